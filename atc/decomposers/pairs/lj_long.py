"""Lennard-Jones whose dispersion has no cutoff: the bonds of its split, for LAMMPS's ``lj/long/coul/long long …``.

The smooth part is a term of its own, which ``kspace_style ewald/disp`` asks for: see `long_range.dispersion`.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ..long_range.dispersion import DispersionSplit
from ..registry import StyleInput
from .lennard_jones import mix_lj
from .pairs import PairStyle

#: How far C_ij of a pair_coeff line may be from what the mixing rule says: digits of a script.
MIXED = 1e-6


class LennardJonesLong(PairStyle):
    """U = w A/d¹² − C [e^{−b²}(1 + b² + b⁴/2) − (1 − w)]/d⁶, b = αd, w the pair's weight.

    A pair of weight w < 1 loses 1 − w of its whole dispersion, the smooth part's share included, if it is within the
    script's cutoff.

    Parameters
    ----------
    A, C, reach : (n_types + 1, n_types + 1), internal units; the script's cutoffs, 0: no repulsion
    split : DispersionSplit
    """

    name = "lj/long"
    keeps_excluded = True

    def __init__(self, A, C, reach, split: DispersionSplit):
        self.A, self.C, self.reach, self.split = A, C, reach, split
        self._set(np.where(reach > 0, np.maximum(reach, split.cutoff), 0.0), A, C, reach**2)

    def at(self, accuracy: float, alpha: float | None = None) -> LennardJonesLong:
        """The same with another accuracy."""
        new = LennardJonesLong(self.A, self.C, self.reach, self.split.at(accuracy))
        new.own_special = self.own_special
        return new

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _long(types, i, j, d2, weights, self.table, self.split.cutoff**2, self.split.alpha, U, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _long(types, i, j, d2, weights, table, near2, alpha, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        row = table[types[i[b]], types[j[b]]]
        if d2[b] >= row[0]:
            continue
        w = weights[b] if weighted else 1.0
        s2 = 1.0 / d2[b]
        s6 = s2 * s2 * s2
        c = row[2] * s6
        if d2[b] < row[3]:
            a = w * row[1] * s6 * s6
            U[b] += a + (1.0 - w) * c
            G[b] -= (12.0 * a + 6.0 * (1.0 - w) * c) * s2
        if d2[b] < near2:
            x = alpha * alpha * d2[b]
            c *= np.exp(-x)
            U[b] -= c * (1.0 + x + 0.5 * x * x)
            G[b] += c * (6.0 + 6.0 * x + 3.0 * x * x + x * x * x) * s2


def long_dispersion(inp: StyleInput, epsilon, sigma, cutoff) -> LennardJonesLong:
    """The style of a ``pair_style … long …`` line from its coefficients."""
    if inp.wanted is not None and not inp.wanted[1:, 1:].all():
        raise inp.error(f"{inp.command}: long-range dispersion must act between all types of atoms")
    if inp.modify.shift:
        raise inp.error(f"{inp.command} long: pair_modify shift yes has no meaning for dispersion without a cutoff")
    rule = inp.modify.mix or "geometric"
    C = 4.0 * epsilon * sigma**6
    for i in range(1, len(C)):
        for j in range(i + 1, len(C)):
            e, s, *_ = mix_lj(*((epsilon[k, k], sigma[k, k], cutoff[k, k]) for k in (i, j)), rule)
            if not abs(C[i, j] - 4.0 * e * s**6) <= MIXED * abs(C[i, j]):
                raise inp.error(
                    f"{inp.command} long: the dispersion of types {i} and {j} is not the {rule} mean of those of each "
                    "with itself, which the run's sum over modes takes: leave out their pair_coeff line"
                )
    if len({*cutoff[1:, 1:].ravel()}) > 1:
        raise inp.error(f"{inp.command} long: expected one Lennard-Jones cutoff for all types")
    split = DispersionSplit.of(float(cutoff[1, 1]))
    return LennardJonesLong(4.0 * epsilon * sigma**12, C, cutoff, split)
