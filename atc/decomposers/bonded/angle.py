"""Angles of the topology: U(θ) at the middle atom of three, a third of it to each, as forces along the three distances.

With the apex a between b and c (formulas §2): G of an arm is U_c (1/(d_ab d_ac) − cos θ/d_ab²), of the distance b–c
−U_c/(d_ab d_ac), where U_c = dU/dcos θ = −U'(θ)/sin θ. Styles that are polynomials in cos θ have it without a division;
the others divide by sin θ, where U' vanishes at 0 or 180° by its limit, otherwise by no less than 0.001 (as LAMMPS
does), and such angles are counted in the notes.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from ..base import Accumulator
from .cluster import first_not_finite
from .table import Tables, build_tables
from .topology import Idle, SharedTerm, degrees, energy, length, per_length2

#: LAMMPS's SMALL: the least sin θ that is divided by.
SMALL = 0.001
_CENTER = ((0.0, 1.0, 0.0), "energy to the middle atom")


class Angles:
    """The geometry of some angles, (t,) each: d_b, d_c the lengths of the arms (d2_b, d2_c their squares, d their
    product), d_bc the distance of the outer atoms, cos, sin, theta.

    What a style's energy gives besides: G_b, G_c, G_bc, the G of the three distances beyond what the angle gives, and
    `clamped`, which angles have a sine that is too small to be divided by.
    """

    G_b = G_c = G_bc = 0.0

    def __init__(self, x_tkc):
        def dot(u, v):
            return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]

        # By components: numpy is slow along axes of three.
        b, c, bc = ([x_tkc[:, p, k] - x_tkc[:, q, k] for k in range(3)] for p, q in ((0, 1), (2, 1), (0, 2)))
        self.d2_b, self.d2_c = dot(b, b), dot(c, c)
        self.d_b, self.d_c, self.d_bc = np.sqrt(self.d2_b), np.sqrt(self.d2_c), np.sqrt(dot(bc, bc))
        self.d = d = np.sqrt(self.d2_b * self.d2_c)
        self.cos = np.clip(dot(b, c) / d, -1.0, 1.0)
        # From the cross product: accurate near 0 and 180°.
        across = b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2], b[0] * c[1] - b[1] * c[0]
        self.sin = np.sqrt(dot(across, across)) / d
        self.theta = np.arctan2(self.sin, self.cos)
        self.clamped = np.zeros(len(d), bool)

    def over_sine(self, v):
        """v/sin θ with sin θ at least 0.001."""
        self.clamped |= (self.sin < SMALL) & (v != 0.0)
        return v / np.maximum(self.sin, SMALL)

    def deviation_over_sine(self, x, theta0):
        """x/sin θ, x = θ − θ0: its limit where θ0 = 0 or 180° is the very end that the angle is near."""
        ratio, small = x / np.maximum(self.sin, SMALL), np.flatnonzero(self.sin < SMALL)
        end, cos, s = theta0[small], self.cos[small], self.sin[small]
        own = (np.abs(np.sin(end)) < 1e-12) & ((np.cos(end) < 0) == (cos < 0))
        self.clamped[small[~own]] = True
        # x = ± asin(sin θ); the next term of the series is 3/40 sin⁴ θ.
        ratio[small[own]] = (np.where(cos < 0, -1.0, 1.0) * (1.0 + s * s / 6.0))[own]
        return ratio

    def polynomial(self, theta0, powers):
        """U = Σ K_n x^n from n = 2, x = θ − θ0, and dU/dcos θ."""
        x = self.theta - theta0
        U = slope = 0.0
        for n in range(len(powers) + 1, 1, -1):
            U = U * x + powers[n - 2]
            slope = slope * x + n * powers[n - 2]
        return U * x * x, -slope * self.deviation_over_sine(x, theta0)


class AngleStyle(SharedTerm):
    """Base of the angle styles. Subclasses implement `curve`, or `energies`.

    Parameters: see `SharedTerm`; partition "equal": a third to each atom, as LAMMPS; "center": all to the middle one.
    """

    kind = "angle"
    bodies = 3
    origin = 1
    partitions = MappingProxyType({"equal": "equal", "center": "center"})
    shares = MappingProxyType(
        {"equal": ((1.0 / 3.0,) * 3, "energy shared a third to each atom"), "center": _CENTER, "centre": _CENTER}
    )

    def curve(self, a: Angles, *columns):
        """U and dU/dcos θ, (t,); `columns` are the coefficients of each angle."""
        raise NotImplementedError

    def energies(self, types, a: Angles):
        """The same of angles of these types."""
        return self.curve(a, *self.columns(types))

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        with np.errstate(all="ignore"):  # said by `complaint`
            a = Angles(x_tkc)
            U[:], by_cos = self.energies(types, a)
            v = 1.0 / a.d
            G[:, 0] = by_cos * (v - a.cos / a.d2_b) + a.G_b
            G[:, 1] = a.G_bc - by_cos * v
            G[:, 2] = by_cos * (v - a.cos / a.d2_c) + a.G_c
        acc.note("angles near 0 or 180 degrees where sin was clamped at 0.001", a.clamped.sum())
        return first_not_finite(U, G)

    def complaint(self, frame, atoms_k, kind, x_kc):
        ids = ", ".join(str(i) for i in frame.ids[atoms_k])
        if not (x_kc[[0, 2]] != x_kc[1]).any(axis=1).all():
            return f"two atoms of the angle {ids} are at the same place, so it has no angle: remove one of them"
        return (
            f"the angle {ids} (type {kind}, style {self.name}) is {np.degrees(Angles(x_kc[None]).theta[0]):.6g} "
            "degrees, where its energy is not a finite number"
        )


class CosineAngle(AngleStyle):
    """U = K (1 + cos θ). Coefficient K [energy]. Regular at 0 and 180°."""

    name = "cosine"
    wants = (("K", energy),)

    def curve(self, a, K):
        return K * (1.0 + a.cos), K


class CosineSquaredAngle(AngleStyle):
    """U = K (cos θ − cos θ0)². Coefficients K [energy], θ0 [degrees]. Regular at 0 and 180°."""

    name = "cosine/squared"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, a, K, theta0):
        delta = a.cos - np.cos(theta0)
        return K * delta * delta, 2.0 * K * delta


class CosineDeltaAngle(AngleStyle):
    """U = K [1 − cos(θ − θ0)]. Coefficients K [energy], θ0 [degrees]. Where sin θ < 0.001 and θ0 is neither 0 nor 180°
    the sine is clamped."""

    name = "cosine/delta"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, a, K, theta0):
        # 1 − cos x = 2 sin²(x/2): no cancellation near θ0.
        half = np.sin(0.5 * (a.theta - theta0))
        # θ0 = 0 or 180°: U is a polynomial in cos θ.
        s0 = np.where(np.abs(np.sin(theta0)) < 1e-12, 0.0, np.sin(theta0))
        return 2.0 * K * half * half, -K * (np.cos(theta0) - a.over_sine(s0 * a.cos))


class HarmonicAngle(AngleStyle):
    """U = K (θ − θ0)² (LAMMPS's K: no ½). Coefficients K [energy/rad²], θ0 [degrees].

    For θ0 = 0 or 180° U'/sin θ has a limit there and is taken to it; for other θ0 sin θ is clamped at 0.001, as LAMMPS
    does.
    """

    name = "harmonic"
    wants = (("K", energy), ("theta0", degrees))

    def curve(self, a, K, theta0):
        return a.polynomial(theta0, (K,))


class CharmmAngle(AngleStyle):
    """U = K (θ − θ0)² + K_UB (d_bc − r_UB)² with the outer atoms' distance (Urey-Bradley). Coefficients K
    [energy/rad²], θ0 [degrees], K_UB [energy/length²], r_UB [length]. At 0 and 180° as `HarmonicAngle`."""

    name = "charmm"
    wants = (("K", energy), ("theta0", degrees), ("K_UB", per_length2), ("r_UB", length))

    def curve(self, a, K, theta0, K_UB, r_UB):
        U, by_cos = a.polynomial(theta0, (K,))
        x = a.d_bc - r_UB
        # Outer atoms at one place have no direction, and no force.
        a.G_bc = np.divide(2.0 * K_UB * x, a.d_bc, out=np.zeros_like(x), where=a.d_bc > 0)
        return U + K_UB * x * x, by_cos


class ZeroAngle(Idle, AngleStyle):
    """Angles that exert no force (LAMMPS ``angle_style zero``)."""

    at_rest = (("theta0", degrees),)


class TableAngle(AngleStyle):
    """U(θ) and −U'(θ) interpolated in a LAMMPS angle table (``angle_style table linear|spline N``). sin θ is clamped at
    0.001, as LAMMPS does."""

    name = "table"

    def __init__(self, tables: Tables, *, partition="equal"):
        self.tables = tables
        self.units = tables.units
        self.covered = frozenset(tables.types)
        self.share(partition)

    @classmethod
    def build(cls, inp):
        return cls(build_tables(inp))

    def energies(self, types, a):
        # atan2 gives at most π rounded, which is where the table ends.
        U, F = self.tables.lookup(types, a.theta)
        return U, a.over_sine(F)
