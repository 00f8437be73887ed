"""Rows of nodes into columns of bonds and back, eight bonds at a time: vector loads and shuffles in place of one number
after the other.

Compilers gather and scatter element by element; a node's numbers lie side by side, so that one load takes four of them
and a transposition of registers makes columns. Written in LLVM's vectors: right on every machine, fast where there are
wide registers.
"""

from __future__ import annotations

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ..compiled import njit
from .bonds import JIT

# Row buffers: columns of a fixed length, so that the compiler can tell them apart and vectorise.
C = 128
# Helpers of the rows' loops: inside them, so that no array is counted in and out a row (threads would fight for the
# counters).
INLINE = dict(JIT, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
_F8, _I32, _I64 = ir.DoubleType(), ir.IntType(32), ir.IntType(64)
_V4, _V8 = ir.VectorType(_F8, 4), ir.VectorType(_F8, 8)


def _shuffle(builder, a, b, lanes):
    return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_I32, len(lanes)), [_I32(x) for x in lanes]))


def _data(context, builder, ty, value):
    return make_array(ty)(context, builder, value).data


def _vector(builder, data, at, vector):
    """Pointer to a vector of doubles that starts at number `at` of `data`."""
    return builder.bitcast(builder.gep(data, [at]), vector.as_pointer())


def _eight(first, columns, own):
    """An intrinsic (rows, node_k, i, k, w): numbers first.. first+3 of eight nodes less row i's numbers own.. own+3;
    the first `columns` into w."""

    @intrinsic
    def eight(typingctx, rows, node_k, i, k, w):
        def codegen(context, builder, signature, args):
            data = _data(context, builder, signature.args[0], args[0])
            node = _data(context, builder, signature.args[1], args[1])
            out = _data(context, builder, signature.args[4], args[4])
            row = lambda n, c: _vector(builder, data, builder.add(builder.mul(n, _I64(8)), _I64(c)), _V4)  # noqa: E731
            mine = builder.load(row(args[2], own), align=8)
            four = []
            for lane in range(8):
                n = builder.zext(builder.load(builder.gep(node, [builder.add(args[3], _I64(lane))])), _I64)
                four.append(builder.fsub(builder.load(row(n, first), align=8), mine))
            # Nodes k and k + 4 side by side, then a 4 by 4 transposition in each half.
            c = [_shuffle(builder, four[r], four[r + 4], range(8)) for r in range(4)]
            low, high = (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)
            pairs = [(_shuffle(builder, c[0], c[1], s), _shuffle(builder, c[2], c[3], s)) for s in (low, high)]
            left, right = (0, 1, 8, 9, 4, 5, 12, 13), (2, 3, 10, 11, 6, 7, 14, 15)
            for column in range(columns):
                a, b = pairs[column % 2]
                v = _shuffle(builder, a, b, left if column < 2 else right)
                builder.store(v, _vector(builder, out, builder.add(args[3], _I64(column * C)), _V8), align=8)
            return context.get_dummy_value()

        return types.void(rows, node_k, types.int64, types.int64, w), codegen

    return eight


@intrinsic
def _deal(typingctx, f, base, node_k, k, w, own):
    """Row n − base of f (force, smallest stretch) for eight nodes n, one after the other: forces in columns 0-2 of w
    are taken off, the stretch in column 6 lowers the smallest. `own`, four numbers as well, gets the forces added, in
    the same order."""

    def codegen(context, builder, signature, args):
        rows = _data(context, builder, signature.args[0], args[0])
        node = _data(context, builder, signature.args[2], args[2])
        columns = _data(context, builder, signature.args[4], args[4])
        mine = _vector(builder, _data(context, builder, signature.args[5], args[5]), _I64(0), _V4)
        c = [
            builder.load(_vector(builder, columns, builder.add(args[3], _I64(column * C)), _V8), align=8)
            for column in (0, 1, 2, 6)
        ]
        low, high = (0, 8, 2, 10, 4, 12, 6, 14), (1, 9, 3, 11, 5, 13, 7, 15)
        pairs = [(_shuffle(builder, c[0], c[1], s), _shuffle(builder, c[2], c[3], s)) for s in (low, high)]
        total = builder.load(mine, align=8)
        for lane in range(8):
            p = lane // 2 * 2
            row = _shuffle(builder, *pairs[lane % 2], (p, p + 1, p + 8, p + 9))
            n = builder.sub(
                builder.zext(builder.load(builder.gep(node, [builder.add(args[3], _I64(lane))])), _I64), args[1]
            )
            at = _vector(builder, rows, builder.mul(n, _I64(4)), _V4)
            old = builder.load(at, align=8)
            # Three forces, and the smaller of the two stretches.
            keep = (0, 1, 2, 7)
            lower = builder.select(builder.fcmp_ordered("<", row, old), row, old)
            builder.store(_shuffle(builder, builder.fsub(old, row), lower, keep), at, align=8)
            lower = builder.select(builder.fcmp_ordered("<", row, total), row, total)
            total = _shuffle(builder, builder.fadd(total, row), lower, keep)
        builder.store(total, mine, align=8)
        return context.get_dummy_value()

    return types.void(f, types.int64, node_k, types.int64, w, own), codegen


_displacements = _eight(0, 4, 0)
_references = _eight(4, 2, 4)
_positions = _eight(0, 4, 4)


@njit(**INLINE)
def gather(b0, m, i, j, image, images, z, node, w):
    """η and ξ of m bonds of row i, from bond b0 on, into columns 0-5 of w; zeros up to the next multiple of eight.

    z : rows of displacement and reference position. node : (C + 8,) int32, room for the bonds' other ends.
    """
    _ends(b0, m, i, j, node)
    for k in range(0, m, 8):
        _displacements(z, node, i, k, w)
        _references(z, node, i, k, w[4 * C :])
    if len(image):
        for k in range(m):
            t = image[b0 + k]
            w[3 * C + k] += images[t, 0]
            w[4 * C + k] += images[t, 1]
            w[5 * C + k] += images[t, 2]
            # How far the strained cell has moved that image.
            w[k] += images[t, 3]
            w[C + k] += images[t, 4]
            w[2 * C + k] += images[t, 5]


@njit(**INLINE)
def gather_positions(b0, m, i, j, image, images, y, node, w):
    """y_j − y_i of m bonds of row i into columns 0-2 of w, A_j + A_i into column 3; zeros (2 A_i) up to the next
    multiple of eight.

    y : rows of position and A, then position and −A once more.
    """
    _ends(b0, m, i, j, node)
    for k in range(0, m, 8):
        _positions(y, node, i, k, w)
    if len(image):
        for k in range(m):
            t = image[b0 + k]
            w[k] += images[t, 0] + images[t, 3]
            w[C + k] += images[t, 1] + images[t, 4]
            w[2 * C + k] += images[t, 2] + images[t, 5]


@njit(**INLINE)
def _ends(b0, m, i, j, node):
    """The other ends of a row's bonds; the row itself, which is at no distance, beyond them."""
    for k in range(m):
        node[k] = j[b0 + k]
    for k in range(m, m + 8):
        node[k] = i


@njit(**INLINE)
def deal(m, base, node, w, f, own):
    """Take the forces of m bonds (columns 0-2 of w) off their nodes' rows of f, add them to `own`; column 3 of both
    keeps the smallest stretch.

    Sums go bond by bond, so that bonds without force change nothing wherever they stand. f : (window, 4), node n in row
    n − base.
    """
    for k in range(m, (m + 7) & ~7):
        w[k] = 0.0
        w[C + k] = 0.0
        w[2 * C + k] = 0.0
        w[6 * C + k] = np.inf
    for k in range(0, m, 8):
        _deal(f, base, node, k, w, own)
