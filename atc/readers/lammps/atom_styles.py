"""LAMMPS's atom styles: the columns of the Atoms and Velocities sections of data files, by name or as far as they can
be told from the file."""

from __future__ import annotations

import os
import re

from ...errors import AtcError

# Columns of the Atoms section (LAMMPS manual, read_data; template, dielectric, rheo and amoeba as LAMMPS 22 Jul 2025
# writes and reads them). Three image flags may follow. tdpd has as many concentrations behind z as its argument says.
ATOM_STYLES = {
    "amoeba": "id mol type q x y z",
    "angle": "id mol type x y z",
    "atomic": "id type x y z",
    "body": "id type bodyflag mass x y z",
    "bond": "id mol type x y z",
    "bpm/sphere": "id mol type diameter density x y z",
    "charge": "id type q x y z",
    "dielectric": "id mol type q x y z normx normy normz area ed em epsilon curvature",
    "dipole": "id type q x y z mux muy muz",
    "dpd": "id type theta x y z",
    "edpd": "id type edpd_temp edpd_cv x y z",
    "electron": "id type q espin eradius x y z",
    "ellipsoid": "id type ellipsoidflag density x y z",
    "full": "id mol type q x y z",
    "line": "id mol type lineflag density x y z",
    "mdpd": "id type rho x y z",
    "mesont": "id mol type bond1 bond2 mass mradius mlength buckling x y z",
    "molecular": "id mol type x y z",
    "oxdna": "id type x y z",
    "peri": "id type volume density x y z",
    "rheo": "id type status rho x y z",
    "rheo/thermal": "id type status rho esph x y z",
    "smd": "id type mol volume mass kradius cradius x0 y0 z0 x y z",
    "sph": "id type rho esph cv x y z",
    "sphere": "id type diameter density x y z",
    "spin": "id type x y z spx spy spz sp",
    "tdpd": "id type x y z",
    "template": "id mol template_index template_atom type x y z",
    "tri": "id mol type triangleflag density x y z",
    "wavepacket": "id type q espin eradius etag cs_re cs_im x y z",
}
# Names of older versions, by what they are called today.
_RENAMED = {"granular": "sphere", "meso": "sph"}
# Behind id vx vy vz in section Velocities, in LAMMPS's units of each.
_VELOCITIES = {
    "body": "lx ly lz", "bpm/sphere": "wx wy wz", "electron": "ervel", "ellipsoid": "lx ly lz", "line": "wx wy wz",
    "sphere": "wx wy wz", "tri": "wx wy wz lx ly lz", "wavepacket": "ervel",
}  # fmt: skip
# Columns that are one property of LAMMPS's: in a hybrid style only the first sub-style that has it prints it.
_PROPERTY = {
    "density": "rmass", "mass": "rmass", "diameter": "radius", "cradius": "radius", "normx": "mux", "normy": "muy",
    "normz": "muz", "wx": "omegax", "lx": "angmomx",
}  # fmt: skip
#: Styles that give an atom its mass by a volume of its own. Each multiplies the density by its volume.
SHAPED = frozenset(("bpm/sphere", "ellipsoid", "line", "sphere", "tri"))

_USUAL = ("atomic", "charge", "molecular", "full")  # what a style is called of which others have the same columns
_BEHIND = "id type x y z".split()
_USED = frozenset("id mol type q mass x y z ix iy iz diameter density template_index template_atom".split())
_NOT_NEGATIVE = frozenset(
    "theta rho diameter density mass volume eradius edpd_temp edpd_cv esph cv area epsilon kradius cradius "
    "template_index template_atom".split()
)
WHOLE = frozenset(
    "id mol ix iy iz bodyflag ellipsoidflag lineflag triangleflag template_index template_atom status espin "
    "etag".split()
)
ASK = "write the style behind the name of the section, e.g. 'Atoms # full', or give it: atom_style = \"full\""


def _base(word: str) -> str:
    word = re.sub(r"/(kk|omp|gpu|device|host)$", "", word)
    return _RENAMED.get(word, word)


class AtomStyle:
    """An ``atom_style`` line as a script has it, e.g. ``hybrid sphere tdpd 2 template mols``.

    Attributes
    ----------
    name : the words, cleaned. parts : names of the sub-styles, of the style itself if it is not hybrid; () for a hybrid
        that does not name them
    species : concentrations of tdpd, None if not said

    Raises
    ------
    AtcError, with `where` in front, for a name that is none of LAMMPS's.
    """

    def __init__(self, words, where: str):
        words = words.split() if isinstance(words, str) else list(words)
        if not words or not all(isinstance(w, str) for w in words):
            raise AtcError(
                f'{where}: expected a LAMMPS atom style, e.g. "full" or "hybrid sphere molecular", got {words!r}'
            )
        self.given = " ".join(words)
        self.hybrid = _base(words[0]) == "hybrid"
        self.species = None
        parts, k = [], int(self.hybrid)
        while k < len(words):
            name = _base(words[k])
            if name not in ATOM_STYLES or (parts and not self.hybrid):
                raise AtcError(
                    f"{where}: {words[k]!r} is no atom style that atc knows, which are hybrid, {', '.join(ATOM_STYLES)}"
                )
            parts.append(name)
            k += 1 + self._arguments(name, words[k + 1 :])
        self.parts = tuple(parts)
        self.name = " ".join(("hybrid", *parts) if self.hybrid else parts)

    def _arguments(self, name, behind) -> int:
        """How many of the words behind a style's name are its arguments."""
        if name == "tdpd" and behind and behind[0].isdigit() and len(behind[0]) < 5:
            self.species = int(behind[0])
            return 1
        if name == "template":
            return min(1, len(behind))
        n = 0
        if name == "body" and behind:
            n = 1
        if name in ("body", "sphere", "bpm/sphere"):
            while n < len(behind) and behind[n].isdigit():
                n += 1
        return n

    def columns(self, width: int | None = None) -> list[str]:
        """Names of the columns of section Atoms, without image flags. `width`: of the file's lines, for a tdpd that
        does not say its species."""
        if not self.hybrid:
            columns = ATOM_STYLES[self.parts[0]].split()
            more = 0 if width is None else width - len(columns)
            return columns + self._species(more) if self.parts[0] == "tdpd" else columns
        columns, have = list(_BEHIND), set(_BEHIND)
        for name in self.parts:
            more = self._species(0) if name == "tdpd" else ATOM_STYLES[name].split()
            for c in more:
                if _PROPERTY.get(c, c) not in have:
                    columns.append(c)
                    have.add(_PROPERTY.get(c, c))
        return columns

    def _species(self, otherwise: int) -> list[str]:
        n = otherwise if self.species is None else self.species
        return [f"tdpd_{k}" for k in range(max(0, n))]

    @property
    def certain(self) -> bool:
        """Whether the columns are known without looking at the file."""
        return bool(self.parts) and ("tdpd" not in self.parts or self.species is not None)

    def velocity_columns(self) -> list[str]:
        columns, have = "id vx vy vz".split(), set()
        for name in self.parts:
            new = [c for c in _VELOCITIES.get(name, "").split() if c not in have]
            columns += new
            have.update(new)
        return columns


class StyledFile(os.PathLike):
    """The path of a data file, with the atom style of the run that it is for."""

    def __init__(self, path, atom_style):
        self.path, self.atom_style = os.fspath(path), AtomStyle(atom_style, "atom_style").given

    def __fspath__(self):
        return self.path

    def __str__(self):
        return str(self.path)


def style_of_comment(comment: str) -> AtomStyle | None:
    """The style that the comment behind ``Atoms`` names; None if it says something else."""
    words = comment.replace(":", " ").replace(",", " ").split()
    if not words:
        return None
    first = _base(words[0])
    if first == "hybrid":
        try:
            return AtomStyle(words, "")
        except AtcError:
            return AtomStyle(["hybrid"], "")
    if first not in ATOM_STYLES:
        return None
    # Behind the name of a style that has no arguments there may be words for people, such as the names of the columns.
    return AtomStyle(words[:2] if first == "tdpd" and len(words) > 1 and words[1].isdigit() else [first], "")


def inferred_style(rows, bonded: bool, where: str) -> AtomStyle:
    """The style of a section whose name has no comment, from its first lines (lists of words), if that leaves one
    possibility.

    `bonded`: the file has bonded terms, so that its atoms have molecules.

    Raises
    ------
    AtcError that names the candidates.
    """
    row = rows[0]
    possible: dict[tuple, list[str]] = {}
    for name, spec in ATOM_STYLES.items():
        if name == "tdpd":  # any number of columns
            continue
        columns = spec.split()
        for extra in ([], ["ix", "iy", "iz"]):
            full = columns + extra
            if len(full) != len(row) or (bonded and "mol" not in full):
                continue
            if all(_fits(c, w) for words in rows if len(words) == len(row) for c, w in zip(full, words, strict=True)):
                # What differs only in columns that are not used is the same.
                key = tuple(c if c in _USED else "-" for c in full)
                possible.setdefault(key, []).append(name)
    if any(key[-1] == "iz" for key in possible):
        # The last three columns hold integers alone: image flags, not positions.
        possible = {key: names for key, names in possible.items() if key[-3:] != ("x", "y", "z")}
    if len(possible) != 1:
        names = ", ".join(name for group in possible.values() for name in group) or "none"
        raise AtcError(
            f"{where}: which atom style has these {len(row)} columns is not certain (possible: {names}); {ASK}"
        )
    names = next(iter(possible.values()))
    return AtomStyle([next((name for name in _USUAL if name in names), names[0])], where)


def _fits(column: str, word: str) -> bool:
    """Whether a word can stand in a column: integers where integers belong, nothing negative where that has no
    meaning."""
    if column == "type":
        return not re.fullmatch(r"[-+]?(\d+\.\d*|\.\d+|0|-\d+|\d*\.?\d+[eE].*)", word)
    if column in _NOT_NEGATIVE and word.startswith("-"):
        return False
    if column in WHOLE:
        return bool(re.fullmatch(r"[01]" if column.endswith("flag") else r"[-+]?\d+", word))
    return bool(re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?", word))
