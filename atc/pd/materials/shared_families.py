"""Sums over the families that bonds share with a node's other bonds, for `bond_associated`.

The bonds of a node stand in an order that goes to and fro through its family, row by row, so that the bonds near one of
them, a part of the family, are few runs of this order: 10 for 55 bonds on a lattice at three spacings. What a bond's
family adds up to is then a difference of running sums at the ends of each run. The order is one of speed alone: in any
cloud of nodes the runs are exactly the bonds that are near.

A node's bonds are its *ends*: 2b at i and 2b + 1 at j of bond b; ``first`` says where those of each node begin among
``end``, and local numbers count from there.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...simd import address, load4, splat4, store4
from ..bonds import JIT
from ..lanes import INLINE, C

#: Numbers of a row of a running sum: three rows of three, each with room for four.
_ROW = 12
#: Columns of the law's work, each of C numbers: Σ or V w P K⁻¹ (9), K⁻¹ (6), w, W.
_COLUMNS = 17


def order(nodes_e, xi_ec, spacing):
    """The order of the ends: by their node, then to and fro through its family. xi_ec : (2b, 3), bonds seen from their
    node."""
    c = np.rint(xi_ec / spacing).astype(np.int64)
    y = np.where(c[:, 2] % 2 == 0, c[:, 1], -c[:, 1])
    x = np.where((c[:, 1] + c[:, 2]) % 2 == 0, xi_ec[:, 0], -xi_ec[:, 0])
    return np.lexsort((x, y, c[:, 2], nodes_e))


@njit(**INLINE)
def family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a):
    """ξ, η and weights (0 of broken ones) of node i's bonds, seen from it. Returns how many."""
    m = first[i + 1] - first[i]
    for k in range(m):
        b = end[first[i] + k] >> 1
        sign = 1.0 if end[first[i] + k] & 1 == 0 else -1.0
        p, q = i_b[b], j_b[b]
        for c in range(3):
            x = z[q, 3 + c] - z[p, 3 + c]
            e = z[q, c] - z[p, c]
            if len(image):
                x += images[image[b], c]
                e += images[image[b], 3 + c]
            xi[k, c] = sign * x
            eta[k, c] = sign * e
        a[k] = W[b] if intact[b] != 0 else 0.0
    return m


@njit(**INLINE)
def _near(xi, j, k, reach2):
    """Whether the ends of two bonds of a node are within each other's horizon."""
    x = xi[j, 0] - xi[k, 0]
    y = xi[j, 1] - xi[k, 1]
    z = xi[j, 2] - xi[k, 2]
    return x * x + y * y + z * z <= reach2


@njit(**JIT)
def find_runs(lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, where, runs, reach2, count):
    """How many runs each end of these nodes' bonds has, into `where`; or, without `count`, the runs from there on."""
    xi, eta, a = np.empty((most, 3)), np.empty((most, 3)), np.empty(most)
    for n in range(lo, hi):
        i = nodes[n]
        m = family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for j in range(m):
            r = np.int64(0) if count else where[first[i] + j]
            inside = False
            for k in range(m):
                near = _near(xi, j, k, reach2)
                if near != inside:
                    if not count:
                        runs[r, 0 if near else 1] = k
                    if not near:
                        r += 1
                    inside = near
            if inside:
                if not count:
                    runs[r, 1] = m
                r += 1
            if count:
                where[first[i] + j] = r


@njit(**JIT)
def moments(lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, where, runs, K):
    """K (xx yy zz yz xz xy) at all ends of these nodes' bonds."""
    xi, eta, a = np.empty((most, 3)), np.empty((most, 3)), np.empty(most)
    for n in range(lo, hi):
        i = nodes[n]
        m = family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for j in range(m):
            e = first[i] + j
            for c in range(6):
                K[c, e] = 0.0
            for q in range(where[e], where[e + 1]):
                for k in range(runs[q, 0], runs[q, 1]):
                    x, y, s = a[k] * xi[k, 0], a[k] * xi[k, 1], a[k] * xi[k, 2]
                    K[0, e] += x * xi[k, 0]
                    K[1, e] += y * xi[k, 1]
                    K[2, e] += s * xi[k, 2]
                    K[3, e] += y * xi[k, 2]
                    K[4, e] += x * xi[k, 2]
                    K[5, e] += x * xi[k, 1]


@njit(**INLINE)
def _over(runs, q0, q1, sums, out):
    """The sum over runs q0 to q1 of rows whose running sums are `sums`, into `out`; both addresses."""
    s = splat4(0.0)
    t = splat4(0.0)
    u = splat4(0.0)
    for q in range(q0, q1):
        a = _ROW * np.int64(runs[q, 0])
        b = _ROW * np.int64(runs[q, 1])
        s = s + (load4(sums, b) - load4(sums, a))
        t = t + (load4(sums, b + 4) - load4(sums, a + 4))
        u = u + (load4(sums, b + 8) - load4(sums, a + 8))
    store4(out, 0, s)
    store4(out, 4, t)
    store4(out, 8, u)


@njit(**INLINE)
def _saint_venant(m, w, lam, mu, V):
    """Columns of w: of Σ ω η⊗ξ, K⁻¹ and the bond's share become V share P K⁻¹ and share W, for S = λ tr(E) + 2μE,
    P = F S."""
    for k in range(m):
        xx = w[9 * C + k]
        yy = w[10 * C + k]
        zz = w[11 * C + k]
        yz = w[12 * C + k]
        xz = w[13 * C + k]
        xy = w[14 * C + k]
        a0 = w[k] * xx + w[C + k] * xy + w[2 * C + k] * xz
        a1 = w[k] * xy + w[C + k] * yy + w[2 * C + k] * yz
        a2 = w[k] * xz + w[C + k] * yz + w[2 * C + k] * zz
        b0 = w[3 * C + k] * xx + w[4 * C + k] * xy + w[5 * C + k] * xz
        b1 = w[3 * C + k] * xy + w[4 * C + k] * yy + w[5 * C + k] * yz
        b2 = w[3 * C + k] * xz + w[4 * C + k] * yz + w[5 * C + k] * zz
        c0 = w[6 * C + k] * xx + w[7 * C + k] * xy + w[8 * C + k] * xz
        c1 = w[6 * C + k] * xy + w[7 * C + k] * yy + w[8 * C + k] * yz
        c2 = w[6 * C + k] * xz + w[7 * C + k] * yz + w[8 * C + k] * zz
        exx = a0 + 0.5 * (a0 * a0 + b0 * b0 + c0 * c0)
        eyy = b1 + 0.5 * (a1 * a1 + b1 * b1 + c1 * c1)
        ezz = c2 + 0.5 * (a2 * a2 + b2 * b2 + c2 * c2)
        eyz = 0.5 * (b2 + c1 + a1 * a2 + b1 * b2 + c1 * c2)
        exz = 0.5 * (a2 + c0 + a0 * a2 + b0 * b2 + c0 * c2)
        exy = 0.5 * (a1 + b0 + a0 * a1 + b0 * b1 + c0 * c1)
        trace = exx + eyy + ezz
        share = w[15 * C + k]
        square = exx * exx + eyy * eyy + ezz * ezz + 2.0 * (eyz * eyz + exz * exz + exy * exy)
        w[16 * C + k] = share * (0.5 * lam * trace * trace + mu * square)
        scale = share * V
        pressure = scale * lam * trace
        exx = 2.0 * mu * scale * exx + pressure
        eyy = 2.0 * mu * scale * eyy + pressure
        ezz = 2.0 * mu * scale * ezz + pressure
        eyz = 2.0 * mu * scale * eyz
        exz = 2.0 * mu * scale * exz
        exy = 2.0 * mu * scale * exy
        p0 = exx + a0 * exx + a1 * exy + a2 * exz
        p1 = exy + a0 * exy + a1 * eyy + a2 * eyz
        p2 = exz + a0 * exz + a1 * eyz + a2 * ezz
        w[k] = p0 * xx + p1 * xy + p2 * xz
        w[C + k] = p0 * xy + p1 * yy + p2 * yz
        w[2 * C + k] = p0 * xz + p1 * yz + p2 * zz
        p0 = exy + b0 * exx + b1 * exy + b2 * exz
        p1 = eyy + b0 * exy + b1 * eyy + b2 * eyz
        p2 = eyz + b0 * exz + b1 * eyz + b2 * ezz
        w[3 * C + k] = p0 * xx + p1 * xy + p2 * xz
        w[4 * C + k] = p0 * xy + p1 * yy + p2 * yz
        w[5 * C + k] = p0 * xz + p1 * yz + p2 * zz
        p0 = exz + c0 * exx + c1 * exy + c2 * exz
        p1 = eyz + c0 * exy + c1 * eyy + c2 * eyz
        p2 = ezz + c0 * exz + c1 * eyz + c2 * ezz
        w[6 * C + k] = p0 * xx + p1 * xy + p2 * xz
        w[7 * C + k] = p0 * xy + p1 * yy + p2 * yz
        w[8 * C + k] = p0 * xz + p1 * yz + p2 * zz


@njit(**JIT)
def states(
    lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, where, runs, inverse, share, lam, mu, V,
    pull, U, T,
):  # fmt: skip
    """U of these nodes; with `pull` T = V ω A ξ at their ends of bonds."""
    xi, eta, a = np.empty((most, 3)), np.empty((most, 3)), np.empty(most)
    # Running sums of ω η⊗ξ, and of V w P K⁻¹.
    sums, pulls = np.zeros((most + 1) * _ROW), np.zeros((most + 1) * _ROW)
    row, w = np.zeros(_ROW), np.zeros(_COLUMNS * C)
    at_sums, at_pulls, at_row = address(sums), address(pulls), address(row)
    for n in range(lo, hi):
        i = nodes[n]
        m = family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for k in range(m):
            s = _ROW * (k + 1)
            x, y, v = a[k] * xi[k, 0], a[k] * xi[k, 1], a[k] * xi[k, 2]
            for r in range(3):
                sums[s + 4 * r] = sums[s + 4 * r - _ROW] + eta[k, r] * x
                sums[s + 4 * r + 1] = sums[s + 4 * r + 1 - _ROW] + eta[k, r] * y
                sums[s + 4 * r + 2] = sums[s + 4 * r + 2 - _ROW] + eta[k, r] * v
        energy = 0.0
        for j0 in range(0, m, C):
            e0, count = first[i] + j0, min(C, m - j0)
            for k in range(count):
                _over(runs, where[e0 + k], where[e0 + k + 1], at_sums, at_row)
                for r in range(3):
                    for c in range(3):
                        w[(3 * r + c) * C + k] = row[4 * r + c]
            for c in range(6):
                for k in range(count):
                    w[(9 + c) * C + k] = inverse[c, e0 + k]
            for k in range(count):
                w[15 * C + k] = share[e0 + k]
            _saint_venant(count, w, lam[i], mu[i], V[i])
            for k in range(count):
                energy += w[16 * C + k]
            for k in range(count):
                s = _ROW * (j0 + k + 1)
                for r in range(3):
                    for c in range(3):
                        pulls[s + 4 * r + c] = pulls[s + 4 * r + c - _ROW] + w[(3 * r + c) * C + k]
        U[i] = V[i] * energy
        if pull:
            for k in range(m):
                out = end[first[i] + k]
                e = first[i] + k
                _over(runs, where[e], where[e + 1], at_pulls, at_row)
                x, y, v = a[k] * xi[k, 0], a[k] * xi[k, 1], a[k] * xi[k, 2]
                for r in range(3):
                    T[out, r] = row[4 * r] * x + row[4 * r + 1] * y + row[4 * r + 2] * v


@njit(**JIT)
def stiff_rows(
    lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, where, runs, inverse, share, own, across,
    modulus,
):  # fmt: skip
    """Shares of these nodes' energies in the row sums of the stiffness: in their own rows, and by ends in others'."""
    xi, eta, a, g = np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.empty(most)
    v, mine = np.empty(3), np.empty(3)
    for n in range(lo, hi):
        i = nodes[n]
        m = family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for k in range(m):
            across[end[first[i] + k]] = 0.0
        for j in range(m):
            e = first[i] + j
            w = share[e] * modulus[i]
            if w == 0.0:
                continue
            xx, yy, zz, yz, xz, xy = (
                inverse[0, e], inverse[1, e], inverse[2, e], inverse[3, e], inverse[4, e], inverse[5, e],
            )  # fmt: skip
            mine[:] = 0.0
            total = 0.0
            for q in range(where[e], where[e + 1]):
                for k in range(runs[q, 0], runs[q, 1]):
                    v[0] = a[k] * (xx * xi[k, 0] + xy * xi[k, 1] + xz * xi[k, 2])
                    v[1] = a[k] * (xy * xi[k, 0] + yy * xi[k, 1] + yz * xi[k, 2])
                    v[2] = a[k] * (xz * xi[k, 0] + yz * xi[k, 1] + zz * xi[k, 2])
                    for c in range(3):
                        mine[c] += v[c]
                    g[k] = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
                    total += g[k]
            size = np.sqrt(mine[0] * mine[0] + mine[1] * mine[1] + mine[2] * mine[2])
            total += size
            own[i] += w * size * total
            for q in range(where[e], where[e + 1]):
                for k in range(runs[q, 0], runs[q, 1]):
                    across[end[first[i] + k]] += w * g[k] * total
