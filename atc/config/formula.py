"""Formulas people type on the command line, as functions of arrays: numbers, one variable, + - * / ^, a few functions.
Nothing else is executed."""

from __future__ import annotations

import ast

import numpy as np

from ..errors import AtcError

FUNCTIONS = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "tanh": np.tanh,
    "abs": np.abs,
    "sign": np.sign,
    "heaviside": lambda v: np.heaviside(v, 0.5),
}
CONSTANTS = {"pi": np.pi, "e": np.e}
_BINARY = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Pow: np.power}
_UNARY = {ast.UAdd: np.positive, ast.USub: np.negative}


def formula(text: str, variable: str, what: str, **constants: float):
    """The function of `variable` that `text` says, e.g. formula("0.5 + sin(2*pi*x)", "x", "--initial"). `^` and `**`
    are powers.

    Raises
    ------
    AtcError
        that names `what`, the part that was not understood, and what there is.
    """
    names = CONSTANTS | constants
    try:
        tree = ast.parse(text.replace("^", "**"), mode="eval").body
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        raise AtcError(
            f"{what} {text!r}: not a formula of {variable}; expected something like sin(2*pi*{variable})"
        ) from None

    def build(node):
        if isinstance(node, ast.Constant) and isinstance(node.value, (int, float)) and not isinstance(node.value, bool):
            return lambda v, c=float(node.value): c
        if isinstance(node, ast.Name):
            if node.id == variable:
                return lambda v: v
            if node.id in names:
                return lambda v, c=float(names[node.id]): c
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            op, left, right = _BINARY[type(node.op)], build(node.left), build(node.right)
            return lambda v: op(left(v), right(v))
        if isinstance(node, ast.UnaryOp) and type(node.op) in _UNARY:
            op, inner = _UNARY[type(node.op)], build(node.operand)
            return lambda v: op(inner(v))
        if (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in FUNCTIONS
            and len(node.args) == 1
            and not node.keywords
        ):
            op, inner = FUNCTIONS[node.func.id], build(node.args[0])
            return lambda v: op(inner(v))
        raise AtcError(
            f"{what} {text!r}: {ast.unparse(node)!r} is not understood; there are {variable}, {', '.join(names)}, + - "
            f"* / ^ and {', '.join(FUNCTIONS)} of one argument"
        )

    try:
        function = build(tree)
    except RecursionError:
        raise AtcError(f"{what}: the formula is nested too deeply") from None

    def evaluate(values):
        values = np.asarray(values, dtype=float)
        with np.errstate(all="ignore"):
            return np.broadcast_to(np.asarray(function(values), dtype=float), values.shape).copy()

    return evaluate
