"""``atc conductivity``: Green and Kubo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .common import (
    Begin,
    End,
    Jobs,
    Json,
    SceneFile,
    Set,
    Step,
    console,
    load_scene,
    option,
    parse_numbers,
    progress_bar,
)


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(conductivity)


def conductivity(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    segments: Annotated[int, option("--segments N", "Independent parts of the run that give the error.")] = 10,
    plateau: Annotated[
        str | None, option("--plateau T1,T2", "Average the integral over these lags; default: found.")
    ] = None,
    longest: Annotated[float | None, option("--longest T", "The longest lag; default: half a segment.")] = None,
    dt: Annotated[float | None, option("--dt T", "Time between frames, if the file does not say it.")] = None,
    picture: Annotated[Path | None, option("--picture FILE", "Draw the correlation function and its integral.")] = None,
    json: Json = False,
    quiet: Annotated[bool, option("-q --quiet", "No progress.")] = False,
) -> None:
    """Thermal conductivity of an equilibrium run, by Green and Kubo, with an error bar: needs [trajectory] and
    [potential]."""
    from ..analysis.green_kubo import conductivity_of_scene

    made = load_scene(scene, set, begin, end, step)
    two = "two lags in the trajectory's unit of time, e.g. --plateau 3,6"
    lags = parse_numbers("--plateau", plateau, two, lambda values: len(values) == 2)
    with progress_bar(quiet or json) as progress:
        result = conductivity_of_scene(
            made, segments=segments, plateau=lags, longest=longest, dt=dt, jobs=jobs, progress=progress
        )
    if picture is not None:
        result.picture(picture)
    if json:
        print(result.json())
    else:
        result.print(console())
        if picture is not None:
            print(f"picture: {picture}")
