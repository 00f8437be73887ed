"""How much of a field is in doubt because the trajectory was written with few digits, to be read beside the method's
own error."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...grids import Grid
from ...readers.plausible import stress_error
from ...readers.trajectory import resolution_of
from ..driver import fields_of
from ..settings import Settings

#: Points at which the fields are computed with moved atoms.
POINTS = 100


def input_errors(job, anchor=None) -> tuple[float, dict[str, float]]:
    """The resolution of the coordinates (internal) and, by field, how far the field moves when atoms move by what
    rounding hides.

    The first frame is computed twice at random points of the grid: as it is, and with every coordinate shifted by a
    random amount within half a step of its last digit, which is what rounding did to it. Relative to the largest value,
    as all errors. Nothing is computed, and nothing returned, where coordinates are so fine that it cannot matter at
    this tolerance.
    """
    work = job.work
    names = tuple(q.name for q in work.quantities if q.kind == "grid" and not q.on_reference and not q.parts)
    names += tuple(q.name for q in work.quantities if q.kind == "grid" and not q.on_reference and q.parts)
    if not names or not len(job.first):
        return 0.0, {}
    step = resolution_of(job.frames, job.first)
    units = job.first.units
    if stress_error(units.to_user("length", step), units) < 0.1 * max(job.request.tolerance, 1e-6):
        return step, {}
    frame, grid = job.first, job.request.grid
    if job.bound.kind != "slab":
        points = job.bound.points_gc
        rng = np.random.default_rng([20240229, 0])
        some = np.sort(rng.choice(len(points), min(POINTS, len(points)), replace=False))
        grid = Grid.points(frame.units.to_user("length", points[some]))
    settings = replace(job.settings(anchor), names=names, grid=grid, methods={}, check_points=1, tiles=None)
    moved = frame.positions + np.random.default_rng(7).uniform(-0.5, 0.5, frame.positions.shape) * step
    a, b = (_fields(f, settings) for f in (frame, frame.replace(positions=moved)))
    out = {}
    for name in names:
        largest = float(np.abs(np.nan_to_num(a[name])).max(initial=0.0))
        if largest > 0:
            out[name] = float(np.abs(np.nan_to_num(a[name] - b[name])).max(initial=0.0)) / largest
    return step, out


def _fields(frame, settings: Settings):
    return fields_of([frame], settings).arrays
