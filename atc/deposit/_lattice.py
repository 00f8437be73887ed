"""The two sums on a lattice of points: rows of equally spaced points, each cut to its chord through the bond's capsule.

A point sees a bond when it lies within the support R of it, in a capsule. For every row of the lattice that the capsule meets, the first
and last point inside follow from the union of two spheres and a cylinder; β is evaluated for four points in a row at a time and added.

The accumulator is [row][component][position in row], rows over the two slower axes. Positions run on past the row's end (`ext` ≥ n + 3 of
them), so that a run never has to be split at the periodic boundary; what lies beyond is folded back, or on an open axis dropped, at the end.
A site is a bond of length 0.
"""

from __future__ import annotations

from math import ceil, floor, isfinite, sqrt

import numba as nb
import numpy as np

from ._beta import N_CONSTANTS, even, even_constants
from ._simd import INLINE, JIT_FMA, axpy4, ramp4, splat4

# Replaced in each specialised copy (see `_simd.specialise`).
BETA = even
CONSTANTS = even_constants


@nb.njit(**INLINE)
def folded(i, n):
    """i modulo n; a division is slow and rarely needed."""
    if 0 <= i < n:
        return i
    i += n if i < 0 else -n
    return i if 0 <= i < n else i % n


@nb.njit(**JIT_FMA)
def chords(n, D_j, Y_j, M_j, E2, D2, Y2, k_lo, k_hi, base2, n2, wrap2, first_j, count_j, at_j, keep_j):
    """First point and number of points of each row inside the capsule, and where in the row of the accumulator that is.

    `keep_j` gets the rows that have any. Returns how many those are, and the number of points.

    A row is (D + k D2, Y + k Y2, M) in units of the bond's length, the bond from (0, 0, 0) to (1, 0, 0), E2 the radius squared.
    The capsule is the union of a cylinder and two spheres and convex: the chord runs from the least to the greatest of their ends.
    """
    row = sqrt(D2 * D2 + Y2 * Y2)
    inverse_row = 1.0 / row
    inverse_row2 = inverse_row * inverse_row
    # A row parallel or normal to the bond never leaves one of the two slabs: divide by something tiny instead of 0.
    tiny = 1e-15 * row
    inverse_D = 1.0 / (D2 if abs(D2) > tiny else tiny)
    inverse_Y = 1.0 / (Y2 if abs(Y2) > tiny else tiny)
    half_Y = abs(inverse_Y)
    # An open row is a periodic one that is never left.
    period = float(n2) if wrap2 else 1e18
    inverse_period = 1.0 / period
    for j in range(n):
        D = D_j[j]
        Y = Y_j[j]
        W = E2 - M_j[j] * M_j[j]
        # Cylinder, between the two end planes.
        half = sqrt(W if W > 0.0 else 0.0) * half_Y
        centre = -Y * inverse_Y
        p = -D * inverse_D
        q = p + inverse_D
        near = p if p < q else q
        far = q if p < q else p
        lo = centre - half
        hi = centre + half
        lo = lo if lo > near else near
        hi = hi if hi < far else far
        met = hi >= lo
        lo = lo if met else 1e300
        hi = hi if met else -1e300
        # Sphere about x_i, sphere about x_j.
        across = (D * Y2 - Y * D2) * inverse_row
        chord = W - across * across
        met = chord >= 0.0
        half = sqrt(chord if met else 0.0) * inverse_row
        centre = -(D * D2 + Y * Y2) * inverse_row2
        p = centre - half if met else 1e300
        q = centre + half if met else -1e300
        lo = lo if lo < p else p
        hi = hi if hi > q else q
        across -= Y2 * inverse_row
        chord = W - across * across
        met = chord >= 0.0
        half = sqrt(chord if met else 0.0) * inverse_row
        centre += D2 * inverse_row2
        p = centre - half if met else 1e300
        q = centre + half if met else -1e300
        lo = lo if lo < p else p
        hi = hi if hi > q else q
        # Rounding must not lose a point at the rim; one too many has β = 0.
        lo -= 1e-9
        hi += 1e-9
        lo = lo if lo > k_lo else k_lo
        hi = hi if hi < k_hi else k_hi
        met = (W >= 0.0) & (hi >= lo)
        lo = np.ceil(lo if met else 0.0)
        hi = np.floor(hi if met else -1.0)
        first_j[j] = lo
        count_j[j] = hi - lo + 1.0
        lo += base2
        at_j[j] = lo - period * np.floor(lo * inverse_period)
    kept = 0
    points = 0
    for j in range(n):
        count = int(count_j[j])
        keep_j[kept] = j
        kept += count > 0
        points += count
    return kept, points


@nb.njit(**JIT_FMA)
def frame(r0, r1, r2, step_ac, frame_cc):
    """Rows n, u, v: orthonormal, n along the bond, v normal to the row's direction too, so that v·d is the same all along a row."""
    if r0 == 0.0 and r1 == 0.0 and r2 == 0.0:
        nx, ny, nz = 1.0, 0.0, 0.0
    else:
        t = 1.0 / sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        nx, ny, nz = r0 * t, r1 * t, r2 * t
    sx, sy, sz = step_ac[2, 0], step_ac[2, 1], step_ac[2, 2]
    vx, vy, vz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
    if vx * vx + vy * vy + vz * vz < 1e-28 * (sx * sx + sy * sy + sz * sz):
        if abs(nx) < 0.6:
            vx, vy, vz = 0.0, nz, -ny
        else:
            vx, vy, vz = -nz, 0.0, nx
    t = 1.0 / sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * t, vy * t, vz * t
    # Once more against n: nearly parallel vectors leave a cross product of few digits.
    t = vx * nx + vy * ny + vz * nz
    vx, vy, vz = vx - t * nx, vy - t * ny, vz - t * nz
    t = 1.0 / sqrt(vx * vx + vy * vy + vz * vz)
    vx, vy, vz = vx * t, vy * t, vz * t
    frame_cc[0, 0] = nx
    frame_cc[0, 1] = ny
    frame_cc[0, 2] = nz
    frame_cc[1, 0] = vy * nz - vz * ny
    frame_cc[1, 1] = vz * nx - vx * nz
    frame_cc[1, 2] = vx * ny - vy * nx
    frame_cc[2, 0] = vx
    frame_cc[2, 1] = vy
    frame_cc[2, 2] = vz


@nb.njit(**JIT_FMA)
def rows_of_planes(i, i_hi, j_lo, width, base0, base1, n0, n1, wrap0, wrap1, map_4c, D_j, Y_j, M_j, row_j):
    """Bond coordinates of the rows of planes i, i+1, .. (as many as the buffers hold; nearly always all), and the rows' numbers.

    Returns the number of rows and the first plane left out.
    """
    rows = 0
    while i <= i_hi and rows + width <= len(row_j):
        at0 = base0 + i
        if wrap0:
            at0 = folded(at0, n0)
        at1 = base1 + j_lo
        if wrap1:
            at1 = folded(at1, n1)
        D = map_4c[3, 0] + i * map_4c[0, 0] + j_lo * map_4c[1, 0]
        Y = map_4c[3, 1] + i * map_4c[0, 1] + j_lo * map_4c[1, 1]
        M = map_4c[3, 2] + i * map_4c[0, 2] + j_lo * map_4c[1, 2]
        D1, Y1, M1 = map_4c[1, 0], map_4c[1, 1], map_4c[1, 2]
        for j in range(width):
            D_j[rows + j] = D + j * D1
            Y_j[rows + j] = Y + j * Y1
            M_j[rows + j] = M + j * M1
            row_j[rows + j] = at0 * n1 + at1
            at1 += 1
            if wrap1 and at1 == n1:
                at1 = 0
        rows += width
        i += 1
    return rows, i


@nb.njit(**JIT_FMA)
def images(x_nc, at, origin_c, r_bc, b, support, image_a, inverse_ca, region_2a, lo_a, hi_a):
    """The range of periodic images of a bond that can reach the lattice, along each axis of the cell. Returns their number."""
    for a in range(3):
        if image_a[a]:
            h0, h1, h2 = inverse_ca[0, a], inverse_ca[1, a], inverse_ca[2, a]
            start = (x_nc[at, 0] - origin_c[0]) * h0 + (x_nc[at, 1] - origin_c[1]) * h1 + (x_nc[at, 2] - origin_c[2]) * h2
            end = start - (r_bc[b, 0] * h0 + r_bc[b, 1] * h1 + r_bc[b, 2] * h2)
            reach = support * sqrt(h0 * h0 + h1 * h1 + h2 * h2) + 1e-9
            lo_a[a] = ceil(region_2a[0, a] - reach - max(start, end))
            hi_a[a] = floor(region_2a[1, a] + reach - min(start, end))
    return max(0, hi_a[0] - lo_a[0] + 1) * max(0, hi_a[1] - lo_a[1] + 1) * max(0, hi_a[2] - lo_a[2] + 1)


@nb.njit(**JIT_FMA)
def nearest(x_nc, at, image, lo_a, hi_a, period_ac, origin_c, offset_c, step_ac, inverse_ca, d_c, f_a, base_a):
    """The lattice point nearest to an image of x: its index, d = x − point, and d in lattice coordinates."""
    g0, g1, g2 = lo_a[0], lo_a[1], lo_a[2]
    if image > 0:
        span1 = hi_a[1] - g1 + 1
        span2 = hi_a[2] - g2 + 1
        g0 += image // (span1 * span2)
        g1 += image // span2 % span1
        g2 += image % span2
    for c in range(3):
        d_c[c] = (x_nc[at, c] - origin_c[c]) - offset_c[c] + g0 * period_ac[0, c] + g1 * period_ac[1, c] + g2 * period_ac[2, c]
    for a in range(3):
        f = d_c[0] * inverse_ca[0, a] + d_c[1] * inverse_ca[1, a] + d_c[2] * inverse_ca[2, a]
        base_a[a] = floor(f + 0.5)
        f_a[a] = f - base_a[a]
    for c in range(3):
        d_c[c] -= base_a[0] * step_ac[0, c] + base_a[1] * step_ac[1, c] + base_a[2] * step_ac[2, c]


@nb.njit(**JIT_FMA)
def in_frame(d_c, step_ac, frame_cc, length, map_4c):
    """d of the nearest point (row 3) and its change from one point to the next (rows 0-2), in the bond's frame and unit of length."""
    t = 1.0 / length
    for c in range(3):
        for a in range(3):
            map_4c[a, c] = -t * (step_ac[a, 0] * frame_cc[c, 0] + step_ac[a, 1] * frame_cc[c, 1] + step_ac[a, 2] * frame_cc[c, 2])
        map_4c[3, c] = t * (d_c[0] * frame_cc[c, 0] + d_c[1] * frame_cc[c, 1] + d_c[2] * frame_cc[c, 2])


def lattice_bonds(
    x_nc,
    i_b,
    r_bc,
    b_bk,
    radii_m,
    coef_mk,
    origin_c,  # the cell's
    offset_c,  # lattice point (0, 0, 0), relative to the cell's origin
    step_ac,  # rows: steps along the lattice's axes; the last axis is the row
    inverse_ca,  # of step_ac: lattice coordinates are (x − offset) @ inverse_ca
    shape_a,
    wrap_a,  # whether an axis of the lattice closes on itself through the periodic cell
    image_a,  # whether to look for periodic images of the bond along an axis of the cell; never where the lattice wraps
    period_ac,  # the cell's vectors
    period_inverse_ca,
    region_2a,  # the lattice's extent in fractional coordinates of the cell
    acc,  # flat: rows × components × ext
    ext,
    row_6j,  # buffers: D, Y, M, first point, number of points and place of each row
    index_2j,  # buffers: which row of the accumulator; the rows that are met
):
    """Σ_b b β at every point, added to `acc`. Returns the number of (bond, point) pairs visited, −1 if something is not finite."""
    n0, n1, n2 = shape_a[0], shape_a[1], shape_a[2]
    wrap0, wrap1, wrap2 = wrap_a[0], wrap_a[1], wrap_a[2]
    any_image = image_a[0] or image_a[1] or image_a[2]
    # How far a ball of radius 1 reaches in lattice coordinates.
    reach0 = sqrt(inverse_ca[0, 0] ** 2 + inverse_ca[1, 0] ** 2 + inverse_ca[2, 0] ** 2)
    reach1 = sqrt(inverse_ca[0, 1] ** 2 + inverse_ca[1, 1] ** 2 + inverse_ca[2, 1] ** 2)
    n_comp = b_bk.shape[1]
    stride = n_comp * ext
    D_j = row_6j[0]
    Y_j = row_6j[1]
    M_j = row_6j[2]
    first_j = row_6j[3]
    count_j = row_6j[4]
    at_j = row_6j[5]
    row_j = index_2j[0]
    keep_j = index_2j[1]
    visits = 0
    lo_a = np.zeros(3, np.int64)
    hi_a = np.zeros(3, np.int64)
    base_a = np.zeros(3, np.int64)
    d_c = np.zeros(3)
    f_a = np.zeros(3)
    frame_cc = np.zeros((3, 3))
    map_4c = np.zeros((4, 3))
    k_ = np.zeros(N_CONSTANTS)
    for b in range(len(r_bc)):
        r0, r1, r2 = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        true_length = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        o = i_b[b]
        if not isfinite(true_length + x_nc[o, 0] + x_nc[o, 1] + x_nc[o, 2]):
            return -1
        e0 = r0 * inverse_ca[0, 0] + r1 * inverse_ca[1, 0] + r2 * inverse_ca[2, 0]
        e1 = r0 * inverse_ca[0, 1] + r1 * inverse_ca[1, 1] + r2 * inverse_ca[2, 1]
        frame(r0, r1, r2, step_ac, frame_cc)
        b0 = b_bk[b, 0]
        b1, b2, b3, b4, b5 = (b_bk[b, 1], b_bk[b, 2], b_bk[b, 3], b_bk[b, 4], b_bk[b, 5]) if n_comp == 6 else (0.0, 0.0, 0.0, 0.0, 0.0)
        n_images = 1
        if any_image:
            n_images = images(x_nc, o, origin_c, r_bc, b, radii_m[0], image_a, period_inverse_ca, region_2a, lo_a, hi_a)
        for image in range(n_images):
            # Everything below is relative to the lattice point nearest to x_i.
            nearest(x_nc, o, image, lo_a, hi_a, period_ac, origin_c, offset_c, step_ac, inverse_ca, d_c, f_a, base_a)
            base0, base1, base2 = base_a[0], base_a[1], base_a[2]
            if wrap0:
                base0 = folded(base0, n0)
            if wrap1:
                base1 = folded(base1, n1)
            if wrap2:
                base2 = folded(base2, n2)
            k_lo = -1e18 if wrap2 else float(-base2)
            k_hi = 1e18 if wrap2 else float(n2 - 1 - base2)
            for m in range(len(radii_m)):
                R = radii_m[m]
                length = max(true_length, 1e-30 * R)
                in_frame(d_c, step_ac, frame_cc, length, map_4c)
                CONSTANTS(length, R, coef_mk, m, r0, r1, r2, frame_cc, k_)
                D2, Y2 = map_4c[2, 0], map_4c[2, 1]
                i = ceil(f_a[0] - max(e0, 0.0) - R * reach0 - 1e-9)
                i_hi = floor(f_a[0] - min(e0, 0.0) + R * reach0 + 1e-9)
                j_lo = ceil(f_a[1] - max(e1, 0.0) - R * reach1 - 1e-9)
                j_hi = floor(f_a[1] - min(e1, 0.0) + R * reach1 + 1e-9)
                if not wrap0:
                    i = max(i, -base0)
                    i_hi = min(i_hi, n0 - 1 - base0)
                if not wrap1:
                    j_lo = max(j_lo, -base1)
                    j_hi = min(j_hi, n1 - 1 - base1)
                while i <= i_hi and j_lo <= j_hi:
                    rows, i = rows_of_planes(
                        i, i_hi, j_lo, j_hi - j_lo + 1, base0, base1, n0, n1, wrap0, wrap1, map_4c, D_j, Y_j, M_j, row_j
                    )
                    kept, points = chords(
                        rows, D_j, Y_j, M_j, (R / length) ** 2, D2, Y2, k_lo, k_hi,
                        base2, n2, wrap2, first_j, count_j, at_j, keep_j,
                    )  # fmt: skip
                    visits += points
                    for t in range(kept):
                        j = keep_j[t]
                        k = first_j[j]
                        left = int(count_j[j])
                        at = int(at_j[j])
                        Dk = D_j[j] + k * D2
                        Yk = Y_j[j] + k * Y2
                        Mv = splat4(M_j[j])
                        while left > 0:
                            # Once, unless the chord is longer than what the row of the accumulator has to spare.
                            runs = min((left + 3) >> 2, (ext - at) >> 2)
                            to = row_j[j] * stride + at
                            for _ in range(runs):
                                beta = BETA(ramp4(Dk, D2), ramp4(Yk, Y2), Mv, k_)
                                axpy4(acc, to, b0, beta)
                                if n_comp == 6:
                                    axpy4(acc, to + ext, b1, beta)
                                    axpy4(acc, to + 2 * ext, b2, beta)
                                    axpy4(acc, to + 3 * ext, b3, beta)
                                    axpy4(acc, to + 4 * ext, b4, beta)
                                    axpy4(acc, to + 5 * ext, b5, beta)
                                else:
                                    for c in range(1, n_comp):
                                        axpy4(acc, to + c * ext, b_bk[b, c], beta)
                                Dk += 4.0 * D2
                                Yk += 4.0 * Y2
                                to += 4
                            left -= 4 * runs
                            at += 4 * runs
                            if left > 0 and wrap2:
                                at %= n2
    return visits
