"""Materials of a twin, derived from the potential and the crystal."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from .. import pd
from ..errors import AtcError, AtcWarning
from ..pd.sampling import MODULI_REFUSE, MODULI_WARN, sampled_constants
from ..upscaling.elasticity import elastic_constants


class TwinMaterial:
    """What the materials of a twin have in common (internal units): `material` of `atc.pd`, `bulk`, `shear`,
    and `lines(units)`: what it is, what it gets exactly and what not, for a person.

    sampled_vv, wanted_vv : (6, 6) elastic constants of the nodes, and those that the material means to have
    crystal_vv : those of the crystal along the body's axes
    damage : what breaks bonds. temperature : the one that it knows. None where it has none.
    carries_atoms : whether nodes carry atoms along; `frame(simulation)` then gives these, and their potential
    """

    sampled_vv = wanted_vv = crystal_vv = damage = temperature = None
    carries_atoms = False

    @property
    def error(self) -> float:
        """The largest difference of the nodes' constants from the material's, relative to the largest constant."""
        return float(np.abs(self.sampled_vv - self.wanted_vv).max() / np.abs(self.wanted_vv).max())

    def after(self, simulation) -> list[str]:
        """What a run showed, for a person."""
        return []


def require_stable(crystal, stable: bool) -> None:
    """Raise unless every strain of a crystal costs energy."""
    if not stable:
        raise AtcError(f"{crystal.name}: the crystal is unstable under this potential: check structure and potential")


@dataclass
class Isotropic(TwinMaterial):
    """The isotropic solid of a crystal's Hill averages (internal units).

    material : PMB or LPS. bulk, shear : K and G. anisotropy : Zener's A = 2 C44/(C11 − C12). C : ElasticConstants
    sampled_vv : (6, 6) elastic constants that the nodes of a periodic body of this spacing and horizon have
    wanted_vv : those that the material means to have (of PMB with Poisson's ratio 1/4)
    crystal_vv : (6, 6) those of the crystal along the body's axes
    damage : pd.CriticalStretch, Gc : fracture energy and surface : `upscaling.surfaces.Surface` it is from; None where
        bonds do not break. given : whether Gc was, so that it is not 2γ
    strength : `upscaling.surfaces.Strength` of the crystal beside that of the bonds
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
    Gc: float | None = None
    strength: object = None
    given: bool = False
    horizon: float = np.nan

    def lines(self, units) -> list[str]:
        """What it is, what it gets exactly and what not: for a person."""
        p = lambda v: f"{units.to_user('pressure', v):.5g}"  # noqa: E731
        if self.C.crystal.dimension == 2:
            return self._lines_in_plane(p, units)
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

    def _lines_in_plane(self, p, units) -> list[str]:
        c11, c12, c66 = (self.C.C_vv[k] for k in ((0, 0), (0, 1), (5, 5)))
        return [
            f"material: isotropic ({self.material.name}) in plane strain, lambda + mu {p(self.bulk + self.shear / 3)}, "
            f"mu {p(self.shear)} {units.label('pressure')} of C11 {p(c11)}, C12 {p(c12)}, C66 {p(c66)}",
            "exact: small strains",
            "not exact: nonlinearity, dispersion of the crystal",
            f"the nodes' elastic constants differ from the material's by at most {100 * self.error:.2g} %",
            *self._fracture(units),
        ]

    def _fracture(self, units) -> list[str]:
        if self.damage is None:
            return []
        d = self.C.crystal.dimension
        per_area = units.to_user("energy", 1.0) / units.to_user("length", 1.0) ** (d - 1)
        unit = f"{units.label('energy')}/{units.label('length')}" + ("^2" if d == 3 else "")
        plane = "".join(map(str, self.surface.plane))
        gamma = f"2 gamma({plane}) = {2 * self.surface.energy * per_area:.4g} {unit}"
        among = "{100}, {110}, {111}" if d == 3 else "rows {01}, {1-1}"
        Gc = (
            f"Gc = {self.Gc * per_area:.4g} {unit}, as given; {gamma}"
            if self.given
            else f"Gc = {gamma}, the least of {among}: a lower bound, nothing else is dissipated"
        )
        p = lambda v: f"{units.to_user('pressure', v):.4g} {units.label('pressure')}"  # noqa: E731
        own, s = self.nodes_strength, self.strength
        # Strength goes with the root of the horizon's inverse.
        length = f"{units.to_user('length', self.horizon * (own / s.stress) ** 2):.3g} {units.label('length')}"
        return [
            f"fracture: {Gc}; critical stretch {self.damage.s00:.4g}",
            f"fracture: pulled apart without a crack the nodes part at {p(own)}, the crystal at {p(s.stress)}, strain "
            f"{s.strain:.3g}, along the normal of ({plane}): both have Gc and strength at a horizon of {length} only; "
            "blunt notches and defects break too "
            + ("easily" if own < s.stress else "late")
            + " in the twin, long sharp "
            "cracks do not notice",
            "fracture: a crystal holds a sharp crack beyond Griffith's load, its lattice traps it, bond by bond; nodes "
            "do so less, or otherwise: MD may start later than the twin. fracture_energy sets another Gc; material = "
            '"smoothed" with nodes = "atoms" has the lattice\'s own trapping',
        ]

    @property
    def nodes_strength(self) -> float:
        """The stress in uniaxial strain at which the longest stretched bonds break."""
        return float(self.damage.s00 * self.wanted_vv[0, 0])


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


def hill_in_plane(C_vv) -> tuple[float, float]:
    """λ + μ and μ of a crystal in the plane, from constants in Voigt's notation: means of Voigt's and Reuss's."""
    C = C_vv[np.ix_((0, 1, 5), (0, 1, 5))]
    sums = lambda M: (M[0, 0] + M[1, 1] + 2 * M[0, 1], M[0, 0] + M[1, 1] - 2 * M[0, 1], M[2, 2])  # noqa: E731
    a, b, c = sums(C)
    p, q, r = sums(np.linalg.inv(C))
    return float((a / 4 + 1 / p) / 2), float(((b + 4 * c) / 8 + 2 / (q + r)) / 2)


def isotropic(crystal, model, law: str, step_cc, horizon, influence=None) -> Isotropic:
    """PMB or LPS of a relaxed crystal under its potential; moduli that its nodes would miss by more than 10 % are
    refused."""
    C = elastic_constants(crystal, model)
    require_stable(crystal, C.stable)
    plane = {}
    if crystal.dimension == 2:
        area, G = hill_in_plane(C.C_vv)
        # In plane strain lambda + mu is K + G/3.
        K, plane = area - G / 3, {"dimension": 2, "plane": "strain"}
    else:
        K, G = hill(C.C_vv)
    given = {} if influence is None else {"influence": influence}
    material = pd.LPS(K, G, **given) if law == "lps" else pd.PMB(bulk=K, **given)
    wanted = isotropic_vv(K, G if law == "lps" else 0.6 * K)
    sampled = sampled_constants(material, step_cc, horizon, crystal.density, components=crystal.strains, **plane)
    if plane:
        inside = np.isin(np.arange(6), crystal.strains)
        wanted, sampled = (np.where(np.outer(inside, inside), M, 0.0) for M in (wanted, sampled))
        c11, c12, c44 = C.C_vv[0, 0], C.C_vv[0, 1], C.C_vv[5, 5]
    else:
        c11, c12, c44 = C.cubic
    found = Isotropic(material, K, G, 2 * c44 / (c11 - c12), C, sampled, wanted, horizon=horizon)
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
