"""Materials of a twin, derived from the potential and the crystal."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from ..errors import AtcError, AtcWarning
from ..pd.sampling import MODULI_REFUSE, MODULI_WARN, sampled_constants


@dataclass
class Isotropic:
    """The isotropic solid of a crystal's Hill averages (internal units).

    material : PMB or LPS. bulk, shear : K and G. anisotropy : Zener's A = 2 C44/(C11 − C12). C : ElasticConstants
    sampled_vv : (6, 6) elastic constants that the nodes of a periodic body of this spacing and horizon have
    wanted_vv : those that the material means to have (of PMB with Poisson's ratio 1/4)
    crystal_vv : (6, 6) those of the crystal along the body's axes
    damage : pd.CriticalStretch, surface : `upscaling.surfaces.Surface` it is from; None where bonds do not break
    """

    material: object
    bulk: float
    shear: float
    anisotropy: float
    C: object
    sampled_vv: np.ndarray
    wanted_vv: np.ndarray
    crystal_vv: np.ndarray = None
    damage: object = None
    surface: object = None

    @property
    def error(self) -> float:
        """The largest difference of the nodes' constants from the material's, relative to the largest constant."""
        return float(np.abs(self.sampled_vv - self.wanted_vv).max() / np.abs(self.wanted_vv).max())

    def lines(self, units) -> list[str]:
        """What it is, what it gets exactly and what not: for a person."""
        p = lambda v: f"{units.to_user('pressure', v):.5g}"  # noqa: E731
        c11, c12, c44 = self.C.cubic
        # σ along a cube axis at the uniaxial strain that the cell prescribes
        along = (self.bulk + 4 / 3 * self.wanted_vv[3, 3]) / c11 - 1
        return [
            f"material: isotropic ({self.material.name}), Hill averages K {p(self.bulk)}, G {p(self.shear)} "
            f"{units.label('pressure')} of C11 {p(c11)}, C12 {p(c12)}, C44 {p(c44)}",
            "exact: the bulk modulus"
            + ("" if self.material.name == "lps" else "; Poisson's ratio is 1/4, so that the shear modulus is not"),
            f"not exact: anisotropy (Zener's ratio {self.anisotropy:.3g}; uniaxial strain along a cube axis is "
            f"{100 * along:+.2g} % too stiff), nonlinearity, dispersion of the crystal",
            f"the nodes' elastic constants differ from the material's by at most {100 * self.error:.2g} %",
            *self._fracture(units),
        ]

    def _fracture(self, units) -> list[str]:
        if self.damage is None:
            return []
        gamma = self.surface.energy * units.to_user("energy", 1.0) / units.to_user("length", 1.0) ** 2
        plane = "".join(map(str, self.surface.plane))
        return [
            f"fracture: Gc = 2 gamma({plane}) = {2 * gamma:.4g} {units.label('energy')}/{units.label('length')}^2, the "
            f"least of {{100}}, {{110}}, {{111}}: a lower bound, nothing else is dissipated; critical stretch "
            f"{self.damage.s00:.4g}"
        ]

    def after(self, simulation) -> list[str]:
        """What a run showed, for a person."""
        return []


def hill(C_vv) -> tuple[float, float]:
    """Hill's averages K, G of elastic constants in Voigt's notation: means of Voigt's and Reuss's."""

    def sums(M):
        return np.trace(M[:3, :3]), M[0, 1] + M[0, 2] + M[1, 2], np.trace(M[3:, 3:])

    a, b, c = sums(C_vv)
    K_V, G_V = (a + 2 * b) / 9, (a - b + 3 * c) / 15
    a, b, c = sums(np.linalg.inv(C_vv))
    K_R, G_R = 1 / (a + 2 * b), 15 / (4 * a - 4 * b + 3 * c)
    return float((K_V + K_R) / 2), float((G_V + G_R) / 2)


def isotropic_vv(K, G) -> np.ndarray:
    """(6, 6) elastic constants of an isotropic solid in Voigt's notation (xx, yy, zz, yz, xz, xy)."""
    C = np.diag([2 * G] * 3 + [G] * 3)
    C[:3, :3] += K - 2 * G / 3
    return C


def isotropic(crystal, model, law: str, step_cc, horizon) -> Isotropic:
    """PMB or LPS of a relaxed crystal under its potential; moduli that its nodes would miss by more than 10 % are
    refused."""
    from .. import pd
    from ..upscaling.elasticity import elastic_constants

    C = elastic_constants(crystal, model)
    if not C.stable:
        raise AtcError(f"{crystal.name}: the crystal is unstable under this potential: check structure and potential")
    K, G = hill(C.C_vv)
    material = pd.LPS(bulk=K, shear=G) if law == "lps" else pd.PMB(bulk=K)
    wanted = isotropic_vv(K, G if law == "lps" else 0.6 * K)
    c11, c12, c44 = C.cubic
    found = Isotropic(
        material, K, G, 2 * c44 / (c11 - c12), C, sampled_constants(material, step_cc, horizon, crystal.density), wanted
    )
    if not found.error <= MODULI_REFUSE:
        raise AtcError(
            f"the nodes' elastic constants would miss the material's by {100 * found.error:.3g} %: take a larger "
            "horizon or a smaller spacing in [twin]"
        )
    if found.error > MODULI_WARN:
        warnings.warn(
            f"the nodes' elastic constants miss the material's by {100 * found.error:.2g} %: a larger horizon in "
            "spacings is more accurate",
            AtcWarning,
            stacklevel=3,
        )
    return found
