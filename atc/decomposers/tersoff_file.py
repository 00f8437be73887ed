"""Tersoff parameter files as LAMMPS reads them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from ..errors import AtcError
from .parameter_file import LARGE, element_entries, energy_conversion, read_parameter_file

NUMBERS = ("m", "gamma", "lam3", "c", "d", "costheta0", "n", "beta", "lam2", "B", "R", "D", "lam1", "A")


@dataclass(frozen=True)
class TersoffEntry:
    """One entry ``elem1 elem2 elem3``, elem1 at the centre, elem2 the bonded atom, elem3 the one that weakens the bond:
    see `Tersoff`."""

    m: float
    gamma: float
    lam3: float
    c: float
    d: float
    costheta0: float
    n: float
    beta: float
    lam2: float
    B: float
    R: float
    D: float
    lam1: float
    A: float
    where: str = "the Tersoff parameters"

    what: ClassVar[str] = "Tersoff"
    keys: ClassVar[tuple] = NUMBERS
    signed: ClassVar[tuple] = ("costheta0", "lam3")
    energies: ClassVar[tuple] = ("A", "B")

    def check(self) -> str | None:
        """What LAMMPS would refuse, if anything."""
        for key in self.keys:
            if key not in self.signed and getattr(self, key) < 0:
                return f"{key} must not be negative, got {getattr(self, key):g}"
        if self.m not in (1.0, 3.0):
            return f"m must be 1 or 3, got {self.m:g}"
        if self.D > self.R:
            return f"D must not exceed R, got R {self.R:g} and D {self.D:g}"
        if self.d == 0 and self.c != 0:
            return "d must not be 0, the angular function divides by it"
        return None


def read_tersoff_file(path, elements, units_name: str, where: str = "", kind=TersoffEntry) -> dict:
    """{(elem1, elem2, elem3): TersoffEntry} of a LAMMPS ``.tersoff`` file for some elements, energies and lengths in
    `units_name`.

    elements : the elements in use; entries with any other are skipped, as LAMMPS does
    units_name : a ``UNITS:`` tag in the first line that differs is converted between metal and real (A and B), and
        refused otherwise
    where : file and line that named this file, for messages
    kind : the class of the entries: what its file lists, in order, and which of it are energies

    Raises
    ------
    AtcError for a missing file, a malformed, impossible or duplicate entry, or units that cannot be converted.
    """
    text = read_parameter_file(path, kind.what, where)
    factor = energy_conversion(text, units_name, path)
    entries: dict[tuple, TersoffEntry] = {}
    for here, names, values in element_entries(text, path, kind.keys, elements, kind.what):
        entry = kind(**dict(zip(kind.keys, values, strict=True)), where=here)
        odd = next((key for key, v in zip(kind.keys, values, strict=True) if not abs(v) < LARGE), None)
        if wrong := (f"{odd} must be a finite number below {LARGE:g}" if odd else entry.check()):
            raise AtcError(f"{here}: {wrong}")
        if names in entries:
            raise AtcError(
                f"{here}: second entry for {' '.join(names)} (the first is at {entries[names].where}): remove one"
            )
        entries[names] = replace(entry, **{key: getattr(entry, key) * factor for key in kind.energies})
    return entries
