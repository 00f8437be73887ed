"""Materials of peridynamic bodies, one file each. `MATERIALS` is the table over which every invariance test loops."""

from .base import INFLUENCE, BondForces, Material
from .pmb import PMB

__all__ = ["INFLUENCE", "MATERIALS", "PMB", "BondForces", "Material"]

# name: a function (bulk, shear) → material; bond-based ones ignore the shear modulus.
MATERIALS = {
    "pmb": lambda bulk, shear: PMB(bulk),
}
