"""Consecutive frames with one cell: what is asked of them, and the sums that they give."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of
from .accuracy.random_points import kernel_internal
from .accuracy.strongest_bonds import StrongestBonds, StrongestOfFrames, summed_exactly
from .atom_pass import AtomFactors, add_atoms, atom_pass, drift_velocity, gather_pass, reference_gather_pass
from .bond_pass import BondPass, BondTask, bond_pass, named_bond_sums, reference_bonds
from .deposits import SQUARES
from .field_pass import FieldPass, atom_fields, finer_check, is_checked
from .groups import added_up, formed_once
from .methods import DEPOSITS
from .peridynamic import horizon_of
from .place import Place
from .quantities.quantity import Quantity
from .results import MeanFields
from .settings import Settings
from .summed import BOND, SITE, WHOLE, by_name
from .sums import Sums
from .tightening import thin_sums, watched
from .tiles import here_in_turn, tiled_bond_pass
from .work import Work

#: How many times the precision of the sums may be left of a bond that was taken out of them again.
PRECISIONS_LEFT = 8.0


@dataclass(frozen=True)
class Run:
    """Consecutive frames with one cell, and what is asked of them.

    bound, reference_bound : the grid on them, and on the reference; None where nothing asked is there
    horizon : of the quantities that need one
    drifts : (3,) mean velocity of each frame
    chosen : of each frame which atoms and bonds count (`chosen.Chosen`), or None
    together : the deposits ("site") whose sums of several frames are added up; sums over bonds always are
    once, each : the quantities formed from the mean sums, and those formed of each frame, of which the mean is taken;
        wholes may be in neither
    """

    frames: list
    settings: Settings
    work: Work
    index: int
    goal: float
    run_tiles: object
    kern: object
    bound: object
    reference_bound: object
    horizon: float | None
    drifts: list
    chosen: list
    together: frozenset
    once: list[Quantity]
    each: list[Quantity]

    @classmethod
    def of(cls, frames, settings: Settings, work: Work, index: int = 0, goal: float = np.inf, run_tiles=None) -> Run:
        first, reference = frames[0], settings.reference
        chosen = [settings.chosen(f) for f in frames]
        here, there = set(work.grid_users) - set(work.on_reference), work.on_reference
        if len(frames) == 1:
            once, each, together = work.quantities, [], frozenset()
        else:
            once, together = formed_once(work), added_up(work)
            each = [q for q in work.elements if q not in once]
        return cls(
            frames, settings, work, index, goal, run_tiles,
            kern=kernel_internal(settings.kern, first.units) if work.kernel_users else None,
            bound=_bound(settings.grid, first, settings.follow, chosen[0]) if here else None,
            reference_bound=_bound(settings.grid, reference) if there else None,
            horizon=horizon_of(settings.horizon, settings.pot, settings.grid, first.units, work.horizon_users)
            if work.horizon_users
            else None,
            drifts=[
                drift_velocity(f, None if c is None else c.chosen_n) if "velocities" in work.attributes else np.zeros(3)
                for f, c in zip(frames, chosen)
            ],
            chosen=chosen,
            together=together, once=once, each=each,
        )  # fmt: skip

    @property
    def several(self) -> bool:
        return len(self.frames) > 1

    def places(self, methods, again: bool) -> tuple[Place | None, Place | None]:
        """Where sums are wanted: now, and over reference positions."""
        s = self.settings
        on = ((self.bound, self.frames[0]), (self.reference_bound, s.reference))
        return tuple(
            None
            if bound is None
            else Place.on(bound, at.cell, self.kern, methods, s.tolerance, s.threads, self.index, s.check_points, again)
            for bound, at in on
        )

    def task(self, k: int, pot, here: Place | None, reference: Place | None) -> BondTask:
        """What is wanted of the bonds of frame `k`."""
        return BondTask(pot, self.work, here, reference, self.settings.threads, self.drifts[k], self.horizon)

    def factors(self, k: int, per_atom, drift=None) -> AtomFactors:
        """The columns of the sums over atoms of frame `k`, velocities relative to its own drift if there is no
        other."""
        drift = self.drifts[k] if drift is None else drift
        return AtomFactors(self.frames[k], drift, per_atom, self.settings.pot, self.chosen[k])

    def no_sums(self, k: int) -> Sums:
        frame = self.frames[k]
        return Sums(
            drift=self.drifts[k],
            volume=frame.cell.volume,
            boltzmann=frame.units.boltzmann,
            dimension=frame.dimension,
            velocities=self.settings.velocity,
        )


def _bound(grid, frame, follow=None, chosen=None):
    """The grid on a frame, where it has moved to."""
    frame = atoms_of(frame)
    bound = grid.bind(frame.units, frame.cell, frame.positions)
    return bound if follow is None else bound.moved(follow.shift(frame, None if chosen is None else chosen.chosen_n))


@dataclass(frozen=True)
class RunBonds:
    """What the bonds of a run give.

    each : of each frame. grid : mean sums on the grid, by name
    strongest : the strongest bonds, if they were looked for; strong_g : (g,) the largest component of what was summed
        exactly of them
    left : what rounding may have left of them, in the units of the sums
    fields : what has no bonds, already added to the sums; or None
    """

    each: tuple[BondPass, ...]
    grid: dict = field(default_factory=dict)
    strongest: StrongestOfFrames | None = None
    strong_g: np.ndarray | None = None
    left: float = 0.0
    fields: FieldPass | None = None


@dataclass(frozen=True)
class RunSums:
    """All sums of a run.

    grid, check : of its only frame, on the grid and at the points of the check; of several, the mean sums on the grid,
        and None
    exactly : fields at the points of the check; fields, boxes : means of what is formed frame by frame
    """

    here: Place | None
    reference: Place | None
    bonds: RunBonds
    grid: Sums
    check: Sums | None
    exactly: MeanFields
    fields: MeanFields
    boxes: MeanFields
    mask: np.ndarray | None
    anywhere: np.ndarray | None
    thin: set
    seconds: dict[str, float]


# --- the sums


def sum_up(run: Run, methods, again=frozenset(DEPOSITS), before: RunSums | None = None) -> RunSums:
    """The sums of the deposits in `again`; everything else is kept as it was `before`."""
    work, settings, start = run.work, run.settings, perf_counter()
    here, reference = run.places(methods, again=before is not None)
    bonds = before.bonds if before else RunBonds((BondPass(),) * len(run.frames))
    if work.bond_users and (before is None or again & {"bond", "reference_bond"}):
        watch = (
            here is not None
            and here.bound.kind != "slab"
            and settings.tiles is None
            and watched(work, methods, settings.check_points)
        )
        bonds = sum_bonds(run, here, reference, bonds, watch)
    bonds_done = perf_counter()
    together = here.grid.make("site", work.n_site, 0) if "site" in run.together and work.site else None
    exactly, fields, boxes = MeanFields(keep=True), MeanFields(), MeanFields(keep=True)
    mask, anywhere, thin, grid = None, None, set(), None

    def mark(grid):
        nonlocal mask, anywhere
        thin.update(thin_sums(grid, work, methods))
        if work.masked:
            mask = grid.defined if mask is None else mask | grid.defined
            anywhere = grid.anywhere if anywhere is None else anywhere | grid.anywhere

    for k, frame in enumerate(run.frames):
        factors = run.factors(k, bonds.each[k].per_atom)
        grid, check = frame_sums(run, k, bonds, here, reference, factors, again, before)
        if together is not None:
            # Velocities relative to the same drift in all frames.
            common = factors if k == 0 else run.factors(k, factors.per_atom, run.drifts[0])
            add_atoms(here.grid, together, frame, work.site, common)
        else:
            mark(grid)
        boxes.add([q for q in work.quantities if run.several and q.kind == "box" and not q.parts], grid)
        fields.add(run.each, grid)
        exactly.add(work.elements if run.several else [q for q in work.quantities if q.kind == "grid"], check)
    if run.several:
        size = sum(one.size(work) / len(run.frames) for one in bonds.each) if work.bond else 0.0
        grid, check = replace(run.no_sums(0), bond=bonds.grid, size=size), None
        if together is not None:
            grid.site.update(by_name(work.site, SITE, together.site_sums() / len(run.frames)))
            mark(grid)
    old = before.seconds if before else {"bonds": 0.0, "sites": 0.0}
    seconds = {"bonds": old["bonds"] + bonds_done - start, "sites": old["sites"] + perf_counter() - bonds_done}
    return RunSums(here, reference, bonds, grid, check, exactly, fields, boxes, mask, anywhere, thin, seconds)


def sum_bonds(run: Run, here: Place | None, reference: Place | None, before: RunBonds, watch: bool) -> RunBonds:
    """The bonds of all frames into one deposit; where they are to be watched, the strongest are taken out of it and
    summed exactly. Which those are, and what has no bonds, is known if it was found `before`."""
    work, settings, strongest, fields = run.work, run.settings, before.strongest, before.fields
    pot, whole = settings.pot, settings.tiles is None
    # Fields' energies and forces cost as much as their modes.
    streamed = pot if whole and (work.beyond_bonds or pot.needs_forces) else pot.local
    deposit = here.grid.open(work.n_bond) if work.bond and whole else None
    seek = watch and strongest is None
    each, found = [], []
    for k, (frame, drift) in enumerate(zip(run.frames, run.drifts)):
        task, to_reference = run.task(k, streamed, here, reference), reference_bonds(frame, settings.reference, work)
        if whole:
            found.append(StrongestBonds(frame.positions, settings.threads) if seek else None)
            finer = bool(pot.fields and work.bond and is_checked(run.index + k))
            # A frame alone is in memory anyway when it is looked around in.
            kept = {} if seek and not run.several else None
            more = {"chosen": run.chosen[k], "check": not finer, "deposit": deposit, "strongest": found[-1]}
            one = bond_pass(frame, task, to_reference, settings.anchor, kept, **more)
            if finer:
                check_gk = finer_check(streamed, frame, work, here, drift)
                one = replace(one, totals=replace(one.totals, bond=(one.totals.bond[0], check_gk)))
        else:
            one = tiled_bond_pass(frame, task, to_reference, settings.tiles, run.run_tiles or here_in_turn)
        each.append(atom_fields(pot, frame, work, one, tiled=not whole))
    if seek:
        strongest = StrongestOfFrames(run.frames, found, work.bond, run.drifts)
    if not work.bond:
        return RunBonds(tuple(each), strongest=strongest)
    exact_gk, strong_g, left = 0.0, None, 0.0
    if watch:
        exact_gk = summed_exactly(deposit, here, *strongest.exactly)
        strong_g = np.abs(exact_gk[:, : BOND[work.bond[0]].width]).max(1)
        left = PRECISIONS_LEFT * float(np.finfo(deposit.real).eps) * float(strong_g.max(initial=0.0))
    total_gk = deposit.bond_sums() + exact_gk if whole else sum(one.totals.bond[0] for one in each)
    del deposit  # its meshes are large, and so are those of fields
    if pot.fields:
        fields = fields or FieldPass(pot, run.frames, run.drifts, work.bond, here, settings.tolerance)
        total_gk = total_gk + fields.grid_gk
        each = [fields.added(k, one) for k, one in enumerate(each)]
    mean = named_bond_sums(work, total_gk / len(run.frames))
    return RunBonds(tuple(each), mean, strongest, strong_g, left, fields)


def frame_sums(
    run: Run, k: int, bonds: RunBonds, here, reference, factors, again, before: RunSums | None
) -> tuple[Sums, Sums]:
    """The sums of frame `k` on the grid, but for those that are added up over frames, and at the points of the
    check."""
    frame, work, settings, one = run.frames[k], run.work, run.settings, bonds.each[k]
    both = [run.no_sums(k), run.no_sums(k)] if before is None or run.several else [before.grid, before.check]

    def due(needed, key) -> bool:
        return bool(needed) and (before is None or key in again)

    if work.bond_users:
        both = [replace(sums, **one.point_sums(at, work)) for at, sums in enumerate(both)]
        if not run.several:
            both[0].bond.update(bonds.grid)
    both[0] = replace(both[0], whole={name: WHOLE[name].of(factors, one) for name in work.whole})
    gathered = []
    if due(work.gather, "gather"):
        gathered.append(gather_pass(frame, settings.reference, work, here, factors))
    if due(work.reference_gather, "reference_gather"):
        energies_n = settings.reference_energies_n
        gathered.append(reference_gather_pass(frame, settings.reference, energies_n, reference, factors))
    for pair in gathered:
        both = [
            replace(sums, **{kind: getattr(sums, kind) | more for kind, more in found.items()})
            for sums, found in zip(both, pair, strict=True)
        ]
    if due(work.gather, "gather") and work.site and not work.summed_site:
        both[0] = replace(both[0], site={name: both[0].gathered[name] for name in work.site})
        # The check keeps to a path of its own.
        both[1] = atom_pass(both[1], frame, work, here.check.deposits, factors)
    if due(work.summed_site, "site"):
        within = (SQUARES * settings.tolerance, 0.0)
        both = [
            sums if at == 0 and "site" in run.together else atom_pass(sums, frame, work, deposits, factors, within[at])
            for at, (sums, deposits) in enumerate(zip(both, here.both))
        ]
    return both[0], both[1]
