"""What a System of OpenMM says of its particles: masses, charges, who is excluded from whom, constraints, and the lists
of bonded terms."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...errors import AtcError
from ...frame import Cell, Frame, Topology
from ..atom_columns import KIND
from ..constraints.rules import LIGHT, Rule
from ..pairs.special_bonds import SpecialBonds

#: Lighter than any atom but hydrogen, deuterium and hydrogen with mass of its neighbour's; amu.
_HEAVY = 5.0


@dataclass
class Listed:
    """The atoms (m, K) and types (m,) of a bonded term, from a System instead of from a frame's topology."""

    atoms: np.ndarray
    types: np.ndarray

    def __call__(self, frame: Frame):
        if len(self.atoms) and self.atoms.max() >= len(frame):
            raise AtcError(
                f"{frame.source}: has {len(frame)} atoms, and the System of OpenMM has terms of particle "
                f"{int(self.atoms.max()) + 1}: all atoms are needed"
            )
        return self.atoms, self.types


def listed(term, atoms, types):
    """A bonded term with its list."""
    term.terms_of = Listed(np.ascontiguousarray(atoms, dtype=np.int32), np.ascontiguousarray(types, dtype=np.int32))
    return term


class ExcludedPairs(SpecialBonds):
    """Pairs without pair interaction: the bonds of a topology's `weighted`, not who is two or three of them apart."""

    def __init__(self):
        super().__init__((0.0, 1.0, 1.0), (0.0, 1.0, 1.0))

    def lists(self, top, n):
        from ..pairs.special_bonds import _neighbours, special_hints

        start, other = _neighbours(np.unique(np.sort(np.asarray(top.bonds, np.int64), axis=1), axis=0), n)
        other = other.astype(np.int32)
        return start, other, np.ones(len(other), np.int8), special_hints(start, other)


@dataclass(frozen=True, eq=False)
class SystemConstraints(Rule):
    """The constraints of a System. Its bonds have their terms all the same, as far as the System has them."""

    pairs_c2: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    where: str = ""
    releases = False
    #: nor do GROMACS's and AMBER's
    contained = False

    def describe(self) -> str:
        return f"{len(self.pairs_c2)} constraints of the System"

    def pairs(self, frame: Frame) -> np.ndarray:
        return self.pairs_c2


@dataclass
class Particles:
    """The `setup` of a potential from a System: completes frames of its particles.

    Attributes
    ----------
    name : what the System is called
    masses, charges : (n,) internal. kinds : (n,) rows of the pair tables, from 1
    exclusions : (m, 2) pairs without pair interaction
    periodic : whether the model is periodic
    sites : `sites.SystemSites` or None
    """

    name: str
    masses: np.ndarray
    charges: np.ndarray
    kinds: np.ndarray
    exclusions: np.ndarray
    periodic: bool
    sites: object = None
    # What a LAMMPS script would have.
    needs: frozenset = frozenset()
    groups: tuple = ()
    data_files: tuple = ()

    def __post_init__(self):
        self._last = None

    def __getstate__(self):
        return {**self.__dict__, "_last": None}

    def complete(self, frame: Frame) -> Frame:
        """The frame with what the System says of its atoms. Raises AtcError where they are others."""
        if frame.extra.get(KIND) is self.kinds:
            return frame
        n = len(self.masses)
        if len(frame) != n:
            raise AtcError(
                f"{frame.source}: has {len(frame)} atoms, {self.name} has {n} particles: give the trajectory of this "
                "system, all of it"
            )
        self._check_order(frame)
        changes = {
            "masses": self.masses,
            "charges": self.charges,
            "topology": self._topology(frame.topology),
            "extra": {**frame.extra, KIND: self.kinds},
            "given": {k: v for k, v in frame.given.items() if k not in ("masses", "charges", "topology", "boundary")},
            "cell": self._cell(frame),
        }
        frame = frame.replace(**changes)
        return frame if self.sites is None else self.sites.placed(frame)

    def _check_order(self, frame: Frame) -> None:
        """Atoms that are heavy in one and light in the other are not the same, whatever mass was moved to hydrogen."""
        if frame.masses is None or frame.given.get("masses"):
            return
        amu = self._amu
        mine, theirs = self.masses / amu, frame.masses / amu
        wrong = ((mine < LIGHT) & (theirs > _HEAVY)) | ((mine > _HEAVY) & (theirs < LIGHT))
        if wrong.any():
            k = int(np.argmax(wrong))
            raise AtcError(
                f"{frame.source}: atom {frame.ids[k]} has the mass {theirs[k]:g} there, and {mine[k]:g} in {self.name}:"
                " they are of different systems, or their atoms are in different order"
            )

    @property
    def _amu(self) -> float:
        from ...units import units

        return units("mdanalysis").mass

    def _topology(self, top):
        """A frame's own bonds, with the exclusions of the System in the place of those that follow from bonds."""
        if self._last is None or self._last[0] is not top:
            weighted = Topology(bonds=self.exclusions, bond_types=np.ones(len(self.exclusions), np.int64))
            self._last = top, replace(Topology() if top is None else top, weighted=weighted, untold="")
        return self._last[1]

    def _cell(self, frame: Frame) -> Cell:
        cell = frame.cell
        if not self.periodic:
            return Cell(cell.vectors, cell.origin, (False, False, False)) if cell.periodic.any() else cell
        if not cell.periodic.all():
            why = "has no box" if not cell.periodic.any() else "has a box that is open along some axes"
            raise AtcError(f"{frame.source}: {why}, and {self.name} is periodic along x, y and z")
        return cell

    def remarks(self) -> list[str]:
        """Where properties of atoms come from, for `Potential.describe`."""
        return [f"charges, masses and bonded terms are those of {self.name}"]
