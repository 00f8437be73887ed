"""Angles whose energy is a formula: of cos θ, where nothing is ever divided by sin θ, or of θ itself (see
`atc.decomposers.bonded.angle`)."""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcWarning
from .angle import AngleStyle, over_sine
from .bond_curves import gaussian_row, log_of_gaussians
from .topology import RowTerm, degrees, energy, kelvin, plain, register_bonded


class CosineCurve(AngleStyle):
    """Base of angles with a formula of cos θ. Subclasses implement `curve`."""

    def curve(self, cos, sin, *columns):
        """U and dU/dcos θ, (t,); `columns` are the coefficients of each angle."""
        raise NotImplementedError

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        U[:], U_c[:] = self.curve(cos, sin, *self.table[types].T)
        return 0


class ThetaCurve(AngleStyle):
    """Base of angles with a formula of θ. Subclasses implement `curve`; sin θ is clamped at 0.001 as LAMMPS does, and
    such angles are counted."""

    def curve(self, theta, *columns):
        """U and dU/dθ, (t,); `columns` are the coefficients of each angle."""
        raise NotImplementedError

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        U[:], slope = self.curve(np.arctan2(sin, cos), *self.table[types].T)
        U_c[:], clamped = over_sine(-slope, sin)
        return clamped


class ThetaPolynomial(AngleStyle):
    """Base of U = Σ_{n≥2} K_n x^n, x = θ − θ0, with θ0 in column `at` and K_2, K_3, .. in `powers`.

    U' has the factor x: for θ0 = 0 or 180° x/sin θ has a limit there, which is taken.
    """

    at = 0

    def powers(self, *columns):
        """K_2, K_3, ... of each angle, (t,) each."""
        return columns[1:]

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        columns = self.table[types].T
        U[:], x, slope_over_x = polynomial(np.arctan2(sin, cos), columns[self.at], self.powers(*columns))
        ratio, clamped = deviation_over_sine(x, columns[self.at], cos, sin)
        U_c[:] = -slope_over_x * ratio
        return clamped


def polynomial(theta, theta0, powers):
    """U = Σ K_n x^n from n = 2, x = θ − θ0, and U'/x."""
    x = theta - theta0
    U = slope = 0.0
    for n in range(len(powers) + 1, 1, -1):
        U = U * x + powers[n - 2]
        slope = slope * x + n * powers[n - 2]
    return U * x * x, x, slope


def deviation_over_sine(x, theta0, cos, sin):
    """(θ − θ0)/sin θ, and how many were clamped: none where θ0 = 0 or 180° is the very end the angle is near."""
    ratio, _ = over_sine(x, sin)
    small = sin < 0.001
    own = small & (np.abs(np.sin(theta0)) < 1e-12) & ((np.cos(theta0) < 0) == (cos < 0))
    # x = ± asin(sin θ); the next term of the series is 3/40 sin⁴ θ.
    ratio = np.where(own, np.where(cos < 0, -1.0, 1.0) * (1.0 + sin * sin / 6.0), ratio)
    return ratio, int(np.count_nonzero(small & ~own))


class QuarticAngle(ThetaPolynomial):
    """U = K2 x² + K3 x³ + K4 x⁴, x = θ − θ0 (LAMMPS ``quartic``). Coefficients θ0 [degrees], K2, K3, K4 [energy/rad²,
    ³, ⁴]."""

    name = "quartic"
    wants = (("theta0", degrees), ("K2", energy), ("K3", energy), ("K4", energy))


class MM3Angle(AngleStyle):
    """U = K x² [1 − 0.014 x° + 5.6e-5 x°² − 7e-7 x°³ + 2.2e-8 x°⁴], x = θ − θ0, x° in degrees (LAMMPS ``mm3``).

    Energy and forces are LAMMPS's (22 Jul 2025, measured): its constants, in radians to six digits, where the manual
    prints 9e-10 as the last one; and its forces, whose cubic coefficient is 1.6 % off the derivative of its energy.
    Coefficients K [energy/rad²], θ0 [degrees].
    """

    name = "mm3"
    wants = (("K", energy), ("theta0", degrees))

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        K, theta0 = self.table[types].T
        x = np.arctan2(sin, cos) - theta0
        U[:] = K * x * x * (1.0 + x * (-0.802141 + x * (0.183837 + x * (-0.131664 + x * 0.237090))))
        ratio, clamped = deviation_over_sine(x, theta0, cos, sin)
        U_c[:] = -K * (2.0 + x * (-2.406422 + x * (0.735348 + x * (-0.6478318 + x * 1.422540)))) * ratio
        return clamped


class FourierAngle(CosineCurve):
    """U = K [C0 + C1 cos θ + C2 cos 2θ] (LAMMPS ``fourier``). Coefficients K [energy], C0, C1, C2."""

    name = "fourier"
    wants = (("K", energy), ("C0", plain), ("C1", plain), ("C2", plain))

    def curve(self, cos, sin, K, C0, C1, C2):
        return K * (C0 + C1 * cos + C2 * (2.0 * cos * cos - 1.0)), K * (C1 + 4.0 * C2 * cos)


def multiple_cosine(n, cos, sin):
    """cos nθ and d(cos nθ)/dcos θ = n sin nθ/sin θ for whole n, (t,). Nothing is singular: both are polynomials in cos
    θ."""
    theta = np.arctan2(sin, cos)
    near = sin < 1e-4
    # n² cos nθ/cos θ [1 − (n² − 1) sin²θ/3 ...] relative to cos nθ: the next term is below 1e-16 there.
    limit = (
        n
        * n
        * np.cos(n * np.rint(theta / np.pi) * np.pi)
        / np.where(near, np.sign(cos), 1.0)
        * (1.0 - (n * n - 1.0) * sin * sin / 6.0)
    )
    return np.cos(n * theta), np.where(near, limit, n * np.sin(n * theta) / np.where(near, 1.0, sin))


class FourierSimpleAngle(CosineCurve):
    """U = K [1 + c cos nθ] (LAMMPS ``fourier/simple``). Coefficients K [energy], c, n.

    The forces are those LAMMPS computes (22 Jul 2025, measured): n sin nθ/sin θ = n² [1 + (1 − n²)(1 − |cos θ|)/3],
    with the other sign beyond 90° if n is even. That is exact for n = 0, 1, 2 and only good near 0 and 180° for others,
    where a warning says that forces and energy do not belong together. (``fourier`` and ``cosine/periodic`` have no
    such fault.)
    """

    name = "fourier/simple"
    wants = (("K", energy), ("c", plain), ("n", plain))

    def check(self, t):
        n = self.table[t, 2]
        if n not in (0.0, 1.0, 2.0) and self.table[t, 0] and self.table[t, 1]:
            warnings.warn(
                f"angle_style fourier/simple with n = {n:g}: LAMMPS computes forces that are not the derivative of its "
                "energy for n other than 1 and 2; the run's forces are taken as they are, so energy is not balanced: "
                "use angle_style cosine/periodic or fourier in new runs",
                AtcWarning,
                stacklevel=2,
            )
        return None

    def curve(self, cos, sin, K, c, n):
        U = K * (1.0 + c * np.cos(n * np.arctan2(sin, cos)))
        sign = np.where((cos < 0) & (n % 2 == 0), -1.0, 1.0)
        return U, K * c * sign * n * n * (1.0 + (1.0 - n * n) * (1.0 - np.abs(cos)) / 3.0)


class CosinePeriodicAngle(AngleStyle):
    """U = (2/n²) C [1 − B (−1)ⁿ cos nθ] (LAMMPS ``cosine/periodic``). Coefficients C [energy], B = 1 or −1, n = 1 .. 6.
    Regular at 0 and 180°."""

    name = "cosine/periodic"
    wants = (("C", energy), ("B", plain), ("n", plain))

    def check(self, t):
        _, B, n = self.table[t]
        if B not in (1.0, -1.0):
            return f"B must be 1 or -1, got {B:g}"
        return None if n == int(n) and n >= 1 else f"n must be a whole number from 1, got {n:g}"

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        C, B, n = self.table[types].T
        cos_n, slope = multiple_cosine(n, cos, sin)
        sign = -B * np.where(n % 2 == 1, -1.0, 1.0)
        U[:] = 2.0 / n**2 * C * (1.0 + sign * cos_n)
        U_c[:] = 2.0 / n**2 * C * sign * slope
        return 0


class RestrictedAngle(CosineCurve):
    """U = K (cos θ − cos θ0)²/sin² θ (MARTINI's restricted bending; LAMMPS ``cosine/squared/restricted``). Coefficients
    K [energy], θ0 [degrees].

    Infinite at 0 and 180° (for θ0 = 0 or 180° only at the other end): such an angle is an error.
    """

    name = "cosine/squared/restricted"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, cos, sin, K, theta0):
        return restricted(cos, sin, K, np.cos(theta0))


def restricted(cos, sin, K, cos0):
    """K (cos − cos0)²/sin² and its derivative with respect to cos; inf where sin = 0."""
    # (c − c0)²/(1 − c²) is (1 ∓ c)/(1 ± c) for c0 = ±1: there one end is regular.
    end = np.abs(np.abs(cos0) - 1.0) < 1e-14
    s = np.sign(cos0)
    with np.errstate(divide="ignore", invalid="ignore"):
        x, y = cos - cos0, 1.0 / (sin * sin)
        general = K * x * x * y, 2.0 * K * x * y * (1.0 + x * cos * y)
        z = 1.0 / np.where(1.0 + s * cos > 0.5, 1.0 + s * cos, sin * sin / (1.0 - s * cos))
        at_end = K * (1.0 - s * cos) * z, -2.0 * K * s * z * z
    return tuple(np.where(end, a, b) for a, b in zip(at_end, general, strict=True))


class WormLikeAngle(CosineCurve):
    """U = −k_B T ln[(q1 + q2)/(1 + exp(−μ/k_B T))], q1 = exp[−k1 (1 + cos θ)/k_B T], q2 = exp[−(μ + k2 (1 + cos θ))/k_B
    T] (LAMMPS ``mwlc``).

    A worm-like chain that can melt (Farrell et al. 2024). Coefficients k1, k2, μ [energy], T [temperature]. Regular at
    0 and 180°.
    """

    name = "mwlc"
    wants = (("k1", energy), ("k2", energy), ("mu", energy), ("T", kelvin))

    def check(self, t):
        return None if self.table[t, 3] > 0 else "T must be positive"

    def curve(self, cos, sin, k1, k2, mu, kT):
        stiff, melted = -k1 * (1.0 + cos) / kT, -(mu + k2 * (1.0 + cos)) / kT
        log_q = np.logaddexp(stiff, melted)
        p = np.exp(stiff - log_q)
        return -kT * (log_q - np.logaddexp(0.0, -mu / kT)), p * k1 + (1.0 - p) * k2


class CosineShiftAngle(ThetaCurve):
    """U = −½ U_min [1 + cos(θ − θ0)] (LAMMPS ``cosine/shift``). Coefficients U_min [energy], θ0 [degrees]."""

    name = "cosine/shift"
    wants = (("U_min", energy), ("theta0", degrees))

    def exponent(self, columns):
        """a of `cosine/shift/exp`: 0 here."""
        return 0.0

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        depth, theta0 = self.table[types, 0], self.table[types, 1]
        # c = cos(θ − θ0): its derivative with respect to cos θ is cos θ0 − sin θ0 cos θ/sin θ.
        s0 = np.where(np.abs(np.sin(theta0)) < 1e-12, 0.0, np.sin(theta0))
        c = np.cos(theta0) * cos + s0 * sin
        U[:], slope = shift_exp(c, depth, self.exponent(self.table[types]))
        ratio, _ = over_sine(s0 * cos, sin)
        U_c[:] = slope * (np.cos(theta0) - ratio)
        return int(np.count_nonzero((sin < 0.001) & (s0 != 0.0)))


def shift_exp(c, depth, a):
    """U = −U_min (e^{−a u} − 1)/(e^a − 1) with u = −½(1 + c), and dU/dc; as LAMMPS to first order in a where |a| <
    0.001."""
    u = -0.5 * (1.0 + c)
    a = np.asarray(a, float)
    small = np.abs(a) < 0.001
    b = np.where(small, 1.0, a)
    U = np.where(small, depth * u * (1.0 - 0.5 * a * (1.0 + u)), -depth * np.expm1(-b * u) / np.expm1(b))
    slope = np.where(small, depth * (1.0 - 0.5 * a * (1.0 + 2.0 * u)), depth * b * np.exp(-b * u) / np.expm1(b))
    return U, -0.5 * slope


class CosineShiftExpAngle(CosineShiftAngle):
    """U = −U_min (e^{−a u} − 1)/(e^a − 1), u = −½[1 + cos(θ − θ0)] (LAMMPS ``cosine/shift/exp``). Coefficients U_min
    [energy], θ0 [degrees], a."""

    name = "cosine/shift/exp"
    wants = (*CosineShiftAngle.wants, ("a", plain))

    def exponent(self, columns):
        return columns[:, 2]


class GaussianAngle(RowTerm, ThetaCurve):
    """U = −k_B T ln Σ_i A_i/(w_i √(π/2)) exp(−2 (θ − θ_i)²/w_i²), θ in radians (LAMMPS ``gaussian``, as it computes:
    its manual lacks the 2).

    Coefficients T [temperature], n, then A_i, w_i [radians], θ_i [degrees] for each of the n terms.
    """

    name = "gaussian"
    filling = (0.0, 1.0, 0.0)

    @classmethod
    def row(cls, numbers, u):
        return gaussian_row(numbers, kelvin(u), 1.0, degrees(u), "theta")

    def curve(self, theta, kT, *terms):
        return log_of_gaussians(theta, kT, np.stack(terms, axis=1).reshape(len(theta), -1, 3))


register_bonded(QuarticAngle, MM3Angle, FourierAngle, FourierSimpleAngle, CosinePeriodicAngle, RestrictedAngle)
register_bonded(WormLikeAngle, CosineShiftAngle, CosineShiftExpAngle, GaussianAngle)
