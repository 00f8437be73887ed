"""Bonds of the topology: U(d) between the closest images of two bonded atoms, half of it to each."""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ..base import Accumulator, Work
from ..images import Images
from ..registry import bond_style
from .table import Tables, build_tables
from .topology import CHUNK, BondedTerm, energy, length, per_length, per_length2, register_bonded

# LAMMPS stops evaluating the logarithm of FENE here (it warns, and uses this value), which is at 0.949 R0.
_FENE_CAP = 0.1


class BondStyle(BondedTerm):
    """Base of the bond styles. Subclasses implement `add`."""

    kind = "bond"
    pairwise = True

    def add(self, types, d, U, G):
        """Fill U and G = U'(d)/d of bonds of length d, all (b,). Returns (the first bond that has no energy, or −1; how
        many are worth a note)."""
        raise NotImplementedError

    def refuse(self, t: int, d: float) -> str:
        """Why a bond of type t and length d has no energy, and what to do."""
        raise NotImplementedError

    def note(self) -> str:
        """What the count that `add` returns means."""
        return ""

    def describe(self) -> str:
        return f"bond {self.name}, energy shared half to each atom"

    def prepare(self, frame: Frame) -> Work:
        return _BondWork(self, frame)


class _BondWork(Work):
    def __init__(self, term: BondStyle, frame: Frame):
        self.term, self.frame = term, frame
        atoms, self.types = term.terms_of(frame)
        self.i, self.j = np.ascontiguousarray(atoms[:, 0]), np.ascontiguousarray(atoms[:, 1])
        self.images = Images(frame.cell)
        self.stages = (-(-len(atoms) // CHUNK),)

    def vectors(self, here: slice, r):
        """Fill r = x_i − x_j of some of the bonds."""
        self.images.vectors_to(self.frame.positions, self.i[here], self.j[here], r)

    def add(self, i, j, types, d, U, G):
        return self.term.add(types, d, U, G)

    def run(self, stage, task, acc: Accumulator):
        here = slice(task * CHUNK, (task + 1) * CHUNK)
        i, j, types = self.i[here], self.j[here], self.types[here]
        n = len(i)
        r = np.empty((n, 3))
        self.vectors(here, r)
        d = np.sqrt(np.einsum("bc,bc->b", r, r))
        U, G = np.zeros(n), np.zeros(n)
        bad, noted = self.add(i, j, types, d, U, G)
        if bad >= 0:
            a, b = self.frame.ids[i[bad]], self.frame.ids[j[bad]]
            raise AtcError(
                f"{self.frame.source}: the bond between atoms {a} and {b} (type {types[bad]}, style {self.term.name}) "
                f"is {self.frame.units.to_user('length', d[bad]):.6g} "
                f"{self.frame.units.label('length')} long, {self.term.refuse(int(types[bad]), float(d[bad]))}"
            )
        if noted:
            acc.note(self.term.note(), noted)
        acc.energy += float(U.sum())
        if acc.energies is not None:
            _share2(i, j, U, acc.energies)
        return Bonds(i, j, r, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _share2(i, j, U, energies):
    for b in range(len(U)):
        energies[i[b]] += 0.5 * U[b]
        energies[j[b]] += 0.5 * U[b]


class HarmonicBond(BondStyle):
    """U = K (d − r0)² (LAMMPS's K: no ½). Coefficients K [energy/length²], r0 [length]. A bond of length 0 has no
    direction and no force."""

    name = "harmonic"
    wants = (("K", per_length2), ("r0", length))

    def add(self, types, d, U, G):
        return _harmonic(types, d, self.table, U, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonic(types, d, table, U, G):
    for b in range(len(d)):
        k, r0 = table[types[b], 0], table[types[b], 1]
        x = d[b] - r0
        U[b] = k * x * x
        # Where d = 0, G multiplies a zero vector; LAMMPS takes 0 as well.
        G[b] = 2.0 * k * x / d[b] if d[b] > 0.0 else 0.0
    return -1, 0


class MorseBond(BondStyle):
    """U = D [1 − exp(−α(d − r0))]². Coefficients D [energy], α [1/length], r0 [length]."""

    name = "morse"
    wants = (("D", energy), ("alpha", per_length), ("r0", length))

    def add(self, types, d, U, G):
        return _morse(types, d, self.table, U, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _morse(types, d, table, U, G):
    for b in range(len(d)):
        depth, alpha, r0 = table[types[b], 0], table[types[b], 1], table[types[b], 2]
        e = np.exp(-alpha * (d[b] - r0))
        U[b] = depth * (1.0 - e) * (1.0 - e)
        G[b] = 2.0 * depth * alpha * (1.0 - e) * e / d[b] if d[b] > 0.0 else 0.0
    return -1, 0


FENE_NOTE = "FENE bonds stretched beyond 0.949 R0, where LAMMPS caps the force"


def overstretched(d: float, longest: float, start: float = 0.0) -> str:
    """Why a bond that exists from `start` to that and `longest` has no energy."""
    if d <= start:
        return "where its repulsion is infinite: two bonded atoms are at the same place"
    return (
        f"{d / (longest + start):.4g} of the length at which it has infinite energy: the chain is broken or the "
        "topology is not this trajectory's"
    )


class FeneBond(BondStyle):
    """U = −½ K R0² ln[1 − (d/R0)²] + (4ε[(σ/d)¹² − (σ/d)⁶] + ε for d < 2^(1/6) σ). Coefficients K [energy/length²], R0
    [length], ε, σ.

    A bond of R0 or more is an error. From 0.949 R0 on LAMMPS caps the logarithm (with a warning); here the formula
    holds up to R0, and such bonds are counted in the notes.
    """

    name = "fene"
    wants = (("K", per_length2), ("R0", length), ("epsilon", energy), ("sigma", length))

    def check(self, t):
        return None if self.table[t, 1] > 0 else f"R0 must be positive, got {self.table[t, 1]}"

    def add(self, types, d, U, G):
        return _fene(types, d, self._columns(), U, G)

    def _columns(self):
        return np.ascontiguousarray(np.column_stack([self.table[:, :4], np.zeros(len(self.table))]))

    def refuse(self, t, d):
        return overstretched(d, self._columns()[t, 1], self._columns()[t, 4])

    def note(self):
        return FENE_NOTE


class FeneExpandBond(FeneBond):
    """FENE of d − Δ instead of d. Coefficients K, R0, ε, σ, Δ [length]."""

    name = "fene/expand"
    wants = (*FeneBond.wants, ("delta", length))

    def _columns(self):
        return self.table


@njit(cache=True, nogil=True, error_model="numpy")
def _fene(types, d, table, U, G):
    noted = 0
    for b in range(len(d)):
        t = types[b]
        k, r0, eps, sigma = table[t, 0], table[t, 1], table[t, 2], table[t, 3]
        x = d[b] - table[t, 4]
        q = 1.0 - (x / r0) ** 2
        if q <= 0.0 or d[b] == 0.0 or x == 0.0:
            return b, noted
        if q < _FENE_CAP:
            noted += 1
        U[b] = -0.5 * k * r0 * r0 * np.log(q)
        slope = k * x / q
        s2 = (sigma / x) ** 2
        # d < 2^(1/6) σ
        if 2.0 * s2 * s2 * s2 > 1.0:
            s6 = s2 * s2 * s2
            U[b] += 4.0 * eps * s6 * (s6 - 1.0) + eps
            slope -= 48.0 * eps * s6 * (s6 - 0.5) / x
        G[b] = slope / d[b]
    return -1, noted


class ZeroBond(BondStyle):
    """Bonds that exert no force (LAMMPS ``bond_style zero``); they only make neighbours for special_bonds."""

    name = "zero"

    def describe(self):
        return "bond zero"

    def prepare(self, frame):
        self.terms_of(frame)
        return Work()


class TableBond(BondStyle):
    """U(d) and −U'(d) interpolated in a LAMMPS bond table (``bond_style table linear|spline N``; with linear the two
    are interpolated each by itself).

    Parameters
    ----------
    tables : `Tables`, see `read_tables`. Beyond the ends of a table there is an error, as in LAMMPS.
    """

    name = "table"

    def __init__(self, tables: Tables):
        self.tables = tables
        self.units = tables.units
        self.covered = frozenset(tables.types)

    def add(self, types, d, U, G):
        bad = self.tables.lookup(types, d, U, G)
        if bad >= 0:
            return bad, 0
        # The table gives −U'.
        np.divide(-G, d, out=G, where=d > 0)
        return -1, 0

    def refuse(self, t, d):
        lo, hi = self.tables.range_of(t)
        return f"outside its table, which runs from {lo:.6g} to {hi:.6g}: the table must cover every length that occurs"


register_bonded(HarmonicBond, MorseBond, FeneBond, FeneExpandBond)


@bond_style("zero")
def _zero(inp):
    return ZeroBond._from_input(inp.by_type(lambda line: ()), inp)


@bond_style("table")
def _table(inp):
    return TableBond(build_tables(inp, "bond"))
