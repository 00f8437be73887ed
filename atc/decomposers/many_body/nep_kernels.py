"""Energies of atoms of a neuroevolution potential, and their gradients by the vectors to their neighbours."""

from __future__ import annotations

from functools import cache
from math import factorial

import numpy as np

from ...compiled import njit
from .neighborhood import around

_PI = np.pi


def size(l_max: int) -> int:
    """Harmonics of degree 1 to l_max: (l, m) stands at l² − 1 + (0 for m = 0, 2m − 1 for cos mφ, 2m for sin mφ)."""
    return (l_max + 1) ** 2 - 1


@cache
def norms(l_max: int) -> np.ndarray:
    """(l_max + 1, l_max + 1) [l, m]: what makes dᵐP_l/dzᵐ(z) Re or Im (x + iy)ᵐ orthonormal on the unit sphere."""
    out = np.zeros((l_max + 1, l_max + 1))
    for l in range(l_max + 1):
        for m in range(l + 1):
            out[l, m] = np.sqrt((2 * l + 1) / (4 * np.pi) * factorial(l - m) / factorial(l + m) * (2 if m else 1))
    return out


@cache
def coupling(l_max: int, degrees: tuple) -> tuple[np.ndarray, np.ndarray]:
    """The invariant Σ (l1 l2 l3; m1 m2 m3) A_l1m1 A_l2m2 A_l3m3 as Σ C s_a s_b s_c of real harmonics.

    Wigner's 3j symbols are what integrals of three harmonics are made of (Gaunt):
    ∫YYY = √((2l1+1)(2l2+1)(2l3+1)/4π) (l1 l2 l3; 0 0 0) (l1 l2 l3; m1 m2 m3).

    Returns
    -------
    (q, 3) int64 a, b, c and (q,) C
    """
    top = sum(degrees)
    z, weight = np.polynomial.legendre.leggauss(top + 1)
    phi = 2 * np.pi * np.arange(2 * top + 1) / (2 * top + 1)
    rho = np.sqrt(1 - z * z)[:, None]
    u = np.stack([rho * np.cos(phi), rho * np.sin(phi), np.broadcast_to(z[:, None], rho.shape[:1] + phi.shape)], -1)
    u = u.reshape(-1, 3)
    w = np.repeat(weight, len(phi)) * 2 * np.pi / len(phi)
    Y = np.empty((len(u), size(l_max)))
    P = np.zeros((l_max + 1, l_max + 2))
    xy = np.zeros((2, l_max + 1))
    for g in range(len(u)):
        harmonics(u[g, 0], u[g, 1], u[g, 2], l_max, norms(l_max), P, xy, Y[g])
    of = [slice(l * l - 1, (l + 1) ** 2 - 1) for l in degrees]
    C = np.einsum("g,ga,gb,gc->abc", w, *(Y[:, s] for s in of))
    C /= np.sqrt(np.prod([2 * l + 1 for l in degrees]) / (4 * np.pi)) * _three_j_zero(*degrees)
    places = np.argwhere(np.abs(C) > 1e-13)
    return places + np.array([s.start for s in of]), C[tuple(places.T)]


def _three_j_zero(a: int, b: int, c: int) -> float:
    """(a b c; 0 0 0), a + b + c even (Edmonds 1957, eq. 3.7.17)."""
    f, J = factorial, a + b + c
    g = J // 2
    root = f(J - 2 * a) * f(J - 2 * b) * f(J - 2 * c) / f(J + 1)
    return (-1) ** g * np.sqrt(root) * f(g) / (f(g - a) * f(g - b) * f(g - c))


@njit(cache=True, nogil=True, error_model="numpy")
def harmonics(x, y, z, l_max, norm, P, xy, Y):
    """Real harmonics of a unit vector into Y; P[l, m] = dᵐP_l/dzᵐ and xy = Re, Im (x + iy)ᵐ are left for the
    gradient."""
    xy[0, 0], xy[1, 0] = 1.0, 0.0
    for m in range(1, l_max + 1):
        xy[0, m] = x * xy[0, m - 1] - y * xy[1, m - 1]
        xy[1, m] = x * xy[1, m - 1] + y * xy[0, m - 1]
    diagonal = 1.0
    for m in range(l_max + 1):
        P[m, m] = diagonal
        diagonal *= 2 * m + 1
        for l in range(m + 1, l_max + 1):
            below = P[l - 2, m] if l > m + 1 else 0.0
            P[l, m] = ((2 * l - 1) * z * P[l - 1, m] - (l + m - 1) * below) / (l - m)
    for l in range(1, l_max + 1):
        at = l * l - 1
        Y[at] = norm[l, 0] * P[l, 0]
        for m in range(1, l + 1):
            q = norm[l, m] * P[l, m]
            Y[at + 2 * m - 1] = q * xy[0, m]
            Y[at + 2 * m] = q * xy[1, m]


@njit(cache=True, nogil=True, error_model="numpy")
def slope(l_max, norm, P, xy, W, out):
    """Σ W_lm ∂Y_lm/∂(x, y, z) of the polynomials that `harmonics` evaluates; only its part across the vector has
    meaning."""
    gx = gy = gz = 0.0
    for l in range(1, l_max + 1):
        at = l * l - 1
        gz += W[at] * norm[l, 0] * P[l, 1]
        for m in range(1, l + 1):
            c, s, n = W[at + 2 * m - 1], W[at + 2 * m], norm[l, m]
            q = n * P[l, m] * m
            gx += q * (c * xy[0, m - 1] + s * xy[1, m - 1])
            gy += q * (s * xy[0, m - 1] - c * xy[1, m - 1])
            if m < l:
                gz += n * P[l, m + 1] * (c * xy[0, m] + s * xy[1, m])
    out[0], out[1], out[2] = gx, gy, gz


@njit(cache=True, nogil=True, error_model="numpy")
def basis(d, rc, f, df):
    """f_k = ½ (T_k(2 (d/r_c − 1)² − 1) + 1) f_c, f_c = ½ (1 + cos π d/r_c), and their derivatives, d < r_c."""
    c = _PI / rc
    fc, dfc = 0.5 + 0.5 * np.cos(c * d), -0.5 * c * np.sin(c * d)
    y = d / rc - 1.0
    x, dx = 2.0 * y * y - 1.0, 4.0 * y / rc
    f[0], df[0] = fc, dfc
    T0, T1, D0, D1 = 1.0, x, 0.0, dx
    for k in range(1, len(f)):
        h = 0.5 * (T1 + 1.0)
        f[k] = h * fc
        df[k] = 0.5 * D1 * fc + h * dfc
        T0, T1, D0, D1 = T1, 2.0 * x * T1 - T0, D1, 2.0 * (dx * T1 + x * D1) - D0


@njit(cache=True, nogil=True, error_model="numpy")
def screened(d, row):
    """The repulsion of two nuclei and its derivative: (strength/d) Σ a exp(−b d) f; row: inner, outer, strength, then
    a, b four times; f = 1 below inner, 0 above outer, ½ (1 + cos π (d − inner)/(outer − inner)) between."""
    if d >= row[1]:
        return 0.0, 0.0
    s = ds = 0.0
    for k in range(4):
        e = row[3 + 2 * k] * np.exp(-row[4 + 2 * k] * d)
        s += e
        ds -= row[4 + 2 * k] * e
    f, df = 1.0, 0.0
    if d > row[0]:
        c = _PI / (row[1] - row[0])
        f, df = 0.5 + 0.5 * np.cos(c * (d - row[0])), -0.5 * c * np.sin(c * (d - row[0]))
    U = row[2] * s / d
    return U * f, (row[2] * ds - U) / d * f + U * df


@njit(cache=True, nogil=True, error_model="numpy")
def centres(s0, s1, most, near, radial, angular, invariants, network, core, units, g_end, energies):
    """U of the atoms s0..s1; into g_end[pair, side] the gradient of the energy of the atom at that side by the vector
    from it to the other one.

    radial, angular : cutoffs (t, t) and c (t, t, k, n). invariants : l_max, norm, and abc, C: terms C s_a s_b s_c of
        invariants number `which`; fifth: the number of (Σ s_1m²)², −1 if there is none; n_many
    network : w0, b0, w1, b1. core : (t, t, 11) rows of `screened`, (0, 0, 11) if there is none. units : Å and eV
    """
    start, pair, end, _, _, _, _, element, atom = near
    (rc_radial, c_radial), (rc_angular, c_angular), (length, energy) = radial, angular, units
    l_max, norm, abc, C, which, fifth, n_many = invariants
    w0, b0, w1, b1 = network
    t, _, k_radial, n_radial = c_radial.shape
    k_angular, n_angular = c_angular.shape[2:]
    n_lm = (l_max + 1) ** 2 - 1
    descriptors = n_radial + n_angular * (l_max + n_many)
    neurons = w0.shape[1]
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    df = np.empty((most, k_radial))
    g, dg = np.empty((most, n_angular)), np.empty((most, n_angular))
    f_k = np.empty(k_radial)
    fa_k, dfa_k = np.empty(k_angular), np.empty(k_angular)
    sums, back = np.empty((t, k_radial)), np.empty((t, k_radial))
    s_nl, B_nl = np.empty((n_angular, n_lm)), np.empty((n_angular, n_lm))
    Y, W, V = np.empty(n_lm), np.empty(n_lm), np.empty(n_lm)
    P, xy = np.zeros((l_max + 1, l_max + 2)), np.zeros((2, l_max + 1))
    q, F = np.empty(descriptors), np.empty(descriptors)
    across = np.empty(3)
    total = 0.0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        es = element[s]
        sums[:] = 0.0
        s_nl[:] = 0.0
        for e in range(k):
            o = element[who[e]]
            dist[e] /= length
            x = dist[e]
            # The unit vector to the neighbour.
            for c in range(3):
                arm[e, c] /= -length * x
            if x < rc_radial[es, o]:
                basis(x, rc_radial[es, o], f_k, df[e])
                for p in range(k_radial):
                    sums[o, p] += f_k[p]
            if x < rc_angular[es, o]:
                basis(x, rc_angular[es, o], fa_k, dfa_k)
                g[e] = 0.0
                dg[e] = 0.0
                for p in range(k_angular):
                    for n in range(n_angular):
                        g[e, n] += c_angular[es, o, p, n] * fa_k[p]
                        dg[e, n] += c_angular[es, o, p, n] * dfa_k[p]
                harmonics(arm[e, 0], arm[e, 1], arm[e, 2], l_max, norm, P, xy, Y)
                for n in range(n_angular):
                    for i in range(n_lm):
                        s_nl[n, i] += g[e, n] * Y[i]
        # Descriptors.
        q[:] = 0.0
        for o in range(t):
            for p in range(k_radial):
                for n in range(n_radial):
                    q[n] += c_radial[es, o, p, n] * sums[o, p]
        for n in range(n_angular):
            for l in range(1, l_max + 1):
                for i in range(l * l - 1, (l + 1) * (l + 1) - 1):
                    q[n_radial + (l - 1) * n_angular + n] += s_nl[n, i] * s_nl[n, i]
            first = n_radial + l_max * n_angular + n
            for i in range(len(C)):
                q[first + which[i] * n_angular] += C[i] * s_nl[n, abc[i, 0]] * s_nl[n, abc[i, 1]] * s_nl[n, abc[i, 2]]
            if fifth >= 0:
                square = s_nl[n, 0] * s_nl[n, 0] + s_nl[n, 1] * s_nl[n, 1] + s_nl[n, 2] * s_nl[n, 2]
                # (1 1 0; 0 0 0)² + (1 1 2; 0 0 0)² = 7/15
                q[first + fifth * n_angular] = 7.0 / 15.0 * square * square
        # The network.
        F[:] = 0.0
        U = -b1[es]
        for h in range(neurons):
            z = -b0[es, h]
            for i in range(descriptors):
                z += w0[es, h, i] * q[i]
            z = np.tanh(z)
            U += w1[es, h] * z
            z = w1[es, h] * (1.0 - z * z)
            for i in range(descriptors):
                F[i] += w0[es, h, i] * z
        # And back to the neighbours.
        back[:] = 0.0
        for o in range(t):
            for p in range(k_radial):
                for n in range(n_radial):
                    back[o, p] += c_radial[es, o, p, n] * F[n]
        for n in range(n_angular):
            for l in range(1, l_max + 1):
                for i in range(l * l - 1, (l + 1) * (l + 1) - 1):
                    B_nl[n, i] = 2.0 * F[n_radial + (l - 1) * n_angular + n] * s_nl[n, i]
            first = n_radial + l_max * n_angular + n
            for i in range(len(C)):
                w = F[first + which[i] * n_angular] * C[i]
                x, y, z = s_nl[n, abc[i, 0]], s_nl[n, abc[i, 1]], s_nl[n, abc[i, 2]]
                B_nl[n, abc[i, 0]] += w * y * z
                B_nl[n, abc[i, 1]] += w * x * z
                B_nl[n, abc[i, 2]] += w * x * y
            if fifth >= 0:
                square = s_nl[n, 0] * s_nl[n, 0] + s_nl[n, 1] * s_nl[n, 1] + s_nl[n, 2] * s_nl[n, 2]
                w = F[first + fifth * n_angular] * (28.0 / 15.0) * square
                for i in range(3):
                    B_nl[n, i] += w * s_nl[n, i]
        for e in range(k):
            o, x = element[who[e]], dist[e]
            along = 0.0
            across[:] = 0.0
            if x < rc_radial[es, o]:
                for p in range(k_radial):
                    along += back[o, p] * df[e, p]
            if x < rc_angular[es, o]:
                W[:] = 0.0
                V[:] = 0.0
                for n in range(n_angular):
                    for i in range(n_lm):
                        W[i] += B_nl[n, i] * g[e, n]
                        V[i] += B_nl[n, i] * dg[e, n]
                harmonics(arm[e, 0], arm[e, 1], arm[e, 2], l_max, norm, P, xy, Y)
                for i in range(n_lm):
                    along += V[i] * Y[i]
                slope(l_max, norm, P, xy, W, across)
                out = across[0] * arm[e, 0] + across[1] * arm[e, 1] + across[2] * arm[e, 2]
                for c in range(3):
                    across[c] = (across[c] - out * arm[e, c]) / x
            if len(core):
                z, dz = screened(x, core[es, o])
                U += 0.5 * z
                along += 0.5 * dz
            i, side = pair[start[s] + e], end[start[s] + e]
            for c in range(3):
                g_end[i, side, c] = (along * arm[e, c] + across[c]) * (energy / length)
        U *= energy
        total += U
        if len(energies):
            energies[atom[s]] += U
    return total
