"""Does it look right? What every way of computing fields, and their plan, checks before anything is computed."""

from __future__ import annotations

import warnings

from ..errors import AtcWarning
from ..estimators.planes import Path
from ..estimators.requirements import require
from ..grids.planes import through_planes
from ..readers.plausible import doubts
from .job import Job


def sanity(job: Job) -> None:
    """Complain of what is missing in the first frame; warn of what can be computed but is probably not what was
    meant."""
    frame, work, u = job.first, job.work, job.first.units
    require(frame, job.settings(), work)
    if work.grid_users and through_planes(job.request.grid):
        Path.of(frame, job.request.grid, job.request.pot, work)  # the time over which passages are counted is known
    if job.request.output_units is not None:
        from ..units.words import require_used, wanted_units

        given = job.request.output_units
        have = [u.label(q.dimension) for q in work.quantities] + [u.label("length"), u.label("time")]
        require_used(wanted_units(given), have, str(given))
    for doubt in doubts(frame, temperature="velocities" in work.attributes):
        warnings.warn(f"{frame.source}: {doubt}", AtcWarning, stacklevel=3)
    if work.kernel_users and job.request.kern is not None and job.request.grid is not None:
        bound = job.request.grid.bind(u, frame.cell, frame.positions)
        spacing = 0.0 if getattr(bound, "means", False) else grid_spacing(bound)
        support = u.to_internal("length", job.request.kern.support)
        if spacing > support:
            radius = f"{float(job.request.kern.radius):g} {u.label('length')}"
            text = (
                f"the kernel's radius ({radius}) is smaller than the distance between grid points "
                f"({u.to_user('length', spacing):.3g}): much of the material is seen by no point; use a finer grid or "
                "a wider kernel"
            )
            warnings.warn(text, AtcWarning, stacklevel=3)


def grid_spacing(bound) -> float:
    """Largest distance between neighbouring points along a grid axis (internal units); 0 for scattered points."""
    gaps = [] if bound.spacing is None else [d for d, n in zip(bound.spacing, bound.shape) if n > 1]
    return float(max(gaps, default=0.0))
