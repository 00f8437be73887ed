"""Lennard-Jones pair styles."""

from __future__ import annotations

import numpy as np
from numba import njit

from ..errors import AtcError
from ..units import units as get_units
from .pair import PairStyle
from .pair_input import as_matrix, mix_distance, mix_energy, pair_values
from .registry import StyleInput, pair_style


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


class LennardJones(LennardJonesCut):
    """Lennard-Jones with a cutoff, U = 4ε[(σ/d)¹² − (σ/d)⁶] for d < cutoff, from numbers in the user's units.

    Parameters
    ----------
    epsilon, sigma, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n
    units : unit style of these numbers
    shift : subtract U(cutoff), so that the energy has no step
    n_types : number of types that single numbers stand for (default 1)
    """

    def __init__(self, epsilon, sigma, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        u = get_units(units)
        n = max([n_types or 1] + [len(a) for a in (np.asarray(epsilon), np.asarray(sigma), np.asarray(cutoff)) if a.ndim])
        if not (np.all(np.asarray(cutoff, float) >= 0) and np.any(np.asarray(cutoff, float) > 0)):
            raise AtcError(f"LennardJones: the cutoff must be positive, got {cutoff}")
        super().__init__(
            as_matrix(epsilon, n, u.factor("energy")),
            as_matrix(sigma, n, u.factor("length")),
            as_matrix(cutoff, n, u.factor("length")),
            shift,
        )
        self.units = u


def _mix(a, b, rule):
    return mix_energy(a[0], b[0], a[1], b[1], rule), mix_distance(a[1], b[1], rule), mix_distance(a[2], b[2], rule)


@pair_style("lj/cut")
def _lj_cut_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("the cutoff", "length")])
    wants = [("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length")]
    return LennardJonesCut(*pair_values(inp, wants, optional=1, defaults=[rc], mix=_mix), shift=inp.modify.shift)


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
