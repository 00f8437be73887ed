"""Materials of peridynamic bodies, one file each. `MATERIALS` is the table over which every invariance test loops."""

from .base import Material
from .bond_associated import BondAssociated
from .correspondence import Correspondence
from .force_model import BondForces
from .hyperelastic import Hyperelastic
from .influence import INFLUENCE
from .linear import Linear
from .lps import LPS, Elastic
from .plastic import Plastic
from .pmb import PMB, bond_law
from .viscoelastic import Viscoelastic

__all__ = [
    "INFLUENCE",
    "LPS",
    "MATERIALS",
    "PMB",
    "BondAssociated",
    "BondForces",
    "Correspondence",
    "Elastic",
    "Hyperelastic",
    "Linear",
    "Material",
    "Plastic",
    "Viscoelastic",
    "bond_law",
]

# name: a function (bulk, shear) → material; bond-based ones ignore the shear modulus. `Linear` and `Hyperelastic`,
# which are no isotropic laws, and `Viscoelastic` and `Plastic`, which have a memory, are not among them.
MATERIALS = {
    "pmb": lambda bulk, shear: PMB(bulk),
    "lps": lambda bulk, shear: LPS(bulk, shear),
    "correspondence": lambda bulk, shear: Correspondence(bulk, shear),
    "bond-associated": lambda bulk, shear: BondAssociated(bulk, shear),
    "elastic": lambda bulk, shear: Elastic(
        9 * bulk * shear / (3 * bulk + shear), (3 * bulk - 2 * shear) / (2 * (3 * bulk + shear))
    ),
}
