"""``atc profile``: pressure across a planar interface, and its surface tension."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import (
    Dataset,
    Jobs,
    Json,
    Overwrite,
    Quiet,
    SceneFile,
    SceneFlags,
    option,
    progress_bar,
    show,
    write_result,
)


def profile(
    scene: SceneFile,
    flags: SceneFlags,
    output: Dataset = None,
    axis: Annotated[
        str | None, option("--axis x|y|z", "Normal of the interface, if not the scene's slab grid's.")
    ] = None,
    bins: Annotated[int | None, option("--bins N", "Bins along it, if not the scene's.")] = None,
    interfaces: Annotated[int, option("--interfaces N", "How many interfaces share the tension of the cell.")] = 2,
    flow: Annotated[
        bool, option("--flow", "Kinetic pressure relative to the mean velocity profile of the run.")
    ] = False,
    boundary: Annotated[
        str,
        option(
            "--boundary auto|periodic|vacuum",
            "Of the electric field: no mean field in the cell, or none below its lower face.",
        ),
    ] = "auto",
    jobs: Jobs = 1,
    picture: Annotated[Path | None, option("--picture FILE", "Draw the profiles.")] = None,
    json: Json = False,
    csv: Annotated[bool, option("--csv", "The profiles as CSV.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Profiles across a planar interface, with error bars: pressure and surface tension, species, charges and
    electric potential, velocities.

    Needs [trajectory], [kernel] and a slab [grid] (or --axis and --bins); for pressure [potential].
    """
    from ..analysis.interface import profile_of_scene

    if json and csv:
        raise AtcError("give --json or --csv, not both")
    made = flags.load(scene)
    out = made.output(output, overwrite=overwrite) if output is not None else None
    if picture is not None:
        from ..pictures.drawing import picture_kind

        picture_kind(picture)
    with progress_bar(quiet or json or csv) as progress:
        where = {"axis": axis, "bins": bins, "interfaces": interfaces}
        how = {"flow": flow, "boundary": boundary, "jobs": jobs, "progress": progress}
        result = profile_of_scene(made, **where, **how)
    show(result, json, csv, quiet)
    write_result(result, out, picture, tell=not (json or csv or quiet))
