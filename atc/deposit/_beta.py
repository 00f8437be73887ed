"""β of many points at once, from buffers: one function per kernel family, all with the same arguments.

Isotropic families get, for every point, its coordinates relative to the bond in units of the bond's length: D along the bond from x_i,
and (Y, M) across it, p² = Y² + M². `length` is |r|, `R` the piece's cut-off, row `piece` of `c_mk` its coefficients with the normalisation included.
The other families get the components of d = x_i − x in D, Y, M and the bond vector (r0, r1, r2).
"""

from __future__ import annotations

from math import erf, exp, sqrt

import numba as nb
import numpy as np

from ._simd import JIT_FMA, bits, from_bits

_GL8 = np.polynomial.legendre.leggauss(8)
_T0, _T1, _T2, _T3 = (float(t) for t in 0.5 * (1.0 + _GL8[0][:4]))
_T4, _T5, _T6, _T7 = (float(t) for t in 0.5 * (1.0 + _GL8[0][4:]))
_W0, _W1, _W2, _W3 = (float(w) for w in 0.5 * _GL8[1][:4])
_GL5 = np.polynomial.legendre.leggauss(5)
_X5 = tuple(float(x) for x in 0.5 * (1.0 + _GL5[0]))
_W5 = tuple(float(x) for x in 0.5 * _GL5[1])


@nb.njit(**JIT_FMA)
def even(n, D, Y, M, length, r0, r1, r2, R, c_mk, piece, out):
    """c0 + c1 w + c2 w² with w = 1 − ρ²/R²: step, Epanechnikov, quartic."""
    e2 = (R / length) * (R / length)
    c0 = c_mk[piece, 0]
    c1 = c_mk[piece, 1] / e2
    c2 = c_mk[piece, 2] / (e2 * e2)
    for l in range(n):
        d = D[l]
        w = e2 - M[l] * M[l] - Y[l] * Y[l]
        w = w if w > 0.0 else 0.0
        q = sqrt(w)
        lo = d - q
        lo = lo if lo > 0.0 else 0.0
        hi = d + q
        hi = hi if hi < 1.0 else 1.0
        share = hi - lo
        share = share if share > 0.0 else 0.0
        a = lo - d
        b = hi - d
        ab = a * b
        aabb = (a + b) * (a + b) - 2.0 * ab
        m2 = (aabb + ab) * (1.0 / 3.0)
        m4 = (aabb * aabb + ab * aabb - ab * ab) * 0.2
        out[l] = share * (c0 + c1 * (w - m2) + c2 * (w * (w - 2.0 * m2) + m4))


_LN2_HALF = 0.34657359027997264


@nb.njit(inline="always", **JIT_FMA)
def _atanh_over(S, delta):
    """atanh(δ/S)/δ for 0 ≤ δ ≤ S, S > 0: with 2^e the nearest power of two to (S+δ)/(S−δ), ½ e ln 2 + atanh of what is left (|f| < 0.21)."""
    top = S + delta
    low = S - delta
    floor_ = 1e-17 * S
    low = low if low > floor_ else floor_
    # Round log2(top/low), read off the bits: exponent difference, mantissas as a linear approximation to their log2.
    # top ≥ low, so e ≥ 0: the mask only tells the compiler so.
    e = ((bits(top) - bits(low) + 0x0008000000000000) >> 52) & 0x7FF
    scale = from_bits((e + 1023) << 52)
    direct = e == 0
    scaled = low * scale
    f = (2.0 * delta if direct else top - scaled) / (top + scaled)
    z = f * f
    # atanh(f)/f − 1, |f| < 0.21: z^k/(2k+1) up to k = 12 leaves 0.21^26/27 = 9e-20.
    g = 1.0 / 25.0
    g = g * z + 1.0 / 23.0
    g = g * z + 1.0 / 21.0
    g = g * z + 1.0 / 19.0
    g = g * z + 1.0 / 17.0
    g = g * z + 1.0 / 15.0
    g = g * z + 1.0 / 13.0
    g = g * z + 1.0 / 11.0
    g = g * z + 1.0 / 9.0
    g = g * z + 1.0 / 7.0
    g = g * z + 1.0 / 5.0
    g = g * z + 1.0 / 3.0
    g = g * z + 1.0
    return (g if direct else f * g + _LN2_HALF * (from_bits(e | 0x4330000000000000) - 4503599627370496.0)) / (S if direct else delta)


@nb.njit(**JIT_FMA)
def cone(n, D, Y, M, length, r0, r1, r2, R, c_mk, piece, out):
    """c0 + c1 ρ/R: linear, hardy, tables."""
    e2 = (R / length) * (R / length)
    c0 = c_mk[piece, 0]
    c1 = c_mk[piece, 1] * (length / R)
    for l in range(n):
        d = D[l]
        p2 = M[l] * M[l] + Y[l] * Y[l]
        w = e2 - p2
        w = w if w > 0.0 else 0.0
        q = sqrt(w)
        lo = d - q
        lo = lo if lo > 0.0 else 0.0
        hi = d + q
        hi = hi if hi < 1.0 else 1.0
        share = hi - lo
        share = share if share > 0.0 else 0.0
        a = lo - d
        b = hi - d
        S = sqrt(p2 + a * a) + sqrt(p2 + b * b) + 1e-300
        j1 = 0.25 * (S + (a + b) * (a + b) / S) + p2 * _atanh_over(S, share)
        out[l] = share * (c0 + c1 * j1)


@nb.njit(**JIT_FMA)
def radial(n, D, Y, M, length, r0, r1, r2, R, c_mk, piece, out):
    """Σ_k c_k (ρ/R)^k, k = 0..4 (kernels.py, `mean_powers`)."""
    e2 = (R / length) * (R / length)
    s = length / R
    c0 = c_mk[piece, 0]
    c1 = c_mk[piece, 1] * s
    c2 = c_mk[piece, 2] * s * s
    c3 = c_mk[piece, 3] * s * s * s
    c4 = c_mk[piece, 4] * s * s * s * s
    for l in range(n):
        d = D[l]
        p2 = M[l] * M[l] + Y[l] * Y[l]
        w = e2 - p2
        w = w if w > 0.0 else 0.0
        q = sqrt(w)
        lo = d - q
        lo = lo if lo > 0.0 else 0.0
        hi = d + q
        hi = hi if hi < 1.0 else 1.0
        share = hi - lo
        share = share if share > 0.0 else 0.0
        a = lo - d
        b = hi - d
        ra = sqrt(p2 + a * a)
        rb = sqrt(p2 + b * b)
        S = ra + rb + 1e-300
        T2 = (a + b) * (a + b) / S
        ab = a * b
        aabb = a * a + b * b
        rab = ra * rb
        m2 = (aabb + ab) * (1.0 / 3.0)
        m4 = (aabb * aabb + ab * aabb - ab * ab) * 0.2
        j1 = 0.25 * (S + T2) + p2 * _atanh_over(S, share)
        j3 = 0.125 * (S * (S * S - 3.0 * rab) + T2 * (S * S - rab)) + 0.75 * p2 * j1
        out[l] = share * (c0 + c1 * j1 + c2 * (p2 + m2) + c3 * j3 + c4 * (p2 * (p2 + 2.0 * m2) + m4))


@nb.njit(**JIT_FMA)
def gaussian(n, D, Y, M, length, r0, r1, r2, R, c_mk, piece, out):
    """c0 exp(−ρ²/2w²), w = c1. Short bonds by 8 Gauss-Legendre points, where a difference of erf's would cancel (kernels.py)."""
    s = length / (sqrt(2.0) * c_mk[piece, 1])
    norm = c_mk[piece, 0]
    if s < 1.0:
        for l in range(n):
            d = D[l]
            p2 = M[l] * M[l] + Y[l] * Y[l]
            g = _W0 * (exp(-((s * (_T0 - d)) ** 2)) + exp(-((s * (_T7 - d)) ** 2)))
            g += _W1 * (exp(-((s * (_T1 - d)) ** 2)) + exp(-((s * (_T6 - d)) ** 2)))
            g += _W2 * (exp(-((s * (_T2 - d)) ** 2)) + exp(-((s * (_T5 - d)) ** 2)))
            g += _W3 * (exp(-((s * (_T3 - d)) ** 2)) + exp(-((s * (_T4 - d)) ** 2)))
            out[l] = norm * exp(-s * s * p2) * g
    else:
        half = 0.5 * sqrt(np.pi) / s
        for l in range(n):
            d = D[l]
            p2 = M[l] * M[l] + Y[l] * Y[l]
            out[l] = norm * exp(-s * s * p2) * half * (erf(s * (1.0 - d)) + erf(s * d))


@nb.njit(**JIT_FMA)
def _m4(v):
    v = abs(v)
    a = 2.0 - v if v < 2.0 else 0.0
    b = 1.0 - v if v < 1.0 else 0.0
    return (a * a * a - 4.0 * b * b * b) / 6.0


@nb.njit(**JIT_FMA)
def bspline(n, X, Y, Z, length, r0, r1, r2, R, c_mk, piece, out):
    """c0 Π M4(d_a/h), h = c1: between crossings of knot planes a polynomial of degree 9 along the bond, five Gauss points are exact."""
    h = c_mk[piece, 1]
    times = np.empty(17)
    r = (r0, r1, r2)
    for l in range(n):
        d = (X[l], Y[l], Z[l])
        times[0] = 0.0
        times[1] = 1.0
        count = 2
        for a in range(3):
            for k in range(-2, 3):
                if r[a] != 0.0:
                    t = (d[a] - k * h) / r[a]
                    if 0.0 < t < 1.0:
                        m = count
                        while times[m - 1] > t:
                            times[m] = times[m - 1]
                            m -= 1
                        times[m] = t
                        count += 1
        total = 0.0
        for m in range(count - 1):
            width = times[m + 1] - times[m]
            part = 0.0
            for q in range(5):
                t = times[m] + _X5[q] * width
                part += _W5[q] * _m4((d[0] - t * r0) / h) * _m4((d[1] - t * r1) / h) * _m4((d[2] - t * r2) / h)
            total += width * part
        out[l] = c_mk[piece, 0] * total


@nb.njit(**JIT_FMA)
def box(n, X, Y, Z, length, r0, r1, r2, R, c_mk, piece, out):
    """c0 inside the half-open box of edges c1, c2, c3: the share of the bond between three pairs of planes."""
    r = (r0, r1, r2)
    half = (0.5 * c_mk[piece, 1], 0.5 * c_mk[piece, 2], 0.5 * c_mk[piece, 3])
    for l in range(n):
        d = (X[l], Y[l], Z[l])
        lo = 0.0
        hi = 1.0
        for a in range(3):
            if abs(r[a]) > 2e-30 * half[a]:
                t1 = (d[a] - half[a]) / r[a]
                t2 = (d[a] + half[a]) / r[a]
                lo = max(lo, min(t1, t2))
                hi = min(hi, max(t1, t2))
            elif not (-half[a] <= d[a] < half[a]):
                lo = 2.0
        out[l] = c_mk[piece, 0] * (hi - lo) if hi > lo else 0.0
