"""The one language of formulas, in files and on the command line, like ``16.5*min(t/1e-6, 1)``: arithmetic, comparisons
and a few functions of named variables, and nothing else. docs/formulas.md says it all.

The text is parsed by Python's own parser and every node of the tree is translated on its own; what is not on the list
is an error that says where it stands. Nothing is ever handed to ``eval``.
"""

from __future__ import annotations

import ast
from collections.abc import Callable
from functools import reduce

import numpy as np

from ..errors import AtcError
from .words import unknown

_LONGEST = 2000
# Well inside of what Python's own stack allows.
_DEEPEST = 150

_BINARY = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.Pow: np.power,
    ast.Mod: np.mod,
}
_COMPARE = {
    ast.Lt: np.less,
    ast.LtE: np.less_equal,
    ast.Gt: np.greater,
    ast.GtE: np.greater_equal,
    ast.Eq: np.equal,
    ast.NotEq: np.not_equal,
}
# name: (function, fewest arguments, most arguments)
FUNCTIONS = {
    **{
        name: (getattr(np, {"asin": "arcsin", "acos": "arccos", "atan": "arctan"}.get(name, name)), 1, 1)
        for name in "sin cos tan asin acos atan sinh cosh tanh exp log log10 sqrt abs floor ceil sign".split()
    },
    "atan2": (np.arctan2, 2, 2),
    "min": (lambda *a: reduce(np.minimum, a), 2, 99),
    "max": (lambda *a: reduce(np.maximum, a), 2, 99),
    "where": (lambda c, a, b: np.where(c, a, b), 3, 3),
    "heaviside": (lambda a: np.heaviside(a, 0.5), 1, 1),
    "step": (lambda a: np.heaviside(a, 0.5), 1, 1),
}
CONSTANTS = {"pi": np.pi, "e": np.e}


class Formula:
    """A function of named variables, written as text.

    Parameters
    ----------
    text : e.g. ``"0.5*(1 - cos(2*pi*t/1e-6))"``. Known are + - * / % and ^ or ** (the power), comparisons, ``and or
        not``, ``a if c else b``, numbers, pi, e, the functions of `FUNCTIONS` (log is natural, heaviside(0) = step(0) =
        1/2) and the variables, which come before constants of the same name
    variables : their names
    words : what else could have been written in the formula's place, for the complaint about an unknown name

    Attributes: ``text``, ``uses`` (the variables that occur). Equal texts of the same variables are equal formulas.
    Raises ValueError that names the character where something is wrong.
    """

    def __init__(self, text: str, variables=("t",), words=()):
        self.text, self.variables = str(text), tuple(variables)
        self._words = tuple(words)
        self.uses: set[str] = set()
        shift = len(self.text) - len(self.text.lstrip())
        source = self.text.strip().replace("\n", " ")
        if not source:
            raise ValueError("an empty formula")
        if len(source) > _LONGEST:
            raise ValueError(f"a formula of more than {_LONGEST} characters: give a table of times and values")
        self._shift = shift
        # Python's ^ binds otherwise than a power. Characters of what is parsed, as characters of the text:
        self._origin = [k for k, c in enumerate(source) for _ in range(1 + (c == "^"))]
        source = source.replace("^", "**")
        try:
            tree = ast.parse(source, mode="eval")
        except SyntaxError as e:
            raise self._wrong(self._at((e.offset or 1) - 1), "this is not a formula") from None
        except (ValueError, RecursionError, MemoryError):
            raise ValueError(f"{self._shown()} is not a formula") from None
        self._source = source.encode()
        self._depth = 0
        self._value = self._translate(tree.body)

    def __call__(self, **values):
        """The value at these values of the variables, numbers or arrays that broadcast. Not finite is the caller's to
        refuse: see `finite`."""
        with np.errstate(all="ignore"):
            return np.asarray(self._value(values), float)

    def finite(self, complain, **values):
        """As a call, but infinity and what is not a number are an error made by `complain(why)`."""
        out = self(**values)
        if not np.isfinite(out).all():
            bad = np.flatnonzero(~np.isfinite(np.ravel(out)))[0]
            there = {v: float(np.broadcast_to(np.asarray(values[v], float), out.shape).ravel()[bad]) for v in self.uses}
            at = ", ".join(f"{name} = {there[name]:.6g}" for name in sorted(there))
            raise complain(
                f"{self._shown()} is {float(np.ravel(out)[bad])} at {at}" if at else f"{self._shown()} is not finite"
            )
        return out

    def __eq__(self, other):
        return type(other) is type(self) and (self.text, self.variables) == (other.text, other.variables)

    def __hash__(self):
        return hash((self.text, self.variables))

    def __repr__(self):
        return f"Formula({self.text!r}, {self.variables})"

    # ---- from the tree to functions of {name: value}

    def _translate(self, node):
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ValueError(f"{self._shown()} is nested too deeply: use brackets, or a table of times and values")
        try:
            return self._part(node)
        finally:
            self._depth -= 1

    def _part(self, node):
        if isinstance(node, ast.Constant):
            return self._number(node)
        if isinstance(node, ast.Name):
            return self._name(node)
        if isinstance(node, ast.BinOp) and type(node.op) in _BINARY:
            f, a, b = _BINARY[type(node.op)], self._translate(node.left), self._translate(node.right)
            return lambda v: f(a(v), b(v))
        if isinstance(node, ast.UnaryOp):
            a = self._translate(node.operand)
            if isinstance(node.op, ast.USub):
                return lambda v: np.negative(a(v))
            if isinstance(node.op, ast.UAdd):
                return a
            if isinstance(node.op, ast.Not):
                return lambda v: np.logical_not(a(v))
        if isinstance(node, ast.Compare) and all(type(op) in _COMPARE for op in node.ops):
            parts = [self._translate(n) for n in (node.left, *node.comparators)]
            tests = [_COMPARE[type(op)] for op in node.ops]
            return lambda v: reduce(
                np.logical_and, (f(a(v), b(v)) for f, a, b in zip(tests, parts, parts[1:], strict=False))
            )
        if isinstance(node, ast.BoolOp):
            both: Callable = np.logical_and if isinstance(node.op, ast.And) else np.logical_or
            parts = [self._translate(n) for n in node.values]
            return lambda v: reduce(both, (p(v) for p in parts))
        if isinstance(node, ast.IfExp):
            c, a, b = (self._translate(n) for n in (node.test, node.body, node.orelse))
            return lambda v: np.where(c(v), a(v), b(v))
        if isinstance(node, ast.Call):
            return self._call(node)
        raise self._wrong(self._place(node), "only arithmetic, comparisons and functions of numbers are known here")

    def _number(self, node):
        if isinstance(node.value, bool) or not isinstance(node.value, (int, float)):
            raise self._wrong(self._place(node), f"expected a number, got {str(node.value)[:20]!r}")
        try:
            number = float(node.value)
        except OverflowError:
            number = np.inf
        if not np.isfinite(number):
            raise self._wrong(self._place(node), "this number is too large")
        return lambda v: number

    def _name(self, node):
        name = node.id
        if name in self.variables:
            self.uses.add(name)
            return lambda v: v[name]
        if name in CONSTANTS:
            return lambda v: CONSTANTS[name]
        if name in FUNCTIONS:
            raise self._wrong(self._place(node), f"{name} is a function: write {name}(...)")
        known = [*self.variables, *CONSTANTS, *self._words]
        raise self._wrong(self._place(node), unknown(repr(name), name, known))

    def _call(self, node):
        if not isinstance(node.func, ast.Name):
            raise self._wrong(self._place(node), "only functions by their names are known here")
        name = node.func.id
        if name not in FUNCTIONS:
            raise self._wrong(self._place(node), unknown(f"function {name!r}", name, sorted(FUNCTIONS)))
        f, fewest, most = FUNCTIONS[name]
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args) or not fewest <= len(node.args) <= most:
            want = f"{fewest} or more arguments" if most > fewest else f"{fewest} argument{'s' * (fewest > 1)}"
            raise self._wrong(self._place(node), f"{name} takes {want}")
        arguments = [self._translate(a) for a in node.args]
        return lambda v: f(*(a(v) for a in arguments))

    # ---- where something is wrong

    def _place(self, node) -> int:
        """The character of the text where a node begins; the tree counts bytes."""
        return self._at(len(self._source[: node.col_offset].decode(errors="ignore")))

    def _at(self, k: int) -> int:
        return self._shift + (self._origin[k] if k < len(self._origin) else len(self.text))

    def _shown(self) -> str:
        text = " ".join(self.text.split())
        return f'"{text if len(text) <= 60 else text[:57] + "..."}"'

    def _wrong(self, place: int, why: str) -> ValueError:
        return ValueError(f"in {self._shown()}, character {min(place, len(self.text)) + 1}: {why}")


def formula(text: str, variable: str, what: str, words=(), **constants: float):
    """The function of one array that `text` says, e.g. formula("0.5 + sin(2*pi*x)", "x", "--initial").

    Raises
    ------
    AtcError
        that names `what`, the character, and what there is.
    """
    try:
        said = Formula(text, (variable, *constants), words)
    except ValueError as e:
        raise AtcError(f"{what}: {e}") from None

    def evaluate(values):
        values = np.asarray(values, dtype=float)
        return np.array(np.broadcast_to(said(**{variable: values}, **constants), values.shape))

    return evaluate


#: Variables of an influence function: the bond's vector, its length and the horizon.
INFLUENCE_LETTERS = ("r", "delta", "x", "y", "z")


class Influence(Formula):
    """ω(r, delta) by a formula of the bond's length and the horizon, as a function that the materials take.

    unit : of the formula's lengths, in those of the body
    """

    def __init__(self, text: str, unit: float = 1.0):
        super().__init__(text, ("r", "delta"))
        self.unit = float(unit)

    def __eq__(self, other):
        return super().__eq__(other) and self.unit == other.unit

    __hash__ = Formula.__hash__

    def __call__(self, *args, **values):
        if not args:
            return super().__call__(**values)
        r, delta = (a / self.unit for a in args)
        w = self.finite(lambda why: AtcError(f"influence: {why}"), r=r, delta=delta)
        if (w < 0).any():
            raise AtcError(
                f"influence: {self._shown()} is negative at r = "
                f"{float(np.asarray(r)[np.broadcast_to(w, np.shape(r)) < 0][0]):.6g}"
            )
        return np.array(np.broadcast_to(w, np.shape(r)))


class DirectedInfluence:
    """ω(ξ) by a formula of the bond's vector x, y, z, its length r and the horizon delta, as a function of (b, 3)
    vectors alone. delta : of the body; unit : of the formula's lengths, in the body's."""

    def __init__(self, text: str, delta: float, unit: float = 1.0):
        self.formula, self.delta, self.unit = Formula(text, INFLUENCE_LETTERS), float(delta), float(unit)

    def _key(self):
        return self.formula, self.delta, self.unit

    def __eq__(self, other):
        return type(other) is type(self) and self._key() == other._key()

    def __hash__(self):
        return hash(self._key())

    def __call__(self, xi_bc):
        xi = np.asarray(xi_bc, float) / self.unit
        r, delta = np.sqrt((xi * xi).sum(axis=1)), self.delta / self.unit
        complain = lambda why: AtcError(f"influence: {why}")  # noqa: E731
        w = self.formula.finite(complain, r=r, delta=delta, **dict(zip("xyz", xi.T, strict=True)))
        return np.array(np.broadcast_to(w, r.shape))


def influence(text: str, delta: float, unit: float = 1.0):
    """The influence function that a formula says: of (r, delta), or, where it uses x, y or z, of the bond's vector."""
    if Formula(text, INFLUENCE_LETTERS).uses & {"x", "y", "z"}:
        return DirectedInfluence(text, delta, unit)
    return Influence(text, unit)
