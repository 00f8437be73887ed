"""Angles whose energy is a formula: of cos θ, where nothing is ever divided by sin θ, or of θ itself (see
`atc.decomposers.bonded.angle`)."""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcWarning
from .angle import AngleStyle
from .bond_curves import gaussian_row, log_of_gaussians
from .topology import RowTerm, degrees, energy, plain, whole


class QuarticAngle(AngleStyle):
    """U = K2 x² + K3 x³ + K4 x⁴, x = θ − θ0 (LAMMPS ``quartic``). Coefficients θ0 [degrees], K2, K3, K4 [energy/rad²,
    ³, ⁴]."""

    name = "quartic"
    wants = (("theta0", degrees), ("K2", energy), ("K3", energy), ("K4", energy))

    def curve(self, a, theta0, *powers):
        return a.polynomial(theta0, powers)


class MM3Angle(AngleStyle):
    """U = K x² [1 − 0.014 x° + 5.6e-5 x°² − 7e-7 x°³ + 2.2e-8 x°⁴], x = θ − θ0, x° in degrees (LAMMPS ``mm3``).

    Energy and forces are LAMMPS's (22 Jul 2025, measured): its constants, in radians to six digits, where the manual
    prints 9e-10 as the last one; and its forces, whose cubic coefficient is 1.6 % off the derivative of its energy.
    Coefficients K [energy/rad²], θ0 [degrees].
    """

    name = "mm3"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, a, K, theta0):
        x = a.theta - theta0
        U = K * x * x * (1.0 + x * (-0.802141 + x * (0.183837 + x * (-0.131664 + x * 0.237090))))
        slope_over_x = K * (2.0 + x * (-2.406422 + x * (0.735348 + x * (-0.6478318 + x * 1.422540))))
        return U, -slope_over_x * a.deviation_over_sine(x, theta0)


class FourierAngle(AngleStyle):
    """U = K [C0 + C1 cos θ + C2 cos 2θ] (LAMMPS ``fourier``). Coefficients K [energy], C0, C1, C2."""

    name = "fourier"
    wants = (("K", energy), ("C0", plain), ("C1", plain), ("C2", plain))

    def curve(self, a, K, C0, C1, C2):
        return K * (C0 + C1 * a.cos + C2 * (2.0 * a.cos * a.cos - 1.0)), K * (C1 + 4.0 * C2 * a.cos)


def multiple_cosine(n, a):
    """cos nθ and d(cos nθ)/dcos θ = n sin nθ/sin θ for whole n, (t,). Nothing is singular: both are polynomials in cos
    θ."""
    theta, near, sin = a.theta, a.sin < 1e-4, a.sin
    # n² cos nθ/cos θ [1 − (n² − 1) sin²θ/3 ...] relative to cos nθ: the next term is below 1e-16 there.
    limit = (
        n
        * n
        * np.cos(n * np.rint(theta / np.pi) * np.pi)
        / np.where(near, np.sign(a.cos), 1.0)
        * (1.0 - (n * n - 1.0) * sin * sin / 6.0)
    )
    return np.cos(n * theta), np.where(near, limit, n * np.sin(n * theta) / np.where(near, 1.0, sin))


class FourierSimpleAngle(AngleStyle):
    """U = K [1 + c cos nθ] (LAMMPS ``fourier/simple``). Coefficients K [energy], c, n.

    The forces are those LAMMPS computes (22 Jul 2025, measured): n sin nθ/sin θ = n² [1 + (1 − n²)(1 − |cos θ|)/3],
    with the other sign beyond 90° if n is even. That is exact for n = 0, 1, 2 and only good near 0 and 180° for others,
    where a warning says that forces and energy do not belong together. (``fourier`` and ``cosine/periodic`` have no
    such fault.)
    """

    name = "fourier/simple"
    wants = (("K", energy), ("c", plain), ("n", plain))

    def row(self, K, c, n):
        if n not in (0.0, 1.0, 2.0) and K and c:
            warnings.warn(
                f"angle_style fourier/simple with n = {n:g}: LAMMPS computes forces that are not the derivative of its "
                "energy for n other than 1 and 2; the run's forces are taken as they are, so energy is not balanced: "
                "use angle_style cosine/periodic or fourier in new runs",
                AtcWarning,
                stacklevel=2,
            )
        return K, c, n

    def curve(self, a, K, c, n):
        U = K * (1.0 + c * np.cos(n * a.theta))
        sign = np.where((a.cos < 0) & (n % 2 == 0), -1.0, 1.0)
        return U, K * c * sign * n * n * (1.0 + (1.0 - n * n) * (1.0 - np.abs(a.cos)) / 3.0)


class CosinePeriodicAngle(AngleStyle):
    """U = (2/n²) C [1 − B (−1)ⁿ cos nθ] (LAMMPS ``cosine/periodic``). Coefficients C [energy], B = 1 or −1, n = 1 .. 6.
    Regular at 0 and 180°."""

    name = "cosine/periodic"
    wants = (("C", energy), ("B", plain), ("n", plain))

    def row(self, C, B, n):
        if B not in (1.0, -1.0):
            raise ValueError(f"B must be 1 or -1, got {B:g}")
        return C, B, whole(n, "n", 1)

    def curve(self, a, C, B, n):
        cos_n, slope = multiple_cosine(n, a)
        sign = -B * np.where(n % 2 == 1, -1.0, 1.0)
        return 2.0 / n**2 * C * (1.0 + sign * cos_n), 2.0 / n**2 * C * sign * slope


class RestrictedAngle(AngleStyle):
    """U = K (cos θ − cos θ0)²/sin² θ (MARTINI's restricted bending; LAMMPS ``cosine/squared/restricted``). Coefficients
    K [energy], θ0 [degrees].

    Infinite at 0 and 180° (for θ0 = 0 or 180° only at the other end): such an angle is an error.
    """

    name = "cosine/squared/restricted"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, a, K, theta0):
        return restricted(a.cos, a.sin, K, np.cos(theta0))


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


class WormLikeAngle(AngleStyle):
    """U = −k_B T ln[(q1 + q2)/(1 + exp(−μ/k_B T))], q1 = exp[−k1 (1 + cos θ)/k_B T], q2 = exp[−(μ + k2 (1 + cos θ))/k_B
    T] (LAMMPS ``mwlc``).

    A worm-like chain that can melt (Farrell et al. 2024). Coefficients k1, k2, μ [energy], T [temperature]. Regular at
    0 and 180°.
    """

    name = "mwlc"
    wants = (("k1", energy), ("k2", energy), ("mu", energy), ("T", plain))

    def row(self, k1, k2, mu, T):
        if not T > 0:
            raise ValueError("T must be positive")
        return k1, k2, mu, self.units.boltzmann * T

    def curve(self, a, k1, k2, mu, kT):
        stiff, melted = -k1 * (1.0 + a.cos) / kT, -(mu + k2 * (1.0 + a.cos)) / kT
        log_q = np.logaddexp(stiff, melted)
        p = np.exp(stiff - log_q)
        return -kT * (log_q - np.logaddexp(0.0, -mu / kT)), p * k1 + (1.0 - p) * k2


class CosineShiftAngle(AngleStyle):
    """U = −½ U_min [1 + cos(θ − θ0)] (LAMMPS ``cosine/shift``). Coefficients U_min [energy], θ0 [degrees]."""

    name = "cosine/shift"
    wants = (("U_min", energy), ("theta0", degrees))

    def curve(self, a, depth, theta0, exponent=0.0):
        # c = cos(θ − θ0): its derivative with respect to cos θ is cos θ0 − sin θ0 cos θ/sin θ.
        s0 = np.where(np.abs(np.sin(theta0)) < 1e-12, 0.0, np.sin(theta0))
        U, slope = shift_exp(np.cos(theta0) * a.cos + s0 * a.sin, depth, exponent)
        return U, slope * (np.cos(theta0) - a.over_sine(s0 * a.cos))


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


class GaussianAngle(RowTerm, AngleStyle):
    """U = −k_B T ln Σ_i A_i/(w_i √(π/2)) exp(−2 (θ − θ_i)²/w_i²), θ in radians (LAMMPS ``gaussian``, as it computes:
    its manual lacks the 2).

    Coefficients T [temperature], n, then A_i, w_i [radians], θ_i [degrees] for each of the n terms.
    """

    name = "gaussian"
    filling = (0.0, 1.0, 0.0)

    @classmethod
    def scaled(cls, numbers, u):
        return gaussian_row(numbers, u.boltzmann, 1.0, degrees, "theta")

    def curve(self, a, kT, *terms):
        U, slope = log_of_gaussians(a.theta, kT, np.stack(terms, axis=1).reshape(len(kT), -1, 3))
        return U, a.over_sine(-slope)
