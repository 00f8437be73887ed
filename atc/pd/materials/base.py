"""What to inherit from for a material: `Material` and `Isotropic`, with elastic constants in 1, 2 and 3 dimensions; and
`ForceModel`."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from .force_model import ForceModel
from .influence import MEAN_COS, bond_based_shear, micromodulus, moment

__all__ = ["ForceModel", "Isotropic", "Material"]


class Material:
    """Base of the materials. `volume_correction`: the share ν of volumes near the horizon. `surface_correction`: None
    or "energy"."""

    name = "material"
    model: type[ForceModel]  # what computes its forces; given where that is defined, below the material
    by_numbers = True  # whether constants alone define it
    springs = True  # whether the energy of a bond grows like the square of its stretch
    elastic = False  # whether its stress is that of its constants and the strain of now, where that is small
    directed = False  # whether its influence function may be one of the bond's vector
    volume_correction = True
    surface_correction = None
    influence = "one"
    expansion = 0.0  # linear, by heat

    def lame(self, body):
        """(λ, μ) that act in the body's dimension; in 1-D λ = μ = E/3, so that λ + 2μ is Young's modulus."""
        raise NotImplementedError

    def interface_energy(self, other, body, interface=1.0):
        """Energy per area to stretch all bonds across the plane between this material and another to 1: each end of a
        bond has its half.

        `interface` : the stiffness of the bonds relative to the default.
        """
        return interface * 0.5 * (self.fracture_energy(body, 1.0) + other.fracture_energy(body, 1.0))

    def uniaxial(self, body):
        """The modulus of a thin bar (in plane strain: of a strip) of this body, pulled along one axis and free along
        the others."""
        lam, mu = self.lame(body)
        if body.dimension == 1:
            return lam + 2 * mu
        if body.dimension == 2:
            return 4 * mu * (lam + mu) / (lam + 2 * mu)
        return mu * (3 * lam + 2 * mu) / (lam + mu)

    def poisson(self, body):
        """Contraction over extension of a bar of this body pulled along one axis."""
        lam, mu = self.lame(body)
        return {1: 0.0, 2: lam / (lam + 2 * mu), 3: lam / (2 * (lam + mu))}[body.dimension]


class Isotropic(Material):
    """Two elastic constants: any two of bulk and shear modulus, Young's modulus and Poisson's ratio, always the
    three-dimensional ones.

    In a plate λ is that of plane stress or plane strain.
    """

    def __init__(self, bulk=None, shear=None, *, youngs=None, poisson=None):
        given = {k: v for k, v in dict(bulk=bulk, shear=shear, youngs=youngs, poisson=poisson).items() if v is not None}
        if set(given) == {"youngs", "poisson"}:
            bulk, shear = youngs / (3 * (1 - 2 * poisson)), youngs / (2 * (1 + poisson))
        elif set(given) != {"bulk", "shear"}:
            raise AtcError(
                f"{self.name}: give bulk and shear, or youngs and poisson; got {', '.join(given) or 'nothing'}"
            )
        if not (bulk > 0 and shear > 0 and np.isfinite(bulk + shear)):
            raise AtcError(
                f"{self.name}: bulk and shear modulus must be positive, got bulk {bulk:g} and shear {shear:g}"
            )
        self.bulk, self.shear = float(bulk), float(shear)

    def lame(self, body):
        K, G = self.bulk, self.shear
        lam = K - 2.0 * G / 3.0
        if body.dimension == 1:
            E = 9.0 * K * G / (3.0 * K + G)
            return E / 3.0, E / 3.0
        if body.dimension == 2 and body.plane == "stress":
            lam = 2.0 * lam * G / (lam + 2.0 * G)
        return lam, G

    def contact_micromodulus(self, body):
        """c of the bond-based material of this bulk modulus: 18K/(πδ⁴) in 3-D. Contact takes 15 times that."""
        return micromodulus(body, bond_based_shear(body, bulk=self.bulk))

    def fracture_energy(self, body, s0):
        """Energy per area to stretch all bonds across a plane to s0, their shares in b alone: (9/5) K δ s0² for ω =
        1/|ξ| and K = 5G/3.

        For correspondence an estimate, since there a bond has no energy of its own.
        """
        d = body.dimension
        # Both ends' energies ½ (b/m) ω e² of each bond, with half the crossing volume |cos| r (every direction counts a
        # bond twice).
        b_over_m = d * (d + 2) * self.lame(body)[1] / moment(self.influence, body, 2)
        return 0.5 * b_over_m * s0**2 * moment(self.influence, body, 3) * MEAN_COS[d]
