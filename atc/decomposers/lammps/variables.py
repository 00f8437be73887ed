"""LAMMPS variables: ``${name}``, ``$x``, ``$(formula)`` and the arithmetic of equal-style formulas, evaluated without
running anything.

Only what is known from the text counts: numbers, constants, other variables. A formula that needs the simulation
(thermo keywords, computes, fixes, random numbers, files, the environment) is an error, raised only where a line of the
model needs its value.
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
    "||": (1, lambda a, b: float(bool(a) or bool(b))), "|^": (1, lambda a, b: float(bool(a) != bool(b))),
    "&&": (2, lambda a, b: float(bool(a) and bool(b))), "==": (3, lambda a, b: float(a == b)),
    "!=": (3, lambda a, b: float(a != b)), "<": (4, lambda a, b: float(a < b)), "<=": (4, lambda a, b: float(a <= b)),
    ">": (4, lambda a, b: float(a > b)), ">=": (4, lambda a, b: float(a >= b)), "+": (5, lambda a, b: a + b),
    "-": (5, lambda a, b: a - b), "*": (6, lambda a, b: a * b), "/": (6, lambda a, b: a / b), "%": (6, math.fmod),
    "^": (7, math.pow),
}  # fmt: skip


#: A line with its variables put in is no longer than this, and a formula needs no more evaluations of other variables.
LONGEST = 1 << 16
MOST = 10000
_DEEPEST = 50
_FORMAT = re.compile(r"[^%]{0,200}%[-+ #0]*\d{0,3}(?:\.\d{0,3})?[eEfFgG][^%]{0,200}$")


class Unknown(Exception):
    """A value that the text alone does not give; the message says why."""


class _Strings:
    """The values of an index, loop, or file variable, and which of them holds."""

    def __init__(self, values, pad: int = 0):
        self.values, self.pad, self.k = values, pad, 0

    @property
    def text(self) -> str:
        value = self.values[self.k]
        return value if isinstance(value, str) else f"{value:0{self.pad}d}" if self.pad else str(value)


class Variables:
    """The variables of a script as far as they are known from its text.

    `read` gives the text of a file that a ``file`` variable names, or raises Unknown.
    """

    def __init__(self, read=None):
        self._values: dict[str, tuple[str, object]] = {}
        self._read = read
        self._left = MOST

    def define(self, words: list[str]) -> None:
        """Take ``variable <words>``."""
        if len(words) < 2:
            return
        name, style, rest = words[0], words[1], words[2:]
        if style == "delete":
            self._values.pop(name, None)
        elif style in ("equal", "vector", "atom") and rest:
            self._values[name] = (style, rest[0] if len(rest) == 1 else " ".join(rest))
        elif style == "string" and rest:
            self._values[name] = ("text", self._in_quotes(rest[0], name))
        elif style in ("index", "universe", "world", "loop", "uloop", "file", "atomfile"):
            # LAMMPS: such a variable keeps its first definition (this is how -var on the command line wins).
            if name not in self._values:
                self._values[name] = self._listed(name, style, rest)
        elif style == "internal" and rest:
            self._values[name] = ("equal", rest[0])
        elif style == "format" and len(rest) > 1:
            self._values[name] = ("format", (rest[0], rest[1]))
        elif style == "getenv":
            self.forget(name, f"variable {name} is taken from the environment of the run, which is not known")
        else:
            self.forget(name, f"variable {name} is of style {style}, whose value is only known while LAMMPS runs")

    def _in_quotes(self, text, name):
        """A string variable's value: LAMMPS puts variables in there even if it is quoted."""
        try:
            return self.substitute(text)
        except Unknown:
            return text

    def _listed(self, name, style, rest):
        if style == "index" and rest:
            return "strings", _Strings(rest)
        if style == "loop":
            pad = rest[-1:] == ["pad"]
            numbers = rest[: len(rest) - pad]
            if len(numbers) in (1, 2) and all(re.fullmatch(r"\d{1,18}", w) for w in numbers):
                low, high = (1, int(numbers[0])) if len(numbers) == 1 else map(int, numbers)
                if low <= high:
                    return "strings", _Strings(range(low, high + 1), len(str(high)) if pad else 0)
            return "unknown", f"variable {name} loop {' '.join(rest)}: expected one or two whole numbers"
        if style == "file" and rest and self._read is not None:
            try:
                values = [w for w in (line.split("#")[0].strip() for line in self._read(rest[0]).split("\n")) if w]
            except Unknown as e:
                return "unknown", str(e)
            return ("strings", _Strings(values)) if values else ("unknown", f"variable {name}: {rest[0]} has no lines")
        if style == "atomfile" and rest:
            return "atomfile", rest[0]
        return "unknown", f"variable {name} is of style {style}, whose value is only known while LAMMPS runs"

    def step(self, names: list[str]) -> bool:
        """``next``: whether the values have come to their end, so that the next jump is left out."""
        ended = False
        for name in names:
            kind, value = self._values.get(name, ("unknown", ""))
            if kind != "strings":
                if name in self._values:
                    self.forget(name, f"variable {name} is stepped by 'next', and its values are not known")
                continue
            if value.k + 1 < len(value.values):
                value.k += 1
            else:
                ended = True
        if ended:
            for name in names:
                self._values.pop(name, None)
        return ended

    def forget(self, name: str, why: str) -> None:
        """Mark a variable as one whose value is not known."""
        self._values[name] = ("unknown", why)

    def kind(self, name: str) -> tuple[str, object] | None:
        """Style and value of a variable ("text", "equal", "atom", "atomfile", "strings", "unknown" ...), None if it is
        not defined."""
        return self._values.get(name)

    def text(self, name: str, depth: int = 0) -> str:
        """What ``${name}`` stands for (LAMMPS prints equal-style values with %.15g)."""
        kind, value = self._get(name)
        if kind == "text":
            return value
        if kind == "strings":
            return value.text
        if kind == "format":
            other, form = value
            if not _FORMAT.match(form):
                raise Unknown(f"variable {name}: the format {form!r} is not understood")
            return form % self.evaluate(f"v_{other}", depth + 1)
        if kind == "vector":
            raise Unknown(f"variable {name} is a vector: name one of its values, such as v_{name}[1]")
        if kind != "equal":
            raise Unknown(f"variable {name} has a value for every atom")
        return f"{self.evaluate(value, depth + 1):.15g}"

    def _get(self, name):
        if name not in self._values:
            raise Unknown(
                f"variable {name} is not defined: add a line such as 'variable {name} index <value>' before it"
            )
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
            raise Unknown(f"variable {name} is {value[:40]!r}, which is not a number") from None

    def element(self, name: str, k: int, depth: int = 0) -> float:
        """What ``v_name[k]`` stands for, of a vector that is written out: ``variable name vector [1,2,3]``."""
        kind, value = self._get(name)
        value = str(value).strip()
        if kind != "vector" or not (value.startswith("[") and value.endswith("]")):
            raise Unknown(f"v_{name}[{k}]: what variable {name} holds there is only known while LAMMPS runs")
        values = value[1:-1].split(",")
        if not 1 <= k <= len(values):
            raise Unknown(f"v_{name}[{k}]: variable {name} has {len(values)} values, counted from 1")
        return self.evaluate(values[k - 1], depth + 1)

    def substitute(self, line: str) -> str:
        """Replace ``${name}``, ``$x`` and ``$(formula:%format)`` outside quotes."""
        if "$" not in line:
            return line
        self._left = MOST
        out, p, quote, size = [], 0, "", 0
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
                size += len(value)
                if size > LONGEST:
                    raise Unknown(f"the line is longer than {LONGEST} characters with its variables put in")
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
            m = re.search(r":([^:%]*%[-+ #0]*\d{0,3}(?:\.\d{0,3})?[eEfFgG][^:%]*)$", body)
            if m:
                body, form = body[: m.start()], m.group(1)
            return form % self.evaluate(body), q + 1
        if not nxt or nxt.isspace():
            raise Unknown("'$' without a variable's name")
        return self.text(nxt), p + 2

    def evaluate(self, formula: str, depth: int = 0) -> float:
        """The value of an equal-style formula."""
        if depth == 0:
            self._left = MOST
        self._left -= 1
        if depth > _DEEPEST or self._left < 0:
            raise Unknown(f"the formula {formula[:60]!r} refers to itself, or to too many others")
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
            raise Unknown(f"cannot evaluate {parser.formula!r}: {e}") from None
        return float(value)


class _Parser:
    def __init__(self, tokens, variables, formula, depth):
        self.tokens, self.variables, self.formula, self.depth = (
            tokens,
            variables,
            formula if len(formula) < 80 else formula[:77] + "...",
            depth,
        )
        self.p = self.level = 0

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
        self.level += 1
        if self.level > _DEEPEST:
            raise Unknown(f"cannot evaluate {self.formula!r}: too many brackets")
        left = self.unary()
        while True:
            kind, op = self.peek()
            if kind != "o" or op not in _BINARY or _BINARY[op][0] <= least:
                self.level -= 1
                return left
            self.take()
            left = _BINARY[op][1](left, self.expression(_BINARY[op][0]))

    def unary(self):
        signs = []
        while self.peek() in (("o", "-"), ("o", "!")):
            signs.append(self.take()[1])
        value = self.atom()
        for sign in reversed(signs):
            value = -value if sign == "-" else float(not value)
        return value

    def atom(self):
        kind, v = self.take()
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
        if m := re.fullmatch(r"v_(\w+)\[(\d{1,9})\]", v):
            return self.variables.element(m[1], int(m[2]), self.depth)
        raise Unknown(
            f"cannot evaluate {self.formula!r}: {v!r} is only known while LAMMPS runs: write the number that it has "
            "there"
        )
