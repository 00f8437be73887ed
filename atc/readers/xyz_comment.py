"""What the comment line of an XYZ frame says: extended XYZ (key=value), i-PI's cell, or LAMMPS's ``Atoms. Timestep:
0``."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from ..units import units as unit_system
from .lammps.columns import edge_vectors
from .lammps.dump import number, whole

_PAIR = re.compile(
    r"""([A-Za-z_][\w.-]*)\s*=\s*("(?:[^"\\]|\\.)*"|'[^']*'|\{[^}]*\}|\[(?:[^\[\]]|\[[^\[\]]*\])*\]|[^\s"'{\[]\S*)"""
)
_IPI = re.compile(r"CELL[\(\[\{](abcABC|H|GENH)[\)\]\}]:\s*((?:[-+\d.eE]+\s+){5,8}[-+\d.eE]+)")
_BRACES = re.compile(r"\b(cell|positions|velocities|forces|momenta)\s*\{(\w+)\}")
_PLAIN_LAMMPS = re.compile(r"^\s*Atoms\. Timestep: (-?\d+)(?:\s+Time: (\S+))?\s*$")
_LONGEST = 1 << 14
#: Keys of `Comment.keys` for what the reader has to say about a comment.
CELL_UNIT_TAKEN, TIME_ROUNDED = "cell unit taken", "time rounded away"
_LAMMPS = re.compile(r"\s*Timestep=\S+ Time=\S+ pbc=|.*\bTimestep=.*\bPotential_energy=")
_BOHR = unit_system("electron").length
_LENGTHS = {"angstrom": 1.0, "nanometer": 10.0, "atomic_unit": _BOHR, "bohr": _BOHR}


@dataclass
class Comment:
    """One comment line. ``kind``: "plain", "extended", "lammps" (extended, in the units of a run of LAMMPS), "lammps
    plain" or "ipi"."""

    kind: str
    keys: dict = field(default_factory=dict)  # lower-case key -> text, extended ones
    #: (name, letter of its type, width); empty: species and three coordinates
    columns: list = field(default_factory=list)
    vectors: np.ndarray | None = None  # (3, 3) rows, in the file's unit of length
    origin: np.ndarray | None = None
    periodic: tuple | None = None
    step: int | None = None
    time: float | None = None
    length: float = 1.0  # i-PI: of positions, in Å
    cell_length: float = 1.0


def read_comment(line: str, where: str) -> Comment:
    """What a comment line says; an AtcError that begins with `where` if it contradicts itself or cannot be
    understood."""
    if len(line) > _LONGEST:
        raise AtcError(f"{where}: a comment of {len(line)} letters; the file is damaged")
    m = _PLAIN_LAMMPS.match(line)
    if m:
        time = _time(m.group(2), where) if m.group(2) else None
        return Comment("lammps plain", step=_step(m.group(1), where), time=time)
    m = _IPI.search(line)
    if m:
        return _ipi(m, line, where)
    if re.search(r"(?i)\b(Properties|Lattice)\s*=", line):
        return _extended(line, where)
    return Comment("plain")


def _step(text, where):
    try:
        return whole(text)
    except ValueError:
        raise AtcError(f"{where}: the step {text[:40]!r} is no whole number") from None


def _time(text, where):
    try:
        value = number(text)
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise AtcError(f"{where}: the time {text[:40]!r} is no number")
    return value


def _numbers(text: str, what: str, where: str, counts) -> np.ndarray:
    words = re.sub(r"[\[\]{},]", " ", text).split()
    try:
        values = np.array([number(w) for w in words])
    except ValueError:
        values = np.array([np.nan])
    if len(values) not in counts or not np.isfinite(values).all():
        raise AtcError(f"{where}: {what}={text[:60]!r}: expected {' or '.join(map(str, counts))} numbers")
    return values


def _extended(line: str, where: str) -> Comment:
    keys = {}
    for m in _PAIR.finditer(line):
        value = m.group(2)
        if value[:1] in "\"'{" and len(value) > 1:
            value = value[1:-1]
        name = m.group(1).lower()
        if name in keys and name in ("properties", "lattice", "pbc", "time", "timestep", "origin"):
            raise AtcError(f"{where}: {m.group(1)} is there twice")
        keys.setdefault(name, value)
    c = Comment("extended", keys)
    if _LAMMPS.match(line):
        c.kind = "lammps"
    if "properties" in keys:
        parts = keys["properties"].split(":")
        triples = list(zip(*[iter(parts)] * 3))
        if len(parts) % 3 or not all(n and t in [*"SRIL"] and w.isdigit() and 0 < int(w) < 1000 for n, t, w in triples):
            raise AtcError(
                f"{where}: Properties={keys['properties'][:80]!r}: expected name:type:columns triples such as "
                "species:S:1:pos:R:3"
            )
        c.columns = [(n, t, int(w)) for n, t, w in triples]
        names = [n for n, _, _ in c.columns]
        if len(set(names)) < len(names):
            raise AtcError(f"{where}: Properties names {next(n for n in names if names.count(n) > 1)!r} twice")
    if "lattice" in keys:
        v = _numbers(keys["lattice"], "Lattice", where, (9, 3))
        c.vectors = v.reshape(3, 3) if len(v) == 9 else np.diag(v)
    if "origin" in keys:
        c.origin = _numbers(keys["origin"], "Origin", where, (3,))
    pbc = keys.get("pbc")
    if pbc is not None:
        flags = re.sub(r"[\[\],]", " ", pbc).split()
        if len(flags) == 1:
            flags = flags * 3
        if len(flags) != 3 or not all(f.lower() in ("t", "f", "true", "false", "1", "0") for f in flags):
            raise AtcError(f'{where}: pbc={pbc[:40]!r}: expected three of T and F, such as pbc="T T F"')
        c.periodic = tuple(f.lower() in ("t", "true", "1") for f in flags)
    for name in ("timestep", "step"):
        if name in keys:
            # "step" of other programs may be anything; LAMMPS's own name must be a step.
            if name == "timestep" or re.fullmatch(r"\d{1,18}", keys[name]):
                c.step = _step(keys[name], where)
            break
    if "time" in keys:
        c.time = _time(keys["time"], where)
        # %f prints six decimals: of a small time they leave nothing, or too little to tell one step from another.
        if c.kind == "lammps" and c.step and abs(c.time) < 1e-4:
            c.time = None
            c.keys[TIME_ROUNDED] = "yes"
    return c


def _ipi(m, line: str, where: str) -> Comment:
    what = m.group(1)
    try:
        values = np.array([float(w) for w in m.group(2).split()])
    except ValueError:
        values = np.array([np.nan])
    braces = dict(_BRACES.findall(line))
    for other in ("velocities", "forces", "momenta"):
        if other in braces:
            raise AtcError(f"{where}: i-PI wrote {other} here, not positions; give the file of positions")
    if "positions" not in braces:
        raise AtcError(
            f"{where}: the comment has i-PI's CELL({what}) but not the unit of positions: expected "
            f"positions{{angstrom}} or positions{{atomic_unit}}"
        )
    # Older versions of i-PI name the unit of positions alone: their cells are in its own units.
    keys = {} if "cell" in braces else {CELL_UNIT_TAKEN: "atomic_unit"}
    braces.setdefault("cell", "atomic_unit")
    for name in ("positions", "cell"):
        if braces[name] not in _LENGTHS:
            raise AtcError(f"{where}: {name}{{{braces[name]}}}: expected one of {', '.join(_LENGTHS)}")
    if len(values) != (6 if what == "abcABC" else 9) or not np.isfinite(values).all():
        raise AtcError(f"{where}: expected {6 if what == 'abcABC' else 9} numbers behind CELL({what})")
    lengths = {"length": _LENGTHS[braces["positions"]], "cell_length": _LENGTHS[braces["cell"]]}
    c = Comment("ipi", keys, periodic=(True, True, True), **lengths)
    if what == "abcABC":
        if not (values[:3] > 0).all() or not ((values[3:] > 0) & (values[3:] < 180)).all():
            raise AtcError(f"{where}: CELL(abcABC) {values.tolist()} is no cell")
        c.vectors = edge_vectors(values[:3], np.where(values[3:] == 90, 0.0, np.cos(np.radians(values[3:]))))
        if c.vectors is None:
            raise AtcError(f"{where}: angles {values[3:].tolist()} make no cell")
    else:
        h = values.reshape(3, 3)
        if h[1, 0] or h[2, 0] or h[2, 1]:
            raise AtcError(
                f"{where}: CELL({what}) is not upper triangular: i-PI turns such cells, and the atoms stay; write "
                "CELL(abcABC)"
            )
        c.vectors = h.T  # i-PI's h has the edge vectors as columns
    step = re.search(r"\bStep:\s*(-?\d+)", line)
    if step:
        c.step = _step(step.group(1), where)
    return c
