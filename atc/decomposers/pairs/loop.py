"""The loop over pairs, once: the law of each pair style is compiled into a copy of it.

A law is a function of the squared distance and of the style's coefficients for a pair of types; it returns U and G =
U'/d. What stands around it is done here: whose coefficients, the cutoff, the weight of bonded neighbours, the offset
that makes the energy end at 0, charges.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from llvmlite import ir
from numba.core import types as kinds
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ...compiled import njit, specialise, tag_of

JIT = dict(cache=True, nogil=True, error_model="numpy")


@intrinsic(prefer_literal=True)
def _coefficients(typingctx, table, first, count):
    """`count` numbers of a table from number `first` on, as a tuple. A view of the row would be counted in and out for
    every pair."""

    def codegen(context, builder, signature, args):
        data = make_array(signature.args[0])(context, builder, args[0]).data
        at = [builder.add(args[1], ir.Constant(ir.IntType(64), k)) for k in range(count.literal_value)]
        return context.make_tuple(builder, signature.return_type, [builder.load(builder.gep(data, [k])) for k in at])

    return kinds.UniTuple(kinds.float64, count.literal_value)(table, kinds.int64, count), codegen


def pair_law(function):
    """Decorator of the `law` of a pair style, a function that numba can compile; see `RadialStyle` and `ChargedStyle`
    for its arguments."""
    return staticmethod(njit(nogil=True, error_model="numpy", forceinline=True, no_cfunc_wrapper=True)(function))


@cache
def pair_loop(law, width: int):
    """The loop (types, i, j, d2, weights, table, U, G) of a `RadialStyle`; rows of the table are [cutoff²,
    *coefficients, offset], `width` numbers."""
    return specialise(_pairs, tag_of(law), JIT, LAW=law, WIDTH=width)


@cache
def one_type_loop(law, width: int):
    """As `pair_loop` for pairs that all have one row of coefficients and no weights: (d2, row, U, G)."""
    return specialise(_one_type, tag_of(law), JIT, LAW=law, WIDTH=width)


@cache
def charged_loop(law, width: int, whole: bool):
    """The loop (types, i, j, d2, weights, table, constant, charges, U, G) of a `ChargedStyle`; rows of the table are
    [cutoff², *coefficients].

    whole : whether weights take off a share of the bare Coulomb energy, not of the law's
    """
    return specialise(_charges, tag_of(law) + str(int(whole)), JIT, LAW=law, WIDTH=width, WHOLE=whole)


# Replaced in each copy.
LAW, WIDTH, WHOLE = None, 0, False


def _pairs(types, i, j, d2, weights, table, U, G):
    n, weighted = len(table), len(weights) > 0
    for b in range(len(d2)):
        at = (types[i[b]] * n + types[j[b]]) * WIDTH
        if d2[b] < _coefficients(table, at, 1)[0]:
            w = weights[b] if weighted else 1.0
            row = _coefficients(table, at, WIDTH)
            u, g = LAW(d2[b], *row[1:-1])
            U[b] += w * (u - row[-1])
            G[b] += w * g


def _one_type(d2, p, U, G):
    # No gathers and no branches, so that simple laws run in SIMD.
    row = _coefficients(p, 0, WIDTH)
    for b in range(len(d2)):
        u, g = LAW(d2[b], *row[1:-1])
        on = d2[b] < row[0]
        U[b] += u - row[-1] if on else 0.0
        G[b] += g if on else 0.0


def _charges(types, i, j, d2, weights, table, constant, q, U, G):
    n, weighted = len(table), len(weights) > 0
    for b in range(len(d2)):
        at = (types[i[b]] * n + types[j[b]]) * WIDTH
        if d2[b] < _coefficients(table, at, 1)[0]:
            w = weights[b] if weighted else 1.0
            row = _coefficients(table, at, WIDTH)
            c = constant * q[i[b]] * q[j[b]]
            if WHOLE:
                u, g = LAW(d2[b], c, *row[1:])
                if w < 1.0:
                    lost = (1.0 - w) * c / np.sqrt(d2[b])
                    u -= lost
                    g += lost / d2[b]
            else:
                u, g = LAW(d2[b], c * w, *row[1:])
            U[b] += u
            G[b] += g
