"""Spreading points of bonds onto a mesh: the loops of the spectral deposit.

The mesh is [x][y][z][components], components padded to four or eight. On periodic axes it is one window's halo wider
than the cell, so that no index wraps. What is done at one point is written as LLVM instructions for each width of the
window: the products of weights and components stay in registers, and no loop is short. Memory goes by address there;
`spread_bonds` owns the arrays and the bounds.

In two dimensions the mesh is one layer, of which every point takes all along z (DEPTH 1).

In single precision a mesh takes half the time and half the memory; its sums have to stay short (`SpectralDeposit` moves
them on).
"""

from __future__ import annotations

from functools import cache
from math import ceil, floor, frexp, sqrt

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ..compiled import njit
from ..simd import ENTRY, INLINE, specialise

# Set by `core` and `row_core`: nodes of the window along x and y, and along z (as many, or 1), components, type of the
# mesh, and what is done at a point.
WIDTH, DEPTH, LANES, REAL, SPREAD = 4, 4, 8, np.float64, None

_DOUBLE, _FLOAT, _INT64, _INT32 = ir.DoubleType(), ir.FloatType(), ir.IntType(64), ir.IntType(32)

# A bond's share of the field decides how well it is integrated, in steps of two: the loosest and strictest are
# 2^±LEVELS times the tolerance.
LEVELS = 24
# Bonds stronger than 2^STRONG times the mean are strong ones.
STRONG = 4


@intrinsic
def begin(typingctx, array):
    """The address of a contiguous array."""

    def codegen(context, builder, sig, args):
        return builder.ptrtoint(context.make_array(sig.args[0])(context, builder, args[0]).data, _INT64)

    return types.int64(array), codegen


def _spreader(width, lanes, degree, real, depth):
    """An intrinsic: (mesh, first node's offset, strides of x and y, distances along x, y, z, coefficients, components,
    scratch) -> nothing.

    Coefficients: (degree + 1, 4⌈width/4⌉) of the window in powers of the distance; scratch: room for 8⌈width/4⌉
    numbers.
    """
    assert depth in (1, width)
    pad = 4 * ((width + 3) // 4)
    number = _FLOAT if real == np.float32 else _DOUBLE
    size = 4 if real == np.float32 else 8
    row, node = ir.VectorType(number, pad), ir.VectorType(number, lanes)

    def codegen(context, builder, sig, args):
        mesh, offset, stride0, stride1, fx, fy, fz, coef, values, scratch = args
        contract = ("contract",)

        def place(base, index, kind):
            index = ir.Constant(_INT64, index) if isinstance(index, int) else index
            return builder.bitcast(builder.gep(builder.inttoptr(base, number.as_pointer()), [index]), kind.as_pointer())

        def load(base, index, kind):
            return builder.load(place(base, index, kind), align=size)

        def pick(vector, kind, k):
            """Lane k of a vector, all over another one."""
            undefined = ir.Constant(vector.type, ir.Undefined)
            return builder.shuffle_vector(
                vector, undefined, ir.Constant(ir.VectorType(_INT32, kind.count), [k] * kind.count)
            )

        def splat(x, kind):
            return pick(builder.insert_element(ir.Constant(kind, ir.Undefined), x, ir.Constant(_INT32, 0)), kind, 0)

        def times_plus(a, b, c):
            return builder.fadd(builder.fmul(a, b, flags=contract), c, flags=contract)

        # Horner's scheme, three axes at a time.
        f = [splat(builder.fptrunc(x, number) if size == 4 else x, row) for x in (fx, fy, fz)]
        p = [load(coef, degree * pad, row)] * 3
        for d in range(degree - 1, -1, -1):
            c = load(coef, d * pad, row)
            p = [times_plus(p[k], f[k], c) for k in range(3)]
        for k in range(2):
            builder.store(p[k], place(scratch, k * pad, row), align=size)
        v = load(values, 0, node)
        vz = [builder.fmul(pick(p[2], node, c), v, flags=contract) for c in range(width)] if depth > 1 else [v]
        end = ir.Constant(_INT64, width)
        with cgutils.for_range(builder, end) as a:
            wx = builder.load(place(scratch, a.index, number))
            plane = builder.add(offset, builder.mul(a.index, stride0))
            for e in range(width):
                wy = builder.load(place(scratch, pad + e, number))
                s = splat(builder.fmul(wx, wy), node)
                at = builder.add(plane, builder.mul(ir.Constant(_INT64, e), stride1))
                for c, x in enumerate(vz):
                    to = place(mesh, builder.add(at, ir.Constant(_INT64, lanes * c)), node)
                    builder.store(times_plus(s, x, builder.load(to, align=size)), to, align=size)
        return context.get_dummy_value()

    @intrinsic
    def spread(typingctx, mesh, offset, stride0, stride1, fx, fy, fz, coef, values, scratch):
        i, f = types.int64, types.float64
        return types.void(i, i, i, i, f, f, f, i, i, i), codegen

    return spread


def aligned(size, dtype):
    """Zeros that begin at a cache line, which numpy does not promise."""
    step = np.dtype(dtype).itemsize
    raw = np.zeros(size + 64 // step, dtype)
    skip = (-raw.ctypes.data % 64) // step
    return raw[skip : skip + size]


def row_length(count, bytes_each):
    """Nodes from one row along z to the next, at least `count`, so that neighbouring rows do not lie nearly a multiple
    of 4096 bytes apart.

    Processors tell a load from the stores before it by the last 12 bits of their addresses: where rows look alike, each
    node waits for one of the row before, and spreading takes up to four times as long.
    """
    row = int(count)
    while min(row * bytes_each % 4096, -row * bytes_each % 4096) < 256:
        row += 1
    return row


@cache
def core(width, lanes, degree, real, depth):
    """`spread_bonds` for a window, a number of components and a precision."""
    tag = f"{width}_{lanes}_{degree}_{np.dtype(real).name}" + "_plane" * (depth == 1)
    make = _spreader(width, lanes, degree, real, depth)
    return specialise(spread_bonds, tag, WIDTH=width, DEPTH=depth, LANES=lanes, REAL=real, SPREAD=make)


@njit(**INLINE)
def first_node(u, n, inverse, half, low):
    """Array index of the first node in reach of u (mesh spacings; of any image, where n > 0) and its distance above the
    window's lower end."""
    v = u - n * floor(u * inverse) - half - low
    i = int(v) + 1
    return i, i - v


@njit(**ENTRY)
def survey(x_nc, i_b, r_bc, b_bk, origin, to_mesh, bounded):
    """What is to come: least and greatest mesh coordinate along each axis (2, 3) if `bounded`, mean |b| of each column,
    greatest |b|, and whether all numbers are finite.
    """
    n_comp = b_bk.shape[1]
    bounds, mean = np.empty((2, 3)), np.zeros(n_comp)
    bounds[0], bounds[1] = np.inf, -np.inf
    most, check = 0.0, 0.0
    for b in range(len(i_b)):
        i = i_b[b]
        x, y, z = x_nc[i, 0] - origin[0], x_nc[i, 1] - origin[1], x_nc[i, 2] - origin[2]
        rx, ry, rz = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        # A sum of numbers that are not finite is none, whatever they are.
        check += 0.0 * (x + y + z + rx + ry + rz)
        if bounded:
            for a in range(3):
                u = x * to_mesh[0, a] + y * to_mesh[1, a] + z * to_mesh[2, a]
                v = u - (rx * to_mesh[0, a] + ry * to_mesh[1, a] + rz * to_mesh[2, a])
                bounds[0, a] = min(bounds[0, a], u, v)
                bounds[1, a] = max(bounds[1, a], u, v)
        for k in range(n_comp):
            size = abs(b_bk[b, k])
            mean[k] += size
            most = size if size > most else most
    for k in range(n_comp):
        check += 0.0 * mean[k]
    return bounds, mean / max(1, len(i_b)), most, check == 0.0


def spread_bonds(
    x_nc,
    i_b,
    r_bc,
    b_bk,
    origin,
    to_mesh,
    period,
    low,
    counts,
    row,
    weight_k,
    slack,
    longest,
    nodes,
    node_weights,
    coef,
    inverse_scale,
    mesh,
    rows,
):
    """mesh += Σ over bonds, their Gauss points and the nodes in reach of b × weight × window. Returns the number of
    points. All numbers are finite.

    Parameters
    ----------
    origin, to_mesh (3, 3) : positions relative to the origin, and bond vectors, to mesh spacings
    period : (3,) nodes of periodic axes; 0 on open ones, where points out of the mesh are left out
    low, counts : (3,) the node that comes first in the mesh, and how many there are (with the halo)
    row : nodes from one row along z to the next
    weight_k : (k,) one over the mean |b| of a column: strong bonds are integrated better than weak ones
    slack : what weight_k has been made smaller by, as a power of two. Bonds stronger than 2^STRONG times the mean all
        get the strictest rule: then their
        points do not depend on the bonds they come with, and they can be taken out again without a trace
        (`SpectralDeposit.add_strong`)
    longest, nodes, node_weights : (2 LEVELS + 1, m), (m, m), (m, m): Gauss-Legendre rules on [0, 1], and the longest
        bond that each does for
        when the error may be 2^(level − LEVELS) times the tolerance
    inverse_scale : the mesh holds b times this
    rows : (x, y) gets 1 where the first row that a point reaches is
    """
    half = 0.5 * WIDTH
    n0, n1, n2 = float(period[0]), float(period[1]), float(period[2])
    inverse0, inverse1, inverse2 = (
        1.0 / n0 if n0 > 0.0 else 0.0,
        1.0 / n1 if n1 > 0.0 else 0.0,
        1.0 / n2 if n2 > 0.0 else 0.0,
    )
    low0, low1, low2 = float(low[0]), float(low[1]), float(low[2])
    # One node's distance to spare, as in the halo.
    last0, last1, last2 = counts[0] - WIDTH, counts[1] - WIDTH, counts[2] - WIDTH
    if DEPTH == 1:
        last2 = 1
    stride1 = row * LANES
    stride0 = counts[1] * stride1
    n_comp, most = b_bk.shape[1], longest.shape[1]
    o0, o1, o2 = origin[0], origin[1], origin[2]
    t00, t01, t02 = to_mesh[0, 0], to_mesh[0, 1], to_mesh[0, 2]
    t10, t11, t12 = to_mesh[1, 0], to_mesh[1, 1], to_mesh[1, 2]
    t20, t21, t22 = to_mesh[2, 0], to_mesh[2, 1], to_mesh[2, 2]
    scratch, values = np.zeros(8 * ((WIDTH + 3) // 4), REAL), np.zeros(LANES, REAL)
    mesh_at, coef_at, scratch_at, values_at = begin(mesh), begin(coef), begin(scratch), begin(values)
    total = 0
    for b in range(len(i_b)):
        strength = 0.0
        for k in range(n_comp):
            s = abs(b_bk[b, k]) * weight_k[k]
            strength = s if s > strength else strength
        if strength == 0.0:
            continue
        i = i_b[b]
        x, y, z = x_nc[i, 0] - o0, x_nc[i, 1] - o1, x_nc[i, 2] - o2
        rx, ry, rz = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        u0, u1, u2 = x * t00 + y * t10 + z * t20, x * t01 + y * t11 + z * t21, x * t02 + y * t12 + z * t22
        d0, d1, d2 = rx * t00 + ry * t10 + rz * t20, rx * t01 + ry * t11 + rz * t21, rx * t02 + ry * t12 + rz * t22
        length = sqrt(rx * rx + ry * ry + rz * rz)
        m, pieces = 0, 1
        if length > 0.0:
            power = frexp(strength)[1]
            level = 0 if power + slack > STRONG else min(max(LEVELS - power, 0), 2 * LEVELS)
            while m < most - 1 and length > longest[level, m]:
                m += 1
            if length > longest[level, m]:
                pieces = ceil(length / longest[level, m])
        share = 1.0 / pieces
        for piece in range(pieces):
            for q in range(m + 1):
                t = (piece + nodes[m, q]) * share
                i0, f0 = first_node(u0 - t * d0, n0, inverse0, half, low0)
                i1, f1 = first_node(u1 - t * d1, n1, inverse1, half, low1)
                if DEPTH == 1:
                    i2, f2 = 1, 0.0
                else:
                    i2, f2 = first_node(u2 - t * d2, n2, inverse2, half, low2)
                if i0 < 1 or i1 < 1 or i2 < 1 or i0 > last0 or i1 > last1 or i2 > last2:
                    continue
                w = node_weights[m, q] * share * inverse_scale
                for k in range(n_comp):
                    values[k] = b_bk[b, k] * w
                rows[i0, i1] = 1
                SPREAD(
                    mesh_at,
                    i0 * stride0 + i1 * stride1 + (i2 if DEPTH > 1 else 0) * LANES,
                    stride0,
                    stride1,
                    f0,
                    f1,
                    f2,
                    coef_at,
                    values_at,
                    scratch_at,
                )
        total += pieces * (m + 1)
    return total


@cache
def row_core(width, degree, real, depth):
    """`spread_rows` for a window and a precision."""
    tag = f"{width}_{degree}_{np.dtype(real).name}" + "_plane" * (depth == 1)
    return specialise(
        spread_rows, tag, WIDTH=width, DEPTH=depth, LANES=8, REAL=real, SPREAD=_spreader(width, 8, degree, real, depth)
    )


def spread_rows(
    x_nc, which, values_nk, columns, factor, origin, to_mesh, period, low, counts, row, coef, meshes, rows
):  # fmt: skip
    """Like `spread_bonds` for atoms with many components, in groups of eight with a mesh each. Returns the number of
    points on the meshes.

    Parameters
    ----------
    x_nc, which : positions, and of which rows of `values_nk` they are
    columns : (group, 8) of `values_nk`; −1: none
    factor : the meshes hold the values times this
    meshes : (group,) where they begin in memory; all of the same shape. The caller keeps them alive
    """
    half = 0.5 * WIDTH
    n0, n1, n2 = float(period[0]), float(period[1]), float(period[2])
    inverse0, inverse1, inverse2 = (
        1.0 / n0 if n0 > 0.0 else 0.0,
        1.0 / n1 if n1 > 0.0 else 0.0,
        1.0 / n2 if n2 > 0.0 else 0.0,
    )
    low0, low1, low2 = float(low[0]), float(low[1]), float(low[2])
    last0, last1, last2 = counts[0] - WIDTH, counts[1] - WIDTH, counts[2] - WIDTH
    if DEPTH == 1:
        last2 = 1
    stride1 = row * LANES
    stride0 = counts[1] * stride1
    scratch, values = np.zeros(8 * ((WIDTH + 3) // 4), REAL), np.zeros(LANES, REAL)
    coef_at, scratch_at, values_at = begin(coef), begin(scratch), begin(values)
    total = 0
    for n in range(len(which)):
        x, y, z = x_nc[n, 0] - origin[0], x_nc[n, 1] - origin[1], x_nc[n, 2] - origin[2]
        i0, f0 = first_node(x * to_mesh[0, 0] + y * to_mesh[1, 0] + z * to_mesh[2, 0], n0, inverse0, half, low0)
        i1, f1 = first_node(x * to_mesh[0, 1] + y * to_mesh[1, 1] + z * to_mesh[2, 1], n1, inverse1, half, low1)
        if DEPTH == 1:
            i2, f2 = 1, 0.0
        else:
            i2, f2 = first_node(x * to_mesh[0, 2] + y * to_mesh[1, 2] + z * to_mesh[2, 2], n2, inverse2, half, low2)
        if i0 < 1 or i1 < 1 or i2 < 1 or i0 > last0 or i1 > last1 or i2 > last2:
            continue
        total += 1
        rows[i0, i1] = 1
        at, a = i0 * stride0 + i1 * stride1 + (i2 if DEPTH > 1 else 0) * LANES, which[n]
        for g in range(len(meshes)):
            for k in range(LANES):
                c = columns[g, k]
                values[k] = values_nk[a, c] * factor if c >= 0 else 0.0
            SPREAD(meshes[g], at, stride0, stride1, f0, f1, f2, coef_at, values_at, scratch_at)
    return total


@njit(**ENTRY)
def flush(mesh, rows, width, total, scale):
    """total += scale mesh, mesh = 0, rows = 0: where points have been spread since the last time. Arrays [x][y][z and
    component]."""
    reached = np.zeros(rows.shape, np.uint8)
    for x in range(rows.shape[0]):
        for y in range(rows.shape[1]):
            if rows[x, y]:
                rows[x, y] = 0
                for a in range(width):
                    for b in range(width):
                        reached[x + a, y + b] = 1
    for x in range(rows.shape[0]):
        for y in range(rows.shape[1]):
            if reached[x, y]:
                for k in range(mesh.shape[2]):
                    total[x, y, k] += scale * mesh[x, y, k]
                    mesh[x, y, k] = 0.0


@njit(**ENTRY)
def collect(mesh, scale, first, period, out):
    """One plane [y][z][component] of the mesh, added to out[component][y][z]: nodes counted from `first`, the halo of
    periodic axes to its place."""
    n_comp, n1, n2 = out.shape
    for y in range(mesh.shape[0]):
        to1 = y + first[0]
        if period[0] > 0:
            to1 %= period[0]
        if not 0 <= to1 < n1:
            continue
        for z in range(mesh.shape[1]):
            to2 = z + first[1]
            if period[1] > 0:
                to2 = to2 - period[1] if to2 >= period[1] else (to2 + period[1] if to2 < 0 else to2)
            if not 0 <= to2 < n2:
                continue
            for c in range(n_comp):
                out[c, to1, to2] += scale * mesh[y, z, c]


@njit(**ENTRY)
def interpolate(u_gc, period, coef, width, mesh, out):
    """out[g, c] = Σ over the nodes in reach of u (mesh spacings, array indices) of mesh × window; all axes periodic.

    mesh : [component][x][y][z]
    """
    degree = len(coef) - 1
    w = np.zeros((3, width))
    at = np.zeros((3, width), np.int64)
    for g in range(len(u_gc)):
        for a in range(3):
            n = period[a]
            u = u_gc[g, a] - 0.5 * width
            i = floor(u) + 1
            f = i - u
            for k in range(width):
                p = coef[degree, k]
                for d in range(degree - 1, -1, -1):
                    p = p * f + coef[d, k]
                w[a, k] = p
                at[a, k] = (i + k) % n
        for c in range(mesh.shape[0]):
            total = 0.0
            for i in range(width):
                for j in range(width):
                    part = 0.0
                    for k in range(width):
                        part += w[2, k] * mesh[c, at[0, i], at[1, j], at[2, k]]
                    total += w[0, i] * w[1, j] * part
            out[g, c] = total


@njit(**ENTRY)
def spread_sites(u_nc, period, coef, width, a_n, mesh):
    """mesh += Σ a × window at the nodes in reach of u, the transpose of `interpolate`. mesh : [x][y][z]"""
    degree = len(coef) - 1
    w = np.zeros((3, width))
    at = np.zeros((3, width), np.int64)
    for g in range(len(u_nc)):
        for a in range(3):
            n = period[a]
            u = u_nc[g, a] - 0.5 * width
            i = floor(u) + 1
            f = i - u
            for k in range(width):
                p = coef[degree, k]
                for d in range(degree - 1, -1, -1):
                    p = p * f + coef[d, k]
                w[a, k] = p
                at[a, k] = (i + k) % n
        for i in range(width):
            for j in range(width):
                part = a_n[g] * w[0, i] * w[1, j]
                for k in range(width):
                    mesh[at[0, i], at[1, j], at[2, k]] += part * w[2, k]


@njit(**ENTRY)
def interpolate_plane(u_gc, period, coef, width, mesh, out):
    """`interpolate` from a mesh of one layer, [component][x][y]."""
    degree = len(coef) - 1
    w = np.zeros((2, width))
    at = np.zeros((2, width), np.int64)
    for g in range(len(u_gc)):
        for a in range(2):
            n = period[a]
            u = u_gc[g, a] - 0.5 * width
            i = floor(u) + 1
            f = i - u
            for k in range(width):
                p = coef[degree, k]
                for d in range(degree - 1, -1, -1):
                    p = p * f + coef[d, k]
                w[a, k] = p
                at[a, k] = (i + k) % n
        for c in range(mesh.shape[0]):
            total = 0.0
            for i in range(width):
                part = 0.0
                for j in range(width):
                    part += w[1, j] * mesh[c, at[0, i], at[1, j]]
                total += w[0, i] * part
            out[g, c] = total
