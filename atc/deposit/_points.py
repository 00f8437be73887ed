"""The two sums at scattered points, in two steps: which points are near which bonds, and the sum of b β over those
pairs.

Points are sorted into bins of the cell once; each starting atom collects those in reach, images included, and its bonds
look only at these. Where a bond has a point or two near it, as in the check of errors, anything done once a bond is
paid in full by every pair: so nothing is. A pair has all that β needs (`kernels.Compiled.pairs`), and β is evaluated
for four pairs at once, of whatever bonds.
"""

from __future__ import annotations

from math import floor, isfinite, sqrt

import numpy as np

from ..compiled import njit
from ..simd import (
    ENTRY,
    JIT_FMA,
    address,
    axpy4,
    greater,
    largest4,
    lesser,
    load4,
    load_rows4,
    maximum4,
    minimum4,
    peek,
    peek_int,
    poke,
    poke_int,
    prefetch,
    splat4,
    store4,
    sum4,
    where_positive4,
)

# Replaced in each specialised copy (see `compiled.specialise`).
BETA = None
# A bond shorter than this times the support has the direction of x.
SHORTEST = 1e-30
# Fewer points than that in reach of an atom: its bonds are looked at four at a time.
_FEW = 8
_AHEAD = 100


@njit(**JIT_FMA)
def near(r0, r1, r2, m, support, cartesian, bond, x_at, apart, n, pair_at, bond_at, point_at, most):
    """Append the pairs of one bond with those of `m` points that lie inside its capsule; returns how many there are
    then.

    Points are given by d = x_i − x (three rows of `apart` numbers at `x_at`), and by their numbers in the fourth; the
    four rows after that are for what is computed here. A pair has three numbers, `most` apart: D, p² and |r|², see
    `kernels.Compiled`, or d if `cartesian`.
    """
    length2 = r0 * r0 + r1 * r1 + r2 * r2
    least = SHORTEST * support
    if length2 < least * least:
        r0, r1, r2, length2 = least, 0.0, 0.0, least * least
    inverse = 1.0 / length2
    u0, u1, u2 = r0 * inverse, r1 * inverse, r2 * inverse
    limit = support * support * inverse
    for l in range(0, m, 4):
        x, y, z = load4(x_at, l), load4(x_at, apart + l), load4(x_at, 2 * apart + l)
        D = x * u0 + y * u1 + z * u2
        c0, c1, c2 = y * u2 - z * u1, z * u0 - x * u2, x * u1 - y * u0
        p2 = c0 * c0 + c1 * c1 + c2 * c2
        beyond = D - minimum4(maximum4(D, 0.0), 1.0)
        store4(x_at, 4 * apart + l, D)
        store4(x_at, 5 * apart + l, p2)
        store4(x_at, 7 * apart + l, limit - p2 - beyond * beyond)
    from_at = x_at if cartesian else x_at + 32 * apart
    begin = n
    for l in range(m):
        # Written whether it counts or not: nothing to predict.
        poke(pair_at, n, peek(from_at, l))
        poke(pair_at, most + n, peek(from_at, apart + l))
        if cartesian:
            poke(pair_at, 2 * most + n, peek(from_at, 2 * apart + l))
        poke_int(point_at, n, peek_int(x_at, 3 * apart + l))
        n += peek(x_at, 7 * apart + l) > 0.0
    for l in range(begin, n):
        poke_int(bond_at, l, bond)
    if not cartesian:
        for l in range(begin, n, 4):
            store4(pair_at, 2 * most + l, splat4(length2))
    return n


@njit(**JIT_FMA)
def near_few(r_at, first, last, end, m, support, cartesian, x_at, apart, n, pair_at, bond_at, point_at, most):
    """The same for the bonds `first` to `last` (there are `end` of them) and a few points: four bonds at a time."""
    least = SHORTEST * support
    at = x_at + 32 * apart
    # Four rows in a row, also where there are no more bonds.
    rows_at = at + 8 * 16
    for b in range(first, last, 4):
        from_at, row = r_at, 3 * b
        if b + 4 > end:
            from_at, row = rows_at, 0
            for l in range(12):
                poke(rows_at, l, peek(r_at, 3 * b + l) if b + l // 3 < end else 0.0)
        r0, r1, r2 = load_rows4(from_at, row)
        length2 = r0 * r0 + r1 * r1 + r2 * r2
        far = length2 - least * least
        r0, r1, r2 = where_positive4(far, r0, least), where_positive4(far, r1, 0.0), where_positive4(far, r2, 0.0)
        length2 = maximum4(length2, least * least)
        inverse = 1.0 / length2
        u0, u1, u2 = r0 * inverse, r1 * inverse, r2 * inverse
        limit = (support * support) * inverse
        store4(at, 8, length2)
        for l in range(m):
            x, y, z = peek(x_at, l), peek(x_at, apart + l), peek(x_at, 2 * apart + l)
            D = x * u0 + y * u1 + z * u2
            c0, c1, c2 = y * u2 - z * u1, z * u0 - x * u2, x * u1 - y * u0
            p2 = c0 * c0 + c1 * c1 + c2 * c2
            beyond = D - minimum4(maximum4(D, 0.0), 1.0)
            depth = limit - p2 - beyond * beyond
            if not largest4(depth) > 0.0:
                continue
            store4(at, 0, D)
            store4(at, 4, p2)
            store4(at, 12, depth)
            which = peek_int(x_at, 3 * apart + l)
            for q in range(lesser(4, last - b)):
                poke(pair_at, n, x if cartesian else peek(at, q))
                poke(pair_at, most + n, y if cartesian else peek(at, 4 + q))
                poke(pair_at, 2 * most + n, z if cartesian else peek(at, 8 + q))
                poke_int(bond_at, n, b + q)
                poke_int(point_at, n, which)
                n += peek(at, 12 + q) > 0.0
    return n


@njit(**JIT_FMA)
def _same(x_at, x0, x1, x2):
    return peek(x_at, 0) == x0 and peek(x_at, 1) == x1 and peek(x_at, 2) == x2


@njit(**JIT_FMA)
def _bin(s, n, periodic):
    """The bin that s lies in, −1 if none."""
    k = floor(s)
    if 0 <= k < n:
        return k
    return k % n if periodic else -1


@njit(**JIT_FMA)
def reached(s, pad, n, periodic):
    """The first and the last bin in reach."""
    lo, hi = floor(s - pad), floor(s + pad)
    if periodic:
        return lo, hi
    return greater(lo, 0), lesser(hi, n - 1)


@njit(**ENTRY)
def find_pairs(
    state,  # where to go on: the first bond in a row with its start, the bin, the bond; all 0 at first
    x_nc,
    i_b,
    r_bc,
    support,
    cartesian,
    cell,  # its origin, vectors, their inverse, one over its heights, periodic axes: tuples
    point_gc,  # relative to the cell's origin, wrapped along periodic axes, sorted by bin
    start_w,  # first point of each bin, and one past the end
    bins,  # how many, the fractional coordinates of their lower corner, how many per unit: tuples
    marked,  # other bins: whether a bond that starts there, not longer than `length`, may reach a point
    mark_bins,  # the lower corner, how many per unit
    length,  # negative: there are none
    buffer_8l,  # room for the points in reach of an atom, more than in any bin
    pair_3l,
    bond_l,
    point_l,
):
    """(bond, point) pairs within reach of each other. Returns how many were found before the room was full (`state[0]`
    is the number of bonds when all are done), −1 if something is not finite."""
    apart, most = buffer_8l.shape[1], pair_3l.shape[1]
    # The last run of four may read and write three more than there are.
    room, full = apart - 4, most - 4
    x_at, pair_at = address(buffer_8l), address(pair_3l)
    bond_at, point_at, r_at = address(bond_l), address(point_l), address(r_bc)
    x_all_at, g_at = address(x_nc), address(point_gc)
    origin, ((v00, v01, v02), (v10, v11, v12), (v20, v21, v22)), inverse, per_height, periodic = cell
    (i00, i01, i02), (i10, i11, i12), (i20, i21, i22) = inverse
    (b0, b1, b2), low, scale = bins
    mark_low, mark_scale = mark_bins
    n = np.int64(0)  # not the literal, for which what it is handed to would be compiled once more
    n_bonds = len(r_bc)
    first, w, b = state[0], state[1], state[2]
    while first < n_bonds:
        # Atoms are anywhere in memory.
        prefetch(x_all_at, 3 * i_b[lesser(first + _AHEAD, n_bonds - 1)])
        # All bonds in a row that start at the same place.
        o = i_b[first]
        x0, x1, x2 = peek(x_all_at, 3 * o), peek(x_all_at, 3 * o + 1), peek(x_all_at, 3 * o + 2)
        last = first + 1
        while last < n_bonds:
            a = i_b[last]
            if a != o and not _same(x_all_at + 24 * a, x0, x1, x2):
                break
            last += 1
        longest4, total4 = splat4(0.0), splat4(0.0)
        k = first
        while k + 4 <= last:
            a0, a1, a2 = load_rows4(r_at, 3 * k)
            many = a0 * a0 + a1 * a1 + a2 * a2
            total4 = total4 + many
            longest4 = maximum4(many, longest4)
            k += 4
        longest, total = largest4(longest4), sum4(total4)
        while k < last:
            r0, r1, r2 = peek(r_at, 3 * k), peek(r_at, 3 * k + 1), peek(r_at, 3 * k + 2)
            length2 = r0 * r0 + r1 * r1 + r2 * r2
            total += length2
            longest = length2 if length2 > longest else longest
            k += 1
        if not isfinite(x0 + x1 + x2 + total):
            return -1
        x0, x1, x2 = x0 - origin[0], x1 - origin[1], x2 - origin[2]
        s0 = x0 * i00 + x1 * i10 + x2 * i20
        s1 = x0 * i01 + x1 * i11 + x2 * i21
        s2 = x0 * i02 + x1 * i12 + x2 * i22
        if longest <= length * abs(length):
            k0 = _bin((s0 - mark_low[0]) * mark_scale[0], marked.shape[0], periodic[0])
            k1 = _bin((s1 - mark_low[1]) * mark_scale[1], marked.shape[1], periodic[1])
            k2 = _bin((s2 - mark_low[2]) * mark_scale[2], marked.shape[2], periodic[2])
            if k0 < 0 or k1 < 0 or k2 < 0 or not marked[k0, k1, k2]:
                first, w, b = last, 0, last
                continue
        reach = (support + sqrt(longest)) * (1.0 + 1e-12)
        lo0, hi0 = reached((s0 - low[0]) * scale[0], reach * per_height[0] * scale[0] + 1e-9, b0, periodic[0])
        lo1, hi1 = reached((s1 - low[1]) * scale[1], reach * per_height[1] * scale[1] + 1e-9, b1, periodic[1])
        lo2, hi2 = reached((s2 - low[2]) * scale[2], reach * per_height[2] * scale[2] + 1e-9, b2, periodic[2])
        span0, span1, span2 = greater(hi0 - lo0 + 1, 0), greater(hi1 - lo1 + 1, 0), greater(hi2 - lo2 + 1, 0)
        end = span0 * span1 * span2
        while w < end:
            # Points in reach, of as many bins as there is room for ...
            begin = w
            m = 0
            c0, c1, c2 = lo0 + w // (span1 * span2), lo1 + w // span2 % span1, lo2 + w % span2
            m0, m1, m2 = c0 // b0, c1 // b1, c2 // b2
            while w < end:
                bin_ = ((c0 - m0 * b0) * b1 + c1 - m1 * b1) * b2 + c2 - m2 * b2
                g, g_end = start_w[bin_], start_w[bin_ + 1]
                if m + g_end - g > room:
                    break
                if g < g_end:
                    p0 = x0 - (m0 * v00 + m1 * v10 + m2 * v20)
                    p1 = x1 - (m0 * v01 + m1 * v11 + m2 * v21)
                    p2 = x2 - (m0 * v02 + m1 * v12 + m2 * v22)
                    while g < g_end:
                        d0, d1, d2 = p0 - peek(g_at, 3 * g), p1 - peek(g_at, 3 * g + 1), p2 - peek(g_at, 3 * g + 2)
                        poke(x_at, m, d0)
                        poke(x_at, apart + m, d1)
                        poke(x_at, 2 * apart + m, d2)
                        poke_int(x_at, 3 * apart + m, g)
                        m += d0 * d0 + d1 * d1 + d2 * d2 <= reach * reach
                        g += 1
                w += 1
                c2 += 1
                m2 += c2 - m2 * b2 == b2
                if c2 > hi2:
                    c2 = lo2
                    m2 = c2 // b2
                    c1 += 1
                    m1 += c1 - m1 * b1 == b1
                    if c1 > hi1:
                        c1 = lo1
                        m1 = c1 // b1
                        c0 += 1
                        m0 += c0 - m0 * b0 == b0
            # ... and each bond finds its own among them.
            b = greater(b, first)
            if m > 0:
                few = 0 < m < _FEW and last - b > 1 and m * (last - b) <= full
                if few and n + m * (last - b) <= full:
                    n = near_few(
                        r_at, b, last, n_bonds, m, support, cartesian, x_at, apart, n, pair_at, bond_at, point_at, most
                    )
                    b = last
                while b < last:
                    if few or n + m > full:
                        state[0], state[1], state[2] = first, begin, b
                        return n
                    n = near(
                        peek(r_at, 3 * b),
                        peek(r_at, 3 * b + 1),
                        peek(r_at, 3 * b + 2),
                        m,
                        support,
                        cartesian,
                        b,
                        x_at,
                        apart,
                        n,
                        pair_at,
                        bond_at,
                        point_at,
                        most,
                    )
                    b += 1
            b = first
        first, w, b = last, 0, last
    state[0] = n_bonds
    return n


@njit(**ENTRY)
def renumber(n, bond_l, which):
    """The bonds of the first n pairs, each once, in their order, in `which`; in `bond_l` their numbers among these take
    their place. How many there are. Compiled: as numpy it cost a small frame a twentieth."""
    count, before = 0, -1
    for l in range(n):
        if bond_l[l] != before:
            before = bond_l[l]
            which[count] = before
            count += 1
        bond_l[l] = count - 1
    return count


def sum_pairs(
    n,
    pair_3l,
    bond_l,
    point_l,
    r_bc,  # only looked at for kernels that are not spheres
    b_bk,  # k a multiple of four
    radii_m,
    coef_mk,
    series,  # see `kernels.Compiled`
    acc_gk,
    k_,
):
    """Σ b β over the pairs of each point, added to `acc_gk`."""
    most = pair_3l.shape[1]
    pair_at, bond_at, point_at = address(pair_3l), address(bond_l), address(point_l)
    coef_at, series_at, k_at = address(coef_mk), address(series), address(k_)
    acc_at, b_at, r_at = address(acc_gk), address(b_bk), address(r_bc)
    n_comp = b_bk.shape[1]
    for m in range(len(radii_m)):
        R2 = radii_m[m] * radii_m[m]
        if m > 0:
            # Only those within reach of this piece.
            k = 0
            for l in range(n):
                D, p2, length2 = peek(pair_at, l), peek(pair_at, most + l), peek(pair_at, 2 * most + l)
                beyond = D - lesser(greater(D, 0.0), 1.0)
                poke(pair_at, k, D)
                poke(pair_at, most + k, p2)
                poke(pair_at, 2 * most + k, length2)
                poke_int(bond_at, k, peek_int(bond_at, l))
                poke_int(point_at, k, peek_int(point_at, l))
                k += (p2 + beyond * beyond) * length2 < R2
            n = k
        if n == 0:
            return
        for l in range(n, n + 3):
            poke(pair_at, l, peek(pair_at, n - 1))
            poke(pair_at, most + l, peek(pair_at, most + n - 1))
            poke(pair_at, 2 * most + l, peek(pair_at, 2 * most + n - 1))
            poke_int(bond_at, l, peek_int(bond_at, n - 1))
        row_at = coef_at + 8 * m * coef_mk.shape[1]
        for l in range(0, n, 4):
            x, y, z = load4(pair_at, l), load4(pair_at, most + l), load4(pair_at, 2 * most + l)
            store4(k_at, 0, BETA(x, y, z, R2, row_at, series_at, bond_at + 8 * l, r_at, k_at))
            for q in range(lesser(4, n - l)):
                t, b, g = peek(k_at, q), n_comp * peek_int(bond_at, l + q), n_comp * peek_int(point_at, l + q)
                for c in range(0, n_comp, 4):
                    axpy4(acc_at, g + c, t, load4(b_at, b + c))


@njit(**ENTRY)
def mark(p_ga, pad, limit2, edges, periodic, marked):
    """Mark the bins whose centre is near a point; p_ga in bins."""
    n0, n1, n2 = marked.shape
    for g in range(len(p_ga)):
        p0, p1, p2 = p_ga[g, 0], p_ga[g, 1], p_ga[g, 2]
        for c0 in range(floor(p0 - pad[0]), floor(p0 + pad[0]) + 1):
            if not periodic[0] and not 0 <= c0 < n0:
                continue
            for c1 in range(floor(p1 - pad[1]), floor(p1 + pad[1]) + 1):
                if not periodic[1] and not 0 <= c1 < n1:
                    continue
                for c2 in range(floor(p2 - pad[2]), floor(p2 + pad[2]) + 1):
                    if not periodic[2] and not 0 <= c2 < n2:
                        continue
                    d2 = 0.0
                    for c in range(3):
                        d = (
                            (c0 + 0.5 - p0) * edges[0, c]
                            + (c1 + 0.5 - p1) * edges[1, c]
                            + (c2 + 0.5 - p2) * edges[2, c]
                        )
                        d2 += d * d
                    if d2 <= limit2:
                        marked[c0 % n0, c1 % n1, c2 % n2] = True
