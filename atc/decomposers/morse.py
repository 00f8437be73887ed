"""Morse pair style."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import pair_values
from .registry import StyleInput, pair_style


class Morse(PairStyle):
    """U = D₀[e^{−2α(d − r₀)} − 2 e^{−α(d − r₀)}] − offset for d < cutoff (LAMMPS ``morse``).

    Parameters
    ----------
    d0, alpha, r0, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0 = no interaction
    units : unit style of these numbers (alpha: 1/length)
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "morse"
    numbers = (("d0", "energy"), ("alpha", {"length": -1}), ("r0", "length"), ("cutoff", "length"))

    def __init__(self, d0, alpha, r0, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((d0, alpha, r0, cutoff), units, n_types, shift)

    def fill(self, d0, alpha, r0, cutoff, shift):
        x = np.exp(-alpha * (cutoff - r0))
        self._set(cutoff, d0, alpha, r0, d0 * (x * x - 2 * x) if shift else np.zeros_like(d0))

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _morse(types, i, j, d2, weights, self.table, U, G)


@pair_style("morse")
def _morse_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    return Morse.internal(*pair_values(inp, Morse.numbers, optional=1, defaults=[rc]), shift=inp.modify.shift)


@njit(cache=True, nogil=True, error_model="numpy")
def _morse(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            d0, alpha = table[ti, tj, 1], table[ti, tj, 2]
            x = np.exp(-alpha * (d - table[ti, tj, 3]))
            U[b] += w * (d0 * (x * x - 2.0 * x) - table[ti, tj, 4])
            G[b] -= w * (2.0 * d0 * alpha * (x * x - x) / d)
