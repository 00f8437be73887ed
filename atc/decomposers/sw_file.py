"""Stillinger-Weber parameter files as LAMMPS reads them."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..errors import AtcError
from .parameter_file import element_entries, energy_conversion, read_parameter_file

_NUMBERS = ("epsilon", "sigma", "a", "lam", "gamma", "costheta0", "A", "B", "p", "q", "tol")
_WHAT = "Stillinger-Weber"


@dataclass(frozen=True)
class SWEntry:
    """One line of a parameter file, ``elem1 elem2 elem3`` with elem1 at the centre: see `StillingerWeber` for the
    meaning of the numbers."""

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
    units_name : unit style the result is wanted in. A ``UNITS:`` tag in the file's first line that differs is converted
        between metal and
        real (energies times LAMMPS's own 23.060549), and refused otherwise. A file without tag is taken to be in
        `units_name`.
    where : file and line that named this file, for messages

    Returns
    -------
    {(elem1, elem2, elem3): SWEntry}, energies and lengths in `units_name`

    Raises
    ------
    AtcError for a missing file, a malformed, negative or duplicate entry, or units that cannot be converted.
    """
    text = read_parameter_file(path, _WHAT, where)
    factor = energy_conversion(text, units_name, path)
    entries: dict[tuple, SWEntry] = {}
    for here, names, values in element_entries(text, path, _NUMBERS, elements, _WHAT):
        for key, value in zip(_NUMBERS, values, strict=True):
            if value < 0 and key != "costheta0":
                raise AtcError(f"{here}: {key} must not be negative in a {_WHAT} entry, found {value:g}")
        if names in entries:
            raise AtcError(
                f"{here}: second entry for {' '.join(names)} (the first is at {entries[names].where}): remove one"
            )
        entry = SWEntry(*values, where=here)
        entries[names] = replace(entry, epsilon=entry.epsilon * factor)
    return entries
