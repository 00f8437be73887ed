"""Kernels integrated over planes: polynomials of |z|, and what slab profiles need of any such profile in machine
code."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..compiled import njit
from ..simd import JIT_FMA, abs4, load4, maximum4, minimum4, peek, poke, splat4, store4
from .lanes import SCRATCH

# A bond shorter than this times the radius is given this length, in a direction that no longer matters: its β is φ to
# rounding.
TINY = 1e-30
# Eight Gauss-Legendre points on [0, 1].
GL_T, GL_W = (lambda x, w: (0.5 * (x + 1.0), 0.5 * w))(*np.polynomial.legendre.leggauss(8))
# Below this bond length, in units of R, a difference of antiderivatives loses more than three digits: means of powers
# instead.
_SHORT = 1e-3


@dataclass(frozen=True)
class CompiledProfile:
    """Bond functions along one axis, for `deposit._slab`.

    name : of the loop's copy
    constants : (r, R_m, c_mk, k), once a bond: fills the array k
    mean : (z, r, R_m, c_mk, k) -> vec4, the mean of φ₁(z − t r) over t in [0, 1] for four z
    integral, second : (z, m, R_m, c_mk) -> I(z) = ∫₀^z φ₁ and ∫₀^z I of piece m alone, for one z; what means over bins
        are made of (see `binned`)
    """

    name: str
    constants: Callable
    mean: Callable
    integral: Callable | None = None
    second: Callable | None = None


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
def _polynomial(z, r, radii_m, coef_mk, k):
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
            store4(k, SCRATCH, z)
            for l in range(SCRATCH, SCRATCH + 4):
                poke(k, l, _mean_of_powers(peek(k, l), r, R, coef_mk, m))
            total = total + load4(k, SCRATCH)
    return total


@njit(**JIT_FMA)
def reciprocals(r, radii_m, coef_mk, k_):
    for k in range(coef_mk.shape[1]):
        k_[k] = 1.0 / (k + 1.0)


@njit(**JIT_FMA)
def _half_open(z, r, radii_m, coef_mk, k):
    """Mean of the half-open step −R ≤ z < R."""
    R = radii_m[0]
    store4(k, SCRATCH, z)
    for l in range(SCRATCH, SCRATCH + 4):
        d = peek(k, l)
        if abs(r) < 1e-30 * R:
            poke(k, l, coef_mk[0, 0] if -R <= d < R else 0.0)
        else:
            t1 = (d - R) / r
            t2 = (d + R) / r
            poke(k, l, coef_mk[0, 0] * max(0.0, min(max(t1, t2), 1.0) - max(min(t1, t2), 0.0)))
    return load4(k, SCRATCH)


# Of `Marginal.bin_pieces`: powers, where I begins, its value from R on, and 1/R.
_POWERS, _FIRST, _TAIL, _INVERSE = 7, 7, 14, 15


@njit(**JIT_FMA)
def _integral(z, m, radii_m, coef_mk):
    """∫₀^z Σ c_k (|z|/R)^k = v Σ [R c_k/(k + 1)] v^k, v = |z|/R, constant beyond v = 1."""
    v = min(abs(z) * coef_mk[m, _INVERSE], 1.0)
    total = 0.0
    for k in range(_POWERS - 1, -1, -1):
        total = total * v + coef_mk[m, _FIRST + k]
    return total * v if z >= 0.0 else -total * v


@njit(**JIT_FMA)
def _second(z, m, radii_m, coef_mk):
    """∫₀^z of that: v² Σ [R² c_k/((k + 1)(k + 2))] v^k, beyond v = 1 along its tangent."""
    v = min(abs(z) * coef_mk[m, _INVERSE], 1.0)
    total = 0.0
    for k in range(_POWERS - 1, -1, -1):
        total = total * v + coef_mk[m, k]
    return total * v * v + max(abs(z) - radii_m[m], 0.0) * coef_mk[m, _TAIL]


class Marginal:
    """φ₁(z) = Σ_m Σ_k c_mk (|z|/R_m)^k, each m only for |z| < R_m: a kernel integrated over the planes normal to z; ∫φ₁
    dz = 1."""

    def __init__(self, radii, coef_mk, half_open=False):
        self.radii = np.asarray(radii, float)
        self.coef_mk = np.asarray(coef_mk, float)
        self.half_open = bool(half_open)

    @property
    def compiled(self) -> CompiledProfile:
        return _HALF_OPEN if self.half_open else _POLYNOMIAL

    @property
    def pieces(self):
        order = np.argsort(-self.radii)
        return self.radii[order], np.ascontiguousarray(self.coef_mk[order])

    @property
    def bin_pieces(self):
        """What `integral` and `second` of the compiled functions take."""
        radii, coef = self.pieces
        R, k = radii[:, None], np.arange(_POWERS)
        first = R * coef / (k + 1.0)
        second = R * first / (k + 2.0)
        return radii, np.concatenate([second, first, first.sum(1, keepdims=True), 1.0 / R], axis=1)

    @property
    def support(self) -> float:
        return float(self.radii.max())

    def phi(self, z):
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            inside = (z >= -R) & (z < R) if self.half_open else np.abs(z) < R
            total += np.where(inside, np.polynomial.polynomial.polyval(np.abs(z) / R, c), 0.0)
        return total

    def cumulative(self, z):
        """∫ φ₁ from −∞ to z."""
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.minimum(np.abs(z) / R, 1.0)
            total += R * u * np.polynomial.polynomial.polyval(u, c / (np.arange(7) + 1.0))
        return 0.5 + np.sign(z) * total

    def second(self, z):
        """∫₀^z (∫₀^z φ₁): even, and |z|/2 less a constant far out."""
        z = np.abs(np.asarray(z, float))
        total = np.zeros_like(z)
        k = np.arange(7)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.minimum(z / R, 1.0)
            total += R * R * u * u * np.polynomial.polynomial.polyval(u, c / ((k + 1.0) * (k + 2.0)))
            total += np.maximum(z - R, 0.0) * R * (c / (k + 1.0)).sum()
        return total

    def slope(self, z):
        """dφ₁/dz."""
        z = np.asarray(z, float)
        total = np.zeros_like(z)
        for R, c in zip(self.radii, self.coef_mk):
            u = np.abs(z) / R
            total += np.where(u < 1.0, np.polynomial.polynomial.polyval(u, c[1:] * np.arange(1, len(c))) / R, 0.0)
        return np.sign(z) * total

    def beta(self, d, r):
        """The mean of φ₁(d − t r) over t in [0, 1], for numbers d = z_i − z and r."""
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        if self.half_open:
            at_rest = np.abs(r) < TINY * self.support
        r = np.where(np.abs(r) < TINY * self.support, TINY * self.support, r)
        total = np.zeros(d.shape)
        for R, c in zip(self.radii, self.coef_mk):
            for side in (-1.0, 1.0):
                t1, t2 = d / r, (d - side * R) / r
                lo, hi = np.clip(np.minimum(t1, t2), 0.0, 1.0), np.clip(np.maximum(t1, t2), 0.0, 1.0)
                va, vb = np.abs(d - lo * r) / R, np.abs(d - hi * r) / R
                mean = np.zeros(d.shape)
                for k in range(7):
                    if c[k] != 0:
                        mean += c[k] / (k + 1.0) * sum(va**i * vb ** (k - i) for i in range(k + 1))
                total += (hi - lo) * mean
        return np.where(at_rest, self.phi(d), total) if self.half_open else total


_POLYNOMIAL = CompiledProfile("polynomial", reciprocals, _polynomial, _integral, _second)
_HALF_OPEN = CompiledProfile("box", reciprocals, _half_open, _integral, _second)
