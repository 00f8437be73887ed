"""Loops of MEAM: how much each pair is screened, the densities and embedding energies of atoms, and one bond a pair;
see `atc.decomposers.many_body.meam`."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from .embedded_atom import _place, cubic
from .neighborhood import around, share_half


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _smooth(x):
    """f_c(x) = [1 − (1 − x)⁴]² between 0 and 1, and its slope."""
    if x >= 1.0:
        return 1.0, 0.0
    if x <= 0.0:
        return 0.0, 0.0
    y = 1.0 - x
    y3 = y * y * y
    b = 1.0 - y3 * y
    return b * b, 8.0 * b * y3


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _factor(u, v, w, low, high):
    """S_abk and its derivatives by u = d_ab², v = d_ak², w = d_bk², each over S_abk (×2: by ξ); 1, 0, 0, 0 where k does
    not screen."""
    X, Y = v / u, w / u
    a = 1.0 - (X - Y) * (X - Y)
    if a <= 0.0:
        return 1.0, 0.0, 0.0, 0.0
    more = X + Y - 1.0
    C = 1.0 + 2.0 * more / a
    if C >= high:
        return 1.0, 0.0, 0.0, 0.0
    f, df = _smooth((C - low) / (high - low))
    if f == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    t = df / ((high - low) * f)
    slant = 4.0 * more * (X - Y) / (a * a)
    CX, CY = 2.0 / a + slant, 2.0 / a - slant
    return f, -2.0 * t * (CX * X + CY * Y) / u, 2.0 * t * CX / u, 2.0 * t * CY / u


@njit(cache=True, nogil=True, error_model="numpy")
def screenings(p0, p1, near, rc, screen, S):
    """S of the pairs p0..p1, without cutoff (0 from rc on). Returns how many triples screen partially."""
    start, pair, end, a, b, r, d, element, _ = near
    Cmin, Cmax, bound = screen
    partial = 0
    for p in range(p0, p1):
        S[p] = 0.0
        if d[p] >= rc:
            continue
        s, t = a[p], b[p]
        es, et = element[s], element[t]
        u = d[p] * d[p]
        value = 1.0
        count = 0
        for q in range(start[s], start[s + 1]):
            pk = pair[q]
            # An atom that is its own neighbour has the pair twice in its list: only this end of it is the pair itself.
            if (pk == p and end[q] == 0) or d[pk] * d[pk] > bound * u:
                continue
            k, sign = (b[pk], 1.0) if end[q] == 0 else (a[pk], -1.0)
            w = 0.0
            for c in range(3):
                w += (sign * r[pk, c] - r[p, c]) ** 2
            f, by_u, by_v, by_w = _factor(u, d[pk] * d[pk], w, Cmin[es, et, element[k]], Cmax[es, et, element[k]])
            value *= f
            if value == 0.0:
                break
            if by_u != 0.0:
                count += 1
        S[p] = value
        partial += count if value != 0.0 else 0
    return partial


@njit(cache=True, nogil=True, error_model="numpy")
def _g(gamma, ibar, smooth):
    """G(Γ) and its derivative."""
    if ibar == 1:
        g = np.exp(0.5 * gamma)
        return g, 0.5 * g
    if ibar == 3:
        e = np.exp(-gamma)
        g = 2.0 / (1.0 + e)
        return g, 0.5 * g * g * e
    if ibar == -5:
        x = 1.0 + gamma
        g = np.sqrt(abs(x))
        if g == 0.0:
            return 0.0, 0.0
        return (g, 0.5 / g) if x >= 0.0 else (-g, 0.5 / g)
    switch = -smooth / (smooth + 1.0)
    if gamma < switch:
        g = np.sqrt((switch / gamma) ** smooth / (smooth + 1.0))
        return g, -0.5 * smooth * g / gamma
    g = np.sqrt(1.0 + gamma)
    return g, 0.5 / g


@njit(cache=True, nogil=True, error_model="numpy")
def densities(s0, s1, most, near, ending, S, atoms, ialloy, linear, smooth, ends, out, energies):
    """Embedding energies of the atoms s0..s1; G of the arms, ∂U/∂S of the pairs at each end, outer bonds. Returns their
    number and the energy."""
    start, pair, end, _, _, _, _, element, atom = near
    (rc, delr), (beta, t, rho0, re, strength, background, ibar) = ending, atoms
    G_end, S_end, dUdS = ends
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(S_end) > 0
    shared = len(energies) > 0
    who, arm, dist = np.empty(most, np.int32), np.empty((most, 3)), np.empty(most)
    active = np.empty(most, np.int32)  # the neighbours that count
    weight, fc, dfc = np.empty(most), np.empty(most), np.empty(most)
    A = np.empty((most, 4))  # atomic densities, times t where ialloy is 1
    P = np.empty((most, 4))  # times S f_c
    Q = np.empty((most, 4))  # ∂R_k/∂P_k
    G_arm, grad = np.empty(most), np.empty((most, 3))
    R, T, Y, ave, by_R, by_t = np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    total = 0.0
    n = 0
    for s in range(s0, s1):
        k = around(s, near, who, arm, dist)
        es = element[s]
        count = 0
        R[:] = 0.0
        T[:] = 0.0
        Y[:] = 0.0
        for e in range(k):
            p, side = pair[start[s] + e], end[start[s] + e]
            if S[p] == 0.0:
                continue
            active[count] = e
            count += 1
            ee = element[who[e]]
            fc[e], slope = _smooth((rc - dist[e]) / delr)
            dfc[e] = -slope / delr
            weight[e] = S[p] * fc[e]
            G_arm[e] = 0.0
            for c in range(3):
                grad[e, c] = 0.0
            for m in range(4):
                A[e, m] = rho0[ee] * np.exp(-beta[ee, m] * (dist[e] / re[ee] - 1.0))
                if ialloy == 1 and m > 0:
                    A[e, m] *= t[ee, m]
                P[e, m] = A[e, m] * weight[e]
                Q[e, m] = 0.0
            R[0] += P[e, 0]
            for m in range(1, 4):
                T[m] += t[ee, m] * P[e, 0]
                Y[m] += t[ee, m] ** 2 * P[e, 0]
        if R[0] <= 0.0:
            continue
        for x in range(count):
            e = active[x]
            for y in range(x, count):
                f = active[y]
                cos = (
                    (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) / (dist[e] * dist[f])
                    if y > x
                    else 1.0
                )
                l2, l3 = cos * cos - 1.0 / 3.0, (cos * cos - 0.6) * cos
                Q[e, 1] += 2.0 * P[f, 1] * cos
                Q[e, 2] += 2.0 * P[f, 2] * l2
                Q[e, 3] += 2.0 * P[f, 3] * l3
                if y > x:
                    Q[f, 1] += 2.0 * P[e, 1] * cos
                    Q[f, 2] += 2.0 * P[e, 2] * l2
                    Q[f, 3] += 2.0 * P[e, 3] * l3
        for m in range(1, 4):
            for x in range(count):
                R[m] += 0.5 * P[active[x], m] * Q[active[x], m]
        gamma = 0.0
        for m in range(1, 4):
            if ialloy == 2:
                ave[m] = t[es, m]
            elif ialloy == 1:
                ave[m] = T[m] / Y[m] if Y[m] > 0.0 else 0.0
            else:
                ave[m] = T[m] / R[0]
            gamma += ave[m] * R[m]
        gamma /= R[0] * R[0]
        g, dg = _g(gamma, ibar[es], smooth)
        rhobar = R[0] * g / background[es]
        if rhobar > 0.0:
            U = strength[es] * rhobar * np.log(rhobar)
            dU = strength[es] * (np.log(rhobar) + 1.0)
        else:
            dU = -strength[es] if linear else 0.0
            U = dU * rhobar
        total += U
        if shared:
            energies[atom[s]] += U
        dU /= background[es]
        by_R[0] = dU * (g - 2.0 * gamma * dg)
        for m in range(1, 4):
            by_R[m] = dU * dg * ave[m] / R[0]
            by_t[m] = dU * dg * R[m] / R[0]
        for x in range(count):
            e = active[x]
            p, side = pair[start[s] + e], end[start[s] + e]
            ee = element[who[e]]
            by_P0 = by_R[0]
            for m in range(1, 4):
                if ialloy == 0:
                    by_P0 += by_t[m] * (t[ee, m] - ave[m]) / R[0]
                elif ialloy == 1 and Y[m] > 0.0:
                    by_P0 += by_t[m] * (t[ee, m] - ave[m] * t[ee, m] ** 2) / Y[m]
            by_weight = A[e, 0] * by_P0
            radial = -beta[ee, 0] / re[ee] * P[e, 0] * by_P0
            for m in range(1, 4):
                by_weight += A[e, m] * by_R[m] * Q[e, m]
                radial -= beta[ee, m] / re[ee] * P[e, m] * by_R[m] * Q[e, m]
            dUdS[p, side] = fc[e] * by_weight
            G_arm[e] += (radial + S[p] * dfc[e] * by_weight) / dist[e]
            for y in range(x + 1, count):
                f = active[y]
                v = 1.0 / (dist[e] * dist[f])
                cos = (arm[e, 0] * arm[f, 0] + arm[e, 1] * arm[f, 1] + arm[e, 2] * arm[f, 2]) * v
                by_cos = 2.0 * (
                    by_R[1] * P[e, 1] * P[f, 1]
                    + 2.0 * cos * by_R[2] * P[e, 2] * P[f, 2]
                    + (3.0 * cos * cos - 0.6) * by_R[3] * P[e, 3] * P[f, 3]
                )
                if by_cos == 0.0:
                    continue
                G_arm[e] += by_cos * (v - cos / (dist[e] * dist[e]))
                G_arm[f] += by_cos * (v - cos / (dist[f] * dist[f]))
                out_i[n], out_j[n], out_G[n] = atom[who[e]], atom[who[f]], -by_cos * v
                for c in range(3):
                    out_r[n, c] = arm[f, c] - arm[e, c]
                    if sources:
                        grad[e, c] += out_G[n] * out_r[n, c]
                        grad[f, c] -= out_G[n] * out_r[n, c]
                n += 1
        for x in range(count):
            e = active[x]
            p, side = pair[start[s] + e], end[start[s] + e]
            G_end[p, side] = G_arm[e]
            if sources:
                for c in range(3):
                    S_end[p, side, 0, c] = grad[e, c] - G_arm[e] * arm[e, c]
    return n, total


@njit(cache=True, nogil=True, error_model="numpy")
def merge(p0, p1, near, ending, screen, pair_table, S, ends, out, energies):
    """Pair energies and bonds of the pairs p0..p1, and bonds to the atoms that screen them. Returns their number, the
    energy, the first bad pair (−1)."""
    start, pair, end, a, b, r, d, element, atom = near
    (rc, delr), (Cmin, Cmax, bound), (phi, per_dr) = ending, screen, pair_table
    G_end, S_end, dUdS = ends
    out_i, out_j, out_r, out_G, out_D = out
    sources = len(out_D) > 0
    points = phi.shape[2] - 1
    total = 0.0
    m = 0
    ga, gb, gk, bk = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    for p in range(p0, p1):
        if S[p] == 0.0:
            continue
        s, t = a[p], b[p]
        es, et = element[s], element[t]
        row, x = _place(d[p], per_dr, points)
        value, by_d = cubic(phi[es, et, row], x, per_dr)
        f, slope = _smooth((rc - d[p]) / delr)
        u, du = value * f, by_d * f - value * slope / delr
        own = S[p] * du / d[p]
        g = own + G_end[p, 0] + G_end[p, 1]
        if not np.isfinite(g + u):
            return 0, 0.0, p
        total += S[p] * u
        share_half(energies, atom[s], atom[t], S[p] * u)
        # The shares' derivatives by S, times S: what the factors' logarithmic derivatives want.
        qa, qb = S[p] * (dUdS[p, 0] + 0.5 * u), S[p] * (dUdS[p, 1] + 0.5 * u)
        own_slot = m
        m += 1
        if sources:
            for c in range(3):
                half = 0.5 * own * r[p, c]
                out_D[own_slot, 0, c] = -half + S_end[p, 0, 0, c]
                out_D[own_slot, 1, c] = half + S_end[p, 1, 0, c]
        square = d[p] * d[p]
        for q in range(start[s], start[s + 1]):
            pk = pair[q]
            if (pk == p and end[q] == 0) or d[pk] * d[pk] > bound * square:
                continue
            k, sign = (b[pk], 1.0) if end[q] == 0 else (a[pk], -1.0)
            w = 0.0
            for c in range(3):
                bk[c] = sign * r[pk, c] - r[p, c]
                w += bk[c] * bk[c]
            _, by_u, by_v, by_w = _factor(square, d[pk] * d[pk], w, Cmin[es, et, element[k]], Cmax[es, et, element[k]])
            if by_u == 0.0:
                continue
            g += (qa + qb) * by_u
            out_i[m], out_j[m], out_G[m] = atom[s], atom[k], (qa + qb) * by_v
            out_i[m + 1], out_j[m + 1], out_G[m + 1] = atom[t], atom[k], (qa + qb) * by_w
            for c in range(3):
                ak = sign * r[pk, c]
                out_r[m, c], out_r[m + 1, c] = ak, bk[c]
                if sources:
                    ga[c] = by_u * r[p, c] + by_v * ak
                    gb[c] = -by_u * r[p, c] + by_w * bk[c]
                    gk[c] = -by_v * ak - by_w * bk[c]
                    out_D[own_slot, 0, c] += qa * gb[c]
                    out_D[own_slot, 1, c] += qb * ga[c]
                    out_D[m, 0, c], out_D[m, 1, c] = qa * gk[c], 0.0
                    out_D[m + 1, 0, c], out_D[m + 1, 1, c] = qb * gk[c], 0.0
            m += 2
        out_i[own_slot], out_j[own_slot], out_G[own_slot] = atom[s], atom[t], g
        for c in range(3):
            out_r[own_slot, c] = r[p, c]
    return m, total, -1
