"""Lennard-Jones pair styles: cut, shifted in force, expanded, and with a quadratic term that makes energy and force
vanish at the cutoff."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import mix_distance, mix_energy, pair_values
from .registry import StyleInput, pair_style

_NUMBERS = (("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length"))


def _with_cutoff(value, cutoff):
    """`value` where there is an interaction, else 0: keeps divisions by an absent cutoff out."""
    return np.where(cutoff > 0, value, 0.0)


class LennardJones(PairStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] − offset for d < cutoff (LAMMPS ``lj/cut``).

    Parameters
    ----------
    epsilon, sigma, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n;
        cutoff 0 = no interaction
    units : unit style of these numbers
    shift : whether offset = U(cutoff), so that the energy has no step (``pair_modify shift yes``); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "lj/cut"
    numbers = _NUMBERS

    def __init__(self, epsilon, sigma, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((epsilon, sigma, cutoff), units, n_types, shift)

    def fill(self, epsilon, sigma, cutoff, shift):
        offset = np.zeros_like(epsilon)
        if shift:
            s6 = (sigma / np.where(cutoff > 0, cutoff, np.inf)) ** 6
            offset = 4 * epsilon * (s6 * s6 - s6)
        self._set(cutoff, 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, offset)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        if self.n_types == 1 and len(weights) == 0:
            _lj_cut_one(d2, *self.table[1, 1], U, G)
        else:
            _lj_cut(types, i, j, d2, weights, self.table, U, G)


class LennardJonesSmoothLinear(PairStyle):
    """Lennard-Jones minus its value and slope at the cutoff: U = u(d) − u(r_c) − (d − r_c) u'(r_c) (LAMMPS
    ``lj/smooth/linear``).

    Parameters as for `LennardJones`, without `shift`.
    """

    name = "lj/smooth/linear"
    numbers = _NUMBERS

    def __init__(self, epsilon, sigma, cutoff, *, units, n_types: int | None = None):
        self._take((epsilon, sigma, cutoff), units, n_types, False)

    def fill(self, epsilon, sigma, cutoff, shift):
        a, c = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6
        s6 = 1.0 / np.where(cutoff > 0, cutoff, np.inf) ** 6
        slope = -(12 * a * s6 * s6 - 6 * c * s6) / np.where(cutoff > 0, cutoff, np.inf)
        self._set(cutoff, a, c, a * s6 * s6 - c * s6, slope, cutoff)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _lj_smooth_linear(types, i, j, d2, weights, self.table, U, G)


class LennardJonesQuadratic(PairStyle):
    """Lennard-Jones plus a quadratic term: U = 4ε[(σ/d)¹² − (σ/d)⁶] + A d² + B for d < cutoff, with A and B such that U
    and U' vanish there.

    What continuum-stress codes use as "Lennard-Jones with quadratic smoothing": A = −u'(r_c)/(2 r_c), B = −u(r_c) − A
    r_c². Parameters as for `LennardJones`, without `shift`.
    """

    name = "lj/quadratic"
    numbers = _NUMBERS

    def __init__(self, epsilon, sigma, cutoff, *, units, n_types: int | None = None):
        self._take((epsilon, sigma, cutoff), units, n_types, False)

    def fill(self, epsilon, sigma, cutoff, shift):
        a, c = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6
        s2 = 1.0 / np.where(cutoff > 0, cutoff, np.inf) ** 2
        s6 = s2**3
        A = 0.5 * (12 * a * s6 * s6 - 6 * c * s6) * s2
        self._set(cutoff, a, c, A, -(a * s6 * s6 - c * s6) - A * cutoff**2)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _lj_quadratic(types, i, j, d2, weights, self.table, U, G)


class LennardJonesExpand(PairStyle):
    """Lennard-Jones of d − Δ for d < cutoff + Δ (LAMMPS ``lj/expand``).

    Parameters as for `LennardJones`, with `delta`, the shift of the distance, before the cutoff. With `shift`, LAMMPS
    subtracts the unexpanded Lennard-Jones at cutoff + Δ (not the value at the cutoff); so does this class.
    """

    name = "lj/expand"
    numbers = (*_NUMBERS[:2], ("delta", "length"), _NUMBERS[2])

    def __init__(self, epsilon, sigma, delta, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((epsilon, sigma, delta, cutoff), units, n_types, shift)

    def fill(self, epsilon, sigma, delta, cutoff, shift):
        offset = np.zeros_like(epsilon)
        if shift:
            s6 = (sigma / np.where(cutoff > 0, cutoff + delta, np.inf)) ** 6
            offset = 4 * epsilon * (s6 * s6 - s6)
        self._set(
            np.where(cutoff > 0, cutoff + delta, 0.0), 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, offset, delta
        )

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _lj_expand(types, i, j, d2, weights, self.table, U, G)


def mix_lj(a, b, rule):
    """LAMMPS's mixing of (epsilon, sigma, ..., cutoff): what lies between sigma and the cutoff is averaged."""
    between = tuple(0.5 * (x + y) for x, y in zip(a[2:-1], b[2:-1], strict=True))
    return (
        mix_energy(a[0], b[0], a[1], b[1], rule),
        mix_distance(a[1], b[1], rule),
        *between,
        mix_distance(a[-1], b[-1], rule),
    )


def _builder(cls):
    def build(inp: StyleInput):
        (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
        return cls.internal(
            *pair_values(inp, cls.numbers, optional=1, defaults=[rc], mix=mix_lj), shift=inp.modify.shift
        )

    return build


for _cls in (LennardJones, LennardJonesSmoothLinear, LennardJonesExpand):
    pair_style(_cls.name)(_builder(_cls))
# Its old name in LAMMPS.
pair_style("lj/sf")(_builder(LennardJonesSmoothLinear))


@njit(cache=True, nogil=True, error_model="numpy")
def _lj_cut_one(d2, cut2, a12, a6, offset, U, G):
    """One type, no weights, every pair of the list within the cutoff or masked: no gathers, so that it runs in SIMD."""
    for b in range(len(d2)):
        on = 1.0 if d2[b] < cut2 else 0.0
        s2 = 1.0 / d2[b]
        s6 = s2 * s2 * s2
        a = a12 * s6 * s6
        c = a6 * s6
        U[b] += on * (a - c - offset)
        G[b] -= on * ((12.0 * a - 6.0 * c) * s2)


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


@njit(cache=True, nogil=True, error_model="numpy")
def _lj_smooth_linear(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            s2 = 1.0 / d2[b]
            d = np.sqrt(d2[b])
            s6 = s2 * s2 * s2
            a = table[ti, tj, 1] * s6 * s6
            c = table[ti, tj, 2] * s6
            slope = table[ti, tj, 4]
            U[b] += w * (a - c - table[ti, tj, 3] - slope * (d - table[ti, tj, 5]))
            G[b] -= w * ((12.0 * a - 6.0 * c) * s2 + slope / d)


@njit(cache=True, nogil=True, error_model="numpy")
def _lj_quadratic(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            s2 = 1.0 / d2[b]
            s6 = s2 * s2 * s2
            a = table[ti, tj, 1] * s6 * s6
            c = table[ti, tj, 2] * s6
            A = table[ti, tj, 3]
            U[b] += w * (a - c + A * d2[b] + table[ti, tj, 4])
            G[b] -= w * ((12.0 * a - 6.0 * c) * s2 - 2.0 * A)


@njit(cache=True, nogil=True, error_model="numpy")
def _lj_expand(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            s = 1.0 / (d - table[ti, tj, 4])
            s2 = s * s
            s6 = s2 * s2 * s2
            a = table[ti, tj, 1] * s6 * s6
            c = table[ti, tj, 2] * s6
            U[b] += w * (a - c - table[ti, tj, 3])
            G[b] -= w * (12.0 * a - 6.0 * c) * s / d
