"""Lattices in periodic cells that they do not fill, and what nodes add up to where nothing cuts their cells."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell


def lattice(length, spacing=1.0, cut=False, axis=0, hi=None, **more):
    edge = np.full(3, 6.0 * spacing)
    edge[axis] = length
    top = np.where(np.arange(3) == axis, length if hi is None else hi, 6.0 * spacing) - 1e-7
    cell = Cell(edge, periodic=np.arange(3) == axis)
    return pd.Body.lattice(
        pd.Box((0, 0, 0), top), spacing, 2.015 * spacing, 1.0, cell=cell, cut=cut, warn=False, **more
    )


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("axis", [0, 2])
def test_a_spacing_that_does_not_divide_a_periodic_edge(axis, cut):
    """11 rows in 10.05 are 9.5 % too much matter, through whichever face, with cut cells too."""
    words = rf"spacing of 1 does not divide .* along {'xyz'[axis]}, 10.05: 11 rows of nodes take 9.45 % more than that"
    with pytest.raises(AtcError, match=words) as e:
        lattice(10.05, axis=axis, cut=cut)
    assert "\n" not in str(e.value) and str(e.value).endswith("that fit: 0.9136363636, 1.005")
    for fits in (10.05 / 11, 1.005):
        body = lattice(10.05, fits, axis=axis, cut=cut)
        assert body.V_n.sum() == pytest.approx(10.05 * (6 * fits) ** 2, rel=1e-6 if not cut else 2e-3)


def test_what_it_says_of_cells_that_nothing_fits():
    box = pd.Box((0, 0, 0), (9.9, 9.9, 0))
    with pytest.raises(AtcError, match="edges with a common part"):
        cell = Cell([10.0, 7.0710678, 1], periodic=(True, True, False))
        pd.Body.lattice(box & pd.Box((0, 0, 0), (9.9, 7, 0)), 1.0, 2.015, 1.0, dimension=2, cell=cell)
    with pytest.raises(AtcError, match="not meet its own image"):
        hexagonal = Cell([[10.0, 0, 0], [5.0, 8.66025, 0], [0, 0, 1]], periodic=(True, True, False))
        pd.Body.lattice(box, 1.0, 2.015, 1.0, dimension=2, cell=hexagonal)
    sheared = Cell([[10.0, 0, 0], [3.0, 10.0, 0], [0, 0, 1]], periodic=(True, True, False))
    body = pd.Body.lattice(box, 1.0, 2.015, 1.0, dimension=2, cell=sheared, warn=False)
    assert len(body) == 100 and np.ptp(body.bonds.sums(np.ones(len(body.bonds)))) == 0


def test_a_body_with_room_around_it_need_not_fit():
    """A bar that stays further from its image than the horizon; and a spacing that is rounded, so that a fourth row comes in."""
    body = lattice(10.05, hi=7.0)
    assert not np.any(body.bonds.images_tc[body.bonds.image_b][:, 0])
    with pytest.raises(AtcError, match="10 rows of nodes take 4.76 % less"):
        lattice(10.5, hi=9.5)
    with pytest.raises(AtcError, match="4 rows of nodes take 33.3 % more .*: 0.25, 0.3333333333$"):
        lattice(1.0, 0.3333)
    assert len(lattice(1.0, 0.3333333333)) == 3 * 6 * 6


def test_more_volume_than_the_cell_has():
    X = np.stack(np.meshgrid(*3 * [np.arange(4.0)], indexing="ij"), -1).reshape(-1, 3)
    cell = Cell([4.0, 4, 4])
    assert pd.Body(X, 1.0, 1.0, 1.5, cell=cell).V_n.sum() == 64
    with pytest.raises(AtcError, match="add up to 70.4, 10 % more than the 64 of the periodic cell"):
        pd.Body(X, 1.1, 1.0, 1.5, cell=cell)
    assert pd.Body(X, 1.1, 1.0, 1.5, cell=cell, crowded=True).V_n.sum() == pytest.approx(70.4)
    plate = X[X[:, 2] == 0]
    flat = Cell([4.0, 4, 1], periodic=(True, True, False))
    with pytest.raises(AtcError, match="add up to 0.33, 3.13 % more than the 0.32"):
        pd.Body(plate, 0.33 / 16, 1.0, 1.5, cell=flat, dimension=2, thickness=0.02)


def box(hi, **more):
    return {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": hi}, "spacing": 1.0, "horizon": 2.015,
                 "density": 2.0, **more},
        "material": {"model": "lps", "youngs": 1.0, "poisson": 0.25, "surface_correction": "energy"},
        "run": {"steps": 1},
    }  # fmt: skip


@pytest.mark.filterwarnings("ignore:.*sample lps")
def test_cases_refuse_and_say_the_mass(tmp_path):
    from atc.cli.pd import describe

    periodic = {"cell": [8.4, 8, 8], "periodic": [True, True, True], "horizon": 2.015}
    with pytest.raises(AtcError, match=r"case: \[body\] a spacing of 1 does not divide .*9 rows .*7.14 % more"):
        Case.load(box([8.4, 8, 8], **periodic)).simulation(1)
    # 9 x 9 x 5 nodes of a box of 8 x 8 x 4
    case = Case.load(box([8, 8, 4]))
    line = describe(case).splitlines()[-1]
    assert line.startswith("volume 405, mass 810; that is 58.2 % more than the 256 of the region")
    ds = case.run(tmp_path / "out.nc", threads=1)
    assert (ds.attrs["volume"], ds.attrs["mass"], ds.attrs["region_volume"]) == (405, 810, 256)
    whole = Case.load(box([8, 8, 8], **{**periodic, "cell": [8, 8, 8]}))
    assert describe(whole).splitlines()[-1] == "volume 512, mass 1024"
    cut = Case.load(box([8, 8, 4], cut=True))
    assert describe(cut).splitlines()[-1] == "volume 256, mass 512"
    sphere = box([0, 0, 0])
    sphere["body"]["region"] = {"shape": "sphere", "center": [0.5, 0.5, 0.5], "radius": 4.0}
    from atc.cases.build import amounts

    found = amounts(Case.load(sphere), Case.load(sphere).simulation(1).body)
    assert found["region_volume"] == pytest.approx(4 / 3 * np.pi * 64, rel=1e-3)


def test_notches_that_cut_nothing():
    for a, b in (
        ((1, 0, 0), (2, 0, 0)),
        ((0, 0, 0), (0, 1, 0)),
        ((1, 0, 0), (1, 1e-12, 0)),
        ((1, 0, 0), (0, np.inf, 0)),
    ):
        with pytest.raises(AtcError, match="two edge vectors that span a plane"):
            pd.Notch((0, 0, 0), a, b)
    with pytest.raises(AtcError, match=r"a notch needs a length: it goes from \[1, 2\] to \[1, 2\]"):
        pd.Notch.line((1, 2), (1, 2))
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (5, 5, 0)), 1.0, 2.015, 1.0, dimension=2, warn=False,
        notches=[pd.Notch.line((-1, 2.5), (2.5, 2.5)), pd.Notch.line((7, 7), (9, 9))],
    )  # fmt: skip
    with pytest.warns(AtcWarning, match="notch 2 crosses no bond of the body"):
        pd.Simulation(body, pd.PMB(1.0), threads=1)
