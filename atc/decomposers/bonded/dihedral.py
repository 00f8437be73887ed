"""Torsions of the topology: U(φ) of four atoms in a chain, as forces along their six distances.

Every style here is even in φ, so a polynomial in cos φ, and therefore a function of distances; it is kept as a
Chebyshev series U = Σ a_n cos nφ, dU/dcos φ = Σ n a_n sin nφ / sin φ, both polynomials: nothing is divided by sin φ,
planar chains are an ordinary case. A phase that is neither 0 nor 180° makes a term that tells a torsion from its mirror
image. Such a term has no forces along distances (formulas §2, R 4.0.28): it is refused.

With b1 = x2 − x1, b2 = x3 − x2, b3 = x4 − x3: cos φ = (b1×b2)·(b2×b3) / (|b1×b2| |b2×b3|), trans = 180°, as in LAMMPS.
Where three atoms are collinear φ has no value, and U(φ) no limit. There 1/sin θ of the angle between two successive
bonds is continued below sin θ = 0.001 by (3 − sin²θ/ε²)/(2ε), ε = 0.001: cos φ goes to 0, energy and forces stay finite
and continuous, and the forces are the energy's derivatives. Chains with such an angle are counted in the notes. (LAMMPS
clamps the sine, in styles of its own choosing.)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..base import Accumulator
from .cluster import first_not_finite
from .topology import Idle, MirrorError, RowTerm, SharedTerm, energy, plain
from .topology import whole as _whole

#: sin θ below which the collinear continuation holds
COLLINEAR = 0.001
_INNER = {"inner": ((0.0, 0.5, 0.5, 0.0), "energy shared half to each of the two inner atoms")}
_MIRROR = (
    "a chain whose torsion this phase prefers and its mirror image differ in energy, so the term is not a function of "
    "distances and has no forces along bonds"
)


class FourAtoms(SharedTerm):
    """What torsions and impropers share. Parameters: see `SharedTerm`; partition "inner": half to each of atoms 2 and
    3."""

    bodies = 4
    shares = _INNER

    @property
    def partitions(self) -> Mapping[str, str]:
        # Which atom of an improper is its centre is each model's own convention.
        return {"equal": "equal", "center": "inner"} if self.kind == "dihedral" else {"equal": "equal"}


class ZeroTorsion(Idle, FourAtoms):
    """Torsions that exert no force (LAMMPS ``dihedral_style zero``)."""

    kind = "dihedral"


class CurveTorsion(FourAtoms):
    """Base of terms with a formula of cos φ. Subclasses implement `curve`. See `FourAtoms` for the parameters."""

    kind = "dihedral"
    #: what the angle is called in notes
    angle_name = "phi"

    def curve(self, cos, sin, types, acc: Accumulator):
        """U and dU/dcos φ, (t,), of each chain; sin φ ≥ 0."""
        raise NotImplementedError

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        cos, sin, near = np.empty(len(U)), np.empty(len(U)), np.empty(len(U), np.int64)
        geometry(x_tkc, cos, sin, G, near)
        U[:], slope = self.curve(cos, sin, types, acc)
        G *= slope[:, None]
        said = f"{self.kind}s with three atoms in a line, where cos {self.angle_name} was continued to 0"
        acc.note(said, np.count_nonzero(near))
        return first_not_finite(U, G)


class Torsion(CurveTorsion):
    """Base of the torsion styles: U = Σ_n a_n cos nφ, the a_n (internal energy units) the `row` of a type."""

    def curve(self, cos, sin, types, acc):
        a = self.columns(types)
        # Chebyshev polynomials of first and second kind side by side: T_n and U_{n-1}.
        T0, T1, V0, V1 = np.ones_like(cos), cos, np.zeros_like(cos), np.ones_like(cos)
        U, slope = a[0], np.zeros_like(cos)
        for n in range(1, len(a)):
            U, slope = U + a[n] * T1, slope + n * a[n] * V1
            T0, T1, V0, V1 = T1, 2.0 * cos * T1 - T0, V1, 2.0 * cos * V1 - V0
        return U, slope


def _cosine(n: int, factor: float) -> np.ndarray:
    a = np.zeros(n + 1)
    a[n] = factor
    return a


def sign_of(phase: float) -> float:
    """1 or −1 for a phase of 0 or π (radians, to nine digits of a degree); MirrorError for others."""
    return sign_of_phase(round(np.degrees(phase), 9))


def sign_of_phase(degrees: float) -> float:
    """1 or −1 for a phase of 0 or 180 degrees; MirrorError for others."""
    if degrees % 180.0 != 0.0:
        raise MirrorError(f"the phase {degrees:g} degrees is neither 0 nor 180: {_MIRROR}")
    return 1.0 if degrees % 360.0 == 0.0 else -1.0


class HarmonicTorsion(Torsion):
    """U = K [1 + d cos nφ] (LAMMPS ``harmonic``). Coefficients K [energy], d = 1 or −1, n = 0, 1, 2, ..."""

    name = "harmonic"
    wants = (("K", energy), ("d", plain), ("n", plain))

    def row(self, K, d, n):
        if d not in (1.0, -1.0):
            raise ValueError(f"d must be 1 or -1, got {d:g}")
        a = _cosine(_whole(n, "n", 0), K * d)
        a[0] += K
        return a


class CharmmTorsion(Torsion):
    """U = K [1 + cos(nφ − d)] (LAMMPS ``charmm``). Coefficients K [energy], n, d [degrees, 0 or 180], w.

    w is the weight of a 1-4 pair interaction whose coefficients belong to a charmm pair style. From LAMMPS lines it
    becomes a term of its own (`one_four`); where there is no such term, w must be 0.
    """

    name = "charmm"
    wants = (("K", energy), ("n", plain), ("d", plain), ("w", plain))

    #: whether somebody takes care of the 1-4 pairs
    ends_done = False

    def _set(self, values: Mapping, where: str = ""):
        super()._set(values, where)
        self.end_weights = {t: v[3] for t, v in values.items() if v[3] != 0.0}

    def prepare(self, frame):
        if self.end_weights and not self.ends_done:
            t, w = next(iter(self.end_weights.items()))
            raise AtcError(
                f"dihedral type {t} of style {self.name}: the weight {w:g} asks for a 1-4 pair interaction, which is "
                "not supported here: "
                "give the dihedral types by number in LAMMPS lines with a charmm pair style, or weight 0.0"
            )
        return super().prepare(frame)

    def row(self, K, n, d, w):
        if not 0.0 <= w <= 1.0:
            raise ValueError(f"the weight of the 1-4 pair must be between 0 and 1, got {w:g}")
        a = _cosine(_whole(n, "n", 0), K * sign_of_phase(d))
        a[0] += K
        return a


class CharmmFSWTorsion(CharmmTorsion):
    """LAMMPS ``charmmfsw``: as ``charmm`` where the weight is 0."""

    name = "charmmfsw"


class OPLSTorsion(Torsion):
    """U = ½K1 (1 + cos φ) + ½K2 (1 − cos 2φ) + ½K3 (1 + cos 3φ) + ½K4 (1 − cos 4φ) (LAMMPS ``opls``). Coefficients K1
    K2 K3 K4 [energy]."""

    name = "opls"
    wants = tuple((f"K{k}", energy) for k in (1, 2, 3, 4))

    def row(self, K1, K2, K3, K4):
        return 0.5 * np.array([K1 + K2 + K3 + K4, K1, -K2, K3, -K4])


class MultiHarmonicTorsion(Torsion):
    """U = Σ_{n=1..5} A_n cosⁿ⁻¹ φ (LAMMPS ``multi/harmonic``). Coefficients A1 .. A5 [energy]."""

    name = "multi/harmonic"
    wants = tuple((f"A{k}", energy) for k in (1, 2, 3, 4, 5))

    def row(self, *A):
        return np.polynomial.chebyshev.poly2cheb(A)


class NHarmonicTorsion(RowTerm, Torsion):
    """U = Σ_{n=1..N} A_n cosⁿ⁻¹ φ (LAMMPS ``nharmonic``). Coefficients A1 .. AN [energy] (in LAMMPS's lines after their
    number N)."""

    name = "nharmonic"

    @classmethod
    def scaled(cls, numbers, u):
        return [x * u.energy for x in numbers]

    @classmethod
    def read(cls, inp, line):
        n = inp.number(line.words[0], 1.0, "the number of terms", line) if line.words else 0
        if n < 1 or n != len(line.words) - 1:
            raise inp.wrong("dihedral_coeff of nharmonic takes n and then n coefficients A1 .. An", line)
        return [inp.number(w, "energy", f"A{k}", line) for k, w in enumerate(line.words[1:], 1)]

    def row(self, *A):
        if not A:
            raise ValueError("needs at least one coefficient")
        return np.polynomial.chebyshev.poly2cheb(A)


class FourierTorsion(RowTerm, Torsion):
    """U = Σ_{i=1..m} K_i [1 + cos(n_i φ − d_i)] (LAMMPS ``fourier``). Coefficients m, then K_i [energy], n_i, d_i
    [degrees, 0 or 180] for each i."""

    name = "fourier"

    @classmethod
    def scaled(cls, numbers, u):
        return [x * u.energy if k % 3 == 1 else x for k, x in enumerate(numbers)]

    def row(self, m=0.0, *more):
        m = _whole(m, "the number of terms", 1)
        if len(more) != 3 * m:
            raise ValueError(f"{m} terms need {3 * m} numbers K n d after {m}, got {len(more)}")
        terms = [
            (K, _whole(n, "n", 0), sign_of_phase(d)) for K, n, d in zip(more[::3], more[1::3], more[2::3], strict=True)
        ]
        a = np.zeros(max(n for _, n, _ in terms) + 1)
        for K, n, sign in terms:
            a[0] += K
            a[n] += K * sign
        return a


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _inverse_root(A, y):
    """1/√A for A = y sin²θ, continued below sin θ = ε (module docstring), and its derivatives with respect to A and
    y."""
    e2 = COLLINEAR * COLLINEAR
    if A >= e2 * y:
        w = 1.0 / np.sqrt(A)
        return w, -0.5 * w / A, 0.0, 0
    s = A / (e2 * y)
    v = 1.0 / np.sqrt(y)
    w = (3.0 - s) * v / (2.0 * COLLINEAR)
    return w, -v / (2.0 * COLLINEAR * e2 * y), 3.0 * (s - 1.0) * v / (4.0 * COLLINEAR * y), 1


@njit(cache=True, nogil=True, error_model="numpy")
def cosine_and_slopes(x, slopes):
    """cos φ, |sin φ| of four atoms x (4, 3), and ∂cos φ/∂ξ of the pairs 12 13 14 23 24 34. Returns (cos, sin, how many
    collinear angles)."""
    b1x, b1y, b1z = x[1, 0] - x[0, 0], x[1, 1] - x[0, 1], x[1, 2] - x[0, 2]
    b2x, b2y, b2z = x[2, 0] - x[1, 0], x[2, 1] - x[1, 1], x[2, 2] - x[1, 2]
    b3x, b3y, b3z = x[3, 0] - x[2, 0], x[3, 1] - x[2, 1], x[3, 2] - x[2, 2]
    # Cross products from the vectors: as differences of dot products they would lose digits near collinear.
    mx, my, mz = b1y * b2z - b1z * b2y, b1z * b2x - b1x * b2z, b1x * b2y - b1y * b2x
    nx, ny, nz = b2y * b3z - b2z * b3y, b2z * b3x - b2x * b3z, b2x * b3y - b2y * b3x
    a = b1x * b1x + b1y * b1y + b1z * b1z
    b = b2x * b2x + b2y * b2y + b2z * b2z
    c = b3x * b3x + b3y * b3y + b3z * b3z
    p = b1x * b2x + b1y * b2y + b1z * b2z
    q = b2x * b3x + b2y * b3y + b2z * b3z
    t = b1x * b3x + b1y * b3y + b1z * b3z
    A = mx * mx + my * my + mz * mz
    B = nx * nx + ny * ny + nz * nz
    N = mx * nx + my * ny + mz * nz
    u, u_A, u_y, near1 = _inverse_root(A, a * b)
    v, v_B, v_y, near2 = _inverse_root(B, b * c)
    # cos = N u v; N = p q − t b, A = a b − p², B = b c − q².
    C_a = N * v * (u_A + u_y) * b
    C_c = N * u * (v_B + v_y) * b
    C_b = -t * u * v + N * v * (u_A + u_y) * a + N * u * (v_B + v_y) * c
    C_p = q * u * v - 2.0 * N * v * u_A * p
    C_q = p * u * v - 2.0 * N * u * v_B * q
    C_t = -b * u * v
    # a, b, c = 2ξ12, 2ξ23, 2ξ34; p = ξ13 − ξ12 − ξ23; q = ξ24 − ξ23 − ξ34; t = ξ14 + ξ23 − ξ13 − ξ24.
    slopes[0] = 2.0 * C_a - C_p
    slopes[1] = C_p - C_t
    slopes[2] = C_t
    slopes[3] = 2.0 * C_b - C_p - C_q + C_t
    slopes[4] = C_q - C_t
    slopes[5] = 2.0 * C_c - C_q
    volume = np.abs(mx * b3x + my * b3y + mz * b3z)
    return N * u * v, np.sqrt(b) * volume * u * v, near1 + near2


@njit(cache=True, nogil=True, error_model="numpy")
def geometry(x, cos, sin, slopes, near):
    """Fill cos φ, |sin φ|, ∂cos φ/∂ξ of the six pairs and how many collinear angles, chain by chain."""
    for t in range(len(cos)):
        c, sin[t], near[t] = cosine_and_slopes(x[t], slopes[t])
        cos[t] = min(1.0, max(-1.0, c))
        if near[t] > 0:
            # The continuation scales the cosine alone: the angle is the one that belongs to it.
            sin[t] = np.sqrt(1.0 - cos[t] * cos[t])
