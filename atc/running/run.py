"""From a trajectory to a dataset: frames one after another or over processes, resumable, averaged if asked."""

from __future__ import annotations

import time
import warnings

from ..errors import AtcError, AtcWarning, logger
from ..estimators.driver import fields_of
from ..neighbors.verlet import anchor_of
from ..planning.identity import identity
from ..planning.job import Job, prepare
from ..planning.report import plan  # noqa: F401  (plan belongs to the same door)
from ..planning.request import Request
from ..planning.sanity import sanity
from ..readers.memory import comes_once
from ..terminal import progress_of
from .collecting import Sink
from .first_frames import agreement, fix_methods, input_errors
from .interruption import whole
from .opening import open_dataset
from .output import dataset_in_memory, explained
from .parallel import frame_results
from .store import Store
from .whole import write_dataset


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
        traj, pot, kern, grid, quantities, tolerance, method, reference, average, threads, workers, scene, horizon,
        cluster, tiles, forces=forces, log=log, column_units=column_units, select=select, by=by, bonds=bonds,
        velocity=velocity, output_units=output_units,
    )  # fmt: skip
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


def _run(job: Job, store: Store | None, progress) -> Sink:
    log, began = logger(), time.perf_counter()
    what = ", ".join(q.name for q in job.work.quantities)
    source = getattr(job.frames, "source", job.first.source)
    log.info("%s: %d frames of %d atoms: %s; %s", source, job.n_frames, len(job.first), what, job.method_used)
    with progress_of(progress) as report:
        sink = _run_frames(job, store, report)
    log.info("%s: %d frames in %.3g s", source, job.n_frames, time.perf_counter() - began)
    return sink


def _run_frames(job: Job, store: Store | None, progress) -> Sink:
    n, window = job.n_frames, job.window
    sink = Sink(job, store)
    start = sink.next_frame
    sink.compare_done(start)
    sink.agreement = agreement(job, store)
    anchor = anchor_of(job)
    first = fix_methods(job, store, start, anchor)
    settings = job.settings(anchor)
    if job.group() > 1:
        first = None  # it is part of a group
    began, done = time.perf_counter(), start
    if progress is not None:
        progress(done, n, 0.0)
    sink.input_error = input_errors(job, store, anchor)
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
