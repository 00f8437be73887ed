"""The two sums on a lattice of points: rows of equally spaced points, each cut to its chord through the bond's capsule.

A point sees a bond when it lies within the support R of it, in a capsule. For every row of the lattice that the capsule meets, the first
and last point inside follow from the union of two spheres and a cylinder; the points found are written to buffers in runs of four,
β is evaluated for all of them in one loop, and each run is added to the row.

The accumulator is [row][component][position in row], rows over the two slower axes. Positions run on past the row's end (`ext` ≥ n + 3 of
them), so that a run never has to be split at the periodic boundary; what lies beyond is folded back, or on an open axis dropped, at the end.
A site is a bond of length 0.
"""

from __future__ import annotations

from math import ceil, floor, sqrt

import numba as nb
import numpy as np

from ._beta import even
from ._simd import JIT_FMA, axpy4, ramp4

# Replaced in each specialised copy (see `_simd.specialise`).
BETA = even
CARTESIAN = False


@nb.njit(**JIT_FMA)
def chords(n, D_j, Y_j, M_j, E2, D2, Y2, k_lo, k_hi, first_j, count_j):
    """First point and number of points of each row inside the capsule.

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


def lattice_bonds(
    x_nc,  # positions relative to the cell's origin
    i_b,
    r_bc,
    b_bk,
    radii_m,
    coef_mk,
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
    lane_4l,  # buffers: D, Y, M, β of the points of one bond
    row_5j,  # buffers: D, Y, M, first point and number of points of each row
    index_2j,  # buffers: which row of the accumulator; where each run of four goes in it
):
    """Σ_b b β at every point, added to `acc`. Returns the number of (bond, point) pairs visited."""
    n0, n1, n2 = shape_a[0], shape_a[1], shape_a[2]
    wrap0, wrap1, wrap2 = wrap_a[0], wrap_a[1], wrap_a[2]
    any_image = image_a[0] or image_a[1] or image_a[2]
    s00, s01, s02 = step_ac[0, 0], step_ac[0, 1], step_ac[0, 2]
    s10, s11, s12 = step_ac[1, 0], step_ac[1, 1], step_ac[1, 2]
    s20, s21, s22 = step_ac[2, 0], step_ac[2, 1], step_ac[2, 2]
    # How far a ball of radius 1 reaches in lattice coordinates.
    reach0 = sqrt(inverse_ca[0, 0] ** 2 + inverse_ca[1, 0] ** 2 + inverse_ca[2, 0] ** 2)
    reach1 = sqrt(inverse_ca[0, 1] ** 2 + inverse_ca[1, 1] ** 2 + inverse_ca[2, 1] ** 2)
    n_comp = b_bk.shape[1]
    visits = 0
    D, Y, M, beta = lane_4l[0], lane_4l[1], lane_4l[2], lane_4l[3]
    D_j, Y_j, M_j, first_j, count_j = row_5j[0], row_5j[1], row_5j[2], row_5j[3], row_5j[4]
    row_j, to_run = index_2j[0], index_2j[1]
    rows_max = row_5j.shape[1]
    runs_max = lane_4l.shape[1] // 4
    lo_a = np.zeros(3, np.int64)
    hi_a = np.zeros(3, np.int64)
    for b in range(len(r_bc)):
        at = i_b[b]
        r0, r1, r2 = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        true_length = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        if any_image:
            for a in range(3):
                if image_a[a]:
                    h0, h1, h2 = period_inverse_ca[0, a], period_inverse_ca[1, a], period_inverse_ca[2, a]
                    start = x_nc[at, 0] * h0 + x_nc[at, 1] * h1 + x_nc[at, 2] * h2
                    end = start - (r0 * h0 + r1 * h1 + r2 * h2)
                    reach = radii_m[0] * sqrt(h0 * h0 + h1 * h1 + h2 * h2) + 1e-9
                    lo_a[a] = ceil(region_2a[0, a] - reach - max(start, end))
                    hi_a[a] = floor(region_2a[1, a] + reach - min(start, end))
        span1 = hi_a[1] - lo_a[1] + 1
        span2 = hi_a[2] - lo_a[2] + 1
        n_images = max(0, hi_a[0] - lo_a[0] + 1) * max(0, span1) * max(0, span2)
        for image in range(n_images):
            g0 = lo_a[0] + image // (span1 * span2)
            g1 = lo_a[1] + image // span2 % span1
            g2 = lo_a[2] + image % span2
            x0 = x_nc[at, 0] - offset_c[0] + g0 * period_ac[0, 0] + g1 * period_ac[1, 0] + g2 * period_ac[2, 0]
            x1 = x_nc[at, 1] - offset_c[1] + g0 * period_ac[0, 1] + g1 * period_ac[1, 1] + g2 * period_ac[2, 1]
            x2 = x_nc[at, 2] - offset_c[2] + g0 * period_ac[0, 2] + g1 * period_ac[1, 2] + g2 * period_ac[2, 2]
            # The lattice point nearest to x_i; everything below is relative to it.
            f0 = x0 * inverse_ca[0, 0] + x1 * inverse_ca[1, 0] + x2 * inverse_ca[2, 0]
            f1 = x0 * inverse_ca[0, 1] + x1 * inverse_ca[1, 1] + x2 * inverse_ca[2, 1]
            f2 = x0 * inverse_ca[0, 2] + x1 * inverse_ca[1, 2] + x2 * inverse_ca[2, 2]
            base0, base1, base2 = floor(f0 + 0.5), floor(f1 + 0.5), floor(f2 + 0.5)
            d0 = x0 - (base0 * s00 + base1 * s10 + base2 * s20)
            d1 = x1 - (base0 * s01 + base1 * s11 + base2 * s21)
            d2 = x2 - (base0 * s02 + base1 * s12 + base2 * s22)
            f0 -= base0
            f1 -= base1
            e0 = f0 - (r0 * inverse_ca[0, 0] + r1 * inverse_ca[1, 0] + r2 * inverse_ca[2, 0])
            e1 = f1 - (r0 * inverse_ca[0, 1] + r1 * inverse_ca[1, 1] + r2 * inverse_ca[2, 1])
            if wrap0:
                base0 %= n0
            if wrap1:
                base1 %= n1
            if wrap2:
                base2 %= n2
            k_lo = -1e18 if wrap2 else float(-base2)
            k_hi = 1e18 if wrap2 else float(n2 - 1 - base2)
            for m in range(len(radii_m)):
                R = radii_m[m]
                # Orthonormal frame (n, u, v): n along the bond, v normal to the row, so that v·d is the same all along a row.
                length = true_length
                if length < 1e-30 * R:
                    length = 1e-30 * R
                    nx, ny, nz = 1.0, 0.0, 0.0
                else:
                    nx, ny, nz = r0 / length, r1 / length, r2 / length
                vx, vy, vz = ny * s22 - nz * s21, nz * s20 - nx * s22, nx * s21 - ny * s20
                if vx * vx + vy * vy + vz * vz < 1e-28 * (s20 * s20 + s21 * s21 + s22 * s22):
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
                ux, uy, uz = vy * nz - vz * ny, vz * nx - vx * nz, vx * ny - vy * nx
                t = 1.0 / length
                E2 = (R * t) * (R * t)
                # d of the nearest point, and its change from one point to the next, in this frame and in units of the bond's length.
                D00 = (d0 * nx + d1 * ny + d2 * nz) * t
                Y00 = (d0 * ux + d1 * uy + d2 * uz) * t
                M00 = (d0 * vx + d1 * vy + d2 * vz) * t
                D0 = -(s00 * nx + s01 * ny + s02 * nz) * t
                Y0 = -(s00 * ux + s01 * uy + s02 * uz) * t
                M0 = -(s00 * vx + s01 * vy + s02 * vz) * t
                D1 = -(s10 * nx + s11 * ny + s12 * nz) * t
                Y1 = -(s10 * ux + s11 * uy + s12 * uz) * t
                M1 = -(s10 * vx + s11 * vy + s12 * vz) * t
                D2 = -(s20 * nx + s21 * ny + s22 * nz) * t
                Y2 = -(s20 * ux + s21 * uy + s22 * uz) * t
                i = ceil(min(f0, e0) - R * reach0 - 1e-9)
                i_hi = floor(max(f0, e0) + R * reach0 + 1e-9)
                j_lo = ceil(min(f1, e1) - R * reach1 - 1e-9)
                j_hi = floor(max(f1, e1) + R * reach1 + 1e-9)
                if not wrap0:
                    i = max(i, -base0)
                    i_hi = min(i_hi, n0 - 1 - base0)
                if not wrap1:
                    j_lo = max(j_lo, -base1)
                    j_hi = min(j_hi, n1 - 1 - base1)
                width = j_hi - j_lo + 1
                if width <= 0:
                    continue
                while i <= i_hi:
                    # As many planes of rows as the buffers hold; nearly always all of them.
                    rows = 0
                    while i <= i_hi and rows + width <= rows_max:
                        at0 = base0 + i
                        if wrap0:
                            at0 %= n0
                        at1 = base1 + j_lo
                        if wrap1:
                            at1 %= n1
                        Di, Yi, Mi = D00 + i * D0 + j_lo * D1, Y00 + i * Y0 + j_lo * Y1, M00 + i * M0 + j_lo * M1
                        for j in range(width):
                            D_j[rows + j] = Di + j * D1
                            Y_j[rows + j] = Yi + j * Y1
                            M_j[rows + j] = Mi + j * M1
                            row_j[rows + j] = at0 * n1 + at1
                            at1 += 1
                            if wrap1 and at1 == n1:
                                at1 = 0
                        rows += width
                        i += 1
                    chords(rows, D_j, Y_j, M_j, E2, D2, Y2, k_lo, k_hi, first_j, count_j)
                    row = 0
                    k = 0
                    left = 0
                    while row < rows or left > 0:
                        runs = 0
                        while runs < runs_max:
                            if left <= 0:
                                if row == rows:
                                    break
                                k = int(first_j[row])
                                left = int(count_j[row])
                                visits += left
                                row += 1
                                if left <= 0:
                                    continue
                            at2 = base2 + k
                            if wrap2 and (at2 < 0 or at2 >= n2):
                                at2 %= n2
                            more = min(min((left + 3) >> 2, (ext - at2) >> 2), runs_max - runs)
                            to = row_j[row - 1] * n_comp * ext + at2
                            Dk = D_j[row - 1] + k * D2
                            Yk = Y_j[row - 1] + k * Y2
                            Mk = M_j[row - 1]
                            for _ in range(more):
                                to_run[runs] = to
                                ramp4(D, 4 * runs, Dk, D2)
                                ramp4(Y, 4 * runs, Yk, Y2)
                                ramp4(M, 4 * runs, Mk, 0.0)
                                runs += 1
                                to += 4
                                Dk += 4.0 * D2
                                Yk += 4.0 * Y2
                            left -= 4 * more
                            k += 4 * more
                        if CARTESIAN:
                            # These kernels want d itself, not the bond's frame.
                            for l in range(4 * runs):
                                cD, cY, cM = D[l] * length, Y[l] * length, M[l] * length
                                D[l] = cD * nx + cY * ux + cM * vx
                                Y[l] = cD * ny + cY * uy + cM * vy
                                M[l] = cD * nz + cY * uz + cM * vz
                        BETA(4 * runs, D, Y, M, length, r0, r1, r2, R, coef_mk[m], beta)
                        if n_comp == 6:
                            b0, b1, b2, b3, b4, b5 = b_bk[b, 0], b_bk[b, 1], b_bk[b, 2], b_bk[b, 3], b_bk[b, 4], b_bk[b, 5]
                            for q in range(runs):
                                to = to_run[q]
                                axpy4(acc, to, b0, beta, 4 * q)
                                axpy4(acc, to + ext, b1, beta, 4 * q)
                                axpy4(acc, to + 2 * ext, b2, beta, 4 * q)
                                axpy4(acc, to + 3 * ext, b3, beta, 4 * q)
                                axpy4(acc, to + 4 * ext, b4, beta, 4 * q)
                                axpy4(acc, to + 5 * ext, b5, beta, 4 * q)
                        else:
                            for q in range(runs):
                                for c in range(n_comp):
                                    axpy4(acc, to_run[q] + c * ext, b_bk[b, c], beta, 4 * q)
    return visits
