"""Where the points are when they move with the atoms or the cell; and outputs that people write again themselves."""

import numpy as np
import pytest
import xarray as xr
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.errors import AtcWarning
from atc.frame import Cell
from atc.pictures.geometry import points_of_grid
from atc.running.opening import open_dataset

KERN = atc.kernel("quartic", radius=5.5)


def breathing(n=3, cell="orthogonal"):
    """Frames whose cell grows a little every time."""
    first = argon(cell, seed=1)
    out = []
    for k in range(n):
        s = 1 + 0.01 * k
        out.append(
            first.replace(
                positions=first.positions * s,
                cell=Cell(first.cell.vectors * s, first.cell.origin * s, first.cell.periodic),
                step=k,
            )
        )
    return out


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
@pytest.mark.parametrize("again", [".zarr", ".nc"])
def test_outputs_can_be_written_again(tmp_path, suffix, again):
    ds = atc.fields(
        breathing(), BruteLJ(), KERN, atc.Grid.regular(shape=3), ["stress", "density"], out=tmp_path / f"a{suffix}"
    )
    path = tmp_path / f"b{again}"
    (ds.to_zarr if again == ".zarr" else ds.to_netcdf)(path)
    xr.testing.assert_identical(open_dataset(path).load(), ds.load())


@pytest.mark.parametrize("suffix", [None, ".zarr", ".nc"])
def test_atoms_carry_their_positions(tmp_path, suffix):
    frames = [argon(seed=k) for k in range(3)]
    out = None if suffix is None else tmp_path / f"a{suffix}"
    ds = atc.fields(frames, None, KERN, atc.Grid.atoms(), ["number_density"], out=out)
    for k, frame in enumerate(frames):
        for c, x in zip("xyz", frame.positions.T):
            assert ds[f"position_{c}"].dims == ("frame", "atom")
            np.testing.assert_allclose(ds[f"position_{c}"][k], frame.units.to_user("length", x), rtol=1e-15)
        np.testing.assert_allclose(
            points_of_grid(ds, ds.number_density.isel(frame=k)).x_gc, frame.positions, rtol=1e-15
        )
    np.testing.assert_allclose(
        points_of_grid(ds, ds.number_density.mean("frame")).x_gc, frames[0].positions, rtol=1e-15
    )
    single = atc.fields(frames[0], None, KERN, atc.Grid.atoms(), ["number_density"])
    assert single.position_x.dims == ("atom",)


@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
def test_points_of_a_changing_cell(cell):
    frames, grid = breathing(cell=cell), atc.Grid.regular(shape=(2, 3, 4))
    ds = atc.fields(frames, None, KERN, grid, ["density"])
    aligned = cell == "orthogonal"
    assert ds.position_x.dims == (("frame", "x") if aligned else ("frame", "x", "y", "z"))
    for k, frame in enumerate(frames):
        points = grid.bind(frame.units, frame.cell).points_gc.reshape(2, 3, 4, 3)
        np.testing.assert_allclose(points_of_grid(ds, ds.density.isel(frame=k)).x_gc, points, rtol=1e-14)
    if aligned:
        np.testing.assert_allclose(ds.x, ds.position_x[0], rtol=1e-15)
        assert "first frame" in ds.x.attrs["comment"]
    still = atc.fields([frames[0]] * 3, None, KERN, grid, ["density"])
    assert ("position_x" in still.coords) == (not aligned) and "comment" not in getattr(still, "x", still.density).attrs
    windows = atc.fields(frames, None, KERN, grid, ["density"], average=2)
    np.testing.assert_allclose(windows.position_x[1], ds.position_x[2], rtol=1e-15)


def test_a_cell_that_changes_later_is_told():
    frames = breathing()
    with pytest.warns(AtcWarning, match="first frame"):
        atc.fields([frames[0], frames[0], frames[1]], None, KERN, atc.Grid.regular(shape=3), ["density"])
