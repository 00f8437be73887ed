"""The two sums averaged over planes: in one dimension, with the kernel integrated over the plane
(`kernels.Marginal`)."""

from __future__ import annotations

from math import asin, asinh, ceil, cos, floor, isfinite, sin, sqrt

import numpy as np

from ..compiled import njit
from ..kernels import _GL_T, _GL_W
from ..kernels.disc import DISC_SHORT
from ..simd import INLINE, JIT_FMA, abs4, address, axpy4, load4, maximum4, minimum4, peek, poke, ramp4, splat4, store4
from . import _beta

_gaussian, _gaussian_constants = _beta.gaussian, _beta.gaussian_constants

# Below this bond length, in units of R, a difference of antiderivatives loses more than three digits: means of powers
# instead.
_SHORT = 1e-3


@njit(**JIT_FMA)
def _mean_of_powers(d, r, R, coef_mk, m):
    """Mean of Σ c_k (|z|/R)^k over z = d − t r, |z| < R. v^k averages to (va^k + va^{k−1} vb + … + vb^k)/(k + 1):
    nothing cancels if va = vb."""
    s = r if abs(r) > 1e-30 * R else 1e-30 * R
    total = 0.0
    for side in range(2):
        t1 = d / s
        t2 = (d - R) / s if side == 0 else (d + R) / s
        lo = min(max(min(t1, t2), 0.0), 1.0)
        hi = min(max(max(t1, t2), 0.0), 1.0)
        if hi > lo:
            va = abs(d - lo * s) / R
            vb = abs(d - hi * s) / R
            mean = coef_mk[m, 0]
            power_a = 1.0
            sum_ = 1.0
            for k in range(1, coef_mk.shape[1]):
                power_a *= va
                sum_ = sum_ * vb + power_a
                mean += coef_mk[m, k] * sum_ / (k + 1.0)
            total += (hi - lo) * mean
    return total


@njit(**JIT_FMA)
def polynomial(z, r, radii_m, coef_mk, k):
    """Mean of φ₁(z − t r), t in [0, 1], for four z."""
    total = splat4(0.0)
    n = coef_mk.shape[1]
    for m in range(len(radii_m)):
        R = radii_m[m]
        if abs(r) > _SHORT * R:
            # ∫₀^z Σ c_k (|z|/R)^k = R v Σ c_k |v|^k/(k + 1), v = z/R, constant beyond |v| = 1.
            a = maximum4(minimum4(z * (1.0 / R), 1.0), -1.0)
            b = maximum4(minimum4((z - r) * (1.0 / R), 1.0), -1.0)
            abs_a = abs4(a)
            abs_b = abs4(b)
            p = splat4(coef_mk[m, n - 1] * (1.0 / n))
            q = p
            for j in range(n - 2, -1, -1):
                c = coef_mk[m, j] * peek(k, j)
                p = p * abs_a + c
                q = q * abs_b + c
            total = total + (a * p - b * q) * (R / r)
        else:
            store4(k, _beta.SCRATCH, z)
            for l in range(_beta.SCRATCH, _beta.SCRATCH + 4):
                poke(k, l, _mean_of_powers(peek(k, l), r, R, coef_mk, m))
            total = total + load4(k, _beta.SCRATCH)
    return total


@njit(**JIT_FMA)
def polynomial_constants(r, radii_m, coef_mk, k_):
    for k in range(coef_mk.shape[1]):
        k_[k] = 1.0 / (k + 1.0)


@njit(**INLINE)
def gaussian(z, r, radii_m, coef_mk, k):
    """Mean of c0 exp(−z²/2 c1²): the Gaussian's bond function on the bond's own line."""
    length = max(abs(r), 1e-30 * radii_m[0])
    zero = splat4(0.0)
    return _gaussian(z * ((-1.0 if r < 0.0 else 1.0) / length), zero, zero, k)


@njit(**JIT_FMA)
def gaussian_constants(r, radii_m, coef_mk, k_):
    _gaussian_constants(max(abs(r), 1e-30 * radii_m[0]), radii_m[0], coef_mk, 0, 0, 0, 0, k_)


@njit(**JIT_FMA)
def box(z, r, radii_m, coef_mk, k):
    """Mean of the half-open step −R ≤ z < R."""
    R = radii_m[0]
    store4(k, _beta.SCRATCH, z)
    for l in range(_beta.SCRATCH, _beta.SCRATCH + 4):
        d = peek(k, l)
        if abs(r) < 1e-30 * R:
            poke(k, l, coef_mk[0, 0] if -R <= d < R else 0.0)
        else:
            t1 = (d - R) / r
            t2 = (d + R) / r
            poke(k, l, coef_mk[0, 0] * max(0.0, min(max(t1, t2), 1.0) - max(min(t1, t2), 0.0)))
    return load4(k, _beta.SCRATCH)


box_constants = polynomial_constants


@njit(**JIT_FMA)
def _chord(u, coef_mk, m):
    """Σ c_k ∫ρ^k over the chord at distance u of the unit disc (`atc.disc`)."""
    u = abs(u)
    if u >= 1.0:
        return 0.0
    q = sqrt((1.0 - u) * (1.0 + u))
    u2 = u * u
    i1 = q + u2 * asinh(q / u) if u > 0.0 else q
    i0 = 2.0 * q
    i2 = (2.0 * q + 2.0 * u2 * i0) / 3.0
    return (
        coef_mk[m, 0] * i0
        + coef_mk[m, 1] * i1
        + coef_mk[m, 2] * i2
        + coef_mk[m, 3] * (2.0 * q + 3.0 * u2 * i1) / 4.0
        + coef_mk[m, 4] * (2.0 * q + 4.0 * u2 * i2) / 5.0
    )


@njit(**JIT_FMA)
def _strip(u, coef_mk, m):
    """Σ c_k ∫ρ^k over the part of the unit disc between its middle line and the chord at u."""
    v = min(abs(u), 1.0)
    a, q = 2.0 * asin(v), sqrt((1.0 - v) * (1.0 + v))
    v2 = v * v
    i1 = q + v2 * asinh(q / v) if v > 0.0 else q
    i0 = 2.0 * q
    i2 = (2.0 * q + 2.0 * v2 * i0) / 3.0
    i3 = (2.0 * q + 3.0 * v2 * i1) / 4.0
    i4 = (2.0 * q + 4.0 * v2 * i2) / 5.0
    total = (
        coef_mk[m, 0] * (v * i0 + a) / 2.0
        + coef_mk[m, 1] * (v * i1 + a) / 3.0
        + coef_mk[m, 2] * (v * i2 + a) / 4.0
        + coef_mk[m, 3] * (v * i3 + a) / 5.0
        + coef_mk[m, 4] * (v * i4 + a) / 6.0
    )
    return total if u >= 0.0 else -total


@njit(**JIT_FMA)
def _short_disc(d, r, coef_mk, m):
    """The mean of the chords from d to d − r (`atc.disc._short_mean`)."""
    s = r if abs(r) > 1e-30 else 1e-30
    total = 0.0
    for side in range(2):
        lo, hi = side - 1.0, float(side)
        t1, t2 = (d - lo) / s, (d - hi) / s
        share = min(max(max(t1, t2), 0.0), 1.0) - min(max(min(t1, t2), 0.0), 1.0)
        a, b = asin(min(max(d, lo), hi)), asin(min(max(d - s, lo), hi))
        middle, half = 0.5 * (a + b), 0.5 * (a - b)
        across = cos(middle)
        if share > 0.0 and across > 0.0:
            part = 0.0
            for g in range(len(_GL_T)):
                x = middle + (2.0 * _GL_T[g] - 1.0) * half
                part += _GL_W[g] * cos(x) * _chord(sin(x), coef_mk, m)
            total += share * part / (across * (sin(half) / half if half != 0.0 else 1.0))
    return total


@njit(**JIT_FMA)
def disc(z, r, radii_m, coef_mk, k):
    """Mean of a planar kernel's profile over z − t r, t in [0, 1], for four z."""
    total = splat4(0.0)
    for m in range(len(radii_m)):
        R = radii_m[m]
        store4(k, _beta.SCRATCH, z)
        for l in range(_beta.SCRATCH, _beta.SCRATCH + 4):
            d = peek(k, l)
            if abs(r) > DISC_SHORT * R:
                strips = _strip(d / R, coef_mk, m) - _strip((d - r) / R, coef_mk, m)
                poke(k, l, R * (R / r) * strips)
            else:
                poke(k, l, R * _short_disc(d / R, r / R, coef_mk, m))
        total = total + load4(k, _beta.SCRATCH)
    return total


disc_constants = polynomial_constants

# Replaced in each specialised copy (see `compiled.specialise`).
MEAN = polynomial
CONSTANTS = polynomial_constants


def slab_bonds(x_nc, i_b, r_bc, b_bk, origin_c, normal_c, radii_m, coef_mk, step, n, periodic, acc, ext):
    """Σ_b b β₁ in n bins whose centres are at (k + ½) step from the cell's lower face. Returns the number of visits, −1
    if something is not finite.

    `acc` is flat, components × ext; positions beyond n are folded back, or dropped, at the end (as in `_lattice`).
    """
    n_comp = b_bk.shape[1]
    R = radii_m[0]
    k_ = np.zeros(_beta.N_CONSTANTS)
    acc_at, k_at = address(acc), address(k_)
    visits = 0
    for b in range(len(r_bc)):
        o = i_b[b]
        r = r_bc[b, 0] * normal_c[0] + r_bc[b, 1] * normal_c[1] + r_bc[b, 2] * normal_c[2]
        z = (
            (x_nc[o, 0] - origin_c[0]) * normal_c[0]
            + (x_nc[o, 1] - origin_c[1]) * normal_c[1]
            + (x_nc[o, 2] - origin_c[2]) * normal_c[2]
        )
        if not isfinite(r + z):
            return -1
        f = z / step - 0.5
        base = floor(f + 0.5)
        # From the nearest bin centre.
        d = (f - base) * step
        lo = ceil((min(d, d - r) - R) / step - 1e-9)
        hi = floor((max(d, d - r) + R) / step + 1e-9)
        if not periodic:
            lo = max(lo, -base)
            hi = min(hi, n - 1 - base)
        left = hi - lo + 1
        if left <= 0:
            continue
        visits += left
        CONSTANTS(r, radii_m, coef_mk, k_)
        at = base + lo
        k = lo
        while left > 0:
            if periodic:
                at %= n
            runs = min((left + 3) >> 2, (ext - at) >> 2)
            for _ in range(runs):
                mean = MEAN(ramp4(d - k * step, -step), r, radii_m, coef_mk, k_at)
                for c in range(n_comp):
                    axpy4(acc_at, c * ext + at, b_bk[b, c], mean)
                at += 4
                k += 4
            left -= 4 * runs
    return visits
