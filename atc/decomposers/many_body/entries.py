"""Potentials whose numbers come in entries ``elem1 elem2 elem3`` of a LAMMPS parameter file, elem1 at the centre."""

from __future__ import annotations

from dataclasses import dataclass, fields
from itertools import product
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from ...errors import AtcError
from ...units import Units
from ...units import units as system
from ..bonded.cluster import weights_of
from .elements import ElementMap, named_elements
from .neighbor_work import NeighborTerm
from .parameter_file import read_entries


@dataclass(frozen=True)
class Entry:
    """Base of entries: dataclasses of the file's numbers, in its order, and `where` it was found.

    Class variables
    ---------------
    what : the potential's name. signed : the numbers that may be negative. energies : those that are energies.
    converts : whether LAMMPS converts such files between metal and real units
    """

    what: ClassVar[str]
    signed: ClassVar[tuple] = ()
    energies: ClassVar[tuple] = ()
    converts: ClassVar[bool] = True

    @classmethod
    def keys(cls) -> tuple[str, ...]:
        """Names of the numbers, in the file's order."""
        return tuple(f.name for f in fields(cls) if f.name != "where")

    def check(self) -> str | None:
        """What LAMMPS would refuse, if anything."""
        for key in self.keys():
            value = getattr(self, key)
            if not np.isfinite(value):
                return f"{key} must be a finite number, got {value:g}"
            if value < 0 and key not in self.signed:
                return f"{key} must not be negative, got {value:g}"
        return None


class OfEntries(NeighborTerm):
    """A term of such numbers; subclasses set `style` and `entry`, and are made of entries, elements and `units`."""

    style: str
    entry: type[Entry]

    def take(self, entries: dict, elements, units: str | Units) -> tuple[dict, list[str]]:
        """The entries as `entry`, checked, and the elements in use; sets `units`, and `map` from types to elements."""
        self.units = system(units)
        entries = {tuple(k): v if isinstance(v, self.entry) else self.entry(**v) for k, v in entries.items()}
        for e in entries.values():
            if wrong := e.check():
                raise AtcError(f"{e.where}: {wrong}")
        names = [next(iter(entries))[0]] if elements is None else named_elements(elements)
        self.map = ElementMap(elements, names, f"pair_style {self.style}")
        for triple in product(names, repeat=3):
            if triple not in entries:
                raise AtcError(
                    f"{self.style}: no entry for {' '.join(triple)}: a potential needs every combination of its "
                    "elements"
                )
        return entries, names

    @classmethod
    def from_file(cls, path, elements, *, units: str | Units = "metal", where: str = "", **more):
        """From a LAMMPS parameter file, e.g. ``Tersoff.from_file("Si.tersoff", ["Si"])``.

        elements : the element of each atom type from 1, ``"NULL"`` or None leaves a type out. where : the line that
            names the file, for messages. more : what else the class takes
        """
        entries = read_entries(path, named_elements(elements), system(units).name, cls.entry, where)
        return cls.from_entries(entries, elements, units=units, **more)

    @classmethod
    def from_entries(cls, entries: dict, elements, *, units: str | Units = "metal", **more):
        """From {(elem1, elem2, elem3): `entry` or dict of its fields}, elem1 at the centre, and elements as for
        `from_file`."""
        return cls(entries, elements, units=units, **more)


class OfTriplets(OfEntries):
    """One of pairs and triplets, whose triplets' energy may be shared in more than one way."""

    partitions = MappingProxyType({"equal": "equal", "center": "center"})

    def share(self, partition):
        center = ((1.0, 0.0, 0.0), "to the atom at its center")
        w, words = weights_of(partition, 3, {"center": center, "centre": center}, self.style)
        if w[1] != w[2]:
            raise AtcError(
                f"{self.style}: the two outer atoms of a triplet are equals, so their shares must be, got {partition!r}"
            )
        self.weights = float(w[0]), float(w[1])
        self.shared = "a third to each of its atoms" if isinstance(partition, str) and partition == "equal" else words
