"""Recorded arithmetic and its derivatives: what turns a user's energy function into compiled code for energy and
gradient.

A function is called once with `Value`s, which record on a `Tape` what is done to them (`atc.decomposers.recording`).
The record is differentiated in reverse (one sweep gives the derivatives with respect to every argument), common
subexpressions are shared, and energy and gradient are printed as one straight piece of Python that numba compiles.
Nothing is differenced numerically.
"""

from __future__ import annotations

import math
import operator

import numpy as np

UNARY = tuple("exp log sqrt sin cos tan arcsin arccos arctan sinh cosh tanh expm1 log1p".split())
ERF = ("erf", "erfc")
_BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/", "pow": "**"}
COMPARE = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}


class NotRecorded(Exception):
    """Something was done to an argument that cannot be recorded; the message says what to do instead."""


class Tape:
    """A record of operations in the order in which they were first done; the same operation on the same things is
    recorded once."""

    def __init__(self):
        self.nodes: list[tuple] = []
        self.known: dict[tuple, int] = {}

    def node(self, op: str, *args) -> Value:
        key = (op, *args)
        if key not in self.known:
            self.known[key] = len(self.nodes)
            self.nodes.append(key)
        return Value(self, self.known[key])

    def value(self, x) -> Value:
        if isinstance(x, Value):
            return x
        if isinstance(x, np.ndarray) and x.ndim == 0:
            x = x.item()
        if isinstance(x, bool | int | float | np.number):
            return self.node("const", float(x))
        raise NotRecorded(f"expected a number, got {type(x).__name__}")

    def apply(self, op: str, *args) -> Value:
        """Record an operation, with what is known without knowing the arguments worked out."""
        args = [self.value(a) for a in args]
        c = [a.constant for a in args]
        if op in ("add", "sub") and c[1] == 0.0:
            return args[0]
        if op == "add" and c[0] == 0.0:
            return args[1]
        if op == "mul" and 0.0 in c:
            return self.value(0.0)
        if op in ("mul", "div", "pow") and c[1] == 1.0:
            return args[0]
        if op == "mul" and c[0] == 1.0:
            return args[1]
        if op == "pow" and c[1] == 0.0:
            return self.value(1.0)
        if op == "sub" and c[0] == 0.0:
            return self.apply("neg", args[1])
        if op in _BINARY and None not in c:
            if not (op == "div" and c[1] == 0.0):
                return self.value(getattr(operator, {"div": "truediv"}.get(op, op))(*c))
        if op == "neg" and c[0] is not None:
            return self.value(-c[0])
        if op in UNARY and c[0] is not None:
            return self.value(float(getattr(np, op)(c[0])))
        if op in ("add", "mul") and args[0].index > args[1].index:
            args = args[::-1]
        return self.node(op, *(a.index for a in args))


def _method(op, reverse=False):
    def f(self, other):
        if isinstance(other, np.ndarray) and other.ndim:
            return NotImplemented
        return self.tape.apply(op, other, self) if reverse else self.tape.apply(op, self, other)

    return f


class Value:
    """A recorded number."""

    __slots__ = ("index", "tape")
    __array_priority__ = 100

    def __init__(self, tape: Tape, index: int):
        self.tape, self.index = tape, index

    @property
    def constant(self) -> float | None:
        n = self.tape.nodes[self.index]
        return n[1] if n[0] == "const" else None

    __add__, __radd__ = _method("add"), _method("add", True)
    __sub__, __rsub__ = _method("sub"), _method("sub", True)
    __mul__, __rmul__ = _method("mul"), _method("mul", True)
    __truediv__, __rtruediv__ = _method("div"), _method("div", True)
    __pow__, __rpow__ = _method("pow"), _method("pow", True)
    __lt__, __le__, __gt__, __ge__ = _method("lt"), _method("le"), _method("gt"), _method("ge")
    __eq__, __ne__ = _method("eq"), _method("ne")
    __and__, __rand__ = _method("and"), _method("and", True)
    __or__, __ror__ = _method("or"), _method("or", True)
    __hash__ = None

    def __neg__(self):
        return self.tape.apply("neg", self)

    def __pos__(self):
        return self

    def __invert__(self):
        return self.tape.apply("not", self)

    def __abs__(self):
        return self.tape.apply("abs", self)

    def __bool__(self):
        raise NotRecorded(
            "a branch (if, while, and, or) on the value of a distance cannot be differentiated: use "
            "numpy.where(condition, a, b), with & and | in the condition"
        )

    def __float__(self):
        raise NotRecorded("float() or a function of numbers only was applied to a distance: use numpy's functions")

    __int__ = __index__ = __float__

    def __array_ufunc__(self, ufunc, method, *inputs, **kwargs):
        if method != "__call__" or kwargs or any(isinstance(x, np.ndarray) and x.ndim for x in inputs):
            # Arrays of recorded numbers: numpy applies the operators and the methods below to each.
            return NotImplemented
        name = _UFUNCS.get(ufunc.__name__)
        if name is None:
            raise NotRecorded(
                f"numpy.{ufunc.__name__} cannot be differentiated here: use another function, or give gradient="
            )
        return call(self.tape, name, inputs)

    def __array_function__(self, func, kinds, args, kwargs):
        if func is np.where and len(args) == 3:
            return self.tape.apply("where", *args)
        if func is np.clip and len(args) == 3:
            return self.tape.apply("minimum", self.tape.apply("maximum", args[0], args[1]), args[2])
        raise NotRecorded(
            f"numpy.{func.__name__} cannot be differentiated here: use another function, or give gradient="
        )


_SAME = (*UNARY, "square", "reciprocal", "cbrt", "minimum", "maximum", "arctan2", "hypot")
_UFUNCS = {n: n for n in _SAME} | {
    "add": "add",
    "subtract": "sub",
    "multiply": "mul",
    "divide": "div",
    "true_divide": "div",
    "power": "pow",
    "float_power": "pow",
    "negative": "neg",
    "positive": "pos",
    "absolute": "abs",
    "fabs": "abs",
    "fmin": "minimum",
    "fmax": "maximum",
    "less": "lt",
    "less_equal": "le",
    "greater": "gt",
    "greater_equal": "ge",
    "equal": "eq",
    "not_equal": "ne",
    "logical_and": "and",
    "logical_or": "or",
    "logical_not": "not",
    "bitwise_and": "and",
    "bitwise_or": "or",
    "invert": "not",
}


def call(tape: Tape, name: str, args):
    """A numpy function by its name, as operations on the tape."""
    if name == "pos":
        return args[0]
    if name == "square":
        return tape.apply("mul", args[0], args[0])
    if name == "reciprocal":
        return tape.apply("div", 1.0, args[0])
    if name == "cbrt":
        return tape.apply("pow", args[0], 1.0 / 3.0)
    if name == "hypot":
        return tape.apply(
            "sqrt", tape.apply("add", tape.apply("mul", args[0], args[0]), tape.apply("mul", args[1], args[1]))
        )
    return tape.apply(name, *args)


for _name in (*UNARY, *ERF):
    # Object arrays call methods of these names.
    setattr(Value, _name, lambda self, op=_name: self.tape.apply(op, self))


def gradient(tape: Tape, out: Value, n_args: int) -> list[Value]:
    """∂out/∂argument, in reverse. Recorded on the same tape."""
    last = out.index
    # Below a `where`, what is not chosen may be infinite or undefined; its weight 0 must win.
    times = "weigh" if any(n[0] == "where" for n in tape.nodes[: last + 1]) else "mul"
    adjoint: dict[int, Value] = {last: tape.value(1.0)}

    def give(k, v):
        if tape.nodes[k][0] != "const":
            adjoint[k] = tape.apply("add", adjoint[k], v) if k in adjoint else v

    def x(a, b):
        a = tape.value(a)
        if a.constant is not None or times == "mul":
            return tape.apply("mul", a, b)
        b = tape.value(b)
        return a if b.constant == 1.0 else tape.node("weigh", a.index, b.index)

    for k in range(last, -1, -1):
        if k not in adjoint:
            continue
        g = adjoint[k]
        op, *args = tape.nodes[k]
        if op in ("arg", "const"):
            continue
        me, a = Value(tape, k), [Value(tape, i) for i in args]
        if op in _SLOPES:
            give(args[0], x(g, _SLOPES[op](*a, me)))
        elif op == "pow" and a[1].constant is not None:
            give(args[0], x(g, a[1].constant * a[0] ** (a[1].constant - 1.0)))
        elif op in _SHARES:
            for i, v in zip(args, _SHARES[op](g, x, me, *a), strict=True):
                if v is not None:
                    give(i, v)
    zero = tape.value(0.0)
    return [adjoint.get(tape.known[("arg", k)], zero) for k in range(n_args)]


def _either(g, first):
    """The adjoint of a choice, for the first and the second."""
    return g.tape.apply("where", first, g, 0.0), g.tape.apply("where", first, 0.0, g)


# What of the adjoint g of `me` comes to each of its arguments; x multiplies.
_SHARES = {
    "add": lambda g, x, me, a, b: (g, g),
    "sub": lambda g, x, me, a, b: (g, -g),
    "neg": lambda g, x, me, a: (-g,),
    "mul": lambda g, x, me, a, b: (x(g, b), x(g, a)),
    "div": lambda g, x, me, a, b: (x(g, 1.0 / b), -x(g, me / b)),
    "pow": lambda g, x, me, a, b: (x(g, b * a ** (b - 1.0)), x(g, me * a.log())),
    "where": lambda g, x, me, c, a, b: (None, *_either(g, c)),
    "minimum": lambda g, x, me, a, b: _either(g, g.tape.apply("le", a, b)),
    "maximum": lambda g, x, me, a, b: _either(g, g.tape.apply("ge", a, b)),
    "abs": lambda g, x, me, a: (g.tape.apply("where", g.tape.apply("ge", a, 0.0), g, -g),),
    "arctan2": lambda g, x, me, a, b: (x(g, b / (a * a + b * b)), -x(g, a / (a * a + b * b))),
}
_SLOPES = {
    "exp": lambda a, y: y,
    "expm1": lambda a, y: y + 1.0,
    "log": lambda a, y: 1.0 / a,
    "log1p": lambda a, y: 1.0 / (a + 1.0),
    "sqrt": lambda a, y: 0.5 / y,
    "sin": lambda a, y: a.cos(),
    "cos": lambda a, y: -a.sin(),
    "tan": lambda a, y: 1.0 + y * y,
    "arcsin": lambda a, y: 1.0 / (1.0 - a * a).sqrt(),
    "arccos": lambda a, y: -1.0 / (1.0 - a * a).sqrt(),
    "arctan": lambda a, y: 1.0 / (1.0 + a * a),
    "sinh": lambda a, y: a.cosh(),
    "cosh": lambda a, y: a.sinh(),
    "tanh": lambda a, y: 1.0 - y * y,
    "erf": lambda a, y: 2.0 / math.sqrt(math.pi) * (-(a * a)).exp(),
    "erfc": lambda a, y: -2.0 / math.sqrt(math.pi) * (-(a * a)).exp(),
}


_TEXTS = {
    **{op: f"{{0}} {sign} {{1}}" for op, sign in (_BINARY | COMPARE).items()},
    **{op: f"math.{op}({{0}})" for op in ERF},
    "neg": "-{0}",
    "weigh": "{0} * {1} if {0} != 0.0 else 0.0",
    "where": "{1} if {0} else {2}",
    "and": "bool({0}) and bool({1})",
    "or": "bool({0}) or bool({1})",
    "not": "not {0}",
    "minimum": "{0} if {0} <= {1} else {1}",
    "maximum": "{0} if {0} >= {1} else {1}",
    "abs": "abs({0})",
}


def source(tape: Tape, out: Value, slopes: list[Value]) -> str:
    """Python for ``f(Q, U, G)``: for every row of Q (terms, arguments) the energy into U and its derivatives into G."""
    used: set[int] = set()
    stack = [out.index, *(s.index for s in slopes)]
    while stack:
        k = stack.pop()
        if k not in used:
            used.add(k)
            op, *args = tape.nodes[k]
            if op not in ("arg", "const"):
                stack += args
    lines = ["def f(Q, U, G):", "    for t in range(Q.shape[0]):"]

    def name(k):
        op, *args = tape.nodes[k]
        return f"({args[0]!r})" if op == "const" else f"v{k}"

    for k in sorted(used):
        op, *args = tape.nodes[k]
        if op == "const":
            continue
        if op == "arg":
            text = f"Q[t, {args[0]}]"
        elif op == "pow" and tape.nodes[args[1]][0] == "const":
            c = tape.nodes[args[1]][1]
            # Whole powers are products in compiled code.
            text = f"{name(args[0])} ** ({int(c)})" if c == int(c) and abs(c) <= 64 else f"{name(args[0])} ** ({c!r})"
        else:
            n = [name(a) for a in args]
            text = _TEXTS[op].format(*n) if op in _TEXTS else f"np.{op}({', '.join(n)})"
        lines.append(f"        v{k} = {text}")
    lines.append(f"        U[t] = {name(out.index)}")
    lines += [f"        G[t, {k}] = {name(s.index)}" for k, s in enumerate(slopes)]
    return "\n".join(lines) + "\n"


def compiled(text: str):
    """The compiled function of a `source`."""
    from ..compiled import njit

    space = {"np": np, "math": math, "inf": math.inf, "nan": math.nan}
    exec(compile(text, "<energy and gradient>", "exec"), space)
    return njit(nogil=True, error_model="numpy")(space["f"])
