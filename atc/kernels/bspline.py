"""The product of a cubic B-spline along each axis."""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from ..compiled import njit
from ..simd import JIT, JIT_FMA, peek, poke
from .base import Compiled, Kernel, along_axis, positive
from .profile import Marginal


class BSpline(Kernel):
    """Product over x, y, z (in the plane over x and y) of M4(d/h)/h, the cubic B-spline of knot spacing h = radius/2:
    not rotation invariant."""

    name, aliases, takes = "bspline", ("b-spline",), ("radius",)
    is_isotropic = False
    last_mode = 1200.0

    @classmethod
    def of(cls, dimension=None, *, radius):
        return cls(positive("radius", radius, cls.name))

    def __init__(self, radius, dimension=3):
        self._radius, self.dimension = float(radius), dimension

    @property
    def radius(self):
        return self._radius

    @property
    def parameters(self):
        return {"radius": self.radius}

    @property
    def _h(self):
        return 0.5 * self.radius

    @property
    def normalisation(self):
        # In the plane d_z is 0 and its factor M4(0) = 2/3 is in every product.
        return 1.0 / self._h**3 if self.dimension == 3 else 1.5 / self._h**2

    @property
    def support(self):
        return sqrt(float(self.dimension)) * self.radius

    @property
    def pieces(self):
        return np.array([self.support]), np.array([[self.normalisation, self._h]])

    def scaled(self, factor):
        return self if factor == 1.0 else BSpline(self.radius * factor, self.dimension)

    def planar(self):
        return BSpline(self.radius, dimension=2)

    def phi(self, d):
        return self.normalisation * _factor(np.asarray(d, float) / self._h).prod(-1)

    def grad_phi(self, d):
        v = np.asarray(d, float) / self._h
        f, g = _factor(v), _factor_slope(v)
        out = np.empty_like(v)
        for a in range(3):
            out[..., a] = g[..., a] * f[..., (a + 1) % 3] * f[..., (a + 2) % 3]
        return self.normalisation / self._h * out

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        # Between the times at which the bond crosses a knot plane the integrand is a polynomial of degree 9: five Gauss
        # points are exact.
        with np.errstate(divide="ignore", invalid="ignore"):
            knots = [
                np.where(r[..., a] != 0, (d[..., a] - k * self._h) / r[..., a], 0.0)
                for a in range(3)
                for k in (-2, -1, 0, 1, 2)
            ]
        times = np.sort(
            np.clip(np.nan_to_num(np.stack([*knots, np.ones_like(d[..., 0]), np.zeros_like(d[..., 0])], -1)), 0.0, 1.0),
            -1,
        )
        x, w = np.polynomial.legendre.leggauss(5)
        total = np.zeros(d.shape[:-1])
        for m in range(times.shape[-1] - 1):
            a, b = times[..., m], times[..., m + 1]
            for xi, wi in zip(x, w):
                t = a + 0.5 * (1.0 + xi) * (b - a)
                total += 0.5 * wi * (b - a) * self.phi(d - t[..., None] * r)
        return total

    def hat(self, k):
        return (np.sinc(np.asarray(k, float) * (0.25 * self.radius / pi)) ** 4).prod(-1)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        along_axis(self, normal)
        h = self._h
        cubes = np.array([1.0, -3.0, 3.0, -1.0, 0.0, 0.0, 0.0])
        # M4(v) = [(2 − |v|)³₊ − 4 (1 − |v|)³₊]/6
        return Marginal(np.array([2 * h, h]), np.array([8.0 / 6.0, -4.0 / 6.0])[:, None] * cubes / h)


def _factor(v):
    v = np.abs(v)
    return (np.maximum(2.0 - v, 0.0) ** 3 - 4.0 * np.maximum(1.0 - v, 0.0) ** 3) / 6.0


def _factor_slope(v):
    s, v = np.sign(v), np.abs(v)
    return -0.5 * s * (np.maximum(2.0 - v, 0.0) ** 2 - 4.0 * np.maximum(1.0 - v, 0.0) ** 2)


@njit(**JIT_FMA)
def _m4(v):
    v = abs(v)
    a = 2.0 - v if v < 2.0 else 0.0
    b = 1.0 - v if v < 1.0 else 0.0
    return (a * a * a - 4.0 * b * b * b) / 6.0


_GL5 = np.polynomial.legendre.leggauss(5)
_X5 = tuple(float(x) for x in 0.5 * (1.0 + _GL5[0]))
_W5 = tuple(float(x) for x in 0.5 * _GL5[1])


@njit(**JIT_FMA)
def _mean(d0, d1, d2, r0, r1, r2, c_at, times):
    """c0 Π M4(d_a/h), h = c1: between crossings of knot planes a polynomial of degree 9 along the bond, five Gauss
    points are exact."""
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


@njit(**JIT)
def _m4_and_slope(d, h):
    """The cubic B-spline of knot spacing h (times h), and its slope."""
    u = abs(d) / h
    p, q = max(2.0 - u, 0.0), max(1.0 - u, 0.0)
    return (p * p * p - 4.0 * q * q * q) / 6.0, -0.5 * (p * p - 4.0 * q * q) * (1.0 if d > 0.0 else -1.0) / h


@njit(**JIT)
def _value(d0, d1, d2, r2, radii, coef, g):
    h = coef[0, 1]
    f0, s0 = _m4_and_slope(d0, h)
    f1, s1 = _m4_and_slope(d1, h)
    f2, s2 = _m4_and_slope(d2, h)
    n = coef[0, 0]
    g[0], g[1], g[2] = n * s0 * f1 * f2, n * f0 * s1 * f2, n * f0 * f1 * s2
    return n * f0 * f1 * f2


BSpline.compiled = Compiled.pointwise("bspline", _mean, _value, seconds=2.3e-7)
