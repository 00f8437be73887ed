"""Tabulated three-body potentials of Zhou's polymorphic form: Stillinger-Weber, Tersoff, embedded atom and others
(LAMMPS ``pair_style polymorphic``)."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...units import Units
from ...units import units as system
from ..bonded.cluster import weights_of
from .centred import Centred
from .elements import ElementMap, mapped_style, require_known
from .embedded_atom import cubic, spline
from .neighbor_work import law
from .neighborhood import around, between_neighbors
from .parameter_file import LARGE, Rows, read_parameter_file, same_units, word_lines
from .tersoff import _PAIR


@dataclass
class PolymorphicTables:
    """names; eta; cut_ee, xi_ee (m, m); tables with the first argument and the step: U, V, W (m, m, nr) from 0 with
    step_ee, P (m, m, m, nr) [i, j, k] from −r_max with step_P, G (m, m, m, ntheta) [i, j, k] from −1 with step_G, F (m,
    m, nx) from 0 with step_F; i at the centre."""

    names: list[str]
    eta: int
    cut_ee: np.ndarray
    xi_ee: np.ndarray
    U: np.ndarray
    V: np.ndarray
    W: np.ndarray
    P: np.ndarray
    G: np.ndarray
    F: np.ndarray
    xmax: float


def read_polymorphic(path, units_name: str = "metal", where: str = "") -> PolymorphicTables:
    """A ``.poly`` file.

    Raises
    ------
    AtcError for a missing, malformed or truncated file.
    """
    text = read_parameter_file(path, "polymorphic", where)
    same_units(text, units_name, path, "polymorphic")
    lines = word_lines(text)
    rows = Rows(path, lines)
    row = rows.values
    (m, eta), at = row("the number of elements and eta", (int, int))
    if not 1 <= m <= 100:
        raise AtcError(f"{at}: the number of elements must be between 1 and 100, got {m}")
    names = [row("an atomic number, a mass and a name", (float, float, str))[0][2] for _ in range(m)]
    (nr, ntheta, nx, xmax), at = row("nr ntheta nx xmax", (int, int, int, float))
    if min(nr, ntheta, nx) < 5 or max(nr, ntheta, nx) > 10_000_000 or not xmax > 0:
        raise AtcError(f"{at}: nr, ntheta and nx must be at least 5 and xmax positive")
    order = [(i, i) for i in range(m)] + [(i, j) for i in range(m) for j in range(i + 1, m)]
    cut, xi = np.zeros((m, m)), np.zeros((m, m))
    for i, j in order:
        (c, x), at = row("a cutoff and xi", (float, float))
        if not c > 0:
            raise AtcError(f"{at}: a cutoff must be positive, got {c:g}")
        cut[i, j] = cut[j, i] = c
        xi[i, j] = xi[j, i] = x
    words = [w for _, line in lines[rows.place :] for w in line]
    triples = m**3
    count = len(order) * (3 * nr + nx) + triples * ntheta + (triples if eta == 3 else len(order)) * nr
    if len(words) < count:
        raise AtcError(f"{path}: {len(words)} tabulated values where {count} should be: the file is cut off")
    try:
        values = np.array(words[:count], dtype=np.float64)
    except ValueError:
        values = np.array([np.nan])
    if not (np.abs(values) < LARGE).all():
        raise AtcError(
            f"{path}: the tables (from line {lines[rows.place][0]}) hold something that is not a finite number"
        )
    used = 0

    def take(n):
        nonlocal used
        used += n
        return values[used - n : used]

    def pairs(n):
        out = np.zeros((m, m, n))
        for i, j in order:
            out[i, j] = out[j, i] = take(n)
        return out

    U, V, W = pairs(nr), pairs(nr), pairs(nr)
    # The file's triples are JIK, the centre in the middle.
    P = (
        take(triples * nr).reshape(m, m, m, nr).transpose(1, 0, 2, 3)
        if eta == 3
        else np.repeat(pairs(nr)[:, None], m, axis=1)
    )
    G = take(triples * ntheta).reshape(m, m, m, ntheta).transpose(1, 0, 2, 3)
    return PolymorphicTables(names, eta, cut, xi, U, V, W, P, G, pairs(nx), xmax)


class Polymorphic(Centred):
    """U = Σ_pairs U(d) − ½ Σ_{i≠j} F_ij(X_ij) V_ij(d_ij), X_ij = Σ_{k≠j} W_ik(d_ik) G_jik(cos θ) P_jik(d_ij − ξ_ij
    d_ik); or, with η = 1, of embedded atoms, U = Σ_pairs U(d) − ½ Σ_i F_ii(X_i), X_i = Σ_k W_ik(d_ik).

    All functions come from tables, with LAMMPS's interpolation: the cubic of the nearest point (so they jump, by as
    much as the table is coarse, halfway between points). G follows from arms and cosines as in `Tersoff`. Half of U to
    each end; F V half to i and j each as in LAMMPS, or as `partition` says ("pair", "center", two numbers); with η = 1
    to i.

    Parameters
    ----------
    tables : PolymorphicTables in `units`
    elements : the tables' element of each atom type, from type 1; None or "NULL" leaves a type out. Default: every atom
        is the first element.
    units : the default has eV and Å

    Notes
    -----
    Source: Zhou, Foster, Jones, Yang, Fan & Doty, J. Mater. Sci. Res. 4, 15 (2015).
    """

    style = "polymorphic"
    part_name = "polymorphic"
    partitions = MappingProxyType({"equal": "pair", "center": "center"})

    def __init__(self, tables: PolymorphicTables, elements=None, *, units: str | Units = "metal", partition="pair"):
        self.units = u = system(units)
        t = tables
        self.map = ElementMap(elements, t.names, "pair_style polymorphic")
        self.share(partition)
        energy, length = u.energy, u.length
        nr = t.U.shape[-1]
        self.eam = t.eta == 1
        self.cut, self.xi = t.cut_ee * length, t.xi_ee
        self.cutoff = float(self.cut.max())
        self.per_r = (nr - 1) / self.cut
        self.per_p = (nr - 1) / (2.0 * self.cutoff)
        self.per_g, self.per_x = (t.G.shape[-1] - 1) / 2.0, (t.F.shape[-1] - 1) / t.xmax
        self.of_pair, self.F = (self.cut, self.per_r, spline(t.U * energy)), spline(t.F * energy)
        self.V, self.W, self.P, self.G = (spline(x) for x in (t.V, t.W, t.P, t.G))

    @classmethod
    def from_file(
        cls, path, elements=None, *, units: str | Units = "metal", partition="pair", where: str = ""
    ) -> Polymorphic:
        """From a LAMMPS file. where : the line that names it, for messages."""
        t = read_polymorphic(path, system(units).name, where)
        require_known(elements, t.names, path, where)
        return cls(t, elements, units=units, partition=partition)

    def share(self, partition):
        if isinstance(partition, str) and partition == "equal":
            partition = "pair"
        self.weights, self.shared = weights_of(partition, 2, _PAIR, "polymorphic")

    def describe(self) -> str:
        return (
            f"polymorphic{self.map.describe()}, {self.shared}, pair energy half to each atom; one merged bond a pair, "
            "outer j-k bonds apart"
        )

    @law
    def pair(ea, eb, d, cut, per_r, U):
        if d >= cut[ea, eb]:
            return 0.0, 0.0
        u, du = _at(U[ea, eb], d, per_r[ea, eb])
        return u, du / d

    def centres(self, s0, s1, most, near, *out):
        steps = self.per_r, self.per_p, self.per_g, self.per_x
        tables = self.V, self.W, self.P, self.G, self.F
        return _centres(s0, s1, most, near, self.eam, self.cut, self.xi, self.cutoff, steps, tables, self.weights, *out)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _at(table, x, per_step):
    """Value and slope of a table whose first argument is 0: the cubic of the nearest point."""
    p = x * per_step + 1.0
    m = max(1, min(int(p + 0.5), table.shape[0] - 1))
    p -= m
    return cubic(table[m], p, per_step)


@njit(cache=True, nogil=True, error_model="numpy")
def _centres(s0, s1, most, near, eam, cut, xi, r_max, steps, tables, weights, G_end, S_end, out, energies):
    start, pair, end, _, _, _, _, element, atom = near
    per_r, per_p, per_g, per_x = steps
    V, W, P, G, F = tables
    sources = len(S_end) > 0
    shared = len(energies) > 0
    w_i, w_j = weights[0], weights[1]
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    value, slope = np.empty(most), np.empty(most)
    along, other, outer = np.empty(most), np.empty(most), np.empty(most)  # ∂X/∂ξ of ij, ik, jk
    G_arm, G_out = np.empty(most), np.empty((most, most))
    grad, S = np.empty((most, 3)), np.empty((most, most, 3))
    g_j, g_k = np.empty(3), np.empty(3)
    total = 0.0
    n = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        es = element[s]
        X_s = 0.0
        for e in range(k):
            ee = element[who[e]]
            value[e] = slope[e] = G_arm[e] = 0.0
            if dist[e] < (cut[ee, ee] if eam else cut[es, ee]):
                # The density that an atom makes is its own element's.
                ew = ee if eam else es
                value[e], slope[e] = _at(W[ew, ee], dist[e], per_r[ew, ee])
            X_s += value[e]
            for c in range(3):
                grad[e, c] = 0.0
                for f in range(k):
                    S[e, f, c] = 0.0
            for f in range(k):
                G_out[e, f] = 0.0
        if eam:
            f_value, f_slope = _at(F[es, es], X_s, per_x)
            total -= 0.5 * f_value
            if shared:
                energies[atom[s]] -= 0.5 * f_value
            for e in range(k):
                G_arm[e] = -0.5 * f_slope * slope[e] / dist[e]
                for c in range(3):
                    grad[e, c] = -G_arm[e] * arm[e, c]
        for e in range(0 if eam else k):
            ee = element[who[e]]
            if dist[e] >= cut[es, ee]:
                continue
            X = 0.0
            for f in range(k):
                along[f] = other[f] = outer[f] = 0.0
                if f == e or dist[f] >= cut[es, element[who[f]]]:
                    continue
                ef = element[who[f]]
                v = 1.0 / (dist[e] * dist[f])
                cos = (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) * v
                g, dg = _at(G[es, ee, ef], cos + 1.0, per_g)
                p, dp = _at(P[es, ee, ef], dist[e] - xi[es, ee] * dist[f] + r_max, per_p)
                X += value[f] * g * p
                by_cos = value[f] * dg * p
                along[f] = by_cos * (v - cos / (dist[e] * dist[e])) + value[f] * g * dp / dist[e]
                other[f] = (
                    by_cos * (v - cos / (dist[f] * dist[f])) + g * (slope[f] * p - value[f] * xi[es, ee] * dp) / dist[f]
                )
                outer[f] = -by_cos * v
            f_value, f_slope = _at(F[es, ee], X, per_x)
            v_value, v_slope = _at(V[es, ee], dist[e], per_r[es, ee])
            energy = -0.5 * f_value * v_value
            pre = -0.5 * f_slope * v_value
            g_ij = -0.5 * f_value * v_slope / dist[e]
            total += energy
            if shared:
                energies[atom[s]] += w_i * energy
                energies[atom[who[e]]] += w_j * energy
            for f in range(k):
                g_ij += pre * along[f]
            G_arm[e] += g_ij
            for c in range(3):
                g_j[c] = -g_ij * arm[e, c]
            for f in range(k):
                if along[f] == 0.0 and other[f] == 0.0 and outer[f] == 0.0:
                    continue
                G_arm[f] += pre * other[f]
                G_out[min(e, f), max(e, f)] += pre * outer[f]
                if sources:
                    for c in range(3):
                        across = pre * outer[f] * (arm[f, c] - arm[e, c])
                        g_j[c] += across
                        g_k[c] = -pre * other[f] * arm[f, c] - across
                        grad[f, c] += w_i * g_k[c]
                        S[e, f, c] += w_j * g_k[c]
            for c in range(3):
                grad[e, c] += w_i * g_j[c]
                S[e, e, c] += w_j * g_j[c]
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            G_end[p, side] = G_arm[e]
            if sources:
                for c in range(3):
                    back = 0.0
                    for f in range(k):
                        back -= S[e, f, c]
                    S_end[p, side, 0, c], S_end[p, side, 1, c] = grad[e, c], back
        n = between_neighbors(k, near, who, arm, G_out, S, sources, out, n)
    return n, total


mapped_style("polymorphic", ending=".poly", read=Polymorphic.from_file)
