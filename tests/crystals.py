"""The two crystals of the dispersion tests, at rest at zero pressure, made once."""

from functools import cache
from pathlib import Path

import atc
from atc.upscaling.crystal import Crystal, relax
from atc.upscaling.elasticity import elastic_constants
from atc.upscaling.force_constants import force_constants

DATA = Path(__file__).resolve().parent.parent / "data"
#: Argon as in the published numbers: sigma 3.40 Å, epsilon 0.0104 eV, cut at 2.5 sigma without a shift.
EPSILON, SIGMA, CUTOFF, MASS = 0.0104, 3.40, 8.5, 39.948
ARGON = f"pair_style lj/cut {CUTOFF}\npair_coeff 1 1 {EPSILON} {SIGMA}"


@cache
def model(name):
    if name == "argon":
        return atc.potential(ARGON, units="metal")
    return atc.potential(f"pair_style sw\npair_coeff * * {DATA / 'silicon_plate' / 'Si.sw'} Si", units="metal")


def start(name, a=None):
    if name == "argon":
        return Crystal.cubic("fcc", a or 5.3, MASS, "metal", symbols="Ar")
    return Crystal.cubic("diamond", a or 5.4, 28.0855, "metal", symbols="Si")


@cache
def crystal(name):
    return relax(start(name), model(name))


@cache
def constants(name):
    return force_constants(crystal(name), model(name))


@cache
def elastic(name):
    return elastic_constants(crystal(name), model(name))
