"""Tersoff's bond-order potential (LAMMPS ``pair_style tersoff``).

A frame is done in four stages: the half neighbour list; which pairs meet at which atom; around each atom, the energies V_ij of its bonds with
G of the arms into slots of their own (one for each end of a pair) and the outer distances as bonds of their own; one bond a pair.
"""

from __future__ import annotations

from itertools import product
from types import MappingProxyType

import numpy as np
from numba import njit

from ..bonds import Bonds
from ..errors import AtcError
from ..frame import Frame
from ..units import Units
from ..units import units as system
from .base import Accumulator, Term, Work
from .cluster import weights_of
from .elements import ElementMap, mapped_line
from .neighborhood import Neighborhood
from .registry import MAPPED_STYLES, pair_style
from .tersoff_file import TersoffEntry, read_tersoff_file
from .twin_entries import agree

_NOTHING = np.zeros(0)
_NO_S = np.zeros((0, 2, 2, 3))
_NO_D = np.zeros((0, 2, 3))
_CENTER = ((1.0, 0.0), "bond-order energy V_ij to its center i")
_PAIR = {
    "pair": ((0.5, 0.5), "bond-order energy V_ij shared half to each of i and j"),
    "center": _CENTER,
    "centre": _CENTER,
}


class Tersoff(Term):
    """U = Σ_pairs f_C A exp(−λ1 d) − ½ Σ_{i≠j} f_C b_ij B exp(−λ2 d), b = (1 + βⁿ ζⁿ)^(−1/2n), ζ_ij = Σ_k f_C(d_ik) g(cos θ) exp[λ3^m (d_ij − d_ik)^m],
    g = γ [1 + c²/d² − c²/(d² + (cos θ0 − cos θ)²)], f_C = 1 below R − D, 0 above R + D, ½ − ½ sin(π (r − R)/2D) between.

    G of i–j, i–k and j–k follows from ∂ζ/∂ξ through cos θ and the two distances (formulas §2); every function and its slope vanish at R + D.
    Limits of b for small and large ζ are LAMMPS's.

    Parameters
    ----------
    entries : {(elem1, elem2, elem3): TersoffEntry or dict of its fields}, elem1 at the centre; lengths and energies in `units`
    elements : the element of each atom type from 1, None or "NULL" for types left out; default: all atoms are the first entry's element
    units : the default has eV and Å
    partition : how V_ij = ½ f_C b_ij f_A, which depends on the neighbours of i, is shared: "pair" (half to i, half to j, as LAMMPS), "center" (all to
        i), or two numbers that add up to 1. Atoms k that only weaken the bond have no share. Repulsion: half to each. Stress and total energy do not
        depend on it; heat flux and churning do.

    Notes
    -----
    Source: Tersoff, Phys. Rev. B 37, 6991 (1988); 39, 5566 (1989). Parameter files: `from_file`.
    """

    part_name = "tersoff"
    partitions = MappingProxyType({"equal": "pair", "center": "center"})

    def __init__(self, entries: dict, elements=None, *, units: str | Units = "metal", partition="pair"):
        self.units = u = system(units)
        entries = {tuple(k): v if isinstance(v, TersoffEntry) else TersoffEntry(**v) for k, v in entries.items()}
        for e in entries.values():
            if wrong := e.check():
                raise AtcError(f"{e.where}: {wrong}")
        names = [next(iter(entries))[0]] if elements is None else list(dict.fromkeys(e for e in elements if e not in (None, "NULL")))
        self.map = ElementMap(elements, names, "pair_style tersoff")
        self.share(partition)
        energy, length = u.to_internal("energy", 1.0), u.to_internal("length", 1.0)
        m = len(names)
        self.two = np.zeros((m, m, 12))
        self.three = np.zeros((m, m, m, 9))
        for (i, a), (j, b), (k, c) in product(enumerate(names), repeat=3):
            e = entries.get((a, b, c))
            if e is None:
                raise AtcError(f"Tersoff: no entry for {a} {b} {c}: a potential needs every combination of its elements")
            R, D, lam3 = e.R * length, e.D * length, e.lam3 / length
            self.three[i, j, k] = R, D, lam3, e.m, e.gamma, e.c**2, e.d**2, e.costheta0, (1.0 + e.c**2 / e.d**2 if e.c else 1.0)
            if j == k:
                if not e.n > 0 and e.beta > 0 and e.B > 0:
                    raise AtcError(f"{e.where}: n must be positive in the entry {a} {b} {b}, got {e.n:g}")
                c1, c2 = ((2.0 * e.n * 1e-16) ** (-1.0 / e.n), (2.0 * e.n * 1e-8) ** (-1.0 / e.n)) if e.n > 0 else (np.inf, np.inf)
                self.two[i, j] = R, D, e.A * energy, e.lam1 / length, e.B * energy, e.lam2 / length, e.beta, e.n, c1, c2, 1.0 / c2, 1.0 / c1
        self._symmetric(entries, names)
        self.cutoff = float((self.three[..., 0] + self.three[..., 1]).max())
        if not self.cutoff > 0:
            raise AtcError("Tersoff: every cutoff R + D is 0")

    def _symmetric(self, entries, names):
        """The repulsion of a pair, which LAMMPS takes from one of two entries by the numbering of the atoms, must be the same in both."""
        for i, j in product(range(len(names)), repeat=2):
            if j <= i:
                continue
            e, f = entries[names[i], names[j], names[j]], entries[names[j], names[i], names[i]]
            what = f"{e.where} and {f.where}: the repulsion of {names[i]} and {names[j]} in both entries"
            if not agree(self.two[i, j, :4], self.two[j, i, :4], what, self._repulsive, self.units.label("energy")):
                raise AtcError(
                    f"{e.where} and {f.where}: the entries {names[i]} {names[j]} {names[j]} and {names[j]} {names[i]} {names[i]} give different R, D, A or lambda1 for the "
                    "repulsion of one pair, of which LAMMPS takes one by the atoms' numbers: make them equal"
                )
        self.repulsion = np.ascontiguousarray(0.5 * (self.two + self.two.transpose(1, 0, 2))[..., :4])

    def _repulsive(self, row):
        """f_C A exp(−λ1 d) in the user's energy unit at distances from three quarters of the cutoff on, where bonds are."""
        R, D, A, lam1 = row[:4]
        d = np.linspace(0.75 * (R - D), R + D, 200)
        switch = np.where(d < R - D, 1.0, 0.5 - 0.5 * np.sin(0.5 * np.pi * np.clip((d - R) / D if D > 0 else 0.0 * d, -1, 1)))
        return self.units.to_user("energy", switch * A * np.exp(-lam1 * d))

    @classmethod
    def from_file(cls, path, elements, *, units: str | Units = "metal", partition="pair", where: str = "") -> Tersoff:
        """From a LAMMPS parameter file, e.g. ``Tersoff.from_file("Si.tersoff", ["Si"])``. where : the line that names it, for messages."""
        used = dict.fromkeys(e for e in elements if e not in (None, "NULL"))
        entries = read_tersoff_file(path, used, system(units).name, where)
        for triple in product(used, repeat=3):
            if triple not in entries:
                raise AtcError(
                    f"{path}: no entry for {' '.join(triple)}, which {where or 'the list of elements'} needs; a file must have every combination"
                )
        return cls(entries, elements, units=units, partition=partition)

    def share(self, partition):
        if isinstance(partition, str) and partition == "equal":
            raise AtcError(
                "tersoff: partition 'equal': a bond-order term has as many atoms as its bond has neighbours; use 'pair', 'center' or two numbers"
            )
        self.weights, self.shared = weights_of(partition, 2, _PAIR, "tersoff")

    def describe(self) -> str:
        return f"tersoff{self.map.describe()}, {self.shared}, repulsion half to each atom; one merged bond a pair, outer j-k bonds apart"

    def prepare(self, frame: Frame) -> Work:
        return _TersoffWork(self, frame)


class _TersoffWork(Work):
    def __init__(self, term: Tersoff, frame: Frame):
        self.term, self.frame = term, frame
        element_n, who = term.map.apply(frame)
        self.near = near = Neighborhood(frame, who, term.cutoff, "Tersoff")
        self.element = element_n[near.atom]
        self.stages = (near.chunks, 1, near.chunks, near.chunks)

    def run(self, stage, task, acc: Accumulator):
        return (self._collect, self._join, self._centres, self._merge)[stage](task, acc)

    def _collect(self, task, acc):
        self.near.collect(task, acc.ws)

    def _join(self, task, acc):
        self.near.join()
        pairs = len(self.near.a)
        self.G_end = np.zeros((pairs, 2))
        # Slot (pair, end): what the bonds around that end give, ∂U^(centre)/∂x_other and ∂U^(other)/∂x_centre.
        self.S_end = np.zeros((pairs, 2, 2, 3)) if acc.sources else _NO_S

    def _centres(self, task, acc):
        near, term, ws = self.near, self.term, acc.ws
        most, room = near.most(task)
        while ws.capacity < room:
            ws.grow()
        D = np.empty((room, 2, 3)) if acc.sources else _NO_D
        energies = acc.energies if acc.energies is not None else _NOTHING
        m, energy = _bond_orders(
            near.first[task], near.first[task + 1], most, near.start, near.pair, near.end, near.a, near.b, near.r_pc, near.d_p, self.element,
            term.two, term.three, term.weights, near.atom, self.G_end, self.S_end, ws.i, ws.j, ws.r, ws.G, D, energies,
        )  # fmt: skip
        acc.energy += energy
        return Bonds(ws.i[:m], ws.j[:m], ws.r[:m], ws.G[:m], D[:m] if acc.sources else None)

    def _merge(self, task, acc):
        near, ws = self.near, acc.ws
        p0, p1 = near.edges[task], near.edges[task + 1]
        while ws.capacity < p1 - p0:
            ws.grow()
        D = np.empty((p1 - p0, 2, 3)) if acc.sources else _NO_D
        energies = acc.energies if acc.energies is not None else _NOTHING
        m, energy, bad = _merge(
            p0, p1, near.a, near.b, near.r_pc, near.d_p, self.element, self.term.repulsion, self.G_end, self.S_end, near.atom,
            ws.i, ws.j, ws.r, ws.G, D, energies,
        )  # fmt: skip
        if bad >= 0:
            a, b = self.frame.ids[near.atom[near.a[bad]]], self.frame.ids[near.atom[near.b[bad]]]
            raise AtcError(
                f"{self.frame.source}: the Tersoff force between atoms {a} and {b} at distance {near.d_p[bad]:.3g} is not a finite number"
            )
        acc.energy += energy
        return Bonds(ws.i[:m], ws.j[:m], ws.r[:m], ws.G[:m], D[:m] if acc.sources else None)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cutoff(d, R, D):
    """f_C and its slope."""
    if d < R - D:
        return 1.0, 0.0
    if d >= R + D:
        return 0.0, 0.0
    x = 0.5 * np.pi * (d - R) / D
    return 0.5 * (1.0 - np.sin(x)), -0.25 * np.pi / D * np.cos(x)


@njit(cache=True, nogil=True, error_model="numpy")
def _bond_order(zeta, two):
    """b(ζ) and b'(ζ), with LAMMPS's limits (PairTersoff::ters_bij) where one term of 1 + (βζ)ⁿ is lost in the other."""
    beta, n = two[6], two[7]
    t = beta * zeta
    if t > two[8]:
        return 1.0 / np.sqrt(t), -0.5 * beta * t**-1.5
    if t > two[9]:
        tn = t**-n
        return (1.0 - tn / (2.0 * n)) / np.sqrt(t), -0.5 * beta * t**-1.5 * (1.0 - (1.0 + 0.5 / n) * tn)
    if t < two[11]:
        return 1.0, 0.0
    if t < two[10]:
        return 1.0 - t**n / (2.0 * n), -0.5 * beta * t ** (n - 1.0)
    tn = t**n
    return (1.0 + tn) ** (-0.5 / n), -0.5 * (1.0 + tn) ** (-1.0 - 0.5 / n) * tn / zeta


@njit(cache=True, nogil=True, error_model="numpy")
def _bond_orders(
    s0,
    s1,
    most,
    start,
    pair,
    end,
    a,
    b,
    r,
    d,
    element,
    two,
    three,
    weights,
    atom,
    G_end,
    S_end,
    out_i,
    out_j,
    out_r,
    out_G,
    out_D,
    energies,
):
    """V_ij of the bonds of the atoms s0..s1 and its derivatives: arms into the slots, outer distances to the out arrays."""
    sources = len(out_D) > 0
    shared = len(energies) > 0
    w_i, w_j = weights[0], weights[1]
    who = np.empty(most, np.int32)
    arm = np.empty((most, 3))  # x_i − x_k
    dist = np.empty(most)
    G_arm = np.empty(most)
    G_out = np.empty((most, most))
    S_arm = np.empty((most, 2, 3))
    S_out = np.empty((most, most, 3))  # [p, q] = ∂U^(p)/∂x_q
    along, other, outer = np.empty(most), np.empty(most), np.empty(most)  # ∂ζ/∂ξ of ij, ik, jk
    g_j, g_i, g_k = np.empty(3), np.empty(3), np.empty(3)
    total = 0.0
    m = 0
    for s in range(s0, s1):
        k = start[s + 1] - start[s]
        for e in range(k):
            p = pair[start[s] + e]
            sign = 1.0
            who[e] = b[p]
            if end[start[s] + e] == 1:
                sign = -1.0
                who[e] = a[p]
            dist[e] = d[p]
            G_arm[e] = 0.0
            for c in range(3):
                arm[e, c] = sign * r[p, c]
                S_arm[e, 0, c] = S_arm[e, 1, c] = 0.0
            for f in range(k):
                G_out[e, f] = 0.0
                if sources:
                    for c in range(3):
                        S_out[e, f, c] = 0.0
        es = element[s]
        for e in range(k):
            ee = element[who[e]]
            par = two[es, ee]
            d1 = dist[e]
            if d1 >= par[0] + par[1] or par[4] == 0.0:
                continue
            zeta = 0.0
            for f in range(k):
                along[f] = other[f] = outer[f] = 0.0
                if f == e:
                    continue
                tri = three[es, ee, element[who[f]]]
                d2 = dist[f]
                if d2 >= tri[0] + tri[1]:
                    continue
                fc, dfc = _cutoff(d2, tri[0], tri[1])
                v = 1.0 / (d1 * d2)
                cos = (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) * v
                h = tri[7] - cos
                q = 1.0 / (tri[6] + h * h)
                g = tri[4] * (tri[8] - tri[5] * q)
                dg = -2.0 * tri[4] * tri[5] * h * q * q
                x = tri[2] * (d1 - d2)
                if tri[3] == 3.0:
                    y, dy = x * x * x, 3.0 * tri[2] * x * x
                else:
                    y, dy = x, tri[2]
                # LAMMPS's bounds of the exponential.
                ex = 1e30 if y > 69.0776 else (0.0 if y < -69.0776 else np.exp(y))
                zeta += fc * g * ex
                by_cos = fc * dg * ex
                by_r = fc * g * ex * dy
                along[f] = by_cos * (v - cos / (d1 * d1)) + by_r / d1
                other[f] = by_cos * (v - cos / (d2 * d2)) - by_r / d2 + dfc * g * ex / d2
                outer[f] = -by_cos * v
            fc, dfc = _cutoff(d1, par[0], par[1])
            attraction = -par[4] * np.exp(-par[5] * d1)
            fa, dfa = attraction * fc, attraction * (dfc - par[5] * fc)
            order, slope = _bond_order(zeta, par)
            V = 0.5 * order * fa
            pre = 0.5 * fa * slope
            g_ij = 0.5 * order * dfa / d1
            for f in range(k):
                g_ij += pre * along[f]
            total += V
            if shared:
                energies[atom[s]] += w_i * V
                energies[atom[who[e]]] += w_j * V
            G_arm[e] += g_ij
            for f in range(k):
                G_arm[f] += pre * other[f]
                if e < f:
                    G_out[e, f] += pre * outer[f]
                else:
                    G_out[f, e] += pre * outer[f]
            if sources:
                for c in range(3):
                    g_j[c] = -g_ij * arm[e, c]
                    g_i[c] = 0.0
                for f in range(k):
                    if other[f] == 0.0 and outer[f] == 0.0:
                        continue
                    for c in range(3):
                        across = pre * outer[f] * (arm[f, c] - arm[e, c])
                        g_j[c] += across
                        g_k[c] = -pre * other[f] * arm[f, c] - across
                        g_i[c] -= g_k[c]
                        S_arm[f, 0, c] += w_i * g_k[c]
                        S_out[e, f, c] += w_j * g_k[c]
                for c in range(3):
                    S_arm[e, 0, c] += w_i * g_j[c]
                    S_arm[e, 1, c] += w_j * (g_i[c] - g_j[c])
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            G_end[p, side] = G_arm[e]
            if sources:
                for c in range(3):
                    S_end[p, side, 0, c] = S_arm[e, 0, c]
                    S_end[p, side, 1, c] = S_arm[e, 1, c]
            for f in range(e + 1, k):
                keep = G_out[e, f] != 0.0
                out_i[m], out_j[m], out_G[m] = atom[who[e]], atom[who[f]], G_out[e, f]
                for c in range(3):
                    out_r[m, c] = arm[f, c] - arm[e, c]
                    if sources:
                        out_D[m, 0, c], out_D[m, 1, c] = S_out[e, f, c], S_out[f, e, c]
                        keep = keep or S_out[e, f, c] != 0.0 or S_out[f, e, c] != 0.0
                m += 1 if keep else 0
    return m, total


@njit(cache=True, nogil=True, error_model="numpy")
def _merge(p0, p1, a, b, r, d, element, repulsion, G_end, S_end, atom, out_i, out_j, out_r, out_G, out_D, energies):
    """One bond a pair: repulsion and what both ends' bond orders give. Returns their number, the repulsive energy, the first bad pair (−1)."""
    sources = len(out_D) > 0
    shared = len(energies) > 0
    total = 0.0
    m = 0
    for p in range(p0, p1):
        i, j = a[p], b[p]
        par = repulsion[element[i], element[j]]
        fc, dfc = _cutoff(d[p], par[0], par[1])
        e = par[2] * np.exp(-par[3] * d[p])
        u = e * fc
        own = e * (dfc - par[3] * fc) / d[p]
        g = own + G_end[p, 0] + G_end[p, 1]
        if not np.isfinite(g + u):
            return 0, 0.0, p
        total += u
        if shared:
            energies[atom[i]] += 0.5 * u
            energies[atom[j]] += 0.5 * u
        keep = g != 0.0
        out_i[m], out_j[m], out_G[m] = atom[i], atom[j], g
        for c in range(3):
            out_r[m, c] = r[p, c]
            if sources:
                out_D[m, 0, c] = -0.5 * own * r[p, c] + S_end[p, 0, 0, c] + S_end[p, 1, 1, c]
                out_D[m, 1, c] = 0.5 * own * r[p, c] + S_end[p, 0, 1, c] + S_end[p, 1, 0, c]
                keep = keep or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
        m += 1 if keep else 0
    return m, total, -1


MAPPED_STYLES.add("tersoff")


@pair_style("tersoff")
def _tersoff(inp):
    if inp.args:
        raise inp.error(f"pair_style tersoff: {' '.join(inp.args)} is not supported: expected no arguments")
    path, elements, line = mapped_line(inp, ".tersoff")
    return Tersoff.from_file(path, elements, units=inp.units, where=line.where)
