"""Local-density potentials of coarse-grained models: an energy of how many neighbours of some types an atom has (LAMMPS
``pair_style local/density``)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ...units import Units
from ...units import units as system
from ..registry import pair_style
from .elements import whole_line
from .neighbor_work import NeighborTerm, NeighborWork, shares
from .parameter_file import Rows, read_parameter_file
from .spline_meam import Spline, _spline, _stack

_MOST_TYPES = 100_000


@dataclass
class LocalDensityPart:
    """One of the potentials: inner and outer cutoff, types of the atoms that have the energy and of those that are
    counted, F as a spline of ρ."""

    inner: float
    outer: float
    central: tuple[int, ...]
    neighbors: tuple[int, ...]
    F: Spline


def read_local_density(path, where: str = "") -> list[LocalDensityPart]:
    """A LAMMPS local-density file: two lines of comment, the number of potentials and of tabulated values, and a block
    for each.

    Raises
    ------
    AtcError for a missing or malformed file.
    """
    text = read_parameter_file(path, "local-density", where)
    # Two lines of comment; blank lines do not count.
    row = Rows(path, [(k, w) for k, line in enumerate(text.splitlines()[2:], 3) if (w := line.split())]).values
    (parts, points), at = row("the number of potentials and of values", (int, int))
    if parts < 1 or points < 2:
        raise AtcError(f"{at}: expected one potential and two values or more, got {parts} and {points}")
    out = []
    for k in range(1, parts + 1):
        (inner, outer), at = row(f"the cutoffs R1 and R2 of potential {k}", (float, float))
        if not 0 <= inner < outer:
            raise AtcError(f"{at}: expected 0 <= R1 < R2, got {inner:g} and {outer:g}")
        central, _ = row(f"the central types of potential {k}", int)
        neighbors, _ = row(f"the neighbour types of potential {k}", int)
        if not all(1 <= t <= _MOST_TYPES for t in (*central, *neighbors)):
            raise AtcError(f"{at}: the atom types of potential {k} must be between 1 and {_MOST_TYPES}")
        (low, high, _), at = row(f"rho_min, rho_max and drho of potential {k}", (float, float, float))
        if not low < high:
            raise AtcError(f"{at}: rho_max must be larger than rho_min")
        F = np.array([row(f"a value of potential {k}", (float,))[0][0] for _ in range(points)])
        spline = Spline(np.linspace(low, high, points), F, 0.0, 0.0)
        if spline.steep():
            raise AtcError(f"{at}: the values of potential {k} are too large, or its densities too close")
        # LAMMPS makes the step from the ends and the number of values, whatever drho says; F is level at both ends.
        out.append(LocalDensityPart(inner, outer, tuple(central), tuple(neighbors), spline))
    return out


class _LocalDensityWork(NeighborWork):
    own = ("_densities", "_merge")

    def joined(self, acc):
        self.slope = np.zeros((len(self.near.atom), len(self.term.F)))

    def _densities(self, task, acc):
        t = self.term
        functions = t.central, t.counted, t.shape, t.F
        acc.energy += _densities(*self.atoms(task), self.lists, *functions, self.slope, shares(acc))

    def _merge(self, task, acc):
        return self.of_pairs(task, acc, _bonds, self.term.counted, self.term.shape, self.slope)


class LocalDensity(NeighborTerm):
    """U = Σ_k Σ_i a_k(type i) F_k(ρ_k,i), ρ_k,i = Σ_j b_k(type j) φ_k(d_ij), φ = 1 up to R1, 0 from R2 on, a cubic in
    d² between with level ends.

    A pair's G = Σ_k [F_k'(ρ_i) b_j + F_k'(ρ_j) b_i] φ_k'/d: one bond a pair. The energy belongs to the atom whose
    neighbours are counted. F is LAMMPS's cubic spline through the table, level at its ends and constant beyond.

    Parameters
    ----------
    parts : list of LocalDensityPart in `units` (types from 1)
    units : the default is LAMMPS's real

    Notes
    -----
    Source: Sanyal & Shell, J. Chem. Phys. 145, 034109 (2016).
    """

    work = _LocalDensityWork
    sweeps = 2
    word = "local-density"

    def __init__(self, parts: list[LocalDensityPart], *, units: str | Units = "real"):
        self.units = u = system(units)
        energy, length = u.energy, u.length
        top = max(max(p.central + p.neighbors) for p in parts)
        m = len(parts)
        self.central, self.counted = np.zeros((m, top + 1)), np.zeros((m, top + 1))
        self.shape = np.zeros((m, 6))
        for k, p in enumerate(parts):
            self.central[k, list(p.central)] = 1.0
            self.counted[k, list(p.neighbors)] = 1.0
            # A cubic in y = (d² − R1²)/(R2² − R1²) that falls from 1 to 0 with level ends.
            r1, r2 = (p.inner * length) ** 2, (p.outer * length) ** 2
            self.shape[k, :2] = r1, r2
        self.F = _stack([p.F.rows(1.0, energy) for p in parts])
        self.cutoff = float(max(p.outer for p in parts) * length)

    @classmethod
    def from_file(cls, path, *, units: str | Units = "real", where: str = "") -> LocalDensity:
        """From a LAMMPS file. where : the line that names it, for messages."""
        return cls(read_local_density(path, where), units=units)

    def describe(self) -> str:
        return f"local/density ({len(self.F)}), energy to the atom whose neighbours are counted"

    def kinds(self, frame: Frame):
        types = frame.types
        if len(types) and types.min() < 1:
            raise AtcError(f"{frame.source}: atom types must be 1 or larger, found {int(types.min())}")
        # Types that the file does not name take no part.
        return np.where(types < self.central.shape[1], types, 0).astype(np.int32), None


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _indicator(d, row):
    """φ(d) and φ'/d."""
    r1, r2 = row[0], row[1]
    x = d * d
    if x <= r1:
        return 1.0, 0.0
    if x >= r2:
        return 0.0, 0.0
    y = (x - r1) / (r2 - r1)
    return 1.0 - y * y * (3.0 - 2.0 * y), -12.0 * y * (1.0 - y) / (r2 - r1)


@njit(cache=True, nogil=True, error_model="numpy")
def _densities(s0, s1, near, central, counted, shape, F, slope, energies):
    """F of the atoms s0..s1, F' into slope (atoms, potentials)."""
    start, pair, end, a, b, _, d, kind, atom = near
    total = 0.0
    for s in range(s0, s1):
        for k in range(len(F)):
            if central[k, kind[s]] == 0.0:
                continue
            rho = 0.0
            for e in range(start[s], start[s + 1]):
                p = pair[e]
                other = b[p] if end[e] == 0 else a[p]
                rho += counted[k, kind[other]] * _indicator(d[p], shape[k])[0]
            U, slope[s, k] = _spline(F[k], rho)
            total += U
            if len(energies) > 0:
                energies[atom[s]] += U
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _bonds(p0, p1, near, counted, shape, slope, out, energies):
    _, _, _, a, b, r, d, kind, atom = near
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(out_D) > 0
    m = 0
    for p in range(p0, p1):
        i, j = a[p], b[p]
        at_i = at_j = 0.0
        for k in range(len(shape)):
            g = _indicator(d[p], shape[k])[1]
            at_i += slope[i, k] * counted[k, kind[j]] * g
            at_j += slope[j, k] * counted[k, kind[i]] * g
        if at_i == 0.0 and at_j == 0.0:
            continue
        out_i[m], out_j[m], out_G[m] = atom[i], atom[j], at_i + at_j
        for c in range(3):
            out_r[m, c] = r[p, c]
            if sources:
                out_D[m, 0, c] = -at_i * r[p, c]
                out_D[m, 1, c] = at_j * r[p, c]
        m += 1
    return m, 0.0, -1


@pair_style("local/density")
def _local_density(inp):
    line = whole_line(inp, "pair_coeff * * <file>")
    if len(line.words) != 1:
        raise inp.wrong(f"{inp.command} takes pair_coeff * * <file>", line)
    return LocalDensity.from_file(inp.path(line.words[0], line), units=inp.units, where=line.where)
