"""Torsions coupled to the angles and bonds of their chain: COMPASS's class2 with its five cross terms, and
``spherical``."""

from __future__ import annotations

import numpy as np

from .dihedral import sign_of
from .dihedral_chain import Chain, CoupledTorsion
from .topology import CrossTerms, MirrorError, RowTerm, degrees, energy, energy_per_length, length, per_length2, whole


class Class2Torsion(CrossTerms, CoupledTorsion):
    """Σ_{n≤3} K_n [1 − cos(nφ − φ_n)] and, with c_n = cos nφ, the cross terms (COMPASS; LAMMPS ``class2``)

    ``mbt`` (d23 − r2) Σ A_n c_n, ``ebt`` (d12 − r1) Σ B_n c_n + (d34 − r3) Σ C_n c_n, ``at`` (θ1 − t1) Σ D_n c_n + (θ2
    − t2) Σ E_n c_n,
    ``aat`` M (θ1 − t1)(θ2 − t2) c_1, ``bb13`` N (d12 − r1)(d34 − r3).

    Coefficients K1 φ1 K2 φ2 K3 φ3 [energy, degrees: 0 or 180], then those of mbt, ebt, at, aat, bb13 as LAMMPS's lines
    have them (A, B, C [energy/length], D, E [energy/rad], M [energy/rad²], N [energy/length²], r [length], t
    [degrees]); in Python one after the other. Near sin θ = 0 the coupling to θ divides by no less than 0.001, as LAMMPS
    does.
    """

    name = "class2"
    main = tuple(w for n in (1, 2, 3) for w in ((f"K{n}", energy), (f"phi{n}", degrees)))
    crosses = {  # noqa: RUF012
        "mbt": (*((f"A{n}", energy_per_length) for n in (1, 2, 3)), ("r2", length)),
        "ebt": (*((f"{b}{n}", energy_per_length) for b in "BC" for n in (1, 2, 3)), ("r1", length), ("r3", length)),
        "at": (*((f"{b}{n}", energy) for b in "DE" for n in (1, 2, 3)), ("theta1", degrees), ("theta2", degrees)),
        "aat": (("M", energy), ("theta1", degrees), ("theta2", degrees)),
        "bb13": (("N", per_length2), ("r1", length), ("r3", length)),
    }

    def row(self, *numbers):
        numbers = list(numbers)
        for n in (0, 2, 4):
            # The sign of the cosine in the phase's place.
            numbers[n + 1] = sign_of(numbers[n + 1]) if numbers[n] != 0.0 else 1.0
        return numbers

    def curve(self, chain: Chain, types):
        v = self.columns(types)
        c, dc = chain.multiples()
        t1, t2, dt1, dt2 = chain.angles()
        d12, d23, d34 = chain.d
        A, r2, B, C, r1, r3, D, E, at1, at2, (M, aa1, aa2), (N, s1, s3) = (
            v[6:9], v[9], v[10:13], v[13:16], v[16], v[17], v[18:21], v[21:24], v[24], v[25], v[26:29], v[29:32]
        )  # fmt: skip

        def series(a):
            """Σ a_n cos nφ and its derivative by cos φ."""
            return sum(x * y for x, y in zip(a, c, strict=True)), sum(x * y for x, y in zip(a, dc, strict=True))

        (own, own_c), (mid, mid_c), (end1, end1_c), (end3, end3_c), (ang1, ang1_c), (ang2, ang2_c) = map(
            series, ([-v[0] * v[1], -v[2] * v[3], -v[4] * v[5]], A, B, C, D, E)
        )
        y1, y2, y3, x1, x2, z1, z2 = d12 - r1, d23 - r2, d34 - r3, t1 - at1, t2 - at2, t1 - aa1, t2 - aa2
        U = v[0] + v[2] + v[4] + own + y2 * mid + y1 * end1 + y3 * end3 + x1 * ang1 + x2 * ang2
        U = U + M * z1 * z2 * c[0] + N * (d12 - s1) * (d34 - s3)
        return U, np.stack(
            [
                end1 + N * (d34 - s3),
                mid,
                end3 + N * (d12 - s1),
                (ang1 + M * z2 * c[0]) * dt1,
                (ang2 + M * z1 * c[0]) * dt2,
                own_c + y2 * mid_c + y1 * end1_c + y3 * end3_c + x1 * ang1_c + x2 * ang2_c + M * z1 * z2,
            ],
            axis=1,
        )


class SphericalTorsion(RowTerm, CoupledTorsion):
    """U = Σ_i C_i [u_i − cos K_i(φ − a_i)] [v_i − cos L_i(θ1 − b_i)] [w_i − cos M_i(θ2 − c_i)] (LAMMPS ``spherical``).

    Coefficients n, then for each term C [energy], K, a [degrees], u, L, b [degrees], v, M, c [degrees], w. K whole and
    K a a multiple of 180°: other terms tell the chain from its mirror image. The pressure tensor that LAMMPS (22 Jul
    2025) prints for this style is not that of its own forces; this one is. Where θ's factor has a slope at 0 or 180°
    its sine is clamped at 0.001.
    """

    name = "spherical"

    @classmethod
    def scaled(cls, numbers, u):
        n = whole(numbers[0], "the number of terms", 1) if numbers else 0
        if n < 1 or len(numbers) != 1 + 10 * n:
            raise ValueError(
                f"expected n and then C K a u L b v M c w for each of the n terms, got {len(numbers)} numbers"
            )
        terms = np.reshape(numbers[1:], (n, 10)) * [u.energy, 1, degrees, 1, 1, degrees, 1, 1, degrees, 1]
        return terms.ravel()

    def row(self, *numbers):
        for C, K, a, *_ in np.reshape(numbers, (-1, 10)):
            if C != 0.0:
                whole_multiple(K)
                sign_of(K * a)
        return numbers

    def curve(self, chain: Chain, types):
        t1, t2, dt1, dt2 = chain.angles()
        U, partial = np.zeros(len(types)), np.zeros((len(types), 6))
        for C, K, a, u, L, b, v, M, c, w in np.moveaxis(self.table[types].reshape(len(types), -1, 10), 1, 0).transpose(
            0, 2, 1
        ):
            sign = np.where(np.cos(K * a) < 0, -1.0, 1.0)
            cos_K, slope_K = chebyshev(K, chain.cos)
            p, q, r = u - sign * cos_K, v - np.cos(L * (t1 - b)), w - np.cos(M * (t2 - c))
            U += C * p * q * r
            partial[:, 3] += C * p * r * L * np.sin(L * (t1 - b)) * dt1
            partial[:, 4] += C * p * q * M * np.sin(M * (t2 - c)) * dt2
            partial[:, 5] -= C * q * r * sign * slope_K
        return U, partial


def whole_multiple(K):
    """Raise MirrorError for a multiple of φ that is no whole number."""
    if K != int(K):
        raise MirrorError(
            f"the multiple {K:g} of phi is no whole number: the energy has a step at 180 degrees, where the forces "
            "have no value"
        )


def chebyshev(n, c):
    """T_n(c) and its derivative for whole n ≥ 0 or < 0, elementwise."""
    n = np.abs(n).astype(int)
    T, dT = np.ones_like(c), np.zeros_like(c)
    T0, T1, V0, V1 = np.ones_like(c), c, np.zeros_like(c), np.ones_like(c)
    for k in range(1, int(n.max(initial=0)) + 1):
        T, dT = np.where(n == k, T1, T), np.where(n == k, k * V1, dT)
        T0, T1 = T1, 2.0 * c * T1 - T0
        V0, V1 = V1, 2.0 * c * V1 - V0
    return T, dT
