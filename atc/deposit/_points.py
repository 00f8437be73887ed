"""The two sums at scattered points: points are sorted into bins of the cell once; each starting atom collects the points in reach,
images included, and its bonds look only at those."""

from __future__ import annotations

from math import floor, isfinite, sqrt

import numba as nb
import numpy as np

from ._beta import even, even_constants
from ._simd import JIT_FMA, address, load4, maximum4, minimum4, peek, peek_int, poke, poke_int, store4

# Replaced in each specialised copy (see `_simd.specialise`).
BETA = even
CONSTANTS = even_constants


@nb.njit(**JIT_FMA)
def near(n, x_at, scale, E2, frame_at, near_at, room, lane_at, which_at, seen_at):
    """Which of n points lie inside the capsule: their coordinates in the bond's frame go to `lane_at`, their numbers to `seen_at`.

    Points are given by d (x, y, z at `x_at`, `room` apart) and their numbers at `which_at`. Returns how many were found.
    """
    for l in range(0, n, 4):
        x = load4(x_at, l) * scale
        y = load4(x_at, room + l) * scale
        z = load4(x_at, 2 * room + l) * scale
        D = x * peek(frame_at, 0) + y * peek(frame_at, 1) + z * peek(frame_at, 2)
        Y = x * peek(frame_at, 3) + y * peek(frame_at, 4) + z * peek(frame_at, 5)
        M = x * peek(frame_at, 6) + y * peek(frame_at, 7) + z * peek(frame_at, 8)
        beyond = D - minimum4(maximum4(D, 0.0), 1.0)
        store4(near_at, l, D)
        store4(near_at, room + l, Y)
        store4(near_at, 2 * room + l, M)
        store4(near_at, 3 * room + l, E2 - Y * Y - M * M - beyond * beyond)
    lanes = 0
    for l in range(n):
        # Written whether it counts or not: nothing to predict.
        poke(lane_at, lanes, peek(near_at, l))
        poke(lane_at, room + lanes, peek(near_at, room + l))
        poke(lane_at, 2 * room + lanes, peek(near_at, 2 * room + l))
        poke_int(seen_at, lanes, peek_int(which_at, l))
        lanes += peek(near_at, 3 * room + l) > 0.0
    return lanes


@nb.njit(**JIT_FMA)
def frame(r_bc, b, length, frame_bcc):
    """Rows n, u, v of any orthonormal frame with n along the bond; of length 0, along x."""
    nx, ny, nz = r_bc[b, 0] / length, r_bc[b, 1] / length, r_bc[b, 2] / length
    if nx == 0.0 and ny == 0.0 and nz == 0.0:
        nx = 1.0
    if abs(nx) < 0.6:
        vx, vy, vz = 0.0, nz, -ny
    else:
        vx, vy, vz = -nz, 0.0, nx
    t = 1.0 / sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * t, vy * t, vz * t
    at = address(frame_bcc)
    poke(at, 0, nx)
    poke(at, 1, ny)
    poke(at, 2, nz)
    poke(at, 3, vy * nz - vz * ny)
    poke(at, 4, vz * nx - vx * nz)
    poke(at, 5, vx * ny - vy * nx)
    poke(at, 6, vx)
    poke(at, 7, vy)
    poke(at, 8, vz)


def points_bonds(
    x_nc,
    i_b,
    r_bc,
    b_bk,
    radii_m,
    coef_mk,
    origin_c,  # the cell's
    point_gc,  # relative to the cell's origin, wrapped along periodic axes, sorted by bin
    start_w,  # first point of each bin, and one past the end
    bins_a,
    low_a,  # fractional coordinates of the bins' lower corner, and bins per unit
    scale_a,
    periodic_a,
    cell_ac,
    inverse_ca,
    acc_gk,
    buffer_13l,  # x, y, z of the points in reach of an atom and their numbers; their D, Y, M and depth; of those inside D, Y, M, numbers, β
    frame_bcc,  # buffer for one frame
    k_,  # buffer for the constants of β
):
    """Σ_b b β at every point, added to `acc_gk`. Returns the number of (bond, point) pairs visited, −1 if something is not finite."""
    room = buffer_13l.shape[1]
    x_at = address(buffer_13l)
    which_at = x_at + 24 * room
    near_at = x_at + 32 * room
    lane_at = x_at + 64 * room
    seen_at = x_at + 88 * room
    beta_at = x_at + 96 * room
    k_at = address(k_)
    # The last run of four may read and write three more than there are.
    room -= 4
    apart = room + 4
    n_comp = b_bk.shape[1]
    support = radii_m[0]
    height_a = np.empty(3)
    for a in range(3):
        height_a[a] = sqrt(inverse_ca[0, a] ** 2 + inverse_ca[1, a] ** 2 + inverse_ca[2, a] ** 2)
    lo_a = np.zeros(3, np.int64)
    hi_a = np.zeros(3, np.int64)
    visits = 0
    first = 0
    n_bonds = len(r_bc)
    while first < n_bonds:
        # All bonds in a row that start at the same place.
        x0, x1, x2 = x_nc[i_b[first], 0], x_nc[i_b[first], 1], x_nc[i_b[first], 2]
        if not isfinite(x0 + x1 + x2):
            return -1
        last = first
        longest = 0.0
        while last < n_bonds:
            o = i_b[last]
            if x_nc[o, 0] != x0 or x_nc[o, 1] != x1 or x_nc[o, 2] != x2:
                break
            length2 = r_bc[last, 0] ** 2 + r_bc[last, 1] ** 2 + r_bc[last, 2] ** 2
            if not isfinite(length2):
                return -1
            longest = max(longest, length2)
            last += 1
        x0, x1, x2 = x0 - origin_c[0], x1 - origin_c[1], x2 - origin_c[2]
        reach = (support + sqrt(longest)) * (1.0 + 1e-12)
        empty = False
        for a in range(3):
            s = (x0 * inverse_ca[0, a] + x1 * inverse_ca[1, a] + x2 * inverse_ca[2, a] - low_a[a]) * scale_a[a]
            pad = reach * height_a[a] * scale_a[a] + 1e-9
            lo_a[a] = floor(s - pad)
            hi_a[a] = floor(s + pad)
            if not periodic_a[a]:
                lo_a[a] = max(lo_a[a], 0)
                hi_a[a] = min(hi_a[a], bins_a[a] - 1)
            empty = empty or hi_a[a] < lo_a[a]
        span1 = hi_a[1] - lo_a[1] + 1
        span2 = hi_a[2] - lo_a[2] + 1
        total = 0 if empty else (hi_a[0] - lo_a[0] + 1) * span1 * span2
        w = 0
        g = 0
        g_end = 0
        p0 = p1 = p2 = 0.0
        while w < total or g < g_end:
            # Fill the buffer with points in reach ...
            n = 0
            while n < room:
                if g >= g_end:
                    if w >= total:
                        break
                    c0 = lo_a[0] + w // (span1 * span2)
                    c1 = lo_a[1] + w // span2 % span1
                    c2 = lo_a[2] + w % span2
                    w += 1
                    m0, m1, m2 = c0 // bins_a[0], c1 // bins_a[1], c2 // bins_a[2]
                    bin_ = ((c0 - m0 * bins_a[0]) * bins_a[1] + c1 - m1 * bins_a[1]) * bins_a[2] + c2 - m2 * bins_a[2]
                    g = start_w[bin_]
                    g_end = start_w[bin_ + 1]
                    if g < g_end:
                        p0 = x0 - (m0 * cell_ac[0, 0] + m1 * cell_ac[1, 0] + m2 * cell_ac[2, 0])
                        p1 = x1 - (m0 * cell_ac[0, 1] + m1 * cell_ac[1, 1] + m2 * cell_ac[2, 1])
                        p2 = x2 - (m0 * cell_ac[0, 2] + m1 * cell_ac[1, 2] + m2 * cell_ac[2, 2])
                    continue
                d0, d1, d2 = p0 - point_gc[g, 0], p1 - point_gc[g, 1], p2 - point_gc[g, 2]
                if d0 * d0 + d1 * d1 + d2 * d2 <= reach * reach:
                    poke(x_at, n, d0)
                    poke(x_at, apart + n, d1)
                    poke(x_at, 2 * apart + n, d2)
                    poke_int(which_at, n, g)
                    n += 1
                g += 1
            if n == 0:
                continue
            # ... and let each bond find its own among them.
            for b in range(first, last):
                length = max(sqrt(r_bc[b, 0] ** 2 + r_bc[b, 1] ** 2 + r_bc[b, 2] ** 2), 1e-30 * support)
                frame(r_bc, b, length, frame_bcc)
                for m in range(len(radii_m)):
                    R = radii_m[m]
                    lanes = near(n, x_at, 1.0 / length, (R / length) ** 2, address(frame_bcc), near_at, apart, lane_at, which_at, seen_at)
                    if lanes == 0:
                        continue
                    visits += lanes
                    CONSTANTS(length, R, coef_mk, m, r_bc, frame_bcc, b, k_)
                    for l in range(0, lanes, 4):
                        store4(beta_at, l, BETA(load4(lane_at, l), load4(lane_at, apart + l), load4(lane_at, 2 * apart + l), k_at))
                    for l in range(lanes):
                        t = peek(beta_at, l)
                        g_l = peek_int(seen_at, l)
                        for c in range(n_comp):
                            acc_gk[g_l, c] += t * b_bk[b, c]
        first = last
    return visits
