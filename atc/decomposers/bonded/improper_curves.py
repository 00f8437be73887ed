"""Impropers that are functions of a pyramid's invariants (see `improper_pyramid`), and two of other
angles.

Which atom is the apex, and every factor, is as LAMMPS (22 Jul 2025) computes; where its manual says otherwise the class
says so.
"""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcWarning
from ..base import Accumulator
from .cluster import first_not_finite
from .dihedral import FourAtoms
from .improper_pyramid import Pyramid, PyramidImproper, asin_over_sine
from .topology import CrossTerms, MirrorError, RowTerm, degrees, energy, length, per_length2, per_length4

# The least sine or cosine that is divided by at a kink.
_SMALL = 0.001
# The same for inversion/harmonic and for the angles of class2, where LAMMPS has none: rounding is as large about here.
_PLANE = 1e-8
_HANDED = (
    "the pyramid and its mirror image differ in energy, so the term is not a function of distances and has no forces "
    "along bonds"
)


def signed_cosine(p: Pyramid, axis: int):
    """cos ω of an arm and the plane of the others: negative if the arm leans to the same side as the sum of the others'
    directions."""
    beside = {0: (0, 1), 1: (0, 2), 2: (1, 2)}[axis]
    return np.where(p.cos[beside[0]] + p.cos[beside[1]] > 0, -1.0, 1.0) * np.sqrt(1.0 - p.sin2[axis])


def by_cosine(p: Pyramid, axis: int, cos, slope, acc: Accumulator):
    """∂U/∂ξ of a term with dU/dcos ω = slope, cos ω = ±√(1 − sin² ω): where the arm is upright and the term has a
    slope, cos ω is clamped at 0.001."""
    small = (np.abs(cos) < _SMALL) & (np.abs(slope) > 1e-12 * np.abs(slope).max(initial=0.0))
    acc.note("impropers with an arm upright on a plane, where cos omega was clamped at 0.001", int(small.sum()))
    clamped = np.where(np.abs(cos) < _SMALL, np.copysign(_SMALL, cos), cos)
    return (-0.5 * slope / clamped)[:, None] * p.sin2_e[axis]


class UmbrellaImproper(PyramidImproper):
    """U = ½K (cos ω − cos ω0)²/sin² ω0, and K (1 − cos ω) for ω0 = 0 (DREIDING; LAMMPS ``umbrella``). Coefficients K
    [energy], ω0 [degrees].

    ω is the angle between the arm to atom 4 and the plane of atoms 1, 2, 3; atom 1 is the apex.
    """

    name = "umbrella"
    wants = (("K", energy), ("omega0", degrees))

    def row(self, K, omega0):
        if omega0 != 0.0 and not abs(np.sin(omega0)) > 1e-6:
            raise ValueError("omega0 must be 0 or an angle with a sine")
        return K, omega0

    def curve(self, p, types, acc):
        K, omega0 = self.columns(types)
        cos, flat = signed_cosine(p, 2), omega0 == 0.0
        k, x = K / np.where(flat, 1.0, np.sin(omega0)) ** 2, cos - np.cos(omega0)
        # 1 − cos ω without cancellation near the plane.
        rise = np.where(cos > 0, p.sin2[2] / (1.0 + np.abs(cos)), 1.0 - cos)
        return np.where(flat, K * rise, 0.5 * k * x * x), by_cosine(p, 2, cos, np.where(flat, -K, k * x), acc)


class FourierImproper(RowTerm, PyramidImproper):
    """U = K [C0 + C1 cos ω + C2 cos 2ω] (LAMMPS ``fourier``). Coefficients K [energy], C0, C1, C2, and optionally all
    (1, or 0).

    Atom 1 is the apex; with all = 1 (the default) the sum over the three arms against the plane of the other two,
    otherwise atom 4's arm alone.
    """

    name = "fourier"

    @classmethod
    def scaled(cls, numbers, u):
        if len(numbers) not in (4, 5) or numbers[4:] not in ([], [0.0], [1.0]):
            raise ValueError(f"expected K C0 C1 C2 and optionally 0 or 1, got {len(numbers)} numbers")
        return (numbers[0] * u.energy, *numbers[1:4], numbers[4] if len(numbers) == 5 else 1.0)

    def curve(self, p, types, acc):
        K, C0, C1, C2, every = self.columns(types)
        U, G = 0.0, 0.0
        for axis in range(3):
            k = K if axis == 2 else K * every
            cos = signed_cosine(p, axis)
            U = U + k * (C0 + C1 * cos + C2 * (2.0 * cos * cos - 1.0))
            # cos 2ω = 1 − 2 sin² ω has no kink.
            G = G + by_cosine(p, axis, cos, k * C1, acc) - (2.0 * k * C2)[:, None] * p.sin2_e[axis]
        return U, G


class InversionHarmonicImproper(PyramidImproper):
    """U = (K/3) Σ (ω − ω0)² over the three arms, 0 ≤ ω ≤ 90° (Wilson-Decius; LAMMPS ``inversion/harmonic``: its manual
    lacks the third).

    Coefficients K [energy/rad²], ω0 [degrees]. Atom 1 is the apex. For ω0 ≠ 0 a planar figure is a ridge: sin ω is then
    clamped at 1e-8.
    """

    name = "inversion/harmonic"
    wants = (("K", energy), ("omega0", degrees))

    def curve(self, p, types, acc):
        K, omega0 = self.columns(types)
        U, G = 0.0, 0.0
        for axis in range(3):
            s, cos = np.sqrt(p.sin2[axis]), np.maximum(np.sqrt(1.0 - p.sin2[axis]), _PLANE)
            U = U + K / 3.0 * (np.arcsin(s) - omega0) ** 2
            kink = np.where(omega0 != 0.0, omega0 / np.maximum(s, _PLANE), 0.0)
            acc.note(
                "impropers in a plane they do not prefer, where sin omega was clamped at 1e-8",
                int(((s < _PLANE) & (omega0 != 0)).sum()),
            )
            G = G + (K / 3.0 * (asin_over_sine(p.sin2[axis]) - kink) / cos)[:, None] * p.sin2_e[axis]
        return U, G


class DistanceImproper(PyramidImproper):
    """U = K2 h² + K4 h⁴, h the distance of atom 1 from the plane of the others (LAMMPS ``distance``). K2
    [energy/length²], K4 [energy/length⁴]."""

    name = "distance"
    wants = (("K2", per_length2), ("K4", per_length4))

    def curve(self, p, types, acc):
        K2, K4 = self.columns(types)
        return p.height2 * (K2 + K4 * p.height2), (K2 + 2.0 * K4 * p.height2)[:, None] * p.height2_e


class OrientedImproper(PyramidImproper):
    """One whose second number, if not 0, prefers one hand: refused then, with why it is `oriented`."""

    oriented = ""

    def row(self, K, rest, *more):
        if K and rest:
            raise MirrorError(f"{self.oriented}: {_HANDED}")
        return K, rest, *more


class DistHarmImproper(OrientedImproper):
    """U = K (h − h0)² (YAFF; LAMMPS ``distharm``), h the *oriented* distance of atom 1 (LAMMPS's manual: atom 4) from
    the plane of the others.

    Coefficients K [energy/length²], h0 [length]: 0, for others the term prefers one hand.
    """

    name = "distharm"
    wants = (("K", per_length2), ("h0", length))

    oriented = "its distance d0 is oriented and not 0"

    def curve(self, p, types, acc):
        K = self.table[types, 0]
        return K * p.height2, K[:, None] * p.height2_e


class SqDistHarmImproper(PyramidImproper):
    """U = K (h² − h0²)², h the distance of atom 1 (LAMMPS's manual: atom 4) from the plane of the others (YAFF; LAMMPS
    ``sqdistharm``).

    Coefficients K [energy/length⁴], h0² [length²].
    """

    name = "sqdistharm"
    wants = (("K", per_length4), ("h0^2", {"length": 2}))

    def curve(self, p, types, acc):
        K, h02 = self.columns(types)
        x = p.height2 - h02
        return K * x * x, (2.0 * K * x)[:, None] * p.height2_e


class RingImproper(PyramidImproper):
    """U = (K/6) [Σ (cos θ + cos θ0)]⁶ over the three angles at atom 2 (LAMMPS ``ring``: in its manual the second sign
    is −).

    Coefficients K [energy], θ0 [degrees].
    """

    name = "ring"
    wants = (("K", energy), ("theta0", degrees))
    apex = 1

    def curve(self, p, types, acc):
        K, theta0 = self.columns(types)
        x = p.cos.sum(axis=0) + 3.0 * np.cos(theta0)
        return K / 6.0 * x**6, (K * x**5)[:, None] * p.cos_e.sum(axis=0)


class Class2Improper(CrossTerms, OrientedImproper):
    """U = K χ² + M1 x1 x3 + M2 x1 x2 + M3 x2 x3 (COMPASS; LAMMPS ``class2``), χ the mean of the three angles between an
    arm and the plane of the others.

    Atom 2 is the apex; x_k = θ_k − t_k of the angles 1-2-3, 1-2-4, 3-2-4. Coefficients K [energy/rad²], χ0 [degrees]:
    0, for others the term prefers one hand; ``aa`` (section AngleAngle Coeffs) M1, M2, M3 [energy/rad²], t1, t2, t3
    [degrees]. Near sin θ = 0 the sine is clamped at 0.001.
    """

    name = "class2"
    main = (("K", energy), ("chi0", degrees))
    crosses = {"aa": (*((f"M{k}", energy) for k in (1, 2, 3)), *((f"theta{k}", degrees) for k in (1, 2, 3)))}  # noqa: RUF012
    apex = 1

    oriented = "its chi is oriented and chi0 not 0"

    def curve(self, p, types, acc):
        K, _, M1, M2, M3, *t = self.columns(types)
        # All three angles have the sign of the volume: their mean squared has none. ω_j/sin ω_k is regular in the
        # plane.
        omega_over_V = (asin_over_sine(p.sin2) * p.scale).sum(axis=0)
        U = K / 9.0 * p.V2 * omega_over_V**2
        cos = np.maximum(np.sqrt(1.0 - p.sin2), _PLANE)
        G = np.einsum("kt,kte->te", K / 9.0 * omega_over_V / p.scale / cos, p.sin2_e)
        sin = np.sqrt(1.0 - p.cos**2)
        slope = -1.0 / np.maximum(sin, _SMALL)
        acc.note(
            "impropers with two arms in a line, where sin theta was clamped at 0.001",
            int((sin < _SMALL).any(axis=0).sum()),
        )
        x1, x2, x3 = np.arccos(p.cos) - np.array(t)
        U = U + M1 * x1 * x3 + M2 * x1 * x2 + M3 * x2 * x3
        by_theta = np.array([M1 * x3 + M2 * x2, M2 * x1 + M3 * x3, M1 * x1 + M3 * x2])
        return U, G + np.einsum("kt,kte->te", by_theta * slope, p.cos_e)


class CosineSquaredImproper(FourAtoms):
    """U = ½K cos²(χ − χ0), χ between the vectors from atom 1 to 2 and from 3 to 4 (LAMMPS ``cossq``: its manual has
    other words for χ).

    Coefficients K [energy], χ0 [degrees]. For χ0 ≠ 0 LAMMPS (22 Jul 2025, measured) computes forces −K cos(χ − χ0) ∂cos
    χ, which are not the derivative of that energy; they are taken as they are, and a warning says so.
    """

    kind = "improper"
    name = "cossq"
    wants = (("K", energy), ("chi0", degrees))

    def row(self, K, chi0):
        if K and chi0:
            warnings.warn(
                "improper_style cossq with chi0 other than 0: LAMMPS computes forces that are not the derivative of "
                "its energy; the run's forces are taken as they are, so energy is not balanced",
                AtcWarning,
                stacklevel=2,
            )
        return K, chi0

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        K, chi0 = self.columns(types)
        b, d = x_tkc[:, 1] - x_tkc[:, 0], x_tkc[:, 3] - x_tkc[:, 2]
        bb, dd = np.einsum("tc,tc->t", b, b), np.einsum("tc,tc->t", d, d)
        with np.errstate(divide="ignore", invalid="ignore"):
            v = 1.0 / np.sqrt(bb * dd)
            cos = np.clip(np.einsum("tc,tc->t", b, d) * v, -1.0, 1.0)
            # b·d = ξ14 + ξ23 − ξ13 − ξ24.
            slopes = np.stack([-cos / bb, -v, v, v, -v, -cos / dd], axis=1)
            shifted = np.cos(np.arccos(cos) - chi0)
        U[:] = 0.5 * K * shifted**2
        G[:] = (K * shifted)[:, None] * slopes
        return first_not_finite(U, G)
