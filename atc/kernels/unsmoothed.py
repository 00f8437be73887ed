"""No kernel: atoms and bonds where they are, which only means over bins can be made of (Irving & Kirkwood in bins: what
a bond has in a bin is its fraction there).
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from ..simd import JIT_FMA
from .base import Kernel
from .profile import CompiledProfile, reciprocals


class Unsmoothed(Kernel):
    """δ. Not one that users name: what slab profiles of means over bins have without a kernel."""

    name, aliases, takes = "none", (), ()
    jumps, smooth = True, False
    radius = support = 0.0

    @property
    def parameters(self):
        return {}

    def scaled(self, factor):
        return self

    def in_dimension(self, dimension):
        return self

    def phi(self, d):
        raise AtcError("without a kernel there are means over bins only: give one, or a slab profile with means = true")

    def describe(self):
        return "none: atoms and bonds as they are"

    def marginal(self, normal=(0.0, 0.0, 1.0)):
        return Point()


@njit(**JIT_FMA)
def _integral(z, m, radii_m, coef_mk):
    """∫₀^z δ: half of it on either side; what is on an edge belongs to the bin above."""
    return 0.5 if z >= 0.0 else -0.5


@njit(**JIT_FMA)
def _second(z, m, radii_m, coef_mk):
    return 0.5 * abs(z)


_COMPILED = CompiledProfile("point", reciprocals, None, _integral, _second)  # type: ignore[arg-type]


class Point:
    """δ(z), a profile that has means over bins only."""

    support = 0.0
    compiled = _COMPILED
    pieces = bin_pieces = np.zeros(1), np.ones((1, 1))

    def phi(self, z):
        raise AtcError("without a kernel profiles have no derivative: give a smooth kernel")

    slope = phi

    def cumulative(self, z):
        return np.where(np.asarray(z, float) >= 0.0, 1.0, 0.0)

    def second(self, z):
        return 0.5 * np.abs(np.asarray(z, float))
