"""Density and motion: of number, mass and momentum, and what temperature the motion has."""

from __future__ import annotations

from .quantity import MEAN, Quantity, largest

QUANTITIES = [
    Quantity(
        "number_density",
        "number_density",
        "number density",
        lambda s: s.site["one"][:, 0],
        site=("one",),
        sign="positive",
        linear=True,
    ),
    Quantity("density", "density", "mass density", lambda s: s.rho, site=("mass",), sign="positive", linear=True),
    Quantity(
        "momentum",
        "momentum",
        "momentum density",
        lambda s: s.momentum,
        rank=1,
        site=MEAN,
        sign="positive along +x, +y, +z",
        linear=True,
    ),
    Quantity(
        "velocity",
        "velocity",
        "mass-averaged velocity",
        lambda s: s.velocity,
        rank=1,
        site=MEAN,
        masked=True,
        weight="mass",
        sign="positive along +x, +y, +z",
        scale=lambda s: largest(s.drift),
        linear=True,
    ),
    Quantity(
        "temperature",
        "temperature",
        "kinetic temperature relative to the local velocity",
        lambda s: s.temperature,
        site=("degrees", *MEAN, "kinetic"),
        masked=True,
        weight="degrees",
        sign="positive",
        comment="-trace(stress_kinetic)/(3 n k_B): three degrees of freedom per atom; where the potential has "
        "constraints those that they leave each atom: the ones whose mean kinetic energy it has",
    ),
]
