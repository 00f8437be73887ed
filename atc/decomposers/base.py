"""What a decomposer is: terms that turn a frame into energies, forces and bonds, chunk by chunk, on any number of
threads."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from ..bonds import Bonds
from ..compiled import njit
from ..contracts import Interactions
from ..errors import AtcError
from ..frame import Frame
from ..neighbors.cell_list import Workspace
from ..planar import planar
from ..units import Units, require_compatible, units
from .constraints.virtual_sites import FrameWithSites, atoms_of, only_atoms

#: Words for sharing the energy of a whole potential; see `Potential.partitioned`.
PARTITIONS = ("equal", "center")
_SPELLINGS = {"centre": "center"}


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
                _add_given(bonds.i, bonds.j, bonds.F_bc, self.forces)
        elif self.forces is not None:
            self.virial += _symmetric(*_add_forces(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, self.forces))
        else:
            self.virial += _symmetric(*_virial(bonds.r_bc, bonds.G_b))


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
    #: the pair styles it sums, if it does
    styles: Sequence = ()
    #: how many atoms one of its interactions has; 0: two, or as many as its `kind` says
    bodies: int = 0
    #: "bond", "angle", "dihedral", "improper": the list of a topology that it acts on, if it does
    kind: str | None = None
    #: how far apart atoms of one interaction may be, if not `cutoff`
    reach: float = 0.0
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


class Potential(Interactions):
    """A sum of terms. Made by `atc.potential`.

    Attributes
    ----------
    terms : list of Term
    units : Units the parameters were given in (already converted)
    remarks : tuple of str, what else `describe` should say
    masses : {type: mass}, internal units, as far as LAMMPS lines (or the data file they read) say
    data_file : Path or None, the file of the script's ``read_data`` line
    dimension : 2 where the model is that of a two-dimensional run (LAMMPS's ``dimension 2``), else 3; dimension_said :
        whether the lines say so
    unmentioned : kinds of bonded terms ("bond", "angle", ...) that LAMMPS lines say nothing of, not even ``bond_style
        none``
    outside : forces on atoms from outside that the script has besides (walls, fields, friction), one text for each;
        they are no part of the stress
    atom_style : words of the script's ``atom_style``, "" if it has none
    timestep : of the script's runs (internal), None where it is not known or there is no script
    setup : what the script says of atoms, see `complete`, or None
    constraints : `Constraints`, the distances and bodies that are held, or None
    sites : `virtual_sites.VirtualSites`, points besides the atoms that forces act on, or None
    acting : `outside.OutsideForces` of the script, None where nothing says whether there are any
    moved : groups of the script that ``fix move`` moves
    unheld : whether it was said that nothing is held
    """

    unmentioned: tuple[str, ...] = ()
    moved: tuple[str, ...] = ()
    dimension_said: bool = False
    masses: Mapping[int, float] = MappingProxyType({})
    data_file = None
    remarks: tuple[str, ...] = ()
    atom_style: str = ""
    timestep: float | None = None
    sites = None
    unheld: bool = False

    def _repr_html_(self):
        """For notebooks: its terms, and how far they reach."""
        from ..terminal import html_table

        rows = [("units", self.units.name), ("cutoff", f"{self.units.to_user('length', self.cutoff):.6g}")]
        rows += [(f"term {k}", t.describe()) for k, t in enumerate(self.terms, 1)]
        return html_table("potential", rows + [("remark", r) for r in self.remarks])

    def __init__(self, terms, units_: Units | str, description: str = ""):
        self.terms = list(terms)
        self.units = units(units_)
        self.description = description
        if not self.terms:
            raise AtcError(
                "the potential has no interactions: give at least one pair_style or bonded style with its coefficients"
            )

    @property
    def pairwise(self) -> bool:
        """Whether every term is one of pairs, each half to each end."""
        return all(t.pairwise for t in self.terms)

    @property
    def churnless(self) -> bool:
        """Whether all sources of every bond are its force, F = D0 − D1, as with pairs, and with edges of atoms'
        energies: the stress is −M then, and there is no churning."""
        return all(t.pairwise or t.edges for t in self.terms)

    @property
    def cutoff(self) -> float:
        """The largest cutoff (internal length units); 0 if there are only bonded terms."""
        return max(t.cutoff for t in self.terms)

    @property
    def fields(self) -> list[Term]:
        """The terms that are no bonds but fields, given by their modes."""
        return [t for t in self.terms if t.field]

    @property
    def local(self) -> Potential:
        """What of it is bonds: itself without its fields. What sites hand on depends on all forces on them."""
        if not self.fields or self.sites is not None:
            return self
        new = copy(self)
        new.terms = [t for t in self.terms if not t.field]
        return new

    def describe(self) -> str:
        held = [x.describe() for x in (self.sites, self.constraints) if x is not None]
        return self.description or "; ".join([t.describe() for t in self.terms] + held + list(self.remarks))

    @property
    def attributes(self) -> dict[str, str]:
        """What the output says of its terms besides `describe`, see `Term.attributes`."""
        found: dict[str, list[str]] = {}
        for t in self.terms:
            for key, value in t.attributes.items():
                found.setdefault(key, []).append(str(value))
        return {key: "; ".join(dict.fromkeys(values)) for key, values in found.items()}

    @property
    def central(self) -> bool:
        """Whether all forces act along bonds: those of rigid bodies in a plane or on a line do not (see `settled`), nor
        do those of models that were learned."""
        across = self.sites is not None or (self.constraints is not None and self.constraints.across)
        return all(t.central for t in self.terms) and not across

    def held_by_topology(self, frame: Frame) -> Potential:
        """The same potential with the constraints that a frame's topology says (GROMACS's .tpr), where nothing else
        says any; see `constraint_topology`."""
        from .constraints.topology import held_by_topology

        return held_by_topology(self, frame)

    def settled(self, frame: Frame) -> Potential:
        """The same potential for a trajectory that begins with this frame, which must say what its constraints need.
        Raises AtcError where it does not."""
        pot = self.held_by_topology(frame)
        return pot if pot.constraints is None else pot.constrained(pot.constraints.settled(pot.complete(frame)))

    def as_in_file(self, frame: Frame) -> Potential:
        """The same potential with the forces that the file of a run has: without those of constraints where it has none
        of them."""
        if self.constraints is None or frame.forces is None:
            return self
        there = self.constraints.in_file()
        return self if there is self.constraints else self.constrained(there)

    def body_forces(self, frame: Frame, inner_nc) -> tuple[np.ndarray, str]:
        """Forces from outside on the atoms of a frame, and where they are from.

        Parameters
        ----------
        inner_nc : (n, 3) forces between atoms, those of constraints among them

        Returns
        -------
        (n, 3), by the laws of the script where it has all of them, else what the forces of the run have beyond those
        between atoms; and which of the two, in words

        Raises
        ------
        AtcError where neither is known.
        """
        acting = self.acting
        if acting is not None and acting.known:
            whole = self.complete(frame)
            if frame.forces is None or acting.told(whole):
                return acting.of(whole, inner_nc), f"declared: {acting.describe()}"
        if frame.forces is not None:
            named = f" ({acting.describe()})" if acting is not None else ""
            return frame.forces - inner_nc, f"measured: the forces of the run less those of the potential{named}"
        why = (
            f"the script has {', '.join(acting.others)}, whose forces are not known"
            if acting is not None
            else "nothing says which there are"
        )
        raise AtcError(f"{frame.source}: body_force: the forces from outside: {why}: dump fx fy fz too")

    def constrained(self, constraints) -> Potential:
        """The same potential with other `Constraints`, None for none, whatever a topology says."""
        new = copy(self)
        new.constraints, new.unheld = constraints, constraints is None
        return new

    def partitioned(self, partition) -> Potential:
        """The same potential with its energy shared in another way among the atoms.

        Energy, forces and stress stay what they are; per-atom energies, energy sources, and with them heat flux and
        churning, change.

        Parameters
        ----------
        partition : str or dict
            ``"equal"``: every term as it does by default, 1/K of a K-body energy to each of its atoms (bond-order
            energies half to each end of the bond, embedding energies to their own atoms). ``"center"``:
            Stillinger-Weber triplets and angles to their middle atom, torsions half to each of their two middle atoms,
            bond-order energies to the atom whose neighbours they depend on; other terms as ``"equal"``. A dict chooses
            term by term, {"sw": "center", "dihedral": (0, 0.5, 0.5, 0)}; its keys are pair styles (sw, tersoff,
            vashishta, edip ...) and angle, dihedral, improper; terms it does not name stay as they are.

        Raises
        ------
        AtcError for an unknown word, a term that is not there or has one partition only.
        """
        new = copy(self)
        if isinstance(partition, str):
            partition = _SPELLINGS.get(partition, partition)
            if partition not in PARTITIONS:
                raise AtcError(
                    f"partition {partition!r}: expected {' or '.join(map(repr, PARTITIONS))}, or a dict such as "
                    f"{{'sw': 'center'}}"
                )
            new.terms = [t.partitioned(partition, word=True) for t in self.terms]
        elif isinstance(partition, Mapping):
            names = [t.part_name for t in self.terms]
            for key in partition:
                if key not in names or not key:
                    known = ", ".join(dict.fromkeys(n for n in names if n))
                    raise AtcError(
                        f"partition: the potential has no term {key!r} whose energy could be shared in another way: "
                        f"{f'it has {known}' if known else 'none of its terms could'}"
                    )
            new.terms = [
                t.partitioned(partition[n]) if n in partition else t for t, n in zip(self.terms, names, strict=True)
            ]
        else:
            raise AtcError(
                f"partition must be {' or '.join(map(repr, PARTITIONS))}, or a dict such as {{'sw': 'center'}}, got "
                f"{partition!r}"
            )
        return new

    def complete(self, frame: Frame) -> Frame:
        """The frame with what the script says of its atoms (charges, masses, bonds ...), as far as the frame does not
        show it itself.

        Raises AtcError for what is needed and not known, and for contradictions between the script and a data file that
        was named.
        """
        if self.setup is None or isinstance(frame, FrameWithSites):
            return frame
        return self.setup.complete(frame)

    def carriers(self, frame: Frame) -> Frame:
        """The frame that the bonds' indices refer to: itself, completed, unless there are virtual sites besides its
        atoms."""
        return frame if self.sites is None else self.sites.carriers(self.complete(frame))

    def check_topology(self, frame: Frame) -> None:
        """Raise AtcError if the frame has bonded terms of a kind that LAMMPS lines do not mention: `atc.fields` leaves
        nothing out silently."""
        for kind in self.unmentioned if frame.topology is not None else ():
            count = len(getattr(frame.topology, f"{kind}s"))
            if count:
                raise AtcError(
                    f"{frame.source}: the topology has {count} {kind}s but the potential has no {kind}_style: "
                    f"add {kind}_style and {kind}_coeff lines, or '{kind}_style none' if they shall not act"
                )

    def stream(
        self,
        frame: Frame,
        consume: Callable[[Bonds, int], None] | None = None,
        *,
        threads: int = 1,
        energies: bool = False,
        forces: bool = False,
        sources: bool = False,
        kept: dict | None = None,
    ) -> Decomposition:
        """Evaluate a frame without ever holding all its bonds.

        Parameters
        ----------
        frame : Frame
        consume : called as ``consume(bonds, thread)`` for every chunk, from thread number `thread` of 0..threads−1. The
            arrays are
            reused: copy what is kept.
        energies, forces : whether to accumulate per-atom energies and forces
        sources : whether the bonds carry their directed energy sources `D_bdc`
        kept : the works of terms whose bonds can be had again; with those of an earlier call for the same frame bonds
            stream by at little cost (its energies are not what they say)

        Returns
        -------
        Decomposition with `bonds` None.

        Raises
        ------
        AtcError for types without coefficients, missing charges or topology, coincident atoms.
        """
        require_compatible(self.units, frame.units, "the potential", frame.source)
        given = frame
        frame = self.complete(frame)
        if self.dimension == 2 and frame.dimension == 3:
            frame = planar(frame)
        constraints, carriers = self.constraints, self.carriers(frame)
        whole = atoms_of(carriers)
        n = len(whole)
        frame = whole if constraints is None else constraints.released(whole)
        accs = [Accumulator(len(carriers), forces or self.needs_forces, energies, sources) for _ in range(threads)]

        def lane(term, work, stage, t):
            acc = accs[t]
            # A fixed deal of tasks to threads: sums do not depend on timing.
            for task in range(t, work.stages[stage], threads):
                bonds = work.run(stage, task, acc)
                if bonds is not None and len(bonds):
                    acc.add_bonds(bonds)
                    if sources and bonds.D_bdc is None:
                        if not term.pairwise:
                            raise NotImplementedError(f"{term.describe()}: no energy sources")
                        bonds.D_bdc = two_body_sources(bonds)
                    if consume is not None:
                        consume(bonds, t)

        pool = ThreadPoolExecutor(threads) if threads > 1 else None
        try:
            for term in self.terms:
                if hasattr(term.inner, "threads"):  # of those that deal out their work themselves
                    term.inner.threads = threads
                done = kept.get(id(term)) if kept else None
                work = done or term.prepare(carriers if term.on_sites and self.sites is not None else frame)
                for stage in range(done.again if done else 0, len(work.stages)):
                    if pool is None:
                        lane(term, work, stage, 0)
                    else:
                        # list() so that an exception in a worker is raised here.
                        list(pool.map(lambda t, e=term, w=work, s=stage: lane(e, w, s, t), range(threads)))
                if kept is not None and work.again is not None:
                    kept[id(term)] = work
        finally:
            if pool is not None:
                pool.shutdown()
        held = None
        if self.sites is not None:
            levers = carriers.levers(sum(a.forces for a in accs)[carriers.index_s], sources)
            if len(levers):
                accs[0].add_bonds(levers)
                if consume is not None:
                    consume(levers, 0)
        if constraints is not None and n:
            inner = sum(a.forces for a in accs)[:n]
            known = self.acting is not None and self.acting.laws and self.acting.told(whole)
            held = constraints.found(whole, inner, self.acting.of(whole, inner) if known else None)
            for bonds in (held.bonds, held.levers):
                if bonds is None or not len(bonds):
                    continue
                if bonds.F_bc is not None and self.central and consume is not None:
                    raise AtcError(
                        f"{frame.source}: a rigid body that lies in a plane or on a line, as none of the first frame "
                        "does"
                    )
                accs[0].add_bonds(bonds)
                if sources:
                    bonds.D_bdc = two_body_sources(bonds)  # no energy; the power of their forces
                if consume is not None:
                    consume(bonds, 0)
        notes: dict[str, int | Worst] = {}
        for a in accs:
            for k, v in a.notes.items():
                notes[k] = notes.get(k, 0) + v
        energies_n = sum(a.energies for a in accs) if energies else None
        forces_nc = sum(a.forces for a in accs) if forces else None
        if carriers is not given and self.sites is not None:
            energies_n = only_atoms(carriers, energies_n)
            forces_nc = None if forces_nc is None else forces_nc[:n]
        return Decomposition(
            energy=float(sum(a.energy for a in accs)),
            virial_cc=sum(a.virial for a in accs),
            energies_n=energies_n,
            forces_nc=forces_nc,
            n_bonds=sum(a.n_bonds for a in accs),
            notes=notes,
            held=held,
        )

    def decompose(self, frame: Frame, *, threads: int = 1, sources: bool = False) -> Decomposition:
        """Energy, per-atom energies, forces and all bonds of a frame, at once. For large frames prefer `stream`."""
        parts: list[list[Bonds]] = [[] for _ in range(threads)]
        d = self.settled(frame).stream(
            frame, lambda b, t: parts[t].append(b.copy()), threads=threads, energies=True, forces=True, sources=sources
        )
        d.bonds = Bonds.concatenate(b for p in parts for b in p)
        return d


def two_body_sources(bonds: Bonds) -> np.ndarray:
    """∂U^(i)/∂x_j = −½ G r and ∂U^(j)/∂x_i = +½ G r: half of a two-body energy belongs to each end."""
    if bonds.F_bc is not None:
        return 0.5 * np.stack([bonds.F_bc, -bonds.F_bc], axis=1)
    D = np.empty((len(bonds), 2, 3))
    _halves(bonds.r_bc, bonds.G_b, D)
    return D


@njit(cache=True, nogil=True, error_model="numpy")
def _halves(r, G, D):
    for b in range(len(G)):
        g = 0.5 * G[b]
        for c in range(3):
            D[b, 0, c] = -g * r[b, c]
            D[b, 1, c] = g * r[b, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_given(i, j, F_bc, forces):
    for b in range(len(F_bc)):
        for c in range(3):
            forces[i[b], c] += F_bc[b, c]
            forces[j[b], c] -= F_bc[b, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_forces(i, j, r, G, forces):
    """Add those of bonds; their virial."""
    xx = yy = zz = yz = xz = xy = 0.0
    for b in range(len(G)):
        g = G[b]
        x, y, z = r[b, 0], r[b, 1], r[b, 2]
        gx, gy, gz = g * x, g * y, g * z
        p, q = i[b], j[b]
        forces[p, 0] -= gx
        forces[p, 1] -= gy
        forces[p, 2] -= gz
        forces[q, 0] += gx
        forces[q, 1] += gy
        forces[q, 2] += gz
        xx += gx * x
        yy += gy * y
        zz += gz * z
        yz += gy * z
        xz += gx * z
        xy += gx * y
    return xx, yy, zz, yz, xz, xy


@njit(cache=True, nogil=True, error_model="numpy")
def _virial(r, G):
    xx = yy = zz = yz = xz = xy = 0.0
    for b in range(len(G)):
        g = G[b]
        x, y, z = r[b, 0], r[b, 1], r[b, 2]
        xx += g * x * x
        yy += g * y * y
        zz += g * z * z
        yz += g * y * z
        xz += g * x * z
        xy += g * x * y
    return xx, yy, zz, yz, xz, xy


def _symmetric(xx, yy, zz, yz, xz, xy):
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
