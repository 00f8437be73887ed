"""Loops of bond-order potentials over the neighbours of an atom and over merged bonds; see `tersoff`
for formulas and stages.

Members of the family (Tersoff, its modification by Kumagai et al., Gao-Weber, those with a ZBL core) differ in the
cutoff, the angular function, the function b(ζ) and the repulsion, which `form` = (cutoff, angular, order) and the
columns of the tables choose; the sums are the same.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from .neighbor_work import law
from .neighborhood import around, between_neighbors

SINE, MURTY = 0, 1
TERSOFF, KUMAGAI, GAO_WEBER = 0, 1, 2


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _cutoff(kind, d, R, D):
    """f_C and its slope."""
    if d < R - D:
        return 1.0, 0.0
    if d >= R + D:
        return 0.0, 0.0
    x = 0.5 * np.pi * (d - R) / D
    if kind == MURTY:
        return 0.5 - 0.5625 * np.sin(x) - 0.0625 * np.sin(3.0 * x), -0.28125 * np.pi / D * (
            np.cos(x) + np.cos(3.0 * x) / 3.0
        )
    return 0.5 * (1.0 - np.sin(x)), -0.25 * np.pi / D * np.cos(x)


@njit(cache=True, nogil=True, error_model="numpy")
def bond_order(kind, zeta, two):
    """b(ζ) and b'(ζ), with LAMMPS's limits (PairTersoff::ters_bij) where one term of 1 + (βζ)ⁿ is lost in the other."""
    if kind != TERSOFF:
        return _other_order(kind, zeta, two[6], two[7])
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
def _other_order(kind, zeta, eta, n):
    """b(ζ) and b'(ζ) of Gao and Weber (eta is their β) and of Kumagai et al."""
    if kind == GAO_WEBER:
        b = (eta * (1.0 + zeta)) ** -n
        return b, -n * b / (1.0 + zeta)
    if zeta <= 0.0:
        return 1.0, 0.0
    t = zeta**eta
    return (1.0 + t) ** (-0.5 / n), -0.5 * eta / n * (1.0 + t) ** (-1.0 - 0.5 / n) * t / zeta


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _angular(kind, cos, tri):
    """g(θ) and dg/dcosθ."""
    h = tri[7] - cos
    if kind == KUMAGAI:
        h2 = h * h
        q = 1.0 / (tri[6] + h2)
        go, dgo = tri[5] * h2 * q, -2.0 * tri[5] * tri[6] * h * q * q
        e = tri[9] * np.exp(-tri[10] * h2)
        return tri[8] + go * (1.0 + e), dgo * (1.0 + e) + go * e * 2.0 * tri[10] * h
    q = 1.0 / (tri[6] + h * h)
    return tri[4] * (tri[8] - tri[5] * q), -2.0 * tri[4] * tri[5] * h * q * q


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _fermi(d, center, steep):
    """1/(1 + exp(−A_F (d − r_C))) and its slope: 1 everywhere where A_F is 0."""
    if steep == 0.0:
        return 1.0, 0.0
    f = 1.0 / (1.0 + np.exp(-steep * (d - center)))
    return f, steep * f * (1.0 - f)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _universal(d, strength, a):
    """Coulomb energy of two nuclei screened by the universal function of Ziegler, Biersack and Littmark, and its
    slope."""
    x = d / a
    e1, e2, e3, e4 = (
        0.1818 * np.exp(-3.2 * x),
        0.5099 * np.exp(-0.9423 * x),
        0.2802 * np.exp(-0.4029 * x),
        0.02817 * np.exp(-0.2016 * x),
    )
    phi = e1 + e2 + e3 + e4
    slope = -(3.2 * e1 + 0.9423 * e2 + 0.4029 * e3 + 0.2016 * e4) / a
    return strength * phi / d, strength * (slope - phi / d) / d


@njit(cache=True, nogil=True, error_model="numpy")
def bond_orders(form, shift, s0, s1, most, near, two, three, weights, G_end, S_end, out, energies):
    """V_ij of the bonds of the atoms s0..s1 and its derivatives: arms into the slots, outer distances to the out
    arrays."""
    start, pair, end, _, _, _, _, element, atom = near
    sources = len(S_end) > 0
    shared = len(energies) > 0
    cut_kind, angular, order_kind = form
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
        k = around(s, near, who, arm, dist)
        for e in range(k):
            G_arm[e] = 0.0
            for c in range(3):
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
            r1 = d1 + shift
            if r1 >= par[0] + par[1] or par[4] == 0.0:
                continue
            zeta = 0.0
            for f in range(k):
                along[f] = other[f] = outer[f] = 0.0
                if f == e:
                    continue
                tri = three[es, ee, element[who[f]]]
                d2 = dist[f]
                if d2 + shift >= tri[0] + tri[1]:
                    continue
                fc, dfc = _cutoff(cut_kind, d2 + shift, tri[0], tri[1])
                v = 1.0 / (d1 * d2)
                cos = (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) * v
                g, dg = _angular(angular, cos, tri)
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
            fc, dfc = _cutoff(cut_kind, r1, par[0], par[1])
            far, dfar = _fermi(r1, par[15], par[16])
            attraction = -par[4] * np.exp(-par[5] * r1)
            fa, dfa = attraction * fc * far, attraction * ((dfc - par[5] * fc) * far + fc * dfar)
            order, slope = bond_order(order_kind, zeta, par)
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
        m = between_neighbors(k, near, who, arm, G_out, S_out, sources, out, m)
    return m, total


@law
def repulsion(ea, eb, d, cut_kind, shift, table):
    """U and U'/d of the repulsion of a pair, and of its core."""
    par = table[ea, eb]
    r = d + shift
    fc, dfc = _cutoff(cut_kind, r, par[0], par[1])
    e = par[2] * np.exp(-par[3] * r)
    u = (e + par[4]) * fc
    du = (e + par[4]) * dfc - par[3] * e * fc
    # The core, too, ends at R + D.
    if par[8] > 0.0 and r < par[0] + par[1]:
        far, dfar = _fermi(r, par[7], par[8])
        core, dcore = _universal(r, par[5], par[6])
        u, du = far * u + (1.0 - far) * core, far * du + dfar * (u - core) + (1.0 - far) * dcore
    return u, du / d
