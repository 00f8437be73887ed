"""Soft pair style: a cosine bump without a singularity."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import mix_distance, mix_energy, pair_values
from .registry import StyleInput, pair_style


class Soft(PairStyle):
    """U = A[1 + cos(πd/r_c)] for d < cutoff r_c (LAMMPS ``soft``).

    Parameters
    ----------
    A, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0 = no
        interaction
    units : unit style of these numbers
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "soft"
    numbers = (("A", "energy"), ("cutoff", "length"))

    def __init__(self, A, cutoff, *, units, n_types: int | None = None):
        self._take((A, cutoff), units, n_types, False)

    def fill(self, A, cutoff, shift):
        self._set(cutoff, A, np.pi / np.where(cutoff > 0, cutoff, np.inf))

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _soft(types, i, j, d2, weights, self.table, U, G)


def _mix(a, b, rule):
    # As LAMMPS does it, also under sixthpower: the prefactor's mean is geometric (there is no sigma).
    return mix_energy(a[0], b[0], 1.0, 1.0, rule), mix_distance(a[1], b[1], rule)


@pair_style("soft")
def _soft_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    return Soft.internal(*pair_values(inp, Soft.numbers, optional=1, defaults=[rc], mix=_mix))


@njit(cache=True, nogil=True, error_model="numpy")
def _soft(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            A, k = table[ti, tj, 1], table[ti, tj, 2]
            U[b] += w * A * (1.0 + np.cos(k * d))
            # sin(kd)/d has the limit k: coincident atoms feel no force.
            G[b] -= w * A * k * (np.sin(k * d) / d if d > 0.0 else k)
