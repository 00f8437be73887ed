"""Outputs that the tests of exported files share."""

import pytest
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.export.export import export


def fields(grid, cell="orthogonal", quantities=("density", "stress_potential"), frames=2, **more):
    traj = [argon(cell, seed=k) for k in range(frames)]
    return atc.fields(traj, BruteLJ(), atc.kernel("quartic", 6.0), grid, list(quantities), **more)


@pytest.fixture(scope="module")
def regular(tmp_path_factory):
    """A volume with a mask and NaN where there is no mass, and its files."""
    folder = tmp_path_factory.mktemp("regular")
    traj = [argon("open", seed=k) for k in range(2)]
    ds = atc.fields(
        traj, BruteLJ(), atc.kernel("quartic", 4.0), atc.Grid.regular([60.0, 50.0, 40.0], shape=(5, 4, 3)),
        ["density", "velocity", "stress"],
    )  # fmt: skip
    assert not ds.mask.all() and ds.mask.any()
    return ds, export(ds, folder / "out.pvd"), sorted((folder / "out").iterdir())
