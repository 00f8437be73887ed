"""Frames in, fields out: the passes over each frame, the sums of frames that share a cell, the fields formed from them,
and all of it again by tighter methods as long as an error found is larger than allowed. A frame is a group of one.

`fields_of` asks for the sums (`sum_up`: bonds, then atoms), forms the fields (`forming.form`), and compares
(`tightening.tightened`).
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

import numpy as np

from ..grids.planes import through_planes
from . import planes, tiles
from .accuracy.strongest_bonds import StrongestBonds, StrongestOfFrames, summed_exactly
from .atom_pass import add_atoms, atom_pass, gather_pass, reference_gather_pass
from .bond_pass import BondPass, bond_pass, named_bond_sums, reference_bonds
from .chosen import chosen_of
from .deposits import SQUARES
from .field_pass import FieldPass, atom_fields, finer_check, is_checked
from .forming import form
from .groups import POINTS, MeanFields, elements, joined, of_one_cell, of_parts
from .methods import DEPOSITS, NAMES
from .place import Place
from .requirements import require
from .runs import Run, RunBonds, RunSums
from .settings import FrameResult, Settings
from .summed import BOND, SITE, WHOLE, by_name
from .sums import Sums
from .tightening import SAFE, clear_thin, thin_sums, tightened, watched

#: How many times the precision of the sums may be left of a bond that was taken out of them again.
PRECISIONS_LEFT = 8.0


def fields_of(frames, settings: Settings, index: int = 0, run_tiles=None) -> FrameResult:
    """All quantities of `settings` on one frame, or the means of some consecutive frames; computed again by tighter
    methods where an error is too large.

    Parameters
    ----------
    frames : list of Frames. A cell that changes ends a sum, not the group.
    settings : Settings
    index : int
        Number of the first frame: the random points of the error check depend on nothing else.
    run_tiles : callable
        With `settings.tiles`: how tiles are computed (see `tiles.bond_pass`). Default: one after the other, here.

    Returns
    -------
    FrameResult, in the frames' own units; `methods` are those used in the end, `refined` says what was computed again
    and why. Errors are those of the means.

    Raises
    ------
    AtcError
        if a frame lacks what a quantity needs (masses, velocities), or there is no potential, kernel, grid or reference
        for it.
    """
    if settings.parts is not None and settings.part is None:
        each = [
            fields_of(frames, replace(settings, part=k), index, run_tiles) for k in range(len(settings.parts.labels))
        ]
        return of_parts(each)
    work = settings.work
    for frame in frames:
        require(frame, settings, work)
    counted, names = None, settings.names
    if through_planes(settings.grid):
        # Nothing that is counted is to be tightened; fields on no grid are computed as ever.
        own, others = (tuple(q.name for q in work.quantities if (q.kind == "grid") == on) for on in (True, False))
        chosen = chosen_of(frames[0], settings.selection, settings.bonds, settings.parts, settings.part)
        counted = planes.of_frame(
            frames[0], settings.grid, own, settings.pot, chosen, settings.threads, settings.anchor
        )
        if not others:
            return counted
        settings = replace(settings, names=others, grid=None)
        work = settings.work
    if work.bond_users:
        frames = [settings.pot.carriers(f) for f in frames]
    goal, start, several = SAFE * settings.tolerance, perf_counter(), len(frames) > 1
    if several:
        settings = replace(settings, check_points=min(settings.check_points, POINTS))
    runs = [Run.of(run, settings, work, index, goal, run_tiles) for run in of_one_cell(frames)]
    methods, refined, again = dict(settings.methods), [], set(DEPOSITS)
    known = [None] * len(runs)
    while True:
        known = [sum_up(run, methods, again, before) for run, before in zip(runs, known)]
        results = [form(run, sums) for run, sums in zip(runs, known)]
        result = joined(results) if len(runs) > 1 else results[0]
        thin = set().union(*(sums.thin for sums in known))
        tighter = tightened(work, methods, thin, result.expected if settings.check_points else {}, goal)
        if not tighter:
            break
        methods = methods | {key: method for key, (method, _) in tighter.items()}
        refined += [why.then(f"{NAMES[key]} {method}") for key, (method, why) in tighter.items()]
        # The sums of single frames of a group are not kept.
        again = set(DEPOSITS) if several else set(tighter)
    result.methods, result.refined = methods, refined
    result.seconds["total"] = perf_counter() - start
    return result if counted is None else planes.with_others(counted, result, names)


# --- sums


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
    for k, frame in enumerate(run.frames):
        factors = run.factors(k, bonds.each[k].per_atom)
        grid, check = frame_sums(run, k, bonds, here, reference, factors, again, before)
        if together is not None:
            # Velocities relative to the same drift in all frames.
            common = factors if k == 0 else run.factors(k, factors.per_atom, run.drifts[0])
            add_atoms(here.grid, together, frame, work.site, common)
        else:
            clear_thin(grid, methods)
            thin |= thin_sums(grid, work)
            if work.masked:
                mask = grid.defined if mask is None else mask | grid.defined
                anywhere = grid.anywhere if anywhere is None else anywhere | grid.anywhere
        boxes.add([q for q in work.quantities if run.several and q.kind == "box" and not q.parts], grid)
        fields.add(run.each, grid)
        exactly.add(elements(work) if run.several else [q for q in work.quantities if q.kind == "grid"], check)
    if run.several:
        size = (
            sum(one.point_sums(1, work, settings.churnless)["size"] / len(run.frames) for one in bonds.each)
            if work.bond
            else 0.0
        )
        grid, check = replace(run.no_sums(0), bond=bonds.grid, size=size), None
        if together is not None:
            grid.site.update(by_name(work.site, SITE, together.site_sums() / len(run.frames)))
            clear_thin(grid, methods)
            thin |= thin_sums(grid, work)
            mask, anywhere = (grid.defined, grid.anywhere) if work.masked else (None, None)
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
            more = {} if run.run_tiles is None else {"run": run.run_tiles}
            one = tiles.bond_pass(frame, task, to_reference, settings.tiles, **more)
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
    mean = named_bond_sums(work, total_gk / len(run.frames), settings.churnless)
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
        both = [replace(sums, **one.point_sums(at, work, settings.churnless)) for at, sums in enumerate(both)]
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
