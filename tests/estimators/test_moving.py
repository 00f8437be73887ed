"""Grids that move with the atoms: a drifting droplet has the fields of one at rest."""

import numpy as np
import pytest
from frames import argon

import atc
from atc.config.scene import Scene
from atc.errors import AtcError
from atc.estimators.moving import centre

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
