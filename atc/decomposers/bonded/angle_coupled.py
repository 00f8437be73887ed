"""Angles that also depend on the lengths of their two arms (a at the apex): class2 force fields (COMPASS) and YAFF's
cross terms.

G of the arm a–b gets ∂U/∂d_ab / d_ab on top of what its angle gives; see `angle`. The first arm is that
of the first atom.
"""

from __future__ import annotations

from .angle import AngleStyle
from .topology import CrossTerms, degrees, energy, energy_per_length, length, per_length2


class Class2Angle(CrossTerms, AngleStyle):
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

    def curve(self, a, theta0, *more):
        *powers, M, r1, r2, N1, N2, s1, s2 = more
        x, y, z = a.theta - theta0, a.d_b - r1, a.d_c - r2
        U, by_cos = a.polynomial(theta0, powers)
        stretch = N1 * (a.d_b - s1) + N2 * (a.d_c - s2)
        a.G_b = (M * z + N1 * x) / a.d_b
        a.G_c = (M * y + N2 * x) / a.d_c
        return U + (M * y * z + stretch * x), by_cos - a.over_sine(stretch)


class Class2P6Angle(Class2Angle):
    """`Class2Angle` with + K5 x⁵ + K6 x⁶ (MOF-FF; LAMMPS ``class2/p6``): coefficients θ0, K2 .. K6 and the same cross
    terms."""

    name = "class2/p6"
    main = (*Class2Angle.main, ("K5", energy), ("K6", energy))


class CrossAngle(AngleStyle):
    """U = K_SS y z + (K_BS0 y + K_BS1 z)(θ − θ0), y = d_1 − r1, z = d_2 − r2 (LAMMPS ``cross``).

    Coefficients K_SS [energy/length²], K_BS0, K_BS1 [energy/length/rad], r1, r2 [length], θ0 [degrees].
    """

    name = "cross"
    wants = (
        ("K_SS", per_length2), ("K_BS0", energy_per_length), ("K_BS1", energy_per_length), ("r1", length),
        ("r2", length), ("theta0", degrees),
    )  # fmt: skip

    def curve(self, a, K, N1, N2, r1, r2, theta0):
        x, y, z = a.theta - theta0, a.d_b - r1, a.d_c - r2
        stretch = N1 * y + N2 * z
        a.G_b = (K * z + N1 * x) / a.d_b
        a.G_c = (K * y + N2 * x) / a.d_c
        return K * y * z + stretch * x, -a.over_sine(stretch)
