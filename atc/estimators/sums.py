"""The finished sums of one frame at the grid points, and the algebra that turns them into fields (formulas: R
4.0.78-4.0.104).

Symmetric tensors travel as 6 components in the order xx, yy, zz, yz, xz, xy.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .tensors import eshelby, full, general, kinetic_flux, kinetic_flux_about, quotient, quotient_gradient, thermal

#: A number density n − Σ m φ²/ρ below this share of n is that of an atom alone: it is known to 1e-13 of n or so.
LONE = 1e-6


@dataclass
class Sums:
    """Site sums Σ a φ and bond sums Σ b β at the grid points, plus sums over the whole frame; internal units.

    The velocity-dependent site sums are taken with v' = v − drift, drift the mass-mean velocity of the frame: T − ρ
    v⊗v, a small difference of large numbers in a drifting frame, does not change under that shift, nor does the kinetic
    part of the heat flux. `thermal_shifted` and `kinetic_flux_shifted`, when set, were computed with further local
    shifts where one drift was not enough (see atom_pass.local_shifts).
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
    # What thermal motion is relative to (see `settings`), and Σ m φ² by name.
    velocities: str = "local"
    squared: dict[str, np.ndarray] = field(default_factory=dict)
    thermal_shifted: np.ndarray | None = None
    thermal_all_shifted: np.ndarray | None = None
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

    # --- what velocities are relative to: of a part, the mean velocity of all parts
    @property
    def of_part(self) -> bool:
        """Whether the sums are those of one species, or molecule, of several."""
        return "all_mass" in self.site

    @cached_property
    def anywhere(self) -> np.ndarray:
        """(g,) whether there is mass of any part at the point: what is relative to the local velocity is known
        there."""
        return self.site["all_mass"][:, 0] > 0 if self.of_part else self.defined

    @cached_property
    def stream(self) -> np.ndarray:
        """(g, 3) the local velocity − drift, 0 where there is no mass: that of all parts."""
        return quotient(self.site["all_momentum"], self.site["all_mass"][:, 0]) if self.of_part else self.peculiar

    @property
    def stream_velocity(self) -> np.ndarray:
        """(g, 3) the local velocity, 0 where there is no mass."""
        return np.where(self.anywhere[:, None], self.stream + self.drift, 0.0) if self.of_part else self.velocity

    @property
    def potential_stress(self) -> np.ndarray:
        """(g, 3, 3) Σ −r⊗F β."""
        return general(self.bond["moment"]) if "moment" in self.bond else full(self.bond["stress"])

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
        about = (self.stream,) if self.of_part else ()
        return thermal(self.site["mass"], self.site["momentum"], self.site["kinetic"], *about)

    # --- unbiased: the local velocity, of few atoms, follows their thermal motion
    @property
    def of_all(self) -> Sums:
        """The sums over the atoms of all parts that thermal motion is made of."""
        names = [name for name in self.site if name.startswith("all_")]
        whole = Sums({name.removeprefix("all_"): self.site[name] for name in names}, drift=self.drift)
        whole.thermal_shifted = self.thermal_all_shifted
        return whole

    @property
    def all_number(self) -> np.ndarray:
        """(g,) number density of all parts."""
        return self.site["all_one" if self.of_part else "one"][:, 0]

    @cached_property
    def lost(self) -> np.ndarray:
        """(g,) how much of the number density n thermal motion relative to the local velocity u lacks: for independent
        velocities of one temperature <Σ m |v_j − u|² φ> = 3 k_B T (n − Σ m φ²/ρ). Of a part, with u that of all:
        2 Σ_s m φ²/ρ − ρ_s Σ m φ²/ρ²."""
        s2 = self.squared["mass"][:, 0]
        if not self.of_part:
            return quotient(s2, self.rho)
        rho = self.site["all_mass"][:, 0]
        return 2.0 * quotient(s2, rho) - quotient(quotient(self.rho * self.squared["all_mass"][:, 0], rho), rho)

    @property
    def seen(self) -> np.ndarray:
        """(g,) the share of thermal motion that is seen relative to the local velocity, 1 − Σ m φ²/(n ρ) of all parts;
        1 where there is no mass."""
        s2 = self.squared["all_mass" if self.of_part else "mass"][:, 0]
        rho = self.site["all_mass"][:, 0] if self.of_part else self.rho
        return 1.0 - quotient(quotient(s2, rho), self.all_number)

    @cached_property
    def _left(self) -> np.ndarray:
        """(g,) n − Σ m φ²/ρ of all parts."""
        s2 = self.squared["all_mass" if self.of_part else "mass"][:, 0]
        rho = self.site["all_mass"][:, 0] if self.of_part else self.rho
        return self.all_number - quotient(s2, rho)

    @property
    def alone(self) -> np.ndarray:
        """(g,) whether no more than one atom is in reach: nothing can be said of thermal motion there."""
        return ~(self._left > LONE * self.all_number)

    @cached_property
    def kinetic_pressure(self) -> np.ndarray:
        """(g, 6) minus the kinetic stress, by what velocities are relative to; 0 where there is no mass. Unbiased:
        P n/(n − Σ m φ²/ρ), what P lacks shared among parts as they lack it."""
        if self.velocities in ("none", "average"):
            at_rest = np.broadcast_to(-self.drift, self.site["momentum"].shape)
            return thermal(self.site["mass"], self.site["momentum"], self.site["kinetic"], at_rest)
        if self.velocities == "local":
            return self.thermal
        P = self.of_all.thermal if self.of_part else self.thermal
        share = np.where(self.alone, 0.0, quotient(self.lost, np.where(self.alone, 0.0, self._left)))
        return self.thermal + P * share[:, None]

    def count_freedom(self) -> None:
        """Make the degrees of freedom those that thermal motion relative to the local velocity has."""
        if self.velocities != "frame" or "degrees" not in self.site:
            return
        free = self.site["degrees"][:, 0] - self.lost
        self.site["degrees"] = np.where(free > LONE * self.site["degrees"][:, 0], free, 0.0)[:, None]

    @cached_property
    def temperature(self) -> np.ndarray:
        """(g,) trace(T − ρ v⊗v)/(d n k_B), d degrees of freedom per atom (fewer with constraints; n − Σ m φ²/ρ in place
        of n where it is unbiased), 0 where there is no mass."""
        return quotient(
            (self.thermal if self.velocities in ("local", "frame") else self.kinetic_pressure)[:, :3].sum(1)
            / (float(self.dimension) * self.boltzmann),
            np.where(self.defined, self.site["degrees"][:, 0], 0.0),
        )

    # --- heat (formulas.md §4; v' = v − drift, w = v_j − v(x), u = v(x) − drift)
    @cached_property
    def heat_flux_kinetic(self) -> np.ndarray:
        """(g, 3) q_K = J − ε v + σ_K·v = Σ (½ m w² + U_j) w φ, 0 where there is no mass."""
        kinetic = self.kinetic_flux_of_drift if self.kinetic_flux_shifted is None else self.kinetic_flux_shifted
        carried = self.site["potential_flux"] - self.site["potential_energy"] * self.stream
        return np.where(self.anywhere[:, None], kinetic + carried, 0.0)

    @cached_property
    def kinetic_flux_of_drift(self) -> np.ndarray:
        """(g, 3) Σ ½ m w² w φ from the sums relative to the frame's drift alone."""
        if self.of_part:
            return kinetic_flux_about(
                self.site["mass"], self.site["momentum"], self.site["kinetic"], self.site["kinetic_flux"], self.stream
            )
        return kinetic_flux(self.rho, self.peculiar, self.thermal_of_drift, self.site["kinetic_flux"])

    @cached_property
    def heat_flux_potential(self) -> np.ndarray:
        """(g, 3) q_U = A − M v = A' − M u, 0 where there is no mass."""
        return np.where(self.anywhere[:, None], self.bond["power"] - np.einsum("gij,gj->gi", self._M, self.stream), 0.0)

    @cached_property
    def heat_flux_churning(self) -> np.ndarray:
        """(g, 3) q_C = z v, 0 where there is no mass."""
        return np.einsum("gij,gj->gi", self.churning, self.stream_velocity)

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
    cancel: M = −S."""
    for name, whole in (("stress", full), ("moment", general)):
        if name in bond:
            bond["sources"] = -whole(bond[name]).reshape(-1, 9)
