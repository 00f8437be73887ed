"""Checks of single values, which scenes and cases share: each returns the value in its normal form, or raises
ValueError (with a text: why not)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from .words import frame_slice, guess


def takes(json):
    """Says of a check what it takes as JSON Schema (for editors): `json`, or a function that gives it."""

    def said(check):
        check.json = json
        return check

    return said


def json_of(check) -> dict:
    """What a check takes, as JSON Schema."""
    return check.json() if callable(check.json) else dict(check.json)


_WORDS = {"type": "string", "pattern": r"\S"}


@takes(_WORDS)
def string(v):
    """Text that is not empty."""
    if not isinstance(v, str) or not v.strip():
        raise ValueError
    return v


@takes(_WORDS)
def influence(v):
    """The name of an influence function, or its formula."""
    from ..pd.materials.influence import INFLUENCE
    from .formula import INFLUENCE_LETTERS, Formula

    if string(v) in INFLUENCE:
        return v
    if v.isidentifier() and v not in INFLUENCE_LETTERS:
        raise ValueError(f"{guess(v, INFLUENCE)}known: {', '.join(INFLUENCE)}")
    Formula(v, INFLUENCE_LETTERS)
    return v


#: How a bond's weight depends on it.
INFLUENCE_EXPECTED = (
    "'one', 'inverse', 'linear', 'quadratic', 'gaussian', or a formula of r and delta, or of x, y, z too, e.g. "
    "'exp(-(2*r/delta)**2)'"
)


@takes({"type": "boolean"})
def boolean(v):
    """True or False."""
    if not isinstance(v, bool):
        raise ValueError
    return v


def a_number(types, good=lambda v: True, why="", **json):
    """A check of a finite number of these types that is `good`; `why`: what it must be."""

    @takes({"type": "integer" if types is int else "number", **json})
    def checked(v):
        if isinstance(v, bool) or not isinstance(v, types) or v != v or v in (float("inf"), float("-inf")):
            raise ValueError
        if not good(v):
            raise ValueError(why)
        return v

    return checked


_REAL = (int, float)
number = a_number(_REAL)
not_negative = a_number(_REAL, lambda v: v >= 0, "it must not be negative", minimum=0)
positive = a_number(_REAL, lambda v: v > 0, "it must be greater than 0", exclusiveMinimum=0)
part = a_number(_REAL, lambda v: 0 < v <= 1, "it must be greater than 0, at most 1", exclusiveMinimum=0, maximum=1)
tolerance = a_number(
    _REAL,
    lambda v: 0 < v < 1,
    "it must lie between 0 and 1 (1e-12 means the exact sum)",
    exclusiveMinimum=0,
    exclusiveMaximum=1,
)
integer = a_number(int)
count = a_number(int, lambda v: v >= 1, "it must be at least 1, or there is nothing to compute", minimum=1)
seed = a_number(int, lambda v: v >= 0, "it must not be negative", minimum=0)


def list_of(check, length=None):
    """A list that is not empty, or of this length."""
    sizes = {"minItems": length, "maxItems": length} if length is not None else {"minItems": 1}

    @takes(lambda: {"type": "array", "items": json_of(check), **sizes})
    def checked(v):
        if not isinstance(v, list) or (length is not None and len(v) != length) or not v:
            raise ValueError
        return [check(x) for x in v]

    return checked


def either(*checks):
    """What one of some checks takes; the first reason is told."""

    @takes(lambda: {"anyOf": [json_of(check) for check in checks]})
    def checked(v):
        reason = ""
        for check in checks:
            try:
                return check(v)
            except ValueError as e:
                reason = reason or str(e)
        raise ValueError(reason)

    return checked


def list_or_one(check):
    """A list; one alone is a list of one."""
    return either(list_of(check), takes(lambda: json_of(check))(lambda v: [check(v)]))


def choice(choices: Callable[[], list[str]] | list[str]):
    """One of some words, or of those that a function gives."""

    @takes(lambda: {"enum": list(choices() if callable(choices) else choices)})
    def checked(v):
        if not isinstance(v, str):
            raise ValueError
        known = choices() if callable(choices) else choices
        if v not in known:
            raise ValueError(f"{guess(v, known)}known: {', '.join(known)}")
        return v

    return checked


def choice_of(module: str, *names: str):
    """One of the words that these collections in a module of atc hold; it is imported when it is asked."""

    def known():
        found = import_module(f"atc.{module}")
        return [word for name in names for word in getattr(found, name)]

    return choice(known)


def one_of_numbers(*numbers: int):
    """One of some whole numbers."""

    @takes({"enum": [*numbers]})
    def checked(v):
        if isinstance(v, bool) or v not in numbers:
            raise ValueError
        return int(v)

    return checked


@takes({"enum": [*"xyzabcXYZABC", 0, 1, 2]})
def axis(v):
    """An axis of the cell."""
    if isinstance(v, str) and v.lower() in ("x", "y", "z", "a", "b", "c"):
        return v.lower()
    if isinstance(v, int) and not isinstance(v, bool) and v in (0, 1, 2):
        return v
    raise ValueError


_SLICE = {k: {"type": "integer"} for k in ("begin", "end", "step")}


@takes(
    {
        "anyOf": [
            {"type": "integer"},
            {"type": "string", "pattern": r"^\s*-?\d*\s*(:\s*-?\d*\s*){0,2}$"},
            {"type": "object", "properties": _SLICE, "additionalProperties": False},
        ]
    }
)
def frames(v):
    """A slice string, a table {begin, end, step} or one index, kept as written once it is known to be well formed."""
    frame_slice(v)
    return v


def table_of(check, fewest: int = 0):
    """A table with so many keys at least, of any name."""
    sizes = {"minProperties": fewest} if fewest else {}

    @takes(lambda: {"type": "object", "additionalProperties": json_of(check), **sizes})
    def checked(v):
        if not isinstance(v, dict) or len(v) < fewest:
            raise ValueError
        return {str(k): check(x) for k, x in v.items()}

    return checked


@takes({"anyOf": [{"type": "string"}, {"type": "object", "minProperties": 1}]})
def partition(v):
    """How energy is shared, one word or one of each kind of term."""
    if isinstance(v, dict) and v:
        return {str(k): w if isinstance(w, list) else string(w) for k, w in v.items()}
    return string(v)


@takes(_WORDS)
def atom_style(v):
    """An atom_style of LAMMPS."""
    from ..errors import AtcError
    from ..readers.lammps.atom_styles import AtomStyle

    try:
        return AtomStyle(string(v), "").given
    except AtcError:
        raise ValueError from None


@takes(_WORDS)
def output_units(v):
    """Units of a result."""
    from ..errors import AtcError
    from ..units.words import wanted_units

    try:
        wanted_units(string(v))
    except AtcError as e:
        raise ValueError(str(e)) from None
    return v


@dataclass(frozen=True)
class Key:
    """What a key takes, and in words what it should be."""

    check: Callable[[Any], Any]
    expected: str
    path: bool = False  # a file name (when it is a string), relative to the scene
