"""The passes over one frame, each from plain data to sums: over its bonds, over its atoms, and over atoms with the
kernel's gradient.

Every pass serves two sets of points at once, the grid and the points of the error check; what it gives comes in pairs,
(on the grid, at the points of the check). What has no bonds (the modes of long-range charges) is one more pass beside
these, in `field_pass`: its shares are added to what the bonds give.
"""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, field, fields
from functools import cached_property

import numpy as np

from ..decomposers.constraints.virtual_sites import only_atoms
from ..frame import Cell
from .accuracy.random_points import Check, checking_kernel
from .deposits import Deposits
from .kinematics import Displacement
from .peridynamic import WeightedVirials, horizon_of, node_volumes
from .registry import BOND, GATHER, SITE, Work
from .settings import Settings
from .sources import AtomFactors, AtomSums, PerAtom, ReferenceBonds, bond_factors, piola_factor
from .sums import churn_nothing
from .tile_cuts import Tile, owned


@dataclass(frozen=True)
class Place:
    """Where sums are wanted, and how they are taken: a grid, and the points of the error check in it; picklable.

    bound : BoundGrid. cell : Cell of the atoms
    kern, check_kern : kernel in internal units (None where nothing needs one), and the one that errors are measured
        with
    methods : of each deposit on the grid
    index : number of the frame, which random points depend on
    """

    bound: object
    cell: Cell
    kern: object
    check_kern: object
    methods: dict
    threads: int
    index: int
    check_points: int

    @classmethod
    def on(cls, bound, frame, kern, settings: Settings, index: int, methods, again: bool = False) -> Place:
        """The grid of a frame. `again`: the methods follow others that left too large an error, part of which may have
        been the check's own."""
        cut = not again and bound.kind != "slab" and kern is not None
        check_kern = checking_kernel(kern, methods, settings.tolerance) if cut else kern
        return cls(bound, frame.cell, kern, check_kern, methods, settings.threads, index, settings.check_points)

    @cached_property
    def grid(self) -> Deposits:
        """The deposits on the grid."""
        return Deposits(self.methods, self.bound, self.kern, self.cell, self.threads)

    @cached_property
    def check(self) -> Check:
        return Check(
            self.bound, self.kern, self.cell, self.threads, self.index, self.check_points, summed=self.check_kern
        )

    @property
    def both(self) -> tuple:
        """The deposits on the grid and at the points of the check."""
        return self.grid, self.check.deposits

    def __getstate__(self):
        return {f.name: getattr(self, f.name) for f in fields(self)}


def by_name(names, sources, total_gk) -> dict[str, np.ndarray]:
    """Sums side by side, taken apart by name."""
    ends = np.cumsum([sources[name].width for name in names])
    return dict(zip(names, np.split(total_gk, ends[:-1], axis=1), strict=True)) if names else {}


# --- over the bonds


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

    def point_sums(self, k: int, work: Work, churnless: bool) -> dict:
        """What the sums on the grid (k = 0) or at the points of the check (1) get from the bonds; sums of several
        frames are not here."""
        t, bond = self.totals, {}
        if work.bond and t.bond[k] is not None:
            bond |= named_bond_sums(work, t.bond[k][:, : work.n_bond], churnless)
        if work.reference_bond:
            bond |= by_name(work.reference_bond, BOND, t.reference_bond[k])
        size = float(t.bond[1][:, -1].max(initial=0.0)) if has_size(work) else 0.0
        return {"bond": bond, "point": t.point[k], "size": size}


def has_size(work: Work) -> bool:
    """Whether the size of the stress's terms is summed up too, at the points of the check."""
    return bool({"stress", "moment"} & {*work.bond})


def named_bond_sums(work: Work, total_gk, churnless: bool) -> dict[str, np.ndarray]:
    """The columns of `work.bond`; of forces that churn nothing, without what approximate sums leave of it."""
    bond = by_name(work.bond, BOND, total_gk)
    if churnless:
        churn_nothing(bond)
    return bond


class BondCollector:
    """What is added up while bonds stream by: all those of a frame, or of the cluster of atoms that is a tile, of which
    only the tile's own bonds count.

    Parameters
    ----------
    here, reference : Place or None, for current bonds and for those carried to the reference
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
        pot,
        work: Work,
        here: Place | None,
        reference: Place | None,
        *,
        threads: int,
        drift,
        horizon=None,
        to_reference=None,
        deposit=None,
        strongest=None,
        tile: Tile | None = None,
        check: bool = True,
        chosen=None,
    ):
        self.chosen = chosen
        self.frame, self.work, self.to_reference, self.strongest, self.tile = frame, work, to_reference, strongest, tile
        # The error check takes only the bonds near its points, and one more sum: how large the terms of the stress are.
        self.size, length = has_size(work), max(pot.cutoff, 0.0)
        self.shared, self.deposit, self.check = deposit is not None, deposit, None
        if work.bond:
            self.deposit = deposit if self.shared else here.grid.open(work.n_bond)
        if work.bond and check:
            here.check.deposits.place(frame.positions)  # before threads ask for it
            self.check = here.check.deposits.open(work.n_bond + self.size, length=length)
        self.reference_deposit = self.reference_check = None
        if work.reference_bond:
            self.reference_deposit = reference.grid.open(work.n_reference_bond, "reference_bond")
            reference.check.deposits.place(to_reference.X_nc)
            self.reference_check = reference.check.deposits.open(work.n_reference_bond, length=length)
        self.weighted = WeightedVirials(pot, threads, work, here, reference, horizon) if work.horizon_users else None
        self.atoms = AtomSums(
            frame,
            threads,
            virial=work.atom_virial,
            residual="source_residual" in work.site,
            moment=work.atom_moment,
            reference_moment="reference_atom_moment" in work.whole,
        )
        self.power = AtomSums(frame, threads, power="box_power" in work.whole)
        self.widths = [BOND[name].width for name in work.bond]
        self.peculiar_nc = frame.velocities - drift if "power" in work.bond else None
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

    def factors(self, bonds, size=False) -> np.ndarray:
        """(b, k) the factors of Σ b β."""
        return bond_factors(self.work.bond, self.widths, bonds, self.peculiar_nc, self.frame.velocities, size=size)

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
                self.deposit.add_bonds(x_nc[bonds.i], bonds.r_bc, self.factors(bonds), thread=thread)
            if self.strongest is not None:
                self.strongest.add(bonds, thread)
            for found in self.check.find(x_nc, bonds.i, bonds.r_bc, thread) if self.check is not None else ():
                self.check.add_found(found, self.factors(bonds.taken(found.bonds), self.size), thread)
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


def reference_bonds(frame, settings: Settings, work: Work) -> ReferenceBonds | None:
    """How bonds are carried to the reference configuration, if anything asked needs them there."""
    needed = work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole
    return ReferenceBonds(frame, settings.reference) if needed else None


def bond_pass(
    frame,
    settings: Settings,
    work: Work,
    here: Place | None,
    reference: Place | None,
    drift,
    deposit=None,
    strongest=None,
    check: bool = True,
    chosen=None,
    kept=None,
) -> BondPass:
    """One pass over the bonds of a frame for every sum over them. See `BondCollector`; kept : `Potential.stream`."""
    horizon = horizon_of(settings, frame.units, work.horizon_users) if work.horizon_users else None
    collector = BondCollector(
        frame, settings.pot, work, here, reference, threads=settings.threads, drift=drift, horizon=horizon,
        to_reference=reference_bonds(frame, settings, work), deposit=deposit, strongest=strongest, check=check,
        chosen=chosen,
    )  # fmt: skip
    with nullcontext() if settings.anchor is None else settings.anchor.at(frame):
        decomposition = collector.stream(settings.pot, kept)
    notes = dict(getattr(decomposition, "notes", None) or {})
    return BondPass(collector.totals(decomposition), collector.per_atom(decomposition), notes, kept)


def strongest_factors(frame, work: Work, bonds, drift) -> np.ndarray:
    """(b, k) the factors of Σ b β of a few bonds."""
    widths = [BOND[name].width for name in work.bond]
    return bond_factors(
        work.bond, widths, bonds, frame.velocities - drift if "power" in work.bond else None, frame.velocities
    )


# --- over the atoms


def site_pass(frame, work: Work, deposits: Deposits, factors: AtomFactors) -> dict[str, np.ndarray]:
    """One pass over the atoms for every sum over them, at one set of points."""
    x_nc, a_nk, some = frame.positions, factors.columns(work.site), factors.some
    return by_name(work.site, SITE, deposits.sites(x_nc[some], np.ascontiguousarray(a_nk[some])))


def squares_pass(
    frame, work: Work, deposits: Deposits, factors: AtomFactors, below: float = 0.0
) -> dict[str, np.ndarray]:
    """Σ a φ² of what is named in `Work.squares`, at one set of points; `below` as of `Deposits.squares`."""
    a_nk, some = factors.columns(work.squares), factors.some
    sums = deposits.squares(frame.positions[some], np.ascontiguousarray(a_nk[some]), below)
    return by_name(work.squares, SITE, sums)


def gather_pass(frame, settings: Settings, work: Work, place: Place, factors: AtomFactors) -> list[dict]:
    """The sums that need the kernel's gradient, or displacements: "gathered" and "gradient" of the grid and of the
    points of the check."""
    gradient = any(q.gradient for q in work.quantities if not q.on_reference)
    plain = [name for name in work.gather if name not in ("mass", "displacement")]
    extra = factors.columns(plain) if plain else np.zeros((len(frame), 0))
    displacement, m_n = None, factors.masses
    if "displacement" in work.gather:
        displacement = Displacement(frame.replace(masses=m_n), settings.reference, False)
    names = ["mass", "displacement", *plain] if displacement else ["mass", *plain]
    out = []
    for deposits in place.both:
        if displacement is not None:
            values, gradients = displacement.gather(deposits, frame.positions, m_n, extra, gradient)
        else:
            a_nk = np.concatenate([m_n[:, None], extra], axis=1)
            values, gradients = deposits.gather(frame.positions, a_nk, None, gradient)
        out.append(_gathered(names, values, gradients))
    return out


def reference_gather_pass(frame, settings: Settings, place: Place, factors: AtomFactors) -> list[dict]:
    """The same over reference positions."""
    displacement = Displacement(frame, settings.reference, True)
    energy_n1 = (factors.per_atom.energies_n - settings.reference_energies_n)[:, None]
    names = ["reference_mass", "reference_displacement", "reference_energy"]
    X_nc = settings.reference.positions
    return [
        _gathered(names, *displacement.gather(deposits, X_nc, frame.masses, energy_n1, True, "reference_gather"))
        for deposits in place.both
    ]


def _gathered(names, values, gradients) -> dict:
    return {
        "gathered": by_name(names, GATHER, values),
        "gradient": {} if gradients is None else by_name(names, GATHER, gradients),
    }


def whole_sum(name: str, frame, factors: AtomFactors, bonds: BondPass) -> np.ndarray:
    """A sum without a kernel: over the whole frame, or of each atom."""
    per_atom = bonds.per_atom
    if name == "box_virial":
        return bonds.totals.virial_cc.reshape(9)
    if name == "atom_virial":
        return only_atoms(frame, per_atom.virial_n6)
    if name in ("atom_moment", "reference_atom_moment"):
        return only_atoms(frame, per_atom.moment_n9 if name == "atom_moment" else per_atom.reference_moment_n9)
    if name == "atom_volume":
        return node_volumes(frame)
    if name == "box_power":
        return bonds.totals.power_c
    if name == "box_convection":
        return factors["energy_current"].sum(0)
    kinetic_n6 = only_atoms(frame, factors["kinetic"])
    return kinetic_n6 if name == "atom_kinetic" else kinetic_n6.sum(0)
