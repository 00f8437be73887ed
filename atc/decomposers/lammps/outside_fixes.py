"""LAMMPS's fixes that act on atoms from outside, as laws: constants as the script has them. What is not understood is
said to be there, and measured."""

from __future__ import annotations

from math import cos, pi, sin

import numpy as np

from ...units import Units
from ..constraints.rules import Group
from ..outside import Along, Constant, Friction, Indenter, Law, OutsideForces, Put, Wall
from .fixes import class_of
from .script import Command, short

_FACES = {f"{'xyz'[k]}{end}": (k, side) for k in range(3) for end, side in (("lo", -1), ("hi", 1))}
#: Numbers of each wall behind face and place, the cutoff last.
_WALLS = {
    "wall/lj93": ("energy", "length"), "wall/lj126": ("energy", "length"), "wall/lj1043": ("energy", "length"),
    "wall/harmonic": ("stiffness", None), "wall/morse": ("energy", "1/length", "length"),
}  # fmt: skip


class _NotUnderstood(Exception):
    pass


def acting(fixes) -> list[Command]:
    """Those of some fixes that act from outside."""
    return [c for c in fixes if class_of(c) == "outside"]


def outside_of(fixes, groups, u: Units, lattice: bool) -> OutsideForces:
    """The forces from outside of some fixes of a script. groups : as in `constraint_fixes`; lattice : whether lengths
    may be in units of a lattice"""
    laws, others = [], []
    for c in acting(fixes):
        try:
            if c.unknown:
                raise _NotUnderstood
            laws += _laws(c, Group(c.words[1], -1 if c.words[1] == "all" else groups.index(c.words[1])), u, lattice)
        except (_NotUnderstood, ValueError, IndexError):  # a variable, a region, a word that is not looked into
            others.append(f"fix {c.words[2]} ({short(c.where)})")
    return OutsideForces(tuple(laws), tuple(others))


def _laws(c: Command, group: Group, u: Units, lattice: bool) -> list[Law]:
    style, words = c.words[2], list(c.words[3:])
    said = {"group": group, "name": style, "where": c.where}
    force = u.factor("force")
    if style == "addforce":
        _only(words[3:])
        return [Constant(**said, vector=tuple(force * _number(w) for w in words[:3]))]
    if style in ("setforce", "aveforce"):
        _only(words[3:])
        values = tuple(None if w == "NULL" else force * _number(w) for w in words[:3])
        return [Put(**said, values=values, mean=style == "aveforce")]
    if style == "freeze":
        return [Put(**said, values=(0.0, 0.0, 0.0))]
    if style in ("lineforce", "planeforce"):
        return [Along(**said, direction=tuple(_number(w) for w in words[:3]), plane=style == "planeforce")]
    if style == "gravity":
        g = _number(words[0]) * force / u.mass
        return [Constant(**said, vector=tuple(g * e for e in _direction(words[1:])), per="masses")]
    if style == "efield" and u.name in ("lj", "real", "metal"):
        _only(words[3:])
        # Volts per length in real and metal: 1 V on a charge of 1 is 1 eV, the internal unit of energy.
        factor = force if u.reduced else 1.0 / u.length
        return [Constant(**said, vector=tuple(factor * _number(w) for w in words[:3]), per="charges")]
    if style == "viscous":
        scale, rest = [], words[1:]
        while rest:
            if rest[0] != "scale":
                raise _NotUnderstood
            scale.append((int(rest[1]), _number(rest[2])))
            rest = rest[3:]
        return [Friction(**said, gamma=_number(words[0]) * force / u.factor("velocity"), scale=tuple(scale))]
    if style == "indent":
        return [_indenter(words, said, u, lattice)]
    if style in _WALLS:
        return _walls(style, words, said, u, lattice)
    raise _NotUnderstood


def _number(word: str) -> float:
    value = float(word)
    if not np.isfinite(value):
        raise _NotUnderstood
    return value


def _only(words, allowed=()) -> None:
    if [w for w in words if w not in allowed]:
        raise _NotUnderstood


def _direction(words) -> np.ndarray:
    """The unit vector that ``fix gravity`` names."""
    if words[0] == "vector":
        _only(words[4:])
        v = np.array([_number(w) for w in words[1:4]])
        return v / np.linalg.norm(v)
    if words[0] == "chute":
        _only(words[2:])
        a = _number(words[1]) * pi / 180
        return np.array([sin(a), 0.0, -cos(a)])
    if words[0] == "spherical":
        _only(words[3:])
        phi, theta = (_number(w) * pi / 180 for w in words[1:3])
        return np.array([sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)])
    raise _NotUnderstood


def _plain(words, lattice: bool) -> list[str]:
    """The words without ``units box``; lengths in units of a lattice are not understood."""
    if "units" in words:
        k = words.index("units")
        if words[k + 1] != "box" and lattice:
            raise _NotUnderstood
        return words[:k] + words[k + 2 :]
    if lattice:
        raise _NotUnderstood
    return words


def _walls(style, words, said, u: Units, lattice: bool) -> list[Law]:
    words = _plain(words, lattice and any(w not in _FACES and w != "EDGE" for w in words[1:2]))
    factors = {"energy": u.energy, "length": u.length, "1/length": 1.0 / u.length, "stiffness": u.energy / u.length**2}
    kinds, out = _WALLS[style], []
    while words:
        if words[0] not in _FACES:
            raise _NotUnderstood
        axis, side = _FACES[words[0]]
        at = None if words[1] == "EDGE" else _number(words[1]) * u.length
        numbers = words[2 : 3 + len(kinds)]
        if len(numbers) != len(kinds) + 1:
            raise _NotUnderstood
        cutoff = _number(numbers[-1]) * u.length
        values = tuple(_number(w) * factors[k] for w, k in zip(numbers, kinds) if k is not None)
        numbers = (*values, cutoff) if style == "wall/harmonic" else values
        out.append(Wall(**said, axis=axis, side=side, at=at, numbers=numbers, cutoff=cutoff))
        words = words[3 + len(kinds) :]
    return out


def _indenter(words, said, u: Units, lattice: bool) -> Law:
    K = _number(words[0]) * u.factor("force") / u.length**2
    words, inward, shape = _plain(words[1:], lattice), False, None
    while words:
        key = words[0]
        if key == "sphere":
            centre = tuple(_number(w) * u.length for w in words[1:4])
            shape = {"shape": key, "centre": centre, "radius": _number(words[4]) * u.length}
            words = words[5:]
        elif key == "cylinder":
            axis = "xyz".index(words[1])
            centre = np.zeros(3)
            centre[[k for k in range(3) if k != axis]] = [_number(w) * u.length for w in words[2:4]]
            shape = {"shape": key, "axis": axis, "centre": tuple(centre), "radius": _number(words[4]) * u.length}
            words = words[5:]
        elif key == "plane":
            axis, centre = "xyz".index(words[1]), np.zeros(3)
            centre[axis] = _number(words[2]) * u.length
            if words[3] not in ("lo", "hi"):
                raise _NotUnderstood
            shape, inward = {"shape": key, "axis": axis, "centre": tuple(centre)}, words[3] == "hi"
            words = words[4:]
        elif key == "side":
            inward, words = words[1] == "in", words[2:]
        else:
            raise _NotUnderstood
    if shape is None:
        raise _NotUnderstood
    return Indenter(**said, **shape, stiffness=K, inward=inward)
