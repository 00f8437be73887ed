"""Profiles averaged over the width of bins: φ₁ ⊛ a box of width w, so that what is in all bins together is what there
is, whatever their width.

    mean over the bin of φ₁:        B(z) = [I(z + w/2) − I(z − w/2)]/w,            I(z) = ∫₀^z φ₁
    mean over a bond as well:       Σ± ± [J(d ± w/2) − J(d − r ± w/2)]/(w r),       J(z) = ∫₀^z I

A family's profile gives I and J. Of a bond that hardly moves across the bins (or of bins that are narrow beside the
kernel) the second difference would lose digits: there the mean of B is taken between the kinks of I, where it is a
polynomial (of the Gaussian: smooth).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ..compiled import specialise
from ..simd import JIT_FMA, load4, peek, poke, store4
from .lanes import SCRATCH
from .profile import GL_T, GL_W, CompiledProfile

#: Below this share of the kernel's reach, and of the other, a bond (or a bin) is short.
SHORT = 1e-3

# Replaced in each copy (see `compiled.specialise`).
INTEGRAL = SECOND = None


def _short(z, long, short, radii_m, coef_mk, m):
    """The mean over s in [−½, ½] short of [I(z + s + long/2) − I(z + s − long/2)]/long."""
    R = radii_m[m]
    if short == 0.0:
        upper, lower = INTEGRAL(z + 0.5 * long, m, radii_m, coef_mk), INTEGRAL(z - 0.5 * long, m, radii_m, coef_mk)
        return (upper - lower) / long
    total = 0.0
    for side in range(2):
        middle = z + (0.5 if side == 0 else -0.5) * long
        # Four pieces, between −R, 0 and R.
        lo = -0.5
        for piece in range(4):
            hi = 0.5
            if piece < 3:
                hi = min(max(((piece - 1.0) * R - middle) / short, lo), 0.5)
            if hi > lo:
                part = 0.0
                for g in range(len(GL_T)):
                    part += GL_W[g] * INTEGRAL(middle + (lo + GL_T[g] * (hi - lo)) * short, m, radii_m, coef_mk)
                total += (hi - lo) * part if side == 0 else -(hi - lo) * part
            lo = hi
    return total / long


SHORT_MEAN = None


def _mean(z, r, radii_m, coef_mk, k):
    """Mean over z − t r + s, t in [0, 1], s in [−½, ½] w, for four z that are w apart (as `deposit._slab` asks: one
    bin's lower edge is the next one's upper). Row 0 of the pieces is the bins': their reach, and ½ w."""
    h = coef_mk[0, 0]
    w = 2.0 * h
    length = abs(r)
    store4(k, SCRATCH, z)
    for l in range(SCRATCH + 4, SCRATCH + 8):
        poke(k, l, 0.0)
    for m in range(1, len(radii_m)):
        if radii_m[m] > 0.0 and min(length, w) > SHORT * max(radii_m[m], max(length, w)):
            top = peek(k, SCRATCH) + h
            upper = SECOND(top, m, radii_m, coef_mk) - SECOND(top - r, m, radii_m, coef_mk)
            for l in range(SCRATCH, SCRATCH + 4):
                edge = peek(k, l) - h
                lower = SECOND(edge, m, radii_m, coef_mk) - SECOND(edge - r, m, radii_m, coef_mk)
                poke(k, l + 4, peek(k, l + 4) + (upper - lower) / (w * r))
                upper = lower
        else:
            for l in range(SCRATCH, SCRATCH + 4):
                d = peek(k, l) - 0.5 * r
                mean = SHORT_MEAN(d, max(length, w), min(length, w), radii_m, coef_mk, m)
                poke(k, l + 4, peek(k, l + 4) + mean)
    return load4(k, SCRATCH + 4)


def _constants(r, radii_m, coef_mk, k_):
    k_[0] = 0.0


@cache
def in_bins(compiled: CompiledProfile) -> CompiledProfile:
    """The compiled functions of a profile's means over bins."""
    short = specialise(_short, compiled.name, JIT_FMA, INTEGRAL=compiled.integral)
    mean = specialise(_mean, compiled.name, JIT_FMA, SECOND=compiled.second, SHORT_MEAN=short)
    return CompiledProfile(f"{compiled.name}_bins", specialise(_constants, compiled.name, JIT_FMA), mean)


@dataclass(frozen=True)
class Binned:
    """A `Profile`: that of a kernel, `of`, averaged over bins of this width around z."""

    of: object
    width: float

    @property
    def compiled(self) -> CompiledProfile:
        return in_bins(self.of.compiled)

    @property
    def pieces(self):
        radii, coef = self.of.bin_pieces
        first = np.zeros((1, max(coef.shape[1], 1)))
        first[0, 0] = 0.5 * self.width
        return np.concatenate([[self.support], radii]), np.concatenate([first, coef])

    @property
    def support(self) -> float:
        return self.of.support + 0.5 * self.width

    def phi(self, z):
        z, h = np.asarray(z, float), 0.5 * self.width
        return (self.of.cumulative(z + h) - self.of.cumulative(z - h)) / self.width

    def slope(self, z):
        z, h = np.asarray(z, float), 0.5 * self.width
        return (self.of.phi(z + h) - self.of.phi(z - h)) / self.width

    def cumulative(self, z):
        z, h = np.asarray(z, float), 0.5 * self.width
        return 0.5 + (self.of.second(z + h) - self.of.second(z - h)) / self.width

    def beta(self, d, r):
        """By J, and for short bonds (whose kinks are looked for by the compiled functions) by many points."""
        d, r = np.broadcast_arrays(np.asarray(d, float), np.asarray(r, float))
        h = 0.5 * self.width
        wide = np.maximum(np.abs(r), self.width)
        long = np.minimum(np.abs(r), self.width) > SHORT * np.maximum(self.of.support, wide)
        s = np.where(long, r, 1.0)
        upper = self.of.second(d + h) - self.of.second(d - s + h)
        lower = self.of.second(d - h) - self.of.second(d - s - h)
        short = sum(w * self.phi(d - t * r) for t, w in zip(GL_T, GL_W))
        return np.where(long, (upper - lower) / (self.width * s), short)


def profile_of(kernel, bound):
    """The profile that sums on a slab grid are made with: of points at the middle of bins, or of their means."""
    axis, cell = bound.axis, bound.cell
    profile = kernel.marginal(cell.inverse[:, axis] * cell.heights[axis])
    return Binned(profile, cell.heights[axis] / bound.shape[0]) if bound.means else profile
