"""``atc check``: balance laws."""

from __future__ import annotations

from typing import Annotated

import typer

from .common import Jobs, Json, SceneFile, SceneFlags, Silent, option, show


def check(
    scene: SceneFile,
    flags: SceneFlags,
    jobs: Jobs = 1,
    points: Annotated[int | None, option("--points N", "Random points, and as many of the grid's.")] = None,
    json: Json = False,
    quiet: Silent = False,
) -> None:
    """Balance laws: residuals of mass, momentum, energy and of div z = 0 at random points and points of the grid.

    On the frame in the middle, in closed form and from the fields; with 3, 5 or 9 frames close in time also from
    differences between frames. Exit status 0 when every law holds as far as it can be told, 1 when one is broken.
    """
    from ..analysis.check import check_scene

    made = flags.load(scene)
    if points is not None:
        made.set("check", "points", points, flag=f"--points {points}")
    report = check_scene(made, jobs=jobs)
    show(report, json, quiet=quiet)
    if not report.ok:
        raise typer.Exit(1)
