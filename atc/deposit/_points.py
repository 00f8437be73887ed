"""The two sums at scattered points: points are sorted into bins of the cell once; each starting atom collects the points in reach,
images included, and its bonds look only at those."""

from __future__ import annotations

from math import floor, isfinite, sqrt

import numba as nb
import numpy as np

from ._beta import N_CONSTANTS, even, even_constants
from ._simd import JIT_FMA, address, load4, store4

# Replaced in each specialised copy (see `_simd.specialise`).
BETA = even
CONSTANTS = even_constants


@nb.njit(**JIT_FMA)
def near(n, X, Y, Z, nx, ny, nz, ux, uy, uz, vx, vy, vz, E2, D_l, Y_l, M_l, d2_l):
    """Coordinates of n points in the bond's frame, and how far inside the capsule they are (≤ 0: outside)."""
    for l in range(n):
        D = X[l] * nx + Y[l] * ny + Z[l] * nz
        a = X[l] * ux + Y[l] * uy + Z[l] * uz
        c = X[l] * vx + Y[l] * vy + Z[l] * vz
        t = D if D > 0.0 else 0.0
        t = t if t < 1.0 else 1.0
        D_l[l] = D
        Y_l[l] = a
        M_l[l] = c
        d2_l[l] = E2 - a * a - c * c - (D - t) * (D - t)


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
    near_5l,  # buffers: X, Y, Z of the points in reach of an atom; their bond coordinates D, Y, M and depth
    lane_4l,  # buffers: D, Y, M, β of the points a bond sees
    index_2l,  # buffers: which point
):
    """Σ_b b β at every point, added to `acc_gk`. Returns the number of (bond, point) pairs visited, −1 if something is not finite."""
    X, Yp, Z, Dn, Yn, Mn, depth = near_5l[0], near_5l[1], near_5l[2], near_5l[3], near_5l[4], near_5l[5], near_5l[6]
    D, Y, M, beta = lane_4l[0], lane_4l[1], lane_4l[2], lane_4l[3]
    which, seen = index_2l[0], index_2l[1]
    room = near_5l.shape[1]
    n_comp = b_bk.shape[1]
    support = radii_m[0]
    height_a = np.empty(3)
    for a in range(3):
        height_a[a] = sqrt(inverse_ca[0, a] ** 2 + inverse_ca[1, a] ** 2 + inverse_ca[2, a] ** 2)
    lo_a = np.zeros(3, np.int64)
    hi_a = np.zeros(3, np.int64)
    visits = 0
    frame_cc = np.empty((3, 3))
    k_ = np.zeros(N_CONSTANTS)
    D_at, Y_at, M_at, beta_at, k_at = address(D), address(Y), address(M), address(beta), address(k_)
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
                    X[n] = d0
                    Yp[n] = d1
                    Z[n] = d2
                    which[n] = g
                    n += 1
                g += 1
            if n == 0:
                continue
            # ... and let each bond find its own among them.
            for b in range(first, last):
                r0, r1, r2 = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
                true_length = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
                for m in range(len(radii_m)):
                    R = radii_m[m]
                    length = true_length
                    if length < 1e-30 * R:
                        length = 1e-30 * R
                        nx, ny, nz = 1.0, 0.0, 0.0
                    else:
                        nx, ny, nz = r0 / length, r1 / length, r2 / length
                    # Any orthonormal frame (n, u, v).
                    if abs(nx) < 0.6:
                        vx, vy, vz = 0.0, nz, -ny
                    else:
                        vx, vy, vz = -nz, 0.0, nx
                    t = 1.0 / sqrt(vx * vx + vy * vy + vz * vz)
                    vx, vy, vz = vx * t, vy * t, vz * t
                    ux, uy, uz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
                    frame_cc[0, 0], frame_cc[0, 1], frame_cc[0, 2] = nx, ny, nz
                    frame_cc[1, 0], frame_cc[1, 1], frame_cc[1, 2] = ux, uy, uz
                    frame_cc[2, 0], frame_cc[2, 1], frame_cc[2, 2] = vx, vy, vz
                    CONSTANTS(length, R, coef_mk, m, r0, r1, r2, frame_cc, k_)
                    t = 1.0 / length
                    E2 = (R * t) * (R * t)
                    near(n, X, Yp, Z, nx * t, ny * t, nz * t, ux * t, uy * t, uz * t, vx * t, vy * t, vz * t, E2, Dn, Yn, Mn, depth)
                    lanes = 0
                    for l in range(n):
                        if depth[l] > 0.0:
                            D[lanes] = Dn[l]
                            Y[lanes] = Yn[l]
                            M[lanes] = Mn[l]
                            seen[lanes] = which[l]
                            lanes += 1
                    visits += lanes
                    for l in range(0, lanes, 4):
                        store4(beta_at, l, BETA(load4(D_at, l), load4(Y_at, l), load4(M_at, l), k_at))
                    for l in range(lanes):
                        t = beta[l]
                        to = seen[l]
                        for c in range(n_comp):
                            acc_gk[to, c] += t * b_bk[b, c]
        first = last
    return visits
