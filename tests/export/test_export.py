"""Fields in the files of other programs: what is written is read back, point by point."""

import re
from base64 import b64decode

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.errors import AtcError
from atc.export.export import export
from atc.frame import Cell


def appended(path):
    """{name: array} of a VTK XML file with raw appended data, by the format's definition; and its XML."""
    raw = path.read_bytes()
    head, _, tail = raw.partition(b'<AppendedData encoding="raw">\n_')
    xml = head.decode()
    types = {"Float64": "<f8", "UInt8": "u1", "Int32": "<i4", "Int64": "<i8"}
    out = {}
    for tag in re.findall(r"<DataArray [^>]*>", xml):
        a = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        at = int(a["offset"])
        size = int(np.frombuffer(tail[at : at + 8], "<u8")[0])
        values = np.frombuffer(tail[at + 8 : at + 8 + size], types[a["type"]])
        out[a["Name"]] = values.reshape(-1, int(a["NumberOfComponents"])) if "NumberOfComponents" in a else values
    return out, xml


def inline(path):
    """The same of a file whose numbers stand in base64 where their array is, by the format's definition."""
    xml = path.read_text()
    types = {"Float64": "<f8", "Int32": "<i4"}
    out = {}
    for tag, text in re.findall(r"<DataArray ([^>]*)>([^<]+)", xml):
        a = dict(re.findall(r'(\w+)="([^"]*)"', tag))
        assert a["format"] == "binary"
        block = b64decode(text, validate=True)
        assert int(np.frombuffer(block[:8], "<u8")[0]) == len(block) - 8
        values = np.frombuffer(block[8:], types[a["type"]])
        out[a["Name"]] = values.reshape(-1, int(a["NumberOfComponents"])) if "NumberOfComponents" in a else values
    assert len(out) == xml.count("<DataArray ")
    return out, xml


def fields(grid, cell="orthogonal", quantities=("density", "stress_potential"), frames=2, **more):
    traj = [argon(cell, seed=k) for k in range(frames)]
    return atc.fields(traj, BruteLJ(), atc.kernel("quartic", 6.0), grid, list(quantities), **more)


def test_regular_grid_is_image_data(tmp_path):
    ds = fields(atc.Grid.regular(shape=(3, 4, 5)))
    path = export(ds, tmp_path / "out.pvd")
    files = sorted((tmp_path / "out").iterdir())
    assert path == tmp_path / "out.pvd" and [f.name for f in files] == ["out_00000.vti", "out_00001.vti"]
    assert re.findall(r'file="([^"]*)"', path.read_text()) == ["out/out_00000.vti", "out/out_00001.vti"]
    got, xml = inline(files[1])
    assert 'WholeExtent="0 2 0 3 0 4"' in xml and 'type="ImageData"' in xml
    origin = np.array(re.search(r'Origin="([^"]*)"', xml).group(1).split(), float)
    spacing = np.array(re.search(r'Spacing="([^"]*)"', xml).group(1).split(), float)
    np.testing.assert_allclose(origin, [ds.x[0], ds.y[0], ds.z[0]], rtol=1e-12)
    np.testing.assert_allclose(spacing, [ds.x[1] - ds.x[0], ds.y[1] - ds.y[0], ds.z[1] - ds.z[0]], rtol=1e-12)
    # x runs fastest in VTK
    for name, width in (("density", ()), ("stress_potential", (9,))):
        want = ds[name][1].values.reshape(3, 4, 5, *width)
        assert np.array_equal(got[name].reshape(5, 4, 3, *width), np.moveaxis(want, (0, 1, 2), (2, 1, 0)))


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


def test_paraview_reads_it(regular):
    vtk = pytest.importorskip("vtk")
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


def test_ovito_reads_it(regular):
    pytest.importorskip("ovito")
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


@pytest.mark.parametrize("grid, shape", [
    (atc.Grid.regular(shape=(3, 4, 5)), (3, 4, 5)),
    (atc.Grid.plane([1, 2, 50], [3, 1, 0], [0, 2, 1], shape=(4, 3)), (4, 3, 1)),
    (atc.Grid.line([1, 2, 3], [4, 2, 8], 6), (6, 1, 1)),
])  # fmt: skip
def test_other_lattices_are_structured_grids(tmp_path, grid, shape):
    ds = fields(grid, "tilted", frames=1)
    path = export(ds, tmp_path / "out.vts")
    got, xml = appended(path)
    assert f'WholeExtent="0 {shape[0] - 1} 0 {shape[1] - 1} 0 {shape[2] - 1}"' in xml
    frame = argon("tilted", seed=0)
    points = grid.bind(frame.units, frame.cell).points_gc.reshape(*shape, 3)
    fastest = lambda a: np.moveaxis(a, (0, 1, 2), (2, 1, 0)).reshape(-1, *a.shape[3:])  # noqa: E731
    np.testing.assert_allclose(got["Points"], fastest(points), rtol=1e-12)
    assert np.array_equal(got["density"], fastest(ds.density[0].values.reshape(shape)))


def test_points_and_atoms(tmp_path):
    import ase.io
    import meshio

    ds = fields(atc.Grid.atoms(), quantities=["density", "velocity"])
    export(ds, tmp_path / "out.pvd")
    x = np.stack([ds[f"position_{a}"][1] for a in "xyz"], axis=-1)
    mesh = meshio.read(tmp_path / "out" / "out_00001.vtu")
    assert np.array_equal(mesh.points, x) and np.array_equal(mesh.point_data["velocity"], ds.velocity[1])
    export(ds, tmp_path / "out.extxyz")
    frames = ase.io.read(tmp_path / "out.extxyz", index=":")
    assert np.array_equal(frames[1].positions, x) and np.array_equal(frames[1].arrays["density"], ds.density[1])
    np.testing.assert_allclose(frames[1].cell.array, ds.cell[1], rtol=1e-15)
    points = fields(atc.Grid.points([[1, 2, 3], [4, 5, 6]]), quantities=["stress_potential"], frames=1)
    export(points, tmp_path / "p.vtu", quantities="stress_potential")
    mesh = meshio.read(tmp_path / "p.vtu")
    np.testing.assert_allclose(mesh.points, [[1, 2, 3], [4, 5, 6]], rtol=1e-12)
    assert np.array_equal(mesh.point_data["stress_potential"].reshape(2, 3, 3), points.stress_potential[0])


def test_columns_of_the_dump(tmp_path):
    import ase.io

    frame = argon()
    frame = frame.replace(extra={"c_pe": np.linspace(-1, 1, len(frame))})
    name = "column:c_pe:mean"
    ds = atc.fields([frame], None, atc.kernel("quartic", 6.0), atc.Grid.atoms(), [name], column_units={"c_pe": "eV"})
    export(ds, tmp_path / "out.extxyz")
    atoms = ase.io.read(tmp_path / "out.extxyz")
    assert (
        np.array_equal(atoms.arrays["column_c_pe_mean"], ds[name][0]) and "column_c_pe_mean=eV" in atoms.info["Units"]
    )


def test_messages(tmp_path):
    ds = fields(atc.Grid.regular(shape=(2, 2, 2)), frames=1)
    for target, options, words in (
        ("out.stl", {}, r"expected a name that ends in \.pvd"),
        ("out.vtu", {}, r"goes into \.vti files"),
        ("out.extxyz", {}, "take .pvd"),
        ("none/out.pvd", {}, "no directory"),
        ("out.pvd", {"quantities": ["heat"]}, "heat is not a field of this output: it holds density"),
        ("out.pvd", {"frames": slice(5, 6)}, "no frame is selected"),
    ):
        with pytest.raises(AtcError, match=words):
            export(ds, tmp_path / target, **options)
    box = atc.fields(argon(), BruteLJ(), quantities=["virial_stress"])
    with pytest.raises(AtcError, match="nothing to export"):
        export(box, tmp_path / "out.pvd")


def test_command_line(tmp_path):
    from typer.testing import CliRunner

    from atc.cli import app

    traj = [argon(seed=k) for k in range(3)]
    atc.fields(
        traj,
        BruteLJ(),
        atc.kernel("quartic", 6.0),
        atc.Grid.regular(shape=(2, 2, 2)),
        ["density"],
        out=tmp_path / "out.nc",
    )
    result = CliRunner().invoke(app, ["export", str(tmp_path / "out.nc"), "-b", "1", "-q", "density"])
    assert result.exit_code == 0 and result.output.strip() == str(tmp_path / "out.pvd")
    assert len(list((tmp_path / "out").iterdir())) == 2
    (tmp_path / "case.toml").write_text(
        '[body]\nregion = { shape = "box", lo = [0, 0, 0], hi = [4, 4, 4] }\nspacing = 1.0\nhorizon = 2.01\ndensity = '
        "1.0\n"
        '[material]\nmodel = "pmb"\nbulk = 1.0\n[run]\nsteps = 4\n[output]\nevery = 2\n'
    )
    result = CliRunner().invoke(app, ["pd", str(tmp_path / "case.toml"), "--check"])
    assert result.exit_code == 0 and "125 nodes in 3 dimensions" in result.output and "4 steps to" in result.output
    result = CliRunner().invoke(
        app, ["pd", str(tmp_path / "case.toml"), "-o", str(tmp_path / "pd.zarr"), "--set", "run.steps=6"]
    )
    assert result.exit_code == 0 and "of 125 nodes at 4 times" in result.output and "6 steps in" in result.output
    for arguments, words in (
        (["pd", str(tmp_path / "case.toml"), "-o", str(tmp_path / "pd.zarr")], "exists: give --overwrite"),
        (["pd", str(tmp_path / "case.toml")], "say where the result goes"),
        (["pd", str(tmp_path / "case.toml"), "-o", "x.txt"], "ends in .zarr or .nc"),
        (["pd", str(tmp_path / "case.toml"), "-j", "-1", "-o", "x.nc"], "-j -1"),
    ):
        result = CliRunner().invoke(app, arguments)
        assert result.exit_code == 2 and words in result.stderr and "\n" not in result.stderr.strip(), result.stderr


@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
def test_a_cell_that_changes(tmp_path, cell):
    """Points of every frame's own grid."""
    first = argon(cell)
    second = first.replace(
        cell=Cell(1.25 * first.cell.vectors, 1.25 * first.cell.origin), positions=1.25 * first.positions
    )
    kern = atc.kernel("quartic", 6.0)
    ds = atc.fields([first, second], None, kern, atc.Grid.regular(shape=(2, 3, 4)), ["number_density"])
    export(ds, tmp_path / "out.pvd")
    points = [appended(tmp_path / "out" / f"out_{k:05d}.vts")[0]["Points"] for k in range(2)]
    np.testing.assert_allclose(points[1], 1.25 * points[0], rtol=1e-12)
    each = [(np.arange(n) + 0.5) / n for n in (2, 3, 4)]
    s_nc = np.stack(np.meshgrid(*each, indexing="ij"), axis=-1).reshape(2, 3, 4, 3)
    x_nc = first.cell.origin + s_nc @ first.cell.vectors
    np.testing.assert_allclose(points[0], x_nc.transpose(2, 1, 0, 3).reshape(-1, 3), rtol=1e-12)
