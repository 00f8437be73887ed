"""The product of a hat along each axis: the shape functions of linear elements (LAMMPS ``fix atc field``), divided by
their integrals.

φ(d) = Π_a (1 − |d_a|/h_a)/h_a where every |d_a| < h_a. Along a bond it is a cubic between the places where the bond
enters the box |d_a| < h_a, crosses one of its three middle planes d_a = 0, and leaves: two Gauss-Legendre points a
stretch are exact. It is not rotation invariant.
"""

from __future__ import annotations

from math import pi, sqrt

import numpy as np

from ..compiled import njit
from ..simd import INLINE, JIT, abs4, maximum4, minimum4, peek, splat4, where_positive4
from .base import Compiled, Edged, along_axis, edges, positive
from .lanes import bond_vectors, cartesian, cartesian_constants
from .profile import TINY, Marginal

_GAUSS = 0.5 - 0.5 / sqrt(3.0)


class Trilinear(Edged):
    """Π (1 − |d_a|/h_a)/h_a over the axes.

    size : (3,) or (2,) the elements' edges h; given : how many numbers the user gave
    """

    name, aliases, takes = "trilinear", ("hat",), ("size", "radius")
    smooth = False
    # Modes fall as k⁻² along an axis.
    last_mode = 3000.0

    @classmethod
    def of(cls, dimension=None, *, size=None, radius=None):
        if radius is not None:
            return cls(np.full(3, positive("radius", radius, cls.name)), given=1)
        return cls(edges(size, dimension, cls.name), given=np.size(size))

    @property
    def radius(self):
        return float(self.size.max())

    @property
    def scale(self):
        return float(self.size.min())

    @property
    def support(self):
        return float(np.sqrt((self.size**2).sum()))

    @property
    def pieces(self):
        # In the plane d_z is 0, and its factor 1.
        return np.array([self.support]), np.array([[self.normalisation, *self.size, *self.size[: 3 - self.dimension]]])

    def _factors(self, d):
        """(..., dimension) 1 − |d_a|/h_a"""
        return np.maximum(1.0 - np.abs(np.asarray(d, float)[..., : self.dimension]) / self.size, 0.0)

    def phi(self, d):
        return self.normalisation * self._factors(d).prod(-1)

    def grad_phi(self, d):
        d, f = np.asarray(d, float), self._factors(d)
        out = np.zeros_like(d)
        for a in range(self.dimension):
            slope = -np.sign(d[..., a]) / self.size[a] * (f[..., a] > 0)
            out[..., a] = self.normalisation * slope * np.delete(f, a, -1).prod(-1)
        return out

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        lo, hi, middles = np.zeros(d.shape[:-1]), np.ones(d.shape[:-1]), []
        for a, h in enumerate(self.size):
            step = np.where(np.abs(r[..., a]) > TINY * h, r[..., a], TINY * h)
            t1, t2 = (d[..., a] - h) / step, (d[..., a] + h) / step
            lo, hi = np.maximum(lo, np.minimum(t1, t2)), np.minimum(hi, np.maximum(t1, t2))
            middles.append(d[..., a] / step)
        hi = np.maximum(hi, lo)
        times = np.stack([lo, *(np.clip(t, lo, hi) for t in middles), hi], -1)
        times = np.sort(times, -1)
        total = np.zeros(lo.shape)
        for begin, end in zip(np.moveaxis(times, -1, 0)[:-1], np.moveaxis(times, -1, 0)[1:]):
            for x in (_GAUSS, 1.0 - _GAUSS):
                total += 0.5 * (end - begin) * self.phi(d - (begin + x * (end - begin))[..., None] * r)
        return total

    def hat(self, k):
        k = np.asarray(k, float)[..., : self.dimension]
        return (np.sinc(k * self.size * (0.5 / pi)) ** 2).prod(-1)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        h = float(self.size[along_axis(self, normal)])
        return Marginal(np.array([h]), np.array([[1.0, -1.0, 0, 0, 0, 0, 0]]) / h)

    def kink_distance(self, d):
        a = np.abs(d[..., : self.dimension])
        return np.minimum(a, np.abs(a - self.size)).min(-1)


@njit(**INLINE)
def _clipped(lo, hi, d, inverse, h):
    """Where along the bond one component of d is within h of 0, and where it is 0."""
    t1, t2 = (d - h) * inverse, (d + h) * inverse
    return maximum4(lo, minimum4(t1, t2)), minimum4(hi, maximum4(t1, t2)), d * inverse


@njit(**INLINE)
def _product(t, d0, d1, d2, r0, r1, r2, i0, i1, i2):
    """Π (1 − |d_a − t r_a|/h_a), i_a = 1/h_a."""
    return (1.0 - abs4(d0 - t * r0) * i0) * (1.0 - abs4(d1 - t * r1) * i1) * (1.0 - abs4(d2 - t * r2) * i2)


@njit(**INLINE)
def _mean(d0, d1, d2, r0, r1, r2, c_at):
    """β at four points: d = x_i − x, bond vectors r, c0 the normalisation and c1, c2, c3 = h."""
    h0, h1, h2 = peek(c_at, 1), peek(c_at, 2), peek(c_at, 3)
    # A bond that does not move along an axis moves by next to nothing.
    r0 = where_positive4(abs4(r0) - TINY * h0, r0, TINY * h0)
    r1 = where_positive4(abs4(r1) - TINY * h1, r1, TINY * h1)
    r2 = where_positive4(abs4(r2) - TINY * h2, r2, TINY * h2)
    lo, hi, m0 = _clipped(splat4(0.0), splat4(1.0), d0, 1.0 / r0, h0)
    lo, hi, m1 = _clipped(lo, hi, d1, 1.0 / r1, h1)
    lo, hi, m2 = _clipped(lo, hi, d2, 1.0 / r2, h2)
    hi = maximum4(hi, lo)
    m0, m1, m2 = minimum4(maximum4(m0, lo), hi), minimum4(maximum4(m1, lo), hi), minimum4(maximum4(m2, lo), hi)
    # In order.
    low, high = minimum4(m0, m1), maximum4(m0, m1)
    t1, t3 = minimum4(low, m2), maximum4(high, m2)
    t2 = maximum4(low, minimum4(high, m2))
    i0, i1, i2 = 1.0 / h0, 1.0 / h1, 1.0 / h2
    total = splat4(0.0)
    begin = lo
    for s in range(4):
        end = t1 if s == 0 else t2 if s == 1 else t3 if s == 2 else hi
        share = end - begin
        a, b = begin + _GAUSS * share, end - _GAUSS * share
        total = total + share * (
            _product(a, d0, d1, d2, r0, r1, r2, i0, i1, i2) + _product(b, d0, d1, d2, r0, r1, r2, i0, i1, i2)
        )
        begin = end
    return total * (0.5 * peek(c_at, 0))


@njit(**INLINE)
def _beta(D, Y, M, k):
    d0, d1, d2 = cartesian(D, Y, M, k)
    return _mean(d0, d1, d2, splat4(peek(k, 0)), splat4(peek(k, 1)), splat4(peek(k, 2)), k + 8 * 13)


@njit(**INLINE)
def _pairs(x, y, z, R2, c_at, series_at, bond_at, r_at, k):
    r0, r1, r2 = bond_vectors(bond_at, r_at, k)
    return _mean(x, y, z, r0, r1, r2, c_at)


@njit(**JIT)
def _hat_and_slope(d, h):
    f = 1.0 - abs(d) / h
    if f <= 0.0:
        return 0.0, 0.0
    return f, 0.0 if d == 0.0 else -1.0 / h if d > 0.0 else 1.0 / h


@njit(**JIT)
def _value(d0, d1, d2, r2, radii, coef, g):
    f0, s0 = _hat_and_slope(d0, coef[0, 1])
    f1, s1 = _hat_and_slope(d1, coef[0, 2])
    f2, s2 = _hat_and_slope(d2, coef[0, 3])
    n = coef[0, 0]
    g[0], g[1], g[2] = n * s0 * f1 * f2, n * f0 * s1 * f2, n * f0 * f1 * s2
    return n * f0 * f1 * f2


Trilinear.compiled = Compiled("trilinear", cartesian_constants, _beta, _pairs, _value, cartesian=True, seconds=2e-8)
