"""Four numbers at a time, and one compiled copy of a core per kernel family.

The hot loops touch short runs of grid points. LLVM's vectoriser leaves runs that short scalar (its run-time checks cost
more than they save), so `vec4` is a numba type of its own: <4 x double> with + − · /, which LLVM splits where the
machine has narrower vectors.
"""

from __future__ import annotations

import operator
from functools import partial

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.errors import TypingError
from numba.core.typing.templates import ConcreteTemplate, infer_global, signature
from numba.extending import intrinsic, lower_builtin, models, register_model

from .compiled import specialise as copy_of

JIT = dict(cache=True, nogil=True, error_model="numpy")
# What is only called from compiled code needs no entry from Python, which takes longer to compile than most of these
# functions. Contracting a·b + c into one rounding is safe everywhere in the deposit: no sum there is compensated.
# Always inlined: a function that is called has one copy for itself and one in each caller, which may round differently,
# and which of them runs depends on whether it was compiled in this process or came from the disk.
JIT_FMA = dict(JIT, fastmath={"contract"}, forceinline=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
# Called from Python.
ENTRY = dict(JIT_FMA, forceinline=False, no_cpython_wrapper=False)
# For what is called once for four points a call would send vectors through memory too.
INLINE = JIT_FMA

_DOUBLE, _INT64, _INT32 = ir.DoubleType(), ir.IntType(64), ir.IntType(32)
_VEC4, _IVEC4 = ir.VectorType(_DOUBLE, 4), ir.VectorType(_INT64, 4)


class Vec4(types.Type):
    """Four doubles in one register."""

    def __init__(self):
        super().__init__(name="vec4d")


vec4 = Vec4()


@register_model(Vec4)
class _Vec4Model(models.PrimitiveModel):
    def __init__(self, dmm, fe_type):
        super().__init__(dmm, fe_type, _VEC4)


def _splat(builder, value):
    lane0 = builder.insert_element(ir.Constant(_VEC4, ir.Undefined), value, ir.Constant(_INT32, 0))
    return builder.shuffle_vector(
        lane0, ir.Constant(_VEC4, ir.Undefined), ir.Constant(ir.VectorType(_INT32, 4), [0] * 4)
    )


def _constant(value):
    return ir.Constant(_VEC4, [float(value)] * 4)


def _iconstant(value):
    return ir.Constant(_IVEC4, [int(value)] * 4)


def _vector(builder, type_, value):
    return value if isinstance(type_, Vec4) else _splat(builder, value)


def _define(op, instruction):
    """vec4 op vec4, vec4 op float, float op vec4."""
    pairs = [(vec4, vec4), (vec4, types.float64), (types.float64, vec4)]
    infer_global(op)(
        type(f"_vec4_{op.__name__}", (ConcreteTemplate,), {"cases": [signature(vec4, a, b) for a, b in pairs]})
    )

    def lower(context, builder, sig, args):
        a, b = (_vector(builder, t, v) for t, v in zip(sig.args, args))
        return getattr(builder, instruction)(a, b, flags=("contract",))

    for a, b in pairs:
        lower_builtin(op, a, b)(lower)


for _op, _instruction in (
    (operator.add, "fadd"),
    (operator.sub, "fsub"),
    (operator.mul, "fmul"),
    (operator.truediv, "fdiv"),
):
    _define(_op, _instruction)


def _choose(comparison, context, builder, sig, args):
    a, b = (_vector(builder, t, v) for t, v in zip(sig.args, args))
    return builder.select(builder.fcmp_ordered(comparison, a, b), a, b)


@intrinsic
def maximum4(typingctx, a, b):
    """The larger, lane by lane; b may be a float."""
    return vec4(vec4, vec4 if isinstance(b, Vec4) else types.float64), partial(_choose, ">")


@intrinsic
def minimum4(typingctx, a, b):
    """The smaller, lane by lane; b may be a float."""
    return vec4(vec4, vec4 if isinstance(b, Vec4) else types.float64), partial(_choose, "<")


def _other_if(comparison, context, builder, sig, args):
    a, b = args
    compare = builder.icmp_signed if isinstance(sig.return_type, types.Integer) else builder.fcmp_ordered
    return builder.select(compare(comparison, b, a), b, a)


def _of_one_type(a, b):
    if a in (types.int64, types.float64) and a == b:
        return a(a, b)
    raise TypingError(f"two int64 or two float64 are wanted, not {a} and {b}")


# numba's own `max` and `min` of two numbers are functions that it compiles for each type and set of options.


@intrinsic
def greater(typingctx, a, b):
    """The greater of two integers, or of two floats; the first if one is not a number."""
    return _of_one_type(a, b), partial(_other_if, ">")


@intrinsic
def lesser(typingctx, a, b):
    """The lesser of two integers, or of two floats; the first if one is not a number."""
    return _of_one_type(a, b), partial(_other_if, "<")


@intrinsic
def where_positive4(typingctx, a, x, y):
    """x where a ≥ 0, else the float y."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered(">=", args[0], _constant(0.0)), args[1], _splat(builder, args[2]))

    return vec4(vec4, vec4, types.float64), codegen


def _function(name, context, builder, sig, args):
    f = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_VEC4, [_VEC4]), f"llvm.{name}.v4f64")
    return builder.call(f, [args[0]])


@intrinsic
def floor4(typingctx, a):
    return vec4(vec4), partial(_function, "floor")


@intrinsic
def ceil4(typingctx, a):
    return vec4(vec4), partial(_function, "ceil")


@intrinsic
def abs4(typingctx, a):
    return vec4(vec4), partial(_function, "fabs")


@intrinsic
def sqrt4(typingctx, a):
    return vec4(vec4), partial(_function, "sqrt")


@intrinsic
def sum4(typingctx, a):
    """The sum of the four."""

    def codegen(context, builder, sig, args):
        lanes = [builder.extract_element(args[0], ir.Constant(_INT32, k)) for k in range(4)]
        return builder.fadd(builder.fadd(lanes[0], lanes[1]), builder.fadd(lanes[2], lanes[3]))

    return types.float64(vec4), codegen


@intrinsic
def largest4(typingctx, a):
    """The largest of the four."""

    def codegen(context, builder, sig, args):
        largest = builder.extract_element(args[0], ir.Constant(_INT32, 0))
        for k in range(1, 4):
            lane = builder.extract_element(args[0], ir.Constant(_INT32, k))
            largest = builder.select(builder.fcmp_ordered(">", lane, largest), lane, largest)
        return largest

    return types.float64(vec4), codegen


@intrinsic
def lanes4(typingctx, a):
    """Four vec4, each one lane of a, four times."""

    def codegen(context, builder, sig, args):
        undefined = ir.Constant(_VEC4, ir.Undefined)
        four = [
            builder.shuffle_vector(args[0], undefined, ir.Constant(ir.VectorType(_INT32, 4), [k] * 4)) for k in range(4)
        ]
        return context.make_tuple(builder, sig.return_type, four)

    return types.UniTuple(vec4, 4)(vec4), codegen


@intrinsic
def splat4(typingctx, x):
    return vec4(types.float64), lambda context, builder, sig, args: _splat(builder, args[0])


@intrinsic
def ramp4(typingctx, base, step):
    """base + step * (0, 1, 2, 3)"""

    def codegen(context, builder, sig, args):
        lanes = ir.Constant(_VEC4, [0.0, 1.0, 2.0, 3.0])
        product = builder.fmul(_splat(builder, args[1]), lanes, flags=("contract",))
        return builder.fadd(_splat(builder, args[0]), product, flags=("contract",))

    return vec4(types.float64, types.float64), codegen


@intrinsic
def log2_ratio4(typingctx, top, low):
    """A whole number e ≥ 0 near log2(top/low), for top ≥ low > 0: read off the bits, the mantissas as linear
    approximations to their log2.

    top/(low 2^e) is between 2^-0.59 and 2^0.59.
    """

    def codegen(context, builder, sig, args):
        difference = builder.sub(builder.bitcast(args[0], _IVEC4), builder.bitcast(args[1], _IVEC4))
        e = builder.lshr(builder.add(difference, _iconstant(1 << 51)), _iconstant(52))
        # An integer below 2^52 becomes a float by putting it into the mantissa of 2^52.
        as_float = builder.bitcast(builder.or_(e, _iconstant(0x4330000000000000)), _VEC4)
        return builder.fsub(as_float, _constant(2.0**52))

    return vec4(vec4, vec4), codegen


@intrinsic
def exp2i4(typingctx, e):
    """2^e for whole numbers −1022 ≤ e ≤ 1023."""

    def codegen(context, builder, sig, args):
        # 1.5·2^52 + 1023 + e: the exponent, biased, is in the mantissa's lowest bits; move it into place.
        biased = builder.fadd(args[0], _constant(1.5 * 2.0**52 + 1023.0))
        return builder.bitcast(builder.shl(builder.bitcast(biased, _IVEC4), _iconstant(52)), _VEC4)

    return vec4(vec4), codegen


@intrinsic
def where_zero4(typingctx, e, a, b):
    """a where e is 0, else b."""

    def codegen(context, builder, sig, args):
        return builder.select(builder.fcmp_ordered("==", args[0], _constant(0.0)), args[1], args[2])

    return vec4(vec4, vec4, vec4), codegen


# Arrays passed to a function are reference-counted, with atomic instructions: in the inner loops memory goes by its
# address instead. Whoever takes the address must keep the array alive, and owns the bounds.


@intrinsic
def address(typingctx, array):
    """Where the data of a contiguous float64 array begins."""

    def codegen(context, builder, sig, args):
        return builder.ptrtoint(context.make_array(sig.args[0])(context, builder, args[0]).data, _INT64)

    return types.int64(array), codegen


def _pointer(builder, at, index, kind):
    double = builder.gep(builder.inttoptr(at, _DOUBLE.as_pointer()), [index])
    return builder.bitcast(double, kind.as_pointer())


@intrinsic
def peek(typingctx, at, i):
    """at[i]"""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, *args, _DOUBLE))

    return types.float64(types.int64, types.int64), codegen


@intrinsic
def poke(typingctx, at, i, x):
    """at[i] = x"""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _pointer(builder, args[0], args[1], _DOUBLE))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), codegen


@intrinsic
def peek_int(typingctx, at, i):
    """at[i] of whole numbers"""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, *args, _INT64))

    return types.int64(types.int64, types.int64), codegen


@intrinsic
def poke_int(typingctx, at, i, n):
    """at[i] = n of whole numbers"""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _pointer(builder, args[0], args[1], _INT64))
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64), codegen


@intrinsic
def prefetch(typingctx, at, i):
    """at[i] will be read soon."""

    def codegen(context, builder, sig, args):
        byte = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [byte, _INT32, _INT32, _INT32])
        f = cgutils.get_or_insert_function(builder.module, kind, "llvm.prefetch.p0i8")
        where = builder.bitcast(_pointer(builder, *args, _DOUBLE), byte)
        builder.call(f, [where, *(ir.Constant(_INT32, k) for k in (0, 3, 1))])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), codegen


@intrinsic
def load4(typingctx, at, i):
    """at[i:i+4]"""

    def codegen(context, builder, sig, args):
        return builder.load(_pointer(builder, *args, _VEC4), align=8)

    return vec4(types.int64, types.int64), codegen


@intrinsic
def load_rows4(typingctx, at, i):
    """The three columns of four rows of three, at[i:i+12]."""

    def codegen(context, builder, sig, args):
        at, i = args
        a, b, c = (
            builder.load(_pointer(builder, at, builder.add(i, ir.Constant(_INT64, 4 * k)), _VEC4), align=8)
            for k in range(3)
        )

        def pick(a, b, lanes):
            return builder.shuffle_vector(a, b, ir.Constant(ir.VectorType(_INT32, 4), lanes))

        columns = [
            pick(pick(a, b, first), c, second)
            for first, second in (
                ([0, 3, 6, 6], [0, 1, 2, 5]),
                ([1, 4, 7, 7], [0, 1, 2, 6]),
                ([2, 5, 5, 5], [0, 1, 4, 7]),
            )
        ]
        return context.make_tuple(builder, sig.return_type, columns)

    return types.UniTuple(vec4, 3)(types.int64, types.int64), codegen


@intrinsic
def store4(typingctx, at, i, v):
    """at[i:i+4] = v"""

    def codegen(context, builder, sig, args):
        builder.store(args[2], _pointer(builder, args[0], args[1], _VEC4), align=8)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, vec4), codegen


@intrinsic
def accumulate4(typingctx, at, i, v):
    """at[i:i+4] += v"""

    def codegen(context, builder, sig, args):
        to = _pointer(builder, args[0], args[1], _VEC4)
        builder.store(builder.fadd(builder.load(to, align=8), args[2], flags=("contract",)), to, align=8)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, vec4), codegen


@intrinsic
def axpy4(typingctx, at, i, s, v):
    """at[i:i+4] += s v"""

    def codegen(context, builder, sig, args):
        to = _pointer(builder, args[0], args[1], _VEC4)
        product = builder.fmul(_splat(builder, args[2]), args[3], flags=("contract",))
        builder.store(builder.fadd(builder.load(to, align=8), product, flags=("contract",)), to, align=8)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64, vec4), codegen


def specialise(py_func, tag: str, **names):
    """Compile a copy of `py_func` in which the global `names` have other values, e.g. another β; called from Python."""
    return copy_of(py_func, tag, ENTRY, **names)
