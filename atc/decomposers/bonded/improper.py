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

from ...compiled import njit
from ..base import Accumulator
from .dihedral import FourAtoms, HarmonicTorsion, cosine_and_slopes
from .topology import degrees, energy, register_bonded

# LAMMPS's SMALL: the least sin χ that is divided by at a kink.
_SMALL = 0.001


class HarmonicImproper(FourAtoms):
    """U = K (χ − χ0)², 0 ≤ χ ≤ π (LAMMPS's K: no ½). Coefficients K [energy/rad²], χ0 [degrees]. See `FourAtoms` for
    the parameters."""

    kind = "improper"
    name = "harmonic"
    wants = (("K", energy), ("chi0", degrees))
    #: what its angle is called in notes, and the least sine of it that is divided by at a kink (LAMMPS's)
    angle_name, small = "chi", _SMALL

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        bad, collinear, kinks = _harmonic_impropers(x_tkc, types, self.table, self.small, U, G)
        acc.note(f"{self.kind}s with three atoms in a line, where cos {self.angle_name} was continued to 0", collinear)
        acc.note(
            f"{self.kind}s in a plane they do not prefer, where sin {self.angle_name} was clamped at {self.small:g}",
            kinks,
        )
        return bad


class CvffImproper(HarmonicTorsion):
    """U = K [1 + d cos nφ] of an improper (LAMMPS ``cvff``). Coefficients K [energy], d = 1 or −1, n. See `FourAtoms`
    for the parameters."""

    kind = "improper"
    name = "cvff"


register_bonded(HarmonicImproper, CvffImproper)


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonic_impropers(x, types, table, small, U, G):
    slopes = np.empty(6)
    collinear = kinks = 0
    for t in range(len(U)):
        cos, sin, near = cosine_and_slopes(x[t], slopes)
        if near > 0:
            # The continuation scales the cosine alone: the angle is the one that belongs to it.
            collinear += 1
            sin = np.sqrt(max(0.0, 1.0 - cos * cos))
        k, chi0 = table[types[t], 0], table[types[t], 1]
        # The angle from the plane, so that nothing cancels near χ = π; dU/dcos = −2K (χ − χ0)/sin χ is split into a
        # regular part and a kink.
        sign, plane = (1.0, 0.0) if cos >= 0.0 else (-1.0, np.pi)
        angle = np.arctan2(sin, abs(cos))
        U[t] = k * (sign * angle + (plane - chi0)) ** 2
        regular = sign * (angle / sin if sin > 0.0 else 1.0)
        kink = 0.0
        if abs(plane - chi0) > 1e-12:
            s = sin
            if s < small:
                s = small
                kinks += 1
            kink = (plane - chi0) / s
        slope = -2.0 * k * (regular + kink)
        total = U[t]
        for e in range(6):
            G[t, e] = slope * slopes[e]
            total += G[t, e]
        if not np.isfinite(total):
            return t, collinear, kinks
    return -1, collinear, kinks
