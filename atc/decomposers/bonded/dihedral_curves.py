"""Torsions whose energy is another function of cos φ than a short series (see `atc.decomposers.bonded.dihedral` for the
geometry)."""

from __future__ import annotations

import numpy as np

from .angle_curves import restricted, shift_exp
from .dihedral import CurveTorsion, Torsion, sign_of, sign_of_phase
from .improper import HarmonicImproper
from .topology import MirrorError, degrees, energy, plain


class QuadraticTorsion(HarmonicImproper):
    """U = K (φ − φ0)² with φ − φ0 between −180 and 180° (LAMMPS ``quadratic``). Coefficients K [energy/rad²], φ0
    [degrees, 0 or 180].

    Smooth at the plane of φ0. At the other plane the energy has a ridge: sin φ is divided by no less than 1e-6, and
    such chains are counted.
    """

    kind = "dihedral"
    name = "quadratic"
    wants = (("K", energy), ("phi0", degrees))
    angle_name, small = "phi", 1e-6

    def row(self, K, phi0):
        return K, np.pi if sign_of(phi0) < 0 else 0.0


class HelixTorsion(Torsion):
    """U = A [1 − cos φ] + B [1 + cos 3φ] + C [1 + cos(φ + 45°)] (LAMMPS ``helix``). Coefficients A, B, C [energy].

    C must be 0: its term prefers one hand.
    """

    name = "helix"
    wants = (("A", energy), ("B", energy), ("C", energy))

    def row(self, A, B, C):
        if C != 0.0:
            sign_of_phase(45.0)
        return np.array([A + B, -A, 0.0, B])


_SMALL_A = (
    "for |a| below 0.001 LAMMPS's forces are not the derivative of its energy and differ in the mirror image, so they "
    "are no forces along bonds: use a = 0, or 0.001 and more"
)


class CosineShiftExpTorsion(CurveTorsion):
    """U = −U_min (e^{−a u} − 1)/(e^a − 1), u = −½[1 + cos(φ − φ0)] (LAMMPS ``cosine/shift/exp``). U_min [energy], φ0
    [degrees, 0 or 180], a.

    For 0 < |a| < 0.001 LAMMPS (22 Jul 2025, measured) adds a force ½ a cot φ of the right one, of the other sign in the
    mirror image: refused.
    """

    name = "cosine/shift/exp"
    wants = (("U_min", energy), ("phi0", degrees), ("a", plain))

    def row(self, depth, phi0, a):
        if 0.0 < abs(a) < 0.001:
            raise MirrorError(_SMALL_A)
        return depth, sign_of(phi0), a

    def curve(self, cos, sin, types, acc):
        depth, sign, a = self.columns(types)
        U, slope = shift_exp(sign * cos, depth, a)
        return U, sign * slope


class RestrictedTorsion(CurveTorsion):
    """U = K (cos φ − cos φ0)²/sin² φ (MARTINI; LAMMPS ``cosine/squared/restricted``). Coefficients K [energy], φ0
    [degrees].

    A function of cos φ, the same for both hands, for every φ0. Infinite in the planes (for φ0 = 0 or 180° only in the
    other one): an error there.
    """

    name = "cosine/squared/restricted"
    wants = (("K", energy), ("phi0", degrees))

    def curve(self, cos, sin, types, acc):
        K, phi0 = self.columns(types)
        return restricted(cos, sin, K, np.cos(phi0))
