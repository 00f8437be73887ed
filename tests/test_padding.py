"""Grids over cells with open faces: nothing of the integrals is lost beyond them, or it is said."""

import warnings

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell
from atc.grids import Grid
from atc.grids.padding import beyond

KERNEL = atc.kernel("quartic", 6.0)


def wire(cell="orthogonal", along="z"):
    """Argon cut down to a wire: shrink-wrapped across `along`."""
    frame = argon(cell, seed=3)
    a = "xyz".index(along)
    s = frame.cell.fractional(frame.positions)
    s -= np.floor(s)
    x = frame.cell.cartesian(s)
    low, high = s.min(0), s.max(0)
    low[a], high[a] = 0.0, 1.0
    v = frame.cell.vectors * (high - low)[:, None]
    periodic = np.arange(3) == a
    return frame.replace(positions=x, cell=Cell(v, frame.cell.cartesian(low), periodic), images=None)


def mass_of(ds, frame, dims="xyz"):
    steps = [float(ds[d][1] - ds[d][0]) for d in dims]
    return float(ds.density[0].sum()) * np.prod(steps)


def test_padding_keeps_the_mass_and_the_section_force():
    frame = wire()
    volume = lambda **more: atc.fields(  # noqa: E731
        [frame], BruteLJ(), KERNEL, Grid.regular(shape=(40, 40, 16), **more), ["density", "stress_potential"]
    )
    with pytest.warns(AtcWarning, match=r"open faces of the cell \(x, y\).* padding = \"auto\"") as said:
        cut = volume()
    with warnings.catch_warnings():
        warnings.simplefilter("error", AtcWarning)
        whole = volume(padding="auto")
    u = frame.units
    total = u.to_user("mass", frame.masses.sum())
    unit = u.factor("density") * u.factor("volume") / u.factor("mass")
    assert mass_of(whole, frame) * unit == pytest.approx(total, rel=2e-4)
    lost = 1 - mass_of(cut, frame) * unit / total
    share, axes = beyond(Grid.regular(spacing=1.0), KERNEL, frame)
    assert axes == "x, y" and lost > 0.1 and share == pytest.approx(lost, rel=0.1)
    assert f"{100 * share:.2g} %" in str(said[0].message)
    # the force through sections, of the grid and of slabs, whose side faces do not cut kernels off
    slab = atc.fields([frame], BruteLJ(), KERNEL, Grid.slab("z", 16), ["stress_potential"])
    area = abs(np.linalg.det(u.to_user("length", frame.cell.vectors))) / u.to_user("length", frame.cell.heights[2])
    dx, dy = (float(whole[d][1] - whole[d][0]) for d in "xy")
    force = whole.stress_potential[0, :, :, :, 2, 2].sum(("x", "y")).values * dx * dy
    wanted = slab.stress_potential[0, :, 2, 2].values * area
    np.testing.assert_allclose(force, wanted, atol=2e-4 * np.abs(wanted).max())
    short = cut.stress_potential[0, :, :, :, 2, 2].sum(("x", "y")).values
    short = short * float(cut.x[1] - cut.x[0]) * float(cut.y[1] - cut.y[0])
    assert np.abs(short - wanted).max() > 0.05 * np.abs(wanted).max()


@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
def test_padded_slab_has_all_the_mass(cell):
    frame = wire(cell, "x")
    names = ["density", "velocity", "stress", "virial_stress"]
    with pytest.warns(AtcWarning, match=r"open faces of the cell \(z\)"):
        cut = atc.fields([frame], BruteLJ(), KERNEL, Grid.slab("z", 30), names)
    ds = atc.fields([frame], BruteLJ(), KERNEL, Grid.slab("z", 400, padding="auto"), names, tolerance=1e-8)
    assert ds.attrs["measured_error"] < 1e-8
    u = frame.units
    z = ds[next(iter(ds.density[0].dims))].values
    area = u.to_user("volume", frame.cell.volume) / u.to_user("length", frame.cell.heights[2])
    unit = u.factor("density") * u.factor("volume") / u.factor("mass")
    total = u.to_user("mass", frame.masses.sum())
    assert float(ds.density[0].sum()) * (z[1] - z[0]) * area * unit == pytest.approx(total, rel=1e-3)
    assert np.ptp(z) + z[1] - z[0] == pytest.approx(u.to_user("length", frame.cell.heights[2]) + 12.0)
    np.testing.assert_array_equal(ds.virial_stress, cut.virial_stress)
    # the same bins: what lies within the cell is the same field
    inner = np.interp(cut[cut.density.dims[-1]].values, z, ds.density[0].values)
    np.testing.assert_allclose(inner, cut.density[0].values, atol=2e-3 * float(ds.density.max()))


def test_padded_planes_and_points_agree():
    frame = wire("tilted", "x")
    grid = Grid.plane(axis="x", position=4.0, spacing=2.0, padding=5.0)
    ds = atc.fields([frame], BruteLJ(), KERNEL, grid, ["density", "stress_potential"])
    bound = grid.bind(frame.units, frame.cell)
    points = Grid.points(frame.units.to_user("length", bound.points_gc))
    want = atc.fields([frame], BruteLJ(), KERNEL, points, ["density", "stress_potential"])
    for name in ("density", "stress_potential"):
        have = ds[name][0].values.reshape(want[name][0].shape)
        np.testing.assert_allclose(have, want[name][0].values, atol=1e-5 * np.abs(have).max())
    # the plane is where it was, and larger by 5 at each open face
    plain = Grid.plane(axis="x", position=4.0, spacing=2.0).bind(frame.units, frame.cell)
    normal = frame.cell.inverse[:, 0] * frame.cell.heights[0]
    np.testing.assert_allclose(bound.points_gc @ normal, (plain.points_gc @ normal)[0], rtol=1e-12)
    s, t = (frame.cell.fractional(b.points_gc) * frame.cell.heights for b in (bound, plain))
    edges = np.array([np.linalg.norm(b.steps, axis=1) * b.counts for b in (bound, plain)])
    stretch = (frame.cell.heights[1:] + 10.0) / frame.cell.heights[1:]
    np.testing.assert_allclose(edges[0], edges[1] * stretch, rtol=1e-12)
    np.testing.assert_allclose((s.min(0) + s.max(0))[1:], (t.min(0) + t.max(0))[1:], rtol=1e-9, atol=1e-9)


def test_periodic_cells_and_own_regions_are_left_alone():
    frame = argon()
    a, b = (Grid.regular(shape=4, padding=p).bind(frame.units, frame.cell) for p in (None, 5.0))
    np.testing.assert_array_equal(a.points_gc, b.points_gc)
    assert beyond(Grid.regular(shape=4), KERNEL, frame) == (0.0, "")
    assert beyond(Grid.regular([5, 5, 5], shape=4), KERNEL, wire()) == (0.0, "")
    for make, words in (
        (lambda: Grid.regular(shape=4, padding=-1), "0 or more"),
        (lambda: Grid.regular(shape=4, padding="all"), '"auto"'),
        (lambda: Grid.regular([5, 5, 5], shape=4, padding=1), "region of your own"),
        (lambda: Grid.plane([0, 0, 0], [1, 0, 0], [0, 1, 0], shape=(2, 2), padding=1), "cross-section"),
        (lambda: Grid.slab("z", 3, padding="auto").bind(frame.units, wire().cell), "reach of a kernel"),
    ):
        with pytest.raises(AtcError, match=words):
            make()


def test_padding_is_not_added_where_no_atom_is_near():
    frame = wire()
    wide = Cell(frame.cell.vectors * np.array([9, 9, 1])[:, None], frame.cell.origin - 4 * frame.cell.vectors[:2].sum(0),
                frame.cell.periodic)  # fmt: skip
    from atc.grids.padding import resolved

    assert resolved(Grid.slab("x", 4, padding="auto"), KERNEL, frame)._["padding"] == KERNEL.support
    assert resolved(Grid.slab("x", 4, padding="auto"), KERNEL, frame.replace(cell=wide))._["padding"] == 0.0


def test_fields_of_a_peridynamic_case(tmp_path, monkeypatch):
    """A body of 125 nodes of mass 1 in a cell that ends a horizon away from them, under a kernel twice as wide."""
    from typer.testing import CliRunner

    from atc.cli import app
    from atc.running.opening import load

    monkeypatch.chdir(tmp_path)
    case = (
        '[body]\nregion = { shape = "box", lo = [0, 0, 0], hi = [4, 4, 4] }\nspacing = 1.0\nhorizon = 2.01\n'
        'density = 1.0\n[material]\nmodel = "pmb"\nbulk = 1.0\n[run]\nsteps = 1\n[output]\nevery = 1\n'
        '[kernel]\nname = "quartic"\nradius = 4.0\n[fields]\nquantities = ["density"]\n'
        '[grid]\nkind = "regular"\nspacing = 0.5\n'
    )
    for padding, whole in (("", False), ('padding = "auto"\n', True), ("padding = 4.0\n", True)):
        (tmp_path / "case.toml").write_text(case + padding)
        result = CliRunner().invoke(app, ["pd", "case.toml", "-o", "pd.zarr", "--overwrite"])
        assert result.exit_code == 0 and ("of the mass beyond them" in result.stderr) == (not whole), result.stderr
        ds = load(tmp_path / "pd-fields.zarr")
        steps = np.prod([float(ds[a][1] - ds[a][0]) for a in "xyz"])
        mass = float(ds.density[-1].sum()) * steps
        assert mass == pytest.approx(125.0, rel=1e-3) if whole else mass < 117.0
