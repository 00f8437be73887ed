"""A user's energy function and its exact derivatives as compiled code: run once on symbols, differentiated backwards, printed and compiled.

A function is called once with objects that record what is done to them. The record is differentiated in reverse (one sweep gives the
derivatives with respect to every argument), common subexpressions are shared, and energy and gradient are printed as one straight piece of Python that
numba compiles. Nothing is differenced numerically. What can be recorded: arithmetic, powers, numpy's and math's elementary functions, ``abs``,
``min``, ``max``, ``numpy.where``, loops and helper functions; what cannot: a branch on the value of an argument (``if d < rc``), since only one of its
sides would be seen. Strings are read without ever being executed, and sympy expressions are taken over node by node.
"""

from __future__ import annotations

import ast
import math
import operator
import types

import numpy as np

from ..errors import AtcError

_UNARY = ("exp", "log", "sqrt", "sin", "cos", "tan", "arcsin", "arccos", "arctan", "sinh", "cosh", "tanh", "expm1", "log1p")
_ERF = ("erf", "erfc")
_BINARY = {"add": "+", "sub": "-", "mul": "*", "div": "/", "pow": "**"}
_COMPARE = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}


class NotRecorded(Exception):
    """Something was done to an argument that cannot be recorded; the message says what to do instead."""


class Tape:
    """A record of operations in the order in which they were first done; the same operation on the same things is recorded once."""

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
            f = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "div": operator.truediv, "pow": operator.pow}[op]
            if not (op == "div" and c[1] == 0.0):
                return self.value(f(*c))
        if op == "neg" and c[0] is not None:
            return self.value(-c[0])
        if op in _UNARY and c[0] is not None:
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
            "a branch (if, while, and, or) on the value of a distance cannot be differentiated: use numpy.where(condition, a, b), with & and | in the condition"
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
            raise NotRecorded(f"numpy.{ufunc.__name__} cannot be differentiated here: use another function, or give gradient=")
        return _call(self.tape, name, inputs)

    def __array_function__(self, func, kinds, args, kwargs):
        if func is np.where and len(args) == 3:
            return self.tape.apply("where", *args)
        if func is np.clip and len(args) == 3:
            return self.tape.apply("minimum", self.tape.apply("maximum", args[0], args[1]), args[2])
        raise NotRecorded(f"numpy.{func.__name__} cannot be differentiated here: use another function, or give gradient=")


_UFUNCS = {n: n for n in _UNARY} | {
    "add": "add", "subtract": "sub", "multiply": "mul", "divide": "div", "true_divide": "div", "power": "pow", "float_power": "pow",
    "negative": "neg", "positive": "pos", "absolute": "abs", "fabs": "abs", "square": "square", "reciprocal": "reciprocal", "cbrt": "cbrt",
    "minimum": "minimum", "maximum": "maximum", "fmin": "minimum", "fmax": "maximum", "arctan2": "arctan2", "hypot": "hypot",
    "less": "lt", "less_equal": "le", "greater": "gt", "greater_equal": "ge", "equal": "eq", "not_equal": "ne",
    "logical_and": "and", "logical_or": "or", "logical_not": "not", "bitwise_and": "and", "bitwise_or": "or", "invert": "not",
}  # fmt: skip


def _call(tape: Tape, name: str, args):
    if name == "pos":
        return args[0]
    if name == "square":
        return tape.apply("mul", args[0], args[0])
    if name == "reciprocal":
        return tape.apply("div", 1.0, args[0])
    if name == "cbrt":
        return tape.apply("pow", args[0], 1.0 / 3.0)
    if name == "hypot":
        return tape.apply("sqrt", tape.apply("add", tape.apply("mul", args[0], args[0]), tape.apply("mul", args[1], args[1])))
    return tape.apply(name, *args)


for _name in (*_UNARY, *_ERF):
    # Object arrays call methods of these names.
    setattr(Value, _name, lambda self, op=_name: self.tape.apply(op, self))


def _function(op: str, plain):
    """`plain` for numbers, recorded for anything else."""

    def f(*args):
        tape = next((a.tape for a in args if isinstance(a, Value)), None)
        return plain(*args) if tape is None else _call(tape, op, args)

    return f


def _fold(op: str, plain):
    """min and max of several things."""

    def f(*args, **kwargs):
        if len(args) == 1 and not kwargs:
            args = tuple(args[0])
        tape = next((a.tape for a in args if isinstance(a, Value)), None)
        if tape is None:
            return plain(*args, **kwargs)
        out = args[0]
        for a in args[1:]:
            out = tape.apply(op, out, a)
        return out

    return f


_MATH_NAMES = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "fabs": "abs", "hypot": "hypot", "pow": "pow"}
_FUNCTIONS = {
    n: _function(_MATH_NAMES.get(n, n), getattr(math, n)) for n in (*(n for n in _UNARY if hasattr(math, n)), *_ERF, *_MATH_NAMES)
}
_REPLACED = {getattr(math, n): f for n, f in _FUNCTIONS.items()} | {min: _fold("minimum", min), max: _fold("maximum", max)}
_MATH = types.SimpleNamespace(**{n: getattr(math, n) for n in dir(math) if not n.startswith("_")} | _FUNCTIONS)


def _recordable(f, done: dict):
    """A copy of a function (and of those it calls) in which math's functions, min and max can be recorded."""
    f = getattr(f, "py_func", f)
    if f is math:
        return _MATH
    try:
        if f in _REPLACED:
            return _REPLACED[f]
    except TypeError:
        return f
    if not isinstance(f, types.FunctionType) or (f.__module__ or "").split(".")[0] in ("numpy", "scipy", "builtins"):
        return f
    if f not in done:
        names = {"min": min, "max": max} | f.__globals__
        own = dict(f.__globals__)
        cells = None if f.__closure__ is None else tuple(types.CellType(_recordable(c.cell_contents, done)) for c in f.__closure__)
        done[f] = types.FunctionType(f.__code__, own, f.__name__, f.__defaults__, cells)
        done[f].__kwdefaults__ = f.__kwdefaults__
        for name in _names_in(f.__code__):
            if name in names:
                own[name] = _recordable(names[name], done)
    return done[f]


def _names_in(code) -> set[str]:
    out = set(code.co_names)
    for c in code.co_consts:
        if isinstance(c, types.CodeType):
            out |= _names_in(c)
    return out


def record(energy, names, parameters, what: str) -> tuple[Tape, Value]:
    """What a function, a string or a sympy expression does to the arguments called `names`.

    parameters : {name: number} for strings and sympy symbols, or keyword arguments of a function

    Raises
    ------
    AtcError that says what cannot be differentiated.
    """
    tape = Tape()
    args = [tape.node("arg", k) for k in range(len(names))]
    parameters = dict(parameters or {})
    try:
        if isinstance(energy, str):
            out = _from_text(energy, tape, dict(zip(names, args, strict=True)) | parameters)
        elif type(energy).__module__.split(".")[0] == "sympy":
            out = _from_sympy(energy, tape, dict(zip(names, args, strict=True)) | parameters)
        else:
            out = _recordable(energy, {})(*args, **parameters)
        return tape, tape.value(out)
    except NotRecorded as e:
        raise AtcError(f"{what}: {e}") from None
    except AtcError:
        raise
    except Exception as e:
        raise AtcError(
            f"{what}: calling the energy function with {len(names)} distances failed: {type(e).__name__}: {str(e).splitlines()[0] if str(e) else ''}"
        ) from None


def _from_text(text: str, tape: Tape, names: dict):
    """Evaluate an arithmetic expression: numbers, names, operators, functions, comparisons, ``a if c else b``. Nothing else is accepted."""
    functions = {n: _function(n, getattr(np, n)) for n in _UNARY} | _FUNCTIONS
    functions |= {
        "abs": _function("abs", abs),
        "min": _REPLACED[min],
        "max": _REPLACED[max],
        "where": lambda c, a, b: tape.apply("where", c, a, b),
    }
    names = {"pi": math.pi} | names
    binary = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.Pow: "pow"}
    compare = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}

    def ev(n):
        if isinstance(n, ast.Constant) and isinstance(n.value, int | float) and not isinstance(n.value, bool):
            return n.value
        if isinstance(n, ast.Name):
            if n.id not in names:
                raise NotRecorded(f"unknown name {n.id!r} in {text!r}: expected {', '.join(names)}")
            return names[n.id]
        if isinstance(n, ast.BinOp) and type(n.op) in binary:
            return tape.apply(binary[type(n.op)], ev(n.left), ev(n.right))
        if isinstance(n, ast.UnaryOp) and isinstance(n.op, ast.USub | ast.UAdd):
            return tape.apply("neg", ev(n.operand)) if isinstance(n.op, ast.USub) else ev(n.operand)
        if isinstance(n, ast.UnaryOp) and isinstance(n.op, ast.Not):
            return tape.apply("not", ev(n.operand))
        if isinstance(n, ast.BoolOp):
            op = "and" if isinstance(n.op, ast.And) else "or"
            out = ev(n.values[0])
            for v in n.values[1:]:
                out = tape.apply(op, out, ev(v))
            return out
        if isinstance(n, ast.Compare) and len(n.ops) == 1 and type(n.ops[0]) in compare:
            return tape.apply(compare[type(n.ops[0])], ev(n.left), ev(n.comparators[0]))
        if isinstance(n, ast.IfExp):
            return tape.apply("where", ev(n.test), ev(n.body), ev(n.orelse))
        if isinstance(n, ast.Call) and isinstance(n.func, ast.Name) and not n.keywords:
            if n.func.id not in functions:
                raise NotRecorded(f"unknown function {n.func.id!r} in {text!r}: expected {', '.join(sorted(functions))}")
            return functions[n.func.id](*(ev(a) for a in n.args))
        raise NotRecorded(f"cannot read {ast.unparse(n)!r} in {text!r}: expected an arithmetic expression")

    try:
        tree = ast.parse(text.strip(), mode="eval")
    except SyntaxError:
        raise NotRecorded(f"cannot read {text!r}: expected an arithmetic expression such as 'k*(d12 - r0)**2'") from None
    return ev(tree.body)


def _from_sympy(e, tape: Tape, names: dict):
    """Node by node; a name that is neither an argument nor a parameter is an error."""
    renamed = {
        "asin": "arcsin",
        "acos": "arccos",
        "atan": "arctan",
        "atan2": "arctan2",
        "Abs": "abs",
        "And": "and",
        "Or": "or",
        "Not": "not",
    }
    relations = {
        "StrictLessThan": "lt",
        "LessThan": "le",
        "StrictGreaterThan": "gt",
        "GreaterThan": "ge",
        "Equality": "eq",
        "Unequality": "ne",
    }

    def ev(n):
        kind = type(n).__name__
        if n.is_Symbol:
            if n.name not in names:
                raise NotRecorded(f"the symbol {n.name} is neither one of {', '.join(names)} nor in parameters=")
            return names[n.name]
        if kind in ("BooleanTrue", "BooleanFalse"):
            return 1.0 if kind == "BooleanTrue" else 0.0
        if n.is_number:
            return float(n)
        if kind == "Piecewise":
            out = float("nan")
            for value, condition in reversed(n.args):
                c = ev(condition)
                out = ev(value) if isinstance(c, float) and c else tape.apply("where", c, ev(value), out)
            return out
        args = [ev(a) for a in n.args]
        folded = {"Add": "add", "Mul": "mul", "And": "and", "Or": "or", "Min": "minimum", "Max": "maximum"}.get(kind)
        if folded:
            out = args[0]
            for a in args[1:]:
                out = tape.apply(folded, out, a)
            return out
        op = {"Pow": "pow", "Not": "not"}.get(kind) or relations.get(kind) or renamed.get(kind, kind)
        if op in (*_UNARY, *_ERF, "pow", "not", "abs", "arctan2", *_COMPARE):
            return tape.apply(op, *args)
        raise NotRecorded(f"sympy's {kind} is not supported")

    return ev(e)


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
        me = Value(tape, k)
        a = [Value(tape, i) for i in args] if op not in ("arg", "const") else []
        if op == "add":
            give(args[0], g)
            give(args[1], g)
        elif op == "sub":
            give(args[0], g)
            give(args[1], -g)
        elif op == "neg":
            give(args[0], -g)
        elif op == "mul":
            give(args[0], x(g, a[1]))
            give(args[1], x(g, a[0]))
        elif op == "div":
            give(args[0], x(g, 1.0 / a[1]))
            give(args[1], -x(g, me / a[1]))
        elif op == "pow":
            c = a[1].constant
            if c is not None:
                give(args[0], x(g, c * a[0] ** (c - 1.0)))
            else:
                give(args[0], x(g, a[1] * a[0] ** (a[1] - 1.0)))
                give(args[1], x(g, me * a[0].log()))
        elif op == "where":
            give(args[1], tape.apply("where", a[0], g, 0.0))
            give(args[2], tape.apply("where", a[0], 0.0, g))
        elif op in ("minimum", "maximum"):
            first = tape.apply("le" if op == "minimum" else "ge", a[0], a[1])
            give(args[0], tape.apply("where", first, g, 0.0))
            give(args[1], tape.apply("where", first, 0.0, g))
        elif op == "abs":
            give(args[0], tape.apply("where", tape.apply("ge", a[0], 0.0), g, -g))
        elif op == "arctan2":
            r2 = a[0] * a[0] + a[1] * a[1]
            give(args[0], x(g, a[1] / r2))
            give(args[1], -x(g, a[0] / r2))
        elif op in _SLOPES:
            give(args[0], x(g, _SLOPES[op](a[0], me)))
    zero = tape.value(0.0)
    return [adjoint.get(tape.known[("arg", k)], zero) for k in range(n_args)]


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
        if op != "const":
            return f"v{k}"
        return (
            repr(args[0])
            if math.isfinite(args[0])
            else f"np.{'nan' if args[0] != args[0] else 'inf' if args[0] > 0 else 'NINF'}".replace("np.NINF", "(-np.inf)")
        )

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
            if op in _BINARY or op in _COMPARE:
                text = f"{n[0]} {_BINARY.get(op) or _COMPARE[op]} {n[1]}"
            elif op == "neg":
                text = f"-{n[0]}"
            elif op == "weigh":
                text = f"{n[0]} * {n[1]} if {n[0]} != 0.0 else 0.0"
            elif op == "where":
                text = f"{n[1]} if {n[0]} else {n[2]}"
            elif op in ("and", "or"):
                text = f"bool({n[0]}) {op} bool({n[1]})"
            elif op == "not":
                text = f"not {n[0]}"
            elif op == "minimum":
                text = f"{n[0]} if {n[0]} <= {n[1]} else {n[1]}"
            elif op == "maximum":
                text = f"{n[0]} if {n[0]} >= {n[1]} else {n[1]}"
            elif op == "abs":
                text = f"abs({n[0]})"
            elif op in _ERF:
                text = f"math.{op}({n[0]})"
            else:
                text = f"np.{op}({', '.join(n)})"
        lines.append(f"        v{k} = {text}")
    lines.append(f"        U[t] = {name(out.index)}")
    lines += [f"        G[t, {k}] = {name(s.index)}" for k, s in enumerate(slopes)]
    return "\n".join(lines) + "\n"


def batch_source(energy, names, parameters, what: str) -> str:
    """The `source` of an energy function and its gradient."""
    tape, out = record(energy, names, parameters, what)
    return source(tape, out, gradient(tape, out, len(names)))


def compiled(text: str):
    """The compiled function of a `source`."""
    from numba import njit

    space = {"np": np, "math": math}
    exec(compile(text, "<energy and gradient>", "exec"), space)
    return njit(nogil=True, error_model="numpy")(space["f"])
