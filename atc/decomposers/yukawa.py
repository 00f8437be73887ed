"""Yukawa pair style."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import mix_distance, mix_energy, pair_values
from .registry import StyleInput, pair_style


class Yukawa(PairStyle):
    """U = A e^{−κd}/d − offset for d < cutoff (LAMMPS ``yukawa``).

    Parameters
    ----------
    A, kappa, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0 =
        no interaction
    units : unit style of these numbers (A: energy·length, kappa: 1/length)
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "yukawa"
    numbers = (("A", {"energy": 1, "length": 1}), ("kappa", {"length": -1}), ("cutoff", "length"))

    def __init__(self, A, kappa, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((A, kappa, cutoff), units, n_types, shift)

    def fill(self, A, kappa, cutoff, shift):
        offset = A * np.exp(-kappa * cutoff) / np.where(cutoff > 0, cutoff, np.inf) if shift else np.zeros_like(A)
        self._set(cutoff, A, kappa, offset)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _yukawa(types, i, j, d2, weights, self.table, U, G)


def _mix(a, b, rule):
    return mix_energy(a[0], b[0], 1.0, 1.0, rule), mix_distance(a[1], b[1], rule)


@pair_style("yukawa")
def _yukawa_style(inp: StyleInput):
    kappa, rc = inp.numbers(inp.args, [("kappa", {"length": -1}), ("cutoff", "length")])
    A, cutoff = pair_values(inp, (Yukawa.numbers[0], Yukawa.numbers[2]), optional=1, defaults=[rc], mix=_mix)
    return Yukawa.internal(A, np.full_like(A, kappa), cutoff, shift=inp.modify.shift)


@njit(cache=True, nogil=True, error_model="numpy")
def _yukawa(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            s = 1.0 / d
            kappa = table[ti, tj, 2]
            u = table[ti, tj, 1] * np.exp(-kappa * d) * s
            U[b] += w * (u - table[ti, tj, 3])
            G[b] -= w * u * (kappa + s) * s
