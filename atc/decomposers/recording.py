"""What users write (a function, a text, a sympy expression) recorded as arithmetic that can be differentiated.

What can be recorded of a function: arithmetic, powers, numpy's and math's elementary functions, ``abs``, ``min``,
``max``, ``numpy.where``, loops and helper functions. What cannot: a branch on the value of an argument (``if d < rc``),
since only one of its sides would be seen. Texts are read without ever being executed; sympy expressions are taken over
node by node.
"""

from __future__ import annotations

import ast
import math
import types

import numpy as np

from ..errors import AtcError
from .autodiff import COMPARE, ERF, UNARY, NotRecorded, Tape, Value, call, gradient, source


def _function(op: str, plain):
    """`plain` for numbers, recorded for anything else."""

    def f(*args):
        tape = next((a.tape for a in args if isinstance(a, Value)), None)
        return plain(*args) if tape is None else call(tape, op, args)

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


_MATH_NAMES = {
    "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "fabs": "abs", "hypot": "hypot",
    "pow": "pow",
}  # fmt: skip
_FUNCTIONS = {
    n: _function(_MATH_NAMES.get(n, n), getattr(math, n))
    for n in (*(n for n in UNARY if hasattr(math, n)), *ERF, *_MATH_NAMES)
}
_REPLACED = {getattr(math, n): f for n, f in _FUNCTIONS.items()} | {
    min: _fold("minimum", min),
    max: _fold("maximum", max),
}
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
        cells = (
            None
            if f.__closure__ is None
            else tuple(types.CellType(_recordable(c.cell_contents, done)) for c in f.__closure__)
        )
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
            f"{what}: calling the energy function with {len(names)} distances failed: {type(e).__name__}: "
            f"{str(e).splitlines()[0] if str(e) else ''}"
        ) from None


def _from_text(text: str, tape: Tape, names: dict):
    """Evaluate an arithmetic expression: numbers, names, operators (``^`` and ``**`` are the power), functions,
    comparisons, ``a if c else b``. Nothing else is accepted."""
    functions = {n: _function(n, getattr(np, n)) for n in UNARY} | _FUNCTIONS
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
                raise NotRecorded(
                    f"unknown function {n.func.id!r} in {text!r}: expected {', '.join(sorted(functions))}"
                )
            return functions[n.func.id](*(ev(a) for a in n.args))
        raise NotRecorded(f"cannot read {ast.unparse(n)!r} in {text!r}: expected an arithmetic expression")

    try:
        tree = ast.parse(text.strip().replace("^", "**"), mode="eval")
    except SyntaxError:
        raise NotRecorded(
            f"cannot read {text!r}: expected an arithmetic expression such as 'k*(d12 - r0)**2'"
        ) from None
    return ev(tree.body)


def _from_sympy(e, tape: Tape, names: dict):
    """Node by node; a name that is neither an argument nor a parameter is an error."""
    renamed = {
        "asin": "arcsin", "acos": "arccos", "atan": "arctan", "atan2": "arctan2", "Abs": "abs", "And": "and",
        "Or": "or", "Not": "not",
    }  # fmt: skip
    relations = {
        "StrictLessThan": "lt", "LessThan": "le", "StrictGreaterThan": "gt", "GreaterThan": "ge", "Equality": "eq",
        "Unequality": "ne",
    }  # fmt: skip

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
        if op in (*UNARY, *ERF, "pow", "not", "abs", "arctan2", *COMPARE):
            return tape.apply(op, *args)
        raise NotRecorded(f"sympy's {kind} is not supported")

    return ev(e)


def batch_source(energy, names, parameters, what: str) -> str:
    """The `source` of an energy function and its gradient."""
    tape, out = record(energy, names, parameters, what)
    return source(tape, out, gradient(tape, out, len(names)))
