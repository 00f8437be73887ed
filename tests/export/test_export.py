"""Fields in the files of other programs: what is written is read back, point by point."""

import re
from base64 import b64decode

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ
from systems_exported import fields

import atc
from atc.errors import AtcError
from atc.export.export import export


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


def dump_grids(path):
    """[{header item: its lines}] of a file in the form of ``dump grid``, its numbers as {column: (nx, ny, nz)}."""
    frames = []
    for item in path.read_text().split("ITEM: ")[1:]:
        head, *lines = item.splitlines()
        if not frames or "GRID CELLS" in frames[-1]:
            frames.append({})
        name = next(n for n in ("BOX BOUNDS", "GRID SIZE", "GRID CELLS", head) if head.startswith(n))
        frames[-1][name] = [head.removeprefix(name).split(), *(line.split() for line in lines)]
    for f in frames:
        n = tuple(int(k) for k in f["GRID SIZE"][1])
        columns = np.array(f["GRID CELLS"][1:], float).T.reshape(-1, *n[::-1]).transpose(0, 3, 2, 1)
        f["GRID CELLS"] = dict(zip(f["GRID CELLS"][0], columns, strict=True))
    return frames


@pytest.mark.parametrize("cell, at", [("orthogonal", "centers"), ("tilted", "centers"), ("open", "corners")])
def test_dump_grid(tmp_path, cell, at):
    """Cells around the points: of a grid at the cell's centres their box is the cell itself."""
    ds = fields(atc.Grid.regular(shape=(3, 4, 5), at=at), cell, quantities=["density", "momentum", "stress_potential"])
    path = export(ds, tmp_path / "out.grid")
    frames = dump_grids(path)
    assert len(frames) == 2
    own = argon(cell).cell
    for k, f in enumerate(frames):
        assert ("UNITS" in f) == (k == 0) and f.get("UNITS", [[], ["metal"]])[1] == ["metal"]
        assert f["GRID SIZE"] == [["nx", "ny", "nz"], ["3", "4", "5"]]
        assert f["DIMENSION"][1] == ["3"] and f["TIMESTEP"][1] == [str(k)]
        words, *rows = f["BOX BOUNDS"]
        assert words[-3:] == (["ff"] * 3 if cell == "open" else ["pp"] * 3)
        tilts = dict(zip(words, (float(r[2]) for r in rows))) if words[0] == "xy" else {}
        assert bool(tilts) == (cell == "tilted")
        lo, hi = np.array([r[:2] for r in rows], float).T
        xy, xz, yz = (tilts.get(t, 0.0) for t in ("xy", "xz", "yz"))
        lo[:2] -= [min(0, xy, xz, xy + xz), min(0, yz)]
        hi[:2] -= [max(0, xy, xz, xy + xz), max(0, yz)]
        vectors = np.array([[hi[0] - lo[0], 0, 0], [xy, hi[1] - lo[1], 0], [xz, yz, hi[2] - lo[2]]])
        np.testing.assert_allclose(vectors, own.vectors, atol=1e-12 * np.abs(vectors).max())
        shift = 0.0 if at == "centers" else 0.5
        np.testing.assert_allclose(lo, own.origin - shift * (own.vectors / [[3], [4], [5]]).sum(0), atol=1e-12)
        got = f["GRID CELLS"]
        np.testing.assert_array_equal(got["density"], ds.density[k])
        np.testing.assert_array_equal(got["momentum_y"], ds.momentum[k, ..., 1])
        for i, j in ("xx", "xy", "yx", "zz"):
            np.testing.assert_array_equal(got[f"stress_potential_{i}{j}"], ds.stress_potential[k].sel(i=i, j=j))


def test_dump_grid_of_a_slab(tmp_path):
    ds = fields(atc.Grid.slab("y", 6), frames=1)
    (f,) = dump_grids(export(ds, tmp_path / "out.grid"))
    assert f["GRID SIZE"][1] == ["1", "6", "1"]
    own = argon().cell
    lo, hi = np.array(f["BOX BOUNDS"][1:], float).T
    np.testing.assert_allclose([lo, hi], [own.origin, own.origin + np.diag(own.vectors)], atol=1e-12)
    np.testing.assert_array_equal(f["GRID CELLS"]["density"][0, :, 0], ds.density[0])


def test_dump_grid_refuses_what_it_cannot_hold(tmp_path):
    for grid, cell, words in (
        (atc.Grid.line([1, 2, 3], [4, 2, 8], 6), "orthogonal", "this output is on a line: take .pvd"),
        (atc.Grid.atoms(), "orthogonal", "this output is on atoms: take .pvd"),
        (atc.Grid.regular([[0, 5, 0], [5, 0, 0], [0, 0, 5]], shape=2), "orthogonal", "a along x and b in the x-y"),
        (atc.Grid.slab("z", 4), "tilted", "tilted cell"),
    ):
        with pytest.raises(AtcError, match=words):
            export(fields(grid, cell, ["density"], frames=1), tmp_path / "out.grid")
        assert not (tmp_path / "out.grid").exists()


def test_mdanalysis_and_ase_open_points(tmp_path):
    """Positions, cell and every frame, by the readers of both."""
    import ase.io
    import MDAnalysis as mda

    ds = fields(atc.Grid.points([[1, 2, 3], [4, 5, 6.5], [0.25, 0, 9]]), quantities=["density", "momentum"])
    path = export(ds, tmp_path / "out.xyz")
    x = [[1, 2, 3], [4, 5, 6.5], [0.25, 0, 9]]
    universe = mda.Universe(str(path), format="XYZ", topology_format="XYZ")
    assert len(universe.trajectory) == 2
    for k, atoms in enumerate(ase.io.iread(path, format="extxyz")):
        universe.trajectory[k]
        np.testing.assert_allclose(universe.atoms.positions, x, rtol=1e-6)  # float32
        np.testing.assert_allclose(atoms.positions, x, rtol=1e-12)
        np.testing.assert_array_equal(atoms.arrays["momentum"], ds.momentum[k])
        np.testing.assert_array_equal(atoms.cell.array, ds.cell[k])


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
