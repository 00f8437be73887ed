"""What LAMMPS's many-body parameter files share: the units tag, and entries of three element names and a fixed list of
numbers, over as many lines as it takes."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from itertools import product

from ...errors import AtcError, AtcWarning
from ...readers.lammps.sections import number_of, shortened
from ...readers.whole import whole_text

# LAMMPS's own factor between eV and kcal/mol, so that a converted file gives LAMMPS's energies to rounding.
_METAL_TO_REAL = 23.060549
#: No parameter is as large; their powers must be numbers.
LARGE = 1e50


def read_parameter_file(path, what: str, where: str = "") -> str:
    """The text of a `what` parameter file, or an AtcError at `where` that says why not."""
    return whole_text(path, what, where)


def word_lines(text: str, skip: int = 0) -> list[tuple[int, list[str]]]:
    """(number, words) of the lines behind the first `skip` that hold more than a comment."""
    lines = enumerate(text.splitlines()[skip:], skip + 1)
    return [(k, words) for k, line in lines if (words := line.partition("#")[0].split())]


def number(word: str, what: str, at: str, positive: bool = False) -> float:
    """A number of a potential; AtcError at `at` where the word is none."""
    value = number_of(word)
    if value is None or not abs(value) < LARGE or (positive and not value > 0):
        # What computers write for a number that is none.
        odd = value is not None or word.lower().lstrip("+-") in ("nan", "inf", "infinity")
        wanted = "a positive number" if positive else f"a finite number below {LARGE:g}" if odd else "a number"
        raise AtcError(f"{at}: {what} must be {wanted}, got {shortened(word)!r}")
    return value


def numbers(words, keys, at: str) -> list[float]:
    """A number for each of `keys`."""
    if len(words) != len(keys):
        raise AtcError(f"{at}: expected {len(keys)} numbers ({' '.join(keys)}), got {shortened(' '.join(words))!r}")
    return [number(word, key, at) for key, word in zip(keys, words, strict=True)]


def entries_of(text: str, path, length: int, what: str, form: str) -> Iterator[tuple[str, list[str]]]:
    """(where, words) of the `what` entries of a text: `length` words each (`form`), on any number of lines."""
    words: list[str] = []
    first = 0
    for k, new in word_lines(text):
        first = first if words else k
        words += new
        if len(words) > length:
            raise AtcError(
                f"{path}:{first}: expected {length} words ({form}) in a {what} entry, found {len(words)} words"
            )
        if len(words) == length:
            yield f"{path}:{first}", words
            words = []
    if words:
        raise AtcError(
            f"{path}:{first}: the last {what} entry has {len(words)} of {length} words ({form}): complete it"
        )


def units_tag(text: str) -> str | None:
    """The unit style that a parameter file names in its first line (``UNITS: metal``), or None."""
    words = text.partition("\n")[0].replace("#", " ").split()
    return words[words.index("UNITS:") + 1] if "UNITS:" in words[:-1] else None


def same_units(text: str, wanted: str, path, what: str) -> None:
    """Of files that LAMMPS takes as they are: raise AtcError if this one says that it is in other units."""
    if units_tag(text) not in (None, wanted):
        raise AtcError(
            f"{path}: this file is in {units_tag(text)!r} units and the model in {wanted!r}: LAMMPS does not convert "
            f"{what} files"
        )


class Rows:
    """The lines of a file, as words, taken one by one."""

    def __init__(self, path, lines: list[tuple[int, list[str]]]):
        self.path, self.lines, self.place = path, lines, 0

    def values(self, what: str, kinds) -> tuple[list, str]:
        """The numbers (or names) that the next line begins with, one of each of `kinds` (or all it has, of one kind),
        and where it stands."""
        if self.place >= len(self.lines):
            raise AtcError(f"{self.path}: ends where {what} should follow: the file is cut off")
        number, words = self.lines[self.place]
        self.place += 1
        kinds = kinds if isinstance(kinds, tuple) else (kinds,) * len(words)
        try:
            values = [kind(w) for kind, w in zip(kinds, words, strict=len(words) < len(kinds))]
        except ValueError:
            values = []
        if not values or not all(abs(v) < LARGE for v in values if not isinstance(v, str)):
            raise AtcError(f"{self.path}:{number}: expected {what}, got {' '.join(words)!r}")
        return values, f"{self.path}:{number}"


def energy_conversion(text: str, wanted: str, path) -> float:
    """What energies of a file are multiplied with to be in `wanted` units: 1 unless its tag says metal or real and the
    other is wanted."""
    has = units_tag(text)
    if has is None or has == wanted:
        return 1.0
    if (has, wanted) == ("metal", "real"):
        factor = _METAL_TO_REAL
    elif (has, wanted) == ("real", "metal"):
        factor = 1.0 / _METAL_TO_REAL
    else:
        raise AtcError(
            f"{path}: this file is in {has!r} units (its UNITS: tag) and the model in {wanted!r}: only metal and real "
            f"convert into each other; use a file in {wanted!r} units"
        )
    warnings.warn(f"{path}: energies converted from {has} to {wanted} units, as LAMMPS does", AtcWarning, stacklevel=4)
    return factor


def read_entries(path, elements, units_name: str, kind, where: str = "") -> dict:
    """{(elem1, elem2, elem3): entry} of a parameter file for some elements, energies and lengths in `units_name`.

    kind : the class of an entry, see `entries.Entry`

    Raises
    ------
    AtcError for a missing file, a malformed, impossible or duplicate entry, a missing combination of `elements`, or
    units that cannot be converted.
    """
    text = read_parameter_file(path, kind.what, where)
    if not kind.converts:
        same_units(text, units_name, path, kind.what)
    factor = energy_conversion(text, units_name, path)
    entries: dict[tuple, object] = {}
    keys = kind.keys()
    for here, words in entries_of(text, path, 3 + len(keys), kind.what, f"3 elements and {' '.join(keys)}"):
        names = tuple(words[:3])
        if not all(name in elements for name in names):
            continue
        entry = kind(**dict(zip(keys, numbers(words[3:], keys, here), strict=True)), where=here)
        if wrong := entry.check():
            raise AtcError(f"{here}: {wrong}")
        if names in entries:
            raise AtcError(
                f"{here}: second entry for {' '.join(names)} (the first is at {entries[names].where}): remove one"
            )
        entries[names] = replace(entry, **{key: getattr(entry, key) * factor for key in kind.energies})
    for triple in product(elements, repeat=3):
        if triple not in entries:
            raise AtcError(
                f"{path}: no entry for {' '.join(triple)}, which {where or 'the list of elements'} needs; a file must "
                "have every combination"
            )
    return entries
