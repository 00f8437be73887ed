"""Frames in, fields out: the passes over each frame, the sums of frames that share a cell, the fields formed from them,
and all of it again by tighter methods as long as an error found is larger than allowed. A frame is a group of one.

`fields_of` asks for the sums (`runs.sum_up`: bonds, then atoms), forms the fields (`forming.form`), and compares
(`tightening.tightened`).
"""

from __future__ import annotations

from dataclasses import replace
from time import perf_counter

from ..grids.planes import through_planes
from .forming import form
from .groups import POINTS, of_one_cell
from .methods import DEPOSITS, NAMES
from .planes import fields_on_planes
from .requirements import require
from .results import FrameResult, joined, of_parts, with_others
from .runs import Run, sum_up
from .settings import Settings
from .tightening import SAFE, tightened


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
        With `settings.tiles`: how tiles are computed (see `tiles.tiled_bond_pass`). Default: one after the other, here.

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
    if through_planes(settings.grid):
        # Nothing that is counted is to be tightened; fields on no grid are computed as ever.
        own, others = (tuple(q.name for q in work.quantities if (q.kind == "grid") == on) for on in (True, False))
        counted = fields_on_planes(frames[0], replace(settings, names=own))
        if not others:
            return counted
        rest = fields_of(frames, replace(settings, names=others, grid=None), index, run_tiles)
        return with_others(counted, rest, settings.names)
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
