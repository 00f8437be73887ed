"""Impropers of the topology: U = K (χ − χ0)² with χ the torsion angle of the four atoms, as forces along their six
distances.

LAMMPS's ``improper harmonic`` takes χ = arccos(cos χ), between 0 and 180°: a function of cos χ, so the same for a
figure and its mirror image, for *every* χ0. It is a function of distances. What χ0 decides is whether it is smooth: at
a planar figure |χ| has a kink, which only χ0 = 0 (at χ = 0) or χ0 = 180° (at χ = 180°) takes away. There χ/sin χ goes
to its limit, here exactly. For any other χ0 the energy of a planar figure is a ridge whose force has no single value:
sin χ is then divided by no less than 0.001, as LAMMPS does, and such figures are counted.

Where three successive atoms are in a line χ has no value either; see `dihedral` for the continuation
below sin θ = 0.001. (LAMMPS clamps sin² θ of impropers at 0.001, at 1.8° already, where its forces are no longer the
derivatives of its energy.)
"""

from __future__ import annotations

import numpy as np

from ..base import Accumulator
from .dihedral import CurveTorsion, FourAtoms, HarmonicTorsion
from .topology import Idle, degrees, energy

# LAMMPS's SMALL: the least sin χ that is divided by at a kink.
_SMALL = 0.001


class HarmonicImproper(CurveTorsion):
    """U = K (χ − χ0)², 0 ≤ χ ≤ π (LAMMPS's K: no ½). Coefficients K [energy/rad²], χ0 [degrees]. See `FourAtoms` for
    the parameters."""

    kind = "improper"
    name = "harmonic"
    wants = (("K", energy), ("chi0", degrees))
    #: what its angle is called in notes, and the least sine of it that is divided by at a kink (LAMMPS's)
    angle_name, small = "chi", _SMALL

    def curve(self, cos, sin, types, acc: Accumulator):
        K, chi0 = self.columns(types)
        # The angle from the plane, so that nothing cancels near χ = π; dU/dcos = −2K (χ − χ0)/sin χ is split into a
        # regular part and a kink.
        sign = np.where(cos >= 0.0, 1.0, -1.0)
        off, angle = np.where(cos >= 0.0, 0.0, np.pi) - chi0, np.arctan2(sin, np.abs(cos))
        regular = sign * np.divide(angle, sin, out=np.ones_like(sin), where=sin > 0.0)
        kinked = np.abs(off) > 1e-12
        acc.note(
            f"{self.kind}s in a plane they do not prefer, where sin {self.angle_name} was clamped at {self.small:g}",
            np.count_nonzero(kinked & (sin < self.small)),
        )
        kink = np.where(kinked, off / np.maximum(sin, self.small), 0.0)
        return K * (sign * angle + off) ** 2, -2.0 * K * (regular + kink)


class ZeroImproper(Idle, FourAtoms):
    """Impropers that exert no force (LAMMPS ``improper_style zero``)."""

    kind = "improper"


class CvffImproper(HarmonicTorsion):
    """U = K [1 + d cos nφ] of an improper (LAMMPS ``cvff``). Coefficients K [energy], d = 1 or −1, n. See `FourAtoms`
    for the parameters."""

    kind = "improper"
    name = "cvff"
