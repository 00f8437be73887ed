"""Bonds whose energy is a formula of their length: U(d) and U'(d) side by side, G = U'/d."""

from __future__ import annotations

import numpy as np

from .bond import BondStyle, FeneBond, overstretched
from .topology import RowTerm, energy, length, per_length2, per_length3, per_length4, plain, whole

#: MM3's cubic constant; the quartic one is 7/12 of its square
_MM3 = 2.55  # 1/Å


class Class2Bond(BondStyle):
    """U = K2 x² + K3 x³ + K4 x⁴, x = d − r0 (COMPASS; LAMMPS ``class2``). Coefficients r0 [length], K2, K3, K4
    [energy/length², ³, ⁴]."""

    name = "class2"
    wants = (("r0", length), ("K2", per_length2), ("K3", per_length3), ("K4", per_length4))

    def curve(self, d, r0, K2, K3, K4):
        x = d - r0
        return x * x * (K2 + x * (K3 + x * K4)), x * (2.0 * K2 + x * (3.0 * K3 + x * 4.0 * K4))


class GromosBond(BondStyle):
    """U = K (d² − r0²)² (LAMMPS ``gromos``: the factor ¼ is in K). Coefficients K [energy/length⁴], r0 [length]."""

    name = "gromos"
    wants = (("K", per_length4), ("r0", length))

    def curve(self, d, K, r0):
        x = (d - r0) * (d + r0)
        return K * x * x, 4.0 * K * d * x


class NonlinearBond(BondStyle):
    """U = ε x²/(λ² − x²), x = d − r0 (LAMMPS ``nonlinear``). Coefficients ε [energy], r0, λ [length]. A bond with |x| ≥
    λ is an error."""

    name = "nonlinear"
    wants = (("epsilon", energy), ("r0", length), ("lambda", length))

    def row(self, epsilon, r0, reach):
        if not reach > 0:
            raise ValueError(f"lambda must be positive, got {reach}")
        return epsilon, r0, reach

    def curve(self, d, epsilon, r0, reach):
        x = d - r0
        rest = (reach - x) * (reach + x)
        rest = np.where(rest > 0, rest, np.nan)
        return epsilon * x * x / rest, 2.0 * epsilon * x * reach**2 / rest**2

    def refuse(self, t, d):
        return (
            f"{abs(d - self.table[t, 1]) / self.table[t, 2]:.4g} of its maximum extension lambda away from r0, where "
            "its energy is infinite"
        )


class HarmonicShiftBond(BondStyle):
    """U = U_min [x² − (r_c − r0)²]/(r0 − r_c)², x = d − r0 (LAMMPS ``harmonic/shift``). Coefficients U_min [energy],
    r0, r_c [length]."""

    name = "harmonic/shift"
    wants = (("U_min", energy), ("r0", length), ("r_c", length))

    def row(self, depth, r0, rc):
        if r0 == rc:
            raise ValueError("r0 and r_c must differ")
        return depth, r0, rc

    def curve(self, d, depth, r0, rc):
        k, x = depth / (r0 - rc) ** 2, d - r0
        return k * (x * x - (rc - r0) ** 2), 2.0 * k * x


class HarmonicShiftCutBond(HarmonicShiftBond):
    """As `HarmonicShiftBond` up to r_c, and nothing beyond (LAMMPS ``harmonic/shift/cut``)."""

    name = "harmonic/shift/cut"

    def curve(self, d, depth, r0, rc):
        U, slope = super().curve(d, depth, r0, rc)
        inside = d <= rc
        return np.where(inside, U, 0.0), np.where(inside, slope, 0.0)


class MM3Bond(BondStyle):
    """U = K x² [1 − 2.55 x + (7/12)·2.55² x²], x = d − r0 in Å (LAMMPS ``mm3``). Coefficients K [energy/length²], r0
    [length]."""

    name = "mm3"
    wants = (("K", per_length2), ("r0", length))

    def curve(self, d, K, r0):
        # Internal lengths are Å in every unit style but lj, where LAMMPS too takes the numbers as they are.
        x = d - r0
        c3, c4 = -_MM3, 7.0 / 12.0 * _MM3**2
        return K * x * x * (1.0 + x * (c3 + x * c4)), K * x * (2.0 + x * (3.0 * c3 + x * 4.0 * c4))


class FeneNMBond(BondStyle):
    """U = −½ K R0² ln[1 − (d/R0)²] + (E0/(n − m) [m (r0/d)ⁿ − n (r0/d)ᵐ] for d < r0) (LAMMPS ``fene/nm``).

    Coefficients K [energy/length²], R0 [length], E0 [energy], r0 [length], n, m. As in LAMMPS nothing is added where
    the second part ends, so the energy (not the force) jumps by E0 at d = r0. A bond of R0 or more is an error; from
    0.949 R0 on LAMMPS caps the logarithm, here the formula holds and such bonds are counted in the notes.
    """

    name = "fene/nm"
    wants = (("K", per_length2), ("R0", length), ("E0", energy), ("r0", length), ("n", plain), ("m", plain))
    noted = FeneBond.noted

    def row(self, K, R0, E0, r0, n, m):
        if not R0 > 0:
            raise ValueError(f"R0 must be positive, got {R0}")
        if n == m:
            raise ValueError("n and m must differ")
        return K, R0, E0, r0, n, m

    def curve(self, d, K, R0, E0, r0, n, m):
        q = 1.0 - (d / R0) ** 2
        q = np.where((q > 0) & (d > 0), q, np.nan)
        core = d < r0
        s = np.where(core, r0, 0.0) / np.where(d > 0, d, 1.0)
        p = np.where(core, E0 / (n - m), 0.0)
        U = -0.5 * K * R0**2 * np.log(q) + p * (m * s**n - n * s**m)
        return U, K * d / q - p * n * m * (s**n - s**m) / np.where(d > 0, d, 1.0)

    def count(self, types, d):
        return np.count_nonzero(1.0 - (d / self.table[types, 1]) ** 2 < 0.1)

    def refuse(self, t, d):
        return overstretched(d, self.table[t, 1])


def log_of_gaussians(x, kT, terms):
    """−k_B T ln Σ_i A_i/(w_i √(π/2)) exp(−2 (x − x_i)²/w_i²) and its derivative. x (m,), terms (m, n, 3) of A, w, x_i;
    A = 0: no such term."""
    A, w, centre = terms[..., 0], terms[..., 1], terms[..., 2]
    with np.errstate(divide="ignore"):
        log = np.where(A > 0, np.log(A / (w * np.sqrt(0.5 * np.pi))), -np.inf)
    y = (x[:, None] - centre) / w
    log = log - 2.0 * y * y
    top = log.max(axis=1)
    # Relative to the largest term: far from all centres the sum itself would be 0.
    p = np.exp(log - top[:, None])
    total = p.sum(axis=1)
    return -kT * (top + np.log(total)), kT * (p * 4.0 * y / w).sum(axis=1) / total


def gaussian_row(v, kB, size_A_w, size_x, what):
    """(k_B T, A_1, w_1, x_1, ..) of the numbers ``T n A_1 w_1 x_1 ...``; raises ValueError.

    LAMMPS takes the logarithm of A/w in the file's units: A is scaled as w is, so that it stays the same number.
    """
    n = whole(v[1], "the number of terms", 1) if len(v) > 1 else 0
    if n < 1 or len(v) != 2 + 3 * n:
        raise ValueError(f"expected T n and then A w {what} for each of the n terms, got {len(v)} numbers")
    A, w, x = (np.array(v[k::3]) for k in (2, 3, 4))
    if not (A >= 0).all() or not A.any() or not (w > 0).all():
        raise ValueError("every A must be at least 0, one of them positive, and every width w positive")
    return (v[0] * kB, *np.column_stack([A * size_A_w, w * size_A_w, x * size_x]).ravel())


class GaussianBond(RowTerm, BondStyle):
    """U = −k_B T ln Σ_i A_i/(w_i √(π/2)) exp(−2 (d − r_i)²/w_i²) (LAMMPS ``gaussian``, as it computes: its manual lacks
    the 2).

    Coefficients T [temperature], n, then A_i, w_i, r_i [length] for each of the n terms.
    """

    name = "gaussian"
    filling = (0.0, 1.0, 0.0)

    @classmethod
    def scaled(cls, numbers, u):
        return gaussian_row(numbers, u.boltzmann, u.length, u.length, "r")

    def curve(self, d, kT, *terms):
        return log_of_gaussians(d, kT, np.stack(terms, axis=1).reshape(len(d), -1, 3))
