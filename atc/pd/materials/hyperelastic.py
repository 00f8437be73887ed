"""Correspondence with any strain energy: P = ∂W/∂F of a law of the user's, e.g. that of a crystal
(`atc.upscaling.cauchy_born`), with the zero-energy modes stabilised as in `correspondence`."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from .base import Isotropic
from .correspondence import CorrespondenceModel


class Hyperelastic(Isotropic):
    """A solid of energy density W(F), anisotropic or not, at finite strain, in three dimensions.

    Parameters
    ----------
    law : called as ``law(H)`` with (n, 3, 3) displacement gradients H = F − 1; gives (n,) W and (n, 3, 3) P = ∂W/∂F.
        Its ``moduli_vv`` are the (6, 6) elastic constants at rest, Voigt's order xx yy zz yz xz xy.
    stabilisation : how stiff zero-energy modes are, relative to the bond of an isotropic solid of Voigt's shear modulus
    influence : "one" by default; a name, a function of (|ξ|, δ), or one of ξ (b, 3) alone with ω(ξ) = ω(−ξ), whose
        direction changes what nodes listen to and no elastic constant
    volume_correction : the share ν of volumes near the horizon

    Notes
    -----
    `bulk` and `shear`, Voigt's averages, are what contact and fracture energies are estimated with.
    """

    name = "hyperelastic"
    directed = True
    by_numbers = False

    def __init__(self, law, *, stabilisation=0.1, influence="one", volume_correction=True):
        C = np.asarray(law.moduli_vv, float)
        if C.shape != (6, 6) or not np.linalg.eigvalsh(0.5 * (C + C.T)).min() > 0:
            raise AtcError("hyperelastic: the law's moduli_vv must be a positive definite (6, 6) matrix")
        a, b, c = np.trace(C[:3, :3]), C[0, 1] + C[0, 2] + C[1, 2], np.trace(C[3:, 3:])
        super().__init__(bulk=(a + 2 * b) / 9, shear=(a - b + 3 * c) / 15)
        self.law = law
        self.stabilisation = float(stabilisation)
        self.influence, self.volume_correction = influence, bool(volume_correction)


class HyperelasticModel(CorrespondenceModel):
    """The force state of correspondence with the stress that a law P(F) gives."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        if body.dimension != 3:
            raise AtcError("hyperelastic: this material is for bodies in three dimensions")
        super().__init__(body, materials, crew, rules, lammps_compat, interfaces)
        self._laws = [(self.materials[m].law, np.flatnonzero(body.material_n == m)) for m in self.ids]

    def _each(self, H):
        """W and P of every node."""
        W, P = np.zeros(self.n), np.zeros((self.n, 3, 3))
        for law, nodes in self._laws:
            W[nodes], P[nodes] = law(H[nodes])
        return W, P

    def _stresses(self):
        inverse, H = self.inverse_ncc.reshape(-1, 3, 3), self.H_ncc.reshape(-1, 3, 3)
        H[:] = H @ inverse
        self.W_n, P = self._each(H)
        self.Q_ncc[:] = (self.body.V_n[:, None, None] * P @ inverse - self.g_active_n[:, None, None] * H).reshape(-1, 9)

    def _density(self, H):
        return self.W_n

    def _stiffest_n(self):
        # The Voigt matrix in an orthonormal basis: no plane wave is stiffer than its largest eigenvalue.
        scale = np.sqrt([1.0, 1, 1, 2, 2, 2])
        return self.per_node(lambda m: np.linalg.eigvalsh(np.asarray(m.law.moduli_vv) * np.outer(scale, scale)).max())


Hyperelastic.model = HyperelasticModel
