"""Bonds of the topology: U(d) between the closest images of two bonded atoms, half of it to each."""

from __future__ import annotations

import numpy as np

from ..base import Accumulator
from .cluster import first_not_finite
from .table import Tables, build_tables
from .topology import BondedTerm, Idle, energy, length, per_length, per_length2

# LAMMPS stops evaluating the logarithm of FENE here (it warns, and uses this value), which is at 0.949 R0.
_FENE_CAP = 0.1


class BondStyle(BondedTerm):
    """Base of the bond styles. Subclasses implement `curve`, or `energies`."""

    kind = "bond"
    bodies = 2
    weights = np.array([0.5, 0.5])
    pairwise = True
    #: what the bonds that `count` counts are, for the notes
    noted = ""

    def curve(self, d, *columns):
        """U and dU/dd of bonds of lengths d, all (b,); `columns` are the coefficients of each bond. NaN where the bond
        has no energy."""
        raise NotImplementedError

    def energies(self, types, d):
        """The same of bonds of these types."""
        return self.curve(d, *self.columns(types))

    def count(self, types, d) -> int:
        """How many bonds are worth the note."""
        return 0

    def refuse(self, t: int, d: float) -> str:
        """Why a bond of type t and length d has no energy, and what to do."""
        return "where its energy is not a finite number"

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        d = lengths(x_tkc)
        with np.errstate(all="ignore"):  # said by `complaint`
            U[:], slope = self.energies(types, d)
        G[:, 0] = over_length(slope, d)
        acc.note(self.noted, self.count(types, d))
        return first_not_finite(U, G)

    def complaint(self, frame, atoms_k, kind, x_kc):
        (a, b), (d,) = frame.ids[atoms_k], lengths(x_kc[None])
        return (
            f"the bond between atoms {a} and {b} (type {kind}, style {self.name}) is "
            f"{frame.units.to_user('length', d):.6g} {frame.units.label('length')} long, {self.refuse(kind, float(d))}"
        )

    def describe(self) -> str:
        return f"bond {self.name}, energy shared half to each atom"


def lengths(x_tkc) -> np.ndarray:
    """(t,) distances of the first and the last atom."""
    x, y, z = (x_tkc[:, -1, k] - x_tkc[:, 0, k] for k in range(3))
    return np.sqrt(x * x + y * y + z * z)


def over_length(slope, d):
    """G = U'/d; a bond of length 0 has no direction: G multiplies a zero vector."""
    return np.divide(slope, d, out=np.zeros_like(d), where=d != 0.0)


class HarmonicBond(BondStyle):
    """U = K (d − r0)² (LAMMPS's K: no ½). Coefficients K [energy/length²], r0 [length]. A bond of length 0 has no
    direction and no force."""

    name = "harmonic"
    wants = (("K", per_length2), ("r0", length))

    def curve(self, d, K, r0):
        x = d - r0
        return K * x * x, 2.0 * K * x


class MorseBond(BondStyle):
    """U = D [1 − exp(−α(d − r0))]². Coefficients D [energy], α [1/length], r0 [length]."""

    name = "morse"
    wants = (("D", energy), ("alpha", per_length), ("r0", length))

    def curve(self, d, depth, alpha, r0):
        e = np.exp(-alpha * (d - r0))
        return depth * (1.0 - e) * (1.0 - e), 2.0 * depth * alpha * (1.0 - e) * e


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
    noted = "FENE bonds stretched beyond 0.949 R0, where LAMMPS caps the force"

    def row(self, K, R0, epsilon, sigma, delta=0.0):
        if not R0 > 0:
            raise ValueError(f"R0 must be positive, got {R0}")
        return K, R0, epsilon, sigma, delta

    def curve(self, d, K, R0, epsilon, sigma, delta):
        x = d - delta
        q = 1.0 - (x / R0) ** 2
        x = np.where((q > 0.0) & (d != 0.0) & (x != 0.0), x, np.nan)
        s2 = (sigma / x) ** 2
        s6 = s2 * s2 * s2
        core = np.where(2.0 * s6 > 1.0, epsilon, 0.0)  # d < 2^(1/6) σ
        U = -0.5 * K * R0 * R0 * np.log(q) + (4.0 * core * s6 * (s6 - 1.0) + core)
        return U, K * x / q - 48.0 * core * s6 * (s6 - 0.5) / x

    def count(self, types, d):
        return np.count_nonzero(1.0 - ((d - self.table[types, 4]) / self.table[types, 1]) ** 2 < _FENE_CAP)

    def refuse(self, t, d):
        return overstretched(d, self.table[t, 1], self.table[t, 4])


class FeneExpandBond(FeneBond):
    """FENE of d − Δ instead of d. Coefficients K, R0, ε, σ, Δ [length]."""

    name = "fene/expand"
    wants = (*FeneBond.wants, ("delta", length))


class ZeroBond(Idle, BondStyle):
    """Bonds that exert no force (LAMMPS ``bond_style zero``)."""

    at_rest = (("r0", length),)


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

    @classmethod
    def build(cls, inp):
        return cls(build_tables(inp))

    def energies(self, types, d):
        U, F = self.tables.lookup(types, d)
        return U, -F

    def refuse(self, t, d):
        lo, hi = self.tables.range_of(t)
        return f"outside its table, which runs from {lo:.6g} to {hi:.6g}: the table must cover every length that occurs"
