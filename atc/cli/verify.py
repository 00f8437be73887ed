"""``atc verify``: energy, forces and pressure tensor of the potential beside those of the run."""

from __future__ import annotations

from typing import Annotated

import typer

from .common import Jobs, Json, SceneFile, SceneFlags, Silent, option, show


def verify(
    scene: SceneFile,
    flags: SceneFlags,
    jobs: Jobs = 1,
    frames: Annotated[
        str | None,
        option(
            "--frames LIST",
            "Which of the scene's frames: 0,10,-1, a slice 0:100:20, or all; default: the first, the middle "
            "and the last.",
        ),
    ] = None,
    json: Json = False,
    quiet: Silent = False,
) -> None:
    """Model and run side by side: energy, forces, pressure tensor, temperature; needs [trajectory] and [potential].

    The run's forces are those in the trajectory, its energy and pressure those of the log file named by log in
    [trajectory]. Differences are set against what the digits of the files explain. Exit status 0 when model and run
    agree, 1 when they do not, 2 when they cannot be compared.
    """
    from ..agreement.run_check import verify_scene
    from ..planning.job import cores

    found = verify_scene(flags.load(scene), frames, threads=cores(jobs))
    show(found, json, quiet=quiet)
    if not found.agrees:
        raise typer.Exit(1)
