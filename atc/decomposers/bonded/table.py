"""Tabulated bonds and angles: LAMMPS's table files, and its two-step interpolation (file → N even points → linear or
spline)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..table_file import read_table, same_units, spline_through


@dataclass
class Section:
    """One section of a table file in the file's own units: x_k, energy, force = −dE/dx, and the slopes of the force at
    both ends or None."""

    x: np.ndarray
    energy: np.ndarray
    force: np.ndarray
    slopes: tuple | None


def read_section(path, keyword: str, kind: str, where: str = "", units_name: str | None = None) -> Section:
    """The section `keyword` of a LAMMPS bond or angle table file.

    Format: a line with the keyword; a line ``N n [FP lo hi] [EQ x0]``; n lines ``index x energy force``. Blank lines
    and # comments anywhere.

    units_name : unit style of the model; a ``UNITS:`` tag in the file's first line must agree with it

    Raises
    ------
    AtcError for a missing file or section, other units, a malformed line, or coordinates that do not increase.
    """
    known = {"FP": ("lo", "hi"), "EQ": ("x0",)}
    given, data = read_table(path, keyword, kind, known, lambda given: ("x", "energy", "force"), where)
    same_units(given["UNITS"], units_name, path, where)
    x, energy, force = (np.ascontiguousarray(column) for column in data.T)
    if (np.diff(x) <= 0).any():
        raise AtcError(
            f"{path}: the first column after the index of section {keyword!r} must increase from line to line"
        )
    return Section(x, energy, force, given.get("FP"))


class Tables:
    """Interpolation tables by type, all with the same number of points.

    Parameters
    ----------
    sections : {type: Section} in internal units (angles in radians)
    points : N of LAMMPS's ``table linear|spline N``
    spline : cubic splines between the points instead of straight lines
    units : Units the files were in
    """

    def __init__(self, sections: dict[int, Section], points: int, spline: bool, units):
        self.units = units
        self.types = sorted(sections)
        top = max(self.types, default=0) + 1
        self.ends = np.zeros((top, 2))
        # energy, force, and their second derivatives
        self.values = np.zeros((top, points, 4))
        self.spline = spline
        done: dict[int, np.ndarray] = {}
        for t, s in sections.items():
            self.ends[t] = s.x[0], s.x[-1]
            if id(s) not in done:
                done[id(s)] = _interpolated(s, points)
            self.values[t] = done[id(s)]

    def range_of(self, t: int):
        return self.ends[t]

    def lookup(self, types, x):
        """Energies and forces −dU/dx, NaN outside the table."""
        U, F = np.empty(len(x)), np.empty(len(x))
        _lookup(types, x, self.ends, self.values, self.spline, U, F)
        return U, F


def _interpolated(s: Section, points: int) -> np.ndarray:
    if s.slopes is None:
        lo, hi = (s.force[1] - s.force[0]) / (s.x[1] - s.x[0]), (s.force[-1] - s.force[-2]) / (s.x[-1] - s.x[-2])
    else:
        lo, hi = s.slopes
    x = s.x[0] + np.arange(points) * ((s.x[-1] - s.x[0]) / (points - 1))
    e, f = spline_through(s.x, s.energy, -s.force[0], -s.force[-1])(x), spline_through(s.x, s.force, lo, hi)(x)
    # As LAMMPS does: end slopes of the force given, or inferred from the file, once more.
    return np.stack([e, f, spline_through(x, e, -f[0], -f[-1])(x, 2), spline_through(x, f, lo, hi)(x, 2)], axis=-1)


@njit(cache=True, nogil=True, error_model="numpy")
def _lookup(types, x, ends, values, spline, U, F):
    n = values.shape[1]
    for b in range(len(x)):
        t = types[b]
        lo, hi = ends[t, 0], ends[t, 1]
        if not (lo <= x[b] <= hi):
            U[b] = F[b] = np.nan
            continue
        h = (hi - lo) / (n - 1)
        k = int((x[b] - lo) / h)
        k = k if k < n - 1 else n - 2
        q = (x[b] - lo) / h - k
        p = 1.0 - q
        u = p * values[t, k, 0] + q * values[t, k + 1, 0]
        f = p * values[t, k, 1] + q * values[t, k + 1, 1]
        if spline:
            cp = (p * p * p - p) * h * h / 6.0
            cq = (q * q * q - q) * h * h / 6.0
            u += cp * values[t, k, 2] + cq * values[t, k + 1, 2]
            f += cp * values[t, k, 3] + cq * values[t, k + 1, 3]
        U[b] = u
        F[b] = f


def table_options(inp, least: int) -> tuple[int, bool]:
    """How many points a style's tables get, and whether between them are splines."""
    way, points = inp.args if len(inp.args) == 2 else ("", "")
    if way not in ("linear", "spline") or not points.isdigit() or int(points) < least:
        raise inp.wrong(f"{inp.command} takes linear or spline and a number of points of at least {least}")
    return int(points), way == "spline"


def build_tables(inp) -> Tables:
    """From ``bond_style table linear 1000`` and ``bond_coeff 1 file KEYWORD`` lines."""
    kind, options = inp.kind, table_options(inp, 2)

    def read(line):
        if len(line.words) != 2:
            raise inp.wrong(f"{kind}_coeff of table takes a file and a section's keyword", line)
        section = read_section(inp.path(line.words[0], line), line.words[1], kind, line.where, inp.units.name)
        return internal_section(section, kind, inp.units, line.where)

    return Tables(inp.by_type(read), *options, inp.units)


def internal_section(s: Section, kind: str, u, where: str = "") -> Section:
    """A section in internal units: lengths, or angles from degrees (0 to 180) to radians."""
    if kind == "angle":
        # LAMMPS's tolerance for the ends.
        if abs(s.x[0]) > 1e-10 or abs(s.x[-1] - 180.0) > 1e-10:
            raise AtcError(
                f"{where or 'angle table'}: an angle table must run from 0 to 180 degrees, this one from {s.x[0]:g} "
                f"to {s.x[-1]:g}"
            )
        size = np.pi / 180.0
    else:
        size = u.length
    e = u.energy
    x = s.x * size
    if kind == "angle":
        x[0], x[-1] = 0.0, np.pi
    slopes = None if s.slopes is None else tuple(v * e / size**2 for v in s.slopes)
    return Section(x, s.energy * e, s.force * (e / size), slopes)


def read_tables(sections: dict, kind: str, *, points: int, spline: bool = False, units="metal") -> Tables:
    """Tables from files: `sections` is {type: (path, keyword)}, `kind` "bond" or "angle"."""
    from ...units import units as system

    u = system(units)
    read = {
        pk: internal_section(read_section(*pk, kind, units_name=u.name), kind, u, str(pk[0]))
        for pk in dict.fromkeys(sections.values())
    }
    return Tables({t: read[pk] for t, pk in sections.items()}, points, spline, u)
