"""``atc check``: balance laws."""

from __future__ import annotations

from typing import Annotated

import typer

from .common import Begin, End, Jobs, Json, SceneFile, Set, Silent, Step, console, load_scene, option


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(check)


def check(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
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

    made = load_scene(scene, set, begin, end, step)
    if points is not None:
        made.set("check", "points", points, flag=f"--points {points}")
    report = check_scene(made, jobs=jobs)
    if json:
        print(report.json())
    elif not quiet:
        report.print(console())
    if not report.ok:
        raise typer.Exit(1)
