"""Grids that move with the atoms: a drifting droplet has the fields of one at rest."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.estimators.moving import centre, interface

LJ = "pair_style lj/cut 5.0\npair_coeff * * 0.0104 3.4"
BIG = atc.Cell([40.0, 42.0, 44.0], [1.0, 2.0, 3.0])
GRIDS = {
    "regular": atc.Grid.regular(shape=(7, 6, 5)),
    "slab": atc.Grid.slab("y", 9),
    "points": atc.Grid.points([[5.0, 8.0, 9.0], [6.0, 7.0, 8.0]]),
    "line": atc.Grid.line([2.0, 3.0, 4.0], [12.0, 11.0, 10.0], 7),
    "plane": atc.Grid.plane(axis="z", position=6.0, shape=(6, 6)),
    "cylindrical": atc.Grid.cylindrical(5.0, (3, 4, 3), center=[6.0, 7.0, 8.0]),
}


def drifting(steps):
    """One droplet, wrapped into the cell at every place that it has drifted to."""
    f = argon("open", temperature=60.0)
    f = f.replace(positions=f.positions + BIG.origin, cell=BIG)
    out = []
    for k, d in enumerate(steps):
        out.append(f.replace(positions=BIG.wrap(f.positions + np.asarray(d, float))[0], step=k))
    return out


@pytest.mark.parametrize("kind", GRIDS)
def test_fields_move_along(kind):
    frames = drifting([[0, 0, 0], [3.3, -2.1, 5.7], [18.0, 19.0, -15.0]])
    pot, kern = atc.potential(LJ, units="metal"), atc.kernel("quartic", 4.0)
    names = ["stress", "density", "velocity"]
    ds = atc.fields(frames, pot, kern, GRIDS[kind].following(), names, tolerance=1e-12)
    for name in names:
        first = ds[name][0].values
        assert np.nanmax(abs(first)) > 0
        for k in (1, 2):
            assert np.array_equal(np.isnan(first), np.isnan(ds[name][k].values))
            assert np.nanmax(abs(ds[name][k].values - first)) < 1e-10 * np.nanmax(abs(first)), (name, k)
            assert ds[name].attrs["error_max"] < 1e-10
    assert np.allclose(ds.grid_shift.values, [[0, 0, 0], [3.3, -2.1, 5.7], [18.0, 19.0, -15.0]])
    mean = atc.fields(frames, pot, kern, GRIDS[kind].following(), names, tolerance=1e-12, average=True)
    assert np.nanmax(abs(mean.density[0].values - ds.density[0].values)) < 1e-10 * float(ds.density.max())
    still = atc.fields(frames, pot, kern, GRIDS[kind], ["density"], tolerance=1e-12)
    assert abs(still.density[1] - still.density[0]).max() > 0.1 * still.density.max()
    assert "moving" in ds.attrs["grid"]
    assert Scene.loads(ds.attrs["scene"]).grid().follows_mass


def test_centres():
    (f,) = drifting([[0, 0, 0]])
    s, told = centre(f)
    assert told.all()
    plain = f.masses @ f.cell.fractional(f.positions) / f.masses.sum()
    # the mean on a circle is not that on a line, but for what is symmetric; both move alike
    assert np.allclose(s, plain, atol=0.02)
    (g,) = drifting([[15.0, 30.0, 39.0]])
    d = centre(g)[0] - s
    assert np.allclose((d - np.rint(d)) @ BIG.vectors, [15.0, 30.0 - 42.0, 39.0 - 44.0])
    full = argon(n=(4, 4, 4), jitter=0.1)
    assert not centre(full)[1].any()


def test_what_is_followed_is_said():
    full = argon(n=(4, 4, 4), jitter=0.1)
    kern = atc.kernel("quartic", 4.0)
    grid = atc.Grid.regular(shape=3).following()
    with pytest.raises(AtcError, match="fill the cell along every axis"):
        atc.fields([full], None, kern, grid, ["density"])
    few = atc.select(ids="1:3")
    moved = full.replace(positions=full.positions + np.where(full.ids[:, None] <= 3, [1.0, 0.5, 0.25], 0.0))
    ds = atc.fields([full, moved], None, kern, grid, ["density"], select=few, tolerance=1e-12)
    assert np.allclose(ds.grid_shift[1], [1.0, 0.5, 0.25])
    assert abs(ds.density[1] - ds.density[0]).max() < 1e-10 * ds.density.max()
    with pytest.raises(AtcError, match='expected "mass"'):
        atc.Grid.regular(shape=3).following("light")
    with pytest.raises(AtcError, match="leave follow out"):
        atc.Grid.atoms().following()


def film(middle, width, dense=1.0, thin=0.05, tanh=0.0, seed=0, periodic="ppp", n=4000):
    """Atoms at random of two densities along z, in a cell of height 60; the interfaces are `width` apart."""
    rng = np.random.default_rng(seed)
    cell = atc.Cell([20.0, 21.0, 60.0], [1.0, -2.0, 3.0], [p == "p" for p in periodic])
    z = rng.random(20 * n) * 60.0
    d = np.abs((z - middle + 30.0) % 60.0 - 30.0) - 0.5 * width
    rho = thin + (dense - thin) * ((d < 0) if not tanh else 0.5 * (1 - np.tanh(d / tanh)))
    z = z[rng.random(len(z)) * max(dense, thin) < rho][:n]
    x = np.column_stack([rng.random(len(z)) * 20.0, rng.random(len(z)) * 21.0, z]) + cell.origin
    return argon("open").replace(
        positions=x, cell=cell, velocities=np.zeros_like(x), forces=None, types=np.ones(len(x), int),
        ids=np.arange(1, len(x) + 1), masses=np.full(len(x), 39.948), charges=None, extra={}, source="film")  # fmt: skip


@pytest.mark.parametrize("middle", [30.0, 2.0, 55.0])
@pytest.mark.parametrize("tanh", [0.0, 3.0])
def test_dividing_surfaces_are_found(middle, tanh):
    """To the accuracy that random places allow: the mass between two planes by which it is found has a standard error
    of √(n)/n_per_length, and so have the densities."""
    for seed, thin in ((0, 0.05), (1, 0.0), (2, 0.6)):
        f = film(middle, 26.0, thin=thin, tanh=tanh, seed=seed)
        per_length = len(f) / (26.0 + 34.0 * thin)
        error = 2.0 * np.sqrt(13.0 * (1 + thin)) / np.sqrt(per_length) / (1 - thin)
        for upper, want in ((True, middle + 13.0), (False, middle - 13.0)):
            d = 60.0 * interface(f, 2, upper) - want
            assert abs(d - 60.0 * np.rint(d / 60.0)) < 3 * error + 0.05, (seed, upper)


def test_a_crystal_that_grows_is_told_from_its_melt():
    """A perfect lattice, and disordered atoms beside it of which one in twelve is missing."""
    rng = np.random.default_rng(3)
    a, L = 3.0, 90.0
    for planes in (10, 16):
        z = (np.arange(30) + 0.5) * a
        sites = np.stack(np.meshgrid(np.arange(16) * a, np.arange(16) * a, z, indexing="ij"), -1).reshape(-1, 3)
        lattice, melt = sites[sites[:, 2] < planes * a], sites[sites[:, 2] > planes * a]
        melt = melt[rng.random(len(melt)) > 1 / 12]
        melt = melt + rng.uniform(-0.9, 0.9, melt.shape)
        x = np.concatenate([lattice, melt]) + [0.0, 0.0, 20.0]
        cell = atc.Cell([48.0, 48.0, L])
        f = argon().replace(positions=cell.wrap(x)[0], cell=cell, velocities=None, forces=None, extra={}, charges=None,
                            types=np.ones(len(x), int), ids=np.arange(1, len(x) + 1), masses=np.ones(len(x)))  # fmt: skip
        # what is missing at random leaves as much in doubt, from the middle of the melt to the front: three times that
        error = 3 * np.sqrt(256 * (30 - planes) / 2 / 12) / (256 / 12 / a)
        assert L * interface(f, 2, True) == pytest.approx(20.0 + planes * a, abs=error)
        assert L * interface(f, 2, False) == pytest.approx(20.0, abs=error)


def test_grids_follow_an_interface():
    """One film at three places: its profile stays, and the shift is that of the surface."""
    f = film(20.0, 26.0, seed=4)
    up = [0.0, 7.25, 38.5]
    frames = [f.replace(positions=f.cell.wrap(f.positions + [0.3 * u, 0.0, u])[0], step=k) for k, u in enumerate(up)]
    kern = atc.kernel("quartic", 4.0)
    for how in ("+z", "-z"):
        grid = atc.Grid.slab("z", 30).following(how)
        ds = atc.fields(frames, None, kern, grid, ["density"], tolerance=1e-12)
        assert np.allclose(ds.grid_shift.values, np.array([[0, 0, (u + 30) % 60 - 30] for u in up]), atol=1e-9)
        assert np.abs(ds.density[1:] - ds.density[0]).max() < 1e-10 * ds.density.max()
        assert how in ds.attrs["grid"] and Scene.loads(ds.attrs["scene"]).grid().follows == how
    # one that grows: the lower surface stays
    grown = [film(20.0 + 2.0 * k, 26.0 + 4.0 * k, thin=0.0, seed=k, n=4000 + 615 * k) for k in range(3)]
    moved = atc.fields(grown, None, kern, atc.Grid.slab("z", 10).following("+z"), ["density"]).grid_shift
    assert np.allclose(moved[:, 2], [0, 4, 8], atol=1.0)


def test_where_there_is_no_interface_it_is_said():
    kern, grid = atc.kernel("quartic", 4.0), atc.Grid.slab("z", 10)
    with pytest.raises(AtcError, match="no two densities are seen along z"):
        atc.fields([film(20.0, 26.0, thin=1.0)], None, kern, grid.following("+z"), ["density"])
    wall = film(13.0, 26.0, thin=0.0, periodic="ppf")
    with pytest.raises(AtcError, match="reaches to the open face"):
        atc.fields([wall], None, kern, grid.following("-z"), ["density"])
    atc.fields([wall], None, kern, grid.following("+z"), ["density"])
    with pytest.raises(AtcError, match="too few to tell two phases"):
        atc.fields([argon()], None, kern, grid.following("+z"), ["density"])
