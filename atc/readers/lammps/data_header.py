"""The head of a LAMMPS data file: counts, units, and the box."""

from __future__ import annotations

import re

import numpy as np

from ...errors import AtcError
from .sections import SectionedFile, number_of, shortened, whole_of

_COUNT = re.compile(
    r"^\s*(\d+)\s+(atoms|bonds|angles|dihedrals|impropers|(?:atom|bond|angle|dihedral|improper) types|"
    r"extra (?:bond|angle|dihedral|improper|special) per atom|ellipsoids|lines|triangles|bodies)(?:\s|$)",
    re.ASCII,
)
_BOX = re.compile(r"^\s*(\S.*?)\s+(xlo\s+xhi|ylo\s+yhi|zlo\s+zhi|xy\s+xz\s+yz|avec|bvec|cvec|abc\s+origin)(?:\s|$)")
# A header line that a fix of the run reads, such as "6 crossterms" of fix cmap.
_OF_A_FIX = re.compile(r"^\s*(\d+)\s+([A-Za-z][A-Za-z_/-]*)\s*$", re.ASCII)
SMALL, LARGE = 1e-80, 1e80  # lengths whose third powers can still be computed with


def looks_like_data(head: bytes, path=None) -> bool:
    """Whether the first bytes of a file are those of a data file: a count of atoms, or atom types, or box bounds in its
    header."""
    lines = head.split(b"\n")[1:60]
    found = [re.match(rb"^\s*[-+\d.eE]+\s.*?(atoms|atom types|xlo xhi|avec)\s*(#.*)?\r?$", line) for line in lines]
    return sum(m is not None for m in found) >= 2


def header_line(line: str) -> bool:
    """Whether a line without comment belongs to the header of a data file."""
    return bool(_COUNT.match(line) or _BOX.match(line) or _OF_A_FIX.match(line))


class DataHeader:
    """What the lines in front of the sections say: `counts` by their words, `unit_style` or None, and `box`, the cell's
    vectors and origin in the file's units, None where it is not there."""

    source: str
    _file: SectionedFile

    def _read_header(self):
        f = self._file
        if not f.places:
            raise AtcError(f"{self.source}: no 'Atoms' section; is it a LAMMPS data file?")
        found = re.search(r"\bunits\s*=\s*(\w+)", f.title)
        self.unit_style = found.group(1) if found else None
        self.counts = {}
        bounds, tilt, general = {}, (0.0, 0.0, 0.0), {}
        counted_by_fixes = []
        for number, line in f.header:
            at = f"{self.source}, line {number}"
            m = _COUNT.match(line)
            if m:
                value = whole_of(m.group(1))
                if value is None:
                    raise AtcError(f"{at}: {shortened(m.group(1))} {m.group(2)} are more than any file holds")
                self.counts[m.group(2)] = value
                continue
            m = _BOX.match(line)
            if m is None:
                counted_by_fixes.append((at, *_OF_A_FIX.match(line).groups()))
                continue
            words, key = m.group(1).split(), m.group(2).split()
            wanted = 2 if len(key) == 2 and key[0] != "abc" else 3
            values = [number_of(w) for w in words]
            if len(words) != wanted or None in values:
                raise AtcError(f"{at}: expected numbers in {shortened(line.strip())!r}")
            if max(map(abs, values)) > LARGE:
                raise AtcError(f"{at}: {shortened(line.strip())!r} is no box of atoms")
            if key[0] == "xy":
                tilt = tuple(values)
            elif len(key) == 2 and key[0] != "abc":
                bounds[key[0][0]] = tuple(values)
            else:
                general[key[-1]] = values
        if "atoms" not in self.counts:
            raise AtcError(f"{self.source}: the header has no '<n> atoms' line; is it a LAMMPS data file?")
        self._settle_fix_headers(counted_by_fixes)
        self._bounds, self._tilt = bounds, tilt
        self.box = None
        if general:
            if set(general) != {"avec", "bvec", "cvec", "origin"}:
                raise AtcError(
                    f"{self.source}: a general triclinic box needs avec, bvec, cvec and 'abc origin' in the header"
                )
            self.box = (np.array([general[v] for v in ("avec", "bvec", "cvec")]), np.array(general["origin"]))
            self._require_volume(self.box[0], "the vectors avec, bvec, cvec")
        elif set(bounds) == set("xyz"):
            self._restricted_box(bounds)

    def _settle_fix_headers(self, lines):
        """Header lines that LAMMPS does not know: a fix reads them, with a section of as many lines; otherwise they are
        mistakes."""
        sizes = {len(self._file.section(name)) for name in self._file.others} if lines else set()
        for at, count, what in lines:
            if whole_of(count) not in sizes:
                raise AtcError(
                    f"{at}: {shortened(f'{count} {what}')!r} is no header line of LAMMPS, nor of a section of a fix "
                    "that has so many lines"
                )

    def _restricted_box(self, bounds):
        lo, hi = np.array([bounds[a] for a in "xyz"]).T
        xy, xz, yz = self._tilt
        if not (hi > lo).all():
            raise AtcError(f"{self.source}: the box bounds {lo.tolist()} to {hi.tolist()} enclose no volume")
        lx, ly, lz = hi - lo
        self.box = (np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]]), lo)
        self._require_volume(self.box[0], f"the box bounds {lo.tolist()} to {hi.tolist()}")

    def _require_volume(self, vectors, what):
        lengths = np.linalg.norm(vectors, axis=1)
        if not (lengths > SMALL).all() or not abs(np.linalg.det(vectors / lengths[:, None])) > 1e-12:
            raise AtcError(f"{self.source}: {what} enclose no volume")

    def _default_bounds(self, x_nc):
        """The faces that the header leaves out are at -0.5 and 0.5, as for the z of a two-dimensional run, if the atoms
        agree."""
        if self.box is not None:
            return
        missing = [a for a in "xyz" if a not in self._bounds]
        inside = all((np.abs(x_nc["xyz".index(a)]) <= 0.5).all() for a in missing)
        if inside and missing != list("xyz"):
            self._restricted_box({**dict.fromkeys("xyz", (-0.5, 0.5)), **self._bounds})
