"""The environment-dependent interatomic potential (LAMMPS ``pair_style edip`` and ``edip/multi``)."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import combinations, product
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ...compiled import njit
from ...errors import AtcError, AtcWarning
from ...units import Units
from ..registry import pair_style
from .centred import Centred
from .elements import mapped_line, mapped_style
from .entries import Entry, OfEntries
from .neighborhood import around, between_neighbors
from .twin_entries import require_alike

# Shares of a pair's energy (centre, neighbour) and of a triplet's (centre, each neighbour).
_SHARES = {"equal": (0.5, 0.5, 1 / 3, 1 / 3), "center": (1.0, 0.0, 1.0, 0.0), "centre": (1.0, 0.0, 1.0, 0.0)}


@dataclass(frozen=True)
class EDIPEntry(Entry):
    """One entry ``elem1 elem2 elem3`` of an ``.edip`` file, elem1 at the centre: see `EDIP`. a and c are LAMMPS's
    cutoffA and cutoffC."""

    A: float
    B: float
    a: float
    c: float
    alpha: float
    beta: float
    eta: float
    gamma: float
    lam: float
    mu: float
    rho: float
    sigma: float
    Q0: float
    u1: float
    u2: float
    u3: float
    u4: float
    where: str = "the EDIP parameters"

    what: ClassVar[str] = "EDIP"
    signed: ClassVar[tuple] = ("Q0", "u1", "u2", "u3", "u4")
    energies: ClassVar[tuple] = ("A", "lam")
    converts: ClassVar[bool] = False

    def check(self) -> str | None:
        if wrong := super().check():
            return wrong
        if not self.a > self.c:
            return f"cutoffA must be larger than cutoffC, got {self.a:g} and {self.c:g}"
        return None


class EDIP(Centred, OfEntries):
    """U = Σ_i [Σ_j φ2(d_ij, Z_i) + Σ_{j<k} φ3(d_ij, d_ik, cos θ, Z_i)], Z_i = Σ_m f(d_im),
    φ2 = A [(B/d)^ρ − exp(−β Z²)] exp(σ/(d − a)), φ3 = exp(γ/(d_ij − a)) exp(γ/(d_ik − a)) λ [1 − exp(−Q x²) + η Q x²],
    x = cos θ + τ(Z), Q = Q0 exp(−μ Z), τ = u1 + u2 [u3 exp(−u4 Z) − exp(−2 u4 Z)]; f is 1 up to c, exp(α/(1 − y^−3)), y
    = (d − c)/(a − c), to a, and 0 beyond.

    All neighbours of an atom enter each of its energies through Z. Half of φ2 goes to i and j each, a third of φ3 to
    each of its atoms, as in LAMMPS; "center" as partition gives both to i. Neighbours that only change Z have no share.

    Parameters
    ----------
    entries : {(elem1, elem2, elem3): EDIPEntry or dict of its fields}; what depends on one distance comes from (i, j,
        j), λ, η, Q and τ from (i, j, k)
    elements : the element of each atom type from 1, None or "NULL" for types left out; default: all atoms are the first
        entry's element
    units : the default has eV and Å
    partition : "equal" or "center"

    Notes
    -----
    Source: Justo, Bazant, Kaxiras, Bulatov & Yip, Phys. Rev. B 58, 2539 (1998).
    """

    style = "edip/multi"
    entry = EDIPEntry
    part_name = "edip"
    partitions = MappingProxyType({"equal": "equal", "center": "center"})

    def __init__(self, entries: dict, elements=None, *, units: str | Units = "metal", partition="equal"):
        entries, names = self.take(entries, elements, units)
        self.share(partition)
        energy, length = self.units.energy, self.units.length
        m = len(names)
        self.two, self.three = np.zeros((m, m, 9)), np.zeros((m, m, m, 8))
        for (i, a), (j, b), (k, c) in product(enumerate(names), repeat=3):
            e = entries[a, b, c]
            self.three[i, j, k] = e.lam * energy, e.eta, e.Q0, e.mu, e.u1, e.u2, e.u3, e.u4
            if j == k:
                self.two[i, j] = (
                    e.a * length, e.A * energy, e.B * length, e.rho, e.beta, e.sigma * length, e.gamma * length,
                    e.c * length, e.alpha,
                )  # fmt: skip
        for (i, a), ((j, b), (k, c)) in product(enumerate(names), combinations(enumerate(names), 2)):
            alike = np.allclose(self.three[i, j, k], self.three[i, k, j], rtol=1e-5, atol=0)
            what = "lambda, eta, Q0, mu or u1 to u4 for one triplet, of which LAMMPS takes one by the order of its list"
            require_alike(entries, (a, b, c), (a, c, b), alike, what)
        self.three = np.ascontiguousarray(0.5 * (self.three + self.three.transpose(0, 2, 1, 3)))
        self.cutoff = float(self.two[..., 0].max())

    def share(self, partition):
        if partition not in _SHARES:
            raise AtcError(f"edip: partition {partition!r}: expected 'equal' or 'center'")
        self.weights = np.array(_SHARES[partition])
        equal = partition == "equal"
        self.shared = (
            "pair energy half to each, triplet energy a third to each of its atoms"
            if equal
            else "all energy to the atom whose neighbours it has"
        )

    def describe(self) -> str:
        return f"edip{self.map.describe()}, {self.shared}; one merged bond a pair, outer bonds apart"

    def centres(self, s0, s1, most, near, *out):
        return _centres(s0, s1, most, near, self.two, self.three, self.weights, *out)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _coordination(d, row):
    """f(d) and its slope."""
    if d <= row[7]:
        return 1.0, 0.0
    if d >= row[0]:
        return 0.0, 0.0
    width = row[0] - row[7]
    y = width / (d - row[7])
    y3 = y * y * y
    t = 1.0 / (1.0 - y3)
    f = np.exp(row[8] * t)
    return f, -3.0 * row[8] * t * t * y3 * y / width * f


@njit(cache=True, nogil=True, error_model="numpy")
def _centres(s0, s1, most, near, two, three, weights, G_end, S_end, out, energies):
    """φ2 and φ3 of the atoms s0..s1. W is the share of a neighbour; every energy depends on Z too, so its derivative
    goes to all neighbours at the end."""
    start, pair, end, _, _, _, _, element, atom = near
    sources = len(S_end) > 0
    shared = len(energies) > 0
    w_c, w_n, t_c, t_n = weights
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    dZ = np.empty(most)  # f'(d)/d: ∂Z/∂ξ
    h, dh = np.empty(most), np.empty(most)  # exp(γ/(d − a)) and its derivative by ξ over it
    G_arm, by_Z = np.empty(most), np.empty(most)  # by_Z[e] : ∂W_e/∂Z
    G_out = np.empty((most, most))
    grad = np.empty((most, 3))  # ∂U^(centre)/∂x_e, without Z
    S = np.empty((most, most, 3))  # ∂U^(e)/∂x_f, without Z
    g_e, g_f = np.empty(3), np.empty(3)
    total = 0.0
    n = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        es = element[s]
        Z = 0.0
        for e in range(k):
            row = two[es, element[who[e]]]
            f, slope = _coordination(dist[e], row)
            Z += f
            dZ[e] = slope / dist[e]
            h[e] = dh[e] = 0.0
            if dist[e] < row[0]:
                q = 1.0 / (dist[e] - row[0])
                h[e] = np.exp(row[6] * q)
                dh[e] = -row[6] * q * q / dist[e]
            G_arm[e] = by_Z[e] = 0.0
            if sources:
                for c in range(3):
                    grad[e, c] = 0.0
                    for g in range(k):
                        S[e, g, c] = 0.0
        U_Z = 0.0  # ∂U_s/∂Z, U_s all energies around s
        center_Z = 0.0  # ∂ of the centre's share
        for e in range(k):
            row = two[es, element[who[e]]]
            if dist[e] >= row[0]:
                continue
            q = 1.0 / (dist[e] - row[0])
            ex = np.exp(row[5] * q)
            steric = (row[2] / dist[e]) ** row[3]
            order = np.exp(-row[4] * Z * Z)
            V = row[1] * (steric - order) * ex
            V_Z = 2.0 * row[1] * row[4] * Z * order * ex
            g = row[1] * ex * (-row[3] * steric / dist[e] - (steric - order) * row[5] * q * q) / dist[e]
            G_arm[e] += g
            total += V
            U_Z += V_Z
            center_Z += w_c * V_Z
            by_Z[e] += w_n * V_Z
            if shared:
                energies[atom[s]] += w_c * V
                energies[atom[who[e]]] += w_n * V
            if sources:
                for c in range(3):
                    grad[e, c] -= w_c * g * arm[e, c]
                    S[e, e, c] -= w_n * g * arm[e, c]
        for e in range(k):
            for f in range(e + 1, k):
                tri = three[es, element[who[e]], element[who[f]]]
                hh = h[e] * h[f] * tri[0]
                G_out[e, f] = 0.0
                if hh == 0.0:
                    continue
                v = 1.0 / (dist[e] * dist[f])
                cos = (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) * v
                e1 = np.exp(-tri[7] * Z)
                x = cos + tri[4] + tri[5] * (tri[6] * e1 - e1 * e1)
                tau_Z = tri[5] * tri[7] * (2.0 * e1 * e1 - tri[6] * e1)
                Q = tri[2] * np.exp(-tri[3] * Z)
                ex = np.exp(-Q * x * x)
                V = hh * (1.0 - ex + tri[1] * Q * x * x)
                by_Qxx = hh * (ex + tri[1])
                by_cos = 2.0 * by_Qxx * Q * x
                V_Z = by_cos * tau_Z - by_Qxx * tri[3] * Q * x * x
                ge = by_cos * (v - cos / (dist[e] * dist[e])) + V * dh[e]
                gf = by_cos * (v - cos / (dist[f] * dist[f])) + V * dh[f]
                go = -by_cos * v
                G_arm[e] += ge
                G_arm[f] += gf
                G_out[e, f] = go
                total += V
                U_Z += V_Z
                center_Z += t_c * V_Z
                by_Z[e] += t_n * V_Z
                by_Z[f] += t_n * V_Z
                if shared:
                    energies[atom[s]] += t_c * V
                    energies[atom[who[e]]] += t_n * V
                    energies[atom[who[f]]] += t_n * V
                if sources:
                    for c in range(3):
                        across = go * (arm[f, c] - arm[e, c])
                        g_e[c] = -ge * arm[e, c] + across
                        g_f[c] = -gf * arm[f, c] - across
                        grad[e, c] += t_c * g_e[c]
                        grad[f, c] += t_c * g_f[c]
                        S[e, e, c] += t_n * g_e[c]
                        S[e, f, c] += t_n * g_f[c]
                        S[f, e, c] += t_n * g_e[c]
                        S[f, f, c] += t_n * g_f[c]
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            G_end[p, side] = G_arm[e] + U_Z * dZ[e]
            if sources:
                for c in range(3):
                    back = 0.0
                    for f in range(k):
                        S[e, f, c] -= by_Z[e] * dZ[f] * arm[f, c]
                        back -= S[e, f, c]
                    S_end[p, side, 0, c] = grad[e, c] - center_Z * dZ[e] * arm[e, c]
                    S_end[p, side, 1, c] = back
        n = between_neighbors(k, near, who, arm, G_out, S, sources, out, n)
    return n, total


mapped_style("edip/multi", ending=".edip", read=EDIP.from_file)


@pair_style("edip", mapped=True)
def _edip(inp):
    path, elements, line = mapped_line(inp, ".edip")
    if len({e for e in elements if e}) > 1:
        raise inp.error("pair_style edip takes one element: write edip/multi for several", line)
    warnings.warn(
        f"{inp.where}: LAMMPS's edip looks its functions up in tables where edip/multi, and this program, evaluate "
        "them: forces differ from the run's by about 5e-7 of the largest, energies by 1e-8",
        AtcWarning,
        stacklevel=2,
    )
    return EDIP.from_file(path, elements, units=inp.units, where=line.where)
