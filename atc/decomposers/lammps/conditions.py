"""The Boolean expressions of LAMMPS's ``if`` command: numbers and strings, compared and joined."""

from __future__ import annotations

import re

from .variables import _BINARY, Unknown

_TOKEN = re.compile(
    r"\s*(?:(-?\d+\.?\d*(?:[eE][-+]?\d+)?|-?\.\d+(?:[eE][-+]?\d+)?)|([A-Za-z][\w/]*)|(\|\||\|\^|&&|==|!=|<=|>=|[<>!()])|'([^']*)'|\"([^\"]*)\")"
)
_DEEPEST = 50


def holds(text: str) -> bool:
    """Whether a condition is true. Raises Unknown for what LAMMPS would not understand either."""
    tokens, p, text = [], 0, text.strip()
    while p < len(text):
        m = _TOKEN.match(text, p)
        if not m:
            raise Unknown(
                f"cannot evaluate the condition {text[:60]!r}: {text[p : p + 12].strip()!r} is not understood"
            )
        number, word, op, single, double = m.groups()
        quoted = single if single is not None else double
        tokens.append(
            ("value", float(number)) if number else ("op", op) if op else ("value", word if quoted is None else quoted)
        )
        p = m.end()
    value = _Parser(tokens, text).whole()
    if isinstance(value, str):
        raise Unknown(f"cannot evaluate the condition {text[:60]!r}: {value!r} is neither true nor false")
    return value != 0.0


class _Parser:
    def __init__(self, tokens, text):
        self.tokens, self.text, self.p, self.level = tokens, text[:60], 0, 0

    def bad(self, why):
        return Unknown(f"cannot evaluate the condition {self.text!r}: {why}")

    def peek(self):
        return self.tokens[self.p] if self.p < len(self.tokens) else ("end", "the end")

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
            self.p += 1
            right = self.expression(_BINARY[op][0])
            if isinstance(left, str) != isinstance(right, str) or (isinstance(left, str) and op not in ("==", "!=")):
                raise self.bad(f"{left!r} and {right!r} cannot be compared")
            left = _BINARY[op][1](left, right)

    def unary(self):
        negated = 0
        while self.peek() == ("op", "!"):
            self.p += 1
            negated += 1
        kind, value = self.peek()
        self.p += 1
        if (kind, value) == ("op", "("):
            value = self.expression(0)
            if self.peek() != ("op", ")"):
                raise self.bad("a bracket is not closed")
            self.p += 1
        elif kind != "value":
            raise self.bad(f"{value!r} is not expected there")
        for _ in range(negated):
            if isinstance(value, str):
                raise self.bad(f"{value!r} is neither true nor false")
            value = float(value == 0.0)
        return value
