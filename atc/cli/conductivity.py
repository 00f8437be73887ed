"""``atc conductivity``: Green and Kubo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from .common import Jobs, Json, SceneFile, SceneFlags, option, parse_numbers, progress_bar, show


def conductivity(
    scene: SceneFile,
    flags: SceneFlags,
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

    made = flags.load(scene)
    two = "two lags in the trajectory's unit of time, e.g. --plateau 3,6"
    lags = parse_numbers("--plateau", plateau, two, lambda values: len(values) == 2)
    with progress_bar(quiet or json) as progress:
        result = conductivity_of_scene(
            made, segments=segments, plateau=lags, longest=longest, dt=dt, jobs=jobs, progress=progress
        )
    if picture is not None:
        result.picture(picture)
    show(result, json)
    if picture is not None and not json:
        print(f"picture: {picture}")
