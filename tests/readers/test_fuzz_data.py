"""Damaged and hostile files: data files, molecule files, potential files, tables. One line of the package's own, soon,
and without memory beyond the file's size.

The random part runs for seconds; ``pytest -m slow tests/readers/test_fuzz_data.py`` runs it for minutes.
"""

import gzip
import os
import re
import time
import tracemalloc
import warnings
from contextlib import contextmanager

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from test_decomposers_eam import tables
from test_readers_data_lammps import MOLECULE, TEMPLATE

import atc
from atc.decomposers.lammps.data_coeffs import data_file_commands
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame
from atc.readers.lammps.molecule import read_molecule
from atc.units import units

DATA = """LAMMPS data file, units = real

6 atoms
2 bonds
1 angles
2 atom types
1 bond types
1 angle types
1 crossterms

-1 9 xlo xhi
-2 8 ylo yhi
-3 7.5 zlo zhi
0.5 0.25 -0.5 xy xz yz

Atom Type Labels

1 O
2 H

Masses

1 15.999 # oxygen
H 1.008

Pair Coeffs # lj/cut

1 0.1 3.1
2 0.0 1.0

Bond Coeffs

1 450.0 0.97

Atoms # full

3 1 H 0.41 1.5 2.0 3.0 0 0 0
1 1 1 -0.82 0.5 2.0 3.0 0 -1 0
2 1 2 0.41 0.0 1.25 3.0 0 0 1
7 2 1 0.0 5.0 2.0 3.0e0 0 0 0
8 2 1 0.0 5.0 5.0 -1.5 0 0 0
9 3 1 -1e-3 5.0 2.0 6.0 0 0 0

Velocities

1 0.001 0 0
2 0 0.002 0
3 0 0 -0.001
7 0 0 0
8 0 0 0
9 0 0 0

Bonds

1 1 1 2
2 1 1 3

Angles

1 1 2 1 3

CMAP

1 1 1 2 3 7 8
"""
SHAPES = """t

2 atoms
1 atom types
1 ellipsoids
0 9 xlo xhi
0 9 ylo yhi
0 9 zlo zhi

Atoms # ellipsoid

1 1 1 1.5 1 1 1
2 1 0 2.5 2 2 2

Ellipsoids

1 1 2 3 1 0 0 0

Velocities

1 0 0 0 0 0 0
2 0 0 0 1 1 1
"""
TERSOFF = (
    "# DATE: 2007-10-25 UNITS: metal\nSi Si Si 3.0 1.0 1.7322 100390.0 16.217 -0.59825 0.78734 1.1e-6 1.7322 471.18 "
    "2.85 0.15\n  2.4799 1830.8\n"
)
SW = (
    "# UNITS: metal\nSi Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333\n         7.049556277 0.6022245584 4.0 0.0 "
    "0.0\n"
)
TABLE = (
    "# UNITS: metal\n\nLJ\nN 6 FPRIME -3.0 0.1\n\n"
    + "\n".join(f"{k} {1 + 0.4 * k:.1f} {4 / k - 1:.4f} {4 / k**2:.4f}" for k in range(1, 7))
    + "\n"
)
BONDS = (
    "HARM\nN 5 FP 0 0 EQ 1.0\n\n"
    + "\n".join(f"{k} {0.6 + 0.2 * k:.1f} {(0.2 * k - 0.4) ** 2:.4f} {-2 * (0.2 * k - 0.4):.4f}" for k in range(5))
    + "\n"
)
FUNCFL = (
    "Cu\n29 63.55 3.615 FCC\n10 0.2 12 0.5 5.0\n"
    + "\n".join(" ".join(f"{0.1 * (k + j):.3f}" for j in range(4)) for k in range(0, 36, 4))
    + "\n"
)


def data_file(path):
    traj = atc.read(path, units="real")
    frame = traj[0]
    assert len(frame) and np.isfinite(frame.positions).all() and 0 < frame.cell.volume < np.inf
    data_file_commands(path, {"pair": "lj/cut", "bond": "harmonic"})


def potential_of(lines):
    def load(path):
        pot = atc.potential(lines.format(path), units="metal")
        frame = Frame(np.array([[0.0, 0, 0], [2.3, 0, 0], [0.4, 2.2, 0]]), Cell(np.eye(3) * 20.0), units("metal"))
        with np.errstate(all="ignore"):
            if not lines.startswith("bond"):
                pot.decompose(frame)

    return load


KINDS = {
    "data": (DATA, data_file),
    "shapes": (SHAPES, data_file),
    "template": (TEMPLATE, data_file),
    "molecule": (MOLECULE, read_molecule),
    "tersoff": (TERSOFF, potential_of("pair_style tersoff\npair_coeff * * {} Si")),
    "sw": (SW, potential_of("pair_style sw\npair_coeff * * {} Si")),
    "funcfl": (FUNCFL, potential_of("pair_style eam\npair_coeff * * {}")),
    "setfl": (None, potential_of("pair_style eam/alloy\npair_coeff * * {} Aa")),
    "table": (TABLE, potential_of("pair_style table spline 50\npair_coeff * * {} LJ 3.0")),
    "bond table": (BONDS, potential_of("bond_style table linear 20\nbond_coeff 1 {} HARM")),
}


@pytest.fixture(scope="module", autouse=True)
def compiled(tmp_path_factory):
    """Kernels are compiled before the clock starts, and before memory is watched."""
    folder = tmp_path_factory.mktemp("whole")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for text, load in KINDS.values():
            path = folder / "whole.file"
            path.write_text(tables(folder, nrho=7, nr=9).read_text() if text is None else text)
            load(path)


@contextmanager
def bounded(size, seconds=20.0):
    """Time, and memory: a base for what is always there, and two hundred times the size of the file."""
    tracemalloc.start()
    began = time.perf_counter()
    try:
        yield
    finally:
        took, peak = time.perf_counter() - began, tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    assert took < seconds, f"{took} s"
    assert peak < (48 << 20) + 200 * size, f"{peak} bytes"


def survives(path, load):
    """Whatever is in the file: it is read, or refused in one line of this package that names it."""
    size = path.stat().st_size
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.simplefilter("ignore", AtcWarning)
        with bounded(size):
            try:
                load(path)
            except AtcError as e:
                message = str(e)
            else:
                return None
    assert "\n" not in message and len(message) < 1200 and message.isprintable(), message
    assert path.name in message or "potential, line" in message, message
    return message


WORDS = (
    "--1",
    "nan",
    "-nan",
    "inf",
    "1e400",
    "-1e308",
    "1e-320",
    "1e200",
    "0",
    "-0",
    "-1",
    "99999999999999999999",
    "9223372036854775808",
    "1" * 400,
    "2147483648",
    "1000000000000",
    "1_0",
    "0x10",
    "1.5.2",
    "1d3",
    "Atoms",
    "Masses",
    "Bonds # x",
    "#",
    "\t",
    "N",
    "R",
    "C",
    "\u00b2",
    "\u0664",
    "\x00",
    "\x0b",
    "\u2028",
    "atoms",
    "xlo xhi",
)


@st.composite
def damaged(draw, text):
    """The text with a few words, lines or characters replaced, repeated, moved or cut."""
    for _ in range(draw(st.integers(1, 4))):
        lines = text.split("\n")
        k = draw(st.integers(0, len(lines) - 1))
        how = draw(st.sampled_from("word word word number drop repeat swap insert cut char join many".split()))
        words = lines[k].split()
        if how in ("word", "number") and words:
            at = draw(st.integers(0, len(words) - 1))
            words[at] = (
                draw(st.sampled_from(WORDS)) if how == "word" else str(draw(st.one_of(st.integers(), st.floats())))
            )
            lines[k] = " ".join(words)
        elif how == "drop":
            del lines[k]
        elif how == "repeat":
            lines.insert(k, lines[draw(st.integers(0, len(lines) - 1))])
        elif how == "swap":
            j = draw(st.integers(0, len(lines) - 1))
            lines[k], lines[j] = lines[j], lines[k]
        elif how == "insert":
            lines.insert(k, draw(st.one_of(st.sampled_from(WORDS), st.text(max_size=20))))
        elif how == "join" and k + 1 < len(lines):
            lines[k : k + 2] = [lines[k] + " " + lines[k + 1]]
        elif how == "many":
            lines[k] = lines[k] + " 1" * draw(st.sampled_from([1, 40, 3000]))
        text = "\n".join(lines)
        if how == "cut":
            text = text[: draw(st.integers(0, len(text)))]
        elif how == "char" and text:
            at = draw(st.integers(0, len(text) - 1))
            text = text[:at] + draw(st.characters()) + text[at + 1 :]
    return text


def fuzz(kind, folder, examples):
    text, load = KINDS[kind]
    if text is None:
        text = tables(folder, nrho=7, nr=9).read_text()
    path = folder / "hostile.file"
    path.write_text(text)
    assert survives(path, load) is None, "the file is whole to begin with"
    seen = set()

    @settings(
        max_examples=examples,
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
        phases=[Phase.generate, Phase.shrink],
    )
    @given(damaged(text))
    def run(changed):
        path.write_bytes(changed.encode("utf-8", "surrogatepass"))
        seen.add(re.sub(r"\d+", "0", survives(path, load) or "read"))

    run()
    assert len(seen) > 2, "damage that does not reach the reader"


@pytest.mark.parametrize("kind", KINDS)
def test_damage_anywhere(kind, tmp_path):
    fuzz(kind, tmp_path, 60)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_damage_anywhere_for_long(kind, tmp_path):
    fuzz(kind, tmp_path, 4000)


@settings(max_examples=80, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.binary(max_size=400), st.sampled_from(sorted(KINDS)))
def test_any_bytes(tmp_path, content, kind):
    path = tmp_path / "bytes.file"
    path.write_bytes(content)
    load = KINDS[kind][1] if KINDS[kind][1] is not data_file else lambda p: data_file_commands(p, {"pair": "lj/cut"})
    survives(path, load)


# What cannot be read at all, and what is too much
# --------------------------------------------------------------------------------------------

WAYS_IN = {
    k: load for k, (_, load) in KINDS.items() if k in ("data", "molecule", "tersoff", "setfl", "table", "bond table")
}


@pytest.mark.parametrize("kind", WAYS_IN)
def test_not_a_file(tmp_path, kind):
    """Pipes are not waited for, devices not read, directories and impossible names refused."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    for path in (pipe, tmp_path, tmp_path / "nowhere", tmp_path / ("n" * 300), "/dev/zero", "/dev/full"):
        with bounded(0), pytest.raises(AtcError) as e:
            WAYS_IN[kind](path)
        assert "\n" not in str(e.value) and "Errno" not in str(e.value), e.value


@pytest.mark.parametrize("kind", WAYS_IN)
def test_compressed_to_nothing(tmp_path, kind):
    """A small file that swells to 300 MB of blank lines."""
    path = tmp_path / "bomb.gz"
    with gzip.open(path, "wb", compresslevel=9) as f:
        f.write(b"t\n\n1 atoms\n1 atom types\n")
        for _ in range(75):
            f.write(b"\n" * (1 << 22))
    began = time.perf_counter()
    with pytest.raises(AtcError, match="compressed bytes"):
        WAYS_IN[kind](path)
    assert time.perf_counter() - began < 30


@pytest.mark.parametrize(
    "damage", [lambda b: b[: len(b) // 2], lambda b: b[:40] + b"\xff" * 20 + b[60:], lambda b: b[:10]]
)
def test_damaged_compression(tmp_path, damage):
    path = tmp_path / "d.data.gz"
    path.write_bytes(damage(gzip.compress(DATA.encode())))
    with pytest.raises(AtcError, match="d.data.gz") as e:
        data_file_commands(path, {"pair": "lj/cut"})
        atc.read(path, units="real")
    assert "\n" not in str(e.value)


def counted(n, text, old):
    assert old in text
    return text.replace(old, n, 1)


@pytest.mark.parametrize("n", ["1000000000000", "2147483648", "9" * 30])
@pytest.mark.parametrize(
    "kind,old",
    [("data", "6 atoms"), ("data", "2 bonds"), ("data", "2 atom types"), ("shapes", "1 ellipsoids"), ("molecule", "3 atoms"), ("molecule", "2 bonds"), ("funcfl", "10 0.2"), ("funcfl", "12 0.5"), ("table", "N 6"), ("bond table", "N 5")],
)  # fmt: skip
def test_counts_beyond_the_file(tmp_path, kind, old, n):
    text, load = KINDS[kind]
    number = re.search(r"\d+", old).group()
    path = tmp_path / "hostile.file"
    path.write_text(counted(old.replace(number, n), text, old))
    assert survives(path, load) is not None


def test_points_of_a_table_beyond_memory(tmp_path):
    path = tmp_path / "hostile.file"
    path.write_text(TABLE)
    for n in ("2147483648", "1" * 30):
        message = survives(path, potential_of(f"pair_style table spline {n}\npair_coeff * * {{}} LJ 3.0"))
        assert "number of points" in message or "are more than" in message


def test_time_is_linear_in_the_size(tmp_path):
    """Twice the lines, twice the time: blank lines, comments, short lines, lines of words, one long line."""
    path = tmp_path / "hostile.file"
    head = "t\n\n{} atoms\n1 atom types\n0 9 xlo xhi\n0 9 ylo yhi\n0 9 zlo zhi\n\nAtoms # atomic\n\n"
    fillings = {
        "\n": "blank",
        "# c\n": "comments",
        "1\n": "short",
        "a b\n": "words",
        " \t": "one line",
        "1 ": "numbers in a line",
        "1 1 1 1 1\n": "good",
    }
    data_file_commands_only = lambda p: atc.read(p, units="lj")[0]  # noqa: E731
    for filling, what in fillings.items():
        path.write_text(head.format(400_000) + filling * 400_000 + "\n")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AtcWarning)
            with bounded(path.stat().st_size, seconds=60.0):
                try:
                    data_file_commands_only(path)
                except AtcError as e:
                    assert len(str(e)) < 1000, what
