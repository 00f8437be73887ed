"""The continuum limits of the chains: peridynamics with micromodulus c/|ε|, and the classical wave equation. Dispersion
in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .chain import positive

_SERIES_BELOW = 2.0  # above it γ + ln z − Ci z loses no more than two digits


def cin(z) -> np.ndarray:
    """Cin(z) = ∫₀ᶻ (1 − cos t)/t dt = γ + ln z − Ci(z), for real z, to 1e-15 relative; even in z.

    For |z| < 2 the series Σ (−1)^{n+1} z^{2n}/(2n (2n)!), whose terms do not cancel there; γ + ln z − Ci(z) would.
    """
    from scipy.special import sici

    z = np.abs(np.asarray(z, dtype=float))
    with np.errstate(divide="ignore", invalid="ignore"):
        far = np.euler_gamma + np.log(z) - sici(z)[1]
    return np.where(z < _SERIES_BELOW, 0.25 * z**2 * _small(np.minimum(z, _SERIES_BELOW)), far)


def _small(z):
    """4 Cin(z)/z² by its series, 1 at z = 0; for z ≤ 2."""
    z2 = z * z
    total, factor = np.ones_like(z2), np.ones_like(z2)
    for n in range(2, 14):  # the 14th term is below 1e-19 at z = 2
        factor = -factor * z2 / ((2 * n - 1) * (2 * n))
        total += factor / n
    return total


def cin_ratio(z) -> np.ndarray:
    """4 Cin(z)/z²: the factor of ω²/(c²k²) for peridynamics with kδ = z. Goes to 1 as z → 0, without a 0/0."""
    z = np.abs(np.asarray(z, dtype=float))
    safe = np.maximum(z, _SERIES_BELOW)
    return np.where(z < _SERIES_BELOW, _small(np.minimum(z, _SERIES_BELOW)), 4 * cin(safe) / safe**2)


@dataclass(frozen=True)
class Peridynamics:
    """ρ ü = ∫_{−δ}^{δ} (c/|ε|)(u(x+ε) − u(x)) dε with c = 2K₁/δ² (eqs. 4.3, A.3): ω² = (4K₁/(ρδ²)) Cin(kδ). `horizon` =
    0 is the wave equation."""

    horizon: float
    modulus: float = 1.0
    density: float = 1.0
    name: str = "peridynamics, continuous"

    def __post_init__(self):
        if self.horizon != 0:
            positive("horizon", self.horizon, "a length, 0 or greater")
        positive("modulus", self.modulus)
        positive("density", self.density)

    @property
    def sound_speed(self) -> float:
        return (self.modulus / self.density) ** 0.5

    def frequency_squared(self, k) -> np.ndarray:
        k = np.asarray(k, dtype=float)
        return self.modulus / self.density * k**2 * cin_ratio(k * self.horizon)

    def frequency(self, k) -> np.ndarray:
        """ω(k) ≥ 0; grows without bound, but only as √ln k: short waves hardly move."""
        return np.sqrt(self.frequency_squared(k))

    def group_velocity(self, k) -> np.ndarray:
        """dω/dk = (2K₁/(ρδ²)) (1 − cos kδ)/(k ω), the sound speed at k = 0."""
        k = np.asarray(k, dtype=float)
        if self.horizon == 0:
            return np.full(k.shape, self.sound_speed)
        half = 0.5 * k * self.horizon
        # (1 − cos z)/(z²/2) = sinc²(z/2)
        return self.sound_speed * np.sinc(half / np.pi) ** 2 / np.sqrt(cin_ratio(2 * half))


def wave_equation(modulus: float = 1.0, density: float = 1.0) -> Peridynamics:
    """ρ ü = K₁ u_xx (eq. 4.7), the limit δ → 0."""
    return Peridynamics(0.0, modulus, density, name="wave equation")
