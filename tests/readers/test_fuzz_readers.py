"""Damaged files of every format: whatever happens to their bytes, readers raise an AtcError of one line or give frames
that are whole, in little time and memory.

Seconds as part of the suite; ``pytest -m slow`` looks fifty times as long.
"""

import base64
import bz2
import gzip
import io
import lzma
import resource
import struct
import time
import warnings
import zlib

import ase.build
import ase.io
import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.io import netcdf_file
from test_readers_netcdf import VERSION_5

import atc
from atc.errors import AtcError

SECONDS = 10.0  # for one file of a few kilobytes; a warm one takes milliseconds
MEGABYTES = 600  # that the whole test may add

ROWS = "1 1 1.5 2.5 3.5 0.25 -1e-3 7\n3 2 4.5 5.5 6.5 1 2 3\n2 1 7.5 8.25 0.5 -1 -2 -3\n"
BOX = "ITEM: BOX BOUNDS xy xz yz pp pp ff\n-1 11 1.5\n0 10 0.5\n0 10 -0.25\n"


def dump():
    one = (
        "ITEM: UNITS\nmetal\nITEM: TIME\n0.5\nITEM: TIMESTEP\n{}\nITEM: NUMBER OF ATOMS\n3\n"
        + BOX
        + "ITEM: ATOMS id type x y z vx vy vz\n"
        + ROWS
    )
    return (one.format(0) + one.format(10)).encode()


def general():
    head = (
        "ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n2\nITEM: BOX BOUNDS abc origin pp pp pp\n9 1 0 0\n0 9 1 0\n1 0 9 "
        "0\nITEM: ATOMS id element xs ys zs ix iy iz q\n"
    )
    return (head + "5 Si 0.5 0.25 0.125 0 1 -1 0.5\n4 C 0.75 0.5 0.25 0 0 0 -0.5\n").encode()


def yaml():
    out = ""
    for k in range(2):
        out += (
            f"---\ncreator: LAMMPS\ntimestep: {k}\nunits: lj\ntime: {k / 4}\nnatoms: 3\nboundary: [ p, p, f, f, s, s, "
            "]\nthermo:\n  - keywords: [ Step, Temp, ]\n"
        )
        out += (
            f"  - data: [ {k}, 0.5, ]\nbox:\n  - [ 0, 9 ]\n  - [ 0, 9 ]\n  - [ 0, 9 ]\n  - [ 1, 0, 0.5 ]\nkeywords: [ "
            "id, type, x, y, z, vx, vy, vz,  ]\ndata:\n"
        )
        out += "".join("  - [ " + " , ".join(row.split()) + ", ]\n" for row in ROWS.splitlines()) + "...\n"
    return out.encode()


def binary(old=False):
    out = b""
    names = b"id type x y z vx vy vz"
    table = np.array([[float(w) for w in row.split()] for row in ROWS.splitlines()])
    if old:
        table = np.column_stack([np.arange(1, 4), np.ones(3), table[:, 2:5]])
    for k in range(2):
        if not old:
            out += struct.pack("<q", -10) + b"DUMPCUSTOM" + struct.pack("<ii", 1, 2)
        out += (
            struct.pack("<qqi6i", k, 3, 1, 0, 0, 0, 0, 1, 1)
            + struct.pack("<9d", -1, 11, 0, 10, 0, 10, 1.5, 0.5, -0.25)
            + struct.pack("<i", table.shape[1])
        )
        if not old:
            out += (
                struct.pack("<i", 5) + b"metal" + b"\1" + struct.pack("<d", 0.5) + struct.pack("<i", len(names)) + names
            )
        out += struct.pack("<ii", 1, table.size) + table.astype("<f8").tobytes()
    return out


def dcd(title=b"Written by LAMMPS"):
    def record(body):
        return struct.pack("<i", len(body)) + body + struct.pack("<i", len(body))

    head = b"CORD" + struct.pack("<9if10i", 2, 0, 5, 5, 0, 0, 0, 0, 0, 0.5, 1, 0, 0, 0, 0, 0, 0, 0, 0, 24)
    out = record(head) + record(struct.pack("<i", 1) + title.ljust(80, b"\0")) + record(struct.pack("<i", 3))
    for k in range(2):
        out += record(struct.pack("<6d", 9, 0.25, 10, 0, 0.125, 11))
        out += b"".join(record(np.array([1, 2, 3 + k], "<f4").tobytes()) for _ in range(3))
    return out


def extxyz(comment, rows="Si 1 2 3 0.5 1 2\nC 2 3 4 1 -1 0\n"):
    return "".join(f"{rows.count(chr(10))}\n{comment.replace('<k>', str(k))}\n{rows}" for k in range(2)).encode()


LAMMPS_XYZ = (
    'Timestep=<k> Time=<k>.500000 pbc="T T F" Lattice="9 0 0 1 9 0 0 2 9" Potential_energy=-1 Temperature=3 '
    "Properties=species:S:1:pos:R:3:vel:R:3"
)
ASE_XYZ = (
    'Lattice="9 0 0 1 9 0 0 2 9" Properties=species:S:1:pos:R:3:momenta:R:3 energy=-1.5 info={a b} list=[1,2,[3,4]] '
    'pbc="T F T"'
)
IPI_XYZ = "# CELL(abcABC): 10 11 12 90 80 70 Step: <k> Bead: 0 positions{angstrom} cell{atomic_unit}"


def cfg():
    h = "".join(f"H0({i},{j}) = {9.5 * (i == j) + 0.5 * (i > j)} A\n" for i in (1, 2, 3) for j in (1, 2, 3))
    head = (
        f"Number of particles = 2\nA = 1 Angstrom (basic length-scale)\n{h}.NO_VELOCITY.\nentry_count = "
        "5\nauxiliary[0] = id\nauxiliary[1] = vx\n"
    )
    return (head + "28.000000 \nSi \n0.5 0.25 0.125 1 0.5\n12.000000 \nC \n0.25 0.75 0.5 2 -0.5\n").encode()


def netcdf(version, program="LAMMPS"):
    out = io.BytesIO()
    out.close = lambda: None
    f = netcdf_file(out, "w", version=version)
    f.Conventions, f.ConventionVersion, f.program = "AMBER", "1.0", program
    for name, size in (("frame", None), ("spatial", 3), ("atom", 2), ("cell_spatial", 3), ("cell_angular", 3)):
        f.createDimension(name, size)
    for name, dims, unit in (
        ("time", ("frame",), "picosecond"),
        ("cell_lengths", ("frame", "cell_spatial"), "angstrom"),
        ("cell_angles", ("frame", "cell_angular"), "degree"),
        ("coordinates", ("frame", "atom", "spatial"), "angstrom"),
    ):
        v = f.createVariable(name, "f4", dims)
        v.units = unit
        for k in range(2):
            v[k] = (
                0.5 * k
                if name == "time"
                else np.full(f.variables[name].shape[1:], 60 if "angles" in name else 9.0)
                + (np.arange(6).reshape(2, 3) if name == "coordinates" else 0)
            )
    f.flush()
    return out.getvalue()


def data():
    return (
        b"made by hand\n\n3 atoms\n2 atom types\n1 bonds\n1 bond types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n1 0 "
        b"0.5 xy xz yz\n\nMasses\n\n1 28 # Si\n2 12\n\n"
        b"Atoms # full\n\n1 1 1 0.5 1 2 3 0 0 1\n2 1 2 -0.5 2 3 4 0 0 0\n3 1 1 0 3 4 5 0 0 0\n\nVelocities\n\n1 1 0 "
        b"0\n2 0 1 0\n3 0 0 1\n\nBonds\n\n1 1 1 2\n"
    )


def by_ase(form):
    atoms = ase.build.bulk("NaCl", "rocksalt", a=5.6)
    out = io.BytesIO() if form in ("traj", "cif") else io.StringIO()
    ase.io.write(out, atoms, format=form)
    return out.getvalue() if isinstance(out, io.BytesIO) else out.getvalue().encode()


def gro():
    atoms = "".join(
        f"    1SOL  {n:>5}{k:5d}{0.1 * k:8.3f}{0.2 * k:8.3f}{0.3 * k:8.3f}\n"
        for k, n in enumerate(("OW", "HW1", "HW2"), 1)
    )
    return f"water t= 0.5 step= 3\n    3\n{atoms}   1.00000   1.00000   1.00000\n".encode()


def pdb():
    atoms = "".join(
        f"ATOM  {k:5d}  O   HOH A{k:4d}    {k:8.3f}{2 * k:8.3f}{3 * k:8.3f}  1.00  0.00           O\n" for k in (1, 2)
    )
    return f"CRYST1   10.000   10.000   10.000  90.00  90.00  90.00 P 1           1\nMODEL        1\n{atoms}ENDMDL\nMODEL        2\n{atoms}ENDMDL\nEND\n".encode()


FORMATS = {
    "t.dump": dump,
    "general.dump": general,
    "t.yaml": yaml,
    "t.bin": binary,
    "old.bin": lambda: binary(old=True),
    "t.dcd": dcd,
    "t.dump.gz": lambda: gzip.compress(dump()),
    "t.dump.bz2": lambda: bz2.compress(dump()),
    "t.dump.xz": lambda: lzma.compress(dump()),
    "lammps.extxyz": lambda: extxyz(LAMMPS_XYZ),
    "ase.extxyz": lambda: extxyz(ASE_XYZ),
    "ipi.xyz": lambda: extxyz(IPI_XYZ, "O 1 2 3\nH 2 3 4\n"),
    "plain.xyz": lambda: extxyz("nothing", "O 1 2 3\nH 2 3 4\n"),
    "t.cfg": cfg,
    "one.nc": lambda: netcdf(1),
    "two.nc": lambda: netcdf(2),
    "five.nc": lambda: zlib.decompress(base64.b85decode(VERSION_5)),
    "amber.nc": lambda: netcdf(2, "pmemd"),
    "t.data": data,
    "t.traj": lambda: by_ase("traj"),
    "t.cif": lambda: by_ase("cif"),
    "POSCAR": lambda: by_ase("vasp"),
    "t.json": lambda: by_ase("json"),
    "t.gro": gro,
    "t.pdb": pdb,
}
# What is in ASE's or MDAnalysis's units; everything else is read in a run's.
OWN_UNITS = {"ase.extxyz", "ipi.xyz", "plain.xyz", "amber.nc", "t.traj", "t.cif", "POSCAR", "t.json", "t.gro", "t.pdb"}
FILE_SAYS = {"t.dump", "t.yaml", "t.bin", "one.nc", "two.nc", "five.nc", "t.dump.gz", "t.dump.bz2", "t.dump.xz"}
NASTY = [
    b"nan",
    b"inf",
    b"-inf",
    b"1e999",
    b"-1",
    b"--1",
    b"0",
    b"1_0",
    b"1e-400",
    b"99999999999999999999",
    b"9223372036854775808",
    b"1000000000000",
    b"0x10",
    b"1,5",
    b"1.5.2",
    b"\xff\xfe",
    b"\0",
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\x7f\xff\xff\xff",
    b"\xff\xff\xff\x7f",
    b"\n",
    b"\r",
    b" ",
    b"\t",
    b"\x1b[2J",
    b'"',
    b"[",
    b"]",
    b"{",
    b"}",
    b"=",
    b":",
    b"#",
    b"\xd9\xa3",
    b"ITEM: ATOMS",
    b"ITEM: TIMESTEP\n",
    b"---\n",
    b"...\n",
    b"x" * 300,
]


@st.composite
def damage(draw, seed: bytes):
    """`seed` after a few accidents: bytes changed, pieces cut out, doubled, swapped or put in, the end cut off, words
    replaced."""
    out = bytearray(seed)
    for _ in range(draw(st.integers(1, 4))):
        if not out:
            break
        a = draw(st.integers(0, len(out) - 1))
        b = min(len(out), a + draw(st.sampled_from([1, 2, 4, 8, 30, 200])))
        kind = draw(st.sampled_from(["flip", "cut out", "double", "put in", "cut off", "word", "word", "move"]))
        if kind == "flip":
            out[a] ^= draw(st.integers(1, 255))
        elif kind == "cut out":
            del out[a:b]
        elif kind == "double":
            out[a:a] = out[a:b]
        elif kind == "put in":
            out[a:a] = draw(st.sampled_from(NASTY))
        elif kind == "cut off":
            del out[a:]
        elif kind == "move":
            piece = bytes(out[a:b])
            del out[a:b]
            c = draw(st.integers(0, len(out)))
            out[c:c] = piece
        else:
            while a and out[a - 1] > 32:
                a -= 1
            b = a
            while b < len(out) and out[b] > 32:
                b += 1
            out[a:b] = draw(st.sampled_from(NASTY))
    return bytes(out)


def read_all(path, units):
    """Read everything that a file gives; the only exception that may come out is an AtcError of one line that names the
    file."""
    started = time.perf_counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with atc.read(path, units=units) as traj:
                n = 0
                for frame in traj:
                    n += 1
                    assert (
                        np.isfinite(frame.positions).all()
                        and np.isfinite(frame.cell.vectors).all()
                        and frame.cell.volume > 0
                    )
                    assert frame.time is None or np.isfinite(frame.time)
                    assert frame.step is None or -(2**63) <= frame.step < 2**63
                    assert len(np.unique(frame.ids)) == len(frame) == len(frame.types)
                    for a in (frame.velocities, frame.forces, frame.masses, frame.charges):
                        assert a is None or (np.isfinite(a).all() and len(a) == len(frame))
                    if n == 20:
                        break
                assert n
                traj.info()
        except AtcError as e:
            text = str(e)
            assert "\n" not in text and len(text) < 1000 and path.name in text, text
            n = None
    assert time.perf_counter() - started < SECONDS
    return n


def fuzz(name, path, count):
    seed = FORMATS[name]()
    units = None if name in OWN_UNITS | FILE_SAYS else "metal"
    path.write_bytes(seed)
    assert read_all(path, units) in (1, 2)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    @settings(
        max_examples=count,
        deadline=None,
        database=None,
        derandomize=count < 1000,
        suppress_health_check=list(HealthCheck),
    )
    @given(damage(seed))
    @example(seed)
    def run(content):
        path.write_bytes(content)
        read_all(path, units)

    run()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1000 * MEGABYTES


@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files(tmp_path, name):
    fuzz(name, tmp_path / name, 40)


@pytest.mark.slow
@pytest.mark.parametrize("name", FORMATS)
def test_damaged_files_for_long(tmp_path, name):
    fuzz(name, tmp_path / name, 2000)


@settings(max_examples=60, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(
    st.binary(max_size=400),
    st.sampled_from(["x", "x.dump", "x.xyz", "x.extxyz", "x.cfg", "x.data", "x.bin", "x.nc", "x.yaml"]),
    st.sampled_from([None, "metal"]),
)
def test_noise(tmp_path, content, name, units):
    path = tmp_path / name
    path.write_bytes(content)
    read_all(path, units)
