import pickle

import numpy as np
import pytest

import atc
from atc.errors import AtcError
from atc.frame import Cell
from atc.units import units

METAL, NANO = units("metal"), units("nano")
BOX = Cell([8.0, 10.0, 12.0], [1.0, -2.0, 3.0])
TILTED = Cell([[8.0, 0, 0], [2.0, 10.0, 0], [-1.0, 3.0, 12.0]], [1.0, -2.0, 3.0])
LEFT = Cell([[0, 9.0, 0], [8.0, 0, 0], [0, 0, 7.0]])


def test_centers_and_corners():
    for cell in (BOX, TILTED, LEFT):
        c = atc.Grid.regular(shape=(2, 3, 4)).bind(METAL, cell)
        assert c.shape == (2, 3, 4) and c.dims == ("x", "y", "z") and len(c) == 24
        index = np.array(list(np.ndindex(2, 3, 4)))
        np.testing.assert_allclose(c.points_gc, cell.cartesian((index + 0.5) / [2, 3, 4]), atol=1e-14 * 20)
        k = atc.Grid.regular(shape=(2, 3, 4), at="corners").bind(METAL, cell)
        np.testing.assert_allclose(k.points_gc, cell.cartesian(index / [2, 3, 4]), atol=1e-14 * 20)
        for g in (c, k):
            assert g.tiles and g.wraps
            assert g.cell_volume * len(g) == pytest.approx(cell.volume, rel=1e-14)


def test_spacing_is_rounded_to_whole_cells_and_follows_the_frame():
    g = atc.Grid.regular(spacing=1.9)
    assert g.follows_cell
    assert g.bind(METAL, BOX).shape == (4, 5, 6)
    assert g.bind(METAL, BOX.scaled(2.0)).shape == (8, 11, 13)
    assert g.bind(METAL, BOX.scaled(0.01)).shape == (1, 1, 1)
    assert atc.Grid.regular(spacing=(2, 5, 12)).bind(METAL, BOX).shape == (4, 2, 1)


def test_user_units():
    # nano: one length unit is 10 Å.
    g = atc.Grid.regular([0.8, 1.0, 1.2], spacing=0.2, origin=[0.1, -0.2, 0.3])
    assert not g.follows_cell
    b = g.bind(NANO, BOX)
    assert b.shape == (4, 5, 6) and b.tiles
    np.testing.assert_allclose(b.points_gc, atc.Grid.regular(shape=(4, 5, 6)).bind(NANO, BOX).points_gc, atol=1e-14)
    np.testing.assert_allclose(atc.Grid.points([[0.1, 0.2, 0.3]]).bind(NANO, BOX).points_gc, [[1, 2, 3]], rtol=1e-15)
    np.testing.assert_allclose(b.coords(NANO)["x"][1], [0.2, 0.4, 0.6, 0.8], rtol=1e-14)
    # A Cell is in internal units already.
    assert atc.Grid.regular(BOX, shape=2).bind(NANO, BOX).tiles


def test_region_does_not_tile():
    r = atc.Grid.regular([4, 4, 4], shape=2, origin=[1, -2, 3]).bind(METAL, BOX)
    assert not r.tiles and not r.wraps
    np.testing.assert_allclose(r.points_gc[0], [2, -1, 4])
    np.testing.assert_allclose(r.points_gc[-1], [4, 1, 6])
    assert r.cell_volume == pytest.approx(8, rel=1e-14)
    same = atc.Grid.regular(vectors=TILTED.vectors, shape=2, origin=[0, 0, 0]).bind(METAL, TILTED)
    assert same.wraps and same.tiles
    # Shifted along an open axis it no longer covers the cell.
    slab = Cell([8.0, 10.0, 12.0], periodic=(True, True, False))
    assert atc.Grid.regular(slab, shape=3).bind(METAL, slab).tiles
    assert not atc.Grid.regular(slab, shape=3, origin=[0, 0, 9.0]).bind(METAL, slab).tiles


def test_plane():
    p = atc.Grid.plane([1, 2, 3], [4, 0, 0], [0, 3, 3], shape=(2, 3)).bind(METAL, BOX)
    assert p.shape == (2, 3) and p.dims == ("u", "v") and not p.tiles and p.cell_volume is None
    np.testing.assert_allclose(p.points_gc[0], [2, 2.5, 3.5])
    np.testing.assert_allclose(p.points_gc[5], [4, 4.5, 5.5])
    np.testing.assert_allclose(p.coords(METAL)["u"][1], [1, 3])
    corner = atc.Grid.plane([1, 2, 3], [4, 0, 0], [0, 3, 4], spacing=2.5, at="corners").bind(METAL, BOX)
    np.testing.assert_allclose(corner.points_gc[0], [1, 2, 3])
    assert corner.shape == (2, 2)
    np.testing.assert_allclose(corner.coords(METAL)["v"][1], [0, 2.5])
    z = atc.Grid.plane(axis="z", position=2.0, shape=(4, 5)).bind(METAL, BOX)
    assert z.dims == ("x", "y")
    np.testing.assert_allclose(z.points_gc[:, 2], 5.0)
    np.testing.assert_allclose(z.points_gc[0, :2], [2, -1])
    # In a tilted cell the position is the distance from the face.
    t = atc.Grid.plane(axis="x", position=3.0, shape=2).bind(METAL, TILTED)
    normal = TILTED.inverse[:, 0] * TILTED.heights[0]
    np.testing.assert_allclose((t.points_gc - TILTED.origin) @ normal, 3.0)
    middle = atc.Grid.plane(axis="y", shape=1).bind(METAL, TILTED)
    np.testing.assert_allclose(TILTED.fractional(middle.points_gc), [[0.5, 0.5, 0.5]])


def test_line_includes_both_ends():
    g = atc.Grid.line([0, 0, 0], [3, 0, 4], 6).bind(METAL, BOX)
    np.testing.assert_allclose(g.points_gc, np.linspace(0, 1, 6)[:, None] * [3, 0, 4], atol=1e-15 * 8)
    np.testing.assert_allclose(g.coords(METAL)["s"][1], np.arange(6.0))
    assert g.shape == (6,) and g.spacing[0] == pytest.approx(1.0)
    assert len(atc.Grid.line([1, 1, 1], [1, 1, 1], 1).bind(METAL, BOX)) == 1


def test_slab():
    for cell in (BOX, TILTED, LEFT):
        for a, name in enumerate("xyz"):
            g = atc.Grid.slab(name, 5).bind(METAL, cell)
            assert g.shape == (5,) and g.dims == (name,) and g.axis == a
            assert g.cell_volume * 5 == pytest.approx(cell.volume)
            normal = cell.inverse[:, a] * cell.heights[a]
            np.testing.assert_allclose((g.points_gc - cell.origin) @ normal, (np.arange(5) + 0.5) * cell.heights[a] / 5)
    np.testing.assert_allclose(atc.Grid.slab("y", 2).bind(METAL, BOX).coords(METAL)["y"][1], [0.5, 5.5])
    np.testing.assert_allclose(
        atc.Grid.slab("x", 2).bind(METAL, TILTED).coords(METAL)["x"][1], TILTED.heights[0] * np.array([0.25, 0.75])
    )


def test_points_and_atoms():
    x = np.random.default_rng(0).normal(size=(7, 3))
    p = atc.Grid.points(x).bind(METAL, BOX)
    assert np.array_equal(p.points_gc, x) and p.dims == ("point",) and p.shape == (7,)
    a = atc.Grid.atoms()
    assert a.follows_atoms and not a.follows_cell
    b = a.bind(METAL, BOX, x)
    assert np.array_equal(b.points_gc, x) and b.dims == ("atom",)
    assert len(atc.Grid.points([1, 2, 3]).bind(METAL, BOX)) == 1
    with pytest.raises(AtcError, match="atoms"):
        a.bind(METAL, BOX)


def test_coords_give_every_position():
    import xarray as xr

    x = np.random.default_rng(0).normal(size=(7, 3))
    grids = [
        atc.Grid.regular(shape=(2, 3, 4)),
        atc.Grid.regular([[1, 0, 0], [1, 2, 0], [0, 1, 3]], shape=(2, 3, 4)),
        atc.Grid.plane([1, 2, 3], [4, 0, 0], [0, 3, 3], shape=(2, 3)),
        atc.Grid.plane(axis="y", shape=3),
        atc.Grid.line([0, 0, 0], [3, 0, 4], 6),
        atc.Grid.slab("z", 4),
        atc.Grid.points(x),
        atc.Grid.atoms(),
    ]
    for cell in (BOX, TILTED, LEFT):
        for g in grids:
            b = g.bind(NANO, cell, x)
            c = b.coords(NANO)
            ds = xr.Dataset({"f": (b.dims, np.zeros(b.shape))}, coords={k: v for k, v in c.items()})
            if b.kind == "slab":
                continue
            if "position_x" in c:
                got = np.stack([ds[f"position_{d}"].values.ravel() for d in "xyz"], -1)
            else:
                assert b.kind == "regular"
                got = np.stack([m.ravel() for m in np.meshgrid(*[ds[d].values for d in "xyz"], indexing="ij")], -1)
            # 1e-14 of a box of 10 Å = 1 nm.
            np.testing.assert_allclose(got * 10, b.points_gc, atol=1e-14 * 20)
            assert all(v[2]["units"] == "nm" for v in c.values())


def test_a_box_far_away_keeps_its_digits():
    far = Cell([8.0, 10.0, 12.0], [1e6, -1e6, 1e6])
    g = atc.Grid.regular(shape=3)
    # 1e-15: what is relative to the cell is the same to rounding.
    np.testing.assert_allclose(g.bind(METAL, far).relative_points_gc, g.bind(METAL, BOX).relative_points_gc, atol=2e-15)


def test_incomplete_cell_is_completed_from_the_atoms():
    x = np.array([[0.0, 0, 0], [1, 2, 5.0]])
    open_ = Cell(np.diag([4.0, 4.0, 0.0]), periodic=(True, True, False))
    g = atc.Grid.regular(shape=2).bind(METAL, open_, x)
    assert g.cell.complete and g.points_gc[:, 2].max() == pytest.approx(3.75)


def test_pickle_equality_describe():
    grids = [
        atc.Grid.regular(shape=2),
        atc.Grid.regular(BOX, spacing=2.0),
        atc.Grid.plane(axis="z", shape=3),
        atc.Grid.line([0, 0, 0], [1, 1, 1], 3),
    ]
    grids += [atc.Grid.slab("x", 4), atc.Grid.points(np.eye(3)), atc.Grid.atoms()]
    for k, g in enumerate(grids):
        again = pickle.loads(pickle.dumps(g))
        assert again == g and again.describe() == g.describe() and "\n" not in g.describe()
        assert all(g != other for other in grids[k + 1 :])
        b = g.bind(METAL, BOX, np.eye(3))
        assert np.array_equal(pickle.loads(pickle.dumps(b)).points_gc, b.points_gc)


@pytest.mark.parametrize(
    "make, words",
    [
        (lambda: atc.Grid.regular(), "shape"),
        (lambda: atc.Grid.regular(shape=2, spacing=1.0), "either"),
        (lambda: atc.Grid.regular(shape=0), "positive"),
        (lambda: atc.Grid.regular(shape=(2, 0, 2)), "positive"),
        (lambda: atc.Grid.regular(shape=(2, 2, 2, 2)), "3 whole numbers"),
        (lambda: atc.Grid.regular(shape=2.5), "whole"),
        (lambda: atc.Grid.regular(shape="many"), "whole"),
        (lambda: atc.Grid.regular(spacing=0.0), "positive"),
        (lambda: atc.Grid.regular(spacing=-1.0), "positive"),
        (lambda: atc.Grid.regular(spacing=np.nan), "finite"),
        (lambda: atc.Grid.regular(spacing="a"), "numbers"),
        (lambda: atc.Grid.regular(shape=2, at="edges"), "centers"),
        (lambda: atc.Grid.regular([1, 1, 0], shape=2), "no volume"),
        (lambda: atc.Grid.regular([1, np.inf, 1], shape=2), "finite"),
        (lambda: atc.Grid.regular([[1, 0, 0], [2, 0, 0], [0, 0, 1]], shape=2), "no volume"),
        (lambda: atc.Grid.regular(shape=2, origin=[0, np.nan, 0]), "finite"),
        (lambda: atc.Grid.plane(shape=2), "edge vectors"),
        (lambda: atc.Grid.plane([0, 0, 0], [1, 0, 0], [2, 0, 0], shape=2), "parallel"),
        (lambda: atc.Grid.plane([0, 0, 0], [1, 0, 0], [0, 2, 0], axis="z", shape=2), "not both"),
        (lambda: atc.Grid.plane(axis="w", shape=2), "axis"),
        (lambda: atc.Grid.line([0, 0, 0], [0, 0, 0], 3), "same point"),
        (lambda: atc.Grid.line([0, 0, 0], [0, 0, 1], 0), "positive"),
        (lambda: atc.Grid.slab("q", 3), "axis"),
        (lambda: atc.Grid.slab("x", 0), "positive"),
        (lambda: atc.Grid.points([]), "no points"),
        (lambda: atc.Grid.points(np.zeros((0, 3))), "no points"),
        (lambda: atc.Grid.points([[1], [3]]), "expected n x 3"),
        (lambda: atc.Grid.points([[1, 2, 3, 4]]), "expected n x 3"),
        (lambda: atc.Grid.points([[1, 2, np.nan]]), "finite"),
        (lambda: atc.Grid.points("abc"), "numbers"),
    ],
)
def test_bad_input(make, words):
    with pytest.raises(AtcError, match=words) as e:
        make()
    assert "\n" not in str(e.value)
