"""Loops of Stillinger-Weber over pairs, triplets and merged bonds; see `stillinger_weber` for the
formulas and the stages."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from .neighborhood import share_half

#: Angular functions of δ = cos θ − cos θ0: δ², [g_C(δ) δ]², δ²/(1 + C δ²); and (θ − θ0)².
SQUARE, SWITCHED, SATURATED, HARMONIC = 0, 1, 2, 3
ODD = {
    SWITCHED: "triplets in the switch of sw/mod, where LAMMPS's force is not the derivative of its energy",
    HARMONIC: "angles clamped near 0 or 180 degrees",
}


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _power(s, p):
    """s^p; the exponents everyone uses (4 and 0) without a logarithm."""
    if p == 4.0:
        s2 = s * s
        return s2 * s2
    if p == 0.0:
        return 1.0
    return s**p


@njit(cache=True, nogil=True, error_model="numpy")
def sw_pairs(a, b, r, d2, n, element, table, same_ends, atom, rec, G, energies):
    """Two-body energies and G, and the record (x, y, z, 1/d, h, −dlnh/dξ for triplets around a; the same two around b)
    of every pair within reach.

    Compacts a, b, rec, G to the pairs in reach. Returns their number, the energy, and the first pair that is not finite
    (−1: none).
    """
    m = 0
    total = 0.0
    for k in range(n):
        ia, ib = a[k], b[k]
        ea, eb = element[ia], element[ib]
        reach = table[ea, eb, 0]
        d = np.sqrt(d2[k])
        cut = table[ea, eb, 1]
        # Twice, as rounding may put the root on the cutoff where the square is below it.
        if d2[k] >= reach * reach or d >= cut:
            continue
        inv = 1.0 / d
        s = 1.0 / (d - cut)
        # exp underflows to 0 long before s² overflows: 0 at the cutoff from below too.
        e2 = np.exp(table[ea, eb, 2] * s)
        rp = table[ea, eb, 3] * _power(inv, table[ea, eb, 5])
        rq = table[ea, eb, 4] * _power(inv, table[ea, eb, 6])
        u = (rp - rq) * e2
        g = (-(table[ea, eb, 5] * rp - table[ea, eb, 6] * rq) * inv - (rp - rq) * table[ea, eb, 2] * s * s) * e2 * inv
        if not np.isfinite(g + u):
            return 0, 0.0, k
        total += u
        share_half(energies, atom[ia], atom[ib], u)
        gs = table[ea, eb, 7]
        h = np.exp(gs * s)
        w = gs * s * s * inv
        rec[m, 0], rec[m, 1], rec[m, 2], rec[m, 3] = r[k, 0], r[k, 1], r[k, 2], inv
        rec[m, 4], rec[m, 5] = h, w
        if not same_ends:
            gs = table[eb, ea, 7]
            h = np.exp(gs * s)
            w = gs * s * s * inv
        rec[m, 6], rec[m, 7] = h, w
        a[m], b[m] = ia, ib
        G[m] = g
        m += 1
    return m, total, -1


@njit(cache=True, nogil=True, error_model="numpy")
def sw_index(a, b, n):
    """Pairs that start at an atom (they are sorted by a) and those that end there: out_start (n+1,), in_start (n+1,),
    in_pair (pairs,)."""
    out_start = np.zeros(n + 1, np.int64)
    in_start = np.zeros(n + 2, np.int64)
    for p in range(len(a)):
        out_start[a[p] + 1] += 1
        in_start[b[p] + 2] += 1
    for s in range(n):
        out_start[s + 1] += out_start[s]
        in_start[s + 2] += in_start[s + 1]
    in_pair = np.empty(len(b), np.int32)
    for p in range(len(b)):
        in_pair[in_start[b[p] + 1]] = p
        in_start[b[p] + 1] += 1
    return out_start, in_start[: n + 1], in_pair


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _odd(kind, cos, row):
    """1 where the derivative of an angular function is not what it says: see the notes that count them."""
    if kind == HARMONIC:
        return 1 if 1.0 - cos * cos < 1e-6 else 0
    if kind == SWITCHED:
        return 1 if row[2] < abs(cos - row[1]) < row[3] else 0
    return 0


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _angular(kind, cos, row):
    """The angular function of a triplet and its derivative with respect to cos θ; row[1] is cos θ0 (HARMONIC: θ0)."""
    if kind == HARMONIC:
        cos = min(1.0, max(-1.0, cos))
        apart = np.arccos(cos) - row[1]
        # LAMMPS's guard: sin θ no smaller than 0.001.
        return apart * apart, -2.0 * apart / max(np.sqrt(1.0 - cos * cos), 1e-3)
    delta = cos - row[1]
    if kind == SATURATED:
        q = 1.0 / (1.0 + row[2] * delta * delta)
        return delta * delta * q, 2.0 * delta * q * q
    if kind == SWITCHED:
        size = abs(delta)
        if size >= row[3]:
            return 0.0, 0.0
        if size > row[2]:
            # LAMMPS's force has the derivative 2 g_C δ here, as if g_C were constant and once only; its runs went by
            # that.
            delta *= 0.5 + 0.5 * np.cos(np.pi * (size - row[2]) / (row[3] - row[2]))
    return delta * delta, 2.0 * delta


@njit(cache=True, nogil=True, error_model="numpy")
def sw_triplets(angular, s0, s1, most, lists, table, prune, w_centre, w_end, G_end, S_end, out, out_D, energies):
    """All triplets around the atoms s0..s1: G of the arms into G_end (pair, which end is the centre), outer distances
    to out = (i, j, r, G) and out_D.

    lists : `sw_index`'s, and what they are of: see `TripletWork`
    angular : which angular function A(cos θ), whose numbers are in table[centre, b, c, 1:], beside the strength in
        front; U = strength h_b h_c A. Returns the number of outer bonds, the energy, and how many triplets were odd
        (`_odd`).
    S_end and out_D are None where no sources are wanted: numba then leaves those branches out of the machine code. With
    U the energy of a triplet and w its atoms' shares, the source of the ordered pair p, q is ∂U^(p)/∂x_q = w_p ∂U/∂x_q.
    """
    out_start, in_start, in_pair, a, b, rec, element, atom = lists
    out_i, out_j, out_r, out_G = out
    who = np.empty(most, np.int32)
    pair = np.empty(most, np.int64)
    end = np.empty(most, np.int64)
    arm = np.empty((most, 6))  # x_a − x_b, 1/d, h, −dlnh/dξ
    G_arm = np.empty(most)
    if out_D is not None:
        S_arm = np.empty((most, 2, 3))
    m = 0
    odd = 0
    total = 0.0
    shared = len(energies) > 0
    for s in range(s0, s1):
        k = 0
        for p in range(out_start[s], out_start[s + 1]):
            who[k], pair[k], end[k] = b[p], p, 0
            for c in range(6):
                arm[k, c] = rec[p, c]
            k += 1
        for q in range(in_start[s], in_start[s + 1]):
            p = in_pair[q]
            who[k], pair[k], end[k] = a[p], p, 1
            arm[k, 0], arm[k, 1], arm[k, 2], arm[k, 3] = -rec[p, 0], -rec[p, 1], -rec[p, 2], rec[p, 3]
            arm[k, 4], arm[k, 5] = rec[p, 6], rec[p, 7]
            k += 1
        for e in range(k):
            G_arm[e] = 0.0
            if out_D is not None:
                S_arm[e] = 0.0
        es = element[s]
        for e in range(k - 1):
            xb, yb, zb, vb, hb, wb = arm[e, 0], arm[e, 1], arm[e, 2], arm[e, 3], arm[e, 4], arm[e, 5]
            ee = element[who[e]]
            ib = atom[who[e]]
            g_e = 0.0
            e_e = 0.0
            for f in range(e + 1, k):
                ef = element[who[f]]
                base = table[es, ee, ef, 0] * hb * arm[f, 4]
                if base == 0.0:
                    continue
                xc, yc, zc, vc = arm[f, 0], arm[f, 1], arm[f, 2], arm[f, 3]
                v = vb * vc
                cos = (xb * xc + yb * yc + zb * zc) * v
                value, slope = _angular(angular, cos, table[es, ee, ef])
                slope *= base
                odd += _odd(angular, cos, table[es, ee, ef])
                u = base * value
                g_b = slope * (v - cos * vb * vb) - u * wb
                g_c = slope * (v - cos * vc * vc) - u * arm[f, 5]
                g_e += g_b
                G_arm[f] += g_c
                g = -slope * v
                e_e += u
                if shared:
                    energies[atom[who[f]]] += w_end * u
                out_i[m], out_j[m] = ib, atom[who[f]]
                # x_b − x_c through the images that a sees.
                out_r[m, 0], out_r[m, 1], out_r[m, 2] = xc - xb, yc - yb, zc - zb
                out_G[m] = g
                if out_D is None:
                    m += 1 if abs(g) > prune else 0
                else:
                    moved = g != 0.0
                    for c in range(3):
                        outer = g * out_r[m, c]
                        at_b = outer - g_b * arm[e, c]
                        at_c = -outer - g_c * arm[f, c]
                        at_a = -at_b - at_c
                        S_arm[e, 0, c] += w_centre * at_b
                        S_arm[e, 1, c] += w_end * at_a
                        S_arm[f, 0, c] += w_centre * at_c
                        S_arm[f, 1, c] += w_end * at_a
                        out_D[m, 0, c] = w_end * at_c
                        out_D[m, 1, c] = w_end * at_b
                        moved = moved or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
                    m += 1 if moved else 0
            G_arm[e] += g_e
            total += e_e
            if shared:
                energies[ib] += w_end * e_e
                energies[atom[s]] += w_centre * e_e
        for e in range(k):
            G_end[pair[e], end[e]] = G_arm[e]
            if S_end is not None:
                for c in range(3):
                    S_end[pair[e], end[e], 0, c] = S_arm[e, 0, c]
                    S_end[pair[e], end[e], 1, c] = S_arm[e, 1, c]
    return m, total, odd


@njit(cache=True, nogil=True, error_model="numpy")
def sw_merge(p0, p1, a, b, rec, G, G_end, S_end, atom, out_i, out_j, out_r, out_G, out_D):
    """One bond a pair: the two-body part and what the triplets around both of its ends give."""
    m = 0
    for p in range(p0, p1):
        g = G[p] + G_end[p, 0] + G_end[p, 1]
        out_i[m], out_j[m] = atom[a[p]], atom[b[p]]
        out_r[m, 0], out_r[m, 1], out_r[m, 2] = rec[p, 0], rec[p, 1], rec[p, 2]
        out_G[m] = g
        if out_D is None:
            m += 1 if g != 0.0 else 0
        else:
            moved = g != 0.0
            for c in range(3):
                half = 0.5 * G[p] * rec[p, c]
                out_D[m, 0, c] = -half + S_end[p, 0, 0, c] + S_end[p, 1, 1, c]
                out_D[m, 1, c] = half + S_end[p, 0, 1, c] + S_end[p, 1, 0, c]
                moved = moved or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
            m += 1 if moved else 0
    return m
