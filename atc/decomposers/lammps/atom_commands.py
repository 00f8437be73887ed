"""The commands that concern atoms: their keywords, and which properties of atoms they change."""

from __future__ import annotations

import re

import numpy as np

from .script import Command

#: Properties of atoms that are kept, and what a created atom has.
PROPERTIES = {"types": 0, "charges": 0.0, "molecules": 0, "masses": np.nan, "positions": np.nan}
SECTIONS = {"Bonds": 2, "Angles": 3, "Dihedrals": 4, "Impropers": 4}
#: Keywords of ``set``: how many values each has, and which property it changes ("" for what no supported force depends
#: on).
SET = {
    "type": (1, "types"), "type/fraction": (3, "types"), "type/ratio": (3, "types"), "type/subset": (3, "types"),
    "mol": (1, "molecules"), "x": (1, "positions"), "y": (1, "positions"), "z": (1, "positions"),
    "charge": (1, "charges"), "mass": (1, "masses"), "density": (1, "masses"), "density/disc": (1, "masses"),
    "smd/mass/density": (1, "masses"), "bond": (1, "Bonds"), "angle": (1, "Angles"), "dihedral": (1, "Dihedrals"),
    "improper": (1, "Impropers"), "image": (3, ""), "vx": (1, ""), "vy": (1, ""), "vz": (1, ""), "dipole": (3, ""),
    "dipole/random": (2, ""), "spin": (4, ""), "spin/atom": (4, ""), "spin/random": (2, ""),
    "spin/atom/random": (2, ""), "spin/electron": (1, ""), "radius/electron": (1, ""), "quat": (4, ""),
    "quat/random": (1, ""), "diameter": (1, ""), "shape": (3, ""), "length": (1, ""), "tri": (1, ""), "theta": (1, ""),
    "theta/random": (1, ""), "angmom": (3, ""), "omega": (3, ""), "temperature": (1, ""), "volume": (1, ""),
    "sph/e": (1, ""), "sph/cv": (1, ""), "sph/rho": (1, ""), "rheo/rho": (1, ""), "rheo/status": (1, ""),
    "smd/contact/radius": (1, ""), "dpd/theta": (1, ""), "edpd/temp": (1, ""), "edpd/cv": (1, ""), "cc": (2, ""),
    "epsilon": (1, ""),
}  # fmt: skip
RANDOM = ("type/fraction", "type/ratio", "type/subset")
MOLECULAR = {"angle", "bond", "full", "molecular", "template", "amoeba", "oxdna"}


def set_keywords(c: Command) -> list[tuple[str, tuple[str, ...]]]:
    """[(keyword, values), ...] of a ``set`` command. AtcError for a keyword that is not known."""
    out, k = [], 2
    if len(c.words) < 4:
        raise c.error(
            f"expected 'set atom|type|mol|group|region <which> <keyword> <value>', got 'set {' '.join(c.words)}'"
        )
    while k < len(c.words):
        key = c.words[k]
        n = 1 if re.match(r"[id]2?_", key) else SET.get(key, (0, ""))[0]
        if not n or k + n >= len(c.words):
            raise c.error(f"set {key}: {'its value is missing' if n else 'no property of atoms that atc knows'}")
        out.append((key, c.words[k + 1 : k + 1 + n]))
        k += 1 + n
    return out


def boundary_words(c: Command) -> tuple[str, ...]:
    """The three words of a ``boundary`` command, or of ``change_box ... boundary``."""
    words = c.words if c.name == "boundary" else c.words[c.words.index("boundary") + 1 :][:3]
    if len(words) != 3 or any(not re.fullmatch("p|pp|[fsm]{1,2}", w) for w in words):
        raise c.error(f"{c.name}: expected three of p, f, s, m, got {' '.join(words) or 'nothing'}")
    return tuple(words)


def periodic_axes(words) -> list[bool]:
    """Which axes three words of ``boundary`` make periodic."""
    return [w in ("p", "pp") for w in words]


def without_boundary(words):
    """The words of a command without ``boundary`` and the three behind it."""
    if "boundary" not in words:
        return words
    k = words.index("boundary")
    return words[:k] + words[k + 4 :]


def touches(c: Command) -> set[str]:
    """What a command changes: property names, section names, "boundary", "atoms" (which there are), "ids"."""
    if c.name == "set":
        return {SET.get(key, (0, ""))[1] for key, _ in set_keywords(c)} - {""}
    if c.name == "delete_atoms":
        return {"atoms", "ids", *SECTIONS}
    if c.name in ("delete_bonds", "create_bonds"):
        return set(SECTIONS)
    if c.name in ("read_data", "create_atoms", "replicate", "read_restart", "read_dump"):
        return {"atoms", "types", "charges", "molecules", "masses", *SECTIONS}
    if c.name in ("reset_atom_ids", "reset_ids") or (c.name == "reset_atoms" and c.words[:1] == ("id",)):
        return {"ids"}
    if c.name == "reset_mol_ids" or (c.name == "reset_atoms" and c.words[:1] == ("mol",)):
        return {"molecules"}
    if c.name == "change_box":
        return {"boundary"} if "boundary" in c.words else set()
    return {"boundary": {"boundary"}, "mass": {"masses"}}.get(c.name, set())
