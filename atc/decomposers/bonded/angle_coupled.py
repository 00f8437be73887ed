"""Angles that also depend on the lengths of their two arms (a at the apex): class2 force fields (COMPASS) and YAFF's
cross terms.

G of the arm a–b gets ∂U/∂d_ab / d_ab on top of what its angle gives; see `angle`. The first arm is that
of the first atom.
"""

from __future__ import annotations

import numpy as np

from .angle import AngleStyle, over_sine
from .angle_curves import deviation_over_sine, polynomial
from .topology import CrossTerms, degrees, energy, energy_per_length, length, per_length2, register_bonded


class CoupledAngle(AngleStyle):
    """Base of angles coupled to their arms. Subclasses implement `add_coupled`."""

    coupled = True

    def add_coupled(self, types, cos, sin, d_b, d_c, U, U_c, G_b, G_c):
        """Fill U, dU/dcos θ and ∂U/∂d divided by d of the two arms, all (t,). Returns how many sines were clamped."""
        raise NotImplementedError


class Class2Angle(CrossTerms, CoupledAngle):
    """U = K2 x² + K3 x³ + K4 x⁴ + M y z + N1 y' x + N2 z' x, x = θ − θ0, y = d_1 − r1, z = d_2 − r2 (COMPASS; LAMMPS
    ``class2``).

    y', z' have r1, r2 of their own. Coefficients θ0 [degrees], K2, K3, K4 [energy/rad², ³, ⁴]; ``bb`` (section BondBond
    Coeffs) M [energy/length²], r1, r2 [length]; ``ba`` (BondAngle Coeffs) N1, N2 [energy/length/rad], r1, r2 [length].
    In Python one after the other, without the words.
    """

    name = "class2"
    main = (("theta0", degrees), ("K2", energy), ("K3", energy), ("K4", energy))
    crosses = {  # noqa: RUF012
        "bb": (("M", per_length2), ("r1", length), ("r2", length)),
        "ba": (("N1", energy_per_length), ("N2", energy_per_length), ("r1", length), ("r2", length)),
    }

    def add_coupled(self, types, cos, sin, d_b, d_c, U, U_c, G_b, G_c):
        v = self.table[types].T
        m = len(self.main)
        theta0, powers = v[0], v[1:m]
        M, r1, r2, N1, N2, s1, s2 = v[m:]
        U[:], x, slope_over_x = polynomial(np.arctan2(sin, cos), theta0, powers)
        stretch = N1 * (d_b - s1) + N2 * (d_c - s2)
        U += M * (d_b - r1) * (d_c - r2) + stretch * x
        ratio, clamped = deviation_over_sine(x, theta0, cos, sin)
        cross, coupled_clamped = over_sine(stretch, sin)
        U_c[:] = -slope_over_x * ratio - cross
        G_b[:] = (M * (d_c - r2) + N1 * x) / d_b
        G_c[:] = (M * (d_b - r1) + N2 * x) / d_c
        return max(clamped, coupled_clamped)


class Class2P6Angle(Class2Angle):
    """`Class2Angle` with + K5 x⁵ + K6 x⁶ (MOF-FF; LAMMPS ``class2/p6``): coefficients θ0, K2 .. K6 and the same cross
    terms."""

    name = "class2/p6"
    main = (*Class2Angle.main, ("K5", energy), ("K6", energy))


class CrossAngle(CoupledAngle):
    """U = K_SS y z + (K_BS0 y + K_BS1 z)(θ − θ0), y = d_1 − r1, z = d_2 − r2 (LAMMPS ``cross``).

    Coefficients K_SS [energy/length²], K_BS0, K_BS1 [energy/length/rad], r1, r2 [length], θ0 [degrees].
    """

    name = "cross"
    wants = (
        ("K_SS", per_length2), ("K_BS0", energy_per_length), ("K_BS1", energy_per_length), ("r1", length),
        ("r2", length), ("theta0", degrees),
    )  # fmt: skip

    def add_coupled(self, types, cos, sin, d_b, d_c, U, U_c, G_b, G_c):
        K, N1, N2, r1, r2, theta0 = self.table[types].T
        x, y, z = np.arctan2(sin, cos) - theta0, d_b - r1, d_c - r2
        U[:] = K * y * z + (N1 * y + N2 * z) * x
        slope, clamped = over_sine(N1 * y + N2 * z, sin)
        U_c[:] = -slope
        G_b[:] = (K * z + N1 * x) / d_b
        G_c[:] = (K * y + N2 * x) / d_c
        return clamped


register_bonded(Class2Angle, Class2P6Angle, CrossAngle)
