"""The two sums on a lattice of points: rows of equally spaced points, each cut to its chord through the bond's capsule.

A point sees a bond when it lies within the support R of it, in a capsule. For every row of the lattice that the capsule meets, the first
and last point inside follow from the union of two spheres and a cylinder; β is evaluated for four points in a row at a time and added.

The accumulator is [row][position in row][component], rows over the two slower axes. Positions run on past the row's end (`ext` ≥ n + 3 of
them), so that a run never has to be split at the periodic boundary; what lies beyond is folded back, or on an open axis dropped, at the end.
A site is a bond of length 0.
"""

from __future__ import annotations

from math import ceil, floor, isfinite, sqrt

import numba as nb
import numpy as np

from ._beta import N_CONSTANTS, even, even_constants
from ._simd import (
    INLINE,
    JIT_FMA,
    accumulate4,
    address,
    ceil4,
    floor4,
    lanes4,
    load4,
    maximum4,
    minimum4,
    ramp4,
    splat4,
    sqrt4,
    store4,
    sum4,
    where_positive4,
)

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


@nb.njit(**INLINE)
def chords(n, D_j, Y_j, M_j, E2, D2, Y2, k_lo, k_hi, base2, n2, wrap2, first_j, count_j, at_j, short_j, long_j):
    """First point and number of points of each row inside the capsule, and where in the row of the accumulator that is.

    A row is (D + k D2, Y + k Y2, M) in units of the bond's length, the bond from (0, 0, 0) to (1, 0, 0), E2 the radius squared.
    The capsule is the union of a cylinder and two spheres and convex: the chord runs from the least to the greatest of their ends.
    `short_j` gets the rows with one to four points, `long_j` those with more. Returns the numbers of both, and of points.
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
    D_at, Y_at, M_at, first_at, count_at, at_at = (
        address(D_j),
        address(Y_j),
        address(M_j),
        address(first_j),
        address(count_j),
        address(at_j),
    )
    total = splat4(0.0)
    for j in range(0, n, 4):
        D = load4(D_at, j)
        Y = load4(Y_at, j)
        M = load4(M_at, j)
        W = E2 - M * M
        # Cylinder, between the two end planes.
        half = sqrt4(maximum4(W, 0.0)) * half_Y
        centre = Y * -inverse_Y
        p = D * -inverse_D
        q = p + inverse_D
        near = maximum4(centre - half, minimum4(p, q))
        far = minimum4(centre + half, maximum4(p, q))
        lo = where_positive4(far - near, near, 1e300)
        hi = where_positive4(far - near, far, -1e300)
        # Sphere about x_i, sphere about x_j.
        across = (D * Y2 - Y * D2) * inverse_row
        chord = W - across * across
        half = sqrt4(maximum4(chord, 0.0)) * inverse_row
        centre = (D * D2 + Y * Y2) * -inverse_row2
        lo = minimum4(lo, where_positive4(chord, centre - half, 1e300))
        hi = maximum4(hi, where_positive4(chord, centre + half, -1e300))
        across = across - Y2 * inverse_row
        chord = W - across * across
        half = sqrt4(maximum4(chord, 0.0)) * inverse_row
        centre = centre + D2 * inverse_row2
        lo = minimum4(lo, where_positive4(chord, centre - half, 1e300))
        hi = maximum4(hi, where_positive4(chord, centre + half, -1e300))
        # Rounding must not lose a point at the rim; one too many has β = 0.
        lo = ceil4(maximum4(lo - 1e-9, k_lo))
        hi = floor4(minimum4(where_positive4(W, hi, -1e300) + 1e-9, k_hi))
        count = maximum4(hi - lo + 1.0, 0.0)
        total = total + count
        at = lo + base2
        at = at - floor4(at * inverse_period) * period
        store4(first_at, j, lo)
        store4(at_at, j, at)
        store4(count_at, j, count)
    # Rows beyond n, up to a multiple of four, must not count: their M is out of reach.
    points = sum4(total)
    short = 0
    long = 0
    for j in range(n):
        count = int(count_j[j])
        # Written whether it counts or not: nothing to predict.
        short_j[short] = j
        short += (count > 0) & (count <= 4)
        long_j[long] = j
        long += count > 4
    return short, long, int(points)


@nb.njit(**INLINE)
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


@nb.njit(**INLINE)
def rows_of_planes(i, i_hi, j_lo, width, base0, n0, n1, wrap0, map_4c, column_j, D_j, Y_j, M_j, row_j):
    """Bond coordinates of the rows of planes i, i+1, .. (as many as the buffers hold; nearly always all), and the rows' numbers.

    Returns the number of rows and the first plane left out.
    """
    rows = 0
    D1, Y1, M1 = map_4c[1, 0], map_4c[1, 1], map_4c[1, 2]
    D_at, Y_at, M_at = address(D_j), address(Y_j), address(M_j)
    while i <= i_hi and rows + width + 4 <= len(row_j):
        at0 = base0 + i
        if wrap0:
            at0 = folded(at0, n0)
        D = map_4c[3, 0] + i * map_4c[0, 0] + j_lo * D1
        Y = map_4c[3, 1] + i * map_4c[0, 1] + j_lo * Y1
        M = map_4c[3, 2] + i * map_4c[0, 2] + j_lo * M1
        # The last run of four sticks out; the next plane writes over it.
        for j in range(0, width, 4):
            store4(D_at, rows + j, ramp4(D + j * D1, D1))
            store4(Y_at, rows + j, ramp4(Y + j * Y1, Y1))
            store4(M_at, rows + j, ramp4(M + j * M1, M1))
        for j in range(width):
            row_j[rows + j] = at0 * n1 + column_j[j]
        rows += width
        i += 1
    store4(M_at, rows, splat4(1e200))
    return rows, i


@nb.njit(**INLINE)
def add(acc_at, to, quads, b_at, b0, b1, beta):
    """b β for four points in a row; up to eight components from registers. The components of a point are neighbours in memory."""
    w0, w1, w2, w3 = lanes4(beta)
    if quads == 2:
        accumulate4(acc_at, to, w0 * b0)
        accumulate4(acc_at, to + 4, w0 * b1)
        accumulate4(acc_at, to + 8, w1 * b0)
        accumulate4(acc_at, to + 12, w1 * b1)
        accumulate4(acc_at, to + 16, w2 * b0)
        accumulate4(acc_at, to + 20, w2 * b1)
        accumulate4(acc_at, to + 24, w3 * b0)
        accumulate4(acc_at, to + 28, w3 * b1)
    else:
        for c in range(0, 4 * quads, 4):
            b = load4(b_at, c)
            accumulate4(acc_at, to + c, w0 * b)
            accumulate4(acc_at, to + c + 4 * quads, w1 * b)
            accumulate4(acc_at, to + c + 8 * quads, w2 * b)
            accumulate4(acc_at, to + c + 12 * quads, w3 * b)


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


@nb.njit(**INLINE)
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


@nb.njit(**INLINE)
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
    b_bk,  # components filled up with zeros to a multiple of four
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
    acc,  # flat: rows × ext × components
    ext,
    row_6j,  # buffers: D, Y, M, first point, number of points and place of each row
    index_4j,  # buffers: which row of the accumulator; rows that meet the bond in up to four points, in more; second index of the rows of a plane
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
    quads = n_comp // 4
    D_j = row_6j[0]
    Y_j = row_6j[1]
    M_j = row_6j[2]
    first_j = row_6j[3]
    count_j = row_6j[4]
    at_j = row_6j[5]
    row_j = index_4j[0]
    short_j = index_4j[1]
    long_j = index_4j[2]
    column_j = index_4j[3]
    visits = 0
    lo_a = np.zeros(3, np.int64)
    hi_a = np.zeros(3, np.int64)
    base_a = np.zeros(3, np.int64)
    d_c = np.zeros(3)
    f_a = np.zeros(3)
    frame_cc = np.zeros((3, 3))
    map_4c = np.zeros((4, 3))
    k_ = np.zeros(N_CONSTANTS)
    acc_at, k_at = address(acc), address(k_)
    for b in range(len(r_bc)):
        r0, r1, r2 = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        true_length = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        o = i_b[b]
        if not isfinite(true_length + x_nc[o, 0] + x_nc[o, 1] + x_nc[o, 2]):
            return -1
        e0 = r0 * inverse_ca[0, 0] + r1 * inverse_ca[1, 0] + r2 * inverse_ca[2, 0]
        e1 = r0 * inverse_ca[0, 1] + r1 * inverse_ca[1, 1] + r2 * inverse_ca[2, 1]
        frame(r0, r1, r2, step_ac, frame_cc)
        b_at = address(b_bk) + 8 * n_comp * b
        b0, b1 = load4(b_at, 0), load4(b_at, 4 if quads == 2 else 0)
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
                for j in range(j_lo, j_hi + 1):
                    column_j[j - j_lo] = folded(base1 + j, n1) if wrap1 else base1 + j
                while i <= i_hi and j_lo <= j_hi:
                    rows, i = rows_of_planes(i, i_hi, j_lo, j_hi - j_lo + 1, base0, n0, n1, wrap0, map_4c, column_j, D_j, Y_j, M_j, row_j)
                    short, long, points = chords(
                        rows, D_j, Y_j, M_j, (R / length) ** 2, D2, Y2, k_lo, k_hi,
                        base2, n2, wrap2, first_j, count_j, at_j, short_j, long_j,
                    )  # fmt: skip
                    visits += points
                    for t in range(short):
                        j = short_j[t]
                        k = first_j[j]
                        beta = BETA(ramp4(D_j[j] + k * D2, D2), ramp4(Y_j[j] + k * Y2, Y2), splat4(M_j[j]), k_at)
                        add(acc_at, row_j[j] * stride + int(at_j[j]) * n_comp, quads, b_at, b0, b1, beta)
                    for t in range(long):
                        j = long_j[t]
                        k = first_j[j]
                        left = int(count_j[j])
                        at = int(at_j[j])
                        while left > 0:
                            # Once, unless the chord is longer than what the row of the accumulator has to spare.
                            runs = min((left + 3) >> 2, (ext - at) >> 2)
                            to = row_j[j] * stride + at * n_comp
                            for _ in range(runs):
                                beta = BETA(ramp4(D_j[j] + k * D2, D2), ramp4(Y_j[j] + k * Y2, Y2), splat4(M_j[j]), k_at)
                                add(acc_at, to, quads, b_at, b0, b1, beta)
                                k += 4.0
                                to += 4 * n_comp
                            left -= 4 * runs
                            at += 4 * runs
                            if left > 0 and wrap2:
                                at %= n2
    return visits
