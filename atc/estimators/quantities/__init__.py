"""The quantities that atc knows, by kind: one entry a quantity, in one file.

A new one of sums that there are (`..summed`) is an entry here, or `registry.register` from outside.
"""

from . import density, energy, heat, kinematics, peridynamic, stress

QUANTITIES = [
    *density.QUANTITIES,
    *stress.QUANTITIES,
    *energy.QUANTITIES,
    *heat.QUANTITIES,
    *kinematics.QUANTITIES,
    *peridynamic.QUANTITIES,
]
