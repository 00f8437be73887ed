"""The half-open box: every atom is counted by one of the boxes that fill space (LAMMPS fix atc's ``cell``)."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from ..simd import JIT, JIT_FMA, peek
from .base import TINY, Compiled, Edged, along_axis, edges, positive
from .profile import Marginal


class Box(Edged):
    """1/volume (1/area) for −L/2 ≤ d < L/2 along every axis: half-open, so that touching boxes count an atom on their
    face once."""

    name, aliases, takes = "box", ("cell",), ("size", "radius")
    jumps, smooth = True, False

    @classmethod
    def of(cls, dimension=None, *, size=None, radius=None):
        if radius is not None:
            return cls(np.full(3, 2.0 * positive("radius", radius, cls.name)), given=1)
        return cls(edges(size, dimension, cls.name), given=np.size(size))

    @property
    def support(self):
        return 0.5 * float(np.sqrt((self.size**2).sum()))

    @property
    def radius(self):
        return 0.5 * float(self.size.max())

    @property
    def pieces(self):
        # In the plane d_z is 0: inside edges of any length. A point exactly on a corner is inside; the sphere's
        # rounding must not lose it.
        coef_mk = np.array([[self.normalisation, *self.size, *self.size[: 3 - self.dimension]]])
        return np.array([self.support * (1.0 + 1e-12)]), coef_mk

    def kink_distance(self, d):
        return np.abs(np.abs(d[..., : self.dimension]) - 0.5 * self.size).min(-1)

    def phi(self, d):
        d = np.asarray(d, float)[..., : self.dimension]
        return np.where(((d >= -0.5 * self.size) & (d < 0.5 * self.size)).all(-1), self.normalisation, 0.0)

    def grad_phi(self, d):
        return np.zeros_like(np.asarray(d, float))

    def hat(self, k):
        k = np.asarray(k, float)[..., : self.dimension]
        return np.sinc(k * self.size / (2.0 * np.pi)).prod(-1)

    def beta(self, d, r):
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        lo, hi = np.zeros(d.shape[:-1]), np.ones(d.shape[:-1])
        half = 0.5 * self.size
        for a in range(self.dimension):
            moving = np.abs(r[..., a]) > TINY * self.size[a]
            step = np.where(moving, r[..., a], 1.0)
            t1, t2 = (d[..., a] - half[a]) / step, (d[..., a] + half[a]) / step
            inside = (d[..., a] >= -half[a]) & (d[..., a] < half[a])
            lo = np.where(moving, np.maximum(lo, np.minimum(t1, t2)), np.where(inside, lo, 2.0))
            hi = np.where(moving, np.minimum(hi, np.maximum(t1, t2)), hi)
        return self.normalisation * np.maximum(hi - lo, 0.0)

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        edge = float(self.size[along_axis(self, normal)])
        return Marginal(np.array([0.5 * edge]), np.array([[1.0 / edge, 0, 0, 0, 0, 0, 0]]), half_open=True)


@njit(**JIT_FMA)
def _mean(d0, d1, d2, r0, r1, r2, c_at, room_at):
    """c0 times the share of the bond between three pairs of planes, c1, c2, c3 apart."""
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


@njit(**JIT)
def _value(d0, d1, d2, r2, radii, coef, g):
    g[0], g[1], g[2] = 0.0, 0.0, 0.0
    h0, h1, h2 = 0.5 * coef[0, 1], 0.5 * coef[0, 2], 0.5 * coef[0, 3]
    return coef[0, 0] if -h0 <= d0 < h0 and -h1 <= d1 < h1 and -h2 <= d2 < h2 else 0.0


Box.compiled = Compiled.pointwise("box", _mean, _value, seconds=2.1e-8)
