"""Files that are no trajectories, where one belongs: one line that says what each is, and what to give instead. Nothing
of another library is heard."""

import io
import os
import tarfile
import zipfile

import h5py
import matplotlib
import numpy as np
import pytest
from lammps_oracle import lammps_session

import atc
from atc.errors import AtcError
from atc.readers._bytes import open_bytes


def png():
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    out = io.BytesIO()
    plt.imsave(out, np.zeros((2, 2, 3)))
    return out.getvalue()


def zipped():
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as z:
        z.writestr("run.dump", "ITEM: TIMESTEP\n")
    return out.getvalue()


def tarred(mode):
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=mode) as t:
        entry = tarfile.TarInfo("run.dump")
        entry.size = 15
        t.addfile(entry, io.BytesIO(b"ITEM: TIMESTEP\n"))
    return out.getvalue()


def saved(save, *args):
    out = io.BytesIO()
    save(out, *args)
    return out.getvalue()


SCRIPT = "# melt\nunits lj\natom_style atomic\npair_style lj/cut 2.5\npair_coeff 1 1 1.0 1.0\nrun 10\n"
MOLECULE = "# water\n\n3 atoms\n2 bonds\n\nCoords\n\n1 0 0 0\n2 1 0 0\n3 0 1 0\n\nTypes\n\n1 1\n2 2\n3 2\n"
HEADER = "ITEM: TIMESTEP\n0\n"
BOX = "ITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\n"
SCENE = '[trajectory]\nfile = "run.dump"\n\n[kernel]\nname = "quartic"\nradius = 5.0\n'
SW = (
    "# DATE: 2007-06-11 UNITS: metal CONTRIBUTOR: A. B., a@b.c CITATION: none\nSi Si Si 2.1 2.0 1.8 21.0 1.2 -0.3 7.0 "
    "0.6 4.0 0.0 0.0\n"
)

CASES = {
    "script": (SCRIPT, "is a LAMMPS input script, not a trajectory: give the dump it writes"),
    "script without a name": (
        "variable T equal 300\nregion b block 0 1 0 1 0 1\ncreate_box 1 b\nmass 1 1\n",
        "is a LAMMPS input script",
    ),
    "script with continued lines": (
        "pair_coeff * * &\n  1.0 &\n  2.0\nunits metal\nfix 1 all nve\nrun 5\n",
        "is a LAMMPS input script",
    ),
    "log": (
        "LAMMPS (22 Jul 2025 - Update 1)\nunits lj\n",
        "is the log of a LAMMPS run, which holds thermo output but no atoms",
    ),
    "log without its head": (
        "Per MPI rank memory allocation (min/avg/max) = 3 | 3 | 3 Mbytes\nStep Temp\n0 1\n",
        "is the log of a LAMMPS run",
    ),
    "thermo in YAML": (
        "---\nkeywords: ['Step', 'Temp', ]\ndata:\n  - [0, 1, ]\n...\n",
        "is thermo output of LAMMPS in YAML",
    ),
    "molecule": (MOLECULE, "is a molecule template of LAMMPS, which has no box"),
    "dump local": (
        HEADER + "ITEM: NUMBER OF ENTRIES\n1\n" + BOX + "ITEM: ENTRIES index c_1\n1 2\n",
        "is a dump of something else than atoms",
    ),
    "dump local with a label": (
        "ITEM: UNITS\nlj\n" + HEADER + "ITEM: NUMBER OF BONDS\n1\n" + BOX + "ITEM: BONDS a\n1\n",
        "is a dump of something else",
    ),
    "dump grid": (
        HEADER + BOX + "ITEM: DIMENSION\n3\nITEM: GRID SIZE nx ny nz\n1 1 1\nITEM: GRID CELLS a\n1\n",
        "is grid data of LAMMPS",
    ),
    "dump grid with time": (
        "ITEM: UNITS\nlj\nITEM: TIME\n0\n" + HEADER + BOX + "ITEM: DIMENSION\n2\n",
        "is grid data of LAMMPS",
    ),
    "fix ave/chunk": (
        "# Chunk-averaged data for fix 1 and group all\n# Timestep Number-of-chunks\n",
        "is the output of a fix of LAMMPS",
    ),
    "fix ave/time": ("# Time-averaged data for fix 1\n# TimeStep v_a\n0 1\n", "is the output of a fix of LAMMPS"),
    "potential": (SW, "is a potential file of LAMMPS, not a trajectory: name it in a pair_coeff line"),
    "Cu.eam": ("comment\n29 63.55 3.615 fcc\n500 5e-4 500 1e-2 4.95\n", "is a potential file by its name"),
    "scene": (SCENE, "is a scene of atc, not a trajectory: atc plan FILE"),
    "html": ("<!DOCTYPE html>\n<html><body>404</body></html>\n", r"is a web page \(HTML\)"),
    "vtk": ("# vtk DataFile Version 3.0\nx\n", "is a VTK file"),
    "vtu": ('<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid">\n', "is a VTK file"),
    "x.png": (png, "is a picture, as dump image writes it: dump the atoms of the run"),
    "x.ppm": (b"P6\n2 2\n255\n" + bytes(12), "is a picture"),
    "x.mp4": (b"\0\0\0\x18ftypmp42" + bytes(20), "is a film"),
    "x.pdf": (b"%PDF-1.5\n" + bytes(20), "is a PDF document"),
    "x.zip": (zipped, "is an archive: unpack it"),
    "x.tar": (lambda: tarred("w"), "is an archive: unpack it"),
    "x.tar.gz": (lambda: tarred("w:gz"), "is an archive: unpack it"),
    "x.npz": (lambda: saved(np.savez, np.zeros(3)), "is a NumPy archive"),
    "x.npy": (lambda: saved(np.save, np.zeros(3)), "is a NumPy array"),
    "x.pkl": (b"\x80\x04\x95\x05\0\0\0\0\0\0\0K\x01.", "is a pickle of Python"),
    "program": (b"\x7fELF" + bytes(40), "is a program"),
    "restart": (
        b"LammpS RestartT\0" + bytes(40),
        "is a LAMMPS restart file, which only LAMMPS reads: make a data file of it",
    ),
    "empty": ("", "is empty"),
    "blank": ("\n \n", "holds nothing but blanks"),
    "noise": (
        bytes(np.random.default_rng(0).integers(0, 256, 3000, np.uint8)),
        "neither LAMMPS, nor a format that MDAnalysis or ASE knows",
    ),
    "zeros": (bytes(3000), "neither LAMMPS|holds nothing"),
    "prose": ("This is a letter.\nDear reader,\n" * 20, "neither LAMMPS, nor a format"),
    "noise.extxyz": (bytes(range(128, 256)) * 10, "."),
    "noise.dcd": (bytes(range(128, 256)) * 10, "damaged, cut off, or not what its name says"),
    "noise.xtc": (bytes(range(128, 256)) * 10, "damaged, cut off, or not what its name says"),
    "noise.traj": (bytes(range(128, 256)) * 10, "."),
    "noise.cif": (b"data_x\n_cell_length_a what\n", "cannot be read as a file of format 'cif'|holds no frame"),
    "POSCAR": ("x\n1.0\n5 0 0\n0 5 0\n0 0 x\nSi\n1\nDirect\n0 0 0\n", "cannot be read as a file of format 'vasp'"),
    "melt.in": ("hello\nworld\n", "holds no atoms|cannot be read|neither"),
    "noise.nc": (b"CDF\x01" + bytes(range(256)), "."),
    "noise.h5": (b"\x89HDF\r\n\x1a\n" + bytes(range(256)), "HDF5"),
}
OF_OTHERS = {
    "noise.dcd",
    "noise.xtc",
    "noise.cif",
    "POSCAR",
    "melt.in",
}  # their readers have units of their own, and say that first
FOREIGN = ("Error", "Traceback", "codec", "Errno", "Exception", "unpack", "ASE cannot", "None")


@pytest.mark.parametrize("name", CASES)
@pytest.mark.filterwarnings("ignore")
def test_what_a_file_is(tmp_path, name):
    content, what = CASES[name]
    content = content() if callable(content) else content
    path = tmp_path / name.replace(" ", "_").replace("/", "_")
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    for units in (None, "metal"):
        with pytest.raises(AtcError, match="." if units and name in OF_OTHERS else what) as caught:
            for _ in atc.read(path, units=units):
                pass
        text = str(caught.value)
        assert "\n" not in text and text.startswith(str(path)) and len(text) < len(str(path)) + 400
        assert not any(word in text.removeprefix(str(path)).replace("unpack it", "") for word in FOREIGN), text


def test_outputs_of_atc_and_other_hdf5(tmp_path):
    for name, attrs, what in (
        ("out.nc", {"atc_version": "0.4.0"}, "is an output of atc"),
        ("other.nc", {}, "is an HDF5 or NetCDF-4 file of no trajectory that atc knows"),
        ("l.nc", {"program": "LAMMPS", "Conventions": "AMBER"}, "nccopy"),
    ):
        with h5py.File(tmp_path / name, "w") as f:
            f.attrs.update(attrs)
        with pytest.raises(AtcError, match=what):
            atc.read(tmp_path / name)
    (tmp_path / "out.zarr").mkdir()
    with pytest.raises(AtcError, match="is an output of atc or another Zarr store"):
        atc.read(tmp_path / "out.zarr")


def test_what_is_no_regular_file(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    for path in (tmp_path / "fifo", "/dev/zero", "/dev/null"):
        with pytest.raises(AtcError, match="is a pipe or a device"):
            atc.read(path)
    for path, what in (
        ("x" * 5000, "cannot be opened"),
        ("a\0b", "cannot be opened"),
        (tmp_path, "is a directory"),
        ("*[", "there is no such file|no file matches"),
    ):
        with pytest.raises(AtcError, match=what) as caught:
            atc.read(path)
        assert len(str(caught.value)) < 400
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    with pytest.raises(AtcError, match="cannot be opened"):
        atc.read(tmp_path / "loop")


@pytest.mark.parametrize("kind", ["gz", "bz2", "xz"])
def test_bombs(tmp_path, kind, monkeypatch):
    """Text that swells several hundredfold is stopped at the limit (which is lowered here), however little of the file
    has been read."""
    import bz2
    import gzip
    import lzma

    import atc.readers._bytes as module

    monkeypatch.setattr(module, "_BOMB", 1 << 21)
    opener = {"gz": gzip.open, "bz2": bz2.open, "xz": lzma.open}[kind]
    path = tmp_path / f"t.dump.{kind}"
    header = (
        b"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n900000000000\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 9\nITEM: "
        b"ATOMS id type x y z\n"
    )
    block = b"1 1 1 1 1\n" * (1 << 16)
    with opener(path, "wb") as f:
        f.write(header)
        for _ in range(6):
            f.write(block)
    assert path.stat().st_size < 13_000
    with pytest.raises(AtcError, match=r"compressed bytes swell to more than \d+: no trajectory shrinks like that"):
        atc.read(path, units="lj")


def test_a_restart_and_a_log_that_lammps_wrote(tmp_path):
    with lammps_session(log=tmp_path / "log.lammps") as lmp:
        lmp.commands_string(f"""
            units lj
            region b block 0 4 0 4 0 4
            create_box 1 b
            create_atoms 1 single 1 1 1
            create_atoms 1 single 2 2 2
            mass 1 1
            pair_style zero 1
            pair_coeff * *
            write_restart {tmp_path}/r.bin
            thermo_style yaml
            run 0
        """)
    with pytest.raises(AtcError, match="is a LAMMPS restart file"):
        atc.read(tmp_path / "r.bin", units="lj")
    with pytest.raises(AtcError, match="is the log of a LAMMPS run"):
        atc.read(tmp_path / "log.lammps", units="lj")


def test_atc_info_says_it_too(tmp_path):
    from typer.testing import CliRunner

    from atc.cli import app

    (tmp_path / "melt.in").write_text(SCRIPT)
    result = CliRunner().invoke(app, ["info", str(tmp_path / "melt.in")])
    assert result.exit_code == 2 and "is a LAMMPS input script" in result.output and result.output.count("\n") == 1


def test_zstd_is_read_where_python_can(tmp_path):
    text = (
        b"ITEM: UNITS\nlj\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n1\nITEM: BOX BOUNDS pp pp pp\n0 9\n0 9\n0 "
        b"9\nITEM: ATOMS id type x y z\n1 1 1 2 3\n"
    )
    # One frame of one raw block: magic, a header that gives the size in two bytes, the block's length and that it is
    # the last.
    size = len(text)
    raw = (
        b"\x28\xb5\x2f\xfd" + b"\x60" + (size - 256).to_bytes(2, "little")
        if size >= 256
        else b"\x28\xb5\x2f\xfd" + b"\x20" + bytes([size])
    )
    path = tmp_path / "t.dump.zst"
    path.write_bytes(raw + ((size << 3) | 1).to_bytes(3, "little") + text)
    try:
        open_bytes(path)
    except AtcError as e:
        assert "needs Python 3.14 or the package backports.zstd; install it, or decompress first" in str(e)
    else:
        assert atc.read(path)[0].positions.tolist() == [[1, 2, 3]]
