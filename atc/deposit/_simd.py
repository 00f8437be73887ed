"""Four-lane building blocks, and one compiled copy of a core per kernel family.

The hot loops touch short runs of grid points. LLVM's vectoriser leaves runs that short scalar (its run-time alias checks cost more than
they save), so the two memory operations that matter are written as <4 x double> instructions here; on machines with narrower vectors
LLVM splits them. The offsets are trusted: whoever calls these owns the bounds.
"""

from __future__ import annotations

import hashlib
import types as _types
from pathlib import Path

import numba as nb
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

JIT = dict(cache=True, nogil=True, error_model="numpy")
# Contracting a·b + c into one rounding is safe everywhere in the deposit: no sum there is compensated.
JIT_FMA = dict(JIT, fastmath={"contract"})

_DOUBLE = ir.DoubleType()
_INT64 = ir.IntType(64)
_VEC4 = ir.VectorType(_DOUBLE, 4)


def _pointer(context, builder, array_type, array, index):
    data = context.make_array(array_type)(context, builder, array).data
    at = builder.gep(data, [index])
    return builder.bitcast(at, _VEC4.as_pointer())


def _splat(builder, value):
    lane0 = builder.insert_element(ir.Constant(_VEC4, ir.Undefined), value, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(lane0, ir.Constant(_VEC4, ir.Undefined), ir.Constant(ir.VectorType(ir.IntType(32), 4), [0] * 4))


@intrinsic
def axpy4(typingctx, acc, o, s, buf, l):
    """acc[o:o+4] += s * buf[l:l+4]"""
    sig = types.void(acc, types.int64, types.float64, buf, types.int64)

    def codegen(context, builder, signature, args):
        to = _pointer(context, builder, signature.args[0], args[0], args[1])
        at = _pointer(context, builder, signature.args[3], args[3], args[4])
        # fmuladd: fused where the machine can, multiply and add where it cannot.
        fma = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VEC4, [_VEC4] * 3), "llvm.fmuladd.v4f64")
        new = builder.call(fma, [_splat(builder, args[2]), builder.load(at, align=8), builder.load(to, align=8)])
        builder.store(new, to, align=8)
        return context.get_dummy_value()

    return sig, codegen


@intrinsic
def ramp4(typingctx, buf, l, base, step):
    """buf[l:l+4] = base + step * (0, 1, 2, 3)"""
    sig = types.void(buf, types.int64, types.float64, types.float64)

    def codegen(context, builder, signature, args):
        to = _pointer(context, builder, signature.args[0], args[0], args[1])
        lanes = ir.Constant(_VEC4, [0.0, 1.0, 2.0, 3.0])
        value = builder.fadd(_splat(builder, args[2]), builder.fmul(_splat(builder, args[3]), lanes))
        builder.store(value, to, align=8)
        return context.get_dummy_value()

    return sig, codegen


@intrinsic
def bits(typingctx, x):
    """The 64 bits of a float as an integer."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], _INT64)

    return types.int64(types.float64), codegen


@intrinsic
def from_bits(typingctx, i):
    """The float with these 64 bits."""

    def codegen(context, builder, signature, args):
        return builder.bitcast(args[0], _DOUBLE)

    return types.float64(types.int64), codegen


def _fingerprint() -> str:
    h = hashlib.sha256()
    for path in sorted(Path(__file__).parent.glob("_*.py")):
        h.update(path.read_bytes())
    return h.hexdigest()[:8]


_SOURCES = _fingerprint()


def specialise(py_func, tag: str, **names):
    """Compile a copy of `py_func` in which the global `names` have other values, e.g. another β.

    A copy under its own name is what numba can cache on disk; a closure over a compiled function would be recompiled every time.
    numba looks only at the copy's own file for changes, so the name carries a fingerprint of the sources beside it too.
    """
    f = _types.FunctionType(py_func.__code__, {**py_func.__globals__, **names}, py_func.__name__, py_func.__defaults__)
    f.__qualname__ = f"{py_func.__qualname__}_{tag}_{_SOURCES}"
    f.__module__ = py_func.__module__
    return nb.njit(**JIT_FMA)(f)


__all__ = ["JIT", "JIT_FMA", "axpy4", "bits", "cgutils", "from_bits", "ramp4", "specialise"]
