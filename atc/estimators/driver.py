"""Frames in, fields out: the passes over each frame, the sums of frames that share a cell, the fields formed from them,
and all of it again by tighter methods as long as an error found is larger than allowed. A frame is a group of one.

`fields_of` asks for the sums (`sum_up`: bonds, then atoms), forms the fields (`form`), and compares
(`tightening.tightened`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of
from ..grids.curved import in_local_axes
from ..grids.planes import through_planes
from . import passes, planes, tiles
from .accuracy.random_points import ZERO, extent_of, kernel_internal, ratio, without_nan
from .accuracy.strongest_bonds import PointsAround, StrongestBonds, StrongestOfFrames, error_of, summed_exactly
from .chosen import chosen_of
from .deposits import SQUARES
from .field_pass import FieldPass, atom_fields, finer_check, is_checked
from .groups import POINTS, MeanFields, added_up, elements, formed_once, joined, of_one_cell, of_parts
from .methods import DEPOSITS, NAMES
from .passes import BondPass, Place, named_bond_sums
from .registry import BOND, SITE, Quantity, Work
from .requirements import require
from .settings import FrameResult, Settings
from .shifts import local_shifts
from .sources import AtomFactors, OfAll, drift_velocity
from .sums import Sums
from .tightening import SAFE, checkable, clear_thin, thin_sums, tightened, watched

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
    if through_planes(settings.grid):
        return planes.of_frame(frames, settings, index, fields_of)
    more = {"parts": settings.part is not None, "velocity": settings.velocity, "churnless": settings.churnless}
    work = Work.of(settings.names, settings.central, **more)
    for frame in frames:
        require(frame, settings, work)
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
    return result


@dataclass(frozen=True)
class Run:
    """Consecutive frames with one cell, and what is asked of them.

    bound, reference_bound : the grid on them, and on the reference; None where nothing asked is there
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
    drifts: list
    chosen: list
    together: frozenset
    once: list[Quantity]
    each: list[Quantity]

    @classmethod
    def of(cls, frames, settings: Settings, work: Work, index: int = 0, goal: float = np.inf, run_tiles=None) -> Run:
        first, reference = frames[0], settings.reference
        chosen = [chosen_of(f, settings) for f in frames]
        here, there = set(work.grid_users) - set(work.on_reference), work.on_reference
        if len(frames) == 1:
            once, each, together = work.quantities, [], frozenset()
        else:
            once, together = formed_once(work), added_up(work)
            each = [q for q in elements(work) if q not in once]
        return cls(
            frames, settings, work, index, goal, run_tiles,
            kern=kernel_internal(settings.kern, first.units) if work.kernel_users else None,
            bound=_bound(settings, first, chosen[0]) if here else None,
            reference_bound=settings.grid.bind(reference.units, reference.cell, reference.positions) if there else None,
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
        on = ((self.bound, self.frames[0]), (self.reference_bound, self.settings.reference))
        return tuple(
            None if bound is None else Place.on(bound, at, self.kern, self.settings, self.index, methods, again)
            for bound, at in on
        )

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


def _bound(settings: Settings, frame, chosen):
    """The grid on a frame, where it has moved to."""
    frame = atoms_of(frame)
    bound = settings.grid.bind(frame.units, frame.cell, frame.positions)
    if settings.follow is None:
        return bound
    return bound.moved(settings.follow.shift(frame, None if chosen is None else chosen.chosen_n))


# --- sums


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
    around : (PointsAround, fields there): what is looked at around the strongest bonds, if that was done already
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
    around: tuple | None
    seconds: dict[str, float]


def sum_up(run: Run, methods, again=frozenset(DEPOSITS), before: RunSums | None = None) -> RunSums:
    """The sums of the deposits in `again`; everything else is kept as it was `before`."""
    work, settings, start = run.work, run.settings, perf_counter()
    here, reference = run.places(methods, again=before is not None)
    bonds, around = (before.bonds, before.around) if before else (RunBonds((BondPass(),) * len(run.frames)), None)
    if work.bond_users and (before is None or again & {"bond", "reference_bond"}):
        watch = (
            here is not None
            and here.bound.kind != "slab"
            and settings.tiles is None
            and watched(work, settings, methods)
        )
        bonds = sum_bonds(run, here, reference, bonds, watch)
        around = look_around(run, here, bonds) if watch and not run.several else None
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
            x_nc, a_nk, some = here.grid.place(frame.positions), common.columns(work.site), common.some
            here.grid.add_sites(together, x_nc[some], np.ascontiguousarray(a_nk[some]))
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
            grid.site.update(passes.by_name(work.site, SITE, together.site_sums() / len(run.frames)))
            clear_thin(grid, methods)
            thin |= thin_sums(grid, work)
            mask, anywhere = (grid.defined, grid.anywhere) if work.masked else (None, None)
    old = before.seconds if before else {"bonds": 0.0, "sites": 0.0}
    seconds = {"bonds": old["bonds"] + bonds_done - start, "sites": old["sites"] + perf_counter() - bonds_done}
    return RunSums(here, reference, bonds, grid, check, exactly, fields, boxes, mask, anywhere, thin, around, seconds)


def sum_bonds(run: Run, here: Place | None, reference: Place | None, before: RunBonds, watch: bool) -> RunBonds:
    """The bonds of all frames into one deposit; where they are to be watched, the strongest are taken out of it and
    summed exactly. Which those are, and what has no bonds, is known if it was found `before`."""
    work, settings, strongest, fields = run.work, run.settings, before.strongest, before.fields
    whole = settings.tiles is None
    bonds_alone = replace(settings, pot=settings.pot.local)
    # Fields' energies and forces cost as much as their modes.
    of_bonds = settings if work.beyond_bonds or settings.pot.needs_forces else bonds_alone
    deposit = here.grid.open(work.n_bond) if work.bond and whole else None
    seek = watch and strongest is None
    each, found = [], []
    for frame, drift, chosen in zip(run.frames, run.drifts, run.chosen):
        if whole:
            found.append(StrongestBonds(frame.positions, settings.threads) if seek else None)
            finer = bool(settings.pot.fields and work.bond and is_checked(run.index + len(each)))
            # A frame alone is in memory anyway when it is looked around in.
            kept = {} if seek and not run.several else None
            more = {"chosen": chosen, "check": not finer, "kept": kept}
            one = passes.bond_pass(frame, of_bonds, work, here, reference, drift, deposit, found[-1], **more)
            if finer:
                check_gk = finer_check(frame, of_bonds, work, here, drift)
                one = replace(one, totals=replace(one.totals, bond=(one.totals.bond[0], check_gk)))
        else:
            more = {} if run.run_tiles is None else {"run": run.run_tiles}
            one = tiles.bond_pass(frame, bonds_alone, work, here, reference, drift, **more)
        each.append(atom_fields(settings.pot, frame, work, one, tiled=not whole))
    if seek:
        factors = [passes.strongest_factors(f, work, s.ranked(), v) for f, s, v in zip(run.frames, found, run.drifts)]
        strongest = StrongestOfFrames(run.frames, found, factors)
    if not work.bond:
        return RunBonds(tuple(each), strongest=strongest)
    exact_gk, strong_g, left = 0.0, None, 0.0
    if watch:
        exact_gk = summed_exactly(deposit, here, *strongest.exactly)
        strong_g = np.abs(exact_gk[:, : BOND[work.bond[0]].width]).max(1)
        left = PRECISIONS_LEFT * float(np.finfo(deposit.real).eps) * float(strong_g.max(initial=0.0))
    total_gk = deposit.bond_sums() + exact_gk if whole else sum(one.totals.bond[0] for one in each)
    del deposit  # its meshes are large, and so are those of fields
    if settings.pot.fields:
        fields = fields or FieldPass(run.frames, run.drifts, settings, work, here)
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
    kept = (run.no_sums(k), run.no_sums(k)) if before is None or run.several else (before.grid, before.check)
    new: list[dict] = [{}, {}]

    def due(needed, key) -> bool:
        return bool(needed) and (before is None or key in again)

    if work.bond_users:
        for at in (0, 1):
            new[at] |= one.point_sums(at, work, settings.churnless)
        if not run.several:
            new[0]["bond"] |= bonds.grid
    sites = due(work.summed_site, "site")
    if sites:
        for at, deposits in enumerate(here.both):
            if at == 1 or "site" not in run.together:
                new[at] |= {
                    "site": passes.site_pass(frame, work, deposits, factors),
                    "thermal_shifted": None,
                    "kinetic_flux_shifted": None,
                    "thermal_all_shifted": None,
                }
                if work.squares:
                    # They say by how much thermal motion is corrected: a share 1/N = Σ φ²/n² of it, n the number
                    # density.
                    least = Sums(new[at]["site"]).all_number.min(initial=np.inf)
                    below = SQUARES * settings.tolerance * least if at == 0 else 0.0
                    new[at]["squared"] = passes.squares_pass(frame, work, deposits, factors, below)
    for key, needed, one_pass in (
        ("gather", work.gather, lambda: passes.gather_pass(frame, settings, work, here, factors)),
        (
            "reference_gather",
            work.reference_gather,
            lambda: passes.reference_gather_pass(frame, settings, reference, factors),
        ),
    ):
        if due(needed, key):
            for at, found in enumerate(one_pass()):
                for kind, sums in found.items():
                    new[at][kind] = {**getattr(kept[at], kind), **new[at].get(kind, {}), **sums}
    if due(work.gather, "gather") and work.site and not work.summed_site:
        new[0]["site"] = {name: new[0]["gathered"][name] for name in work.site}
        # The check keeps to a path of its own.
        new[1]["site"] = passes.site_pass(frame, work, here.check.deposits, factors)
    new[0]["whole"] = {name: passes.whole_sum(name, frame, factors, one) for name in work.whole}
    grid, check = (replace(old, **more) for old, more in zip(kept, new))
    if sites:
        for sums, deposits in zip((grid, check), here.both):
            shift(run, sums, deposits, frame, factors)
            if work.squares and sums.squared:
                sums.count_freedom()
    return grid, check


def shift(run: Run, sums: Sums, deposits, frame, factors) -> None:
    """See `shifts.local_shifts`."""
    site = run.work.site
    if "kinetic" in site and "momentum" in site:
        found = local_shifts(sums, deposits, frame.positions, factors, flux="kinetic_flux" in site)
        sums.thermal_shifted, sums.kinetic_flux_shifted = found
        if "all_kinetic" in site:
            all_of_them = OfAll(factors)
            sums.thermal_all_shifted = local_shifts(sums.of_all, deposits, frame.positions, all_of_them)[0]


# --- fields


def form(run: Run, sums: RunSums) -> FrameResult:
    """The fields, and which errors are to be expected."""
    work, units, n = run.work, run.frames[0].units, len(run.frames)
    values = {q.name: q.form(sums.grid) for q in run.once} | {q.name: sums.fields.mean(q.name) for q in run.each}
    for q in work.quantities:
        if q.kind == "box" and q.name in sums.boxes.sums:
            values[q.name] = sums.boxes.mean(q.name)
    for q in work.quantities:
        if q.name not in values:
            values[q.name] = sum(values[name] for name in q.parts)
    scales, extents, errors, expected = {}, {}, {}, {}
    for q in work.quantities:
        if q.kind == "grid":
            check = place_of(q, sums).check
            # Points that are never defined are NaN in both.
            known, wanted = without_nan(values[q.name]), without_nan(sums.exactly.of(q))
            scales[q.name], extents[q.name] = q.scale(sums.grid), extent_of(known)
            errors[q.name] = found = check.errors(known, wanted, scales[q.name], extents[q.name])
            likely = check.expected(known, wanted, scales[q.name], extents[q.name])
            expected[q.name] = max(found["error_max"], SAFE * likely)
            found["error_expected"] = max(found["error_max"], likely)
    for name, more in errors_around(run, sums, values, scales, extents, expected).items():
        for key, value in more.items():
            errors[name][key] = max(errors[name][key], value)
        expected[name] = max(expected[name], errors[name]["error_max"])
        errors[name]["error_expected"] = max(errors[name]["error_expected"], errors[name]["error_max"])
    arrays, weights, within, notes = {}, {}, {}, {}
    for q in work.quantities:
        arrays[q.name] = x = units.to_user(q.dimension, values[q.name])
        if run.several:
            means = sums.exactly if q.kind == "grid" else sums.boxes
            within[q.name] = means.within(q) * float(units.to_user(q.dimension, 1.0)) ** 2
        if q.kind == "grid":
            shape = place_of(q, sums).bound.shape
            basis = place_of(q, sums).bound.basis_gcc
            if basis is not None:
                arrays[q.name] = x = in_local_axes(x, basis, q.rank)
            arrays[q.name] = x.reshape(*shape, *x.shape[1:])
            if q.weight is not None:
                w = sums.grid.site[q.weight][:, 0] if q in run.once else sums.fields.weight(q.name)
                weights[q.name] = w.reshape(shape)
    for one in sums.bonds.each:
        for what, count in one.notes.items():
            notes[what] = notes.get(what, 0) + count
    place = sums.here or sums.reference
    return FrameResult(
        arrays,
        mask=None if sums.mask is None else sums.mask.reshape(sums.here.bound.shape),
        common=None
        if sums.anywhere is None or run.settings.part is None
        else sums.anywhere.reshape(sums.here.bound.shape),
        weights=weights,
        errors=errors,
        bound=place.bound if place else None,
        seconds=dict(sums.seconds),
        notes=notes,
        expected=expected,
        frames=n,
        within=within,
    )


def place_of(q: Quantity, sums: RunSums) -> Place:
    """Where the sums of a quantity are: on the reference, or on the frame."""
    return sums.reference if q.on_reference else sums.here


def errors_around(run: Run, sums: RunSums, values, scales, extents, expected) -> dict[str, dict[str, float]]:
    """The errors that the strongest bonds make: of several frames alone, if those at random points leave room for them,
    or else all errors at the points around these bonds."""
    bonds, quantities = sums.bonds, checkable(run.work)
    if bonds.strong_g is None:
        return {}
    around = sums.around
    if run.several:
        if all(q.rank == 2 for q in quantities):  # in the units of the bonds' own sum
            strongest, error = bonds.strongest.all, bonds.left
            few = strongest.watched(run.frames[0].cell)
            if len(few[0]):
                error += float(error_of(sums.here, few, strongest).max(initial=0.0))
            sizes = {q.name: extents[q.name].largest for q in quantities}
            n = len(run.frames)
            alone = {
                name: ratio(error / n, scales[name] if size <= ZERO * scales[name] else size)
                for name, size in sizes.items()
            }
            if all(expected[name] + alone[name] <= run.goal for name in alone):
                return {name: {"error_max": value} for name, value in alone.items()}
        around = look_around(run, sums.here, bonds)
    if around is None:
        return {}
    points, means = around
    found = {
        q.name: points.check.errors(
            without_nan(values[q.name]), without_nan(means.of(q)), scales[q.name], extents[q.name]
        )
        for q in quantities
    }
    return {name: {key: errors[key] for key in ("error_max", "error_of_fluctuation")} for name, errors in found.items()}


def look_around(run: Run, here: Place, bonds: RunBonds) -> tuple[PointsAround, MeanFields] | None:
    """The fields at the points around the strongest bonds, exactly; None where there are no such points."""
    work, settings = run.work, run.settings
    points = PointsAround(run.frames[0], settings, here, bonds.strongest.all, bonds.strong_g, run.index)
    if not len(points):
        return None
    quantities = checkable(work)
    if run.several:
        quantities = [
            q for q in elements(work) if q in quantities or any(q.name in whole.parts for whole in quantities)
        ]
    means = MeanFields()
    for k, frame in enumerate(run.frames):
        factors = run.factors(k, bonds.each[k].per_atom)
        bond_gk = points.bond_sums(frame, work.bond, run.drifts[k], run.chosen[k], bonds.each[k].kept)
        if bonds.fields is not None:
            bond_gk = bond_gk + bonds.fields.at(k, points.which)
        sums = replace(run.no_sums(k), bond=named_bond_sums(work, bond_gk, settings.churnless))
        if work.site:
            sums.site.update(passes.site_pass(frame, work, points.check.deposits, factors))
            shift(run, sums, points.check.deposits, frame, factors)
            if work.squares:
                sums.squared.update(passes.squares_pass(frame, work, points.check.deposits, factors))
                sums.count_freedom()
        means.add(quantities, sums)
    return points, means
