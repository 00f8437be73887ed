"""The finished sums of one frame at the grid points, and the algebra that turns them into fields (formulas: R
4.0.78-4.0.104).

Symmetric tensors travel as 6 components in the order xx, yy, zz, yz, xz, xy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..compiled import njit
from .kinematics import eshelby, quotient_gradient
from .tensors import full, quotient


@dataclass
class Sums:
    """Site sums Σ a φ and bond sums Σ b β at the grid points, plus sums over the whole frame; internal units.

    The velocity-dependent site sums are taken with v' = v − drift, drift the mass-mean velocity of the frame: T − ρ
    v⊗v, a small difference of large numbers in a drifting frame, does not change under that shift, nor does the kinetic
    part of the heat flux. `thermal_shifted` and `kinetic_flux_shifted`, when set, were computed with further local
    shifts where one drift was not enough (see shifts.local_shifts).
    """

    site: dict[str, np.ndarray] = field(default_factory=dict)
    bond: dict[str, np.ndarray] = field(default_factory=dict)
    whole: dict[str, np.ndarray] = field(default_factory=dict)
    point: dict[str, np.ndarray] = field(default_factory=dict)
    drift: np.ndarray = field(default_factory=lambda: np.zeros(3))
    volume: float = np.nan
    boltzmann: float = np.nan
    # Degrees of freedom of an atom.
    dimension: int = 3
    thermal_shifted: np.ndarray | None = None
    kinetic_flux_shifted: np.ndarray | None = None
    # The largest Σ |G| r² β at the points of the check: what the stress is made of, however much of it cancels.
    size: float = 0.0
    # Sums with the kernel's gradient next to the plain ones: (g, k) and (g, k, 3), the direction of the derivative
    # last.
    gathered: dict[str, np.ndarray] = field(default_factory=dict)
    gradient: dict[str, np.ndarray] = field(default_factory=dict)

    @cached_property
    def rho(self) -> np.ndarray:
        """(g,) mass density."""
        return self.site["mass"][:, 0]

    @cached_property
    def defined(self) -> np.ndarray:
        """(g,) whether there is mass at the point: elsewhere quotients have no meaning."""
        return self.rho > 0

    @property
    def potential_stress(self) -> np.ndarray:
        """(g, 3, 3) Σ −r⊗F β."""
        return self.bond["moment"].reshape(-1, 3, 3) if "moment" in self.bond else full(self.bond["stress"])

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
        """(g,) trace(T − ρ v⊗v)/(d n k_B), d degrees of freedom per atom (fewer with constraints), 0 where there is no
        mass."""
        return quotient(
            self.thermal[:, :3].sum(1) / (float(self.dimension) * self.boltzmann),
            np.where(self.defined, self.site["degrees"][:, 0], 0.0),
        )

    # --- heat (formulas.md §4; v' = v − drift, w = v_j − v(x), u = v(x) − drift)
    @cached_property
    def heat_flux_kinetic(self) -> np.ndarray:
        """(g, 3) q_K = J − ε v + σ_K·v = Σ (½ m w² + U_j) w φ, 0 where there is no mass."""
        kinetic = self.kinetic_flux_of_drift if self.kinetic_flux_shifted is None else self.kinetic_flux_shifted
        carried = self.site["potential_flux"] - self.site["potential_energy"] * self.peculiar
        return np.where(self.defined[:, None], kinetic + carried, 0.0)

    @cached_property
    def kinetic_flux_of_drift(self) -> np.ndarray:
        """(g, 3) Σ ½ m w² w φ from the sums relative to the frame's drift alone."""
        return kinetic_flux(self.rho, self.peculiar, self.thermal_of_drift, self.site["kinetic_flux"])

    @cached_property
    def heat_flux_potential(self) -> np.ndarray:
        """(g, 3) q_U = A − M v = A' − M u, 0 where there is no mass."""
        return np.where(
            self.defined[:, None], self.bond["power"] - np.einsum("gij,gj->gi", self._M, self.peculiar), 0.0
        )

    @cached_property
    def heat_flux_churning(self) -> np.ndarray:
        """(g, 3) q_C = z v, 0 where there is no mass."""
        return np.einsum("gij,gj->gi", self.churning, self.velocity)

    @property
    def _M(self) -> np.ndarray:
        return self.bond["sources"].reshape(-1, 3, 3)

    @cached_property
    def churning(self) -> np.ndarray:
        """(g, 3, 3) z = S + M."""
        return self.potential_stress + self._M

    @cached_property
    def velocity_gradient(self) -> np.ndarray:
        """(g, 3, 3) [i, j] = ∂v_j/∂x_i = (∂_i π_j − v_j ∂_i ρ)/ρ, 0 where there is no mass."""
        return quotient_gradient(self.rho, self.peculiar, self.gradient["mass"], self.gradient["momentum"])

    # --- relative to a reference frame
    @cached_property
    def displacement(self) -> np.ndarray:
        """(g, 3) Σ m u φ / ρ over current positions, 0 where there is no mass."""
        return quotient(self.gathered["displacement"], self.gathered["mass"][:, 0])

    @cached_property
    def displacement_gradient(self) -> np.ndarray:
        """(g, 3, 3) [i, j] = ∂u_j/∂x_i."""
        return quotient_gradient(
            self.gathered["mass"][:, 0], self.displacement, self.gradient["mass"], self.gradient["displacement"]
        )

    @cached_property
    def eshelby(self) -> np.ndarray:
        """(g, 3, 3) W I − P (Grad u)ᵀ over reference positions; NaN where no mass is in reach (always the same
        points)."""
        rho = self.gathered["reference_mass"][:, 0]
        u = quotient(self.gathered["reference_displacement"], rho)
        H = quotient_gradient(rho, u, self.gradient["reference_mass"], self.gradient["reference_displacement"])
        out = eshelby(self.gathered["reference_energy"][:, 0], self.bond["piola"].reshape(-1, 3, 3), H)
        out[~(rho > 0)] = np.nan
        return out


def churn_nothing(bond: dict) -> None:
    """z = S + M is 0 identically for pairs and for edges of atoms' energies, not only as far as two approximate sums
    cancel: make M = −S."""
    if "sources" in bond:
        if "moment" in bond:
            bond["sources"] = -bond["moment"]
        elif "stress" in bond:
            bond["sources"] = -full(bond["stress"]).reshape(-1, 9)


def curl(gradient_gcc) -> np.ndarray:
    """(g, 3) ε_ijk ∂_j v_k from [j, k] = ∂_j v_k."""
    L = gradient_gcc
    return np.stack([L[:, 1, 2] - L[:, 2, 1], L[:, 2, 0] - L[:, 0, 2], L[:, 0, 1] - L[:, 1, 0]], axis=1)


def kinetic_flux(rho, u_gc, thermal_g6, flux_gc) -> np.ndarray:
    """Σ ½ m |c − u|² (c − u) φ from ρ, u = Σ m c φ/ρ, Σ m (c − u)⊗(c − u) φ and Σ ½ m c² c φ; 0 where there is no
    mass."""
    half_trace = 0.5 * thermal_g6[:, :3].sum(1, keepdims=True)
    streaming = 0.5 * rho[:, None] * np.einsum("gc,gc->g", u_gc, u_gc)[:, None]
    out = flux_gc - (half_trace + streaming) * u_gc - np.einsum("gij,gj->gi", full(thermal_g6), u_gc)
    out[~(rho > 0)] = 0.0
    return out


def thermal(mass_g1, momentum_gc, kinetic_g6) -> np.ndarray:
    """T − π⊗π/ρ as 6 components; its diagonal is a sum of squares, so what rounding leaves below 0 is cut off."""
    out = np.empty((len(mass_g1), 6))
    # Contiguous: for views of columns the kernel would be compiled once more.
    _thermal(*(np.ascontiguousarray(a) for a in (mass_g1, momentum_gc, kinetic_g6)), out)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _thermal(mass_g1, momentum_gc, kinetic_g6, out):
    for g in range(len(out)):
        m = mass_g1[g, 0]
        if not m > 0:
            out[g, :] = 0.0
            continue
        x, y, z = momentum_gc[g, 0] / m, momentum_gc[g, 1] / m, momentum_gc[g, 2] / m
        out[g, 0] = max(kinetic_g6[g, 0] - x * x * m, 0.0)
        out[g, 1] = max(kinetic_g6[g, 1] - y * y * m, 0.0)
        out[g, 2] = max(kinetic_g6[g, 2] - z * z * m, 0.0)
        out[g, 3] = kinetic_g6[g, 3] - y * z * m
        out[g, 4] = kinetic_g6[g, 4] - x * z * m
        out[g, 5] = kinetic_g6[g, 5] - x * y * m


@njit(cache=True, nogil=True, error_model="numpy")
def within_thermal(rho_g, v_gc, thermal_g6, limit) -> bool:
    """Whether the speed is no more than so many thermal speeds wherever there is mass."""
    for g in range(len(rho_g)):
        if rho_g[g] > 0:
            v2 = v_gc[g, 0] ** 2 + v_gc[g, 1] ** 2 + v_gc[g, 2] ** 2
            heat = (thermal_g6[g, 0] + thermal_g6[g, 1] + thermal_g6[g, 2]) / rho_g[g]
            if not v2 <= limit * limit * heat:
                return False
    return True
