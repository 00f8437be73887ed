"""Bare kernel of the weighted virials: arrays only."""

from math import floor, sqrt

from numba import njit

_OPTIONS = {"cache": True, "nogil": True, "error_model": "numpy"}


@njit(**_OPTIONS)
def _run(first, last, p_gc, t0, t1, t2, x0, x1, x2, y0, y1, y2, far2, near2, half, f0, f1, f2, scale_m, acc_gk):
    """The points first .. last−1, moved by t, for one bond from x to y; `half` is half its length, f minus the force on x."""
    for g in range(first, last):
        px = p_gc[g, 0] + t0
        py = p_gc[g, 1] + t1
        pz = p_gc[g, 2] + t2
        a0 = x0 - px
        a1 = x1 - py
        a2 = x2 - pz
        b0 = y0 - px
        b1 = y1 - py
        b2 = y2 - pz
        a = a0 * a0 + a1 * a1 + a2 * a2
        b = b0 * b0 + b1 * b1 + b2 * b2
        if a > far2 or b > far2:
            continue
        a = half / sqrt(a) if a > near2 else 0.0
        b = half / sqrt(b) if b > near2 else 0.0
        w0 = a * a0 - b * b0
        w1 = a * a1 - b * b1
        w2 = a * a2 - b * b2
        for m in range(len(scale_m)):
            s = scale_m[m]
            k = 9 * m
            v = s * w0
            acc_gk[g, k] += v * f0
            acc_gk[g, k + 1] += v * f1
            acc_gk[g, k + 2] += v * f2
            v = s * w1
            acc_gk[g, k + 3] += v * f0
            acc_gk[g, k + 4] += v * f1
            acc_gk[g, k + 5] += v * f2
            v = s * w2
            acc_gk[g, k + 6] += v * f0
            acc_gk[g, k + 7] += v * f1
            acc_gk[g, k + 8] += v * f2


@njit(**_OPTIONS)
def _range(a, x, y, reach, middle, inverse_ca, low_a, scale_a, bins_a, periodic):
    """The bins along axis a that can hold points within `reach` of both x and y (given along the axis), hence within `middle` of their middle."""
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
    x_bc, r_bc, F_bc, d_b, scale_bm, far, near, p_gc, start_w, bins_a, low_a, scale_a, periodic_a, cell_ac, inverse_ca, acc_gk,
):  # fmt: skip
    """Σ_b −½ |r| (ê_i − ê_j)⊗F · scale at every point within `far` of both ends, images included; row-major, one block of nine for each column of scale."""
    far2 = far * far
    near2 = near * near
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
                    if last > first:
                        _run(
                            first, last, p_gc,
                            m0 * cell_ac[0, 0] + m1 * cell_ac[1, 0] + m2 * cell_ac[2, 0],
                            m0 * cell_ac[0, 1] + m1 * cell_ac[1, 1] + m2 * cell_ac[2, 1],
                            m0 * cell_ac[0, 2] + m1 * cell_ac[1, 2] + m2 * cell_ac[2, 2],
                            x0, x1, x2, y0, y1, y2, far2, near2, 0.5 * d,
                            -F_bc[b, 0], -F_bc[b, 1], -F_bc[b, 2], scale_bm[b], acc_gk,
                        )  # fmt: skip
                    c2 += count
