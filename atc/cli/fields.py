"""``atc fields``: the main job."""

from __future__ import annotations

import time
from typing import Annotated

from ..errors import heard
from .common import (
    Jobs,
    Output,
    Overwrite,
    Progress,
    PublishedUnits,
    Quiet,
    SceneFile,
    SelectFlags,
    duration,
    kept_on_interrupt,
    option,
    progress_bar,
)


def fields(
    scene: SceneFile,
    flags: SelectFlags,
    output: Output = None,
    jobs: Jobs = 1,
    units: PublishedUnits = None,
    cluster: Annotated[
        str | None,
        option("--cluster ADDRESS", "Compute on the workers of this Dask scheduler, e.g. tcp://127.0.0.1:8786."),
    ] = None,
    report: Annotated[bool, option("--report", "Write an HTML page about the result beside it, too.")] = False,
    restart: Annotated[bool, option("--restart", "Forget the finished frames of an interrupted run.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Compute the fields of a scene, frame by frame, into a file. After an interruption the same command continues."""
    made = flags.load(scene)
    if units is not None:
        made.set("output", "units", units, flag=f"--units {units}")
    out = made.output(output, overwrite=overwrite, resume=not restart)
    started = time.perf_counter()
    kept = kept_on_interrupt("the finished frames are kept: the same command continues")
    with kept, progress_bar(quiet) as progress, heard() as warned:
        attributes = made.write(out, jobs=jobs, cluster=cluster, progress=progress, resume=not restart)
    if not quiet:
        _summary(attributes, out, time.perf_counter() - started, progress)
    if report:
        from ..analysis.page import report as write_page

        path = write_page(out, warned=warned)
        if not quiet:
            print(f"report: {path}")


def _summary(attributes: dict, out, seconds: float, progress: Progress) -> None:
    """Closing lines: where the result is, what is in it, how accurate it is, how long it took."""
    computed = progress.total - progress.there
    before = f"{computed} frame{'s' * (computed != 1)}"
    if progress.there:
        before = f"{progress.there} of {progress.total} frames were there, {computed} computed"
    print(f"{out}: {attributes['quantities']}")
    error = attributes.get("measured_error")
    if error is not None:
        print(
            f"measured error {float(error):.1e} of the largest value (tolerance {float(attributes['tolerance']):g}), "
            "at random points by the exact method"
        )
    rounding = attributes.get("input_error")
    if rounding is not None and error is not None and float(rounding) > float(error):
        print(
            f"input error {float(rounding):.1e}: what rounding the coordinates to "
            f"{float(attributes['input_resolution']):.1g} left in doubt"
        )
    print(
        f"{before} in {duration(seconds)}"
        + (f" ({computed / seconds:.3g} frames/s, start included)" if computed > 1 else "")
    )
