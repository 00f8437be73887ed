"""The balance laws at points, and their residuals in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .points import Sites
from .rates import Motion

LAWS = ("mass", "momentum", "energy", "churning")
#: What the residuals are: the unit of each law's terms is this dimension's divided by this one's.
DIMENSIONS = {
    "mass": ("density", "time"),
    "momentum": ("force_density", None),
    "energy": ("energy_density", "time"),
    "churning": ("force_density", None),
}


@dataclass
class Law:
    """One balance law at points.

    terms : {name: (g,) or (g, 3)}, what the law adds up, internal units
    residual : the law's left side minus its right
    without : the same without the churning heat flux (energy only)
    limit : (g,) error of the residual as far as the way of computing it knows it, or None
    """

    terms: dict[str, np.ndarray]
    residual: np.ndarray
    without: np.ndarray | None = None
    limit: np.ndarray | None = None

    @property
    def largest(self) -> tuple[str, float]:
        """The largest term and its size anywhere."""
        sizes = {name: float(size(t).max(initial=0.0)) for name, t in self.terms.items()}
        name = max(sizes, key=sizes.get)
        return name, sizes[name]


def size(a) -> np.ndarray:
    """(g,) Euclidean norms of numbers, vectors or tensors at points."""
    return np.sqrt((np.asarray(a).reshape(len(a), -1) ** 2).sum(1))


@dataclass
class Exact:
    """Sums at points with their exact rates and gradients, and what follows from them; axes g point, then µ, ν."""

    sites: Sites
    state: Motion
    bond_g21: np.ndarray

    def __post_init__(self):
        s, st = self.sites, self.state
        m, v, e = st.frame.masses, st.v_nc, st.total_n
        mv = m[:, None] * v
        self.rho, self.drho = s.sum(m), s.grad(m)
        self.pi, self.dpi = s.sum(mv), s.grad(mv)
        mvv = mv[:, :, None] * v[:, None, :]
        self.T, self.divT = s.sum(mvv), s.div(mvv)
        self.energy, self.denergy = s.sum(e), s.grad(e)
        ev = e[:, None] * v
        self.divJ = s.div(ev)
        self.v = self.pi / self.rho[:, None]
        self.gradv = (
            self.dpi / self.rho[:, None, None] - self.drho[:, :, None] * self.v[:, None, :] / self.rho[:, None, None]
        )
        # rates: each sum changes because its atoms' φ and its atoms' factors change
        self.rho_t = -s.div(mv)
        self.pi_t = s.sum(-st.slope_nc) - s.div(v[:, :, None] * mv[:, None, :])
        power = np.einsum("nc,nc->n", v, st.forces_nc)
        self.energy_t = s.sum(power + st.share_rate_n) - s.div(ev)
        # what acts from outside, and its power
        outside_nc = np.zeros_like(v) if st.outside_nc is None else st.outside_nc
        self.body, self.body_power = s.sum(outside_nc), s.sum(np.einsum("nc,nc->n", v, outside_nc))
        self.pi_t, self.energy_t = self.pi_t + self.body, self.energy_t + self.body_power
        self.S = self.bond_g21[:, :9].reshape(-1, 3, 3)
        self.z = self.S + self.bond_g21[:, 12:].reshape(-1, 3, 3)

    def laws(self) -> dict[str, Law]:
        """Every law with its terms. A term is the whole expression under one ∇· or ∂/∂t, as the laws are written
        above."""
        s, st, v = self.sites, self.state, self.v
        force = s.sum(st.forces_nc)  # ∇·σ_U
        div_z = force + s.sum(st.torque_nc)
        convection = np.einsum("g,gc->gc", np.einsum("gmm->g", self.dpi) - np.einsum("gm,gm->g", v, self.drho), v)
        convection += np.einsum("gm,gmc->gc", v, self.dpi)
        div_stress = force - self.divT + convection
        stress = self.S - self.T + self.pi[:, :, None] * v[:, None, :]
        work = np.einsum("gc,gc->g", div_stress, v) + np.einsum("gmn,gmn->g", stress, self.gradv)
        carried = self.energy * np.einsum("gmm->g", self.gradv) + np.einsum("gm,gm->g", v, self.denergy)
        div_A = s.sum(st.flux_n)
        # J + A is ε v − σ·v + q
        div_q = self.divJ + div_A - carried + work
        div_qC = np.einsum("gc,gc->g", div_z, v) + np.einsum("gmn,gmn->g", self.z, self.gradv)
        div_pi = np.einsum("gmm->g", self.dpi)
        residual = self.energy_t + carried - work + div_q - self.body_power
        acting = st.outside_nc is not None
        return {
            "mass": Law({"d(rho)/dt": self.rho_t, "div(rho v)": div_pi}, self.rho_t + div_pi),
            "momentum": Law(
                {"d(rho v)/dt": self.pi_t, "div(rho v v)": convection, "div(stress)": div_stress}
                | ({"body force": self.body} if acting else {}),
                self.pi_t + convection - div_stress - self.body,
            ),
            "energy": Law(
                {"d(e)/dt": self.energy_t, "div(e v)": carried, "div(stress.v)": work, "div(q)": div_q}
                | ({"power of body force": self.body_power} if acting else {}),
                residual,
                residual - div_qC,
            ),
            "churning": Law(
                {"div(stress_potential)": force, "div(z) - div(stress_potential)": s.sum(st.torque_nc)}, div_z
            ),
        }
