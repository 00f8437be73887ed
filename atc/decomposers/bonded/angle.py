"""Angles of the topology: U(θ) at the middle atom of three, a third of it to each, as forces along the three distances.

With the apex a between b and c (formulas §2): G of an arm is U_c (1/(d_ab d_ac) − cos θ/d_ab²), of the distance b–c
−U_c/(d_ab d_ac), where U_c = dU/dcos θ = −U'(θ)/sin θ. Styles that are polynomials in cos θ have it without a division;
the others divide by sin θ, where U' vanishes at 0 or 180° by its limit, otherwise by no less than 0.001 (as LAMMPS
does), and such angles are counted in the notes.
"""

from __future__ import annotations

from types import MappingProxyType

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ..base import Accumulator, Work
from ..images import Images
from ..registry import angle_style
from .cluster import weights_of
from .table import Tables, build_tables
from .topology import CHUNK, BondedTerm, degrees, energy, length, per_length2, register_bonded

# LAMMPS's SMALL: the least sin θ that is divided by.
_SMALL = 0.001


def over_sine(v, sin):
    """v/sin θ with sin θ at least 0.001, and how many were clamped."""
    small = sin < _SMALL
    return v / np.where(small, _SMALL, sin), int(np.count_nonzero(small & (v != 0.0)))


_CENTER = ((0.0, 1.0, 0.0), "energy to the middle atom")
_SHARES = {"center": _CENTER, "centre": _CENTER}


class AngleStyle(BondedTerm):
    """Base of the angle styles. Subclasses implement `add`.

    Parameters
    ----------
    coeffs, units : see `BondedTerm`
    partition : how an angle's energy is shared among its atoms: "equal" (a third each, as LAMMPS), "center" (all to the
        middle atom), or three
        numbers that add up to 1, in the order of the topology. Stress and total energy do not depend on it; heat flux
        and churning do.
    """

    kind = part_name = "angle"
    partitions = MappingProxyType({"equal": "equal", "center": "center"})
    weights = np.full(3, 1.0 / 3.0)
    shared = "energy shared a third to each atom"
    #: whether the energy depends on the lengths of the arms too, see `angle_coupled`
    coupled = False

    def __init__(self, coeffs, *, units="metal", partition="equal"):
        super().__init__(coeffs, units=units)
        self.share(partition)

    def share(self, partition):
        self.weights, words = weights_of(partition, 3, _SHARES, f"angle {self.name}")
        self.shared = AngleStyle.shared if isinstance(partition, str) and partition == "equal" else words

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        """Fill U and U_c = dU/dcos θ, all (t,). `d_bc` is the distance of the outer atoms, `G_bc` (zeros) a pair force
        between them.

        Returns the number of angles where sin θ was too small to divide by."""
        raise NotImplementedError

    def describe(self) -> str:
        return f"angle {self.name}, {self.shared}"

    def prepare(self, frame: Frame) -> Work:
        return _AngleWork(self, frame)


class _AngleWork(Work):
    def __init__(self, term: AngleStyle, frame: Frame):
        self.term, self.frame = term, frame
        atoms, self.types = term.terms_of(frame)
        self.b, self.a, self.c = (np.ascontiguousarray(atoms[:, k]) for k in range(3))
        self.images = Images(frame.cell)
        self.stages = (-(-len(atoms) // CHUNK),)

    def run(self, stage, task, acc: Accumulator):
        here = slice(task * CHUNK, (task + 1) * CHUNK)
        b, a, c, types = self.b[here], self.a[here], self.c[here], self.types[here]
        n = len(a)
        r_b, r_c, cos, sin, d_bc = np.empty((n, 3)), np.empty((n, 3)), np.empty(n), np.empty(n), np.empty(n)
        self.images.vectors_to(self.frame.positions, b, a, r_b)
        self.images.vectors_to(self.frame.positions, c, a, r_c)
        bad = _geometry(r_b, r_c, cos, sin, d_bc)
        if bad >= 0:
            ids = ", ".join(str(self.frame.ids[k[bad]]) for k in (b, a, c))
            raise AtcError(
                f"{self.frame.source}: two atoms of the angle {ids} are at the same place, so it has no angle: remove "
                "one of them"
            )
        U, U_c, G_bc = np.zeros(n), np.zeros(n), np.zeros(n)
        if self.term.coupled:
            G_arms, d_b, d_c = np.zeros((2, n)), np.sqrt((r_b**2).sum(axis=1)), np.sqrt((r_c**2).sum(axis=1))
            clamped = self.term.add_coupled(types, cos, sin, d_b, d_c, U, U_c, *G_arms)
        else:
            clamped = self.term.add(types, cos, sin, d_bc, U, U_c, G_bc)
        acc.note("angles near 0 or 180 degrees where sin was clamped at 0.001", clamped)
        acc.energy += float(U.sum())
        i, j, r, G = np.empty(3 * n, np.int32), np.empty(3 * n, np.int32), np.empty((3 * n, 3)), np.empty(3 * n)
        _assemble(b, a, c, r_b, r_c, cos, U_c, G_bc, i, j, r, G)
        if self.term.coupled:
            G[0::3] += G_arms[0]
            G[1::3] += G_arms[1]
        finite = np.isfinite(U) & np.isfinite(G.reshape(-1, 3)).all(axis=1)
        if not finite.all():
            bad = int(np.argmin(finite))
            ids = ", ".join(str(self.frame.ids[k[bad]]) for k in (b, a, c))
            raise AtcError(
                f"{self.frame.source}: the angle {ids} (type {types[bad]}, style {self.term.name}) is "
                f"{np.degrees(np.arctan2(sin[bad], cos[bad])):.6g} degrees, where its energy is not a finite number"
            )
        if acc.energies is not None:
            _share3(b, a, c, U, self.term.weights, acc.energies)
        D = None
        if acc.sources:
            D = np.empty((3 * n, 2, 3))
            _sources3(r, G, self.term.weights, D)
        return Bonds(i, j, r, G, D)


@njit(cache=True, nogil=True, error_model="numpy")
def _geometry(r_b, r_c, cos, sin, d_bc):
    """cos θ and sin θ (the sine from the cross product: accurate near 0 and 180°), |x_b − x_c|. Returns the first angle
    with an arm of length 0."""
    for t in range(len(cos)):
        xb, yb, zb = r_b[t, 0], r_b[t, 1], r_b[t, 2]
        xc, yc, zc = r_c[t, 0], r_c[t, 1], r_c[t, 2]
        d = np.sqrt((xb * xb + yb * yb + zb * zb) * (xc * xc + yc * yc + zc * zc))
        if d == 0.0:
            return t
        u, v, w = yb * zc - zb * yc, zb * xc - xb * zc, xb * yc - yb * xc
        c = (xb * xc + yb * yc + zb * zc) / d
        cos[t] = min(1.0, max(-1.0, c))
        sin[t] = np.sqrt(u * u + v * v + w * w) / d
        d_bc[t] = np.sqrt((xb - xc) ** 2 + (yb - yc) ** 2 + (zb - zc) ** 2)
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def _assemble(b, a, c, r_b, r_c, cos, U_c, G_bc, i, j, r, G):
    """Three bonds an angle: b–a, c–a, b–c."""
    for t in range(len(a)):
        d2b = r_b[t, 0] ** 2 + r_b[t, 1] ** 2 + r_b[t, 2] ** 2
        d2c = r_c[t, 0] ** 2 + r_c[t, 1] ** 2 + r_c[t, 2] ** 2
        v = 1.0 / np.sqrt(d2b * d2c)
        p = 3 * t
        i[p], j[p] = b[t], a[t]
        i[p + 1], j[p + 1] = c[t], a[t]
        i[p + 2], j[p + 2] = b[t], c[t]
        for k in range(3):
            r[p, k] = r_b[t, k]
            r[p + 1, k] = r_c[t, k]
            r[p + 2, k] = r_b[t, k] - r_c[t, k]
        G[p] = U_c[t] * (v - cos[t] / d2b)
        G[p + 1] = U_c[t] * (v - cos[t] / d2c)
        G[p + 2] = G_bc[t] - U_c[t] * v


@njit(cache=True, nogil=True, error_model="numpy")
def _share3(b, a, c, U, weights, energies):
    for t in range(len(U)):
        energies[b[t]] += weights[0] * U[t]
        energies[a[t]] += weights[1] * U[t]
        energies[c[t]] += weights[2] * U[t]


@njit(cache=True, nogil=True, error_model="numpy")
def _sources3(r, G, weights, D):
    """Sources of the bonds b–a, c–a, b–c of every angle: ∂U^(p)/∂x_q = w_p ∂U/∂x_q, and ∂U/∂x from the forces along the
    bonds."""
    wb, wa, wc = weights[0], weights[1], weights[2]
    for t in range(len(G) // 3):
        p = 3 * t
        for k in range(3):
            outer = G[p + 2] * r[p + 2, k]
            at_b = G[p] * r[p, k] + outer
            at_c = G[p + 1] * r[p + 1, k] - outer
            at_a = -at_b - at_c
            D[p, 0, k], D[p, 1, k] = wb * at_a, wa * at_b
            D[p + 1, 0, k], D[p + 1, 1, k] = wc * at_a, wa * at_c
            D[p + 2, 0, k], D[p + 2, 1, k] = wb * at_c, wc * at_b


class CosineAngle(AngleStyle):
    """U = K (1 + cos θ). Coefficient K [energy]. Regular at 0 and 180°."""

    name = "cosine"
    wants = (("K", energy),)

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        K = self.table[types, 0]
        U[:] = K * (1.0 + cos)
        U_c[:] = K
        return 0


class CosineSquaredAngle(AngleStyle):
    """U = K (cos θ − cos θ0)². Coefficients K [energy], θ0 [degrees]. Regular at 0 and 180°."""

    name = "cosine/squared"
    wants = (("K", energy), ("theta0", degrees))

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        K, delta = self.table[types, 0], cos - np.cos(self.table[types, 1])
        U[:] = K * delta * delta
        U_c[:] = 2.0 * K * delta
        return 0


class CosineDeltaAngle(AngleStyle):
    """U = K [1 − cos(θ − θ0)]. Coefficients K [energy], θ0 [degrees]. Where sin θ < 0.001 and θ0 is neither 0 nor 180°
    the sine is clamped."""

    name = "cosine/delta"
    wants = (("K", energy), ("theta0", degrees))

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        return _cosine_delta(types, cos, sin, self.table, U, U_c)


@njit(cache=True, nogil=True, error_model="numpy")
def _cosine_delta(types, cos, sin, table, U, U_c):
    clamped = 0
    for t in range(len(cos)):
        k, theta0 = table[types[t], 0], table[types[t], 1]
        c0, s0 = np.cos(theta0), np.sin(theta0)
        # 1 − cos x = 2 sin²(x/2): no cancellation near θ0.
        half = np.sin(0.5 * (np.arctan2(sin[t], cos[t]) - theta0))
        U[t] = 2.0 * k * half * half
        if abs(s0) < 1e-12:
            # θ0 is 0 or 180°: U is a polynomial in cos θ.
            U_c[t] = -k * c0
            continue
        s = sin[t]
        if s < _SMALL:
            s = _SMALL
            clamped += 1
        U_c[t] = -k * (c0 - s0 * cos[t] / s)
    return clamped


class HarmonicAngle(AngleStyle):
    """U = K (θ − θ0)² (LAMMPS's K: no ½). Coefficients K [energy/rad²], θ0 [degrees].

    For θ0 = 0 or 180° U'/sin θ has a limit there and is taken to it; for other θ0 sin θ is clamped at 0.001, as LAMMPS
    does.
    """

    name = "harmonic"
    wants = (("K", energy), ("theta0", degrees))

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        return _harmonic_angle(types, cos, sin, self.table, U, U_c)


@njit(cache=True, nogil=True, error_model="numpy")
def _harmonic_angle(types, cos, sin, table, U, U_c):
    clamped = 0
    for t in range(len(cos)):
        k, theta0 = table[types[t], 0], table[types[t], 1]
        s = sin[t]
        x = np.arctan2(s, cos[t]) - theta0
        U[t] = k * x * x
        if s < _SMALL:
            at_180 = cos[t] < 0.0
            if abs(np.sin(theta0)) < 1e-12 and (np.cos(theta0) < 0.0) == at_180:
                # x/sin θ with x = asin(s) up to sign: the next term of the series is s⁴ · 3/40.
                U_c[t] = (2.0 if at_180 else -2.0) * k * (1.0 + s * s / 6.0)
                continue
            s = _SMALL
            clamped += 1
        U_c[t] = -2.0 * k * x / s
    return clamped


class CharmmAngle(AngleStyle):
    """U = K (θ − θ0)² + K_UB (d_bc − r_UB)² with the outer atoms' distance (Urey-Bradley). Coefficients K
    [energy/rad²], θ0 [degrees], K_UB [energy/length²], r_UB [length]. At 0 and 180° as `HarmonicAngle`."""

    name = "charmm"
    wants = (("K", energy), ("theta0", degrees), ("K_UB", per_length2), ("r_UB", length))

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        clamped = _harmonic_angle(types, cos, sin, self.table, U, U_c)
        k, x = self.table[types, 2], d_bc - self.table[types, 3]
        U += k * x * x
        # Outer atoms at one place have no direction, and no force.
        np.divide(2.0 * k * x, d_bc, out=G_bc, where=d_bc > 0)
        return clamped


class ZeroAngle(AngleStyle):
    """Angles that exert no force (LAMMPS ``angle_style zero``)."""

    name = "zero"

    def describe(self):
        return "angle zero"

    def prepare(self, frame):
        self.terms_of(frame)
        return Work()


class TableAngle(AngleStyle):
    """U(θ) and −U'(θ) interpolated in a LAMMPS angle table (``angle_style table linear|spline N``). sin θ is clamped at
    0.001, as LAMMPS does."""

    name = "table"

    def __init__(self, tables: Tables, *, partition="equal"):
        self.tables = tables
        self.units = tables.units
        self.covered = frozenset(tables.types)
        self.share(partition)

    def add(self, types, cos, sin, d_bc, U, U_c, G_bc):
        theta = np.arctan2(sin, cos)
        # atan2 gives at most π rounded, which is where the table ends.
        self.tables.lookup(types, theta, U, U_c)
        small = sin < _SMALL
        U_c /= np.where(small, _SMALL, sin)
        return int(small.sum())


register_bonded(HarmonicAngle, CosineAngle, CosineSquaredAngle, CosineDeltaAngle, CharmmAngle)


@angle_style("zero")
def _zero(inp):
    return ZeroAngle._from_input(inp.by_type(lambda line: ()), inp)


@angle_style("table")
def _table(inp):
    return TableAngle(build_tables(inp, "angle"))
