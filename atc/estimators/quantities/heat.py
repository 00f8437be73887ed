"""Heat: its flux and the parts of it, the churning tensor, the heat current of the box (formulas.md §4)."""

from __future__ import annotations

import numpy as np

from .quantity import MEAN, SHARED, VELOCITY, Quantity, largest

_FLUX_SIGN = "positive in the direction energy flows"
_CHURNING_SIGN = (
    "that of stress_potential; component [i, j]: i the divergence direction, j is contracted with the velocity in "
    "heat_flux_churning; not symmetric"
)
_THERMAL = (*MEAN, "kinetic", "kinetic_flux", "potential_energy", "potential_flux")


def _flux(long_name, form, **more):
    return {"dimension": "energy_flux", "rank": 1, "sign": _FLUX_SIGN, "long_name": long_name, "form": form, **more}


QUANTITIES = [
    Quantity(
        "heat_flux_kinetic",
        site=_THERMAL,
        masked=True,
        **_flux(
            "kinetic part of the heat flux",
            lambda s: s.heat_flux_kinetic,
            comment="energy carried by atoms relative to the local velocity: J - e v + stress_kinetic v; " + SHARED,
        ),
    ),
    Quantity(
        "heat_flux_potential",
        site=MEAN,
        bond=("power", "sources"),
        masked=True,
        **_flux(
            "potential part of the heat flux",
            lambda s: s.heat_flux_potential,
            comment="A - M v: work of the bonds relative to the local velocity; " + SHARED,
        ),
    ),
    Quantity(
        "heat_flux_churning",
        site=MEAN,
        bond=("stress", "sources"),
        masked=True,
        scale=lambda s: largest(s.potential_stress) * largest(s.velocity),
        **_flux(
            "churning part of the heat flux",
            lambda s: s.heat_flux_churning,
            comment="churning tensor times velocity, in the frame of the simulation: a uniform drift c adds z c, "
            "which has no divergence and no mean over "
            "a periodic box; 0 for pair potentials and embedded atoms; " + SHARED,
        ),
    ),
    Quantity(
        "heat_flux",
        site=_THERMAL,
        bond=("power", "sources", "stress"),
        masked=True,
        parts=("heat_flux_kinetic", "heat_flux_potential", "heat_flux_churning"),
        **_flux(
            "heat flux",
            lambda s: s.heat_flux_kinetic + s.heat_flux_potential + s.heat_flux_churning,
            comment="q in d(energy)/dt + div(energy v) = div(stress v - q); " + SHARED,
        ),
    ),
    Quantity(
        "energy_flux",
        site=("energy_current",),
        bond=("power_lab",),
        linear=True,
        **_flux(
            "flux of energy through points at rest",
            lambda s: s.site["energy_current"] + s.bond["power_lab"],
            comment="J + A = energy v - stress v + heat_flux (the stress relative to the local velocity as it is), in "
            "the frame of the simulation: d(energy)/dt = "
            "-div(energy_flux); its integral over the box is "
            "heat_current; " + SHARED,
        ),
    ),
    Quantity(
        "churning",
        "energy_density",
        "churning tensor",
        lambda s: s.churning,
        rank=2,
        bond=("stress", "sources"),
        sign=_CHURNING_SIGN,
        linear=True,
        scale=lambda s: largest(s.potential_stress),
        comment="z = S + M: what the potential stress and the energy sources of the bonds leave of each other; has no "
        "divergence and no mean over a periodic "
        "box; 0 for pair potentials and embedded atoms; " + SHARED,
    ),
    Quantity(
        "churning_divergence",
        "force_density",
        "divergence of the churning tensor",
        lambda s: s.site["source_residual"][:, :3],
        rank=1,
        site=("source_residual",),
        linear=True,
        scale=lambda s: largest(s.site["source_residual"][:, 3]),
        sign="component j: sum over i of d churning[i, j]/dx_i",
        comment="0 up to rounding: in closed form the force on each atom minus the force that follows from the energy "
        "sources, so this checks the decomposition",
    ),
    Quantity(
        "churning_heat_source",
        "power_density",
        "churning heat source",
        lambda s: np.einsum("gij,gij->g", s.churning, s.velocity_gradient),
        masked=True,
        bond=("stress", "sources"),
        gradient=True,
        **VELOCITY,
        scale=lambda s: largest(s.potential_stress) * largest(s.velocity_gradient),
        sign="positive where the churning part of the heat flux diverges: it takes energy away there",
        comment="z : grad v = div(heat_flux_churning), since z has no divergence; " + SHARED,
    ),
    Quantity(
        "heat_current_convective",
        "energy_current",
        "convective part of the heat current of the box",
        lambda s: s.whole["box_convection"],
        rank=1,
        kind="box",
        whole=("box_convection",),
        sign=_FLUX_SIGN,
        comment="sum of e_j v_j; velocities in the frame of the simulation; " + SHARED,
    ),
    Quantity(
        "heat_current_potential",
        "energy_current",
        "potential part of the heat current of the box",
        lambda s: s.whole["box_power"],
        rank=1,
        kind="box",
        whole=("box_power",),
        sign=_FLUX_SIGN,
        comment="sum over ordered pairs of (v_k . dU_j/dx_k) x_jk; velocities "
        "in the frame of the simulation; " + SHARED,
    ),
    Quantity(
        "heat_current",
        "energy_current",
        "heat current of the box",
        lambda s: s.whole["box_convection"] + s.whole["box_power"],
        rank=1,
        kind="box",
        whole=("box_convection", "box_power"),
        parts=("heat_current_convective", "heat_current_potential"),
        sign=_FLUX_SIGN,
        comment="rate of change of the sum of e_j x_j, heat flux times volume; velocities in the frame of the "
        "simulation, so that a box with momentum "
        "carries its energy along: remove the momentum before a Green-Kubo integral; " + SHARED,
    ),
]
