"""What the first frames settle, once a run, before the others are computed: whether the run's own forces are the
potential's, what the digits of the input leave open, and the methods.
"""

from __future__ import annotations

from ..errors import AtcError
from ..estimators.driver import fields_of
from ..estimators.methods import DEPOSITS, Method, Refinement, summary
from ..estimators.results import FrameResult
from ..grids.planes import through_planes
from ..planning.job import Job
from .parallel import here

#: With so many frames one from the middle says where all begin.
SEVERAL = 6


def agreement(job: Job, store) -> str:
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


def input_errors(job: Job, store, anchor) -> tuple[float, dict[str, float]]:
    """See `estimators.accuracy.input_error`; once a run, on the first frame."""
    if not job.work.grid_users or through_planes(job.request.grid):
        return 0.0, {}  # atoms are on one side of a plane, or on the other
    known = store.recall("input_error") if store is not None else None
    if known is None:
        from ..estimators.accuracy import input_error

        known = input_error.input_errors(job, anchor)
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
