"""Which distances of a frame are held: rules that name bonds, angles, pairs or whole molecules, as scripts and scenes
do."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..numbering import atoms_of_ids, pair_codes

#: Masses that ``fix shake ... m`` takes for the same, in the units of the script.
SAME_MASS = 0.1
#: Hydrogen (and deuterium, and hydrogen with mass taken from its neighbour) is lighter than this, in atomic units.
LIGHT = 4.5

#: So many bits behind that of a group of `Frame.groups` stands the one of atoms that may be in it or not.
UNSURE = 31


@dataclass(frozen=True)
class Group:
    """A group of a LAMMPS script; `bit` is its place in `Frame.groups`, -1 for all atoms."""

    name: str = "all"
    bit: int = -1

    def inside(self, frame: Frame, where: str) -> np.ndarray:
        """(n,) bool, who is in it."""
        if self.bit < 0:
            return np.ones(len(frame), bool)
        if frame.groups is None:
            raise AtcError(
                f"{where}: who is in group {self.name} is not known for {frame.source}: give atc the frames of a "
                "trajectory, with the data file that the script reads"
            )
        if not self.told(frame):
            raise AtcError(
                f"{where}: who is in group {self.name} is not known for {frame.source}: let the script read the atoms "
                "from a data file (write_data makes one)"
            )
        return (frame.groups >> self.bit) & 1 == 1

    def told(self, frame: Frame) -> bool:
        """Whether it is known who is in it."""
        if self.bit < 0:
            return True
        return frame.groups is not None and not ((frame.groups >> (self.bit + UNSURE)) & 1).any()


class Rule:
    """A rule about constraints.

    where : what said so, for messages
    contained : whether the forces that the run writes contain those of the constraints; None: to be found out
    releases : whether bonds and angles that are held have no terms of their own (LAMMPS switches them off)
    bodies : whether it moves whole bodies, see `rigid_bodies`
    """

    where: str = ""
    contained: bool | None = None
    releases: bool = True
    bodies: bool = False
    #: Whether only forces tell what the run did; see `Shake`.
    forces_only: bool = False

    def pairs(self, frame: Frame) -> np.ndarray:
        """(c, 2) atoms whose distance is held."""
        raise NotImplementedError

    def describe(self) -> str:
        raise NotImplementedError


def topology_of(frame: Frame, where: str):
    """The bonds of a frame, which must be known."""
    top = frame.topology
    if top is not None and top.untold:
        raise AtcError(top.untold)
    if top is None:
        raise AtcError(
            f"{frame.source}: {where} holds bonds, but which atoms are bonded is not known: give a LAMMPS data file "
            "with a Bonds section as topology"
        )
    for name in ("bonds", "angles"):
        atoms = getattr(top, name)
        if len(atoms) and (atoms.min() < 0 or atoms.max() >= len(frame)):
            raise AtcError(
                f"{frame.source}: the topology has {name} of atoms that are not in this frame ({len(frame)} atoms): "
                "dump all atoms"
            )
    return top


@dataclass(frozen=True)
class Shake(Rule):
    """LAMMPS's ``fix shake`` and ``fix rattle``.

    A bond is held if both ends are in the group, and its type, the type of an end or the mass of an end is listed. An
    angle is held if its type is listed, both of its bonds are held, and its three atoms hold no other bonds.

    bond_types, angle_types, atom_types : LAMMPS's; masses : internal units, `same` how far a mass may be from them
    """

    bond_types: tuple[int, ...] = ()
    angle_types: tuple[int, ...] = ()
    atom_types: tuple[int, ...] = ()
    masses: tuple[float, ...] = ()
    same: float = SAME_MASS
    group: Group = field(default_factory=Group)
    style: str = "shake"
    where: str = ""
    contained = True

    @property
    def forces_only(self) -> bool:
        """LAMMPS's RATTLE puts velocities on the constraints by forces that differ at first order in the time step from
        what these velocities say."""
        return self.style == "rattle"

    def describe(self) -> str:
        return f"fix {self.style}"

    def pairs(self, frame: Frame) -> np.ndarray:
        top = topology_of(frame, self.where or self.describe())
        i, j = top.bonds[:, 0], top.bonds[:, 1]
        inside = self.group.inside(frame, self.where)
        listed = np.isin(top.bond_types, self.bond_types)
        ends = np.isin(frame.types, self.atom_types)
        if self.masses:
            frame.require("masses", why=f"{self.where}: m of {self.describe()}")
            ends |= (np.abs(frame.masses[:, None] - np.array(self.masses)) <= self.same).any(1)
        held = (top.bond_types > 0) & inside[i] & inside[j] & (listed | ends[i] | ends[j])
        bonds = top.bonds[held]
        return np.concatenate([bonds, _thirds(top, bonds, np.isin(top.angle_types, self.angle_types), len(frame))])


def _thirds(top, bonds, listed, n) -> np.ndarray:
    """(m, 2) the outer atoms of listed angles whose two bonds are held and are all that its atoms hold."""
    if not listed.any() or not len(bonds):
        return np.zeros((0, 2), np.int64)
    number = np.bincount(bonds.ravel(), minlength=n)
    angles, code = top.angles[listed], np.unique(pair_codes(bonds, n))
    a, b, c = angles.T
    both = np.isin(pair_codes(angles[:, :2], n), code) & np.isin(pair_codes(angles[:, 1:], n), code)
    alone = (number[a] == 1) & (number[b] == 2) & (number[c] == 1)
    return np.stack([a, c], 1)[both & alone].astype(np.int64)


@dataclass(frozen=True)
class HeldPairs(Rule):
    """Given pairs of atoms, by their ids."""

    ids: tuple[tuple[int, int], ...] = ()
    where: str = ""

    def describe(self) -> str:
        return f"{len(self.ids)} pair{'s' * (len(self.ids) != 1)} of atoms"

    def pairs(self, frame: Frame) -> np.ndarray:
        ids = np.asarray(self.ids, np.int64).reshape(-1, 2)
        atoms, known = atoms_of_ids(frame, ids)
        if not known.all():
            raise AtcError(f"{self.where}: atom {ids[~known][0]} is not in {frame.source}")
        return atoms


@dataclass(frozen=True)
class HydrogenBonds(Rule):
    """Every bond of a hydrogen atom; the third side of molecules that have nothing but two such bonds (rigid water)
    with `water`."""

    water: bool = True
    where: str = ""

    #: what the scene calls it, and what it says of itself
    word = "hbonds"
    held = "bonds of hydrogen"

    def describe(self) -> str:
        return self.held + (", rigid water" if self.water else "")

    def chosen(self, top, light) -> np.ndarray:
        """(b,) bool: bonds that are held."""
        return light[top.bonds[:, 0]] | light[top.bonds[:, 1]]

    def pairs(self, frame: Frame) -> np.ndarray:
        top = topology_of(frame, self.where or self.word)
        light = hydrogen(frame, self.where or self.word)
        bonds = top.bonds[self.chosen(top, light) & (top.bond_types > 0)]
        if not self.water:
            return bonds
        return np.concatenate([bonds, _ends_of(bonds, top.bonds, light, len(frame))])


@dataclass(frozen=True)
class AllBonds(HydrogenBonds):
    """Every bond; the third side of rigid water with `water`. GROMACS's ``constraints = all-bonds``."""

    word = "allbonds"
    held = "all bonds"

    def chosen(self, top, light) -> np.ndarray:
        return np.ones(len(top.bonds), bool)


def _ends_of(bonds, every, light, n):
    """(m, 2) both ends of molecules that are a heavy atom between two light ones."""
    many = np.bincount(every.ravel(), minlength=n)
    centre = (many == 2) & (np.bincount(bonds.ravel(), minlength=n) == 2) & ~light
    both = np.concatenate([bonds, bonds[:, ::-1]])
    both = both[centre[both[:, 0]]]
    ends = both[np.argsort(both[:, 0], kind="stable"), 1].reshape(-1, 2)
    return ends[((many[ends] == 1) & light[ends]).all(1)]


def hydrogen(frame: Frame, where: str) -> np.ndarray:
    """(n,) bool: atoms that are hydrogen, by the names of their types (symbols of elements, or a force field's types),
    else by their mass. HO, HS and HE1 are types of hydrogen in AMBER and CHARMM: masses, where they are known, tell
    them from other elements."""
    names = {t: str(name) for t, name in frame.type_names.items()}
    light = None
    if frame.masses is not None and not frame.units.reduced:
        from ...units import units

        light = frame.masses <= LIGHT * units("real").mass
    if names and all(t in names for t in np.unique(frame.types)):
        of = lambda say: np.isin(frame.types, [t for t, name in names.items() if say(name)])  # noqa: E731
        if light is not None:
            out = of(lambda name: name[:1].upper() == "H" and name != "He") & light
        else:
            others = ("He", "Hf", "Hg", "Ho", "Hs")
            out = of(lambda name: name[:1].upper() == "H" and name[:2].title() not in others)
        if out.any():
            return out
    if frame.units.reduced:
        raise AtcError(
            f"{where}: which atoms are hydrogen is not known in {frame.units.name} units: name pairs or molecules "
            "instead"
        )
    frame.require("masses", why=f"{where}: which atoms are hydrogen")
    return light


@dataclass(frozen=True)
class RigidMolecules(Rule):
    """Rigid bodies: atoms of the same molecule, or groups of a script that are a body each.

    chosen : numbers of molecules, or None: all
    groups : with `one_each` every group is one body; else only atoms of the first one count
    """

    chosen: tuple[int, ...] | None = None
    group: Group = field(default_factory=Group)
    each: tuple[Group, ...] = ()
    style: str = "rigid"
    where: str = ""
    contained: bool | None = None
    releases: bool = True
    bodies = True

    def describe(self) -> str:
        return f"fix {self.style}" if self.style != "molecules" else "rigid molecules"

    def labels(self, frame: Frame) -> np.ndarray:
        """(n,) the number of each atom's body from 0, -1 for atoms in none."""
        out = np.full(len(frame), -1, np.int64)
        if self.each:
            for k, g in enumerate(self.each):
                out[g.inside(frame, self.where)] = k
            return out
        if frame.molecules is None:
            raise AtcError(
                f"{self.where}: bodies are told by molecule, but {frame.source} does not say which atom is in which: "
                "dump mol too"
            )
        inside = self.group.inside(frame, self.where)
        if self.chosen is not None:
            inside = inside & np.isin(frame.molecules, self.chosen)
        out[inside] = np.unique(frame.molecules[inside], return_inverse=True)[1]
        return out

    def pairs(self, frame: Frame) -> np.ndarray:
        return np.zeros((0, 2), np.int64)
