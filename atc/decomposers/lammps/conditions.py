"""The Boolean expressions of LAMMPS's ``if`` command: numbers and strings, compared and joined."""

from __future__ import annotations

import re
from itertools import starmap

from .variables import Parser, tokens_of

_TOKEN = re.compile(
    r"\s*(?:(-?\d+\.?\d*(?:[eE][-+]?\d+)?|-?\.\d+(?:[eE][-+]?\d+)?)|([A-Za-z][\w/]*)|(\|\||\|\^|&&|==|!=|<=|>=|[<>!()])|'([^']*)'|\"([^\"]*)\")"
)


def holds(text: str) -> bool:
    """Whether a condition is true. Raises Unknown for what LAMMPS would not understand either."""
    text = text.strip()
    condition = _Condition(text, starmap(_token, tokens_of(text, _TOKEN, _Condition.what)))
    value = condition.whole()
    if isinstance(value, str):
        raise condition.bad(f"{value!r} is neither true nor false")
    return value != 0.0


def _token(number, word, op, single, double):
    if number:
        return "value", float(number)
    return ("op", op) if op else ("value", next(w for w in (word, single, double) if w is not None))


class _Condition(Parser):
    what = "the condition "

    def joined(self, op, a, b):
        if isinstance(a, str) != isinstance(b, str) or (isinstance(a, str) and op not in ("==", "!=")):
            raise self.bad(f"{a!r} and {b!r} cannot be compared")
        return super().joined(op, a, b)

    def signed(self, sign, value):
        if isinstance(value, str):
            raise self.bad(f"{value!r} is neither true nor false")
        return super().signed(sign, value)

    def value(self, kind, v):
        return v
