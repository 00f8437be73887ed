"""LAMMPS's fixes that hold distances and bodies, as `Constraints`: what the words of ``fix shake``, ``fix rattle`` and
the ``fix rigid`` family say."""

from __future__ import annotations

from ..constraints.held import Constraints
from ..constraints.rules import SAME_MASS, Group, RigidMolecules, Shake
from .fixes import class_of
from .script import Command

#: Words behind ``fix shake`` with so many values, which change no constraint.
_SHAKE_WORDS = {"mol": 1, "kbond": 1, "store": 1}
_KINDS = {"b": "bond", "a": "angle", "t": "atom"}
#: Words behind ``fix rigid`` with so many values: thermostats, barostats and what they need act on whole bodies.
_RIGID_WORDS = {
    "langevin": 4, "reinit": 1, "temp": 3, "iso": 3, "aniso": 3, "x": 3, "y": 3, "z": 3, "couple": 1, "tparam": 3,
    "pchain": 1, "dilate": 1, "infile": 1, "mol": 1, "gravity": 1,
}  # fmt: skip


def held(fixes) -> list[Command]:
    """Those of some fixes that are constraints."""
    return [c for c in fixes if class_of(c) == "constraint"]


def groups_of(fixes) -> tuple[str, ...]:
    """The groups of a script that its constraints need, "all" left out."""
    names = []
    for c in held(fixes):
        names.append(c.words[1])
        if c.words[2].startswith("rigid") and c.words[3:4] == ("group",):
            names += c.words[5:]
            names = names[: len(names) - max(0, len(c.words[5:]) - _count(c))]
    return tuple(dict.fromkeys(n for n in names if n != "all"))


def _count(c: Command) -> int:
    try:
        return int(c.words[4])
    except (IndexError, ValueError):
        raise c.error(f"fix {c.words[2]} group: expected a number of groups and their names") from None


def needs_molecules(fixes) -> bool:
    """Whether bodies are told by molecule."""
    return any(c.words[2].startswith("rigid") and c.words[3:4] == ("molecule",) for c in held(fixes))


def constraints_of(fixes, groups, types_of, mass_unit: float, timestep) -> Constraints | None:
    """The constraints of some fixes of a script, None if it has none.

    Parameters
    ----------
    groups : names of groups, in the order of the bits of `Frame.groups`
    types_of : (kind, word, where) → `TypeRange`
    mass_unit : of the script, internal
    timestep : of the run, internal, or None
    """

    def group(name):
        return Group(name, -1 if name == "all" else groups.index(name))

    rules = []
    for c in held(fixes):
        if c.unknown:
            raise c.error(f"fix {c.words[2]}: {c.unknown}")
        make = _shake if c.words[2] in ("shake", "rattle") else _rigid
        rules.append(make(c, group, types_of, mass_unit))
    return Constraints(rules, timestep=timestep) if rules else None


def _shake(c: Command, group, types_of, mass_unit) -> Shake:
    style, words = c.words[2], c.words[6:]
    if len(words) < 2:
        raise c.error(
            f"fix {style}: expected a tolerance, two numbers, and what is held: b, a, t or m with types or masses"
        )
    found: dict[str, list] = {"b": [], "a": [], "t": [], "m": []}
    kind, k = "", 0
    while k < len(words):
        w = words[k]
        if w in found:
            kind = w
        elif w in _SHAKE_WORDS:
            k += _SHAKE_WORDS[w]
        elif not kind:
            raise c.error(f"fix {style}: expected b, a, t or m before {w!r}")
        elif kind == "m":
            try:
                found["m"].append(float(w))
            except ValueError:
                raise c.error(f"fix {style}: expected a mass, got {w!r}") from None
        else:
            span = types_of(_KINDS[kind], w, c.where)
            if span.hi is None or span.hi != span.lo:
                raise c.error(f"fix {style}: expected a single type behind {kind}, got {w!r}")
            found[kind].append(span.lo)
        k += 1
    masses = tuple(m * mass_unit for m in found["m"])
    types = (tuple(found[kind]) for kind in "bat")
    return Shake(*types, masses, SAME_MASS * mass_unit, group(c.words[1]), style, c.where)


def _rigid(c: Command, group, types_of, mass_unit) -> RigidMolecules:
    style, body, words = c.words[2], c.words[3] if len(c.words) > 3 else "", c.words[4:]
    each = ()
    if body == "group":
        number = _count(c)
        each, words = tuple(group(g) for g in words[1 : 1 + number]), words[1 + number :]
    elif body == "single":
        each = (group(c.words[1]),)
    elif body != "molecule":
        raise c.error(
            f"fix {style} {body}: which atoms are a body is not known from what frames show: supported are "
            "single, molecule and group"
        )
    k = 0
    while k < len(words):
        if words[k] not in _RIGID_WORDS:
            raise c.error(
                f"fix {style} {words[k]} is not supported: parts of the forces on bodies are switched off, "
                "or the word is not known"
            )
        k += 1 + _RIGID_WORDS[words[k]]
    return RigidMolecules(None, group(c.words[1]), each, style, c.where, contained=False, releases=False)
