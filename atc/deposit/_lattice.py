"""The two sums on a lattice of points: rows of equally spaced points, each cut to its chord through the bond's capsule.

A point sees a bond when it lies within the support R of it, in a capsule. For every row of the lattice that the capsule
meets, the first and last point inside follow from the union of two spheres and a cylinder; β is evaluated for four
points in a row at a time and added.

The accumulator is [row][position in row][component], rows over the two slower axes. Positions run on past the row's end
(`ext` ≥ n + 3 of them), so that a run never has to be split at the periodic boundary; what lies beyond is folded back,
or on an open axis dropped, at the end. A site is a bond of length 0.
"""

from __future__ import annotations

from math import ceil, floor, isfinite, sqrt

from numpy import int64

from ..compiled import njit
from ..simd import (
    ENTRY,
    INLINE,
    JIT_FMA,
    accumulate4,
    address,
    ceil4,
    floor4,
    greater,
    lanes4,
    lesser,
    load4,
    maximum4,
    minimum4,
    peek,
    peek_int,
    poke,
    poke_int,
    ramp4,
    splat4,
    sqrt4,
    store4,
    sum4,
    where_positive4,
)

# Replaced in each specialised copy (see `compiled.specialise`).
BETA = None
CONSTANTS = None


@njit(**INLINE)
def folded(i, n):
    """i modulo n; a division is slow and rarely needed."""
    if 0 <= i < n:
        return i
    i += n if i < 0 else -n
    return i if 0 <= i < n else i % n


@njit(**INLINE)
def chords(n, D_at, Y_at, M_at, E2, D2, Y2, k_lo, k_hi, base2, n2, wrap2, first_at, count_at, at_at, short_at, long_at):
    """First point and number of points of each row inside the capsule, and where in the row of the accumulator that is.

    A row is (D + k D2, Y + k Y2, M) in units of the bond's length, the bond from (0, 0, 0) to (1, 0, 0), E2 the radius
    squared. The capsule is the union of a cylinder and two spheres and convex: the chord runs from the least to the
    greatest of their ends. `short_at` gets the rows with one to four points, `long_at` those with more. Returns the
    numbers of both, and of points.
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
        count = peek(count_at, j)
        # Written whether it counts or not: nothing to predict.
        poke_int(short_at, short, j)
        short += (count > 0.0) & (count <= 4.0)
        poke_int(long_at, long, j)
        long += count > 4.0
    return short, long, int64(points)


@njit(**INLINE)
def rows_of_planes(i, i_hi, j_lo, width, most, base0, n0, n1, wrap0, map_at, column_at, D_at, Y_at, M_at, row_at):
    """Bond coordinates of the rows of planes i, i+1, .. (as many as the buffers hold; nearly always all), and the rows'
    numbers.

    Returns the number of rows and the first plane left out.
    """
    rows = 0
    D1, Y1, M1 = peek(map_at, 3), peek(map_at, 4), peek(map_at, 5)
    while i <= i_hi and rows + width + 4 <= most:
        at0 = base0 + i
        if wrap0:
            at0 = folded(at0, n0)
        D = peek(map_at, 9) + i * peek(map_at, 0) + j_lo * D1
        Y = peek(map_at, 10) + i * peek(map_at, 1) + j_lo * Y1
        M = peek(map_at, 11) + i * peek(map_at, 2) + j_lo * M1
        # The last run of four sticks out; the next plane writes over it.
        for j in range(0, width, 4):
            store4(D_at, rows + j, ramp4(D + j * D1, D1))
            store4(Y_at, rows + j, ramp4(Y + j * Y1, Y1))
            store4(M_at, rows + j, ramp4(M + j * M1, M1))
            store4(row_at, rows + j, load4(column_at, j) + float(at0 * n1))
        rows += width
        i += 1
    store4(M_at, rows, splat4(1e200))
    return rows, i


@njit(**JIT_FMA)
def add(acc_at, to_at, beta_at, runs, quads, b_at):
    """b β for runs of four points; up to eight components from registers. The components of a point are neighbours in
    memory."""
    if quads == 2:
        b0, b1 = load4(b_at, 0), load4(b_at, 4)
        for q in range(runs):
            to = peek_int(to_at, q)
            w0, w1, w2, w3 = lanes4(load4(beta_at, 4 * q))
            accumulate4(acc_at, to, w0 * b0)
            accumulate4(acc_at, to + 4, w0 * b1)
            accumulate4(acc_at, to + 8, w1 * b0)
            accumulate4(acc_at, to + 12, w1 * b1)
            accumulate4(acc_at, to + 16, w2 * b0)
            accumulate4(acc_at, to + 20, w2 * b1)
            accumulate4(acc_at, to + 24, w3 * b0)
            accumulate4(acc_at, to + 28, w3 * b1)
    else:
        for q in range(runs):
            to = peek_int(to_at, q)
            w0, w1, w2, w3 = lanes4(load4(beta_at, 4 * q))
            for c in range(0, 4 * quads, 4):
                b = load4(b_at, c)
                accumulate4(acc_at, to + c, w0 * b)
                accumulate4(acc_at, to + c + 4 * quads, w1 * b)
                accumulate4(acc_at, to + c + 8 * quads, w2 * b)
                accumulate4(acc_at, to + c + 12 * quads, w3 * b)


@njit(**JIT_FMA)
def _along(map_at, e0, e1, e2, steps, d0, d1, d2):
    """How far the steps of the lattice (backwards) and d go along e."""
    (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = steps
    poke(map_at, 0, -(e0 * a0 + e1 * a1 + e2 * a2))
    poke(map_at, 3, -(e0 * b0 + e1 * b1 + e2 * b2))
    poke(map_at, 6, -(e0 * c0 + e1 * c1 + e2 * c2))
    poke(map_at, 9, e0 * d0 + e1 * d1 + e2 * d2)


@njit(**JIT_FMA)
def _put3(at, x, y, z):
    poke(at, 0, x)
    poke(at, 1, y)
    poke(at, 2, z)


@njit(**ENTRY)
def prepare(
    x_nc,
    i_b,
    r_bc,
    origin,  # three numbers, as tuples: of what is the same for all bonds
    offset,
    steps,
    inverse,
    shape,
    wrap,
    tiny,
    map_bk,
    end_bk,
    base_ba,
    length_b,
    frame_bcc,
):
    """The geometry of bonds from x_nc[i_b] to x − r on the lattice (see the arguments of `lattice_bonds`). Returns the
    greatest length, −1 if something is not finite.
    """
    longest = 0.0
    (s00, s01, s02), (s10, s11, s12), (sx, sy, sz) = steps
    (i00, i01, i02), (i10, i11, i12), (i20, i21, i22) = inverse
    row2 = sx * sx + sy * sy + sz * sz
    x_at, r_at, map_at, end_at = address(x_nc), address(r_bc), address(map_bk), address(end_bk)
    base_at, frame_at = address(base_ba), address(frame_bcc)
    for b in range(len(i_b)):
        o = 3 * i_b[b]
        r0, r1, r2 = peek(r_at, 3 * b), peek(r_at, 3 * b + 1), peek(r_at, 3 * b + 2)
        length = sqrt(r0 * r0 + r1 * r1 + r2 * r2)
        # Relative to the lattice point nearest to x_i, by way of the cell's origin: a box far from 0 loses nothing.
        d0 = (peek(x_at, o) - origin[0]) - offset[0]
        d1 = (peek(x_at, o + 1) - origin[1]) - offset[1]
        d2 = (peek(x_at, o + 2) - origin[2]) - offset[2]
        if not isfinite(length + d0 + d1 + d2):
            return -1.0
        longest = greater(longest, length)
        f0 = d0 * i00 + d1 * i10 + d2 * i20
        f1 = d0 * i01 + d1 * i11 + d2 * i21
        f2 = d0 * i02 + d1 * i12 + d2 * i22
        q0, q1, q2 = floor(f0 + 0.5), floor(f1 + 0.5), floor(f2 + 0.5)
        d0 -= q0 * s00 + q1 * s10 + q2 * sx
        d1 -= q0 * s01 + q1 * s11 + q2 * sy
        d2 -= q0 * s02 + q1 * s12 + q2 * sz
        poke_int(base_at, 3 * b, folded(q0, shape[0]) if wrap[0] else q0)
        poke_int(base_at, 3 * b + 1, folded(q1, shape[1]) if wrap[1] else q1)
        poke_int(base_at, 3 * b + 2, folded(q2, shape[2]) if wrap[2] else q2)
        poke(end_at, 4 * b, f0 - q0)
        poke(end_at, 4 * b + 1, f1 - q1)
        poke(end_at, 4 * b + 2, r0 * i00 + r1 * i10 + r2 * i20)
        poke(end_at, 4 * b + 3, r0 * i01 + r1 * i11 + r2 * i21)
        # Orthonormal frame (n, u, v): n along the bond, v normal to the rows too, so that v·d is the same all along a
        # row.
        if length < tiny:
            length = tiny
            nx, ny, nz = 1.0, 0.0, 0.0
        else:
            t = 1.0 / length
            nx, ny, nz = r0 * t, r1 * t, r2 * t
        vx, vy, vz = ny * sz - nz * sy, nz * sx - nx * sz, nx * sy - ny * sx
        v2 = vx * vx + vy * vy + vz * vz
        if v2 < 1e-28 * row2:
            # Parallel: any normal will do.
            if abs(nx) < 0.6:
                vx, vy, vz = 0.0, nz, -ny
            else:
                vx, vy, vz = -nz, 0.0, nx
            v2 = vx * vx + vy * vy + vz * vz
        t = 1.0 / sqrt(v2)
        vx, vy, vz = vx * t, vy * t, vz * t
        # Once more against n: nearly parallel vectors leave a cross product of few digits.
        t = vx * nx + vy * ny + vz * nz
        vx, vy, vz = vx - t * nx, vy - t * ny, vz - t * nz
        t = 1.0 / sqrt(vx * vx + vy * vy + vz * vz)
        ux, uy, uz = t * (vy * nz - vz * ny), t * (vz * nx - vx * nz), t * (vx * ny - vy * nx)
        vx, vy, vz = t * vx, t * vy, t * vz
        length_b[b] = length
        _put3(frame_at + 72 * b, nx, ny, nz)
        _put3(frame_at + 72 * b + 24, ux, uy, uz)
        _put3(frame_at + 72 * b + 48, vx, vy, vz)
        t = 1.0 / length
        _along(map_at + 96 * b, t * nx, t * ny, t * nz, steps, d0, d1, d2)
        _along(map_at + 96 * b + 8, t * ux, t * uy, t * uz, steps, d0, d1, d2)
        _along(map_at + 96 * b + 16, t * vx, t * vy, t * vz, steps, d0, d1, d2)
    return longest


def lattice_bonds(
    # 12 numbers a bond: the change of (D, Y, M) from one point to the next along each axis of the lattice, and (D, Y,
    # M) of the point nearest to x_i
    map_bk,
    end_bk,  # lattice coordinates of x_i − nearest point, and of r: two numbers each
    base_ba,  # index of the nearest point
    length_b,
    r_bc,
    frame_bcc,  # rows n, u, v: what D, Y, M are along
    b_bk,  # components filled up with zeros to a multiple of four
    radii_m,
    coef_mk,
    reach,  # how far a ball of radius 1 reaches in lattice coordinates, as a tuple
    shape,
    wrap,  # whether an axis of the lattice closes on itself through the periodic cell
    acc,  # flat: rows × ext × components
    ext,
    # buffers: of rows D, Y, M, first point, number of points, place and row in the accumulator, lists of short and long
    # ones, ..
    row_15j,
    k_,  # buffer for the constants of β
):
    """Σ_b b β at every point, added to `acc`. Returns the number of (bond, point) pairs visited."""
    n0, n1, n2 = shape
    wrap0, wrap1, wrap2 = wrap
    reach0, reach1, _ = reach
    n_comp = b_bk.shape[1]
    stride = n_comp * ext
    quads = n_comp // 4
    most = row_15j.shape[1]
    D_at = address(row_15j)
    Y_at = D_at + 8 * most
    M_at = Y_at + 8 * most
    first_at = M_at + 8 * most
    count_at = first_at + 8 * most
    at_at = count_at + 8 * most
    row_at = at_at + 8 * most
    short_at = row_at + 8 * most
    long_at = short_at + 8 * most
    # The second index of the rows of a plane, the same for every plane.
    column_at = long_at + 8 * most
    to_at = column_at + 8 * most
    beta_at = to_at + 8 * most
    acc_at, k_at, end_at, base_at = address(acc), address(k_), address(end_bk), address(base_ba)
    visits = 0
    for b in range(len(length_b)):
        b_at = address(b_bk) + 8 * n_comp * b
        map_at = address(map_bk) + 96 * b
        f0, f1, e0, e1 = peek(end_at, 4 * b), peek(end_at, 4 * b + 1), peek(end_at, 4 * b + 2), peek(end_at, 4 * b + 3)
        base0, base1, base2 = peek_int(base_at, 3 * b), peek_int(base_at, 3 * b + 1), peek_int(base_at, 3 * b + 2)
        k_lo = -1e18 if wrap2 else float(-base2)
        k_hi = 1e18 if wrap2 else float(n2 - 1 - base2)
        D2, Y2 = peek(map_at, 6), peek(map_at, 7)
        length = length_b[b]
        for m in range(len(radii_m)):
            R = radii_m[m]
            CONSTANTS(length, R, coef_mk, m, r_bc, frame_bcc, b, k_)
            i = ceil(f0 - greater(e0, 0.0) - R * reach0 - 1e-9)
            i_hi = floor(f0 - lesser(e0, 0.0) + R * reach0 + 1e-9)
            j_lo = ceil(f1 - greater(e1, 0.0) - R * reach1 - 1e-9)
            j_hi = floor(f1 - lesser(e1, 0.0) + R * reach1 + 1e-9)
            if not wrap0:
                i = greater(i, -base0)
                i_hi = lesser(i_hi, n0 - 1 - base0)
            if not wrap1:
                j_lo = greater(j_lo, -base1)
                j_hi = lesser(j_hi, n1 - 1 - base1)
            for j in range(j_lo, j_hi + 1):
                poke(column_at, j - j_lo, float(folded(base1 + j, n1) if wrap1 else base1 + j))
            while i <= i_hi and j_lo <= j_hi:
                rows, i = rows_of_planes(
                    i,
                    i_hi,
                    j_lo,
                    j_hi - j_lo + 1,
                    most,
                    base0,
                    n0,
                    n1,
                    wrap0,
                    map_at,
                    column_at,
                    D_at,
                    Y_at,
                    M_at,
                    row_at,
                )
                short, long, points = chords(
                    rows, D_at, Y_at, M_at, (R / length) * (R / length), D2, Y2, k_lo, k_hi,
                    base2, n2, wrap2, first_at, count_at, at_at, short_at, long_at,
                )  # fmt: skip
                visits += points
                # All β first and all sums after: two loops the processor can overlap better than one.
                # Not the literal 0, for which `add` would be compiled once more.
                n_runs = int64(0)
                for t in range(short):
                    j = peek_int(short_at, t)
                    k = peek(first_at, j)
                    beta = BETA(
                        ramp4(peek(D_at, j) + k * D2, D2),
                        ramp4(peek(Y_at, j) + k * Y2, Y2),
                        splat4(peek(M_at, j)),
                        k_at,
                    )
                    store4(beta_at, 4 * n_runs, beta)
                    poke_int(to_at, n_runs, int64(peek(row_at, j)) * stride + int64(peek(at_at, j)) * n_comp)
                    n_runs += 1
                for t in range(long):
                    j = peek_int(long_at, t)
                    k = peek(first_at, j)
                    left = int64(peek(count_at, j))
                    at = int64(peek(at_at, j))
                    while left > 0:
                        # Once, unless the chord is longer than what the row of the accumulator or the buffer has to
                        # spare.
                        runs = lesser(lesser((left + 3) >> 2, (ext - at) >> 2), most - n_runs)
                        to = int64(peek(row_at, j)) * stride + at * n_comp
                        for _ in range(runs):
                            beta = BETA(
                                ramp4(peek(D_at, j) + k * D2, D2),
                                ramp4(peek(Y_at, j) + k * Y2, Y2),
                                splat4(peek(M_at, j)),
                                k_at,
                            )
                            store4(beta_at, 4 * n_runs, beta)
                            poke_int(to_at, n_runs, to)
                            n_runs += 1
                            k += 4.0
                            to += 4 * n_comp
                        left -= 4 * runs
                        at += 4 * runs
                        if left > 0:
                            if wrap2:
                                at %= n2
                            if n_runs == most:
                                add(acc_at, to_at, beta_at, n_runs, quads, b_at)
                                n_runs = int64(0)
                add(acc_at, to_at, beta_at, n_runs, quads, b_at)
    return visits
