"""Coefficients, masses and type labels that a LAMMPS data file holds, as if they were lines of the script."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

from ...errors import AtcError
from ..bonded import SECTIONS
from .read_data import data_options
from .script import Command

_SECTION = re.compile(
    rb"^[ \t]*((?:Pair|PairIJ|Bond|Angle|Dihedral|Improper|BondBond|BondAngle|MiddleBondTorsion|EndBondTorsion|AngleTorsion|AngleAngleTorsion|BondBond13|"
    rb"AngleAngle) Coeffs|(?:Atom|Bond|Angle|Dihedral|Improper) Type Labels|Masses)[ \t]*(?:#[^\n]*)?\r?$",
    re.M,
)


def data_file_commands(path: Path, style_names: dict[str, str]) -> list[Command]:
    """``mass``, ``labelmap`` and ``*_coeff`` commands equivalent to the sections of a data file.

    `style_names` are the styles in force ({"pair": "lj/cut", ...}): sections of kinds without a style are passed over. The cross terms of class2 come as
    ``angle_coeff N bb ...`` (``angle_coeff N class2 bb ...`` where the style is hybrid).
    """
    text = _bytes(path)
    # Sections of class2 cross terms: their rows are lines with a word of their own.
    crosses = {section: key for key, section in SECTIONS.items() if key[1]}
    labels, masses, coeffs = [], [], []
    for m in _SECTION.finditer(text):
        section = m.group(1).decode()
        line = text.count(b"\n", 0, m.end()) + 1
        kind = section.split()[0].lower()
        seen = False
        for raw in text[m.end() + 1 : m.end() + (1 << 20)].split(b"\n"):
            line += 1
            words = raw.split(b"#")[0].decode("utf-8", "replace").split()
            if not words:
                if seen:
                    break
                continue
            # The next section's name ends this one: rows start with a number or a label and have more than one word.
            if seen and _SECTION.match(raw):
                break
            seen = True
            where = f"{path}, line {line}"
            if section == "Masses":
                masses.append(Command("mass", tuple(words[:2]), where))
            elif section.endswith("Labels"):
                labels.append(Command("labelmap", (kind, *words[:2]), where))
            elif kind == "pairij" and "pair" in style_names:
                coeffs.append(Command("pair_coeff", tuple(words), where))
            elif kind == "pair" and "pair" in style_names:
                coeffs.append(Command("pair_coeff", (words[0], *words), where))
            elif section in crosses:
                of, word = crosses[section]
                # hybrid: the style's name, or skip, comes first.
                at = 2 if style_names.get(of) == "hybrid" else 1
                if of in style_names and "skip" not in words[1:2]:
                    coeffs.append(Command(f"{of}_coeff", (*words[:at], word, *words[at:]), where))
            elif kind in style_names:
                coeffs.append(Command(f"{kind}_coeff", tuple(words), where))
    return labels + masses + coeffs


def _bytes(path: Path) -> bytes:
    """The file, decompressed."""
    from ...readers._bytes import open_bytes

    reader = open_bytes(path)
    parts, at = [], 0
    while len(part := reader.read(at, at + (1 << 24))):
        parts.append(part.tobytes())
        at += len(part)
    reader.close()
    return b"".join(parts)


def take_data_file(c: Command, folder: Path, style_names) -> tuple[Path, list[Command]]:
    """The path, and the commands of the data file; none if it is not there (only needed if coefficients turn out missing)."""
    options = data_options(c, folder)
    path = options.file
    if not path.is_file():
        return path, []
    try:
        commands = data_file_commands(path, {} if options.nocoeff else style_names)
    except OSError as e:
        raise AtcError(f"{c.where}: {path} cannot be read: {e.strerror}") from None
    return path, [_offset(k, options.offsets) for k in commands] if any(options.offsets.values()) else commands


def _offset(c: Command, offsets: dict) -> Command:
    """A command of a data file whose types ``read_data ... offset`` shifts."""
    if c.name == "labelmap":
        kind, number, label = c.words
        return replace(c, words=(kind, str(int(number) + offsets[kind]), label))
    kind = "atom" if c.name in ("mass", "pair_coeff") else c.name.split("_")[0]
    width = 2 if c.name == "pair_coeff" else 1
    return replace(c, words=(*(str(int(w) + offsets[kind]) if w.isdigit() else w for w in c.words[:width]), *c.words[width:]))
