"""special_bonds: pairs of atoms one, two or three bonds apart, whose pair interactions are weighted or left out (LAMMPS ``special_bonds``)."""

from __future__ import annotations

from ..errors import AtcError


class SpecialBonds:
    """Weights of 1-2, 1-3 and 1-4 neighbours."""

    def __init__(self, lj=(0.0, 0.0, 0.0), coul=(0.0, 0.0, 0.0), angle: bool = False, dihedral: bool = False):
        self.lj, self.coul, self.angle, self.dihedral = tuple(lj), tuple(coul), angle, dihedral

    @classmethod
    def from_lines(cls, lines) -> SpecialBonds:
        if lines:
            raise AtcError(f"{lines[0][1]}: special_bonds is not supported yet")
        return cls()

    def prepare(self, frame):
        if frame.topology is None or not len(frame.topology.bonds):
            return None
        raise AtcError(f"{frame.source}: special_bonds is not supported yet")
