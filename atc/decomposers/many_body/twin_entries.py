"""Two entries of a parameter file that describe one pair of atoms, where the file rounds them differently.

LAMMPS takes one of the two by the numbering of the atoms. Where they differ by no more than published rounding, the
mean of both is as good as either, and the energy says how much it matters; where they differ by more, no number is
right for every numbering.
"""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcError, AtcWarning

# Published files round: products that are equal on paper may differ in the seventh digit, which is not worth a word.
_SAME = 1e-5
# SiC_1994.tersoff has D to five and to six digits, 6e-5 apart.
_ROUNDED = 2e-4


def both(entries, one, other) -> str:
    """Where two entries stand."""
    return f"{entries[one].where} and {entries[other].where}"


def require_alike(entries, one, other, alike: bool, what: str) -> None:
    """Raise AtcError where two entries, by their elements, differ in `what` they say."""
    if not alike:
        raise AtcError(
            f"{both(entries, one, other)}: the entries {' '.join(one)} and {' '.join(other)} give different {what}: "
            "make them equal"
        )


def agree(one, other, where: str, energy=None, unit: str = "") -> bool:
    """Whether two rows of numbers are the same but for rounding; a warning says so where it is more than the last
    digit.

    energy : function of a row, the energies of a pair (in `unit`) at distances that matter; None: the numbers are
        proportional to the energy
    where : the two entries, for the message
    """
    a, b = np.asarray(one, float), np.asarray(other, float)
    if np.allclose(a, b, rtol=_SAME, atol=0):
        return True
    if not np.allclose(a, b, rtol=_ROUNDED, atol=0):
        return False
    scale = np.maximum(np.abs(a), np.abs(b))
    apart = float(np.max(np.abs(a - b)[scale > 0] / scale[scale > 0]))
    if energy is None:
        matters = f"in LAMMPS the energy of such atoms depends on their order by up to {apart:.1e} of itself"
    else:
        u, v = energy(a), energy(b)
        most = float(np.abs(u - v).max())
        matters = (
            f"in LAMMPS the energy of such a pair depends on its numbering by up to {most:.1e} {unit}, "
            f"{most / np.abs(u).max():.1e} of the largest at such distances"
        )
    warnings.warn(f"{where} differ by {apart:.1e}: the mean of both is taken; {matters}", AtcWarning, stacklevel=5)
    return True
