"""Files of ``atc export`` opened by the programs they are for: VTK and PyVista (ParaView's readers) and OVITO.

Not among the tests that run by default: these packages are large, and live in an environment of their own. ``make
test-tools`` makes it and runs these.
"""

import numpy as np
import pytest
from frames import argon
from systems_exported import fields, regular  # noqa: F401

import atc
from atc.export.export import export

pytestmark = pytest.mark.tools


def test_paraview_reads_it(regular):  # noqa: F811
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    ds, _, files = regular
    for k, path in enumerate(files):
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        image = reader.GetOutput()
        assert image.GetDimensions() == (5, 4, 3)
        np.testing.assert_allclose(image.GetOrigin(), [ds.x[0], ds.y[0], ds.z[0]], rtol=1e-12)
        np.testing.assert_allclose(image.GetSpacing(), [ds[a][1] - ds[a][0] for a in "xyz"], rtol=1e-12)
        for name in ("density", "velocity", "stress", "mask"):
            array = image.GetPointData().GetArray(name)
            want = ds[name][k].values
            got = vtk_to_numpy(array).reshape(3, 4, 5, *want.shape[3:]).swapaxes(0, 2)
            np.testing.assert_array_equal(got, want)
            assert array.GetInformation().Get(vtk.vtkDataArray.UNITS_LABEL()) == ds[name].attrs["units"]


def test_pyvista_reads_series_lattices_and_points(tmp_path, regular):  # noqa: F811
    import pyvista as pv

    ds, series, _ = regular
    reader = pv.get_reader(series)
    assert reader.time_values == [0.0, 1.0]
    reader.set_active_time_value(1.0)
    (block,) = reader.read()
    np.testing.assert_array_equal(block["density"].reshape(3, 4, 5).T, ds.density[1])
    for grid, cell in (
        (atc.Grid.regular(shape=(3, 2, 2)), "tilted"),
        (atc.Grid.plane([1, 2, 50], [3, 1, 0], [0, 2, 1], shape=(4, 3)), "orthogonal"),
        (atc.Grid.points([[1, 2, 3], [4, 5, 6]]), "orthogonal"),
        (atc.Grid.atoms(), "orthogonal"),
    ):
        out = fields(grid, cell, frames=1)
        suffix = ".vtu" if grid.kind in ("points", "atoms") else ".vts"
        mesh = pv.read(export(out, tmp_path / f"{grid.kind}{suffix}"))
        frame = argon(cell, seed=0)
        bound = grid.bind(frame.units, frame.cell, frame.positions)
        shape = bound.shape
        points = bound.points_gc.reshape(*shape, 3)
        fastest = lambda a: np.moveaxis(a, range(len(shape)), range(len(shape))[::-1]).reshape(len(bound), -1)  # noqa: B023, E731
        np.testing.assert_allclose(mesh.points, fastest(points), atol=1e-12 * np.abs(points).max())
        np.testing.assert_array_equal(mesh["stress_potential"], fastest(out.stress_potential[0].values))


def test_ovito_reads_vti_and_series(regular):  # noqa: F811
    from ovito.io import import_file

    ds, series, files = regular
    assert import_file(str(files[0])).compute().grids
    pipeline = import_file(str(series))
    assert pipeline.source.num_frames == 2
    for k in range(2):
        (grid,) = pipeline.compute(k).grids.values()
        assert tuple(grid.shape) == (5, 4, 3)
        np.testing.assert_allclose(grid.domain[:, 3], [ds.x[0], ds.y[0], ds.z[0]], rtol=1e-12)
        np.testing.assert_allclose(
            np.diag(grid.domain[:, :3]), [float(ds[a][-1] - ds[a][0]) for a in "xyz"], rtol=1e-12
        )
        for name in ("density", "velocity", "stress", "mask"):
            want = ds[name][k].values
            got = np.asarray(grid[name]).reshape(3, 4, 5, *want.shape[3:]).swapaxes(0, 2)
            np.testing.assert_array_equal(got, want)


@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
def test_ovito_reads_dump_grid(tmp_path, cell):
    """As voxels: components by their names, the box that of the cell, its periodicity, steps and times."""
    from ovito.io import import_file

    ds = fields(atc.Grid.regular(shape=(3, 4, 5)), cell, ["density", "velocity", "stress"])
    pipeline = import_file(str(export(ds, tmp_path / "out.grid")))
    assert pipeline.source.num_frames == 2
    own = argon(cell).cell
    for k in range(2):
        data = pipeline.compute(k)
        assert data.attributes["Timestep"] == k
        (grid,) = data.grids.values()
        assert tuple(grid.shape) == (3, 4, 5) and tuple(grid.domain.pbc) == (True, True, True)
        np.testing.assert_allclose(grid.domain[:, :3].T, own.vectors, atol=1e-12 * np.abs(own.vectors).max())
        np.testing.assert_allclose(grid.domain[:, 3], own.origin, atol=1e-12)
        of = lambda name: np.asarray(grid[name]).reshape(5, 4, 3).T  # noqa: B023, E731
        # Its own parser of numbers may be off in the last bits.
        same = lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-15)  # noqa: E731
        same(of("density"), ds.density[k])
        same(of("velocity_z"), ds.velocity[k, ..., 2])
        for c in ("xx", "yx", "zz"):
            same(of(f"stress_{c}"), ds.stress[k].sel(i=c[0], j=c[1]))


def test_ovito_reads_undefined_values_and_masks(tmp_path, regular):  # noqa: F811
    from ovito.io import import_file

    ds, _, _ = regular
    (grid,) = import_file(str(export(ds, tmp_path / "out.grid"))).compute(0).grids.values()
    of = lambda name: np.asarray(grid[name]).reshape(3, 4, 5).T  # noqa: E731
    np.testing.assert_array_equal(of("mask").astype(bool), ds.mask[0])
    np.testing.assert_allclose(of("velocity_x"), ds.velocity[0, ..., 0], rtol=1e-15)
    assert np.isnan(of("velocity_x")).any()


def test_ovito_reads_points_of_extxyz(tmp_path):
    from ovito.io import import_file

    ds = fields(atc.Grid.points([[1, 2, 3], [4, 5, 6.5]]), quantities=["density", "momentum"])
    pipeline = import_file(str(export(ds, tmp_path / "out.extxyz")))
    assert pipeline.source.num_frames == 2
    for k in range(2):
        particles = pipeline.compute(k).particles
        np.testing.assert_allclose(particles.positions, [[1, 2, 3], [4, 5, 6.5]], rtol=1e-12)
        # Its own parser of numbers may be off in the last bit.
        np.testing.assert_allclose(particles["momentum"], ds.momentum[k], rtol=1e-15)
        np.testing.assert_allclose(particles["density"], ds.density[k], rtol=1e-15)
