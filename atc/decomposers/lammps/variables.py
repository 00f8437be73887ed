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
    **{w: (1, getattr(math, w)) for w in "sqrt exp sin cos tan asin acos atan sinh cosh tanh ceil floor".split()},
    "ln": (1, math.log),
    "log": (1, math.log10),
    "abs": (1, abs),
    "sign": (1, lambda x: 1.0 if x >= 0 else -1.0),
    "atan2": (2, math.atan2),
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
        formula = formula.strip()
        parser = _Formula(formula, tokens_of(formula, _TOKEN, ""), self, depth)
        try:
            return float(parser.whole())
        except (ValueError, ZeroDivisionError, OverflowError) as e:
            raise parser.bad(e) from None


def tokens_of(text: str, pattern, what: str):
    """The groups of each token of an expression; `what` it is, for messages."""
    p = 0
    while p < len(text):
        m = pattern.match(text, p)
        if not m:
            shown = text[p:].strip()[:12]
            raise Unknown(f"cannot evaluate {what}{_shortened(text)!r}: {shown!r} is not understood")
        yield m.groups()
        p = m.end()


def _shortened(text: str) -> str:
    return text if len(text) < 80 else text[:77] + "..."


class Parser:
    """An expression of tokens (kind, value), by precedence: kind "op" for operators and brackets. What the others stand
    for is said by `value`."""

    what = ""  # it is, for messages
    signs = ("!",)

    def __init__(self, text, tokens):
        self.text, self.tokens = _shortened(text), list(tokens)
        self.p = self.level = 0

    def bad(self, why) -> Unknown:
        return Unknown(f"cannot evaluate {self.what}{self.text!r}: {why}")

    def peek(self):
        return self.tokens[self.p] if self.p < len(self.tokens) else ("end", "the end")

    def take(self):
        t = self.peek()
        self.p += 1
        return t

    def expect(self, op):
        token = self.take()
        if token != ("op", op):
            raise self.bad(f"expected {op!r}, found {token[1]!r}")

    def whole(self):
        value = self.expression(0)
        if self.p != len(self.tokens):
            raise self.bad(f"{self.peek()[1]!r} is not expected there")
        return value

    def expression(self, least):
        self.level += 1
        if self.level > _DEEPEST:
            raise self.bad("too many brackets")
        left = self.unary()
        while True:
            kind, op = self.peek()
            if kind != "op" or op not in _BINARY or _BINARY[op][0] <= least:
                self.level -= 1
                return left
            self.take()
            left = self.joined(op, left, self.expression(_BINARY[op][0]))

    def joined(self, op, a, b):
        return _BINARY[op][1](a, b)

    def unary(self):
        signs = []
        while self.peek()[0] == "op" and self.peek()[1] in self.signs:
            signs.append(self.take()[1])
        value = self.atom()
        for sign in reversed(signs):
            value = self.signed(sign, value)
        return value

    def signed(self, sign, value):
        return -value if sign == "-" else float(not value)

    def atom(self):
        kind, v = self.take()
        if (kind, v) == ("op", "("):
            value = self.expression(0)
            self.expect(")")
            return value
        if kind in ("op", "end"):
            raise self.bad(f"{v!r} is not expected there")
        return self.value(kind, v)

    def value(self, kind, v):
        raise NotImplementedError


class _Formula(Parser):
    signs = ("-", "!")

    def __init__(self, text, groups, variables, depth):
        super().__init__(
            text, (("number", float(n)) if n else ("name", name) if name else ("op", op) for n, name, op in groups)
        )
        self.variables, self.depth = variables, depth

    def value(self, kind, v):
        if kind == "number":
            return v
        if v in _FUNCTIONS and self.peek() == ("op", "("):
            count, f = _FUNCTIONS[v]
            self.take()
            args = [self.expression(0)]
            while self.peek() == ("op", ","):
                self.take()
                args.append(self.expression(0))
            self.expect(")")
            if len(args) != count:
                raise self.bad(f"{v} takes {count} numbers, got {len(args)}")
            return f(*args)
        if v in _CONSTANTS:
            return _CONSTANTS[v]
        if v.startswith("v_") and "[" not in v:
            return self.variables.number(v[2:], self.depth)
        if m := re.fullmatch(r"v_(\w+)\[(\d{1,9})\]", v):
            return self.variables.element(m[1], int(m[2]), self.depth)
        raise self.bad(f"{v!r} is only known while LAMMPS runs: write the number that it has there")
