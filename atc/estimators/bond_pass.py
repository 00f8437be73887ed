"""The pass over the bonds of one frame, from plain data to every sum over them: on the grid, at the points of the error
check, of each atom, of the box. What has no bonds (the modes of long-range charges) is one more pass beside this one,
in `field_pass`: its shares are added to what the bonds give.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, field, fields

import numpy as np

from .peridynamic import WeightedVirials
from .place import Place
from .reference import ReferenceBonds, piola_factor
from .summed import BOND, by_name
from .sums import churn_nothing
from .tile_cuts import Tile, owned
from .work import Work


class BondFactors:
    """The factors of Σ b β for the bonds of a frame, side by side.

    names : of `summed.BOND`
    drift : what velocities in "power" are relative to
    """

    def __init__(self, names, frame, drift):
        self.names, self.velocities = names, frame.velocities
        self.widths = [BOND[name].width for name in names]
        self.peculiar_nc = frame.velocities - drift if "power" in names else None

    @property
    def width(self) -> int:
        return sum(self.widths)

    @property
    def sources(self) -> bool:
        """Whether they are made of the bonds' energy sources."""
        return any(BOND[name].sources for name in self.names)

    def of(self, bonds, size: bool = False) -> np.ndarray:
        """(b, k); |F| |r| too if `size`."""
        out = np.empty((len(bonds), self.width + size))
        if not len(bonds):  # which need not have sources either
            return out
        if size:
            r2 = np.einsum("bc,bc->b", bonds.r_bc, bonds.r_bc)
            F_bc = bonds.F_bc
            out[:, -1] = np.abs(bonds.G_b) * r2 if F_bc is None else np.sqrt(r2 * np.einsum("bc,bc->b", F_bc, F_bc))
        at = 0
        for name, width in zip(self.names, self.widths):
            BOND[name].of(self, bonds, at, out)
            at += width
        return out

    def add_near(self, deposit, x_nc, bonds, thread: int, size: bool = False) -> None:
        """Into a deposit at a few points those of the bonds that are near one."""
        for found in deposit.find(x_nc, bonds.i, bonds.r_bc, thread):
            deposit.add_found(found, self.of(bonds.taken(found.bonds), size), thread)

    def sums_near(self, deposits, pot, frame, threads: int, chosen=None, size: bool = False, **more) -> np.ndarray:
        """(h, k) at a few points the sums over the bonds of `pot` that count. more : see `Potential.stream`"""
        deposits.place(frame.positions)
        deposit = deposits.open(self.width + size, length=max(pot.cutoff, 0.0))

        def consume(bonds, thread):
            bonds = bonds if chosen is None else chosen.taken(bonds)[1]
            self.add_near(deposit, frame.positions, bonds, thread, size)

        pot.stream(frame, consume, threads=threads, **more)
        return deposit.bond_sums()


@dataclass(frozen=True)
class PerAtom:
    """What the bonds leave for each atom, where somebody asks for it: its energy, the sums of `AtomSums`, the force on
    it."""

    energies_n: np.ndarray | None = None
    virial_n6: np.ndarray | None = None
    residual_n4: np.ndarray | None = None
    moment_n9: np.ndarray | None = None
    reference_moment_n9: np.ndarray | None = None
    forces_nc: np.ndarray | None = None  # between atoms


class AtomSums:
    """Per-atom sums gathered while bonds stream by, one buffer a thread.

    virial : (n, 6) ½ Σ G r⊗r, half of each bond to each end; energy, tension positive
    residual : (n, 4) the force on each atom minus the force that follows from the energy sources, what ∇·z is made of;
        and the size of the forces
    moment, reference_moment : (n, 9) −½ Σ r⊗F, half of each bond to each end, r between current or reference positions
    power : (3,) Σ (v_j·∂U^(i)/∂x_j − v_i·∂U^(j)/∂x_i) r over all bonds, v in the frame of the simulation
    """

    def __init__(
        self, frame, threads: int, virial=False, residual=False, power=False, moment=False, reference_moment=False
    ):
        n = len(frame)
        self.velocities = frame.velocities
        self._virial = [np.zeros((n, 6)) for _ in range(threads)] if virial else None
        self._residual = [np.zeros((n, 4)) for _ in range(threads)] if residual else None
        self._power = [np.zeros(3) for _ in range(threads)] if power else None
        self._moment = [np.zeros((n, 9)) for _ in range(threads)] if moment else None
        self._reference_moment = [np.zeros((n, 9)) for _ in range(threads)] if reference_moment else None

    @property
    def wanted(self) -> bool:
        return any(x is not None for x in (self._virial, self._residual, self._power, self._moment))

    def add(self, bonds, thread: int, R_bc=None) -> None:
        from . import _numba

        if self._moment is not None:
            _numba.scatter_moment(bonds.i, bonds.j, bonds.r_bc, bonds.forces(), self._moment[thread])
        if self._reference_moment is not None:
            _numba.scatter_moment(bonds.i, bonds.j, R_bc, bonds.forces(), self._reference_moment[thread])

        if self._virial is not None:
            _numba.scatter_virial(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, self._virial[thread])
        if self._residual is not None:
            _numba.scatter_residual(bonds.i, bonds.j, bonds.forces(), bonds.D_bdc, self._residual[thread])
        if self._power is not None:
            _numba.add_power(
                bonds.i, bonds.j, bonds.r_bc, bonds.D_bdc, bonds.powers(), self.velocities, self._power[thread]
            )

    virial_n6 = property(lambda self: _total(self._virial))
    residual_n4 = property(lambda self: _total(self._residual))
    power_c = property(lambda self: _total(self._power))
    moment_n9 = property(lambda self: _total(self._moment))
    reference_moment_n9 = property(lambda self: _total(self._reference_moment))


def _total(buffers):
    """The sum of the threads' buffers, in their order."""
    return None if buffers is None else sum(buffers[1:], buffers[0])


@dataclass(frozen=True)
class BondTotals:
    """Sums over all bonds of a frame, or over those of one of its tiles; they add up.

    bond, reference_bond : (g, k) on the grid and at the points of the check, the columns of `Work.bond` (and the size
        of the terms, at the points of the
        check) and `Work.reference_bond`; None where there are none, or where a deposit of several frames has them
    point : the weighted virials at both, by name
    virial_cc : (3, 3). power_c : (3,) see `AtomSums`
    """

    bond: tuple = (None, None)
    reference_bond: tuple = (None, None)
    point: tuple[dict, dict] = ({}, {})
    virial_cc: np.ndarray | None = None
    power_c: np.ndarray | None = None

    def __add__(self, other: BondTotals) -> BondTotals:
        def plus(a, b):
            if isinstance(a, tuple):
                return tuple(plus(x, y) for x, y in zip(a, b, strict=True))
            if isinstance(a, dict):
                return {name: a[name] + b[name] for name in a}
            return None if a is None else a + b

        return BondTotals(*(plus(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)))


@dataclass(frozen=True)
class BondPass:
    """What the bonds of one frame give: their sums, those of each atom, and what there is to note.

    kept : what gives them again (see `Potential.stream`), if it was asked for
    """

    totals: BondTotals = field(default_factory=BondTotals)
    per_atom: PerAtom = field(default_factory=PerAtom)
    notes: dict[str, int] = field(default_factory=dict)
    kept: dict | None = None

    def point_sums(self, k: int, work: Work) -> dict:
        """What the sums on the grid (k = 0) or at the points of the check (1) get from the bonds; sums of several
        frames are not here."""
        t, bond = self.totals, {}
        if work.bond and t.bond[k] is not None:
            bond |= named_bond_sums(work, t.bond[k][:, : work.n_bond])
        if work.reference_bond:
            bond |= by_name(work.reference_bond, BOND, t.reference_bond[k])
        return {"bond": bond, "point": t.point[k], "size": self.size(work)}

    def size(self, work: Work) -> float:
        """How large the terms of the stress are, at the points of the check."""
        return float(self.totals.bond[1][:, -1].max(initial=0.0)) if work.sized else 0.0


def named_bond_sums(work: Work, total_gk) -> dict[str, np.ndarray]:
    """The columns of `work.bond`; of forces that churn nothing, without what approximate sums leave of it."""
    bond = by_name(work.bond, BOND, total_gk)
    if work.churnless:
        churn_nothing(bond)
    return bond


@dataclass(frozen=True)
class BondTask:
    """What is wanted of the bonds of a frame, or of its tiles; picklable.

    here, reference : where sums over current bonds are wanted, and over those carried to the reference; or None
    drift : (3,) what velocities are relative to
    horizon : of the quantities that need one, or None
    """

    pot: object
    work: Work
    here: Place | None
    reference: Place | None
    threads: int
    drift: np.ndarray
    horizon: float | None = None


class BondCollector:
    """What is added up while bonds stream by: all those of a frame, or of the cluster of atoms that is a tile, of which
    only the tile's own bonds count.

    Parameters
    ----------
    to_reference : ReferenceBonds or None
    deposit : on the grid, if it is one of several frames: its sums are not taken here
    strongest : StrongestBonds that are told of every bond, or None
    tile : Tile or None
    check : whether sums at the points of the check are taken here
    chosen : `chosen.Chosen`, which of the bonds count, or None
    """

    def __init__(
        self,
        frame,
        task: BondTask,
        to_reference=None,
        *,
        deposit=None,
        strongest=None,
        tile: Tile | None = None,
        check: bool = True,
        chosen=None,
    ):
        pot, work, threads, here, reference = task.pot, task.work, task.threads, task.here, task.reference
        self.chosen = chosen
        self.frame, self.work, self.to_reference, self.strongest, self.tile = frame, work, to_reference, strongest, tile
        # The error check takes only the bonds near its points, and one more sum: how large the terms of the stress are.
        length = max(pot.cutoff, 0.0)
        self.shared, self.deposit, self.check = deposit is not None, deposit, None
        self.factors = BondFactors(work.bond, frame, task.drift)
        if work.bond:
            self.deposit = deposit if self.shared else here.grid.open(work.n_bond)
        if work.bond and check:
            here.check.deposits.place(frame.positions)  # before threads ask for it
            self.check = here.check.deposits.open(work.n_bond + work.sized, length=length)
        self.reference_deposit = self.reference_check = None
        if work.reference_bond:
            self.reference_deposit = reference.grid.open(work.n_reference_bond, "reference_bond")
            reference.check.deposits.place(to_reference.X_nc)
            self.reference_check = reference.check.deposits.open(work.n_reference_bond, length=length)
        self.weighted = (
            WeightedVirials(pot, threads, work, here, reference, task.horizon) if work.horizon_users else None
        )
        self.atoms = AtomSums(
            frame,
            threads,
            virial=work.atom_virial,
            residual="source_residual" in work.site,
            moment=work.atom_moment,
            reference_moment="reference_atom_moment" in work.whole,
        )
        self.power = AtomSums(frame, threads, power="box_power" in work.whole)
        self._virials = [np.zeros((3, 3)) for _ in range(threads)]  # of a tile's own bonds

    @property
    def wanted(self) -> bool:
        """Whether anybody asks for single bonds."""
        found = (self.deposit, self.to_reference, self.weighted, self.tile, self.chosen)
        return any(x is not None for x in found) or self.atoms.wanted or self.power.wanted

    @property
    def own_virial(self) -> bool:
        """Whether not all bonds that stream by count."""
        return self.tile is not None or self.chosen is not None

    def consume(self, bonds, thread: int) -> None:
        x_nc, X_bc, R_bc = self.frame.positions, None, None
        scaled = bonds
        if self.chosen is not None:
            bonds, scaled = self.chosen.taken(bonds)
            if not len(bonds):
                return
        if self.to_reference is not None:
            X_bc, R_bc = self.to_reference.bonds(bonds)
        # Atoms of a tile have all their bonds here, whoever owns these; atoms that are chosen all their halves.
        self.atoms.add(bonds, thread, R_bc)
        bonds = scaled
        if self.tile is not None:
            k = owned(bonds.i, bonds.j, self.tile.index_p, self.tile.own_p, self.tile.image_pc)
            bonds = bonds.taken(k)
            if not len(bonds):
                return
            if R_bc is not None:
                X_bc, R_bc = X_bc[k], R_bc[k]
        if self.own_virial:
            self._virials[thread] += bonds.virial()
        self.power.add(bonds, thread)
        if self.work.bond:
            if self.work.bond == ["stress"]:
                self.deposit.add_bond_stress(x_nc, bonds.i, bonds.r_bc, bonds.G_b, thread=thread, j_b=bonds.j)
            else:
                self.deposit.add_bonds(x_nc[bonds.i], bonds.r_bc, self.factors.of(bonds), thread=thread)
            if self.strongest is not None:
                self.strongest.add(bonds, thread)
            if self.check is not None:
                self.factors.add_near(self.check, x_nc, bonds, thread, self.work.sized)
        if self.work.reference_bond:
            P_b9 = piola_factor(bonds, R_bc)
            self.reference_deposit.add_bonds(X_bc, R_bc, P_b9, thread=thread)
            for found in self.reference_check.find(self.to_reference.X_nc, bonds.i, R_bc, thread):
                self.reference_check.add_found(found, P_b9[found.bonds], thread)
        if self.weighted is not None:
            self.weighted.add(x_nc, bonds, X_bc, R_bc, thread)

    def stream(self, pot, kept=None):
        """Send all bonds of `pot` by; returns its own word on the frame."""
        # Potentials of other makers need not know about sources as long as nobody asks for them.
        more = {"sources": True} if self.work.source_users else {}
        if kept is not None and pot.terms:
            more["kept"] = kept
        return pot.stream(
            self.frame,
            self.consume if self.wanted else None,
            threads=len(self._virials),
            energies=bool(self.work.energy_users),
            forces=bool(self.work.force_users),
            **more,
        )

    def totals(self, decomposition) -> BondTotals:
        bond = reference_bond = (None, None)
        if self.work.bond:
            checked = None if self.check is None else self.check.bond_sums()
            bond = None if self.shared else self.deposit.bond_sums(), checked
        if self.work.reference_bond:
            reference_bond = self.reference_deposit.bond_sums(), self.reference_check.bond_sums()
        point = ({}, {}) if self.weighted is None else (self.weighted.sums(0), self.weighted.sums(1))
        virial_cc = sum(self._virials) if self.own_virial else decomposition.virial_cc
        return BondTotals(bond, reference_bond, point, virial_cc, self.power.power_c)

    def per_atom(self, decomposition) -> PerAtom:
        a = self.atoms
        energies = decomposition.energies_n if self.work.energy_users else None
        forces = decomposition.forces_nc if self.work.force_users else None
        return PerAtom(energies, a.virial_n6, a.residual_n4, a.moment_n9, a.reference_moment_n9, forces)


def reference_bonds(frame, reference, work: Work) -> ReferenceBonds | None:
    """How bonds are carried to the reference configuration, if anything asked needs them there."""
    needed = work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole
    return ReferenceBonds(frame, reference) if needed else None


def bond_pass(frame, task: BondTask, to_reference=None, anchor=None, kept=None, **more) -> BondPass:
    """One pass over the bonds of a frame for every sum over them.

    Parameters
    ----------
    anchor : a list of neighbours kept for many frames, see `atc.neighbors.verlet`; or None
    kept : see `Potential.stream`
    more : see `BondCollector`
    """
    collector = BondCollector(frame, task, to_reference, **more)
    with nullcontext() if anchor is None else anchor.at(frame):
        decomposition = collector.stream(task.pot, kept)
    notes = dict(decomposition.notes)
    return BondPass(collector.totals(decomposition), collector.per_atom(decomposition), notes, kept)
