"""Elastic constants of a crystal from its bonds: Born's term with the basis moving along, less what the basis
relaxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from ..pd.voigt import tensor_of
from .crystal import Crystal, response


@dataclass
class ElasticConstants:
    """C_ijkl = ∂σ_ij/∂ε_kl, internal units (energy/length³).

    Attributes
    ----------
    C_vv : (6, 6) in Voigt's notation (xx yy zz yz xz xy), the basis relaxed
    born_vv : (6, 6) the same with the basis moving along with the strain (clamped ions)
    stress_v : (6,) the stress of the unstrained crystal (tension positive). Unless it is 0 the constants are
        stress–strain coefficients of the Cauchy
        stress at that state, which lack the full symmetry of the Born–Huang ones.
    """

    C_vv: np.ndarray
    born_vv: np.ndarray
    stress_v: np.ndarray
    crystal: Crystal

    @property
    def tensor(self) -> np.ndarray:
        """(3, 3, 3, 3) C_ijkl."""
        return tensor_of(self.C_vv)

    def to_user(self, what: str = "C_vv") -> np.ndarray:
        """In the user's pressure unit."""
        return self.crystal.units.to_user("pressure", getattr(self, what))

    def gpa(self, what: str = "C_vv") -> np.ndarray:
        """In GPa (physical units only)."""
        if self.crystal.units.reduced:
            raise AtcError(f"{self.crystal.name}: reduced units (lj) have no GPa: use to_user()")
        return getattr(self, what) * GPA

    @property
    def cubic(self) -> tuple[float, float, float]:
        """C11, C12, C44 averaged over the cube's axes (internal units)."""
        C = self.C_vv
        return (
            float((C[0, 0] + C[1, 1] + C[2, 2]) / 3),
            float((C[0, 1] + C[0, 2] + C[1, 2] + C[1, 0] + C[2, 0] + C[2, 1]) / 6),
            float((C[3, 3] + C[4, 4] + C[5, 5]) / 3),
        )

    def christoffel(self, k_kc) -> np.ndarray:
        """(k, 3, 3) D = C_ijkl k_j k_l / ρ: the classical continuum's dynamical matrix, ω² its eigenvalues."""
        k = np.atleast_2d(k_kc)
        return np.einsum("ijkl,pj,pl->pik", self.tensor, k, k) / self.crystal.density

    @property
    def stable(self) -> bool:
        """Born's criterion: C positive definite."""
        C = self.C_vv[np.ix_(self.crystal.strains, self.crystal.strains)]
        return bool(np.linalg.eigvalsh(0.5 * (C + C.T)).min() > 0)


#: GPa per eV/Å³
GPA = 160.2176634


def elastic_constants(crystal: Crystal, model, *, step: float = 1e-4) -> ElasticConstants:
    """Elastic constants at the crystal's present volume.

    C = ∂σ/∂ε − (1/V) Λᵀ Φ⁺ Λ, with Λ = ∂F/∂ε the forces that a strain brings about and Φ the force constants of the
    sublattices. All three are derivatives of the bonds' forces and virial, by central differences of sixth order at
    strains `step`.

    Parameters
    ----------
    crystal : Crystal, with the basis at rest; usually from `atc.upscaling.crystal.relax`
    model : potential of `atc.potential`, or an ASE calculator with stresses

    Returns
    -------
    ElasticConstants

    Raises
    ------
    AtcError if the basis is not in equilibrium, or unstable.
    """
    r = response(crystal, model, step)
    born = r.born_vv
    largest = np.abs(r.forces_nc).max()
    scale = np.abs(born).max() * crystal.volume ** (2 / 3)
    if largest > 1e-6 * scale:
        raise AtcError(
            f"{crystal.name}: its atoms are not in equilibrium (forces of {largest:.2g} internal units): relax the "
            "crystal first"
        )
    C = born
    if len(crystal) > 1:
        values, modes = np.linalg.eigh(r.phi_xx)
        top = np.abs(values).max()
        if values[0] < -1e-7 * top:
            raise AtcError(
                f"{crystal.name}: its basis is unstable against moving sublattices (an optical mode at k = 0 is "
                "imaginary)"
            )
        inner = values > 1e-7 * top
        L = modes[:, inner].T @ r.lambda_xv
        C = born - (L.T / values[inner]) @ L / crystal.volume
    return ElasticConstants(0.5 * (C + C.T), 0.5 * (born + born.T), r.stress_v, crystal)
