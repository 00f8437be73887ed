"""What a decomposer is: terms that turn a frame into energies, forces and bonds, cut into tasks for any number of
threads."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ..bonds import Bonds
from ..errors import AtcError
from ..frame import Frame
from ..neighbors.cell_list import Workspace
from ..units import Units
from .bond_sums import add_given, virial_of


class Worst(float):
    """A measured error among counts: where counts of frames and threads add up, the largest of these is kept. It
    becomes an attribute of the output, of the name it is noted by."""

    def __add__(self, other):
        # NaN must not be lost.
        return Worst(other) if other != other or other > self else self

    __radd__ = __add__


@dataclass
class Decomposition:
    """What a potential says about one frame, in internal units.

    energy : float. energies_n : (n,) or None, the atoms' shares U^(j) (each K-body term 1/K, unless
        `Potential.describe` says otherwise).
    forces_nc : (n, 3) or None.
    virial_cc : (3, 3) Σ G r⊗r (tension positive; divide by the volume for the potential part of the virial stress).
    bonds : Bonds or None when they were streamed. n_bonds : how many there were.
    notes : counts of guarded singularities and the like, e.g. {"angles clamped near 0 or 180 degrees": 3}, and
        measures of how good something is, `Worst`, e.g. {"energy_identity": Worst(3e-15)}
    held : `constraints.Found`, the forces of constraints and how they were found, or None
    """

    energy: float
    virial_cc: np.ndarray
    energies_n: np.ndarray | None = None
    forces_nc: np.ndarray | None = None
    bonds: Bonds | None = None
    n_bonds: int = 0
    notes: dict = field(default_factory=dict)
    held: object = None


class Accumulator:
    """One thread's running sums and buffers. `forces` and `energies` are None when nobody asked for them; `sources`
    says whether terms must give their bonds' directed energy sources (`Bonds.D_bdc`)."""

    def __init__(self, n: int, forces: bool, energies: bool, sources: bool = False):
        self.sources = sources
        self.energy = 0.0
        self.virial = np.zeros((3, 3))
        self.forces = np.zeros((n, 3)) if forces else None
        self.energies = np.zeros(n) if energies else None
        self.n_bonds = 0
        self.notes: dict[str, int | Worst] = {}
        self.ws = Workspace()

    def note(self, what: str, count: int) -> None:
        if count:
            self.notes[what] = self.notes.get(what, 0) + int(count)

    def measured(self, what: str, error: float) -> None:
        """A measured error, by the name of the output's attribute that tells the largest of them."""
        self.notes[what] = self.notes.get(what, 0) + Worst(error)

    def add_bonds(self, bonds: Bonds) -> None:
        """Add a chunk's forces and virial. Every term's forces follow from its bonds, so this is the only place that
        forms them."""
        self.n_bonds += len(bonds)
        if bonds.F_bc is not None:
            self.virial += bonds.virial()
            if self.forces is not None:
                add_given(bonds.i, bonds.j, bonds.F_bc, self.forces)
        else:
            self.virial += virial_of(bonds.r_bc, bonds.G_b, bonds.i, bonds.j, self.forces)


class Term:
    """A group of interactions evaluated together (all pair styles; all angles; Stillinger-Weber ...).

    Subclasses set `cutoff` (internal length; 0 for bonded terms) and implement `prepare`. A term whose every bond is a
    two-body term of its own, shared half to each end, sets `pairwise`: its energy sources follow from G. Any other term
    fills `Bonds.D_bdc` itself when `acc.sources`.

    Terms that can share their energy among their atoms in more than one way set `part_name` (which ``partition={...}``
    of `atc.potential` calls them by), `partitions` (what the words ``equal`` and ``center`` mean for them) and
    implement `share`.
    """

    cutoff: float = 0.0
    pairwise: bool = False
    #: whether it has no bonds but a field given by its modes, see `long_range`
    field: bool = False
    #: whether its forces act along bonds; if not, its bonds have `Bonds.F_bc`
    central: bool = True
    #: whether every bond's force is what its own sources leave, F = D0 − D1
    edges: bool = False
    #: In cutoffs, how far away an atom may be and still change a bond of an atom, if the term is not pairwise.
    depth: float = 2.0
    part_name: str = ""
    partitions: Mapping[str, str] = MappingProxyType({})
    #: of its numbers, where it was made of some
    units: Units | None = None
    #: the pair styles it sums, if it does
    styles: Sequence = ()
    #: how many atoms one of its interactions has; above two, of a term with a cutoff: it goes through triplets
    bodies: int = 2
    #: how often it goes through the pairs within its cutoff: twice where it needs sums over an atom's neighbours first
    sweeps: int = 1
    #: "bond", "angle", "dihedral", "improper": the list of a topology that it acts on, if it does
    kind: str | None = None
    #: what else the output's attributes say of it besides `describe`; of learned models: energy_path, precision,
    #: energy_reference, and energy_identity where it holds by construction (else it is measured, see
    #: `Accumulator.measured`)
    attributes: Mapping[str, str] = MappingProxyType({})
    #: weights of pairs that are bonded, see `special_bonds`
    special = None
    #: masses that its file gives types, as LAMMPS takes them: the line that named it, and {types: mass}
    file_masses: tuple[str, Mapping[str, float]] = ("", MappingProxyType({}))
    #: whether it needs the charges of the atoms
    needs_charges: bool = False
    #: whether it takes no weights of special_bonds, and none are missed
    unweighted: bool = False
    #: whether it acts on virtual sites, see `virtual_sites`
    on_sites: bool = False

    @property
    def inner(self) -> Term:
        """The term itself, out of those that stand for it."""
        return self

    def with_masses(self, names, masses, where: str):
        """The same, with what its file says of the masses of elements, which its `map` gives types. where : the line
        that named it"""
        self.file_masses = self.map.masses(names, masses, where)
        return self

    @property
    def listed(self) -> bool:
        """Whether its atoms stand in a list instead of being found around each other."""
        return not self.cutoff > 0

    def terms_of(self, frame: Frame) -> tuple[np.ndarray, np.ndarray] | None:
        """(m, bodies) int32 atoms and (m,) int32 types of what is listed; None: it does not say."""
        return None

    def covering(self, top: int) -> Term:
        """The term that acts in a frame whose types go up to `top`."""
        return self

    def prepare(self, frame: Frame) -> Work:
        """Check the frame (types, charges, topology), and cut its evaluation into tasks."""
        raise NotImplementedError

    def describe(self) -> str:
        """One line for the output's `decomposition` attribute."""
        raise NotImplementedError

    def leaves(self, frame: Frame) -> list[Term]:
        """The terms that this one stands for on a frame, itself unless it does nothing of its own."""
        return [self]

    def share(self, partition) -> None:
        """From now on share the energy like this. Raises AtcError for a partition that the term does not know."""
        raise AtcError(f"partition: {self.describe().split(',')[0]} shares its energy in one way only: leave it out")

    def partitioned(self, partition, word: bool = False) -> Term:
        """The same term with another partition of its energy. With `word` it is one for a whole potential, which terms
        that do not know it ignore."""
        if word:
            if partition not in self.partitions:
                return self
            partition = self.partitions[partition]
        new = copy(self)
        new.share(partition)
        return new

    def use_threads(self, count: int) -> None:
        """How many threads a term may use that deals out its work itself; tasks of others are dealt to as many."""


class Wrapper(Term):
    """A term that stands for another one, `term`."""

    term: Term

    @property
    def inner(self) -> Term:
        return self.term.inner

    central, edges, pairwise, depth, attributes, part_name = (
        property(lambda self, name=name: getattr(self.term, name))
        for name in ("central", "edges", "pairwise", "depth", "attributes", "part_name")
    )

    def describe(self) -> str:
        return self.term.describe()

    def leaves(self, frame: Frame) -> list[Term]:
        return self.term.leaves(frame)

    def partitioned(self, partition, word: bool = False) -> Term:
        new = copy(self)
        new.term = self.term.partitioned(partition, word)
        return new


class Work:
    """One term on one frame. `stages` is a list of task counts: all tasks of a stage finish before the next stage
    starts.

    Tasks of a stage run in any order and on any thread; what they share they must only read, apart from slots that are
    theirs. A stage of one task may change the counts of the stages behind it.
    """

    stages: tuple[int, ...] = (0,)
    #: the stage from which a work that is done gives its bonds again, without what was dear about them; None: it cannot
    again: int | None = None

    def run(self, stage: int, task: int, acc: Accumulator) -> Bonds | None:
        """Do one task: add its energy (and shares) to `acc`, return its bonds (views into `acc.ws` are fine) for
        forces, virial and deposit."""
        raise NotImplementedError
