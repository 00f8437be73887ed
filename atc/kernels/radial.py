"""Kernels that are polynomials of the distance, in pieces: step, linear, cubic, quartic, lucy, hardy, and tables of
users.

Every isotropic kernel except the Gaussian is written as a sum of *pieces*, polynomials in ρ/R_m that are cut off at
R_m: φ(ρ) = Σ_m Σ_k c_mk (ρ/R_m)^k for ρ < R_m. A cone cut at R minus a cone cut at R/2 is MDStressLab's `hardy`, and
any piecewise linear table is a sum of cones. β of a piece is closed: clip the bond to the sphere, then take the mean of
ρ^k over what is left, with ρ² = p² + u² (p the distance of x from the bond's line, u the coordinate along it).

The means J_k = (1/Δ)∫ρ^k du over [u_a, u_b] follow from J_k = [D_k + k p² J_{k−2}]/(k+1), D_k = [u ρ^k]_a^b / Δ, Δ =
u_b − u_a. Written with S = ρ_a + ρ_b and T = u_a + u_b (so ρ_b − ρ_a = Δ T/S, and asinh(u_b/p) − asinh(u_a/p) = 2
atanh(Δ/S)) every term is positive and Δ has been divided out by hand: nothing cancels for bonds of any length, tangent,
or through x.

In two dimensions (`Kernel.planar`) φ is the same function of the distance in the plane with ∫φ dA = 1. Between points
and bonds of one plane every formula above holds as it is: a planar kernel is its three-dimensional twin times a
constant. Only what is integrated differs: the normalisation, the transform and the profile, φ integrated along lines of
the plane instead of planes (`disc`).
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from ..compiled import njit
from ..simd import INLINE, JIT, JIT_FMA, exp2i4, log2_ratio4, maximum4, minimum4, peek, sqrt4, where_zero4
from .base import Compiled, Kernel, along
from .disc import DiscMarginal
from .profile import Marginal


class Radial(Kernel):
    """Σ_m Σ_k c_mk (ρ/R_m)^k, each m only for ρ < R_m.

    radii : (m,) R_m. coef_mk : (m, 5), without the normalisation, by which φ is multiplied. table : what a user gave in
        place of a radius
    """

    last_mode, hat_step = 1500.0, 0.01

    def __init__(self, name, radii, coef_mk, normalisation, table=None, dimension=3):
        self.name, self.dimension = name, dimension
        self.radii = np.asarray(radii, float)
        self.coef_mk = np.asarray(coef_mk, float)
        self.normalisation = float(normalisation)
        self._table = table

    @property
    def radius(self) -> float:
        return float(self.radii.max())

    support = radius

    @property
    def parameters(self):
        return {"table": self._table.tolist()} if self._table is not None else {"radius": self.radius}

    @property
    def pieces(self):
        order = np.argsort(-self.radii)
        c = self.normalisation * self.coef_mk[order]
        return self.radii[order], np.ascontiguousarray(c if c[:, [1, 3]].any() else _with_even_powers(c))

    @property
    def compiled(self) -> Compiled:
        odd = self.coef_mk[:, [1, 3]].any()
        return (_RADIAL if self.coef_mk[:, 2:].any() else _CONE) if odd else _EVEN

    @property
    def jumps(self):
        # Every piece must end at 0; 1e-12: rounding of the coefficients.
        return bool((np.abs(self.coef_mk.sum(1)) > 1e-12 * np.abs(self.coef_mk).max()).any())

    @property
    def smooth(self):
        slope_m = self.coef_mk @ np.arange(5.0)
        flat = 1e-12 * np.abs(self.coef_mk).max()
        tip = (self.coef_mk[:, 1] / self.radii).sum() * self.radii.max()
        return not self.jumps and bool((np.abs(slope_m) <= flat).all()) and abs(tip) <= flat

    def kink_distance(self, d):
        rho = np.sqrt((d**2).sum(-1))
        return np.abs(rho[..., None] - np.append(self.radii, 0.0)).min(-1)

    def _with(self, radii, normalisation, table, dimension):
        return Radial(self.name, radii, self.coef_mk, normalisation, table, dimension)

    def scaled(self, factor):
        if factor == 1.0:
            return self
        table = None if self._table is None else self._table * [factor, 1.0]
        return self._with(self.radii * factor, self.normalisation / factor**self.dimension, table, self.dimension)

    def planar(self):
        return self._with(self.radii, 1.0 / _plane_integral(self.radii, self.coef_mk), self._table, 2)

    def phi(self, d):
        rho = np.sqrt((np.asarray(d, float) ** 2).sum(-1))
        total = np.zeros_like(rho)
        for R, c in zip(self.radii, self.coef_mk):
            total += np.where(rho < R, np.polynomial.polynomial.polyval(rho / R, c), 0.0)
        return self.normalisation * total

    def grad_phi(self, d):
        d = np.asarray(d, float)
        rho = np.sqrt((d**2).sum(-1))
        slope_over_rho = np.zeros_like(rho)
        safe = np.where(rho > 0, rho, 1.0)
        for R, c in zip(self.radii, self.coef_mk):
            derivative = np.polynomial.polynomial.polyval(rho / R, c[1:] * np.arange(1, 5)) / R
            slope_over_rho += np.where((rho < R) & (rho > 0), derivative / safe, 0.0)
        return self.normalisation * slope_over_rho[..., None] * d

    def beta(self, d, r):
        p2, D, length = along(d, r, self.support)
        total = np.zeros_like(p2)
        for R, c in zip(self.radii, self.coef_mk):
            half_chord = np.sqrt(np.maximum((R / length) ** 2 - p2, 0.0))
            lo, hi = np.maximum(D - half_chord, 0.0), np.minimum(D + half_chord, 1.0)
            share = np.maximum(hi - lo, 0.0)
            J = mean_powers(p2, lo - D, hi - D, share)
            total += share * sum(c[k] * (length / R) ** k * J[k] for k in range(5) if c[k] != 0)
        return self.normalisation * total

    def hat(self, k):
        k = np.sqrt((np.asarray(k, float) ** 2).sum(-1))
        total = np.zeros(k.shape)
        if self.dimension == 2:
            for R, c in zip(self.radii, self.coef_mk):
                total += (2 * pi * self.normalisation * R**2) * np.einsum("n,n...->...", c, _moments_plane(k * R))
            return total
        for R, c in zip(self.radii, self.coef_mk):
            # Written so that a column of zeros costs nothing.
            for n, moment in enumerate(_moments(k * R)):
                if c[n] != 0:
                    total += (4 * pi * self.normalisation * R**3 * c[n]) * moment
        return total

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        if self.dimension == 2:
            return DiscMarginal(self.radii, self.normalisation * self.coef_mk)
        coef = np.zeros((len(self.radii), 7))
        for m, R in enumerate(self.radii):
            c = 2 * pi * R**2 * self.normalisation * self.coef_mk[m] / (np.arange(5) + 2.0)
            coef[m, 0] = c.sum()
            coef[m, 2:] = -c
        return Marginal(self.radii, coef)


def _with_even_powers(c_mk):
    """(m, 8) of coefficients without odd powers of s: first those of powers of w = 1 − s², then c_mk."""
    return np.concatenate(
        [np.stack([c_mk[:, 0] + c_mk[:, 2] + c_mk[:, 4], -c_mk[:, 2] - 2.0 * c_mk[:, 4], c_mk[:, 4]], 1), c_mk], 1
    )


def _plane_integral(radii, coef_mk) -> float:
    """∫ Σ_m Σ_k c_mk (ρ/R_m)^k dA over the plane."""
    return float(2 * pi * (radii**2 * (coef_mk / (np.arange(5) + 2.0)).sum(axis=1)).sum())


def mean_powers(p2, ua, ub, delta):
    """Means of ρ^k, k = 0..4, over the stretch from ua to ub = ua + delta of a line at distance √p2 (see the module's
    head)."""
    ra, rb = np.sqrt(p2 + ua * ua), np.sqrt(p2 + ub * ub)
    S = np.maximum(ra + rb, 1e-300)
    T = ua + ub
    x = np.minimum(delta / S, 1.0 - 2e-16)
    atanh_over_delta = np.where(x > 1e-8, np.arctanh(x) / np.where(x > 1e-8, delta, 1.0), 1.0 / S)
    T2S = T * T / S
    m2 = (ua * ua + ua * ub + ub * ub) / 3.0
    J1 = 0.5 * (0.5 * (S + T2S) + 2.0 * p2 * atanh_over_delta)
    J3 = 0.25 * (0.5 * (ra**3 + rb**3 + T2S * (ra * ra + ra * rb + rb * rb)) + 3.0 * p2 * J1)
    m4 = (ua**4 + ua**3 * ub + (ua * ub) ** 2 + ua * ub**3 + ub**4) / 5.0
    return np.ones_like(p2), J1, p2 + m2, J3, p2 * p2 + 2.0 * p2 * m2 + m4


# Below this kR the integrals of a polynomial against sin(kρ) are summed as power series, above by recursion: both lose
# less than two digits there.
_SERIES = 6.0


def _moments(z):
    """(5, ...) ∫₀¹ s^(n+1) sin(z s)/z ds for n = 0..4."""
    z = np.asarray(z, float)
    out = np.empty((5, *z.shape))
    small = z < _SERIES
    if small.any():
        z2 = z[small] ** 2
        total = np.zeros((5, z2.size))
        term = np.ones_like(z2)
        for j in range(20):
            for n in range(5):
                total[n] += term / (n + 3 + 2 * j)
            term = -term * z2 / ((2 * j + 2) * (2 * j + 3))
        out[:, small] = total
    if not small.all():
        z = z[~small]
        sin, cos = np.sin(z), np.cos(z)
        S, C = (1.0 - cos) / z, sin / z
        for p in range(1, 6):
            S, C = (p * C - cos) / z, (sin - p * S) / z
            out[p - 1, ~small] = S / z
    return out


def _moments_plane(z):
    """(5, ...) ∫₀¹ s^(n+1) J₀(z s) ds for n = 0..4: from ∫₀¹ s^m J₀ = J₁/z + (m−1) J₀/z² − (m−1)² ∫₀¹ s^(m−2) J₀/z²,
    and Struve's functions for ∫ J₀."""
    from scipy.special import j0, j1, struve

    z = np.asarray(z, float)
    out = np.empty((5, *z.shape))
    small = z < _SERIES
    if small.any():
        z2 = 0.25 * z[small] ** 2
        total = np.zeros((5, z2.size))
        term = np.ones_like(z2)
        for j in range(24):
            for n in range(5):
                total[n] += term / (n + 2 + 2 * j)
            term = -term * z2 / (j + 1) ** 2
        out[:, small] = total
    if not small.all():
        z = z[~small]
        J0, J1 = j0(z), j1(z)
        # ∫₀^z J₀ = z J₀ + (π z/2)(J₁ H₀ − J₀ H₁)
        A = {0: J0 + 0.5 * pi * (J1 * struve(0, z) - J0 * struve(1, z)), 1: J1 / z}
        for m in range(2, 6):
            A[m] = J1 / z + (m - 1) * J0 / z**2 - (m - 1) ** 2 * A[m - 2] / z**2
        out[:, ~small] = np.stack([A[m] for m in range(1, 6)])
    return out


@njit(**JIT_FMA)
def _even_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] / k[0]
    k[3] = c_mk[piece, 2] / (k[0] * k[0])


@njit(**INLINE)
def _even(D, Y, M, k):
    """c0 + c1 w + c2 w² with w = 1 − ρ²/R²: step, Epanechnikov, quartic."""
    return _even_mean(D, peek(k, 0) - M * M - Y * Y, peek(k, 1), peek(k, 2), peek(k, 3))


@njit(**INLINE)
def _even_mean(D, w, c0, c1, c2):
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
def _cone_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] * (length / R)


@njit(**INLINE)
def _cone(D, Y, M, k):
    """c0 + c1 ρ/R: linear, hardy, tables."""
    return _cone_mean(D, M * M + Y * Y, peek(k, 0), peek(k, 1), peek(k, 2))


@njit(**INLINE)
def _cone_mean(D, p2, R2, c0, c1):
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
def _radial_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    s = length / R
    k[0] = (R / length) * (R / length)
    k[1] = c_mk[piece, 0]
    k[2] = c_mk[piece, 1] * s
    k[3] = c_mk[piece, 2] * s * s
    k[4] = c_mk[piece, 3] * s * s * s
    k[5] = c_mk[piece, 4] * s * s * s * s


@njit(**INLINE)
def _radial(D, Y, M, k):
    """Σ_k c_k (ρ/R)^k, k = 0..4 (`mean_powers`)."""
    return _radial_mean(D, M * M + Y * Y, peek(k, 0), peek(k, 1), peek(k, 2), peek(k, 3), peek(k, 4), peek(k, 5))


@njit(**INLINE)
def _radial_mean(D, p2, R2, c0, c1, c2, c3, c4):
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
def _even_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    s2 = length2 * (1.0 / R2)
    return _even_mean(D, R2 / length2 - p2, peek(c_at, 0), peek(c_at, 1) * s2, peek(c_at, 2) * s2 * s2)


@njit(**INLINE)
def _cone_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    return _cone_mean(D, p2, R2 / length2, peek(c_at, 0), peek(c_at, 1) * sqrt4(length2 * (1.0 / R2)))


@njit(**INLINE)
def _radial_pairs(D, p2, length2, R2, c_at, series_at, bond_at, r_at, k):
    s2 = length2 * (1.0 / R2)
    s = sqrt4(s2)
    return _radial_mean(
        D,
        p2,
        R2 / length2,
        peek(c_at, 0),
        peek(c_at, 1) * s,
        peek(c_at, 2) * s2,
        peek(c_at, 3) * s * s2,
        peek(c_at, 4) * s2 * s2,
    )


@njit(**JIT, no_cpython_wrapper=True)
def _sum(d0, d1, d2, r2, radii, coef, first, g):
    """φ and its gradient from coefficients of (ρ/R)^k that begin at column `first`."""
    rho = sqrt(r2)
    value = 0.0
    slope = 0.0  # (dφ/dρ)/ρ
    for m in range(len(radii)):
        R = radii[m]
        if rho >= R:
            break
        s = rho / R
        value += coef[m, first] + s * (
            coef[m, first + 1] + s * (coef[m, first + 2] + s * (coef[m, first + 3] + s * coef[m, first + 4]))
        )
        t = 2.0 * coef[m, first + 2] + s * (3.0 * coef[m, first + 3] + s * 4.0 * coef[m, first + 4])
        if coef[m, first + 1] != 0.0 and s > 0.0:
            t += coef[m, first + 1] / s
        slope += t / (R * R)
    g[0], g[1], g[2] = slope * d0, slope * d1, slope * d2
    return value


@njit(**JIT, no_cpython_wrapper=True)
def _value(d0, d1, d2, r2, radii, coef, g):
    return _sum(d0, d1, d2, r2, radii, coef, 0, g)


@njit(**JIT, no_cpython_wrapper=True)
def _even_value(d0, d1, d2, r2, radii, coef, g):
    return _sum(d0, d1, d2, r2, radii, coef, 3, g)


_EVEN = Compiled("even", _even_constants, _even, _even_pairs, _even_value, seconds=2.5e-9)
_CONE = Compiled("cone", _cone_constants, _cone, _cone_pairs, _value, seconds=9e-9)
_RADIAL = Compiled("radial", _radial_constants, _radial, _radial_pairs, _value, seconds=1.1e-8)
