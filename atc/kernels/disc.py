"""Profiles of planar kernels: Σ_k c_k (ρ/R)^k over a disc, integrated along its chords.

In three dimensions such integrals are polynomials of the distance (`profile.Marginal`); along lines of a plane they
have roots and logarithms.
"""

from __future__ import annotations

from math import asin, asinh, cos, sin, sqrt

import numpy as np

from ..compiled import njit
from ..simd import JIT_FMA, load4, peek, poke, splat4, store4
from .lanes import SCRATCH
from .profile import GL_T, GL_W, TINY, CompiledProfile, Marginal, reciprocals

# A bond shorter than this, in units of R, goes by quadrature along it: the difference of two strips would lose three
# digits.
DISC_SHORT = 1e-3


class DiscMarginal(Marginal):
    """A planar kernel Σ_m Σ_k c_mk (ρ/R_m)^k integrated along the lines at distance z: ∫φ₁ dz = 1.

    With q = √(R² − z²) half the chord, I_k = ∫ρ^k du over it follows from I_k = [2 q R^k + k z² I_{k−2}]/(k + 1),
    I_{−1} = 2 asinh(q/|z|), I_0 = 2q; and the integral over the strip from 0 to z, by the divergence theorem (∇·(x ρ^k)
    = (k + 2) ρ^k), is A_k = [z I_k + 2 R^{k+2} arcsin(z/R)]/(k + 2). Of means over bins is ∫₀^z A_k, with ∫ arcsin z =
    z arcsin z + q − 1 (R = 1) and, from dI_{k+2}/dz = (k + 2) z I_k − 2z/q, ∫₀^z z I_k = [I_{k+2} − 2/(k + 3) +
    2 (1 − q)]/(k + 2).
    """

    bin_pieces = Marginal.pieces

    def phi(self, z):
        z = np.abs(np.asarray(z, float))
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            total += R * (_chord_means(np.minimum(z / R, 1.0)) @ c)
        return total

    def slope(self, z):
        """dφ₁/dz; 0 where it jumps."""
        z = np.asarray(z, float)
        u_all = np.abs(z)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.minimum(u_all / R, 1.0)
            # dI_k/dz = −2 z/q (value at the rim) + ∫ ∂ρ^k/∂z du; in units of R, ∂ρ^k/∂z = k z ρ^{k−2}.
            inside = (u > 0) & (u < 1.0)
            v = np.where(inside, u, 0.5)
            I = _chord_means(v)
            before = np.stack(
                [np.zeros_like(v), 2.0 * np.arcsinh(np.sqrt((1 - v) * (1 + v)) / v), *np.moveaxis(I, -1, 0)[:3]], -1
            )
            k = np.arange(5)
            # At the rim a kernel that is 0 there has no such term: its coefficients' sum is 0 but for rounding.
            rim = c.sum()
            rim = 0.0 if abs(rim) <= 1e-12 * np.abs(c).max() else rim
            value = v * (before @ (k * c)) - 2.0 * v / np.sqrt((1 - v) * (1 + v)) * rim
            total += np.where(inside, value, 0.0)
        return np.sign(z) * total

    def cumulative(self, z):
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.minimum(np.abs(z) / R, 1.0)
            total += R**2 * (_strips(u) @ c)
        return 0.5 + np.sign(z) * total

    def second(self, z):
        z = np.abs(np.asarray(z, float))
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            for k in range(5):
                total += R**3 * c[k] * _strip_integral(np.minimum(z / R, 1.0), k)
            total += np.maximum(z - R, 0.0) * R**2 * float(_strips(np.ones(1))[0] @ c)
        return total

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        total = np.zeros(d.shape)
        for R, c in zip(self.radii, self.coef_mk):
            long = np.abs(r) > DISC_SHORT * R
            s = np.where(long, r, R)
            a, b = np.clip(d / R, -1.0, 1.0), np.clip((d - s) / R, -1.0, 1.0)
            by_strips = (
                R
                * (np.sign(a)[..., None] * _strips(np.abs(a)) - np.sign(b)[..., None] * _strips(np.abs(b)))
                @ c
                * (R / s)
            )
            total += np.where(long, by_strips, R * _short_mean(d / R, np.where(long, 0.0, r) / R, c))
        return total


def _chord_means(u):
    """(..., 5) ∫ ρ^k over the chord at distance 0 ≤ u ≤ 1 from the middle of the unit disc, k = 0..4."""
    q = np.sqrt(np.maximum((1.0 - u) * (1.0 + u), 0.0))
    safe = np.where(u > 0, u, 1.0)
    u2 = u * u
    I1 = q + np.where(u > 0, u2 * np.arcsinh(q / safe), 0.0)
    I0 = 2.0 * q
    I2 = (2.0 * q + 2.0 * u2 * I0) / 3.0
    I3 = (2.0 * q + 3.0 * u2 * I1) / 4.0
    I4 = (2.0 * q + 4.0 * u2 * I2) / 5.0
    return np.stack([I0, I1, I2, I3, I4], -1)


def _strips(u):
    """(..., 5) ∫ ρ^k over the part of the unit disc between its middle line and the chord at 0 ≤ u ≤ 1."""
    return (u[..., None] * _chord_means(u) + 2.0 * np.arcsin(u)[..., None]) / (np.arange(5) + 2.0)


def _strip_integral(u, k):
    """∫₀^u of `_strips`, of ρ^k."""
    q = np.sqrt(np.maximum((1.0 - u) * (1.0 + u), 0.0))
    I = _chord_means(u)
    u2 = u * u
    after = I[..., k + 2] if k < 3 else (2.0 * q + (k + 2.0) * u2 * I[..., k]) / (k + 3.0)
    moment = (after - 2.0 / (k + 3.0) + 2.0 * (1.0 - q)) / (k + 2.0)
    return (moment + 2.0 * (u * np.arcsin(u) + q - 1.0)) / (k + 2.0)


def _short_mean(d, r, c):
    """The mean over a short bond from d to d − r of the chord means, by Gauss and Legendre in the angle whose sine is
    z: no root at the rim. Split at z = 0.

    Between angles Δ apart z changes by 2 cos(mean angle) sin(Δ/2), which is the share of the bond times r: so
    differences of close numbers are not needed.
    """
    d, r = np.broadcast_arrays(d, r)
    s = np.where(np.abs(r) < TINY, TINY, r)
    total = np.zeros(d.shape)
    for lo, hi in ((-1.0, 0.0), (0.0, 1.0)):
        t1, t2 = (d - lo) / s, (d - hi) / s
        share = np.clip(np.maximum(t1, t2), 0.0, 1.0) - np.clip(np.minimum(t1, t2), 0.0, 1.0)
        A, B = np.arcsin(np.clip(d, lo, hi)), np.arcsin(np.clip(d - s, lo, hi))
        middle, half = 0.5 * (A + B), 0.5 * (A - B)
        cos = np.cos(middle)
        there = (share > 0) & (cos > 0)
        factor = share * np.where(there, 1.0 / np.where(there, cos * np.sinc(half / np.pi), 1.0), 0.0)
        for t, w in zip(GL_T, GL_W):
            x = middle + (2.0 * t - 1.0) * half
            total += w * factor * np.cos(x) * (_chord_means(np.abs(np.sin(x))) @ c)
    return total


@njit(**JIT_FMA)
def _chord(u, coef_mk, m):
    """Σ c_k ∫ρ^k over the chord at distance u of the unit disc."""
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
    """The mean of the chords from d to d − r (`_short_mean`)."""
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
            for g in range(len(GL_T)):
                x = middle + (2.0 * GL_T[g] - 1.0) * half
                part += GL_W[g] * cos(x) * _chord(sin(x), coef_mk, m)
            total += share * part / (across * (sin(half) / half if half != 0.0 else 1.0))
    return total


@njit(**JIT_FMA)
def _mean(z, r, radii_m, coef_mk, k):
    """Mean of a planar kernel's profile over z − t r, t in [0, 1], for four z."""
    total = splat4(0.0)
    for m in range(len(radii_m)):
        R = radii_m[m]
        store4(k, SCRATCH, z)
        for l in range(SCRATCH, SCRATCH + 4):
            d = peek(k, l)
            if abs(r) > DISC_SHORT * R:
                strips = _strip(d / R, coef_mk, m) - _strip((d - r) / R, coef_mk, m)
                poke(k, l, R * (R / r) * strips)
            else:
                poke(k, l, R * _short_disc(d / R, r / R, coef_mk, m))
        total = total + load4(k, SCRATCH)
    return total


@njit(**JIT_FMA)
def _integral(z, m, radii_m, coef_mk):
    return radii_m[m] * radii_m[m] * _strip(z / radii_m[m], coef_mk, m)


@njit(**JIT_FMA)
def _second(z, m, radii_m, coef_mk):
    """∫₀^z of that; see `DiscMarginal`."""
    R = radii_m[m]
    v = min(abs(z) / R, 1.0)
    q = sqrt((1.0 - v) * (1.0 + v))
    v2 = v * v
    across = 2.0 * (v * asin(v) + q - 1.0)
    even = 2.0 * q
    odd = q + v2 * asinh(q / v) if v > 0.0 else q
    total = 0.0
    for k in range(5):
        # I_k, then I_{k+2}
        after = (2.0 * q + (k + 2.0) * v2 * (even if k % 2 == 0 else odd)) / (k + 3.0)
        if k % 2 == 0:
            even = after
        else:
            odd = after
        moment = (after - 2.0 / (k + 3.0) + 2.0 * (1.0 - q)) / (k + 2.0)
        total += coef_mk[m, k] * (moment + across) / (k + 2.0)
    return R * R * R * total + max(abs(z) - R, 0.0) * R * R * _strip(1.0, coef_mk, m)


DiscMarginal.compiled = CompiledProfile("disc", reciprocals, _mean, _integral, _second)
