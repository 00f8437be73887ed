"""Tabulated bonds and angles: LAMMPS's table files, and its two-step interpolation (file → N even points → linear or
spline)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...readers.lammps.sections import shortened
from ...readers.whole import whole_text
from ..many_body.parameter_file import units_tag


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
    lines = section_lines(path, keyword, kind, where, units_name)
    number, words = lines[0]
    n, slopes = None, None
    p = 0
    try:
        while p < len(words):
            if words[p] == "N":
                n, p = int(words[p + 1]), p + 2
            elif words[p] == "FP":
                slopes, p = (float(words[p + 1]), float(words[p + 2])), p + 3
            elif words[p] == "EQ":
                float(words[p + 1])
                p += 2
            else:
                raise ValueError
    except (ValueError, IndexError):
        raise AtcError(
            f"{path}:{number}: expected the parameters of a {kind} table, N <n> [FP <lo> <hi>] [EQ <x0>], got "
            f"{shortened(' '.join(words))!r}"
        ) from None
    if n is None or n < 2:
        raise AtcError(f"{path}:{number}: a {kind} table needs N <number of lines> of at least 2")
    if n > len(lines) - 1:
        raise AtcError(
            f"{path}:{number}: the section {keyword!r} announces {n} lines, the file has {len(lines) - 1} more"
        )
    data = read_rows(path, keyword, lines[1 : n + 1], n, ("x", "energy", "force"))
    if not np.isfinite(data).all() or (np.diff(data[:, 0]) <= 0).any():
        raise AtcError(
            f"{path}: the first column after the index of section {keyword!r} must increase from line to line, all "
            "numbers finite"
        )
    return Section(data[:, 0].copy(), data[:, 1].copy(), data[:, 2].copy(), slopes)


def section_lines(
    path, keyword: str, kind: str, where: str = "", units_name: str | None = None
) -> list[tuple[int, list[str]]]:
    """(number, words) of the lines behind a section's keyword to the end of the file, without comments and blank lines;
    the first is its parameters.

    Raises AtcError as `read_section`.
    """
    at = f"{where}: " if where else ""
    text = whole_text(path, f"{kind} table", where)
    tag = units_tag(text)
    if None not in (tag, units_name) and tag != units_name:
        raise AtcError(
            f"{at}{path} is in {tag!r} units (its UNITS: tag) and the model in {units_name!r}: use a table in the "
            "model's units"
        )
    lines = [(n, w) for n, line in enumerate(text.splitlines(), 1) if (w := line.partition("#")[0].split())]
    start = next((p for p, (_, w) in enumerate(lines) if w[0] == keyword), None)
    if start is None:
        names = [w[0] for _, w in lines if not _number(w[0]) and w[0] != "N"]
        raise AtcError(f"{at}{path} has no section {keyword!r}; it has {shortened(', '.join(names)) or 'none'}")
    if start + 1 == len(lines):
        raise AtcError(
            f"{path}:{lines[start][0]}: the section {keyword!r} is empty: expected a line N <number of lines>"
        )
    return lines[start + 1 :]


def read_rows(path, keyword: str, rows, n: int, columns) -> np.ndarray:
    """(n, columns) numbers of n lines ``index <columns>``. Raises AtcError that names the line."""
    data = np.empty((n, len(columns)))
    for k in range(n):
        try:
            number, words = rows[k]
            data[k] = [float(v) for v in words[1 : len(columns) + 1]]
            int(words[0])
        except (ValueError, IndexError):
            here = f"{path}:{number}" if k < len(rows) else str(path)
            raise AtcError(
                f"{here}: the section {keyword!r} needs {n} lines of index, {', '.join(columns)}; line {k + 1} of "
                "them is missing or malformed"
            ) from None
    return data


def _number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


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

    def lookup(self, types, x, U, F) -> int:
        """Fill energies and forces −dU/dx. Returns the first entry outside its table, or −1."""
        return _lookup(types, x, self.ends, self.values, self.spline, U, F)


def _spline(x, y, slope0, slope1):
    """Second derivatives at the knots of the cubic spline with given end slopes."""
    from scipy.interpolate import CubicSpline

    c = CubicSpline(x, y, bc_type=((1, slope0), (1, slope1)))
    return c, c(x, 2)


def _interpolated(s: Section, points: int) -> np.ndarray:
    if s.slopes is None:
        lo, hi = (s.force[1] - s.force[0]) / (s.x[1] - s.x[0]), (s.force[-1] - s.force[-2]) / (s.x[-1] - s.x[-2])
    else:
        lo, hi = s.slopes
    e_file, _ = _spline(s.x, s.energy, -s.force[0], -s.force[-1])
    f_file, _ = _spline(s.x, s.force, lo, hi)
    x = s.x[0] + np.arange(points) * ((s.x[-1] - s.x[0]) / (points - 1))
    e, f = e_file(x), f_file(x)
    _, e2 = _spline(x, e, -f[0], -f[-1])
    # As LAMMPS does: end slopes of the force given, or inferred from the file, once more.
    _, f2 = _spline(x, f, lo, hi)
    return np.stack([e, f, e2, f2], axis=-1)


@njit(cache=True, nogil=True, error_model="numpy")
def _lookup(types, x, ends, values, spline, U, F):
    n = values.shape[1]
    for b in range(len(x)):
        t = types[b]
        lo, hi = ends[t, 0], ends[t, 1]
        if not (lo <= x[b] <= hi):
            return b
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
    return -1


def table_options(inp, least: int) -> tuple[int, bool]:
    """How many points a style's tables get, and whether between them are splines."""
    way, points = inp.args if len(inp.args) == 2 else ("", "")
    if way not in ("linear", "spline") or not points.isdigit() or int(points) < least:
        raise inp.wrong(f"{inp.command} takes linear or spline and a number of points of at least {least}")
    return int(points), way == "spline"


def build_tables(inp, kind: str) -> Tables:
    """From ``bond_style table linear 1000`` and ``bond_coeff 1 file KEYWORD`` lines."""
    options = table_options(inp, 2)

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
