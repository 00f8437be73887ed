"""Embedded atoms whose cross interaction depends on the local concentration (LAMMPS ``eam/cd`` and ``eam/cd/old``)."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ...units import units as system
from .eam_file import EAMTables, read_setfl
from .elements import ElementMap, mapped_style, require_known
from .embedded_atom import _place, cubic, embedding, take_tables
from .neighbor_work import OUTER_PER_TASK, NeighborTerm, NeighborWork, shares
from .neighborhood import around, between_sharing_neighbors, share_half


class _ConcentrationWork(NeighborWork):
    own = ("_densities", "_weights", "_merge", "_outer")

    def joined(self, acc):
        n = len(self.near.atom)
        self.rho, self.x, self.slope, self.X = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        self.grad = np.zeros((n if acc.sources else 0, 3))
        self.runs, self.most, self.room = self.near.runs(OUTER_PER_TASK)
        self.stages = (*self.stages[:-1], len(self.runs) - 1 if acc.sources else 0)

    def _densities(self, task, acc):
        t = self.term
        functions, state = (t.F, t.rho, t.per_drho, t.per_dr), (self.rho, self.x, self.slope, self.grad)
        acc.energy += _densities(*self.atoms(task), self.lists, *functions, *state, shares(acc))

    def _weights(self, task, acc):
        t = self.term
        _weights(*self.atoms(task), self.lists, t.zr, t.per_dr, t.h, t.two_sites, self.x, self.X)

    def _merge(self, task, acc):
        t = self.term
        state = self.rho, self.x, self.slope, self.X, self.grad
        return self.of_pairs(task, acc, _pairs, t.rho, t.zr, t.per_dr, t.h, t.two_sites, *state)

    def _outer(self, task, acc):
        t = self.term
        return self.of_runs(task, acc, _outer, t.rho, t.zr, t.per_dr, t.h, t.two_sites, self.rho, self.x)


class ConcentrationEAM(NeighborTerm):
    """U = Σ_i F_i(ρ_i) + Σ_{AA, BB pairs} φ(d) + Σ_{AB pairs} H_ij φ_AB(d), x_i = Σ_{j of B} ρ_j(d_ij)/ρ_i the
    concentration around i, H_ij = ½ [h(x_i) + h(x_j)] (one site), or h(½ (x_i + x_j)) (two sites), h a polynomial.

    A pair's G = [φ' H + F_i' ρ_ji' + X_i ρ_ji' (δ_jB − x_i)/ρ_i + the same with i and j exchanged]/d, X_i = Σ_j φ_ij
    ∂H_ij/∂x_i: one bond a pair. Embedding energy belongs to its own atom, half of a pair's energy to each end; since
    x_j depends on all neighbours of j, bonds between neighbours of an atom carry energy sources, though no force.
    Between the points of the tables it is LAMMPS's cubic spline.

    Parameters
    ----------
    tables : EAMTables of two elements, A and B, with `mixing`, in `units`
    elements : the element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom is A.
    units : unit style of the tables; the default has eV and Å
    two_sites : LAMMPS's ``eam/cd/old``

    Notes
    -----
    Source: Caro, Crowson & Caro, Phys. Rev. Lett. 95, 075702 (2005); Stukowski, Sadigh, Erhart & Caro, Model. Simul.
    Mater. Sci. Eng. 17, 075005 (2009).
    """

    work = _ConcentrationWork
    sweeps = 2
    # A bond of i and j has X_j, which may have the concentrations of j's neighbours, which have their neighbours.
    depth = 3.0
    word = "EAM"

    def __init__(self, tables: EAMTables, elements=None, *, units: str | Units = "metal", two_sites: bool = False):
        self.units = system(units)
        self.style = "eam/cd/old" if two_sites else "eam/cd"
        if tables.mixing is None or len(tables.elements) != 2:
            raise AtcError(
                f"{self.style}: needs tables of two elements with a polynomial h(x), got {len(tables.elements)} "
                "elements"
            )
        self.map = ElementMap(elements, tables.elements, f"pair_style {self.style}")
        take_tables(self, tables, [0, 1])
        self.rho = np.ascontiguousarray(self.rho[:, 0])
        self.two_sites, self.h = bool(two_sites), np.ascontiguousarray(tables.mixing, float)

    @classmethod
    def from_file(
        cls, path, elements=None, *, units: str | Units = "metal", two_sites: bool = False, where: str = ""
    ) -> ConcentrationEAM:
        """From a LAMMPS file, e.g. ``ConcentrationEAM.from_file("FeCr.cdeam", ["Fe", "Cr"])``. where : the line that
        names it, for messages."""
        t = read_setfl(path, system(units).name, False, where, mixing=True)
        require_known(elements, t.elements, path, where)
        return cls(t, elements, units=units, two_sites=two_sites).with_masses(t.elements, t.masses, where)

    def describe(self) -> str:
        return f"{self.style}{self.map.describe()}, embedding energy to its own atom, pair energy shared half to each"


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(table, d, per_dr):
    """Value and slope of a table at a distance."""
    m, x = _place(d, per_dr, table.shape[0] - 1)
    return cubic(table[m], x, per_dr)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _phi(table, d, per_dr):
    z, dz = _at(table, d, per_dr)
    return z / d, (dz - z / d) / d


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _h(h, x):
    """h(x) and h'(x)."""
    value = slope = 0.0
    for k in range(len(h) - 1, -1, -1):
        slope = slope * x + value
        value = value * x + h[k]
    return value, slope


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _mixed(h, two_sites, x, y):
    """H of concentrations x and y, and its derivative by x."""
    if two_sites:
        value, slope = _h(h, 0.5 * (x + y))
        return value, 0.5 * slope
    value, slope = _h(h, x)
    return 0.5 * (value + _h(h, y)[0]), 0.5 * slope


@njit(cache=True, nogil=True, error_model="numpy")
def _densities(s0, s1, near, F, rho_table, per_drho, per_dr, rho, x, slope, grad, energies):
    """ρ, x, F' of the atoms s0..s1, and Σ_k ∂x/∂x_k where wanted. Returns Σ F."""
    start, pair, end, a, b, r, d, element, atom = near
    total = 0.0
    for s in range(s0, s1):
        of_B = 0.0
        for e in range(start[s], start[s + 1]):
            p = pair[e]
            k = b[p] if end[e] == 0 else a[p]
            value = _at(rho_table[element[k]], d[p], per_dr)[0]
            rho[s] += value
            of_B += value if element[k] == 1 else 0.0
        x[s] = of_B / rho[s] if rho[s] > 0.0 else 0.0
        u, slope[s] = embedding(F[element[s]], rho[s], per_drho)
        total += u
        if len(energies) > 0:
            energies[atom[s]] += u
        if len(grad) > 0 and rho[s] > 0.0:
            for e in range(start[s], start[s + 1]):
                p = pair[e]
                k, sign = (b[p], 1.0) if end[e] == 0 else (a[p], -1.0)
                g = (
                    _at(rho_table[element[k]], d[p], per_dr)[1]
                    * ((1.0 if element[k] == 1 else 0.0) - x[s])
                    / (rho[s] * d[p])
                )
                for c3 in range(3):
                    grad[s, c3] -= g * sign * r[p, c3]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def _weights(s0, s1, near, zr, per_dr, h, two_sites, x, X):
    """X of the atoms s0..s1."""
    start, pair, end, a, b, _, d, element, _ = near
    for s in range(s0, s1):
        for e in range(start[s], start[s + 1]):
            p = pair[e]
            k = b[p] if end[e] == 0 else a[p]
            if element[k] != element[s]:
                X[s] += _phi(zr[0, 1], d[p], per_dr)[0] * _mixed(h, two_sites, x[s], x[k])[1]


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs(p0, p1, near, rho_table, zr, per_dr, h, two_sites, rho, x, slope, X, grad, out, energies):
    _, _, _, a, b, r, d, element, atom = near
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(out_D) > 0
    total = 0.0
    m = 0
    for p in range(p0, p1):
        i, j = a[p], b[p]
        ei, ej = element[i], element[j]
        u, du = _phi(zr[ei, ej], d[p], per_dr)
        by_i = by_j = 0.0
        if ei != ej:
            H, by_i = _mixed(h, two_sites, x[i], x[j])
            by_j = _mixed(h, two_sites, x[j], x[i])[1]
            by_i *= u
            by_j *= u
            u *= H
            du *= H
        # What j does to the density of i, and to its concentration.
        drho_i, drho_j = _at(rho_table[ej], d[p], per_dr)[1], _at(rho_table[ei], d[p], per_dr)[1]
        dx_i = drho_i * ((1.0 if ej == 1 else 0.0) - x[i]) / rho[i] if rho[i] > 0.0 else 0.0
        dx_j = drho_j * ((1.0 if ei == 1 else 0.0) - x[j]) / rho[j] if rho[j] > 0.0 else 0.0
        g = (du + slope[i] * drho_i + slope[j] * drho_j + X[i] * dx_i + X[j] * dx_j) / d[p]
        if not np.isfinite(g + u):
            return 0, 0.0, p
        total += u
        share_half(energies, atom[i], atom[j], u)
        keep = g != 0.0
        out_i[m], out_j[m], out_G[m] = atom[i], atom[j], g
        for c in range(3):
            out_r[m, c] = r[p, c]
            if sources:
                # grad : Σ_k ∂x/∂x_k, minus what the atom's own motion does to its concentration.
                out_D[m, 0, c] = (
                    -(0.5 * du + slope[i] * drho_i + 0.5 * X[i] * dx_i) / d[p] * r[p, c] - 0.5 * by_j * grad[j, c]
                )
                out_D[m, 1, c] = (0.5 * du + slope[j] * drho_j + 0.5 * X[j] * dx_j) / d[p] * r[
                    p, c
                ] - 0.5 * by_i * grad[i, c]
                keep = keep or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
        m += 1 if keep else 0
    return m, total, -1


@njit(cache=True, nogil=True, error_model="numpy")
def _outer(s0, s1, most, near, rho_table, zr, per_dr, h, two_sites, rho, x, out, energies):
    """Between neighbours e, f of an atom s: ∂U^(e)/∂x_f = ½ φ_es ∂H/∂x_s ∂x_s/∂x_f, and the same with e and f
    exchanged."""
    element = near[7]
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    share, slope = np.empty(most), np.empty(most)
    m = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        if not rho[s] > 0.0:
            continue
        for e in range(k):
            o = who[e]
            share[e] = 0.0
            if element[o] != element[s]:
                share[e] = 0.5 * _phi(zr[0, 1], dist[e], per_dr)[0] * _mixed(h, two_sites, x[s], x[o])[1]
            slope[e] = (
                -_at(rho_table[element[o]], dist[e], per_dr)[1]
                * ((1.0 if element[o] == 1 else 0.0) - x[s])
                / (rho[s] * dist[e])
            )
        m = between_sharing_neighbors(k, near, who, arm, share, slope, out, m)
    return m, 0.0


mapped_style("eam/cd", ending=".cdeam", read=ConcentrationEAM.from_file)
mapped_style("eam/cd/old", ending=".cdeam", read=ConcentrationEAM.from_file, two_sites=True)
