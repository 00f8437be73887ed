"""Which atoms and bonds of a frame a field is of: some of the atoms, and of these one species or molecule after the
other.

A bond counts c times, by which of its ends are among the chosen atoms. Parts share what the chosen atoms have: a bond
among those of its ends that are chosen, so that the fields of all parts add up to that of the chosen atoms.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from .work import Work


@dataclass(frozen=True)
class Chosen:
    """Of one frame, or of a cluster of its atoms.

    chosen_n : (n,) bool. part_n : (n,) bool, those of the part, or None: all that are chosen
    bonds : one of `selections.BONDS`
    """

    chosen_n: np.ndarray
    part_n: np.ndarray | None = None
    bonds: str = "half"

    @property
    def own_n(self) -> np.ndarray:
        """(n,) bool: the atoms whose field it is."""
        return self.chosen_n if self.part_n is None else self.part_n

    def of(self, index) -> Chosen:
        """The same of particles that are (copies of) these atoms."""
        return Chosen(self.chosen_n[index], None if self.part_n is None else self.part_n[index], self.bonds)

    def counts(self, i, j) -> np.ndarray:
        """(b,) how often bonds between these atoms count, 0 to 1."""
        ends = self.chosen_n[i].astype(float) + self.chosen_n[j]
        c_b = {
            "half": lambda: 0.5 * ends,
            "both": lambda: (ends == 2.0).astype(float),
            "one": lambda: (ends == 1.0).astype(float),
            "any": lambda: (ends > 0.0).astype(float),
        }[self.bonds]()
        if self.part_n is not None:
            own = self.part_n[i].astype(float) + self.part_n[j]
            c_b *= np.divide(own, ends, out=np.zeros_like(own), where=ends > 0.0)
        return c_b

    def taken(self, bonds):
        """The bonds that count, and the same with all that is linear in their force as often as they count."""
        c_b = self.counts(bonds.i, bonds.j)
        k = np.flatnonzero(c_b)
        some, c_b = bonds.taken(k), c_b[k]
        if (c_b == 1.0).all():
            return some, some
        scaled = some.taken(slice(None))
        scaled.G_b = some.G_b * c_b
        if some.F_bc is not None:
            scaled.F_bc = some.F_bc * c_b[:, None]
        if some.D_bdc is not None:
            scaled.D_bdc = some.D_bdc * c_b[:, None, None]
        return some, scaled


#: Fields that say something of all atoms only, and why.
_OF_ALL = {
    "churning_divergence": "it checks the decomposition of the whole potential",
    "churning_heat_source": "the churning tensor of some bonds has a divergence of its own",
    "eshelby_stress": "the energy-momentum stress belongs to the whole body",
}


def require_choosable(work: Work, pot, parts, tiles) -> None:
    """Raise AtcError for fields that cannot be those of some atoms."""
    what = "by" if parts else "select"
    if tiles is not None:
        raise AtcError(f"{what}: fields of some atoms are not computed in tiles: leave tiles out")
    for q in work.quantities:
        if q.name in _OF_ALL:
            raise AtcError(f"{what}: {q.name} is not known of some atoms: {_OF_ALL[q.name]}: leave it out")
        if q.kind == "atom":
            raise AtcError(f"{what}: {q.name} has every atom's value already: leave it out, or pick atoms by their id")
        if q.point:
            raise AtcError(
                f"{what}: {q.name} weights all bonds around a point at once: ask for peridynamic_stress or stress"
            )
    if work.bond_users and pot is not None and pot.fields:
        raise AtcError(
            f"{what}: {', '.join(work.bond_users)}: long-range Coulomb (kspace_style) is a field of all charges, which "
            "is no sum over bonds with ends: ask for the kinetic parts, or leave the selection out"
        )
