"""NetCDF trajectories, as LAMMPS's manual and AMBER's convention describe them, written by SciPy and netCDF4: units,
scale factors, cell, versions, damage."""

import base64
import zlib

import numpy as np
import pytest
from scipy.io import netcdf_file

import atc
from atc.errors import AtcError, AtcWarning
from atc.readers.lammps.netcdf import LammpsNetcdf
from atc.units import units

# Version 5 ("64-bit data"), which LAMMPS writes and SciPy does not know: written by netCDF4 1.7 (metal; ids 3 1 2; time
# step 0.5).
VERSION_5 = (
    r"c-p;E%}OgV6rS2nm0CpM3JMBE?pm~P*PXfkAYw%n+-jW0xq+CJBo*ED5nQ_T5qtx)bm=4b04`kk0H!l1Gn27GH{O9WUw*&uJ11vrd)N2UZ^}di#&tmdQlKmB"
    r"eferg@hcct0jFgjDT1h1TK6fsz%;*WHJTBo^vu0fb@mX82Na3IUeoFW&TesbjhP~xNt;8W8Fv5f9Os$~`MFapq=7u=gnM&+!=9b)3m%)ai~IG1u-iR4$@u2r"
    r"Op(l<oo%;U`vcl)Z?yj;b6B6T-WAD8S}D}D>A9Z#0V7JfYmGjMxWo}>z5Jex5XEPgC{kP$-mcPl&Cb+a549WXHK{WfBqq!&>3fA*H%orUd7BAYER{(5!s;yn"
    r"#n5?Iidn4w$sg3ack(lRM6vuXKYv2KdJo3}W2c^0@6mFT{9VdAmD0RX;&{&b<F=0{<fys5Q+v(w=3Mj$Ln_a^`VH5(dW^o`!1-qVUSrB5qDW3TF{iE99!SjF"
    r"jm~?D0n7vF(4Yml1_*9~)1ixpj!t!qk4gc(&M?&q%r6*?A53TyrgC9{=m~sjm}~H*!MXkg2(PDC09&r#|CwKBq^DEv;M~NW3DcRuiwWZ+G}=!uklzRRg_qLM"
    r"jd}ra5pWrB)#jJ_`UKzPm5%"
)
N = 5
NAMES = {
    "metal": ("Angstrom", "picosecond"),
    "real": ("Angstrom", "femtosecond"),
    "lj": ("lj", "lj"),
    "si": ("meter", "second"),
    "electron": ("Bohr", "femtosecond"),
}


def write(
    path, style="metal", version=2, frames=3, program="LAMMPS", change=None, origin=True, ids=True, dt=0.25, kind="f8"
):
    """A file of `frames` steps 0, 10, ...; `change(file)` may alter it before it is closed. Returns what was put in, in
    the file's units."""
    rng = np.random.default_rng(0)
    length, time = NAMES[style]
    f = netcdf_file(path, "w", version=version)
    f.Conventions, f.ConventionVersion, f.program, f.programVersion = "AMBER", "1.0", program, "22 Jul 2025"
    for name, size in (
        ("frame", None),
        ("spatial", 3),
        ("atom", N),
        ("cell_spatial", 3),
        ("cell_angular", 3),
        ("label", 10),
        ("Voigt", 6),
    ):
        f.createDimension(name, size)
    per_frame = [
        ("time", "f8", ()),
        ("cell_lengths", "f8", ("cell_spatial",)),
        ("cell_angles", "f8", ("cell_angular",)),
    ]
    per_frame += [("cell_origin", "f8", ("cell_spatial",))] * origin + [("id", "i4", ("atom",))] * ids
    per_frame += [
        ("type", "i4", ("atom",)),
        ("coordinates", kind, ("atom", "spatial")),
        ("velocities", kind, ("atom", "spatial")),
    ]
    per_frame += [
        ("forces", kind, ("atom", "spatial")),
        ("c_s", kind, ("atom", "Voigt")),
        ("q", kind, ("atom",)),
        ("mass", kind, ("atom",)),
    ]
    v = {name: f.createVariable(name, dtype, ("frame", *dims)) for name, dtype, dims in per_frame}
    v["time"].units, v["cell_lengths"].units, v["cell_angles"].units = time, length, "degree"
    v["time"].scale_factor = np.float64(dt)
    put = []
    for k in range(frames):
        p = {
            "time": 10.0 * k,
            "cell_lengths": [8.0, 9.0, 10.0 + k],
            "cell_angles": [80.0, 90.0, 60.0],
            "cell_origin": [1.0, 2.0, 3.0],
        }
        p |= {"id": rng.permutation(N) + 1, "type": rng.integers(1, 3, N), "coordinates": rng.uniform(0, 8, (N, 3))}
        p |= {
            name: rng.normal(size=shape)
            for name, shape in (("velocities", (N, 3)), ("forces", (N, 3)), ("c_s", (N, 6)), ("q", N))
        }
        p["mass"] = rng.uniform(1, 9, N)
        for name, variable in v.items():
            variable[k] = p[name]
        put.append(p)
    if change:
        change(f)
    f.close()
    return put


@pytest.mark.parametrize("style", NAMES)
@pytest.mark.parametrize("version", [1, 2])
def test_every_column_in_the_units_of_the_run(tmp_path, style, version):
    u = units(style)
    put = write(tmp_path / "t.nc", style, version)
    traj = atc.read(tmp_path / "t.nc")
    assert isinstance(traj, LammpsNetcdf) and traj.units is u and len(traj) == 3
    for k, (f, p) in enumerate(zip(traj, put, strict=True)):
        order = np.argsort(p["id"])
        assert f.ids.tolist() == [1, 2, 3, 4, 5] and f.step == 10 * k and f.time == 2.5 * k * u.time
        np.testing.assert_array_equal(f.types, p["type"][order])
        np.testing.assert_array_equal(f.positions, p["coordinates"][order] * u.length)
        np.testing.assert_array_equal(f.velocities, p["velocities"][order] * u.velocity)
        np.testing.assert_array_equal(f.forces, p["forces"][order] * u.factor("force"))
        np.testing.assert_array_equal(f.masses, p["mass"][order] * u.mass)
        np.testing.assert_array_equal(f.charges, p["q"][order] * u.charge)
        np.testing.assert_array_equal(f.extra["c_s[6]"], p["c_s"][order, 5])
        a, b, c = f.cell.vectors / u.length
        np.testing.assert_allclose([np.linalg.norm(e) for e in (a, b, c)], p["cell_lengths"], rtol=1e-14)
        np.testing.assert_allclose(
            [b @ c / (9 * (10 + k)), a @ c / (8 * (10 + k)), a @ b / 72],
            np.cos(np.radians([80, 90, 60])),
            rtol=0,
            atol=1e-15,
        )
        np.testing.assert_allclose(f.cell.origin, np.array([1, 2, 3]) * u.length, rtol=1e-15)
    assert atc.read(tmp_path / "t.nc", units=style).units is u
    with pytest.raises(AtcError, match=rf"t.nc says its units are '{style}' but the units argument says 'nano'"):
        atc.read(tmp_path / "t.nc", units="nano")


def test_version_5(tmp_path):
    (tmp_path / "t.nc").write_bytes(zlib.decompress(base64.b85decode(VERSION_5)))
    traj = atc.read(tmp_path / "t.nc")
    assert traj.units.name == "metal" and [f.step for f in traj] == [0, 10]
    f = traj[1]
    assert f.time == 5 * f.units.time and f.types.tolist() == [2, 1, 1]
    x = np.arange(9.0).reshape(3, 3)[[1, 2, 0]]
    np.testing.assert_array_equal(f.positions, x + 0.5)
    np.testing.assert_array_equal(f.velocities, (-x - 0.25) * f.units.velocity)
    np.testing.assert_allclose(f.cell.vectors, [[8, 0, 0], [4.5, 9 * np.sqrt(0.75), 0], [0, 0, 10]], rtol=0, atol=1e-14)
    with pytest.raises(Exception):  # noqa: B017  SciPy's: this is why there is a reader of our own
        netcdf_file(tmp_path / "t.nc", mmap=False)


def test_what_the_file_leaves_open(tmp_path):
    path = tmp_path / "t.nc"

    def no_units(f):
        del f.variables["time"]._attributes["units"], f.variables["cell_lengths"]._attributes["units"]

    write(path, change=no_units)
    with pytest.raises(AtcError, match="its units are not in the file"):
        atc.read(path)
    assert atc.read(path, units="metal")[1].step == 10

    def fewer(f):
        f.variables["id"][1] = [4, -2147483647, 2, -2147483647, 1]

    put = write(path, change=fewer)
    f = atc.read(path)[1]
    assert f.ids.tolist() == [1, 2, 4]
    np.testing.assert_array_equal(f.positions, put[1]["coordinates"][[4, 2, 0]])

    def open_z(f):
        f.variables["cell_lengths"].data[:, 2] = 0.0

    write(path, change=open_z)
    cell = atc.read(path)[0].cell
    assert cell.periodic.tolist() == [True, True, False] and cell.complete

    def stretched(f):
        f.variables["coordinates"].scale_factor = np.float64(2.0)
        f.variables["velocities"].scale_factor = np.float64(20.455)

    put = write(path, change=stretched)
    f = atc.read(path)[0]
    order = np.argsort(put[0]["id"])
    np.testing.assert_array_equal(f.positions, 2 * put[0]["coordinates"][order])
    np.testing.assert_array_equal(f.velocities, 20.455 * put[0]["velocities"][order] * f.units.velocity)

    def mixed(f):
        f.variables["velocities"].units = "nanometer/picosecond"

    write(path, change=mixed)
    with pytest.raises(AtcError, match="velocities are in 'nanometer/picosecond', but the cell in 'angstrom'"):
        atc.read(path)
    write(path, ids=False, origin=False)
    with pytest.warns(AtcWarning, match="atoms are numbered in file order"):
        f = atc.read(path)[0]
    assert f.ids.tolist() == [1, 2, 3, 4, 5] and f.cell.origin.tolist() == [0, 0, 0]


def test_amber_itself_is_left_to_mdanalysis(tmp_path):
    """Velocities of AMBER are stored in Å per 1/20.455 ps, and the scale factor says so."""
    path = tmp_path / "t.nc"

    def amber(f):
        f.variables["velocities"].units, f.variables["velocities"].scale_factor = (
            "angstrom/picosecond",
            np.float64(20.455),
        )
        f.variables["coordinates"].units, f.variables["forces"].units = "angstrom", "kilocalorie/mole/angstrom"
        f.variables["cell_lengths"].units = "angstrom"
        del f.variables["time"]._attributes["scale_factor"]

    put = write(path, program="pmemd", change=amber, kind="f4")
    f = atc.read(path)[1]
    assert f.units.name == "mdanalysis"
    np.testing.assert_allclose(f.positions, put[1]["coordinates"], rtol=1e-6)
    np.testing.assert_allclose(f.velocities / f.units.velocity, 20.455 * put[1]["velocities"], rtol=1e-6)
    assert f.time / f.units.time == pytest.approx(10.0)


@pytest.mark.parametrize("version", [1, 2])
def test_cut_and_damaged(tmp_path, version):
    write(tmp_path / "t.nc", version=version)
    data = (tmp_path / "t.nc").read_bytes()
    path = tmp_path / "cut.nc"
    traj = atc.read(tmp_path / "t.nc")
    record = traj._file.record_size
    for cut in (1, 8, record // 2, record - 1):
        path.write_bytes(data[:-cut])
        with pytest.warns(
            AtcWarning, match="its header announces 3 frames, the file ends within number 2: it is left out"
        ):
            assert len(atc.read(path)) == 2
    # While LAMMPS runs, the header may say fewer frames than are there: those it says are whole.
    bad = bytearray(data)
    bad[4:8] = (1).to_bytes(4, "big")
    path.write_bytes(bytes(bad))
    assert len(atc.read(path)) == 1
    bad[4:8] = b"\xff" * 4  # streaming: as many as there are
    path.write_bytes(bytes(bad))
    assert len(atc.read(path)) == 3
    for cut in (4, 8, 30, 200, 500):
        path.write_bytes(data[:cut])
        with pytest.raises(AtcError, match=r"cut.nc"):
            atc.read(path)
    at = data.index(b"atom\0\0\0\5")
    bad = bytearray(data)
    bad[at + 4 : at + 8] = (2**31 - 1).to_bytes(4, "big")
    path.write_bytes(bytes(bad))
    with pytest.raises(AtcError, match="holds no complete frame|damaged|ends within"):
        atc.read(path)[0]

    def infinite(f):
        f.variables["time"][1] = np.inf

    write(path, change=infinite)
    with pytest.raises(AtcError, match="cut.nc frame 1: its time is inf"):
        atc.read(path)[1]
