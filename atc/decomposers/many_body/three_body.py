"""Pair energies and energies of bond angles whose arms factorise: Vashishta's and the non-bonded harmonic angle (LAMMPS
``vashishta``, ``nb3b/harmonic``,
``nb3b/screened``). The loops over triplets are those of Stillinger-Weber.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product
from typing import ClassVar

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ..registry import pair_style
from .elements import mapped_line, mapped_style
from .entries import Entry, OfTriplets
from .neighbor_work import TripletWork, shares
from .neighborhood import share_half
from .stillinger_weber_kernels import HARMONIC, SATURATED
from .twin_entries import require_alike

# Which function of the distance an arm has in triplets: exp(γ/(d − r0)), 1, exp(−d/ρ); all 0 at and beyond r0.
_EXPONENTIAL, _PLAIN, _SCREENED = 0, 1, 2


class _ThreeBodyWork(TripletWork):
    """Pairs within U2's reach only become bonds at once; those within an arm's are kept for the triplets and become
    bonds in the end."""

    def pairs(self, task, acc):
        ws, term = acc.ws, self.term
        n = self.list.half(task, ws)
        D = np.empty((n, 2, 3)) if acc.sources else None
        keep_i, keep_j, rec, G = np.empty(n, np.int32), np.empty(n, np.int32), np.empty((n, 8)), np.empty(n)
        pairs, kept = (ws.i, ws.j, ws.r, ws.d2), (keep_i, keep_j, rec, G)
        law = term.table, term.grid, term.pair, term.arms, term.arm
        m, k, energy, bad = _pairs(pairs, n, self.element, *law, self.atom, kept, ws.G, D, shares(acc))
        self.require_finite(bad, ws)
        acc.energy += energy
        self.parts[task] = keep_i[:k].copy(), keep_j[:k].copy(), rec[:k].copy(), G[:k].copy()
        return Bonds(ws.i[:m], ws.j[:m], ws.r[:m], ws.G[:m], None if D is None else D[:m])


class ThreeBody(OfTriplets):
    """U = Σ_pairs U2(d) + Σ_triplets S h(d_ab) h(d_ac) A(cos θ), a at the centre, h = 0 from r0 on.

    Half of a pair's energy goes to each end, a third of a triplet's to each of its atoms (`partition`, as in
    `StillingerWeber`). One bond a pair carries the pair energy and what the triplets at both its ends add; outer
    distances b–c are bonds of their own.

    Subclasses set `style`, `entry`, `angular` and `arm`, and give the rows of the tables (internal units): `pair_row`
    (cutoff of U2, its value and slope there, its numbers), `arm_row` (r0, a number of h), `triplet_row` (S, cos θ0 or
    θ0, a number of A).
    """

    work = _ThreeBodyWork
    bodies = 3
    prune = 0.0
    angular: int
    arm: int
    #: Pair energies and G by pair at (first, step) of d² in place of their functions, or none.
    table = np.zeros((0, 0, 0, 2))
    grid = (0.0, 0.0)

    def __init__(self, entries: dict, elements=None, *, units: str | Units = "metal", partition="equal"):
        entries, names = self.take(entries, elements, units)
        self.share(partition)
        m = len(names)
        self.pair, self.arms, self.triplet = np.zeros((m, m, 11)), np.zeros((m, m, 2)), np.zeros((m, m, m, 4))
        for (i, a), (j, b), (k, c) in product(enumerate(names), repeat=3):
            e = entries[a, b, c]
            self.triplet[i, j, k, :3] = self.triplet_row(e)
            if j == k:
                self.pair[i, j], self.arms[i, j] = self.pair_row(e), self.arm_row(e)
        self._symmetric(entries, names)
        self.cutoff = float(max(self.pair[..., 0].max(), self.arms[..., 0].max()))
        if not self.cutoff > 0:
            raise AtcError(f"pair_style {self.style}: every cutoff is 0")

    def _symmetric(self, entries, names):
        """Where LAMMPS would take one of two entries by the numbering of the atoms, they must say the same (published
        files round to seven digits)."""

        def same(one, other):
            return np.allclose(one, other, rtol=1e-5, atol=0)

        for (i, a), (j, b) in combinations(enumerate(names), 2):
            alike = same(self.pair[i, j], self.pair[j, i])
            require_alike(entries, (a, b, b), (b, a, a), alike, "two-body terms for one pair")
        for (i, a), ((j, b), (k, c)) in product(enumerate(names), combinations(enumerate(names), 2)):
            alike = same(self.triplet[i, j, k], self.triplet[i, k, j])
            idle = min(self.arms[i, j, 0], self.arms[i, k, 0]) <= 0.0
            require_alike(entries, (a, b, c), (a, c, b), alike or idle, "angles for one triplet")
        self.pair = np.ascontiguousarray(0.5 * (self.pair + self.pair.transpose(1, 0, 2)))
        self.triplet = np.ascontiguousarray(0.5 * (self.triplet + self.triplet.transpose(0, 2, 1, 3)))

    @property
    def part_name(self) -> str:
        return self.style

    def describe(self) -> str:
        pair = "pair energy shared half to each atom, " if (self.pair[..., 0] > 0).any() else ""
        return (
            f"{self.style}{self.map.describe()}, {pair}triplet energy {self.shared}; one merged bond a pair, outer "
            "b-c bonds apart"
        )

    def pair_row(self, e):
        return np.zeros(11)

    def arm_row(self, e):
        raise NotImplementedError

    def triplet_row(self, e):
        raise NotImplementedError


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _vashishta(d, p):
    """H/d^η + Z_i Z_j/d exp(−d/λ1) − D/d⁴ exp(−d/λ4) − W/d⁶ and its slope; p = H, η, ZZ, 1/λ1, D, 1/λ4, W."""
    inv = 1.0 / d
    steric = p[0] * inv ** p[1]
    coulomb = p[2] * inv * np.exp(-d * p[3])
    inv2 = inv * inv
    dipole = p[4] * inv2 * inv2 * np.exp(-d * p[5])
    dispersion = p[6] * inv2 * inv2 * inv2
    slope = -p[1] * steric * inv - coulomb * (inv + p[3]) + dipole * (4.0 * inv + p[5]) + 6.0 * dispersion * inv
    return steric + coulomb - dipole - dispersion, slope


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _arm(kind, d, row):
    """h(d) and −dlnh/dξ."""
    if d >= row[0]:
        return 0.0, 0.0
    if kind == _EXPONENTIAL:
        s = 1.0 / (d - row[0])
        # exp underflows to 0 long before s² overflows.
        return np.exp(row[1] * s), row[1] * s * s / d
    if kind == _SCREENED:
        return np.exp(-d * row[1]), row[1] / d
    return 1.0, 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs(pairs, n, element, table, grid, pair, arms, arm, atom, kept, G, D, energies):
    """Pair energies. Pairs that no triplet may have are compacted in place to bonds with the frame's indices, the
    others go to keep_i, keep_j, rec (as in `sw_pairs`), keep_G. Returns how many of each, the energy, the first pair
    that is not finite (−1: none)."""
    (i, j, r, d2), (keep_i, keep_j, rec, keep_G) = pairs, kept
    m = 0
    k = 0
    total = 0.0
    for b in range(n):
        ia, ib = i[b], j[b]
        ea, eb = element[ia], element[ib]
        d = np.sqrt(d2[b])
        row = pair[ea, eb]
        g = 0.0
        if d < row[0]:
            if len(table) > 0 and d2[b] >= grid[0]:
                # LAMMPS's linear interpolation, of force and energy apart.
                x = (d2[b] - grid[0]) / grid[1]
                q = min(int(x), table.shape[2] - 2)
                x -= q
                low, high = table[ea, eb, q], table[ea, eb, q + 1]
                u, g = low[0] + x * (high[0] - low[0]), low[1] + x * (high[1] - low[1])
            else:
                u, du = _vashishta(d, row[4:])
                u -= row[1] + (d - row[0]) * row[2]
                g = (du - row[2]) / d
            if not np.isfinite(g + u):
                return 0, 0, 0.0, b
            total += u
            share_half(energies, atom[ia], atom[ib], u)
        h, w = _arm(arm, d, arms[ea, eb])
        h2, w2 = _arm(arm, d, arms[eb, ea])
        x, y, z = r[b, 0], r[b, 1], r[b, 2]
        if h != 0.0 or h2 != 0.0:
            if not d > 0.0:
                return 0, 0, 0.0, b
            keep_i[k], keep_j[k], keep_G[k] = ia, ib, g
            rec[k, 0], rec[k, 1], rec[k, 2], rec[k, 3] = x, y, z, 1.0 / d
            rec[k, 4], rec[k, 5], rec[k, 6], rec[k, 7] = h, w, h2, w2
            k += 1
        elif g != 0.0:
            i[m], j[m], G[m] = atom[ia], atom[ib], g
            r[m, 0], r[m, 1], r[m, 2] = x, y, z
            if D is not None:
                e = 0.5 * g
                D[m, 0, 0], D[m, 0, 1], D[m, 0, 2] = -e * x, -e * y, -e * z
                D[m, 1, 0], D[m, 1, 1], D[m, 1, 2] = e * x, e * y, e * z
            m += 1
    return m, k, total, -1


@dataclass(frozen=True)
class VashishtaEntry(Entry):
    """One entry ``elem1 elem2 elem3`` of a ``.vashishta`` file, elem1 at the centre: see `Vashishta`."""

    H: float
    eta: float
    Zi: float
    Zj: float
    lambda1: float
    D: float
    lambda4: float
    W: float
    rc: float
    B: float
    gamma: float
    r0: float
    C: float
    costheta0: float
    where: str = "the Vashishta parameters"

    what: ClassVar[str] = "Vashishta"
    signed: ClassVar[tuple] = ("Zi", "Zj", "costheta0")
    energies: ClassVar[tuple] = ("H", "D", "W", "B")


class Vashishta(ThreeBody):
    """U2 = H/d^η + Z_i Z_j e²/d exp(−d/λ1) − D/d⁴ exp(−d/λ4) − W/d⁶ below r_c, less its value and slope there times (d
    − r_c); U3 = B δ²/(1 + C δ²) exp(γ_ab/(d_ab − r0_ab)) exp(γ_ac/(d_ac − r0_ac)), δ = cos θ − cos θ0, a at the centre,
    below r0.

    Parameters
    ----------
    entries : {(elem1, elem2, elem3): VashishtaEntry or dict of its fields}; H … λ, r_c, γ, r0 of a pair come from the
        entry (i, j, j), B, C, cos θ0 from (i, j, k)
    elements : the element of each atom type from 1, None or "NULL" for types left out; default: all atoms are the first
        entry's element
    units : unit style of the numbers (charges in electrons); the default has eV and Å
    partition : of the triplets' energy: "equal", "center", or the centre's share and that of each of the others, as in
        `StillingerWeber`

    Notes
    -----
    Source: Vashishta, Kalia, Rino & Ebbsjö, Phys. Rev. B 41, 12197 (1990); Branicio, Rino, Gan & Tsuzuki, J. Phys.
    Condens. Matter 21, 095002 (2009).
    """

    style = "vashishta"
    entry = VashishtaEntry
    angular = SATURATED
    arm = _EXPONENTIAL

    def pair_row(self, e):
        if not e.rc > 0:
            return np.zeros(11)
        u = self.units
        E, L = u.energy, u.length
        for key in ("lambda1", "lambda4"):
            if not getattr(e, key) > 0:
                raise AtcError(f"{e.where}: {key} must be positive, got {getattr(e, key):g}")
        coulomb = u.coulomb * u.to_internal("charge", e.Zi) * u.to_internal("charge", e.Zj)
        rc = e.rc * L
        numbers = np.array(
            [
                e.H * E * L**e.eta,
                e.eta,
                coulomb,
                1.0 / (e.lambda1 * L),
                e.D * E * L**4,
                1.0 / (e.lambda4 * L),
                e.W * E * L**6,
            ]
        )
        value, slope = _vashishta(rc, numbers)
        return np.array([rc, value, slope, 0.0, *numbers])

    def arm_row(self, e):
        return e.r0 * self.units.length, e.gamma * self.units.length

    def triplet_row(self, e):
        return e.B * self.units.energy, e.costheta0, e.C

    def tabulate(self, points: int, inner: float) -> None:
        """From now on take pair energies and forces from tables, as LAMMPS's ``vashishta/table``: so many points,
        evenly spaced in d² from `inner` (in the potential's units) to the largest cutoff, linear between them; below
        `inner` the function itself.

        Energy and force are interpolated each for itself, so that the force is the derivative of the energy only as far
        as the table is fine.
        """
        first = self.units.to_internal("length", inner) ** 2
        if points < 2 or not 0 < first < self.cutoff**2:
            raise AtcError(
                "vashishta/table: expected two points or more and an inner cutoff between 0 and the largest, got "
                f"{points} and {inner:g}"
            )
        step = (self.cutoff**2 - first) / (points - 1)
        d = np.sqrt(first + step * np.arange(points))
        m = len(self.pair)
        self.style, self.grid, self.table = "vashishta/table", (first, step), np.zeros((m, m, points, 2))
        for a, b in product(range(m), repeat=2):
            row = self.pair[a, b]
            if row[0] > 0:
                u, du = _vashishta.py_func(d, row[4:])
                # Beyond a pair's own cutoff, too: its last interval leans on the point there.
                self.table[a, b, :, 0] = u - row[1] - (d - row[0]) * row[2]
                self.table[a, b, :, 1] = (du - row[2]) / d


@dataclass(frozen=True)
class HarmonicTripletEntry(Entry):
    """One entry ``elem1 elem2 elem3`` of a ``.nb3b.harmonic`` file, elem1 at the centre: see `HarmonicTriplets`."""

    K: float
    theta0: float
    cutoff: float
    where: str = "the nb3b parameters"

    what: ClassVar[str] = "nb3b"
    energies: ClassVar[tuple] = ("K",)


@dataclass(frozen=True)
class ScreenedTripletEntry(Entry):
    """One entry of a ``.nb3b.screened`` file: see `ScreenedTriplets`."""

    K: float
    theta0: float
    rho: float
    cutoff: float
    where: str = "the nb3b parameters"

    what: ClassVar[str] = "nb3b"
    energies: ClassVar[tuple] = ("K",)


class HarmonicTriplets(ThreeBody):
    """U = Σ K (θ − θ0)² over all triplets b–a–c with both arms shorter than their cutoffs (LAMMPS ``nb3b/harmonic``).
    θ0 in degrees, K energy/rad².

    Cutoffs of a–b come from the entry (a, b, b). The energy is cut off without smoothing, as in LAMMPS: it jumps where
    a triplet enters. sin θ is kept from 0 as LAMMPS does. Other parameters as `Vashishta`.
    """

    style = "nb3b/harmonic"
    entry = HarmonicTripletEntry
    angular = HARMONIC
    arm = _PLAIN

    def arm_row(self, e):
        return e.cutoff * self.units.length, 0.0

    def triplet_row(self, e):
        return e.K * self.units.energy, np.radians(e.theta0), 0.0


class ScreenedTriplets(HarmonicTriplets):
    """U = Σ K (θ − θ0)² exp(−d_ab/ρ_ab) exp(−d_ac/ρ_ac) (LAMMPS ``nb3b/screened``), ρ and cutoffs of a–b from the entry
    (a, b, b)."""

    style = "nb3b/screened"
    entry = ScreenedTripletEntry
    arm = _SCREENED

    def arm_row(self, e):
        if e.cutoff > 0 and not e.rho > 0:
            raise AtcError(f"{e.where}: rho must be positive, got {e.rho:g}")
        return e.cutoff * self.units.length, 1.0 / (e.rho * self.units.length) if e.rho > 0 else 0.0


@pair_style("vashishta/table", mapped=True)
def _vashishta_table(inp):
    if len(inp.args) != 2 or not inp.args[0].isdigit():
        raise inp.wrong(f"{inp.command} takes the number of points and an inner cutoff")
    inner = inp.number(inp.args[1], 1.0, "inner cutoff")
    path, elements, line = mapped_line(inp.replace(args=()), ".vashishta")
    term = Vashishta.from_file(path, elements, units=inp.units, where=line.where)
    try:
        term.tabulate(int(inp.args[0]), inner)
    except AtcError as e:
        raise inp.error(str(e)) from None
    return term


mapped_style("vashishta", ending=".vashishta", read=Vashishta.from_file)
mapped_style("nb3b/harmonic", ending=".nb3b.harmonic", read=HarmonicTriplets.from_file)
mapped_style("nb3b/screened", ending=".nb3b.screened", read=ScreenedTriplets.from_file)
