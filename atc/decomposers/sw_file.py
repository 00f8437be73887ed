"""Stillinger-Weber parameter files as LAMMPS reads them."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import AtcError, AtcWarning

_NUMBERS = ("epsilon", "sigma", "a", "lam", "gamma", "costheta0", "A", "B", "p", "q", "tol")
# LAMMPS's own factor between eV and kcal/mol, so that a converted file gives LAMMPS's energies to rounding.
_METAL_TO_REAL = 23.060549


@dataclass(frozen=True)
class SWEntry:
    """One line of a parameter file, ``elem1 elem2 elem3`` with elem1 at the centre: see `StillingerWeber` for the meaning of the numbers."""

    epsilon: float
    sigma: float
    a: float
    lam: float
    gamma: float
    costheta0: float
    A: float
    B: float
    p: float
    q: float
    tol: float = 0.0
    where: str = "the Stillinger-Weber parameters"


def read_sw_file(path, elements, units_name: str, where: str = "") -> dict:
    """The entries of a LAMMPS ``.sw`` file for some elements.

    Parameters
    ----------
    path : str or Path
    elements : collection of str, the elements in use; entries with any other element are skipped, as LAMMPS does
    units_name : unit style the result is wanted in. A ``UNITS:`` tag in the file's first line that differs is converted between metal and
        real (energies times LAMMPS's own 23.060549), and refused otherwise. A file without tag is taken to be in `units_name`.
    where : file and line that named this file, for messages

    Returns
    -------
    {(elem1, elem2, elem3): SWEntry}, energies and lengths in `units_name`

    Raises
    ------
    AtcError for a missing file, a malformed, negative or duplicate entry, or units that cannot be converted.
    """
    at = f"{where}: " if where else ""
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except OSError as e:
        raise AtcError(
            f"{at}cannot read the Stillinger-Weber file {str(path)!r} ({e.strerror or e}): give its path relative to the input"
        ) from None
    factor = _conversion(text, units_name, path)
    entries: dict[tuple, SWEntry] = {}
    words: list[str] = []
    first = 0
    for number, line in enumerate(text.splitlines(), 1):
        new = line.partition("#")[0].split()
        if not new:
            continue
        if not words:
            first = number
        words += new
        if len(words) < 3 + len(_NUMBERS):
            continue
        here = f"{path}:{first}"
        if len(words) > 3 + len(_NUMBERS):
            raise AtcError(
                f"{here}: expected 3 elements and 11 numbers ({' '.join(_NUMBERS)}) in a Stillinger-Weber entry, found {len(words)} words"
            )
        names, words = tuple(words[:3]), words[3:]
        if all(n in elements for n in names):
            values = []
            for key, word in zip(_NUMBERS, words, strict=True):
                try:
                    values.append(float(word))
                except ValueError:
                    raise AtcError(f"{here}: {key} must be a number in a Stillinger-Weber entry, found {word!r}") from None
                if values[-1] < 0 and key != "costheta0":
                    raise AtcError(f"{here}: {key} must not be negative in a Stillinger-Weber entry, found {word}")
            if names in entries:
                raise AtcError(f"{here}: second entry for {' '.join(names)} (the first is at {entries[names].where}): remove one")
            entry = SWEntry(*values, where=here)
            entries[names] = replace(entry, epsilon=entry.epsilon * factor)
        words = []
    if words:
        raise AtcError(
            f"{path}:{first}: the last Stillinger-Weber entry has {len(words)} of 14 words (3 elements and {' '.join(_NUMBERS)}): complete it"
        )
    return entries


def units_tag(text: str) -> str | None:
    """The unit style that a parameter file names in its first line (``UNITS: metal``), or None."""
    words = text.partition("\n")[0].replace("#", " ").split()
    return words[words.index("UNITS:") + 1] if "UNITS:" in words[:-1] else None


def _conversion(text: str, wanted: str, path) -> float:
    has = units_tag(text)
    if has is None:
        return 1.0
    if has == wanted:
        return 1.0
    if (has, wanted) == ("metal", "real"):
        factor = _METAL_TO_REAL
    elif (has, wanted) == ("real", "metal"):
        factor = 1.0 / _METAL_TO_REAL
    else:
        raise AtcError(
            f"{path}: this file is in {has!r} units (its UNITS: tag) and the model in {wanted!r}: only metal and real convert into each other; "
            f"use a file in {wanted!r} units"
        )
    warnings.warn(f"{path}: energies converted from {has} to {wanted} units, as LAMMPS does", AtcWarning, stacklevel=4)
    return factor
