"""The finished sums of one frame at the grid points, and the algebra that turns them into fields (formulas: R 4.0.78-4.0.104).

Symmetric tensors travel as 6 components in the order xx, yy, zz, yz, xz, xy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

_FULL = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def full(a_6) -> np.ndarray:
    """(..., 6) symmetric components xx, yy, zz, yz, xz, xy to (..., 3, 3)."""
    return np.asarray(a_6)[..., _FULL]


def outer6(v_nc) -> np.ndarray:
    """v⊗v as 6 components, (n, 3) to (n, 6)."""
    x, y, z = v_nc.T
    return np.stack([x * x, y * y, z * z, y * z, x * z, x * y], axis=1)


@dataclass
class Sums:
    """Site sums Σ a φ and bond sums Σ b β at the grid points, plus sums over the whole frame; internal units.

    The velocity-dependent site sums are taken with v' = v − drift, drift the mass-mean velocity of the frame: T − ρ v⊗v, a small
    difference of large numbers in a drifting frame, does not change under that shift. `thermal_shifted`, when set, is T − ρ v⊗v
    computed with further local shifts where one drift was not enough (see compute.local_shifts).
    """

    site: dict[str, np.ndarray] = field(default_factory=dict)
    bond: dict[str, np.ndarray] = field(default_factory=dict)
    whole: dict[str, np.ndarray] = field(default_factory=dict)
    drift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    volume: float = np.nan
    boltzmann: float = np.nan
    thermal_shifted: np.ndarray | None = None

    @cached_property
    def rho(self) -> np.ndarray:
        """(g,) mass density."""
        return self.site["mass"][:, 0]

    @cached_property
    def defined(self) -> np.ndarray:
        """(g,) whether there is mass at the point: elsewhere quotients have no meaning."""
        return self.rho > 0

    @cached_property
    def momentum(self) -> np.ndarray:
        """(g, 3) π = Σ m v φ."""
        return self.site["momentum"] + self.site["mass"] * self.drift

    @cached_property
    def peculiar(self) -> np.ndarray:
        """(g, 3) v(x) − drift, 0 where there is no mass."""
        return quotient(self.site["momentum"], self.rho)

    @cached_property
    def velocity(self) -> np.ndarray:
        """(g, 3) v = π/ρ, 0 where there is no mass."""
        return np.where(self.defined[:, None], self.peculiar + self.drift, 0.0)

    @property
    def thermal(self) -> np.ndarray:
        """(g, 6) T − ρ v⊗v = Σ m (v_j − v(x))⊗(v_j − v(x)) φ_j, 0 where there is no mass."""
        return self.thermal_of_drift if self.thermal_shifted is None else self.thermal_shifted

    @cached_property
    def thermal_of_drift(self) -> np.ndarray:
        """`thermal` from the sums relative to the frame's drift alone."""
        return thermal(self.site["mass"], self.site["momentum"], self.site["kinetic"])

    @cached_property
    def temperature(self) -> np.ndarray:
        """(g,) trace(T − ρ v⊗v)/(3 n k_B), 0 where there is no mass."""
        return quotient(self.thermal[:, :3].sum(1) / (3.0 * self.boltzmann), np.where(self.defined, self.site["one"][:, 0], 0.0))


def quotient(a, w) -> np.ndarray:
    """a/w along the first axis, 0 where w is not positive."""
    w = w.reshape((-1,) + (1,) * (a.ndim - 1))
    return np.divide(a, w, out=np.zeros_like(a), where=w > 0)


def thermal(mass_g1, momentum_gc, kinetic_g6) -> np.ndarray:
    """T − π⊗π/ρ as 6 components; its diagonal is a sum of squares, so what rounding leaves below 0 is cut off."""
    rho = mass_g1[:, 0]
    v = quotient(momentum_gc, rho)
    out = kinetic_g6 - outer6(v) * mass_g1
    np.maximum(out[:, :3], 0.0, out=out[:, :3])
    out[~(rho > 0)] = 0.0
    return out
