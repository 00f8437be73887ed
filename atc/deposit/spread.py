"""Spreading points of bonds onto a mesh: the loops of the spectral deposit.

The mesh is [x][y][z][components], components padded to whole vectors of four and one window's halo wider than the cell, so that no index wraps.
What is done at one point is written as LLVM instructions for each width of the window: the products of weights and components stay in registers,
and no loop is short. Memory goes by address there; `spread_bonds` owns the arrays and the bounds.
"""

from __future__ import annotations

from functools import cache
from math import ceil, floor, sqrt

import numba as nb
import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

from ._simd import INLINE, specialise

# Set by `core`: nodes of the window along each axis, vectors of four components, and what is done at a point.
WIDTH, VECTORS, SPREAD = 4, 2, None

_DOUBLE, _INT64, _INT32 = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VEC4 = ir.VectorType(_DOUBLE, 4)


@intrinsic
def begin(typingctx, array):
    """The address of a contiguous float64 array."""

    def codegen(context, builder, sig, args):
        return builder.ptrtoint(context.make_array(sig.args[0])(context, builder, args[0]).data, _INT64)

    return types.int64(array), codegen


def _spreader(width, vectors, degree):
    """An intrinsic: (mesh, first node's offset, strides of x and y, distances along x, y, z, coefficients, components, scratch) -> nothing.

    Coefficients: (degree + 1, 4⌈width/4⌉) of the window in powers of the distance; scratch: room for 8⌈width/4⌉ doubles.
    """
    groups = (width + 3) // 4
    pad = 4 * groups

    def codegen(context, builder, sig, args):
        mesh, offset, stride0, stride1, fx, fy, fz, coef, values, scratch = args
        contract = ("contract",)

        def place(base, index, kind=_VEC4):
            index = ir.Constant(_INT64, index) if isinstance(index, int) else index
            return builder.bitcast(builder.gep(builder.inttoptr(base, _DOUBLE.as_pointer()), [index]), kind.as_pointer())

        def load(base, index):
            return builder.load(place(base, index), align=8)

        def splat(x):
            lane = builder.insert_element(ir.Constant(_VEC4, ir.Undefined), x, ir.Constant(_INT32, 0))
            return builder.shuffle_vector(lane, ir.Constant(_VEC4, ir.Undefined), ir.Constant(ir.VectorType(_INT32, 4), [0] * 4))

        def times_plus(a, b, c):
            return builder.fadd(builder.fmul(a, b, flags=contract), c, flags=contract)

        # Horner's scheme, three axes at a time.
        f = [splat(x) for x in (fx, fy, fz)]
        along_z = []
        for g in range(groups):
            p = [load(coef, degree * pad + 4 * g)] * 3
            for d in range(degree - 1, -1, -1):
                c = load(coef, d * pad + 4 * g)
                p = [times_plus(p[k], f[k], c) for k in range(3)]
            for k in range(2):
                builder.store(p[k], place(scratch, k * pad + 4 * g), align=8)
            along_z.append(p[2])
        v = [load(values, 4 * g) for g in range(vectors)]
        vz = []
        for c in range(width):
            w = builder.shuffle_vector(
                along_z[c // 4], ir.Constant(_VEC4, ir.Undefined), ir.Constant(ir.VectorType(_INT32, 4), [c % 4] * 4)
            )
            vz += [builder.fmul(w, x, flags=contract) for x in v]
        end = ir.Constant(_INT64, width)
        with cgutils.for_range(builder, end) as a:
            wx = builder.load(place(scratch, a.index, _DOUBLE))
            plane = builder.add(offset, builder.mul(a.index, stride0))
            with cgutils.for_range(builder, end) as e:
                wy = builder.load(place(scratch, builder.add(e.index, ir.Constant(_INT64, pad)), _DOUBLE))
                s = splat(builder.fmul(wx, wy))
                row = builder.add(plane, builder.mul(e.index, stride1))
                for c, x in enumerate(vz):
                    at = place(mesh, builder.add(row, ir.Constant(_INT64, 4 * c)))
                    builder.store(times_plus(s, x, builder.load(at, align=8)), at, align=8)
        return context.get_dummy_value()

    @intrinsic
    def spread(typingctx, mesh, offset, stride0, stride1, fx, fy, fz, coef, values, scratch):
        i, f = types.int64, types.float64
        return types.void(i, i, i, i, f, f, f, i, i, i), codegen

    return spread


@cache
def core(width, vectors, degree):
    """`spread_bonds` for a window and a number of components."""
    return specialise(spread_bonds, f"{width}_{vectors}_{degree}", WIDTH=width, VECTORS=vectors, SPREAD=_spreader(width, vectors, degree))


@nb.njit(**INLINE)
def first_node(u, n, half, offset):
    """Array index of the first node in reach of u (mesh spacings, any image) and its distance above the window's lower end."""
    v = u - n * floor(u / n) - half + offset
    i = int(v) + 1
    return i, i - v


def spread_bonds(x_nc, i_b, r_bc, b_bk, origin, to_mesh, counts, longest, nodes, node_weights, coef, mesh):
    """mesh += Σ over bonds, their Gauss points and the nodes in reach of b × weight × window. Returns the number of points.

    Parameters
    ----------
    origin, to_mesh (3, 3) : positions relative to the origin, and bond vectors, to mesh spacings
    counts : (3,) nodes along the axes, without halo
    longest, nodes, node_weights : (m,), (m, m), (m, m): Gauss-Legendre rules on [0, 1], and the longest bond that each does for

    Returns -1, the mesh spoiled, where a position or bond vector is not a number.
    """
    half, offset = 0.5 * WIDTH, (WIDTH + 1) // 2
    n0, n1, n2 = float(counts[0]), float(counts[1]), float(counts[2])
    stride1 = (counts[2] + WIDTH + 1) * 4 * VECTORS
    stride0 = (counts[1] + WIDTH + 1) * stride1
    n_comp, most = b_bk.shape[1], len(longest)
    o0, o1, o2 = origin[0], origin[1], origin[2]
    t00, t01, t02 = to_mesh[0, 0], to_mesh[0, 1], to_mesh[0, 2]
    t10, t11, t12 = to_mesh[1, 0], to_mesh[1, 1], to_mesh[1, 2]
    t20, t21, t22 = to_mesh[2, 0], to_mesh[2, 1], to_mesh[2, 2]
    scratch, values = np.zeros(8 * ((WIDTH + 3) // 4)), np.zeros(4 * VECTORS)
    mesh_at, coef_at, scratch_at, values_at = begin(mesh), begin(coef), begin(scratch), begin(values)
    total = 0
    for b in range(len(i_b)):
        i = i_b[b]
        x, y, z = x_nc[i, 0] - o0, x_nc[i, 1] - o1, x_nc[i, 2] - o2
        rx, ry, rz = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2]
        u0, u1, u2 = x * t00 + y * t10 + z * t20, x * t01 + y * t11 + z * t21, x * t02 + y * t12 + z * t22
        d0, d1, d2 = rx * t00 + ry * t10 + rz * t20, rx * t01 + ry * t11 + rz * t21, rx * t02 + ry * t12 + rz * t22
        # A sum of numbers that are not finite is none, whatever they are.
        if not abs(u0 + u1 + u2 + d0 + d1 + d2) < 1e300:
            return -1
        length = sqrt(rx * rx + ry * ry + rz * rz)
        m = 0
        while m < most - 1 and length > longest[m]:
            m += 1
        pieces = 1 if length <= longest[m] else ceil(length / longest[m])
        share = 1.0 / pieces
        for piece in range(pieces):
            for q in range(m + 1):
                t = (piece + nodes[m, q]) * share
                i0, f0 = first_node(u0 - t * d0, n0, half, offset)
                i1, f1 = first_node(u1 - t * d1, n1, half, offset)
                i2, f2 = first_node(u2 - t * d2, n2, half, offset)
                w = node_weights[m, q] * share
                for k in range(n_comp):
                    values[k] = b_bk[b, k] * w
                SPREAD(
                    mesh_at, i0 * stride0 + i1 * stride1 + i2 * 4 * VECTORS, stride0, stride1, f0, f1, f2, coef_at, values_at, scratch_at
                )  # fmt: skip
        total += pieces * (m + 1)
    return total
