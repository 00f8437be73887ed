"""β at four points at once: for each kernel family the constants of one bond, and the function of position.

A position is given relative to the bond, in units of its length: D along the bond from x_i, and (Y, M) across it, p² =
Y² + M². The constants are computed once a bond (and piece of the kernel) into the array `k`, which β gets by its
address: `length` is |r|, `R` the piece's cut-off, row `piece` of `c_mk` its coefficients with the normalisation
included. The formulas are derived at the head of `atc.kernels`.
"""

from __future__ import annotations

from math import erf, exp, sqrt

import numpy as np

from ..compiled import njit
from ..simd import (
    INLINE,
    JIT_FMA,
    exp2i4,
    load4,
    log2_ratio4,
    maximum4,
    minimum4,
    peek,
    poke,
    splat4,
    sqrt4,
    store4,
    where_zero4,
)

# Room for the constants of any family, and behind them for what is done one point at a time.
SCRATCH = 64
N_CONSTANTS = SCRATCH + 40


@njit(**JIT_FMA)
def even_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] / k[0]
    k[3] = c_mk[piece, 2] / (k[0] * k[0])


@njit(**INLINE)
def even(D, Y, M, k):
    """c0 + c1 w + c2 w² with w = 1 − ρ²/R²: step, Epanechnikov, quartic."""
    return even_mean(D, peek(k, 0) - M * M - Y * Y, peek(k, 1), peek(k, 2), peek(k, 3))


@njit(**INLINE)
def even_mean(D, w, c0, c1, c2):
    w = maximum4(w, 0.0)
    q = sqrt4(w)
    lo = maximum4(D - q, 0.0)
    hi = minimum4(D + q, 1.0)
    share = maximum4(hi - lo, 0.0)
    a = lo - D
    b = hi - D
    ab = a * b
    aabb = (a + b) * (a + b) - 2.0 * ab
    m2 = (aabb + ab) * (1.0 / 3.0)
    m4 = (aabb * aabb + ab * (aabb - ab)) * 0.2
    return share * (c0 + c1 * (w - m2) + c2 * (w * (w - 2.0 * m2) + m4))


@njit(**INLINE)
def _inverse_and_atanh(S, delta):
    """1/S and atanh(δ/S)/δ for 0 ≤ δ ≤ S, S > 0.

    atanh is ½ e ln 2 + atanh f, with 2^e the power of two near (S + δ)/(S − δ) and f what is left, |f| < 0.21. One
    division serves all three.
    """
    top = S + delta
    # (S − δ) ≥ 1e-17 S: closer than that p² has made the logarithm irrelevant.
    low = S - delta + S * 1e-17
    e = log2_ratio4(top, low)
    scaled = low * exp2i4(e)
    Q = top + scaled
    # Where e = 0, f = δ/S: divide by S, which is never 0.
    by = where_zero4(e, S, delta)
    inverse = 1.0 / (S * Q * by)
    inverse_S = inverse * Q * by
    f = where_zero4(e, 2.0 * delta, top - scaled) * (inverse * S * by)
    # atanh(f)/f: z^k/(2k+1) up to k = 11 leaves 0.21^24/25 = 2e-18. In pairs, so that the processor can overlap them.
    z = f * f
    z2 = z * z
    z4 = z2 * z2
    g = (z * (1.0 / 3.0) + 1.0) + z2 * (z * (1.0 / 7.0) + 1.0 / 5.0)
    g = g + z4 * ((z * (1.0 / 11.0) + 1.0 / 9.0) + z2 * (z * (1.0 / 15.0) + 1.0 / 13.0))
    g = g + z4 * z4 * ((z * (1.0 / 19.0) + 1.0 / 17.0) + z2 * (z * (1.0 / 23.0) + 1.0 / 21.0))
    return inverse_S, where_zero4(e, g, f * g + 0.34657359027997264 * e) * (inverse * S * Q)


@njit(**JIT_FMA)
def cone_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] * (length / R)


@njit(**INLINE)
def cone(D, Y, M, k):
    """c0 + c1 ρ/R: linear, hardy, tables."""
    return cone_mean(D, M * M + Y * Y, peek(k, 0), peek(k, 1), peek(k, 2))


@njit(**INLINE)
def cone_mean(D, p2, R2, c0, c1):
    q = sqrt4(maximum4(R2 - p2, 0.0))
    lo = maximum4(D - q, 0.0)
    hi = minimum4(D + q, 1.0)
    share = maximum4(hi - lo, 0.0)
    a = lo - D
    b = hi - D
    S = sqrt4(p2 + a * a) + sqrt4(p2 + b * b) + 1e-90
    inverse_S, atanh = _inverse_and_atanh(S, share)
    j1 = 0.25 * (S + (a + b) * (a + b) * inverse_S) + p2 * atanh
    return share * (c0 + c1 * j1)


@njit(**JIT_FMA)
def radial_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    s = length / R
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] * s
    k[3] = c_mk[piece, 2] * s * s
    k[4] = c_mk[piece, 3] * s * s * s
    k[5] = c_mk[piece, 4] * s * s * s * s


@njit(**INLINE)
def radial(D, Y, M, k):
    """Σ_k c_k (ρ/R)^k, k = 0..4 (`kernels.mean_powers`)."""
    return radial_mean(D, M * M + Y * Y, peek(k, 0), peek(k, 1), peek(k, 2), peek(k, 3), peek(k, 4), peek(k, 5))


@njit(**INLINE)
def radial_mean(D, p2, R2, c0, c1, c2, c3, c4):
    q = sqrt4(maximum4(R2 - p2, 0.0))
    lo = maximum4(D - q, 0.0)
    hi = minimum4(D + q, 1.0)
    share = maximum4(hi - lo, 0.0)
    a = lo - D
    b = hi - D
    ra = sqrt4(p2 + a * a)
    rb = sqrt4(p2 + b * b)
    S = ra + rb + 1e-90
    inverse_S, atanh = _inverse_and_atanh(S, share)
    T2 = (a + b) * (a + b) * inverse_S
    ab = a * b
    aabb = a * a + b * b
    rab = ra * rb
    m2 = (aabb + ab) * (1.0 / 3.0)
    m4 = (aabb * aabb + ab * (aabb - ab)) * 0.2
    j1 = 0.25 * (S + T2) + p2 * atanh
    j3 = 0.125 * (S * (S * S - 3.0 * rab) + T2 * (S * S - rab)) + 0.75 * p2 * j1
    return share * (c0 + c1 * j1 + c2 * (p2 + m2) + c3 * j3 + c4 * (p2 * (p2 + 2.0 * m2) + m4))


@njit(**INLINE)
def exp_minus(x):
    """exp(−x) for 0 ≤ x: 2^−n times a Taylor series of degree 13 on |t| ≤ ½ ln 2 (0.3466^14/14! = 4e-18)."""
    x = minimum4(x, 700.0)
    # To the nearest whole number by adding 1.5·2^52, where doubles have no fraction.
    n = (x * 1.4426950408889634 + 6755399441055744.0) - 6755399441055744.0
    t = n * 0.6931471803691238 - x + n * 1.9082149292705877e-10
    g = t * (1.0 / 6227020800.0) + 1.0 / 479001600.0
    g = g * t + 1.0 / 39916800.0
    g = g * t + 1.0 / 3628800.0
    g = g * t + 1.0 / 362880.0
    g = g * t + 1.0 / 40320.0
    g = g * t + 1.0 / 5040.0
    g = g * t + 1.0 / 720.0
    g = g * t + 1.0 / 120.0
    g = g * t + 1.0 / 24.0
    g = g * t + 1.0 / 6.0
    g = g * t + 0.5
    g = g * t + 1.0
    g = g * t + 1.0
    return g * exp2i4(-1.0 * n)


# Bonds longer than this times √2 w go by erf, shorter ones by a series (45 terms at most).
LONG = 3.0
_TERMS = 48


@njit(**JIT_FMA)
def gaussian_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    """c0 exp(−ρ²/2w²), w = c1, to a relative accuracy of c2 (1e-17 is exact). With y = s²(D − ½), s = |r|/√2 w, the
    mean over the bond is exp(−s²(D − ½)²) ∫ exp(−s²t²) cosh(2yt) dt over |t| < ½ = exp(..) Σ_j y^2j 4^j/(2j)! ∫ t^2j
    exp(−s²t²) dt: all terms are positive.
    """
    s = length / (sqrt(2.0) * c_mk[piece, 1])
    k[0] = s * s
    k[1] = c_mk[piece, 0]
    if s > LONG:
        k[2] = -1.0
        k[3] = 0.5 * sqrt(np.pi) / s
        k[4] = s
        return
    # The last term that matters: the series is that of cosh(z) at most, z = 2 y_max/2.
    z = s * (R / (sqrt(2.0) * c_mk[piece, 1]) + 0.5 * s)
    last = 1
    term = z * z / 2.0
    total = 1.0 + term
    while term > c_mk[piece, 2] * total and last < _TERMS:
        last += 1
        term *= z * z / (2.0 * last * (2.0 * last - 1.0))
        total += term
    k[2] = float(last)
    # ∫ t^2j exp(−s²t²) over |t| < ½: the highest by its own series, the others downwards, I_j = [s² I_j+1 + e^(−s²/4)
    # 2^−(2j+1)] 2/(2j+1).
    e = exp(-0.25 * s * s)
    half = 0.5 ** (2 * last + 1)
    integral = 0.0
    term = 2.0 * half * e / (2.0 * last + 1.0)
    j = last
    while term > 0.1 * c_mk[piece, 2] * integral:
        integral += term
        j += 1
        term *= 0.5 * s * s / (2.0 * j + 1.0)
    factor = 1.0
    for j in range(1, last + 1):
        factor *= 4.0 / (2.0 * j * (2.0 * j - 1.0))
    for j in range(last, -1, -1):
        k[4 + j] = integral * factor
        if j > 0:
            half *= 4.0
            integral = (s * s * integral + e * half) * 2.0 / (2.0 * j - 1.0)
            factor *= 2.0 * j * (2.0 * j - 1.0) / 4.0


@njit(**INLINE)
def gaussian(D, Y, M, k):
    p2 = M * M + Y * Y
    if peek(k, 2) > 0.0:
        c = D - 0.5
        y2 = (peek(k, 0) * c) * (peek(k, 0) * c)
        last = int(peek(k, 2))
        g = splat4(peek(k, 4 + last))
        for j in range(last - 1, -1, -1):
            g = g * y2 + peek(k, 4 + j)
        return peek(k, 1) * g * exp_minus(peek(k, 0) * (p2 + c * c))
    s = peek(k, 4)
    store4(k, SCRATCH, D)
    for l in range(4):
        d = peek(k, SCRATCH + l)
        poke(k, SCRATCH + l, erf(s * (1.0 - d)) + erf(s * d))
    return peek(k, 1) * peek(k, 3) * load4(k, SCRATCH) * exp_minus(peek(k, 0) * p2)


@njit(**JIT_FMA)
def cartesian_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    k[3] = length
    # One frame a bond, or a buffer with the frame of this bond.
    f = min(b, len(frame_bcc) - 1)
    for a in range(3):
        k[a] = r_bc[b, a]
        for c in range(3):
            k[4 + 3 * a + c] = frame_bcc[f, a, c]
    for j in range(c_mk.shape[1]):
        k[13 + j] = c_mk[piece, j]


@njit(**JIT_FMA)
def _cartesian(D, Y, M, k):
    """d = x_i − x along x, y, z, from the bond's frame, into k[SCRATCH:SCRATCH + 12]."""
    D = D * peek(k, 3)
    Y = Y * peek(k, 3)
    M = M * peek(k, 3)
    for c in range(3):
        store4(k, SCRATCH + 4 * c, D * peek(k, 4 + c) + Y * peek(k, 7 + c) + M * peek(k, 10 + c))


@njit(**JIT_FMA)
def _m4(v):
    v = abs(v)
    a = 2.0 - v if v < 2.0 else 0.0
    b = 1.0 - v if v < 1.0 else 0.0
    return (a * a * a - 4.0 * b * b * b) / 6.0


_GL5 = np.polynomial.legendre.leggauss(5)
_X5 = tuple(float(x) for x in 0.5 * (1.0 + _GL5[0]))
_W5 = tuple(float(x) for x in 0.5 * _GL5[1])

bspline_constants = cartesian_constants


@njit(**JIT_FMA)
def bspline(D, Y, M, k):
    """c0 Π M4(d_a/h), h = c1: between crossings of knot planes a polynomial of degree 9 along the bond, five Gauss
    points are exact."""
    times = k + 8 * (SCRATCH + 16)
    _cartesian(D, Y, M, k)
    for l in range(4):
        d0, d1, d2 = peek(k, SCRATCH + l), peek(k, SCRATCH + 4 + l), peek(k, SCRATCH + 8 + l)
        poke(k, SCRATCH + 12 + l, bspline_mean(d0, d1, d2, peek(k, 0), peek(k, 1), peek(k, 2), k + 8 * 13, times))
    return load4(k, SCRATCH + 12)


@njit(**JIT_FMA)
def bspline_mean(d0, d1, d2, r0, r1, r2, c_at, times):
    """At one point: d = x_i − x; room for 17 numbers at `times`."""
    h = peek(c_at, 1)
    poke(times, 0, 0.0)
    poke(times, 1, 1.0)
    count = 2
    for a in range(3):
        d = d0 if a == 0 else d1 if a == 1 else d2
        r = r0 if a == 0 else r1 if a == 1 else r2
        if r == 0.0:
            continue
        for knot in range(-2, 3):
            t = (d - knot * h) / r
            if 0.0 < t < 1.0:
                m = count
                while peek(times, m - 1) > t:
                    poke(times, m, peek(times, m - 1))
                    m -= 1
                poke(times, m, t)
                count += 1
    total = 0.0
    for m in range(count - 1):
        width = peek(times, m + 1) - peek(times, m)
        part = 0.0
        for q in range(5):
            t = peek(times, m) + _X5[q] * width
            part += _W5[q] * _m4((d0 - t * r0) / h) * _m4((d1 - t * r1) / h) * _m4((d2 - t * r2) / h)
        total += width * part
    return peek(c_at, 0) * total


box_constants = cartesian_constants


@njit(**JIT_FMA)
def box(D, Y, M, k):
    """c0 inside the half-open box of edges c1, c2, c3: the share of the bond between three pairs of planes."""
    _cartesian(D, Y, M, k)
    for l in range(4):
        d0, d1, d2 = peek(k, SCRATCH + l), peek(k, SCRATCH + 4 + l), peek(k, SCRATCH + 8 + l)
        poke(k, SCRATCH + 12 + l, box_mean(d0, d1, d2, peek(k, 0), peek(k, 1), peek(k, 2), k + 8 * 13))
    return load4(k, SCRATCH + 12)


@njit(**JIT_FMA)
def box_mean(d0, d1, d2, r0, r1, r2, c_at):
    """At one point: d = x_i − x."""
    lo = 0.0
    hi = 1.0
    for a in range(3):
        d = d0 if a == 0 else d1 if a == 1 else d2
        r = r0 if a == 0 else r1 if a == 1 else r2
        half = 0.5 * peek(c_at, 1 + a)
        if abs(r) > 2e-30 * half:
            t1 = (d - half) / r
            t2 = (d + half) / r
            lo = max(lo, min(t1, t2))
            hi = min(hi, max(t1, t2))
        elif not (-half <= d < half):
            lo = 2.0
    return peek(c_at, 0) * (hi - lo) if hi > lo else 0.0
