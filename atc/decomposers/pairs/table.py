"""Tabulated pair interactions, interpolated exactly as LAMMPS's ``pair_style table`` does."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import LAMMPS_STYLES
from ...units import units as get_units
from ..registry import StyleInput, pair_style
from ..table_file import read_table, spline_through
from .input import fill
from .pairs import PairStyle

_MOST = 10_000_000


@dataclass
class TableSection:
    """One section of a table file, in the file's own units: distances r, energies e, forces f = −dU/dr."""

    r: np.ndarray
    e: np.ndarray
    f: np.ndarray
    spacing: str | None = None
    lo: float = 0.0
    hi: float = 0.0
    fprime: tuple[float, float] | None = None
    units: str | None = None


def read_section(path: Path, keyword: str) -> TableSection:
    """The section `keyword` of a LAMMPS pair table file.

    Raises AtcError for a missing section or parameter, too few lines, or entries that are not numbers.
    """
    ends = ("lo", "hi")
    known = {"R": ends, "RSQ": ends, "FPRIME": ends}
    given, data = read_table(path, keyword, "pair", known, lambda given: ("r", "energy", "force"))
    r, e, f = (np.ascontiguousarray(column) for column in data.T)
    spacing = next((key for key in reversed(given) if key in ("R", "RSQ")), None)
    lo, hi = given.get(spacing, (0.0, 0.0))
    t = np.arange(len(r)) / (len(r) - 1)
    if spacing == "R":
        r = lo + (hi - lo) * t
    elif spacing == "RSQ":
        r = np.sqrt(lo**2 + (hi**2 - lo**2) * t)
    if not (np.diff(r) > 0).all() or r[0] <= 0:
        raise AtcError(f"{path}: the distances of section {keyword} must be positive and increase from line to line")
    return TableSection(r, e, f, spacing, lo, hi, given.get("FPRIME"), given["UNITS"])


class Table(PairStyle):
    """U and the force from tables, interpolated in d² (LAMMPS ``table linear N`` or ``table spline N``).

    LAMMPS splines the given values over r, samples the spline at N points even in r², and interpolates those linearly
    or with cubic splines in r²; energy and force are interpolated separately. So does this class.

    Parameters
    ----------
    r, energy, force : (m,) arrays, m ≥ 2, increasing positive distances; force = −dU/dr
    cutoff : float, default r[-1]
    points : N
    interpolation : "spline" or "linear"
    units : unit style of the arrays
    n_types : the one table is for all pairs of this many types (default 1)

    Raises
    ------
    AtcError where two atoms are closer than the table starts.
    """

    name = "table"

    def __init__(
        self,
        r,
        energy,
        force,
        *,
        units,
        cutoff=None,
        points: int = 5000,
        interpolation: str = "spline",
        n_types: int = 1,
    ):
        u = get_units(units)
        if interpolation not in ("spline", "linear"):
            raise AtcError(f"Table: interpolation must be 'spline' or 'linear', got {interpolation!r}")
        r, energy, force = (np.ascontiguousarray(a, dtype=float) for a in (r, energy, force))
        alike = r.ndim == 1 and len(r) >= 2 and r.shape == energy.shape == force.shape
        if not (alike and (np.diff(r) > 0).all() and r[0] > 0):
            raise AtcError(
                "Table: r, energy and force must be arrays of one length (at least 2), r positive and increasing"
            )
        end = r[-1] if cutoff is None else cutoff
        grid = _Grid(TableSection(r, energy, force), end, points, interpolation == "spline")
        which = np.full((n_types + 1, n_types + 1), -1)
        which[1:, 1:] = 0
        self._set_grids([grid], which, u)
        self.units = u

    @classmethod
    def of_grids(cls, grids, which, u):
        """From several grids (user units) and which grid each pair of types has (−1: none)."""
        style = cls.__new__(cls)
        style._set_grids(grids, which, u)
        return style

    def _set_grids(self, grids, which, u):
        L, E = u.length, u.energy
        cut2 = np.array([*((g.cut * L) ** 2 for g in grids), 0.0])
        self.table = cut2[which][..., None]
        self.which = np.ascontiguousarray(which)
        self.spline = grids[0].spline
        # Per grid: inner², 1/δ, δ²/6; per point: U, G, and their second derivatives (spline).
        self.head = np.array([[g.inner2 * L**2, 1.0 / (g.delta * L**2), g.delta**2 * L**4 / 6.0] for g in grids])
        self.data = np.ascontiguousarray(
            [np.stack([g.e * E, -g.f * E / L**2, g.e2 * E / L**4, -g.f2 * E / L**6], axis=-1) for g in grids]
        )
        self.inner = [g.inner2**0.5 * L for g in grids]

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _table(types, i, j, d2, weights, self.table, self.which, self.head, self.data, self.spline, U, G)

    def trouble(self, ti, tj, d):
        k = self.which[ti, tj]
        if k >= 0 and d < self.inner[k]:
            return f"their distance {d:.6g} Å is smaller than the first distance of their table, {self.inner[k]:.6g} Å"
        return None


class _Grid:
    """N points even in r² from a section: LAMMPS's PairTable::compute_table."""

    def __init__(self, s: TableSection, cut: float, n: int, spline: bool):
        self.cut, self.spline = cut, spline
        inner = s.lo if s.spacing else s.r[0]
        self.inner2 = inner * inner
        self.delta = (cut * cut - self.inner2) / (n - 1)
        rsq = self.inner2 + np.arange(n) * self.delta
        r = np.sqrt(rsq)
        # The values are taken as they are where LAMMPS does: a linear table whose file has just the points it wants.
        if not spline and len(s.r) == n and s.spacing == "RSQ" and s.hi == cut:
            e, force = s.e, s.f
        else:
            lo, hi = s.fprime or ((s.f[1] - s.f[0]) / (s.r[1] - s.r[0]), (s.f[-1] - s.f[-2]) / (s.r[-1] - s.r[-2]))
            force_at = spline_through(s.r, s.f, lo, hi)
            e, force = spline_through(s.r, s.e, -s.f[0], -s.f[-1])(r), force_at(r)
        self.e, self.f = e, force / r
        self.e2 = self.f2 = np.zeros(n)
        if not spline:
            return
        self.e2 = spline_through(rsq, e, -force[0] / (2.0 * inner), -force[-1] / (2.0 * cut))(rsq, 2)
        # d(f/r)/d(r²) at both ends: from FPRIME, or a secant over a tenth of a step.
        step = 0.1 * self.delta

        def h(x):
            return force_at(np.sqrt(x)) / np.sqrt(x)

        if s.fprime:
            g0 = (s.fprime[0] / inner - force[0] / self.inner2) / (2.0 * inner)
        else:
            g0 = (h(self.inner2 + step) - force[0] / inner) / step
        if s.fprime and cut == s.r[-1]:
            g1 = (s.fprime[1] / cut - force[-1] / cut**2) / (2.0 * cut)
        else:
            g1 = (force[-1] / cut - h(cut * cut - step)) / step
        self.f2 = spline_through(rsq, self.f, g0, g1)(rsq, 2)


@pair_style("table")
def _table_style(inp: StyleInput):
    if len(inp.args) != 2 or inp.args[0] not in ("linear", "spline"):
        raise inp.error(
            f"pair_style table {' '.join(inp.args)} is not supported: expected 'pair_style table linear N' or 'table "
            "spline N'"
        )
    n = inp.args[1]
    if not (n.isascii() and n.isdigit() and len(n) < 20) or int(n) < 2:
        raise inp.error(f"{inp.command}: expected a number of points of at least 2, got {n!r}")
    n = int(n)
    if n > _MOST:
        raise inp.error(f"{inp.command}: {n} points are more than the {_MOST} that are supported")
    grids = []

    def read(line):
        if len(line.words) not in (2, 3):
            raise inp.error(
                f"{inp.command}: expected 'pair_coeff I J file keyword [cutoff]', got {' '.join(line.words)!r}", line
            )
        s = read_section(inp.path(line.words[0], line), line.words[1])
        if s.units is not None and s.units != inp.units.name:
            s = _converted(s, inp, line)
        top = s.hi if s.spacing else s.r[-1]
        cut = inp.number(line.words[2], "dimensionless", "cutoff", line) if len(line.words) == 3 else top
        if not (s.lo if s.spacing else s.r[0]) < cut <= top:
            raise inp.error(f"{inp.command}: the cutoff {cut:g} is outside the table, {s.r[0]:g} to {top:g}", line)
        grids.append(_Grid(s, cut, n, inp.args[0] == "spline"))
        return (float(len(grids)),)

    (which,) = fill(inp, inp.by_pair(read), 1)
    return Table.of_grids(grids, which.astype(np.int64) - 1, inp.units)


def _converted(s: TableSection, inp: StyleInput, line) -> TableSection:
    """A section whose file says other units than the model's."""
    if s.units not in LAMMPS_STYLES or (s.units == "lj") != inp.units.reduced:
        raise inp.error(
            f"{inp.command}: {line.words[0]} says UNITS: {s.units}, which does not go with units {inp.units.name}", line
        )
    u = get_units(s.units)
    L, E = u.length / inp.units.length, u.energy / inp.units.energy
    fp = None if s.fprime is None else tuple(v * E / L**2 for v in s.fprime)
    return TableSection(s.r * L, s.e * E, s.f * E / L, s.spacing, s.lo * L, s.hi * L, fp, inp.units.name)


@njit(cache=True, nogil=True, error_model="numpy")
def _table(types, i, j, d2, weights, table, which, head, data, spline, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            m = which[ti, tj]
            x = (d2[b] - head[m, 0]) * head[m, 1]
            if x < 0.0:
                U[b] = np.nan
                continue
            k = min(int(x), data.shape[1] - 2)
            c = x - k
            a = 1.0 - c
            u = a * data[m, k, 0] + c * data[m, k + 1, 0]
            g = a * data[m, k, 1] + c * data[m, k + 1, 1]
            if spline:
                p, q = (a * a * a - a) * head[m, 2], (c * c * c - c) * head[m, 2]
                u += p * data[m, k, 2] + q * data[m, k + 1, 2]
                g += p * data[m, k, 3] + q * data[m, k + 1, 3]
            U[b] += w * u
            G[b] += w * g
