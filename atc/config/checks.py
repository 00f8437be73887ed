"""Checks of single values, which scenes and cases share: each returns the value in its normal form, or raises
ValueError (with a text: why not)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from .words import frame_slice, guess


def described(check, json):
    """A check that says what it takes as JSON Schema (for editors), too: `json`, or a function that gives it."""
    check.json = json
    return check


def json_of(check) -> dict:
    """What a check takes, as JSON Schema; {} (anything) of those that do not say."""
    json = getattr(check, "json", {})
    return json() if callable(json) else dict(json)


def _string(v):
    if not isinstance(v, str) or not v.strip():
        raise ValueError
    return v


def _influence(v):
    """The name of an influence function, or its formula."""
    from ..pd.materials.base import INFLUENCE
    from .formula import INFLUENCE_LETTERS, Formula

    if _string(v) in INFLUENCE:
        return v
    if v.isidentifier() and v not in INFLUENCE_LETTERS:
        raise ValueError(f"{guess(v, INFLUENCE)}known: {', '.join(INFLUENCE)}")
    Formula(v, INFLUENCE_LETTERS)
    return v


described(_influence, {"type": "string", "pattern": r"\S"})
#: How a bond's weight depends on it.
INFLUENCE_EXPECTED = (
    "'one', 'inverse', 'linear', 'quadratic', 'gaussian', or a formula of r and delta, or of x, y, z too, e.g. "
    "'exp(-(2*r/delta)**2)'"
)


def _boolean(v):
    if not isinstance(v, bool):
        raise ValueError
    return v


def _a_number(types, good=lambda v: True, why="", **json):
    """A check of a finite number of these types that is `good`; `why`: what it must be."""

    def checked(v):
        if isinstance(v, bool) or not isinstance(v, types) or v != v or v in (float("inf"), float("-inf")):
            raise ValueError
        if not good(v):
            raise ValueError(why)
        return v

    return described(checked, {"type": "integer" if types is int else "number", **json})


_REAL = (int, float)
_number = _a_number(_REAL)
_not_negative = _a_number(_REAL, lambda v: v >= 0, "it must not be negative", minimum=0)
_positive = _a_number(_REAL, lambda v: v > 0, "it must be greater than 0", exclusiveMinimum=0)
_part = _a_number(_REAL, lambda v: 0 < v <= 1, "it must be greater than 0, at most 1", exclusiveMinimum=0, maximum=1)
_tolerance = _a_number(
    _REAL,
    lambda v: 0 < v < 1,
    "it must lie between 0 and 1 (1e-12 means the exact sum)",
    exclusiveMinimum=0,
    exclusiveMaximum=1,
)
_integer = _a_number(int)
_count = _a_number(int, lambda v: v >= 1, "it must be at least 1, or there is nothing to compute", minimum=1)
_seed = _a_number(int, lambda v: v >= 0, "it must not be negative", minimum=0)


def _list_of(check, length=None):
    def checked(v):
        if not isinstance(v, list) or (length is not None and len(v) != length) or not v:
            raise ValueError
        return [check(x) for x in v]

    sizes = {"minItems": length, "maxItems": length} if length is not None else {"minItems": 1}
    return described(checked, lambda: {"type": "array", "items": json_of(check), **sizes})


def _either(*checks):
    def checked(v):
        reason = ""
        for check in checks:
            try:
                return check(v)
            except ValueError as e:
                reason = reason or str(e)
        raise ValueError(reason)

    return described(checked, lambda: {"anyOf": [json_of(check) for check in checks]})


def _choice(choices: Callable[[], list[str]] | list[str]):
    def checked(v):
        if not isinstance(v, str):
            raise ValueError
        known = choices() if callable(choices) else choices
        if v not in known:
            raise ValueError(f"{guess(v, known)}known: {', '.join(known)}")
        return v

    return described(checked, lambda: {"enum": list(choices() if callable(choices) else choices)})


def _choice_of(module: str, *names: str):
    """One of the words that these collections in a module of atc hold; it is imported when it is asked."""

    def known():
        found = import_module(f"atc.{module}")
        return [word for name in names for word in getattr(found, name)]

    return _choice(known)


def _dimension(v):
    if isinstance(v, bool) or v not in (2, 3) or not isinstance(v, int):
        raise ValueError
    return v


def _axis(v):
    if isinstance(v, str) and v.lower() in ("x", "y", "z", "a", "b", "c"):
        return v.lower()
    if isinstance(v, int) and not isinstance(v, bool) and v in (0, 1, 2):
        return v
    raise ValueError


def _frames(v):
    """A slice string, a table {begin, end, step} or one index, kept as written once it is known to be well formed."""
    frame_slice(v)
    return v


def _table_of(check, fewest: int = 0):
    """A table with so many keys at least, of any name."""

    def checked(v):
        if not isinstance(v, dict) or len(v) < fewest:
            raise ValueError
        return {str(k): check(x) for k, x in v.items()}

    sizes = {"minProperties": fewest} if fewest else {}
    return described(checked, lambda: {"type": "object", "additionalProperties": json_of(check), **sizes})


def _partition(v):
    if isinstance(v, dict) and v:
        return {str(k): w if isinstance(w, list) else _string(w) for k, w in v.items()}
    return _string(v)


def _atom_style(v):
    from ..errors import AtcError
    from ..readers.lammps.atom_styles import AtomStyle

    try:
        return AtomStyle(_string(v), "").given
    except AtcError:
        raise ValueError from None


def _output_units(v):
    from ..errors import AtcError
    from ..units.words import wanted_units

    try:
        wanted_units(_string(v))
    except AtcError as e:
        raise ValueError(str(e)) from None
    return v


for _check, _json in (
    (_string, {"type": "string", "pattern": r"\S"}),
    (_boolean, {"type": "boolean"}),
    (_dimension, {"enum": [2, 3]}),
    (_axis, {"enum": [*"xyzabcXYZABC", 0, 1, 2]}),
    (_atom_style, {"type": "string", "pattern": r"\S"}),
    (_partition, {"anyOf": [{"type": "string"}, {"type": "object", "minProperties": 1}]}),
):
    described(_check, _json)
_SLICE = {k: {"type": "integer"} for k in ("begin", "end", "step")}
described(
    _frames,
    {
        "anyOf": [
            {"type": "integer"},
            {"type": "string", "pattern": r"^\s*-?\d*\s*(:\s*-?\d*\s*){0,2}$"},
            {"type": "object", "properties": _SLICE, "additionalProperties": False},
        ]
    },
)


@dataclass(frozen=True)
class Key:
    check: Callable[[Any], Any]
    expected: str
    path: bool = False  # a file name (when it is a string), relative to the scene
