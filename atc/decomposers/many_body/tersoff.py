"""Tersoff's bond-order potential (LAMMPS ``pair_style tersoff``).

A frame is done in four stages: the half neighbour list; which pairs meet at which atom; around each atom, the energies
V_ij of its bonds with G of the arms into slots of their own (one for each end of a pair) and the outer distances as
bonds of their own; one bond a pair.
"""

from __future__ import annotations

from itertools import combinations, product
from types import MappingProxyType

import numpy as np

from ...errors import AtcError
from ...units import Units
from ..bonded.cluster import weights_of
from ..registry import pair_style
from .centred import Centred
from .elements import mapped_line
from .entries import OfEntries
from .tersoff_file import TersoffEntry
from .tersoff_kernels import SINE, TERSOFF, bond_orders, repulsion
from .twin_entries import agree, both, require_alike

#: Columns of the tables of pairs and of triplets, and those of a pair's repulsion that only some variants have.
TWO, _THREE, _CORE = 17, 11, [12, 13, 14, 15, 16]
_CENTER = ((1.0, 0.0), "bond-order energy V_ij to its center i")
_PAIR = {
    "pair": ((0.5, 0.5), "bond-order energy V_ij shared half to each of i and j"),
    "center": _CENTER,
    "centre": _CENTER,
}


def row(width, *values) -> np.ndarray:
    """(width,) the values, and zeros behind them."""
    out = np.zeros(width)
    out[: len(values)] = values
    return out


class Tersoff(Centred, OfEntries):
    """U = Σ_pairs f_C A exp(−λ1 d) − ½ Σ_{i≠j} f_C b_ij B exp(−λ2 d), b = (1 + βⁿ ζⁿ)^(−1/2n), ζ_ij = Σ_k f_C(d_ik)
    g(cos θ) exp[λ3^m (d_ij − d_ik)^m], g = γ [1 + c²/d² − c²/(d² + (cos θ0 − cos θ)²)], f_C = 1 below R − D, 0 above R
    + D, ½ − ½ sin(π (r − R)/2D) between.

    G of i–j, i–k and j–k follows from ∂ζ/∂ξ through cos θ and the two distances (formulas §2); every function and its
    slope vanish at R + D. Limits of b for small and large ζ are LAMMPS's.

    Parameters
    ----------
    entries : {(elem1, elem2, elem3): TersoffEntry or dict of its fields}, elem1 at the centre; lengths and energies in
        `units`
    elements : the element of each atom type from 1, None or "NULL" for types left out; default: all atoms are the first
        entry's element
    units : the default has eV and Å
    partition : how V_ij = ½ f_C b_ij f_A, which depends on the neighbours of i, is shared: "pair" (half to i, half to
        j, as LAMMPS), "center" (all to
        i), or two numbers that add up to 1. Atoms k that only weaken the bond have no share. Repulsion: half to each.
        Stress and total energy do not depend on it; heat flux and churning do.
    shift : δ: every distance d in the formulas (not in the angles) is replaced by d + δ (LAMMPS's ``shift``), in
        `units`

    Notes
    -----
    Source: Tersoff, Phys. Rev. B 37, 6991 (1988); 39, 5566 (1989). Parameter files: `from_file`.
    """

    part_name = "tersoff"
    partitions = MappingProxyType({"equal": "pair", "center": "center"})
    #: What a variant of the family changes: its name, the entries of its files, and the kernels' choice of cutoff,
    #: angular function and b(ζ).
    style, word = "tersoff", "Tersoff"
    entry = TersoffEntry
    form = (SINE, TERSOFF, TERSOFF)
    pair = repulsion

    def __init__(
        self, entries: dict, elements=None, *, units: str | Units = "metal", partition="pair", shift: float = 0.0
    ):
        entries, names = self.take(entries, elements, units)
        self.share(partition)
        m = len(names)
        self.shift = float(self.units.to_internal("length", shift))
        self.two = np.zeros((m, m, TWO))
        self.three = np.zeros((m, m, m, _THREE))
        for (i, a), (j, b), (k, c) in product(enumerate(names), repeat=3):
            e = entries[a, b, c]
            self.three[i, j, k] = self.around(e)
            if j == k:
                if not e.n > 0 and e.beta > 0 and e.B > 0:
                    raise AtcError(f"{e.where}: n must be positive in the entry {a} {b} {b}, got {e.n:g}")
                self.two[i, j] = self.between(e)
        self._symmetric(entries, names)
        self.cutoff = float((self.three[..., 0] + self.three[..., 1]).max())
        if not self.cutoff > 0:
            raise AtcError(f"{self.style}: every cutoff R + D is 0")
        # A negative δ lets pairs act from farther away.
        self.cutoff += max(0.0, -self.shift)

    def around(self, e) -> np.ndarray:
        """The row of `three` of an entry, in internal units: R, D, λ3, m, and the angular function's numbers."""
        L, top = self.units.length, 1.0 + e.c**2 / e.d**2 if e.c else 1.0
        return row(_THREE, e.R * L, e.D * L, e.lam3 / L, e.m, e.gamma, e.c**2, e.d**2, e.costheta0, top)

    def between(self, e) -> np.ndarray:
        """The row of `two` of an entry: R, D, A, λ1, B, λ2, and what b(ζ) needs; behind them c0, and strength, length,
        r_C, A_F of a ZBL core."""
        E, L = self.units.energy, self.units.length
        c1, c2 = (
            ((2.0 * e.n * 1e-16) ** (-1.0 / e.n), (2.0 * e.n * 1e-8) ** (-1.0 / e.n)) if e.n > 0 else (np.inf, np.inf)
        )
        U = e.R * L, e.D * L, e.A * E, e.lam1 / L, e.B * E, e.lam2 / L
        return row(TWO, *U, e.beta, e.n, c1, c2, 1.0 / c2, 1.0 / c1)

    def _symmetric(self, entries, names):
        """The repulsion of a pair, which LAMMPS takes from one of two entries by the numbering of the atoms, must be
        the same in both."""
        unit = self.units.label("energy")
        for (i, a), (j, b) in combinations(enumerate(names), 2):
            twins, x, y = (entries, (a, b, b), (b, a, a)), self.two[i, j], self.two[j, i]
            what = f"{both(*twins)}: the repulsion of {a} and {b} in both entries"
            alike = agree(x[:4], y[:4], what, self._repulsive, unit)
            one = "the repulsion of one pair, of which LAMMPS takes one by the atoms' numbers"
            require_alike(*twins, alike, f"R, D, A or lambda1 for {one}")
            alike = np.allclose(x[_CORE], y[_CORE], rtol=1e-5, atol=0)
            require_alike(*twins, alike, f"c0 or ZBL numbers for {one}")
        mean = np.ascontiguousarray(0.5 * (self.two + self.two.transpose(1, 0, 2))[..., [0, 1, 2, 3, *_CORE]])
        self.of_pair = self.form[0], self.shift, mean

    def _repulsive(self, row):
        """f_C A exp(−λ1 d) in the user's energy unit at distances from three quarters of the cutoff on, where bonds
        are."""
        R, D, A, lam1 = row[:4]
        d = np.linspace(0.75 * (R - D), R + D, 200)
        switch = np.where(
            d < R - D, 1.0, 0.5 - 0.5 * np.sin(0.5 * np.pi * np.clip((d - R) / D if D > 0 else 0.0 * d, -1, 1))
        )
        return self.units.to_user("energy", switch * A * np.exp(-lam1 * d))

    def share(self, partition):
        if isinstance(partition, str) and partition == "equal":
            raise AtcError(
                f"{self.style}: partition 'equal': a bond-order term has as many atoms as its bond has neighbours; "
                "use 'pair', 'center' or two numbers"
            )
        self.weights, self.shared = weights_of(partition, 2, _PAIR, self.style)

    def describe(self) -> str:
        return (
            f"{self.style}{self.map.describe()}, {self.shared}, repulsion half to each atom; one merged bond a pair, "
            "outer j-k bonds apart"
        )

    def centres(self, s0, s1, most, near, *out):
        return bond_orders(self.form, self.shift, s0, s1, most, near, self.two, self.three, self.weights, *out)


def bond_order_style(inp, kind, ending):
    """A member of the family from its ``pair_style NAME [shift δ]`` and its one ``pair_coeff * *`` line."""
    shift = 0.0
    if inp.args:
        if len(inp.args) != 2 or inp.args[0] != "shift":
            raise inp.error(f"{inp.command}: expected nothing or shift and a distance, got {' '.join(inp.args)!r}")
        shift = inp.number(inp.args[1], 1.0, "shift")
    path, elements, line = mapped_line(inp.replace(args=()), ending)
    return kind.from_file(path, elements, units=inp.units, shift=shift, where=line.where)


@pair_style("tersoff", mapped=True)
def _tersoff(inp):
    return bond_order_style(inp, Tersoff, ".tersoff")
