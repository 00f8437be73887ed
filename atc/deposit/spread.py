"""Spreading points of bonds onto a mesh, and reading a mesh off at points: the loops of the spectral deposit.

The mesh is [x][y][z][components], components padded to whole vectors of four and one window's halo wider than the cell, so that no index wraps.
`WIDTH` nodes of the window along each axis, `VECTORS` vectors of four components, `GROUPS` = ⌈WIDTH/4⌉: set by `specialise`.
"""

from __future__ import annotations

from math import ceil, floor, sqrt

import numba as nb

from ._simd import INLINE, axpy4, load4, splat4, store4

WIDTH, VECTORS, GROUPS = 4, 2, 1


@nb.njit(**INLINE)
def weights(fx, fy, fz, coef, win, groups):
    """The window's values along the three axes: win[0:], win[4 groups:], win[8 groups:]."""
    pad = 4 * groups
    top = len(coef) // pad - 1
    for g in range(groups):
        o = 4 * g
        c = load4(coef, top * pad + o)
        px, py, pz = c, c, c
        for d in range(top - 1, -1, -1):
            c = load4(coef, d * pad + o)
            px = px * fx + c
            py = py * fy + c
            pz = pz * fz + c
        store4(win, o, px)
        store4(win, pad + o, py)
        store4(win, 2 * pad + o, pz)


@nb.njit(**INLINE)
def first_node(u, n, half, offset):
    """Array index of the first node in reach of u (mesh spacings, any image) and its distance above the window's lower end."""
    v = u - n * floor(u / n) - half + offset
    i = int(v) + 1
    return i, i - v


def spread_bonds(x_nc, i_b, r_bc, b_bk, to_mesh, counts, is_open, longest, nodes, node_weights, coef, acc, win, vz):
    """acc += Σ over bonds, their Gauss points and the nodes in reach of b × weight × window. Returns the number of points.

    to_mesh (3, 3): positions and bond vectors to mesh spacings. Points off the mesh along open axes are left out.
    """
    half, offset, pad = 0.5 * WIDTH, (WIDTH + 1) // 2, 4 * GROUPS
    n0, n1, n2 = float(counts[0]), float(counts[1]), float(counts[2])
    stride1 = (counts[2] + WIDTH + 1) * 4 * VECTORS
    stride0 = (counts[1] + WIDTH + 1) * stride1
    n_comp, most = b_bk.shape[1], len(longest)
    t00, t01, t02 = to_mesh[0, 0], to_mesh[0, 1], to_mesh[0, 2]
    t10, t11, t12 = to_mesh[1, 0], to_mesh[1, 1], to_mesh[1, 2]
    t20, t21, t22 = to_mesh[2, 0], to_mesh[2, 1], to_mesh[2, 2]
    open0, open1, open2 = is_open[0], is_open[1], is_open[2]
    total = 0
    for b in range(len(i_b)):
        i = i_b[b]
        x, y, z = x_nc[i, 0], x_nc[i, 1], x_nc[i, 2]
        rx, ry, rz = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        u0, u1, u2 = x * t00 + y * t10 + z * t20, x * t01 + y * t11 + z * t21, x * t02 + y * t12 + z * t22
        d0, d1, d2 = rx * t00 + ry * t10 + rz * t20, rx * t01 + ry * t11 + rz * t21, rx * t02 + ry * t12 + rz * t22
        length = sqrt(rx * rx + ry * ry + rz * rz)
        m = 0
        while m < most - 1 and length > longest[m]:
            m += 1
        pieces = 1 if length <= longest[m] else ceil(length / longest[m])
        share = 1.0 / pieces
        for piece in range(pieces):
            for q in range(m + 1):
                t = (piece + nodes[m, q]) * share
                p0, p1, p2 = u0 - t * d0, u1 - t * d1, u2 - t * d2
                if (open0 and not 0.0 <= p0 < n0) or (open1 and not 0.0 <= p1 < n1) or (open2 and not 0.0 <= p2 < n2):
                    continue
                i0, f0 = first_node(p0, n0, half, offset)
                i1, f1 = first_node(p1, n1, half, offset)
                i2, f2 = first_node(p2, n2, half, offset)
                weights(f0, f1, f2, coef, win, GROUPS)
                w = node_weights[m, q] * share
                for k in range(n_comp):
                    vz[k] = b_bk[b, k] * w
                for g in range(VECTORS):
                    v = load4(vz, 4 * g)
                    for c in range(WIDTH):
                        store4(vz, 4 * (VECTORS * (c + 1) + g), v * win[2 * pad + c])
                for a in range(WIDTH):
                    for e in range(WIDTH):
                        s = win[a] * win[pad + e]
                        o = (i0 + a) * stride0 + (i1 + e) * stride1 + i2 * 4 * VECTORS
                        for c in range(WIDTH * VECTORS):
                            axpy4(acc, o + 4 * c, s, load4(vz, 4 * (VECTORS + c)))
                total += 1
    return total


def gather_points(u_gc, counts, coef, mesh, win, out_gk):
    """out[g] = Σ over the nodes in reach of u_g (mesh spacings) of window × mesh, first components of each node."""
    half, offset, pad = 0.5 * WIDTH, (WIDTH + 1) // 2, 4 * GROUPS
    n0, n1, n2 = float(counts[0]), float(counts[1]), float(counts[2])
    stride1 = (counts[2] + WIDTH + 1) * 4 * VECTORS
    stride0 = (counts[1] + WIDTH + 1) * stride1
    for p in range(len(u_gc)):
        i0, f0 = first_node(u_gc[p, 0], n0, half, offset)
        i1, f1 = first_node(u_gc[p, 1], n1, half, offset)
        i2, f2 = first_node(u_gc[p, 2], n2, half, offset)
        weights(f0, f1, f2, coef, win, GROUPS)
        for g in range(VECTORS):
            total = splat4(0.0)
            for a in range(WIDTH):
                for e in range(WIDTH):
                    s = win[a] * win[pad + e]
                    o = (i0 + a) * stride0 + (i1 + e) * stride1 + i2 * 4 * VECTORS + 4 * g
                    line = splat4(0.0)
                    for c in range(WIDTH):
                        line = line + load4(mesh, o + 4 * VECTORS * c) * win[2 * pad + c]
                    total = total + line * s
            store4(out_gk, 4 * (VECTORS * p + g), total)
