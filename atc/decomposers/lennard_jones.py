"""Lennard-Jones pair styles."""

from __future__ import annotations

import numpy as np
from numba import njit

from .pair import PairStyle


class LennardJonesCut(PairStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] − offset for d < r_c (LAMMPS ``lj/cut``; offset = U(r_c) with ``pair_modify shift yes``, else 0).

    Parameters
    ----------
    epsilon, sigma, cutoff : (n_types + 1, n_types + 1) arrays in internal units, indexed by type from 1; cutoff 0 = no interaction
    shift : bool
    """

    name = "lj/cut"

    def __init__(self, epsilon, sigma, cutoff, shift: bool = False):
        epsilon, sigma, cutoff = (np.asarray(a, float) for a in (epsilon, sigma, cutoff))
        offset = np.zeros_like(epsilon)
        if shift:
            on = cutoff > 0
            s6 = (sigma[on] / cutoff[on]) ** 6
            offset[on] = 4 * epsilon[on] * (s6 * s6 - s6)
        self.table = np.ascontiguousarray(np.stack([cutoff**2, 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, offset], axis=-1))

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _lj_cut(types, i, j, d2, _ONES if weights is None else weights, self.table, U, G)


_ONES = np.zeros(0)


@njit(cache=True, nogil=True, error_model="numpy")
def _lj_cut(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            s2 = 1.0 / d2[b]
            s6 = s2 * s2 * s2
            a = table[ti, tj, 1] * s6 * s6
            c = table[ti, tj, 2] * s6
            U[b] += w * (a - c - table[ti, tj, 3])
            G[b] -= w * (12.0 * a - 6.0 * c) * s2
