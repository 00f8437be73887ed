"""Coefficients, masses and type labels that a LAMMPS data file holds, as if they were lines of the script."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from ...errors import located
from .read_data import data_options
from .script import Command


def data_file_commands(path: Path, style_names: dict[str, str]) -> list[Command]:
    """``mass``, ``labelmap`` and ``*_coeff`` commands equivalent to the sections of a data file.

    `style_names` are the styles in force ({"pair": "lj/cut", ...}): sections of kinds without a style are passed over.
    The cross terms of class2 come as
    ``angle_coeff N bb ...`` (``angle_coeff N class2 bb ...`` where the style is hybrid).
    """
    from ...readers.lammps.data import COEFFS, SECTIONS
    from ...readers.lammps.data_header import header_line
    from ...readers.lammps.sections import SectionedFile

    f = SectionedFile(path, SECTIONS, header_line, "data file")
    labels, masses, coeffs = [], [], []
    for name in f.places:
        kind, cross = COEFFS.get(name, ("", ""))
        if name == "Masses" or name.endswith("Type Labels"):
            s = f.section(name)
            for k, words in enumerate(s.rows()):
                if name == "Masses":
                    masses.append(Command("mass", tuple(words[:2]), s.where(k)))
                else:
                    labels.append(Command("labelmap", (name.split()[0].lower(), *words[:2]), s.where(k)))
        elif kind.replace("pairij", "pair") in style_names:
            s = f.section(name)
            coeffs += [_coefficients(kind, cross, words, style_names, s.where(k)) for k, words in enumerate(s.rows())]
    return labels + masses + [c for c in coeffs if c is not None]


def _coefficients(kind, cross, words, style_names, where) -> Command | None:
    if kind == "pair":
        words = [words[0], *words]
    elif kind == "pairij":
        kind = "pair"
    elif cross:
        # Lines of a hybrid name the style, or say that the type has no such term.
        named = int(style_names[kind] == "hybrid" and len(words) > 1)
        if named and words[1] == "skip":
            return None
        words = [*words[: 1 + named], cross, *words[1 + named :]]
    return Command(f"{kind}_coeff", tuple(words), where)


def take_data_file(c: Command, folder: Path, style_names) -> tuple[Path, list[Command]]:
    """The path, and the commands of the data file; none if it is not there (only needed if coefficients turn out
    missing)."""
    options = data_options(c, folder)
    path = options.file
    if not os.path.isfile(path):
        return path, []
    with located(f"{c.where}: read_data"):
        commands = data_file_commands(path, {} if options.nocoeff else style_names)
    return path, [_offset(k, options.offsets) for k in commands] if any(options.offsets.values()) else commands


def _offset(c: Command, offsets: dict) -> Command:
    """A command of a data file whose types ``read_data ... offset`` shifts."""
    if c.name == "labelmap":
        kind, number, label = c.words
        return replace(c, words=(kind, str(int(number) + offsets[kind]), label))
    kind = "atom" if c.name in ("mass", "pair_coeff") else c.name.split("_")[0]
    width = 2 if c.name == "pair_coeff" else 1
    types = (str(int(w) + offsets[kind]) if w.isdigit() else w for w in c.words[:width])
    return replace(c, words=(*types, *c.words[width:]))
