"""The mean of a few consecutive frames of a time average: sums over atoms and bonds are linear, so that the frames are
added up before the sums are finished.

One transform, one evaluation on the grid and one comparison then do for all frames of a group, and a time average gets
its blocks ready made. What is not linear in the sums (the kinetic stress, the temperature: relative to the velocity
field of each frame) is formed frame by frame, and its mean taken; sums over bonds that it does not need are added up
all the same. The error check goes its own way: the exact fields of each frame at random points, the same for all frames
of the group, and their mean. Of all strongest bonds of the group as many are summed exactly as of one frame, and the
rest watched.

What a group gives depends on its frames, the settings and the number of its first frame alone.
"""

from __future__ import annotations

from contextlib import nullcontext
from copy import copy
from dataclasses import replace
from time import perf_counter

import numpy as np

from ..bonds import Bonds
from ..deposit import make
from .accuracy.random_points import ZERO, _ratio, extent_of, kernel_internal
from .accuracy.strongest_bonds import WATCHED, HotPoints, Strongest, error_map
from .driver import (
    SAFE,
    FrameResult,
    Stage,
    _bond_pass,
    _columns,
    _site_pass,
    _whole,
    add_sites,
    checkable,
    clear_thin,
    frame_fields,
    require,
    thin_sums,
    tightened,
    watched,
)
from .methods import NAMES
from .registry import BOND, SITE, Work
from .sources import AtomFactors, bond_factors, drift_velocity
from .statistics import longest_block
from .sums import Sums, full

#: Atoms of all frames of a group, at most. The frames are held until the group is done: it may have to be computed
#: again.
ATOMS = 2**19
#: Random points of the error check: of all groups of a window together many more than of one frame.
POINTS = 24
#: How many times the precision of the sums may be left of a bond that was taken out of them again.
LEFT = 8.0


def size_of(window: int, atoms: int) -> int:
    """How many frames of a window are added up: a power of two, so that blocks of blocks have whole numbers of
    groups."""
    most = max(1, min(longest_block(window), ATOMS // max(atoms, 1)))
    return 1 << (most.bit_length() - 1)


def added_up(work: Work) -> frozenset[str]:
    """The deposits whose sums can be added up over frames ("site", "bond"); none if there is no gain in groups, or
    something asked is not made for them."""
    if any(
        (work.gather, work.reference_gather, work.reference_bond, work.point, work.reference_point, work.on_reference)
    ):
        return frozenset()
    if any(q.kind == "atom" for q in work.quantities):
        return frozenset()
    uses = [(q.linear, {key for key in ("site", "bond") if getattr(q, key)}) for q in elements(work)]
    found = set().union(*(keys for _, keys in uses))
    while True:
        spoilt = set().union(*(keys for linear, keys in uses if not (linear and keys <= found))) & found
        if not spoilt:
            break
        found -= spoilt
    return frozenset(found if "bond" in found or not work.bond else ())


def elements(work: Work) -> list:
    """The fields on the grid that others are sums of."""
    return [q for q in work.quantities if q.kind == "grid" and not q.parts]


def late(work: Work) -> list:
    """Those that are formed once, from the mean sums."""
    together = added_up(work)
    return [q for q in elements(work) if q.linear and {key for key in ("site", "bond") if getattr(q, key)} <= together]


def group_fields(frames, settings, index: int = 0, run_tiles=None) -> FrameResult:
    """The mean fields of some consecutive frames; of one frame, what `frame_fields` gives.

    Parameters
    ----------
    frames : list of Frames. A cell that changes ends a sum, not the group.
    settings : Settings
    index : int
        Number of the first frame.
    run_tiles : see `frame_fields`

    Returns
    -------
    FrameResult; errors are those of the mean fields.
    """
    if len(frames) == 1:
        return frame_fields(frames[0], settings, index, run_tiles)
    work = Work.of(settings.names, settings.central)
    for frame in frames:
        require(frame, settings, work)
    goal = SAFE * settings.tolerance
    start = perf_counter()
    runs: list[list] = []
    for frame in frames:
        if runs and frame.cell.complete and frame.cell == runs[-1][-1].cell:
            runs[-1].append(frame)
        else:
            runs.append([frame])
    settings = replace(settings, check_points=min(settings.check_points, POINTS))
    jobs = [_Run(run, settings, work, index, goal) for run in runs]
    methods, refined = dict(settings.methods), []
    while True:
        for job in jobs:
            job.compute(methods, again=bool(refined))
        expected = {name: max(job.expected[name] for job in jobs) for name in jobs[0].expected}
        thin = set().union(*(job.thin for job in jobs))
        tighter = tightened(work, methods, thin, expected if settings.check_points else {}, goal)
        if not tighter:
            break
        for key, (method, why) in tighter.items():
            methods[key] = method
            refined.append(why.then(f"{NAMES[key]} {method}"))
    result = jobs[0].result if len(jobs) == 1 else _joined([job.result for job in jobs])
    result.methods, result.refined, result.expected = methods, refined, expected
    result.seconds["total"] = perf_counter() - start
    return result


class _Mean:
    """The mean of fields that come one by one, of those with weights <w x>/<w>."""

    def __init__(self, keep: bool = False):
        self.keep, self.n = keep, 0
        self.sums: dict[str, np.ndarray] = {}
        self.weights: dict[str, np.ndarray] = {}
        self.each: dict[str, list] = {}  # (w x, w), if they are to be kept

    def add(self, quantities, sums: Sums) -> None:
        self.n += 1
        for q in quantities:
            x = q.form(sums)
            w = None
            if q.weight is not None:
                w = sums.site[q.weight][:, 0]
                x = x * _wide(w, x)
                self.weights[q.name] = self.weights[q.name] + w if q.name in self.weights else w
            if self.keep:
                self.each.setdefault(q.name, []).append((x, w))
            if q.name in self.sums:
                self.sums[q.name] += x
            else:
                self.sums[q.name] = x.copy()

    def weight(self, name):
        return self.weights[name] / self.n if name in self.weights else None

    def mean(self, name) -> np.ndarray:
        if name not in self.weights:
            return self.sums[name] / self.n
        w = _wide(self.weights[name], self.sums[name])
        return np.divide(self.sums[name], w, out=np.zeros_like(self.sums[name]), where=w > 0)

    def within(self, q) -> float:
        """Mean square deviation of the fields from their mean, see `BlockAverage.add`."""
        names = q.parts or (q.name,)
        if names[0] in self.weights:
            mean, weight = self.mean(q.name), self.weight(q.name)
            return float(
                np.mean(
                    [
                        np.divide(
                            x - _wide(w, x) * mean, _wide(weight, x), out=np.zeros_like(x), where=_wide(weight, x) > 0
                        )
                        ** 2
                        for x, w in self.each[q.name]
                    ]
                )
            )
        mean = sum(self.mean(name) for name in names)
        return float(np.mean([(sum(self.each[name][k][0] for name in names) - mean) ** 2 for k in range(self.n)]))


def _wide(w, x):
    return w.reshape(w.shape + (1,) * (x.ndim - w.ndim))


class _Run:
    """Consecutive frames with one cell, and the mean of their fields."""

    def __init__(self, frames, settings, work, index, goal):
        self.frames, self.settings, self.work, self.index, self.goal = frames, settings, work, index, goal
        first = frames[0]
        self.together = added_up(work)
        self.late = late(work)
        self.early = [q for q in elements(work) if q not in self.late]
        self.box = [q for q in work.quantities if q.kind == "box" and not q.parts]
        kern = kernel_internal(settings.kern, first.units) if work.kernel_users else None
        self.stage = Stage(first, kern, settings, index) if work.grid_users else None
        self.drifts = [drift_velocity(f) if "velocities" in work.attributes else np.zeros(3) for f in frames]
        self.pairwise = getattr(settings.pot, "pairwise", False)
        self.notes: dict[str, int] = {}
        self.seconds = {"bonds": 0.0, "sites": 0.0}

    def compute(self, methods, again=False) -> None:
        """All sums of all frames, and the fields; `again`: see `Stage.use`."""
        work, stage, threads = self.work, self.stage, self.settings.threads
        stage.use(methods, again)
        self.methods, self.thin, self.notes = methods, set(), {}
        bonds = stage.main.open(work.n_bond) if work.bond else None
        sites = stage.main.make("site", work.n_site, 0) if "site" in self.together and work.site else None
        self.strongest = (
            _Strongest(work) if stage.bound.kind != "slab" and watched(work, self.settings, methods) else None
        )
        # Fields on the grid, those of the whole box, and exact ones at the points of the check.
        fields, exactly, size = _Mean(), _Mean(keep=True), 0.0
        boxes, mask = _Mean(keep=True), None
        for frame, drift in zip(self.frames, self.drifts):
            stage.at(frame)
            stage.seeking = self.strongest is not None
            if stage.seeking:
                stage.strongest = Strongest(frame.positions, threads)
            factors = AtomFactors(frame, drift)
            sums = [
                Sums(drift=drift, volume=frame.cell.volume, boltzmann=frame.units.boltzmann, dimension=frame.dimension)
                for _ in range(2)
            ]
            start = perf_counter()
            decomposition = atoms = None
            if work.bond_users:
                anchor = self.settings.anchor
                with nullcontext() if anchor is None else anchor.at(frame):
                    decomposition, atoms = _bond_pass(
                        frame, self.settings, work, stage, None, factors, sums, kept=bonds
                    )
                self._no_churning(sums[1])
                for what, count in (getattr(decomposition, "notes", None) or {}).items():
                    self.notes[what] = self.notes.get(what, 0) + count
                if stage.seeking:
                    self.strongest.add(frame, stage.strongest, factors)
            done = perf_counter()
            if sites is not None:
                stage.main._add(sites, stage.main.place(frame.positions), self._columns(frame, factors))
                add_sites(frame, work, [(stage.check.target, sums[1])], factors)
            elif work.site:
                _site_pass(frame, work, stage, factors, sums)
                self.thin |= thin_sums(sums[0], work)
                clear_thin(sums[0], methods)
                if work.masked:
                    mask = sums[0].defined if mask is None else mask | sums[0].defined
            for name in work.whole:
                sums[0].whole[name] = _whole(name, factors, decomposition, atoms, frame)
            boxes.add(self.box, sums[0])
            fields.add(self.early, sums[0])
            exactly.add(elements(work), sums[1])
            size += sums[1].size / len(self.frames)
            factors.forget("peculiar", *SITE)
            self.seconds["bonds"] += done - start
            self.seconds["sites"] += perf_counter() - done
        stage.strongest, stage.seeking = None, False
        main = Sums(
            drift=self.drifts[0],
            volume=frame.cell.volume,
            boltzmann=frame.units.boltzmann,
            dimension=frame.dimension,
            size=size,
        )
        n, exact = len(self.frames), 0.0
        if self.strongest is not None:
            exact = self._put_right(bonds)
        if bonds is not None:
            main.bond.update(_columns(work.bond, BOND, (bonds.bond_sums() + exact) / n))
            self._no_churning(main)
        if sites is not None:
            main.site.update(_columns(work.site, SITE, sites.site_sums() / n))
            self.thin |= thin_sums(main, work)
            clear_thin(main, methods)
            mask = main.defined if work.masked else None
        self._form(main, fields, boxes, exactly, mask)

    def _no_churning(self, sums) -> None:
        """Pairs churn nothing, see `compute`."""
        if self.pairwise and {"stress", "sources"} <= sums.bond.keys():
            sums.bond["sources"] = -full(sums.bond["stress"]).reshape(-1, 9)

    def _columns(self, frame, factors):
        """The factors of the sums over atoms that are added up: velocities relative to the same drift in all frames."""
        if frame is not self.frames[0]:
            own, factors = factors, AtomFactors(frame, self.drifts[0])
            for name in ("energies_n", "atom_virial_n6", "residual_n4"):
                setattr(factors, name, getattr(own, name))
        return factors.columns(self.work.site)

    def _put_right(self, deposit) -> np.ndarray:
        """The strongest bonds are taken out of an approximate deposit; returns their exact sums (g, k)."""
        strongest, stage = self.strongest, self.stage
        strongest.sort_out()
        x_bc, r_bc, b_bk = strongest.exactly
        deposit.add_strong(x_bc, r_bc, -b_bk)
        exact = make("direct", stage.bound, stage.reach, stage.main.cell, 0, b_bk.shape[1])
        exact.add_bonds(x_bc, r_bc, b_bk)
        exact_gk = exact.bond_sums()
        self.strong_g = np.abs(exact_gk[:, : BOND[self.work.bond[0]].width]).max(1)
        # What rounding leaves of them.
        self.left = LEFT * float(np.finfo(deposit.real).eps) * float(self.strong_g.max(initial=0.0))
        return exact_gk

    def _form(self, main, fields, boxes, exactly, mask) -> None:
        """The result, and which errors are to be expected."""
        work, stage, units, n = self.work, self.stage, self.frames[0].units, len(self.frames)
        values = {q.name: q.form(main) for q in self.late} | {q.name: fields.mean(q.name) for q in self.early}
        at_points = {q.name: exactly.mean(q.name) for q in elements(work)}
        values |= {q.name: boxes.mean(q.name) for q in self.box}
        for q in work.quantities:
            if q.parts:
                values[q.name] = sum(values[name] for name in q.parts)
                if q.kind == "grid":
                    at_points[q.name] = sum(at_points[name] for name in q.parts)
        scales = {q.name: q.scale(main) for q in work.quantities if q.kind == "grid"}
        errors, extents, self.expected = {}, {}, {}
        for name, scale in scales.items():
            extents[name] = extent_of(values[name])
            given = values[name], at_points[name], scale, extents[name]
            errors[name] = found = stage.check.errors(*given)
            self.expected[name] = max(found["error_max"], SAFE * stage.check.expected(*given))
        for name, more in self._hot(values, scales, extents).items():
            for key, value in more.items():
                errors[name][key] = max(errors[name][key], value)
            self.expected[name] = max(self.expected[name], errors[name]["error_max"])
        arrays, weights, within = {}, {}, {}
        for q in work.quantities:
            unit = units.to_user(q.dimension, 1.0)
            arrays[q.name] = x = units.to_user(q.dimension, values[q.name])
            within[q.name] = (exactly if q.kind == "grid" else boxes).within(q) * float(unit) ** 2
            if q.kind != "grid":
                continue
            arrays[q.name] = x.reshape(*stage.bound.shape, *x.shape[1:])
            if q.weight is not None:
                weights[q.name] = (main.site[q.weight][:, 0] if q in self.late else fields.weight(q.name)).reshape(
                    stage.bound.shape
                )
        self.result = FrameResult(
            arrays,
            mask=None if mask is None else mask.reshape(stage.bound.shape),
            weights=weights,
            errors=errors,
            bound=stage.bound,
            seconds=dict(self.seconds),
            notes=dict(self.notes),
            frames=n,
            within=within,
        )

    def _hot(self, values, scales, extents) -> dict:
        """The errors that the strongest bonds make: alone, if those at random points leave room for them, or else all
        errors at the points around these bonds."""
        if self.strongest is None:
            return {}
        work, stage, n, quantities = self.work, self.stage, len(self.frames), checkable(self.work)
        strongest, cell = self.strongest.all, self.frames[0].cell
        if all(q.rank == 2 for q in quantities):  # in the units of the bonds' own sum
            few, error = strongest.watched(cell), self.left
            if len(few[0]):
                exact = make("direct", stage.bound, stage.reach, cell, 0, 1)
                error += float(
                    error_map(stage.main.make("bond", 0, 1), exact, few, np.array([strongest.mean / 3.0])).max(
                        initial=0.0
                    )
                )
            sizes = {q.name: extents[q.name].largest for q in quantities}
            alone = {
                name: _ratio(error / n, scales[name] if size <= ZERO * scales[name] else size)
                for name, size in sizes.items()
            }
            if all(self.expected[name] + alone[name] <= self.goal for name in alone):
                return {name: {"error_max": value} for name, value in alone.items()}
        hot = HotPoints(self.frames[0], self.settings, stage, strongest, self.strong_g, self.index)
        if not len(hot):
            return {}
        means = _Mean()
        parts = [q for q in elements(work) if q in quantities or any(q.name in whole.parts for whole in quantities)]
        for frame, factors in zip(self.frames, self.strongest.factors):
            here = copy(hot)
            here.frame = frame
            sums = Sums(
                drift=factors.drift,
                volume=frame.cell.volume,
                boltzmann=frame.units.boltzmann,
                dimension=frame.dimension,
            )
            sums.bond.update(_columns(work.bond, BOND, here.bond_sums(work.bond, factors.drift)))
            self._no_churning(sums)
            if work.site:
                add_sites(frame, work, [(here.check.target, sums)], factors)
            means.add(parts, sums)
        found = {
            q.name: hot.check.errors(
                values[q.name], sum(means.mean(name) for name in q.parts or (q.name,)), scales[q.name], extents[q.name]
            )
            for q in quantities
        }
        return {
            name: {key: errors[key] for key in ("error_max", "error_of_fluctuation")} for name, errors in found.items()
        }


class _Strongest:
    """The strongest bonds of several frames.

    Attributes
    ----------
    all : Strongest, as of one frame: those that are to be summed exactly, and those to be watched
    exactly : where the former begin (s, 3), their vectors (s, 3) and factors (s, k)
    factors : AtomFactors of each frame
    """

    def __init__(self, work):
        self.names, self.widths = work.bond, [BOND[name].width for name in work.bond]
        self.most, self.sizes, self.factors = 0, np.zeros(2), []
        self.parts: list[tuple] = []

    def add(self, frame, strongest, factors) -> None:
        known, most = strongest.ranked(), strongest.exactly
        strong = len(strongest.sort_out())
        b_bk = bond_factors(
            self.names, self.widths, known, factors.peculiar_nc if "power" in self.names else None, frame.velocities
        )
        self.parts.append((frame.positions[known.i], known, b_bk, np.arange(len(known)) < strong))
        self.most, self.sizes = max(self.most, most), self.sizes + strongest.totals
        self.factors.append(factors)

    def sort_out(self) -> None:
        """As many are summed exactly as of one frame."""
        x_bc, b_bk, strong_b = (np.concatenate([part[k] for part in self.parts]) for k in (0, 2, 3))
        bonds = Bonds.concatenate([part[1] for part in self.parts])
        order = np.argsort(-np.linalg.norm(bonds.forces(), axis=1) * np.linalg.norm(bonds.r_bc, axis=1), kind="stable")
        exact = order[strong_b[order]][: self.most]
        k = np.r_[exact, order[~np.isin(order, exact)][:WATCHED]]
        bonds = bonds.taken(k)
        bonds.i = np.arange(len(k), dtype=np.int32)
        self.all = Strongest.among(x_bc[k], bonds, len(exact), self.sizes)
        self.exactly = x_bc[exact], bonds.r_bc[: len(exact)], b_bk[exact]


def _joined(results) -> FrameResult:
    """The mean of means."""
    n = sum(r.frames for r in results)
    first = results[0]
    arrays, weights, errors = {}, {}, {}
    for name in first.arrays:
        if name in first.weights:
            weights[name] = w = sum(r.frames * r.weights[name] for r in results) / n
            total = sum(r.frames * r.arrays[name] * _wide(r.weights[name], r.arrays[name]) for r in results) / n
            arrays[name] = np.divide(total, _wide(w, total), out=np.zeros_like(total), where=_wide(w, total) > 0)
        else:
            arrays[name] = sum(r.frames * r.arrays[name] for r in results) / n
    for r in results:
        for name, found in r.errors.items():
            errors[name] = {key: max(value, errors.get(name, {}).get(key, 0.0)) for key, value in found.items()} | {
                key: value for key, value in errors.get(name, {}).items() if key not in found
            }
    notes = {
        what: sum(r.notes.get(what, 0) for r in results)
        for what in dict.fromkeys(what for r in results for what in r.notes)
    }
    return replace(
        first,
        arrays=arrays,
        weights=weights,
        errors=errors,
        mask=None if first.mask is None else np.any([r.mask for r in results], axis=0),
        seconds={key: sum(r.seconds[key] for r in results) for key in first.seconds},
        notes=notes,
        frames=n,
        within={name: sum(r.frames * r.within[name] for r in results) / n for name in first.within},
    )
