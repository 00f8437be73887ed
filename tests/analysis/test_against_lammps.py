"""LAMMPS's own averages over cells and bins: read, and laid beside the fields of the same run. With the box as kernel,
of the cells' size, both are the same sums."""

import gzip

import numpy as np
import pytest
from lammps_oracle import lammps_session
from typer.testing import CliRunner

import atc
from atc.analysis.against_lammps import compare_with_lammps
from atc.cli import app
from atc.errors import AtcError

RUN = """
units lj
atom_style atomic
lattice fcc 0.8442
region box block 0 5 0 4 0 3
create_box 1 box
create_atoms 1 box
mass * 1.0
velocity all create 1.44 87287
pair_style lj/cut 2.5
pair_coeff * * 1 1
fix 1 all nve
run 50
compute st all stress/atom NULL pair
compute c1 all chunk/atom bin/1d z lower 1.6795961914 units box
compute c3 all chunk/atom bin/3d x lower 0.2 y lower 0.25 z lower 0.3333333333333333 units reduced
compute ct all chunk/atom type
fix ag all ave/grid 10 1 10 5 4 3 density/number density/mass vx c_st[1] c_st[4]
fix a1 all ave/chunk 10 1 10 c1 density/mass density/number vx temp c_st[1] c_st[4] file a1.txt
fix a3 all ave/chunk 10 1 10 c3 density/mass density/number vx file a3.txt
fix at all ave/chunk 10 1 10 ct vx file at.txt
dump d all grid 10 d.grid f_ag:grid:count f_ag:grid:data[*]
dump x all custom 10 x.dump id type x y z vx vy vz
dump_modify x format float %.17g sort id
dump_modify d format float %.17g time yes units yes
run 30
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    with pytest.MonkeyPatch.context() as m:
        m.chdir(folder)
        with lammps_session() as lmp:
            lmp.commands_string(RUN)
    traj = atc.read(folder / "x.dump", units="lj", masses={1: 1.0})
    pot = atc.potential("pair_style lj/cut 2.5\npair_coeff * * 1 1", units="lj")
    size = np.diag(traj[0].cell.vectors) / (5, 4, 3)
    kern = atc.kernel("box", size=size.tolist())
    names = ["density", "number_density", "momentum", "smoothed_virial_stress_potential", "temperature", "velocity"]
    make = lambda grid: atc.fields(traj, pot, kern, grid, names, tolerance=1e-12)  # noqa: E731
    cells, slab = make(atc.Grid.regular(shape=(5, 4, 3))), make(atc.Grid.slab("z", 3))
    slab.to_netcdf(folder / "slab.nc", engine="h5netcdf")
    return folder, cells, slab


def test_dump_grid_is_the_same_sum(run):
    folder, cells, _ = run
    names = {
        "number_density": "f_ag:grid:data[1]",
        "density": "f_ag:grid:data[2]",
        "momentum_x": "f_ag:grid:data[3] * f_ag:grid:data[2]",
        "smoothed_virial_stress_potential_xx": "f_ag:grid:data[4]*f_ag:grid:data[1]",
        "smoothed_virial_stress_potential_xy": "f_ag:grid:data[5]*f_ag:grid:data[1]",
    }
    found = compare_with_lammps(cells, folder / "d.grid", names)
    assert len(found.rows) == 5 and "4 steps that both have" in found.title
    for row in found.rows:
        assert row["relative max"] < 1e-12, row  # of 17 digits
        assert abs(row["mean, atc"] - row["mean, LAMMPS"]) < 1e-12 * max(1, abs(row["mean, atc"]))


def test_chunks_are_the_same_to_their_six_digits(run):
    folder, cells, slab = run
    own = ["momentum_x = vx * density/mass", "smoothed_virial_stress_potential_xy = c_st[4] * density/number"]
    for ds, file, columns, count in (
        (slab, "a1.txt", None, 4),
        (slab, "a1.txt", own, 2),
        (cells, "a3.txt", own[:1], 1),
        (cells, "a3.txt", None, 3),
        (cells, "a1.txt", own[:1], 1),  # the mean of the volume over x and y
    ):
        rows = [r for r in compare_with_lammps(ds, folder / file, columns).rows if "temp" not in r["name"]]
        assert len(rows) == count - (file == "a1.txt" and columns is None)
        for row in rows:
            # A bin's velocity is a small mean of large numbers, its own digits those of the mean.
            assert row["relative max"] < 2e-5, row


def test_what_temp_is_beside_temperature_is_said(run):
    folder, _, slab = run
    found = compare_with_lammps(slab, folder / "a1.txt")
    assert any("temp of LAMMPS holds the mean velocity" in n for n in found.notes)
    (row,) = [r for r in found.rows if r["name"] == "temperature = temp"]
    assert 1e-4 < row["relative max"] < 0.1


def test_read_grid(run):
    folder, cells, _ = run
    ds = atc.read_grid(folder / "d.grid")
    assert ds.attrs["units"] == "lj" and ds.sizes == {"frame": 4, "x": 5, "y": 4, "z": 3, "edge": 3, "i": 3}
    np.testing.assert_allclose(ds.x, cells.x, rtol=1e-12)
    np.testing.assert_array_equal(ds.step, [50, 60, 70, 80])
    assert float(ds["f_ag:grid:count"].sum()) == 4 * 240
    (folder / "a3.txt.gz").write_bytes(gzip.compress((folder / "a3.txt").read_bytes()))
    for name in ("a3.txt", "a3.txt.gz"):
        chunks = atc.read_grid(folder / name, units="lj")
        assert chunks["Ncount"].dims == ("frame", "bin1", "bin2", "bin3") and chunks["vx"].attrs["units"] == "sigma/tau"
        np.testing.assert_allclose(chunks["density/number"], ds["f_ag:grid:data[1]"], rtol=1e-5)
    types = atc.read_grid(folder / "at.txt")
    assert types["vx"].dims == ("frame", "chunk") and types["chunk"].values.tolist() == [1]


def test_our_own_export_comes_back(run, tmp_path):
    from atc.export.export import export

    _, cells, _ = run
    back = atc.read_grid(export(cells, tmp_path / "out.grid"))
    np.testing.assert_array_equal(back["momentum_y"], cells.momentum[..., 1])
    np.testing.assert_allclose(back.z, cells.z, rtol=1e-12)
    found = compare_with_lammps(cells, tmp_path / "out.grid")
    assert len(found.rows) == 1 + 1 + 3 + 9 + 1 + 3 and max(r["max"] for r in found.rows) == 0.0


def test_vectors_at_three_points_are_no_tensor(run):
    """Three bins of a vector have the shape of one tensor."""
    slab = run[2].isel(frame=0)
    assert slab.sizes["z"] == 3
    np.testing.assert_array_equal(slab.atc.component("y", "momentum"), slab.momentum[:, 1])


def test_command_line(run, tmp_path):
    folder = run[0]
    picture = tmp_path / "p.png"
    result = CliRunner().invoke(
        app,
        ["compare", str(folder / "slab.nc"), str(folder / "a1.txt"), "--picture", str(picture),
         "--column", "momentum_x = vx*density/mass"],
    )  # fmt: skip
    assert result.exit_code == 0 and "momentum_x" in result.output and picture.stat().st_size > 10_000
    for arguments, words in (
        (["--column", "momentum_x = vz"], "has no column 'vz': it has Ncount, density/mass"),
        (["--column", "heat = vx"], "heat: not a field of"),
        (["--column", "momentum_x"], "expected FIELD = COLUMN"),
    ):
        result = CliRunner().invoke(app, ["compare", str(folder / "slab.nc"), str(folder / "a1.txt"), *arguments])
        assert result.exit_code == 2 and words in result.stderr and "\n" not in result.stderr.strip()


def test_messages(run, tmp_path):
    folder, cells, slab = run
    text = (folder / "d.grid").read_text()
    chunk = (folder / "a1.txt").read_text()
    coarse = cells.isel(x=slice(0, 4))
    later = slab.assign_coords(step=slab.step + 1000)

    def file(name, content):
        (tmp_path / name).write_text(content)
        return tmp_path / name

    for make, words in (
        (lambda: compare_with_lammps(cells, folder / "d.grid"), "is not in their names: say it"),
        (lambda: compare_with_lammps(coarse, folder / "d.grid", {"density": "f_ag:grid:count"}), "4 x 4 x 3 points"),
        (lambda: compare_with_lammps(later, folder / "a1.txt"), "no step is in both: the output has 1050 to 1080"),
        (lambda: compare_with_lammps(slab, folder / "at.txt"), "no coordinates"),
        (lambda: compare_with_lammps(slab, folder / "a1.txt", units="metal"), "in 'metal' units"),
        (lambda: atc.read_grid(folder / "x.dump"), "neither a dump grid"),
        (lambda: atc.read_grid(file("a", text[:-200])), r"ends after \d+ of 60 lines of grid cells"),
        (lambda: atc.read_grid(file("b", text.replace("5 4 3", "5 4"))), "line 14: expected three numbers of grid"),
        (lambda: atc.read_grid(file("c", chunk[:-60])), "chunks"),
        (
            lambda: atc.read_grid(file("d", chunk.replace("\n  1 ", "\n  x ", 1))),
            "line 5: expected 9 numbers of chunks",
        ),
        (lambda: atc.read(folder / "a1.txt", units="lj"), "averages over chunks of a run .* atc.read_grid read it"),
        (lambda: atc.read(folder / "d.grid", units="lj"), "grid data of LAMMPS"),
    ):
        with pytest.raises(AtcError, match=words):
            make()
