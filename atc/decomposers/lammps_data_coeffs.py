"""Coefficients, masses and type labels that a LAMMPS data file holds, as if they were lines of the script."""

from __future__ import annotations

from pathlib import Path

from ..errors import AtcError
from .lammps_script import Command


def data_file_commands(path: Path, style_names: dict[str, str]) -> list[Command]:
    """``mass``, ``labelmap`` and ``*_coeff`` commands equivalent to the sections of a data file.

    `style_names` are the styles in force ({"pair": "lj/cut", ...}): sections of kinds without a style are passed over. The cross terms of class2 come as
    ``angle_coeff N bb ...`` (``angle_coeff N class2 bb ...`` where the style is hybrid).
    """
    from ..readers.lammps_data import COEFFS, SECTIONS, header_line
    from ..readers.lammps_sections import SectionedFile

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
            for k, words in enumerate(s.rows()):
                coeffs.append(_coefficients(kind, cross, words, style_names, s.where(k)))
    return labels + masses + [c for c in coeffs if c is not None]


def _coefficients(kind, cross, words, style_names, where) -> Command | None:
    if kind == "pair":
        words = [words[0], *words]
    elif kind == "pairij":
        kind = "pair"
    elif cross:
        # Lines of a hybrid name the style, or say that the type has no such term.
        named = int(style_names[kind].startswith("hybrid") and len(words) > 1)
        if named and words[1] == "skip":
            return None
        words = [*words[: 1 + named], cross, *words[1 + named :]]
    return Command(f"{kind}_coeff", tuple(words), where)


def resolve(folder: Path, c: Command) -> Path:
    """The file of a read_data line."""
    p = Path(c.words[0]).expanduser()
    return p if p.is_absolute() else folder / p


def take_data_file(c: Command, folder: Path, style_names) -> tuple[Path, list[Command]]:
    """The path, and the commands of the data file; none if it is not there (only needed if coefficients turn out missing)."""
    path = resolve(folder, c)
    if not path.exists():
        return path, []
    try:
        return path, data_file_commands(path, {} if "nocoeff" in c.words else style_names)
    except AtcError as e:
        raise AtcError(f"{c.where}: read_data: {e}") from None
