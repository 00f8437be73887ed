"""The two sums averaged over planes: in one dimension, with the kernel integrated over the plane (`kernels.Marginal`)."""

from __future__ import annotations

from math import ceil, erf, exp, floor, sqrt

import numba as nb
import numpy as np

from ._simd import JIT_FMA


@nb.njit(**JIT_FMA)
def _mean_power(c_k, va, vb):
    """Mean of Σ c_k v^k between va and vb: v^k averages to (va^k + va^{k−1} vb + … + vb^k)/(k + 1); nothing cancels when va = vb."""
    total = c_k[0]
    power_a = 1.0
    sum_ = 1.0
    for k in range(1, len(c_k)):
        power_a *= va
        sum_ = sum_ * vb + power_a
        total += c_k[k] * sum_ / (k + 1.0)
    return total


@nb.njit(**JIT_FMA)
def _integral(c_k, R, z):
    """∫₀^z Σ c_k (|z|/R)^k, constant beyond R."""
    u = abs(z) / R
    u = u if u < 1.0 else 1.0
    total = 0.0
    for k in range(len(c_k) - 1, -1, -1):
        total = total * u + c_k[k] / (k + 1.0)
    total *= u * R
    return total if z >= 0.0 else -total


@nb.njit(**JIT_FMA)
def _polynomial_mean(d, r, radii_m, coef_mk):
    """Mean of φ₁(d − t r), t in [0, 1]."""
    total = 0.0
    for m in range(len(radii_m)):
        R = radii_m[m]
        if abs(r) > 1e-2 * R:
            # A difference of antiderivatives loses two digits at most here.
            total += (_integral(coef_mk[m], R, d) - _integral(coef_mk[m], R, d - r)) / r
        else:
            s = r if abs(r) > 1e-30 * R else 1e-30 * R
            for side in range(2):
                t1 = d / s
                t2 = (d - R) / s if side == 0 else (d + R) / s
                lo = min(max(min(t1, t2), 0.0), 1.0)
                hi = min(max(max(t1, t2), 0.0), 1.0)
                if hi > lo:
                    total += (hi - lo) * _mean_power(coef_mk[m], abs(d - lo * s) / R, abs(d - hi * s) / R)
    return total


_GL8 = np.polynomial.legendre.leggauss(8)
_T8 = 0.5 * (1.0 + _GL8[0])
_W8 = 0.5 * _GL8[1]


@nb.njit(**JIT_FMA)
def _gaussian_mean(d, r, radii_m, coef_mk):
    """Mean of c0 exp(−z²/2 c1²), z = d − t r. Short bonds by Gauss-Legendre (kernels.py, `_mean_gauss`)."""
    w = coef_mk[0, 1] * sqrt(2.0)
    s = r / w
    z = d / w
    if abs(s) < 1.0:
        total = 0.0
        for q in range(8):
            total += _W8[q] * exp(-((z - _T8[q] * s) ** 2))
        return coef_mk[0, 0] * total
    return coef_mk[0, 0] * 0.5 * sqrt(np.pi) * (erf(z) - erf(z - s)) / s


@nb.njit(**JIT_FMA)
def _box_mean(d, r, radii_m, coef_mk):
    """Mean of the half-open step −R ≤ z < R."""
    R = radii_m[0]
    if abs(r) < 1e-30 * R:
        return coef_mk[0, 0] if -R <= d < R else 0.0
    t1 = (d - R) / r
    t2 = (d + R) / r
    return coef_mk[0, 0] * max(0.0, min(max(t1, t2), 1.0) - max(min(t1, t2), 0.0))


# Replaced in each specialised copy (see `_simd.specialise`).
MEAN = _polynomial_mean


def slab_bonds(z_n, i_b, r_b, b_bk, radii_m, coef_mk, step, n, periodic, acc_gk):
    """Σ_b b β₁ in n bins whose centres are at (k + ½) step, z relative to the cell's lower face. Returns the number of visits."""
    n_comp = b_bk.shape[1]
    R = radii_m[0]
    visits = 0
    for b in range(len(r_b)):
        r = r_b[b]
        f = z_n[i_b[b]] / step - 0.5
        base = floor(f + 0.5)
        # From the nearest bin centre.
        d = (f - base) * step
        lo = ceil((min(d, d - r) - R) / step - 1e-9)
        hi = floor((max(d, d - r) + R) / step + 1e-9)
        if periodic:
            base %= n
        else:
            lo = max(lo, -base)
            hi = min(hi, n - 1 - base)
        visits += max(0, hi - lo + 1)
        for k in range(lo, hi + 1):
            t = MEAN(d - k * step, r, radii_m, coef_mk)
            g = (base + k) % n
            for c in range(n_comp):
                acc_gk[g, c] += t * b_bk[b, c]
    return visits
