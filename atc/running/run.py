"""From a trajectory to a dataset: frames one after another or over processes, resumable, averaged if asked."""

from __future__ import annotations

import json
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ..decomposers.base import Worst
from ..errors import AtcError, AtcWarning, logger
from ..estimators.accuracy.random_points import tolerance_kept
from ..estimators.driver import fields_of
from ..estimators.methods import DEPOSITS, Method, Refinement, details, summary
from ..estimators.registry import QUANTITIES, hidden
from ..estimators.results import FrameResult
from ..estimators.statistics import BlockAverage
from ..grids.planes import through_planes
from ..neighbors.verlet import anchor_of
from ..planning.identity import changed_parts, frame_digest, identity
from ..planning.job import Job, prepare
from ..planning.report import plan  # noqa: F401  (plan belongs to the same door)
from ..planning.request import Request
from ..planning.sanity import sanity
from ..readers.memory import comes_once
from ..readers.times import Sequence
from ..terminal import progress_of
from .as_scene import file_name
from .dataset import asymmetry, follows_cell, grid_moves, in_output_units, moving_coordinates, output_layout
from .interruption import whole
from .opening import open_dataset
from .output import dataset_in_memory, explained
from .parallel import frame_results, here
from .store import Store
from .thermal import finish_thermal
from .whole import write_dataset

#: With so many frames one from the middle says where all begin.
SEVERAL = 6
# Seconds between two saves of an unfinished time average.
_SAVE_EVERY = 5.0


def fields(
    traj,
    pot=None,
    kern=None,
    grid=None,
    quantities=("stress",),
    tolerance=1e-5,
    *,
    method="auto",
    reference=None,
    average=False,
    threads=None,
    workers=1,
    cluster=None,
    tiles=None,
    out=None,
    progress=None,
    resume=True,
    scene=None,
    horizon=None,
    forces="warn",
    log=None,
    column_units=None,
    select=None,
    by=None,
    bonds="half",
    velocity=None,
    output_units=None,
):
    """Continuum fields of a trajectory.

    Parameters
    ----------
    traj : trajectory from `atc.read`, Frame, list of Frames, or anything `atc.read` takes; also a generator of frames,
        or a stream of MDAnalysis (IMDv3), whose frames come once: see `atc.Live`
    pot : potential from `atc.potential`; needed by quantities with a potential part
    kern : kernel from `atc.kernel`, its radius in the trajectory's unit of length
    grid : `atc.Grid`: where the fields are wanted
    quantities : names; a whole gives its parts too
        number_density, density, momentum, velocity, temperature, energy, stress (= stress_kinetic + stress_potential),
        virial_stress (of the box), virial_stress_per_atom (stress times volume), smoothed_virial_stress, piola_stress;
        heat_flux (= heat_flux_kinetic + heat_flux_potential + heat_flux_churning), energy_flux, churning,
        churning_divergence, churning_heat_source, heat_current (of the box); velocity_gradient, strain_rate, vorticity;
        displacement, displacement_gradient, eshelby_stress; peridynamic_stress and its variants
        peridynamic_stress_weighted_virial, _weighted_virial_normalised, _nodal_virial, each also as
        peridynamic_piola_stress. See `atc.estimators.registry`.
    tolerance : float
        Error allowed, relative to the largest value of a field.
    method : "auto", or a method of `atc.deposit`
    reference : Frame, or number of a frame of `traj`, or what `atc.read` takes
        Reference configuration of displacements, piola_stress and eshelby_stress; the grid of these two stresses is
        that of the reference frame.
    average : False, True or int
        Time average over all frames, or over windows of so many: every X comes with X_stderr (standard error by block
        averaging) and X_correlated (True where the blocks still correlate, so that X_stderr is a lower bound). velocity
        is <ρ v>/<ρ> and temperature <n T>/<n>, T relative to the velocity field of each frame; everything else is the
        plain mean of the fields of the frames, in which a frame without mass at a point counts as zero stress there. In
        windows of 64 frames and more the sums over atoms and bonds of up to 16 frames at a time are added up before
        they are finished (see `atc.estimators.groups`); errors are then those of the means of so many frames.
    threads : int
        Threads within a frame (default: all processors, shared among the workers). Results are identical for equal
        `threads`.
    workers : int
        Processes over frames, when there are as many frames; otherwise threads.
    cluster : str
        Address of a Dask scheduler, ``tcp://host:port``, or a `distributed.Client`: frames (or tiles) are computed by
        its workers, each with `threads` threads. Workers may come, go and die: what they had not finished is computed
        by others, with the same result.
    tiles : three ints
        Cut each frame along the cell's edges into so many tiles, for frames too large for one worker. Exact sums differ
        from those without by rounding, approximate ones by no more than their errors: `tolerance` holds for both.
    out : path ending in .zarr or .nc
        Written frame by frame to ``out.partial`` and renamed at the end. After a kill or Ctrl-C the same call goes on
        where it was, with the same result as an uninterrupted run. `resume=False` begins again.
    progress : True (a bar, in notebooks too), or callable(done, total, rate), frames and frames per second
    scene : str
        The scene as TOML, to be kept with the result.
    horizon : float
        Radius, in the trajectory's unit of length, within which a weighted virial sees bonds; by default the longest
        reach of the potential.
    forces : "warn", "must agree" or "ignore"
        Where the trajectory has forces, those of its first frame (and of one from the middle of long runs) are compared
        with the potential's. What the digits of the file do not explain is a warning that says what it looks like, or
        with "must agree" an error before anything is computed.
    log : path, or list of paths
        LAMMPS log files of the run: energy and pressure tensor of the steps that both have are compared, too.
    column_units : dict
        {column: unit} of the trajectory's own columns whose fields are asked for (quantities ``column:c_pe``,
        ``column:c_pe:mean``, ``column:c_pe:mass_mean``): what to call the unit of their values, which stay as they are.
    output_units : str
        Units of the result where they are of its fields' and coordinates' dimensions, e.g. ``"GPa, nm, W/(m*K)"``, or a
        preset, ``"metal-gpa"``, ``"nm-gpa"``, ``"si"``. Lengths of kernel and grid stay in the trajectory's.
    velocity : "frame", "local", "average" or "none"
        What thermal motion in temperature and kinetic stress is relative to. "frame" (default): the velocity at the
        point in each frame, and corrected for it: the mean velocity of N atoms takes 1/N of their thermal motion, with
        N = (Σ φ)²/Σ φ² for equal masses, so that both are unbiased down to two atoms in reach; where one is alone in
        reach temperature is NaN and the kinetic stress 0. "local": the same as it is, Hardy's definition, which closes
        the momentum balance of each frame. "average": the velocity of the time average, of many frames (brings density
        and momentum along). "none": the frame of the simulation; streaming counts as heat.
    select : from `atc.select`, or a selection of MDAnalysis as a string
        The atoms whose fields are wanted. Their velocity is the one that kinetic parts are relative to.
    by : "type", "element" or "molecule"
        Fields of each of these apart, along a dimension ``species``: velocity, temperature and means are each one's
        own; all else is that one's share in the field of all, relative to the velocity of all, and adds up to it, bonds
        by halves.
    bonds : "half", "both", "one" or "any"
        Which bonds belong to the selected atoms: half of each for every end that is selected; those with both ends
        selected; with one only; with any: all but those within the atoms left out, walls or grips.

    Returns
    -------
    xarray.Dataset
        Dims: frame, then the grid's, then i, j labelled "x", "y", "z"; float64, in the trajectory's units. Stress is
        tension positive, i the face normal (divergence direction) and j the force component. Attributes of each
        variable: units, long_name, sign_convention, error_max (largest error found at random points by the exact
        method, relative to the largest value of the field), error_l2 (rms, relative to the rms of the field),
        error_of_fluctuation (largest, relative to the largest deviation from the mean), measured_error (the same as
        error_max); error_expected (what is to be expected at the worst of all points, by those found), and
        tolerance_kept where it was not, or may not have been; input_error where the coordinates have so few digits that
        it matters: how far the field of the first frame moves when atoms move by what rounding hid. `agrees_with_run`
        of the dataset says how forces and log compare. With `out` the data are read from the file when they are used.

    Raises
    ------
    AtcError
        when something needed is missing or the output cannot be written.

    Notes
    -----
    Formulas: R 4.0.34-4.0.116 as corrected in the documentation: σ = σ_U + σ_K, σ_U = Σ_bonds G r⊗r β, σ_K = −Σ m (v_j
    − v)⊗(v_j − v) φ_j.
    """
    if comes_once(traj):
        for name, given in (("cluster", cluster), ("tiles", tiles), ("log", log), ("workers", workers != 1 or None)):
            if given is not None:
                raise AtcError(
                    f"{name}: frames that come one by one (a stream, a generator) are computed here: leave it out"
                )
        ds = _fields_of_stream(
            traj, progress, pot=pot, kern=kern, grid=grid, quantities=quantities, tolerance=tolerance, method=method,
            reference=reference, average=average, threads=threads, scene=scene, horizon=horizon, forces=forces,
            column_units=column_units,
        )  # fmt: skip
        if out is not None:
            write_dataset(ds, out)
        return ds
    request = Request(
        traj,
        pot,
        kern,
        grid,
        quantities,
        tolerance,
        method,
        reference,
        average,
        threads,
        workers,
        scene,
        horizon,
        cluster,
        tiles,
        forces=forces,
        log=log,
        column_units=column_units,
        select=select,
        by=by,
        bonds=bonds,
        velocity=velocity,
        output_units=output_units,
    )
    if out is None:
        job = prepare(request)
        sanity(job)
        sink = _run(job, None, progress)
        return dataset_in_memory(sink.layout, sink.entries, sink.final_attributes())
    write(request, out, progress, resume)
    with explained(out):
        return open_dataset(out)


def _fields_of_stream(traj, progress, **asked):
    """`fields` of frames that come once."""
    from .. import Live, read

    live = Live(**asked)
    began = time.perf_counter()
    with progress_of(progress) as report:
        for frame in traj if hasattr(traj, "__next__") else read(traj):
            live.add(frame)
            if report is not None:
                report(live.n, live.n, live.n / max(time.perf_counter() - began, 1e-9))
    return live.result()


def write(request: Request, out, progress=None, resume=True) -> dict:
    """What `fields` does with an output, without opening it again (and without the second that the libraries for that
    take to import).

    Returns the attributes of the dataset.
    """
    job = prepare(request)
    sanity(job)
    store = Store(out, {**identity(job), "frames": job.n_frames}, resume)
    try:
        sink = _run(job, store, progress)
        final = sink.final_attributes()
        store.finish(final)
        return {**sink.layout.attrs, **final[""]}
    finally:
        store.close()


def _run(job: Job, store: Store | None, progress) -> _Sink:
    log, began = logger(), time.perf_counter()
    what = ", ".join(q.name for q in job.work.quantities)
    source = getattr(job.frames, "source", job.first.source)
    log.info("%s: %d frames of %d atoms: %s; %s", source, job.n_frames, len(job.first), what, job.method_used)
    with progress_of(progress) as report:
        sink = _run_frames(job, store, report)
    log.info("%s: %d frames in %.3g s", source, job.n_frames, time.perf_counter() - began)
    return sink


def _run_frames(job: Job, store: Store | None, progress) -> _Sink:
    n, window = job.n_frames, job.window
    sink = _Sink(job, store)
    start = sink.next_frame
    sink.compare_done(start)
    sink.agreement = _agreement(job, store)
    anchor = anchor_of(job)
    first = fix_methods(job, store, start, anchor)
    settings = job.settings(anchor)
    if job.group() > 1:
        first = None  # it is part of a group
    began, done = time.perf_counter(), start
    if progress is not None:
        progress(done, n, 0.0)
    sink.input_error = _input_errors(job, store, anchor)
    results = frame_results(job, settings, start, first)
    try:
        for group, result in results:
            end = done + len(group)
            with whole():
                sink.add(done, group[0], result, last_of_window=end % window == 0 or end == n, more=group[1:])
                done = end
            if progress is not None:
                progress(done, n, (done - start) / max(time.perf_counter() - began, 1e-9))
    except KeyboardInterrupt:
        with whole():
            sink.save_unfinished(done)
        raise
    finally:
        results.close()
    if done < n:
        raise AtcError(f"the trajectory has only {done} frames that can be read, but {n} were expected")
    for sentence in sink.sequence.warnings(sink.averaging):
        warnings.warn(f"{getattr(job.frames, 'source', 'the trajectory')}: {sentence}", AtcWarning, stacklevel=3)
    if sink.layout is None:  # every frame was there already: the run was stopped just before its end
        sink.prepare(fields_of([job.first], settings))
    return sink


def _agreement(job: Job, store) -> str:
    """Whether the run's forces are the potential's, in words: once a run, before anything is computed."""
    log = job.request.log
    about = [job.request.forces, [str(p) for p in log] if isinstance(log, list) else str(log)]
    known = store.recall("agrees_with_run") if store is not None else None
    if known is not None and known["about"] == about:
        return known["text"]
    text = job.alarm().text
    if store is not None:
        store.remember("agrees_with_run", {"about": about, "text": text})
    return text


def _input_errors(job: Job, store, anchor) -> tuple[float, dict[str, float]]:
    """See `estimators.accuracy.input_error`; once a run, on the first frame."""
    if not job.work.grid_users or through_planes(job.request.grid):
        return 0.0, {}  # atoms are on one side of a plane, or on the other
    known = store.recall("input_error") if store is not None else None
    if known is None:
        from ..estimators.accuracy.input_error import input_errors

        known = input_errors(job, anchor)
        if store is not None:
            store.remember("input_error", known)
    return known[0], known[1]


def fix_methods(job: Job, store, start: int, anchor=None) -> FrameResult | None:
    """Fix the methods for all frames, by the errors they leave on the first and on the middle one: the first one's
    result, if it had to be computed and is still wanted.

    They may become looser as well as tighter. On every frame they are tightened as far as that frame needs, beginning
    from these: what is done to a frame does not depend on which frames were computed before it, where, or whether the
    run was interrupted.
    """
    if store is not None and start > 0:
        known = store.recall("methods")
        if known is not None:
            job.methods = {key: Method.from_plain(known[key]) for key in DEPOSITS if key in known}
            return None
    result = None
    if not all(m.exact for m in job.methods.values()):
        began = job.methods
        with here(job) as run_tiles:
            result = fields_of([job.first], job.settings(anchor), run_tiles=run_tiles)
            job.fix_methods(result)
            if job.n_frames >= SEVERAL:
                _fix_methods_again(job, job.n_frames // 2, run_tiles)
        over = [e["error_max"] for e in result.errors.values() if e["error_max"] > job.request.tolerance]
        if result.refined and not over:
            tighter = {k: m for k, m in began.items() if m.looser_than(job.methods[k])}
            if tighter:
                changed = (f"{summary({k: m})} to {m.tolerance:g} -> {job.methods[k]}" for k, m in tighter.items())
                what = f"for all frames, after the first: {', '.join(changed)} ({result.refined[0]})"
                result.refined = [Refinement(what)]
    if store is not None:
        store.remember("methods", {key: m.plain() for key, m in job.methods.items()})
    return result if start == 0 else None


def _fix_methods_again(job: Job, k: int, run_tiles) -> None:
    """Where runs begin is often not where they spend their time: a perfect crystal, atoms at rest. A frame of the
    middle has the last word on where the others begin."""
    try:
        frame = job.frames[k]
        # Whatever list of neighbours was kept for the first frames stays theirs.
        result = fields_of([frame], job.settings(), k, run_tiles=run_tiles)
    except (AtcError, IndexError):
        return  # what is wrong with it is told when it is its turn
    job.fix_methods(result)


# --- results to entries of the output


class _Sink:
    """Collects the results of frames into entries (a frame, or the average of a window) in memory or in a store."""

    def __init__(self, job: Job, store: Store | None):
        self.job, self.store = job, store
        self.agreement = ""  # see `_agreement`
        self.input_error: tuple[float, dict[str, float]] = (0.0, {})  # see `_input_errors`
        self.layout: Any = None  # from `prepare` on
        self.entries: list[dict] = []
        if store is not None:
            store.keep(self._whole_entries(store.journal), job.entries)
        self.notes: list[dict] = list(store.journal) if store else []
        self.averages: dict[str, BlockAverage] = {}
        self.any_mass: np.ndarray | None = None
        self.any_common: np.ndarray | None = None
        self.any_weight: dict[str, np.ndarray] = {}
        self.factors: dict[str, float] = {}  # to the units of the output, by variable
        self.note: dict = {}
        self._said_refined = False
        self.sequence = Sequence()
        self.next_frame = min(len(self.notes) * job.window, job.n_frames)
        self._saved = time.monotonic()
        if store is not None and job.window > 1:
            self._restore(store.load_state())

    def _whole_entries(self, journal) -> int:
        """How many entries hold as many frames as they shall: the last window of a trajectory that has grown since may
        have been a short one."""
        n, window = self.job.n_frames, self.job.window
        for k, note in enumerate(journal):
            if note.get("frames") != min(window, n - k * window):
                return k
        return len(journal)

    def compare_done(self, count: int) -> None:
        """The frames that are done must be what they were; which is told by their content, so they are read again."""
        digests = [d for note in (*self.notes, self.note) for d in note.get("digests", ())]
        if count == 0 or self.store is None:
            return
        out = self.store.partial
        for k, then in enumerate(digests[:count]):
            try:
                frame = self.job.frames[k]
            except IndexError:
                break
            now = frame_digest(frame)
            if now != then:
                raise AtcError(
                    f"{frame.source}: is not what it was when its fields were computed (different: "
                    f"{changed_parts(then, now)}), and {out} holds an unfinished run with it: "
                    "compute that trajectory under another name, delete the directory, or start again without resuming"
                )

    @property
    def averaging(self) -> bool:
        return self.job.request.average is not False

    def add(self, k: int, frame, result: FrameResult, last_of_window: bool, more=()) -> None:
        """The result of frame `k`, or of it and `more` that follow it."""
        if self.layout is None:
            self.prepare(result)
        for j, one in enumerate((frame, *more), k):
            self._fits(one, result)
            self.sequence.add(j, one)
        self._merge_note(k, frame, result, more)
        if not self.averaging:
            known = {name: w > 0 for name, w in result.weights.items()}
            values = self._masked(result.arrays, result.mask, result.common, known)
            values = {name: x for name, x in values.items() if not hidden(name)}
            self._emit({**values, **self._coordinates(frame, result)}, result.mask)
            return
        for name, x in result.arrays.items():
            # The weight stays in internal units: only ratios of it matter.
            weight = None if QUANTITIES[name].weight is None else result.weights[name]
            if name not in self.averages:
                self.averages[name] = BlockAverage(block=self.job.group(k), threads=self.job.threads)
            self.averages[name].add(x, weight, result.frames, result.within.get(name))
        self.any_mass, self.any_common = _either(self.any_mass, result.mask), _either(self.any_common, result.common)
        for name, w in result.weights.items():
            self.any_weight[name] = (w > 0) | self.any_weight.get(name, False)
        if "frame" not in self.note:
            self.note.update(frame=k, first=_plain_coordinates(self._coordinates(frame, result)))
        if last_of_window:
            self._emit_average()
        elif self.store is not None and time.monotonic() - self._saved > _SAVE_EVERY:
            self._save(self.store, k + result.frames)

    def _emit_average(self):
        means, extra = {}, {}
        for name, average in self.averages.items():
            mean, stderr, correlated = average.result()
            means[name], extra[f"{name}_stderr"], extra[f"{name}_correlated"] = mean, stderr, correlated
        finish_thermal(self.job, means, extra)
        masks = self.any_mass, self.any_common, self.any_weight
        values = self._masked(means, *masks)
        for name in means:
            if QUANTITIES[name].masked:
                values[f"{name}_stderr"] = self._masked({name: extra.pop(f"{name}_stderr")}, *masks)[name]
        values.update(extra)
        values["frames_averaged"] = np.array(self.note["frames"])
        values.update({name: np.array(v) for name, v in self.note.pop("first").items()})
        mask = self.any_mass
        self.averages, self.any_mass, self.any_common, self.any_weight = {}, None, None, {}
        self._emit(values, mask)

    def _emit(self, values, mask):
        if mask is not None:
            values["mask"] = mask
        pot, asked = self.job.request.pot, self.job.work.quantities
        if pot is not None and not pot.central:
            self.note["asymmetry"] = {q.name: asymmetry(values[q.name]) for q in asked if q.symmetric_if_central}
        values = {name: x * self.factors[name] if name in self.factors else x for name, x in values.items()}
        note, self.note = self.note, {}
        if self.store is None:
            self.entries.append(values)
        else:
            self.store.write(values, note)
        self.notes.append(note)

    @staticmethod
    def _masked(arrays, mask, common=None, weighted=None):
        """Quotients are NaN where there is no mass (nothing that they could be means of: `weighted`, by name); of
        fields of parts, what is relative to the velocity of all where there is no mass of any (`common`)."""
        out = {}
        for name, x in arrays.items():
            known = common if common is not None and QUANTITIES[name].weight is None else mask
            if known is not None and weighted and name in weighted:
                known = known & weighted[name]
            if known is not None and QUANTITIES[name].masked and not known.all():
                x = x.copy()
                x[~known] = np.nan
            out[name] = x
        return out

    # --- what goes along
    def _merge_note(self, k, frame, result, more=()):
        """Errors are the largest of the frames; the rest is counted."""
        errors = self.note.setdefault("errors", {})
        for name, measured in result.errors.items():
            if hidden(name):
                continue
            known = errors.setdefault(name, {})
            for kind, value in measured.items():
                known[kind] = max(known.get(kind, 0.0), value)
        counts = self.note.setdefault("notes", {})
        worst = self.note.setdefault("worst", {})
        for what, count in result.notes.items():
            if isinstance(count, Worst):
                worst[what] = float(count + worst.get(what, 0.0))
            else:
                counts[what] = counts.get(what, 0) + count
        for what in result.refined:
            self.note.setdefault("refined", []).extend([j, what.plain()] for j in range(k, k + result.frames))
            if not self._said_refined:
                self._said_refined = True
                text = f"{frame.source}: computed again more closely: {what} (further ones are noted in the output)"
                warnings.warn(text, AtcWarning, stacklevel=2)
        self.note["frames"] = self.note.get("frames", 0) + result.frames
        if self.store is not None:
            self.note.setdefault("digests", []).extend(frame_digest(f) for f in (frame, *more))
        self.note["sources"] = [*self.note.get("sources", []), file_name(frame.source)][:1]

    def _coordinates(self, frame, result):
        u = frame.units
        out = {"cell": u.to_user("length", frame.cell.vectors), "cell_origin": u.to_user("length", frame.cell.origin)}
        out["step"] = np.array(-1 if frame.step is None else frame.step, dtype=np.int64)
        out["time"] = np.array(np.nan if frame.time is None else u.to_user("time", frame.time), dtype=np.float64)
        if self.job.follow is not None:
            out["grid_shift"] = u.to_user("length", result.bound.moved_c)
        if self.moves:
            out.update({name: values for name, (_, values, _) in moving_coordinates(result.bound, u).items()})
        return out

    def prepare(self, result: FrameResult) -> None:
        """Lay the output out: the shapes from any frame's result, the rest from the trajectory's first frame, also when
        a run goes on from a later one."""
        job, first = self.job, self.job.first
        self.moves = grid_moves(job)
        self._cell = first.cell
        if set(job.work.grid_users) - set(job.work.on_reference):
            result = replace(result, bound=job.bound)
        self.layout = output_layout(job, first, result, self.moves)
        if job.request.output_units is not None:
            self.layout, self.factors = in_output_units(self.layout, job.request.output_units)
        self._atoms = first.ids
        if self.store is not None:
            self.store.begin(self.layout)

    def _fits(self, frame, result):
        if not self.moves and self.job.entries > 1 and follows_cell(self.job) and frame.cell != self._cell:
            text = "the cell changes, and the grid with it, but its coordinates in the output are those of the first"
            warnings.warn(f"{frame.source}: {text} frame: see cell and cell_origin", AtcWarning, stacklevel=2)
            self._cell = frame.cell
        for v in self.layout.variables:
            x = result.arrays.get(v.name)
            if x is not None and x.shape != v.shape:
                raise AtcError(
                    f"{frame.source}: {v.name} has shape {x.shape} here but {v.shape} in the first frame: compute "
                    "frames with different numbers of atoms "
                    "one by one"
                )
        if any(q.kind == "atom" for q in self.job.work.quantities) and not np.array_equal(self._atoms, frame.ids):
            raise AtcError(
                f"{frame.source}: its atom ids are not those of the first frame: compute per-atom quantities of such "
                "frames one by one"
            )

    def final_attributes(self) -> dict:
        """Attributes only known at the end, by variable; "" for the dataset."""
        out: dict = {}
        worst = 0.0
        for note in self.notes:
            for name, measured in note["errors"].items():
                at = out.setdefault(name, {})
                for kind, value in measured.items():
                    at[kind] = max(at.get(kind, 0.0), value)
                at["measured_error"] = at.get("error_max", 0.0)
                kept = tolerance_kept(at, self.job.request.tolerance)
                if kept is not None:
                    at["tolerance_kept"] = kept
                if at.pop("error_of_terms", 0.0):
                    at["error_relative_to"] = "sum of the sizes of the terms: the field is 0 within rounding"
                worst = max(worst, at["measured_error"])
        out[""] = {"sources": ", ".join(dict.fromkeys(s for note in self.notes for s in note["sources"]))}
        if self.agreement:
            out[""]["agrees_with_run"] = self.agreement
        step, moved = self.input_error
        if moved:
            for name, error in moved.items():
                if not hidden(name):
                    out.setdefault(name, {})["input_error"] = error
            out[""]["input_error"] = max(moved.values())
            out[""]["input_resolution"] = self.job.first.units.to_user("length", step)
        refined = Refinement.summary([r for note in self.notes for r in note.get("refined", [])])
        if refined:
            out[""]["refinements"] = refined
        if self.job.methods:
            out[""]["method"], out[""]["method_details"] = self.job.method_used, details(self.job.methods)
        counts: dict = {}
        for note in self.notes:
            for what, count in note["notes"].items():
                counts[what] = counts.get(what, 0) + count
            for what, value in note.get("worst", {}).items():
                out[""][what] = float(Worst(value) + out[""].get(what, 0.0))
            for name, value in note.get("asymmetry", {}).items():
                at = out.setdefault(name, {})
                at["asymmetry"] = float(Worst(value) + at.get("asymmetry", 0.0))
        if counts:
            out[""]["notes"] = "; ".join(f"{what}: {count}" for what, count in sorted(counts.items()))
        if self.job.work.grid_users:
            out[""]["measured_error"] = worst
            missed = {name: at["tolerance_kept"] for name, at in out.items() if "tolerance_kept" in at}
            if missed:
                # The exact sum itself can only miss it where a field is the small difference of large numbers.
                how = "use method='direct'"
                if all(m.exact or not m.forced for m in self.job.methods.values()):
                    how = "hardly more than the rounding of what they are the difference of"
                which = ", ".join(f"{name} ({kept.partition(': ')[2]})" for name, kept in missed.items())
                text = f"tolerance {self.job.request.tolerance:.1e} not kept for {which}: {how}"
                warnings.warn(f"the measured error {worst:.1e}: {text}", AtcWarning, stacklevel=2)
        return out

    # --- an average that was interrupted
    def save_unfinished(self, after) -> None:
        """Keep what a window has of its frames, when the run is stopped between two of them."""
        if self.store is not None and self.averages and self.job.window > 1:
            self._save(self.store, after)

    def unfinished(self) -> dict:
        """The averages so far, as arrays by names."""
        arrays = {f"{name}/{key}": a for name, average in self.averages.items() for key, a in average.state().items()}
        for key in ("any_mass", "any_common"):
            if getattr(self, key) is not None:
                arrays[key] = getattr(self, key)
        return arrays | {f"any_weight:{name}": known for name, known in self.any_weight.items()}

    def go_on(self, arrays: dict) -> None:
        """Take the averages as `unfinished` gave them."""
        self.any_mass, self.any_common = arrays.pop("any_mass", None), arrays.pop("any_common", None)
        by_name: dict[str, dict] = {}
        for key, a in arrays.items():
            if key.startswith("any_weight:"):
                self.any_weight[key.partition(":")[2]] = a
            else:
                name, _, rest = key.rpartition("/")
                by_name.setdefault(name, {})[rest] = a
        self.averages = {name: BlockAverage.from_state(s, self.job.threads) for name, s in by_name.items()}

    def _save(self, store: Store, after):
        about = {"entry": len(self.notes), "next": after, "note": self.note}
        store.save_state({**self.unfinished(), "about": np.array(json.dumps(about))})
        self._saved = time.monotonic()

    def _restore(self, state):
        if state is None:
            return
        about = json.loads(str(state.pop("about")))
        if about["entry"] != len(self.notes):
            return
        self.next_frame, self.note = about["next"], about["note"]
        self.go_on(state)


def _either(a, b):
    """Where one of two masks is True; None says nothing."""
    return b if a is None else a if b is None else a | b


def _plain_coordinates(coordinates):
    """As JSON can hold them; floats survive JSON exactly."""
    return {name: np.asarray(v).tolist() for name, v in coordinates.items()}
