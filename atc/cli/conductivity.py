"""``atc conductivity``: Green and Kubo."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import AtcError
from .common import Begin, End, Jobs, Json, SceneFile, Set, Step, console, load_scene, progress_bar


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
    segments: Annotated[
        int, typer.Option("--segments", metavar="N", help="Independent parts of the run that give the error.")
    ] = 10,
    plateau: Annotated[
        str | None,
        typer.Option(
            "--plateau",
            metavar="T1,T2",
            help="Average the integral over these lags; default: found.",
            show_default=False,
        ),
    ] = None,
    longest: Annotated[
        float | None,
        typer.Option("--longest", metavar="T", help="The longest lag; default: half a segment.", show_default=False),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option("--dt", metavar="T", help="Time between frames, if the file does not say it.", show_default=False),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="FILE", help="Draw the correlation function and its integral.", show_default=False
        ),
    ] = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Thermal conductivity of an equilibrium run, by Green and Kubo, with an error bar: needs [trajectory] and
    [potential]."""
    from ..analysis.green_kubo import conductivity_of_scene

    made = load_scene(scene, set, begin, end, step)
    with progress_bar(quiet or json) as progress:
        result = conductivity_of_scene(
            made, segments=segments, plateau=_parse_times(plateau), longest=longest, dt=dt, jobs=jobs, progress=progress
        )
    if picture is not None:
        result.picture(picture)
    if json:
        print(result.json())
    else:
        result.print(console())
        if picture is not None:
            print(f"picture: {picture}")


def _parse_times(text: str | None):
    if text is None:
        return None
    try:
        begin, end = (float(v) for v in text.split(","))
    except ValueError:
        raise AtcError(
            f"--plateau {text}: expected two lags in the trajectory's unit of time, e.g. --plateau 3,6"
        ) from None
    return begin, end
