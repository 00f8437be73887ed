"""``read_data`` on the table of atoms: several files, with offsets, and what their headers say of the box."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .atom_commands import SECTIONS
from .regions import Trouble
from .script import Command

_WORDS = {"group": 1, "nocoeff": 0, "shift": 3, "offset": 5, "fix": 3}
_KINDS = ("atom", "bond", "angle", "dihedral", "improper")


@dataclass
class DataOptions:
    """The words behind the file's name. offsets : {kind: what is added to its types}; add : None, "append", "merge" or
    (atom, molecule) offsets."""

    file: Path
    add: object = None
    offsets: dict = field(default_factory=lambda: dict.fromkeys(_KINDS, 0))
    shift: tuple = (0.0, 0.0, 0.0)
    group: str = ""
    nocoeff: bool = False
    fixes: tuple = ()
    extra_types: int = 0


def data_options(c: Command, folder: Path) -> DataOptions:
    """The words of a ``read_data`` command. AtcError for what LAMMPS does not know."""
    if not c.words:
        raise c.error("read_data needs the name of a data file")
    out = DataOptions(folder / Path(c.words[0]).expanduser())
    words, k = c.words, 1

    def numbers(at, n, kind):
        try:
            values = tuple(kind(w) for w in words[at : at + n])
        except ValueError:
            values = ()
        if len(values) != n:
            raise c.error(
                f"read_data {words[at - 1]}: expected {n} number{'s' * (n > 1)}, got "
                f"{' '.join(words[at : at + n]) or 'nothing'}"
            )
        return values

    while k < len(words):
        key = words[k]
        if key == "add":
            value = words[k + 1] if k + 1 < len(words) else ""
            if value in ("append", "merge"):
                out.add = value
                k += 2
            else:
                (first,) = numbers(k + 1, 1, int)
                more = k + 2 < len(words) and words[k + 2].isdigit()
                out.add = (first, int(words[k + 2]) if more else 0)
                k += 2 + more
        elif key == "offset":
            out.offsets = dict(zip(_KINDS, numbers(k + 1, 5, int), strict=True))
            k += 6
        elif key == "shift":
            out.shift = numbers(k + 1, 3, float)
            k += 4
        elif key.startswith("extra/"):
            (more,) = numbers(k + 1, 1, int)
            out.extra_types = more if key == "extra/atom/types" else out.extra_types
            k += 2
        elif key in _WORDS and k + _WORDS[key] < len(words):
            if key == "group":
                out.group = words[k + 1]
            elif key == "fix":
                out.fixes = (*out.fixes, words[k + 1 : k + 4])
            else:
                out.nocoeff = True
            k += 1 + _WORDS[key]
        else:
            raise c.error(f"read_data {key}: expected add, offset, shift, extra/..., group, nocoeff or fix")
    return out


def read_data(atoms, c: Command) -> None:
    """Add the atoms of a data file to the table of `Atoms`."""
    options = data_options(c, atoms.origin.folder)
    data = atoms.origin.open_data(options.file, c)
    if data is None:
        raise Trouble(f"{options.file} is not there")
    atoms.files.append(options.file)
    types = data.counts.get("atom types", 2)
    atoms.n_types = max(atoms.n_types, types + options.offsets["atom"], types + options.extra_types)
    _box(atoms, data, options)
    shift_id = shift_mol = 0
    if options.add == "append":
        shift_id, shift_mol = (int(a[atoms.alive].max(initial=0)) for a in (atoms.ids, atoms.molecules))
        if not atoms.complete:
            raise Trouble("its atoms get numbers behind those of atoms that are not known")
    elif isinstance(options.add, tuple):
        shift_id, shift_mol = options.add
    # Numbers as the file has them: conversion to other units and back would round.
    raw = data._raw["atoms"]
    order = np.argsort(raw["id"], kind="stable")
    x = np.stack([raw[k] for k in "xyz"], axis=1)[order] + np.array(options.shift)
    masses = None if data.per_atom_mass is None else data.per_atom_mass / atoms.origin.mass_unit
    ids = data.ids + shift_id
    twice = ids[np.isin(ids, atoms.ids[atoms.alive])]
    if len(twice):
        raise c.error(f"read_data: atom {twice[0]} of {options.file} is there already")
    new = atoms._add(
        ids,
        data.types + options.offsets["atom"],
        False,
        charges=raw["q"][order] if "q" in raw else None,
        molecules=raw["mol"][order] + shift_mol if "mol" in raw else None,
        masses=masses,
        positions=_unwrapped(raw, order, x, data),
    )
    if data.untold:
        atoms.why |= dict.fromkeys(SECTIONS, data.untold)
    for section, width in SECTIONS.items():
        types, members = data.bonded.get(section, (np.zeros(0, np.int64), np.zeros((0, width), np.int64)))
        old_types, old_members = atoms.bonded[section]
        types = np.concatenate([old_types, types + options.offsets[section[:-1].lower()]])
        atoms.bonded[section] = types, np.concatenate([old_members, members + shift_id])
    for t, (mass, _) in data._mass_of_key.items():
        atoms.type_masses[t + options.offsets["atom"]] = float(mass)
    for kind, labels in data.labels.items():
        atoms.origin.labels.setdefault(kind.lower(), {}).update(labels)
    if options.group:
        atoms._join(options.group, new)
    for _, _, section in options.fixes:
        if section not in ("NULL", "CMAP", "crossterm"):
            for what in ("charges", "molecules", "masses"):
                if what not in atoms.origin.columns:
                    why = f"{c.where}: the section {section} of {options.file} may hold it, which is not read"
                    atoms._taint(what, new, why)


def _unwrapped(raw, order, x, data):
    """Positions with image flags put in: where copies of the atoms go depends on them."""
    if "ix" not in raw or data.box is None:
        return x
    images = np.stack([raw[k] for k in ("ix", "iy", "iz")], axis=1)[order]
    return x + images @ data.box[0] if images.any() else x


def _box(atoms, data, options) -> None:
    if data.box is None:
        atoms.box = None
        return
    edges, lo = data.box
    lo = lo + np.array(options.shift)
    if np.any(edges != np.tril(edges)):
        atoms.box = None  # a general triclinic box, which LAMMPS turns
        return
    hi = lo + np.diag(edges)
    if options.add is not None and atoms.box is not None:
        lo, hi = np.minimum(lo, atoms.box[0]), np.maximum(hi, atoms.box[1])
    atoms.box, atoms.tilt = (lo, hi), (edges[1, 0], edges[2, 0], edges[2, 1])
