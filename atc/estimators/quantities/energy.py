"""Energy, and what force and power come in from outside."""

from __future__ import annotations

from .quantity import Quantity

QUANTITIES = [
    Quantity(
        "energy_kinetic",
        "energy_density",
        "kinetic energy density",
        lambda s: s.site["kinetic_energy"][:, 0],
        site=("kinetic_energy",),
        sign="positive",
        linear=True,
        comment="in the frame of the simulation, streaming motion included",
    ),
    Quantity(
        "energy_potential",
        "energy_density",
        "potential energy density",
        lambda s: s.site["potential_energy"][:, 0],
        site=("potential_energy",),
        linear=True,
        sign="the potential's own zero",
        comment="each K-body term shared equally by its K atoms, unless the potential documents another share",
    ),
    Quantity(
        "energy",
        "energy_density",
        "energy density",
        lambda s: s.site["kinetic_energy"][:, 0] + s.site["potential_energy"][:, 0],
        site=("kinetic_energy", "potential_energy"),
        parts=("energy_kinetic", "energy_potential"),
        sign="the potential's own zero",
    ),
    Quantity(
        "body_force",
        "force_density",
        "force density from outside",
        lambda s: s.site["outside_force"],
        rank=1,
        site=("outside_force",),
        linear=True,
        sign="positive along +x, +y, +z; d(momentum)/dt + div(density velocity velocity) = div(stress) + body_force",
        comment="walls, fields, friction and whatever else acts on atoms from outside: see body_force_source",
    ),
    Quantity(
        "body_power",
        "power_density",
        "power density of the forces from outside",
        lambda s: s.site["outside_power"][:, 0],
        site=("outside_power",),
        linear=True,
        sign="positive where energy is put in",
        comment="sum of force times velocity of the atoms, in the frame of the simulation",
    ),
]
