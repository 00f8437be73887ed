"""Bare kernel of the weighted virials: arrays only."""

from math import floor, sqrt

import numpy as np

from ..compiled import njit

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


# Points collected for one bond before their weights are computed side by side.
ROOM = 1024


@njit(**_OPTIONS)
def _collect(first, last, p_cg, t0, t1, t2, x0, x1, x2, y0, y1, y2, far2, n, which, d_6k):
    """Append the points first .. last−1, moved by t, that are within reach of both x and y: their numbers, and x and y
    seen from them. Returns how many there are."""
    x0 -= t0
    x1 -= t1
    x2 -= t2
    y0 -= t0
    y1 -= t1
    y2 -= t2
    for g in range(first, last):
        a0 = x0 - p_cg[0, g]
        a1 = x1 - p_cg[1, g]
        a2 = x2 - p_cg[2, g]
        b0 = y0 - p_cg[0, g]
        b1 = y1 - p_cg[1, g]
        b2 = y2 - p_cg[2, g]
        # Written whether it counts or not: nothing to predict.
        which[n] = g
        d_6k[0, n] = a0
        d_6k[1, n] = a1
        d_6k[2, n] = a2
        d_6k[3, n] = b0
        d_6k[4, n] = b1
        d_6k[5, n] = b2
        n += (a0 * a0 + a1 * a1 + a2 * a2 <= far2) & (b0 * b0 + b1 * b1 + b2 * b2 <= far2)
    return n


@njit(**_OPTIONS)
def _weights(n, half, near2, a0, a1, a2, b0, b1, b2):
    """½ |r| (ê_i − ê_j) at n points, over a; the unit vector to an end that is the point is 0."""
    for k in range(n):
        a = a0[k] * a0[k] + a1[k] * a1[k] + a2[k] * a2[k]
        b = b0[k] * b0[k] + b1[k] * b1[k] + b2[k] * b2[k]
        a = half / sqrt(a) if a > near2 else 0.0
        b = half / sqrt(b) if b > near2 else 0.0
        a0[k] = a * a0[k] - b * b0[k]
        a1[k] = a * a1[k] - b * b1[k]
        a2[k] = a * a2[k] - b * b2[k]


@njit(**_OPTIONS)
def _add(n, which, w_6k, f0, f1, f2, scale_m, acc_gk):
    for m in range(len(scale_m)):
        g0 = scale_m[m] * f0
        g1 = scale_m[m] * f1
        g2 = scale_m[m] * f2
        for k in range(n):
            acc = acc_gk[which[k], m]
            w = w_6k[0, k]
            acc[0] += w * g0
            acc[1] += w * g1
            acc[2] += w * g2
            w = w_6k[1, k]
            acc[3] += w * g0
            acc[4] += w * g1
            acc[5] += w * g2
            w = w_6k[2, k]
            acc[6] += w * g0
            acc[7] += w * g1
            acc[8] += w * g2


@njit(**_OPTIONS)
def _range(a, x, y, reach, middle, inverse_ca, low_a, scale_a, bins_a, periodic):
    """The bins along axis a that can hold points within `reach` of both x and y (given along the axis), hence within
    `middle` of their middle."""
    height = sqrt(inverse_ca[0, a] ** 2 + inverse_ca[1, a] ** 2 + inverse_ca[2, a] ** 2)
    r = reach * height
    h = middle * height
    c = 0.5 * (x + y)
    lo = max(max(x, y) - r, c - h)
    hi = min(min(x, y) + r, c + h)
    lo = floor((lo - low_a[a]) * scale_a[a] - 1e-9)
    hi = floor((hi - low_a[a]) * scale_a[a] + 1e-9)
    if not periodic:
        if lo < 0:
            lo = 0
        if hi > bins_a[a] - 1:
            hi = bins_a[a] - 1
    return int(lo), int(hi)


@njit(**_OPTIONS)
def add(
    x_bc,
    r_bc,
    F_bc,
    d_b,
    scale_bm,
    far,
    near,
    p_cg,
    start_w,
    bins_a,
    low_a,
    scale_a,
    periodic_a,
    cell_ac,
    inverse_ca,
    acc_gk,
):
    """Σ_b −½ |r| (ê_i − ê_j)⊗F · scale at every point within `far` of both ends, images included, into acc (point,
    column of scale, 9 row-major). `p_cg`: the points sorted by bin."""
    far2 = far * far
    near2 = near * near
    which = np.empty(ROOM, np.int64)
    d_6k = np.empty((6, ROOM))
    n0, n1, n2 = bins_a[0], bins_a[1], bins_a[2]
    for b in range(len(d_b)):
        d = d_b[b]
        if not d < 2.0 * far or d == 0.0:
            continue
        x0, x1, x2 = x_bc[b, 0], x_bc[b, 1], x_bc[b, 2]
        y0, y1, y2 = x0 - r_bc[b, 0], x1 - r_bc[b, 1], x2 - r_bc[b, 2]
        middle = sqrt(far2 - 0.25 * d * d)
        s0 = x0 * inverse_ca[0, 0] + x1 * inverse_ca[1, 0] + x2 * inverse_ca[2, 0]
        s1 = x0 * inverse_ca[0, 1] + x1 * inverse_ca[1, 1] + x2 * inverse_ca[2, 1]
        s2 = x0 * inverse_ca[0, 2] + x1 * inverse_ca[1, 2] + x2 * inverse_ca[2, 2]
        e0 = y0 * inverse_ca[0, 0] + y1 * inverse_ca[1, 0] + y2 * inverse_ca[2, 0]
        e1 = y0 * inverse_ca[0, 1] + y1 * inverse_ca[1, 1] + y2 * inverse_ca[2, 1]
        e2 = y0 * inverse_ca[0, 2] + y1 * inverse_ca[1, 2] + y2 * inverse_ca[2, 2]
        lo0, hi0 = _range(0, s0, e0, far, middle, inverse_ca, low_a, scale_a, bins_a, periodic_a[0])
        lo1, hi1 = _range(1, s1, e1, far, middle, inverse_ca, low_a, scale_a, bins_a, periodic_a[1])
        lo2, hi2 = _range(2, s2, e2, far, middle, inverse_ca, low_a, scale_a, bins_a, periodic_a[2])
        found = 0
        for c0 in range(lo0, hi0 + 1):
            m0 = floor(c0 / n0)
            w0 = c0 - int(m0) * n0
            for c1 in range(lo1, hi1 + 1):
                m1 = floor(c1 / n1)
                w1 = c1 - int(m1) * n1
                row = (w0 * n1 + w1) * n2
                c2 = lo2
                while c2 <= hi2:
                    # The bins of one image of the cell at a time: their points lie side by side.
                    m2 = floor(c2 / n2)
                    w2 = c2 - int(m2) * n2
                    count = min(n2 - w2, hi2 - c2 + 1)
                    first = start_w[row + w2]
                    last = start_w[row + w2 + count]
                    t0 = m0 * cell_ac[0, 0] + m1 * cell_ac[1, 0] + m2 * cell_ac[2, 0]
                    t1 = m0 * cell_ac[0, 1] + m1 * cell_ac[1, 1] + m2 * cell_ac[2, 1]
                    t2 = m0 * cell_ac[0, 2] + m1 * cell_ac[1, 2] + m2 * cell_ac[2, 2]
                    while first < last:
                        # One more than there is room for may be written.
                        part = min(last, first + ROOM - 1 - found)
                        found = _collect(
                            first, part, p_cg, t0, t1, t2, x0, x1, x2, y0, y1, y2, far2, found, which, d_6k
                        )
                        first = part
                        if found >= ROOM - 1:
                            _weights(found, 0.5 * d, near2, d_6k[0], d_6k[1], d_6k[2], d_6k[3], d_6k[4], d_6k[5])
                            _add(found, which, d_6k, -F_bc[b, 0], -F_bc[b, 1], -F_bc[b, 2], scale_bm[b], acc_gk)
                            found = 0
                    c2 += count
        _weights(found, 0.5 * d, near2, d_6k[0], d_6k[1], d_6k[2], d_6k[3], d_6k[4], d_6k[5])
        _add(found, which, d_6k, -F_bc[b, 0], -F_bc[b, 1], -F_bc[b, 2], scale_bm[b], acc_gk)
