"""Atomic configurations for AtomEye that LAMMPS wrote (``dump cfg``): one snapshot a file, in the units of its run."""

from __future__ import annotations

import re

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell
from ..resolution import text_resolution
from ..table import FLOAT, INT, TEXT, is_number, parse_columns
from ..whole import bytes_as_they_are
from .columns import INT_COLUMNS, KNOWN_FLOATS, LammpsTrajectory
from .dump import number, whole

# How many times the box of a file with unwrapped coordinates is larger than the run's (LAMMPS manual, dump cfg).
_EXPANDED = 10.0
# LAMMPS's mass and element lines end with a blank; masses have six decimals. Other writers' do not.
_LAMMPS = re.compile(
    rb"\ANumber of particles = \d+\r?\nA = \S+ Angstrom \(basic length-scale\)\r?\nH0\(1,1\) = [^\n]* "
    rb"A\r?\n.*?^\.NO_VELOCITY\.\r?\nentry_count = \d+\r?\n"
    rb"(?:auxiliary\[\d+\] = [^\n]*\n)*(?:[-\d.]+\.\d{6} \r?\n\S+ \r?\n|\Z)",
    re.S | re.M,
)


def looks_like_lammps_cfg(head: bytes, path=None) -> bool:
    """Whether a file is a configuration that LAMMPS wrote, not ASE, OVITO or AtomEye itself, whose files are in Å."""
    return _LAMMPS.match(head) is not None


class LammpsCfg(LammpsTrajectory):
    """The one frame of a CFG file of LAMMPS.

    Parameters are those of `atc.readers.lammps.dump.LammpsDump`; `units` is needed: the file says "Angstrom" whatever
    the run's units are.

    Notes
    -----
    Reduced coordinates times the edge vectors H0. A file with unwrapped coordinates (``xsu ysu zsu``: "A = 10") has a
    box drawn ten times as large about the centre; its true coordinates are (s − ½)·10 + ½. Auxiliary columns have the
    meaning of their names in a dump. The file knows neither step nor time, nor the corner of the box or its boundaries:
    the corner is put at 0, 0, 0, all axes are taken as periodic (`assumed` says so).
    """

    assumed = ("a CFG file does not say which faces of its box are periodic: all are taken to be",)

    def __init__(self, path, topology=None, units=None, masses=None):
        self.source = str(path)
        self._read(bytes_as_they_are(path).tobytes().replace(b"\r\n", b"\n"))
        super().__init__(path, topology, units, masses, None)

    def _fail(self, line, what) -> AtcError:
        return AtcError(f"{self.source}, line {line}: {what}; the file is damaged")

    def _read(self, text: bytes):
        head = text[: text.index(b"entry_count")].decode("utf-8", "replace").split("\n")
        found = {}
        for k, line in enumerate(head, 1):
            key, _, value = line.partition("=")
            words = value.split()
            if words:
                found[key.strip()] = (words[0], k)
        try:
            self._n = whole(found["Number of particles"][0])
            scale = number(found["A"][0])
            h = np.array([[number(found[f"H0({i},{j})"][0]) for j in (1, 2, 3)] for i in (1, 2, 3)])
        except (KeyError, ValueError):
            raise self._fail(
                1, "expected 'Number of particles', 'A' and the nine numbers H0(i,j), each with a number"
            ) from None
        if scale not in (1.0, _EXPANDED):
            raise self._fail(2, f"'A = {scale:g}': LAMMPS writes 1, or 10 for unwrapped coordinates")
        self._unwrapped = scale == _EXPANDED
        self._h = h
        at = text.index(b"entry_count")
        line = text.count(b"\n", 0, at) + 1
        stop = text.find(b"\n", at)
        try:
            entries = whole(text[at:stop].split(b"=")[1].decode().strip())
        except (ValueError, IndexError):
            raise self._fail(line, "expected 'entry_count = <n>'") from None
        names = []
        at = stop + 1
        while text.startswith(b"auxiliary[", at):
            stop = text.find(b"\n", at)
            if stop < 0:
                break
            line += 1
            names.append(text[at:stop].partition(b"=")[2].strip().decode("utf-8", "replace").split(" [")[0])
            at = stop + 1
        if entries != 3 + len(names):
            raise self._fail(
                line, f"entry_count is {entries}, expected 3 coordinates and {len(names)} auxiliary columns"
            )
        # The table: mass, element and numbers are three lines an atom. A file that ends within them is still being
        # written.
        body = text[at:]
        there = body.count(b"\n") // 3
        if self._n < 0 or there < self._n:
            raise AtcError(
                f"{self.source} holds no complete frame: {there} of {self._n} atoms are there, each line with its "
                "line end"
            )
        if not self._n:
            raise AtcError(f"{self.source} holds no atoms")
        lines = body.split(b"\n")
        if any(w.strip() for w in lines[3 * self._n :]):
            raise self._fail(line + 1 + 3 * self._n, f"there are more lines than {self._n} atoms take")
        lines = lines[: 3 * self._n]
        joined = np.frombuffer(b"".join(b" ".join(lines[3 * k : 3 * k + 3]) + b"\n" for k in range(self._n)), np.uint8)
        # Positions have names of their own: an auxiliary x is another column.
        own = ("mass", "element", "xs", "ys", "zs", "x", "y", "z")
        names = [f"auxiliary {name}" if name in own else name for name in names]
        if len(set(names)) < len(names):
            raise self._fail(line, "an auxiliary column is there twice")
        sample = lines[2].split()[3:]
        numeric = [c >= len(sample) or is_number(sample[c]) or n in KNOWN_FLOATS for c, n in enumerate(names)]
        kinds = [INT if n in INT_COLUMNS else FLOAT if number else TEXT for n, number in zip(names, numeric)]
        first = line + 1
        self._columns = parse_columns(
            joined, ["mass", "element", "xs", "ys", "zs", *names], [FLOAT, TEXT, FLOAT, FLOAT, FLOAT, *kinds], self._n,
            lambda row: f"{self.source}, lines {first + 3 * row} to {first + 3 * row + 2}", KNOWN_FLOATS,
        )  # fmt: skip
        self._sample = [w for k in range(2, 3 * self._n, 3 * max(1, self._n // 1000)) for w in lines[k].split()[:3]]
        if self._unwrapped:
            for name in ("xs", "ys", "zs"):
                self._columns[f"{name[0]}su"] = (self._columns.pop(name) - 0.5) * _EXPANDED + 0.5

    def __len__(self):
        return 1

    def _columns_of(self, k):
        return self._columns, f"{self.source} frame 0", lambda row: f"atom {row + 1} of the file"

    def _frame(self, k):
        where = f"{self.source} frame 0"
        columns = dict(self._columns)
        mass = columns["mass"]
        if not (mass > 0).all():
            self._once(
                "mass",
                f"{self.source}: its six decimals leave nothing of the masses in these units; they are not used, give "
                "masses",
            )
            del columns["mass"]
        if "type" not in columns and self._data is None:
            self._names_tell_types(columns["element"], mass)
        with located(where):
            cell = Cell(self._h * self.units.length)
        return self._build(columns, cell, k, where, None, None, lambda row: f"atom {row + 1} of the file")

    def _names_tell_types(self, names, mass):
        """Without ``dump_modify element``, LAMMPS calls all types C."""
        for name in np.unique(names).tolist():
            different = np.unique(mass[names == name])
            if len(different) > 1:
                raise AtcError(
                    f"{self.source}: atoms called {name!r} have masses {different[0]:g} and {different[1]:g}, so this "
                    "name stands for several types; "
                    "dump type among the auxiliary columns, or name the types with dump_modify element"
                )

    def _numbered(self):
        return "id" in self._columns

    def _precision(self, frame):
        step, why = text_resolution([w.decode("utf-8", "replace") for w in self._sample])
        longest = float(np.linalg.norm(frame.cell.vectors, axis=1).max())
        return step * (_EXPANDED if self._unwrapped else 1.0) * longest, why
