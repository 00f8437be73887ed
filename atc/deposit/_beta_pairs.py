"""β for four (bond, point) pairs at once, each of a bond of its own: nothing is computed once a bond (see `_beta` for
the other way).

A pair is given by D, the position along the bond from x_i, and p², the squared distance from its line, both in units of
its length, and by its squared length (lengths of the kernel); for kernels that are not spheres by d = x_i − x instead.
`R2` is the piece's squared cut-off, at `c_at` are its coefficients, at `bond_at` the numbers of the four bonds, at
`r_at` all bond vectors.
"""

from __future__ import annotations

from math import erf, factorial, sqrt

import numpy as np

from ..compiled import njit
from ..simd import INLINE, JIT_FMA, largest4, load4, minimum4, peek, peek_int, poke, splat4, sqrt4, store4
from ._beta import LONG, box_mean, bspline_mean, cone_mean, even_mean, exp_minus, radial_mean

# In `k`: the first four are β's (`_points.sum_pairs`); then what is done one pair at a time; then, for the Gaussian, s²
# of the last four pairs if they have one, s² that the J_j kept belong to, the last of these, and they. All −1 at first.
_LANES, _SEEN, _KEPT, _LAST, _J = 4, 56, 57, 58, 59


@njit(**INLINE)
def even_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    s2 = length2 * (1.0 / R2)
    return even_mean(D, R2 / length2 - p2, peek(c_at, 0), peek(c_at, 1) * s2, peek(c_at, 2) * s2 * s2)


@njit(**INLINE)
def cone_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    return cone_mean(D, p2, R2 / length2, peek(c_at, 0), peek(c_at, 1) * sqrt4(length2 * (1.0 / R2)))


@njit(**INLINE)
def radial_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    s2 = length2 * (1.0 / R2)
    s = sqrt4(s2)
    return radial_mean(
        D,
        p2,
        R2 / length2,
        peek(c_at, 0),
        peek(c_at, 1) * s,
        peek(c_at, 2) * s2,
        peek(c_at, 3) * s * s2,
        peek(c_at, 4) * s2 * s2,
    )


# The Gaussian's series goes so far at most; 1/(2j + 1)!, two more than that.
_TERMS = 60
_FACTORIALS = np.array([1.0 / factorial(2 * j + 1) for j in range(_TERMS + 4)])
# Steps of the tables in y and in s².
_STEP_Y, _STEP_S2 = 0.5, 0.5
N_CONSTANTS = _J + _TERMS + 4


def series_of(name, radii_m, coef_mk) -> np.ndarray:
    """What the β of a family needs besides its coefficients.

    For the Gaussian: 1/2w²; 1/(2j + 1)!; how many steps its two tables have; and the last term that matters, by y =
    s²|D − ½| and by s². With J_j as in `gaussian_pairs`, the terms beyond the last are to those before as those of
    cosh(2y t) at t = ½ at most; what is left out of J_0 is the product of what each step multiplies it with.
    """
    if name != "gaussian":
        return np.zeros(1)
    width, accuracy = coef_mk[0, 1], 0.1 * coef_mk[0, 2]
    farthest = LONG * (radii_m[0] / (sqrt(2.0) * width) + 0.5 * LONG)
    steps = int(farthest / _STEP_Y) + 2
    by_y, by_s2 = np.zeros(steps), np.zeros(int(LONG**2 / _STEP_S2) + 2)
    for table, last_of in (
        (by_y, lambda k: _last_by_y((k + 1) * _STEP_Y, accuracy)),
        (by_s2, lambda k: _last_by_s2((k + 1) * _STEP_S2, accuracy)),
    ):
        table[:] = [last_of(k) for k in range(len(table))]
    return np.concatenate([[0.5 / width**2], _FACTORIALS, [len(by_y), len(by_s2)], by_y, by_s2])


def _last_by_y(y, accuracy):
    last, term, total = 0, 1.0, 1.0
    while term > accuracy * total and last < _TERMS:
        last += 1
        term *= y * y / (2.0 * last * (2.0 * last - 1.0))
        total += term
    return last


def _last_by_s2(s2, accuracy):
    last, left = 0, 1.0
    while left > accuracy and last < _TERMS:
        last += 1
        left *= s2 * last / ((2.0 * last) * (2.0 * last + 1.0))
    return last


_N_FACTORIALS = len(_FACTORIALS)


@njit(**JIT_FMA)
def _last(y, s2, series_at):
    """The last term that matters for y and s² up to these."""
    at = 1 + _N_FACTORIALS
    n_y, n_s2 = int(peek(series_at, at)), int(peek(series_at, at + 1))
    at_y, at_s2 = min(int(y * (1.0 / _STEP_Y)), n_y - 1), min(int(s2 * (1.0 / _STEP_S2)), n_s2 - 1)
    return int(max(peek(series_at, at + 2 + at_y), peek(series_at, at + 2 + n_y + at_s2)))


@njit(**INLINE)
def gaussian_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    """c0 exp(−ρ²/2w²). With s² = |r|²/2w² and y = s²(D − ½) the mean over the bond is exp(−s²(p² + (D − ½)² + ¼)) Σ_j
    J_j y^2j, where J_j = 4^j/(2j)! ∫ t^2j exp(s²(¼ − t²)) dt over |t| < ½ = (j + 1) s² J_j+1 + 1/(2j + 1)!: downwards,
    in step with Horner's rule; all terms are positive. Long bonds go by erf.
    """
    s2 = length2 * peek(series_at, 0)
    c = D - 0.5
    beta = splat4(0.0)
    longest, shortest = largest4(s2), 0.0 - largest4(s2 * -1.0)
    limit = LONG * LONG
    if shortest <= limit:
        if longest > limit:
            # Those that are too long are done below.
            s2 = minimum4(s2, limit)
        y = s2 * c
        y2 = y * y
        shared = shortest == longest
        if shared and peek(k, _KEPT) == longest:
            # Many pairs of one bond: its J_j are known. Even and odd powers of y² apart, so that the processor can
            # overlap them.
            last, y4 = int(peek(k, _LAST)), y2 * y2
            even, odd = splat4(peek(k, _J + last - 1)), splat4(peek(k, _J + last))
            for j in range(last - 3, -1, -2):
                even = even * y4 + peek(k, _J + j)
                odd = odd * y4 + peek(k, _J + j + 1)
            g = even + odd * y2
        else:
            last = _last(sqrt(largest4(y2)), min(longest, limit), series_at)
            J, g = splat4(peek(series_at, 2 + last)), splat4(0.0)
            for j in range(last, -1, -1):
                J = (s2 * (j + 1.0)) * J + peek(series_at, 1 + j)
                g = g * y2 + J
            if shared and peek(k, _SEEN) == longest:
                # From the third four on.
                last = _last(0.5 * longest + sqrt(longest * R2 * peek(series_at, 0)), longest, series_at) | 1
                J1 = peek(series_at, 2 + last)
                for j in range(last, -1, -1):
                    J1 = (longest * (j + 1.0)) * J1 + peek(series_at, 1 + j)
                    poke(k, _J + j, J1)
                poke(k, _LAST, float(last))
                poke(k, _KEPT, longest)
            poke(k, _SEEN, longest if shared else -1.0)
        beta = peek(c_at, 0) * g * exp_minus(s2 * (p2 + c * c + 0.25))
    if longest > limit:
        s2 = length2 * peek(series_at, 0)
        across = exp_minus(s2 * p2)
        store4(k, _LANES, s2)
        store4(k, _LANES + 4, D)
        store4(k, _LANES + 8, across)
        store4(k, _LANES + 12, beta)
        for l in range(4):
            if peek(k, _LANES + l) > limit:
                s, d = sqrt(peek(k, _LANES + l)), peek(k, _LANES + 4 + l)
                mean = 0.8862269254527580 / s * (erf(s * (1.0 - d)) + erf(s * d))
                poke(k, _LANES + 12 + l, peek(c_at, 0) * mean * peek(k, _LANES + 8 + l))
        beta = load4(k, _LANES + 12)
    return beta


@njit(**JIT_FMA)
def _vectors(x, y, z, bond_at, r_at, k):
    """d and r of the four, side by side, into k."""
    store4(k, _LANES, x)
    store4(k, _LANES + 4, y)
    store4(k, _LANES + 8, z)
    for l in range(4):
        b = 3 * peek_int(bond_at, l)
        for c in range(3):
            poke(k, _LANES + 12 + 3 * l + c, peek(r_at, b + c))


@njit(**JIT_FMA)
def bspline_pairs(x, y, z, R2, c_at, series_at, bond_at, r_at, k):
    times = k + 8 * 32
    _vectors(x, y, z, bond_at, r_at, k)
    for l in range(4):
        r = _LANES + 12 + 3 * l
        d0, d1, d2 = peek(k, _LANES + l), peek(k, _LANES + 4 + l), peek(k, _LANES + 8 + l)
        poke(k, l, bspline_mean(d0, d1, d2, peek(k, r), peek(k, r + 1), peek(k, r + 2), c_at, times))
    return load4(k, 0)


@njit(**JIT_FMA)
def box_pairs(x, y, z, R2, c_at, series_at, bond_at, r_at, k):
    _vectors(x, y, z, bond_at, r_at, k)
    for l in range(4):
        r = _LANES + 12 + 3 * l
        d0, d1, d2 = peek(k, _LANES + l), peek(k, _LANES + 4 + l), peek(k, _LANES + 8 + l)
        poke(k, l, box_mean(d0, d1, d2, peek(k, r), peek(k, r + 1), peek(k, r + 2), c_at))
    return load4(k, 0)
