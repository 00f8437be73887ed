"""Kernels of nonlocal advection on a grid: φ_a(z) = C z b(|z|/δ), odd, and φ_s(z) = C b(|z|/δ), even."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..errors import AtcError

KERNELS = ("box", "triangle", "gaussian")


_SHAPES: dict[str, tuple[Callable, float]] = {
    # even profiles b(|z|/δ), and where they end in units of δ
    "box": (lambda s: np.ones_like(s), 1.0),
    "triangle": (lambda s: 1 - s, 1.0),
    "gaussian": (lambda s: np.exp(-4.5 * s * s), 3.0),  # standard deviation δ/3, cut where it is 3e-18
}


@dataclass(frozen=True)
class Kernel:
    """Discrete φ_a(z) = C z b(|z|/δ) and φ_s(z) = C b(|z|/δ) on a grid, both with their moments exactly 2; φ_s has a
    profile and a horizon of its own where they are given.

    Parameters
    ----------
    shape : str or function
        ``box``, ``triangle``, ``gaussian`` (standard deviation δ/3), or b(s) ≥ 0 on 0 ≤ s ≤ 1, vectorised.
    horizon : float
        δ.
    spacing : float
        Of the grid. Weights are cell averages of b, so δ need not be a multiple; it has to reach the next node.
    smoothing_shape, smoothing_horizon : of φ_s, by default those of φ_a
    """

    shape: str | Callable
    horizon: float
    spacing: float
    smoothing_shape: str | Callable | None = None
    smoothing_horizon: float | None = None

    def __post_init__(self):
        for name in ("horizon", "spacing", "smoothing_horizon"):
            value = getattr(self, name)
            if value is None and name == "smoothing_horizon":
                continue
            if not (isinstance(value, (int, float, np.number)) and math.isfinite(value) and value > 0):
                raise AtcError(f"{name} = {value!r}: expected a length greater than 0")
        for shape in (self.shape, self.smoothing_shape):
            if isinstance(shape, str) and shape not in _SHAPES:
                raise AtcError(f"kernel {shape!r}: expected {', '.join(KERNELS)} or a function")

    @property
    def smoothed_alike(self) -> bool:
        """Whether φ_s has the profile and horizon of φ_a."""
        return self.smoothing_shape is None and self.smoothing_horizon is None

    @cached_property
    def profile_m(self) -> np.ndarray:
        """C b of φ_a averaged over the cells m = 1 … M, times the spacing."""
        return self._profile(self.shape, self.horizon)

    @cached_property
    def smoothing_m(self) -> np.ndarray:
        """C b of φ_s averaged over its cells, times the spacing."""
        if self.smoothed_alike:
            return self.profile_m
        shape = self.shape if self.smoothing_shape is None else self.smoothing_shape
        return self._profile(shape, self.horizon if self.smoothing_horizon is None else self.smoothing_horizon)

    def _profile(self, shape, horizon):
        b, end = _SHAPES[shape] if isinstance(shape, str) else (shape, 1.0)
        reach, dx = horizon * end, self.spacing
        M = math.ceil(reach / dx - 0.5 - 1e-9)
        if M < 1:
            raise AtcError(
                f"horizon = {horizon:g}: does not reach the next node at {dx:g}; take more nodes or a longer horizon"
            )
        m = np.arange(1, M + 1)
        left, right = (m - 0.5) * dx, np.minimum((m + 0.5) * dx, reach)
        nodes, weights = np.polynomial.legendre.leggauss(8)
        z = 0.5 * (left + right)[:, None] + 0.5 * (right - left)[:, None] * nodes
        values = np.asarray(b(z / horizon), dtype=float)
        if values.shape != z.shape or not np.isfinite(values).all():
            raise AtcError(
                "the kernel's profile: expected a finite number for every distance between 0 and the horizon"
            )
        if values.min() < 0:
            raise AtcError(
                "the kernel's profile is negative somewhere: φ_s must be 0 or greater, or the regularisation amplifies"
            )
        w = 0.5 * (right - left) * (values @ weights)
        second = 2 * (w * (m * dx) ** 2).sum()
        if not second > 0:
            raise AtcError("the kernel's profile is zero everywhere")
        return w * 2 / second

    @property
    def neighbors(self) -> int:
        """M, of the kernel that reaches further."""
        return max(len(self.profile_m), len(self.smoothing_m))

    @property
    def odd_m(self) -> np.ndarray:
        """φ_a Δx at z = mΔx, m = 1 … M (at −m the negative)."""
        return self._padded(self.profile_m) * np.arange(1, self.neighbors + 1) * self.spacing

    @property
    def even_m(self) -> np.ndarray:
        """φ_s Δx at z = ±mΔx, m = 1 … M."""
        return self._padded(self.smoothing_m)

    def _padded(self, x_m):
        return np.concatenate([x_m, np.zeros(self.neighbors - len(x_m))])

    def advection_symbol(self, k) -> np.ndarray:
        """∫ φ_a(z) sin(kz) dz of the discrete kernel: 2k for long waves."""
        m = np.arange(1, self.neighbors + 1)
        return 2 * np.sin(np.multiply.outer(np.asarray(k, dtype=float), m * self.spacing)) @ self.odd_m

    def diffusion_symbol(self, k) -> np.ndarray:
        """λ(k) = ∫ φ_s(z)(1 − cos kz) dz of the discrete kernel, ≥ 0: k² for long waves, bounded for short ones."""
        m = np.arange(1, self.neighbors + 1)
        return 4 * np.sin(np.multiply.outer(np.asarray(k, dtype=float), 0.5 * m * self.spacing)) ** 2 @ self.even_m
