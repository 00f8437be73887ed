"""LAMMPS variables: ``${name}``, ``$x``, ``$(formula)`` and the arithmetic of equal-style formulas, evaluated without running anything.

Only what is known from the text counts: numbers, constants, other variables. A formula that needs the simulation (thermo keywords, computes, fixes,
random numbers, files, the environment) is an error, raised only where a line of the model needs its value.
"""

from __future__ import annotations

import math
import re

_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][-+]?\d+)?|\.\d+(?:[eE][-+]?\d+)?)|([A-Za-z_][A-Za-z0-9_\[\]]*)|(\|\||\|\^|&&|==|!=|<=|>=|[-+*/%^()<>!,]))"
)
_CONSTANTS = {"PI": math.pi, "yes": 1.0, "on": 1.0, "true": 1.0, "no": 0.0, "off": 0.0, "false": 0.0}
_FUNCTIONS = {
    "sqrt": (1, math.sqrt),
    "exp": (1, math.exp),
    "ln": (1, math.log),
    "log": (1, math.log10),
    "abs": (1, abs),
    "sign": (1, lambda x: 1.0 if x >= 0 else -1.0),
    "sin": (1, math.sin),
    "cos": (1, math.cos),
    "tan": (1, math.tan),
    "asin": (1, math.asin),
    "acos": (1, math.acos),
    "atan": (1, math.atan),
    "atan2": (2, math.atan2),
    "sinh": (1, math.sinh),
    "cosh": (1, math.cosh),
    "tanh": (1, math.tanh),
    "ceil": (1, math.ceil),
    "floor": (1, math.floor),
    "round": (1, lambda x: math.ceil(x) if x - math.floor(x) >= 0.5 else math.floor(x)),
    "ternary": (3, lambda c, a, b: a if c else b),
}
# LAMMPS's order (Variable::evaluate): all binary operators associate to the left, unary minus and ! bind tightest.
_BINARY = {
    "||": (1, lambda a, b: float(bool(a) or bool(b))),
    "|^": (1, lambda a, b: float(bool(a) != bool(b))),
    "&&": (2, lambda a, b: float(bool(a) and bool(b))),
    "==": (3, lambda a, b: float(a == b)),
    "!=": (3, lambda a, b: float(a != b)),
    "<": (4, lambda a, b: float(a < b)),
    "<=": (4, lambda a, b: float(a <= b)),
    ">": (4, lambda a, b: float(a > b)),
    ">=": (4, lambda a, b: float(a >= b)),
    "+": (5, lambda a, b: a + b),
    "-": (5, lambda a, b: a - b),
    "*": (6, lambda a, b: a * b),
    "/": (6, lambda a, b: a / b),
    "%": (6, math.fmod),
    "^": (7, math.pow),
}


class Unknown(Exception):
    """A value that the text alone does not give; the message says why."""


class Variables:
    """The variables of a script as far as they are known from its text."""

    def __init__(self):
        self._values: dict[str, tuple[str, str]] = {}

    def define(self, words: list[str]) -> None:
        """Take ``variable <words>``."""
        if len(words) < 2:
            return
        name, style, rest = words[0], words[1], words[2:]
        if style == "delete":
            self._values.pop(name, None)
        elif style == "equal" and rest:
            self._values[name] = ("equal", rest[0] if len(rest) == 1 else " ".join(rest))
        elif style == "string" and rest:
            self._values[name] = ("text", rest[0])
        elif style in ("index", "universe", "world", "loop", "uloop"):
            # LAMMPS: such a variable keeps its first definition (this is how -var on the command line wins).
            if name in self._values:
                return
            if style == "index" and rest:
                self._values[name] = ("text", rest[0])
            else:
                self._values[name] = ("unknown", f"variable {name} is of style {style}, whose value is only known while LAMMPS runs")
        elif style == "internal" and rest:
            self._values[name] = ("equal", rest[0])
        else:
            self.forget(name, f"variable {name} is of style {style}, whose value is only known while LAMMPS runs")

    def forget(self, name: str, why: str) -> None:
        """Mark a variable as one whose value is not known."""
        self._values[name] = ("unknown", why)

    def text(self, name: str, depth: int = 0) -> str:
        """What ``${name}`` stands for (LAMMPS prints equal-style values with %.15g)."""
        kind, value = self._get(name)
        return value if kind == "text" else f"{self.evaluate(value, depth + 1):.15g}"

    def _get(self, name):
        if name not in self._values:
            raise Unknown(f"variable {name} is not defined: add a line such as 'variable {name} index <value>' before it")
        kind, value = self._values[name]
        if kind == "unknown":
            raise Unknown(value)
        return kind, value

    def number(self, name: str, depth: int = 0) -> float:
        """What ``v_name`` stands for in a formula: LAMMPS passes it on through its text, 15 digits."""
        value = self.text(name, depth)
        try:
            return float(value)
        except ValueError:
            raise Unknown(f"variable {name} is {value!r}, which is not a number") from None

    def substitute(self, line: str) -> str:
        """Replace ``${name}``, ``$x`` and ``$(formula:%format)`` outside quotes."""
        if "$" not in line:
            return line
        out, p, quote = [], 0, ""
        while p < len(line):
            c = line[p]
            if quote:
                if line.startswith(quote, p):
                    out.append(quote)
                    p += len(quote)
                    quote = ""
                    continue
            elif line.startswith('"""', p):
                quote = '"""'
                out.append(quote)
                p += 3
                continue
            elif c in "\"'":
                quote = c
            elif c == "$":
                value, p = self._dollar(line, p)
                out.append(value)
                continue
            out.append(c)
            p += 1
        return "".join(out)

    def _dollar(self, line: str, p: int) -> tuple[str, int]:
        nxt = line[p + 1 : p + 2]
        if nxt == "{":
            end = line.find("}", p)
            if end < 0:
                raise Unknown("'${' without '}'")
            return self.text(line[p + 2 : end]), end + 1
        if nxt == "(":
            level = 0
            for q in range(p + 1, len(line)):
                level += {"(": 1, ")": -1}.get(line[q], 0)
                if level == 0:
                    break
            else:
                raise Unknown("'$(' without ')'")
            body, form = line[p + 2 : q], "%.20g"
            m = re.search(r":(%[-+ #0-9.]*[eEfFgG])$", body)
            if m:
                body, form = body[: m.start()], m.group(1)
            value = self.evaluate(body)
            return form % value, q + 1
        if not nxt or nxt.isspace():
            raise Unknown("'$' without a variable's name")
        return self.text(nxt), p + 2

    def evaluate(self, formula: str, depth: int = 0) -> float:
        """The value of an equal-style formula."""
        if depth > 50:
            raise Unknown(f"the formula {formula!r} refers to itself")
        tokens, p = [], 0
        formula = formula.strip()
        while p < len(formula):
            m = _TOKEN.match(formula, p)
            if not m:
                raise Unknown(f"cannot evaluate {formula!r}: {formula[p:].strip()[:12]!r} is not understood")
            number, name, op = m.groups()
            tokens.append(("n", float(number)) if number else ("v", name) if name else ("o", op))
            p = m.end()
        parser = _Parser(tokens, self, formula, depth)
        try:
            value = parser.expression(0)
            if parser.p != len(tokens):
                raise Unknown(f"cannot evaluate {formula!r}: {tokens[parser.p][1]!r} is not expected there")
        except (ValueError, ZeroDivisionError, OverflowError) as e:
            raise Unknown(f"cannot evaluate {formula!r}: {e}") from None
        return float(value)


class _Parser:
    def __init__(self, tokens, variables, formula, depth):
        self.tokens, self.variables, self.formula, self.depth = tokens, variables, formula, depth
        self.p = 0

    def peek(self):
        return self.tokens[self.p] if self.p < len(self.tokens) else ("end", "the end")

    def take(self):
        t = self.peek()
        self.p += 1
        return t

    def expect(self, op):
        kind, v = self.take()
        if (kind, v) != ("o", op):
            raise Unknown(f"cannot evaluate {self.formula!r}: expected {op!r}, found {v!r}")

    def expression(self, least):
        left = self.unary()
        while True:
            kind, op = self.peek()
            if kind != "o" or op not in _BINARY or _BINARY[op][0] <= least:
                return left
            self.take()
            left = _BINARY[op][1](left, self.expression(_BINARY[op][0]))

    def unary(self):
        kind, v = self.take()
        if (kind, v) == ("o", "-"):
            return -self.unary()
        if (kind, v) == ("o", "!"):
            return float(not self.unary())
        if (kind, v) == ("o", "("):
            value = self.expression(0)
            self.expect(")")
            return value
        if kind == "n":
            return v
        if kind == "v":
            return self.name(v)
        raise Unknown(f"cannot evaluate {self.formula!r}: {v!r} is not expected there")

    def name(self, v):
        if v in _FUNCTIONS and self.peek() == ("o", "("):
            count, f = _FUNCTIONS[v]
            self.take()
            args = [self.expression(0)]
            while self.peek() == ("o", ","):
                self.take()
                args.append(self.expression(0))
            self.expect(")")
            if len(args) != count:
                raise Unknown(f"cannot evaluate {self.formula!r}: {v} takes {count} numbers, got {len(args)}")
            return f(*args)
        if v in _CONSTANTS:
            return _CONSTANTS[v]
        if v.startswith("v_") and "[" not in v:
            return self.variables.number(v[2:], self.depth)
        raise Unknown(f"cannot evaluate {self.formula!r}: {v!r} is only known while LAMMPS runs")
