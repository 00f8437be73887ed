"""``atc plot``: pictures of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import AtcError
from .common import PublishedUnits, Species


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(plot)


def plot(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Output of atc fields.", show_default=False)],
    quantity: Annotated[
        str | None,
        typer.Option(
            "-q",
            "--quantity",
            metavar="NAME",
            help="Which field; default: the first stress, else the first field.",
            show_default=False,
        ),
    ] = None,
    component: Annotated[
        str | None,
        typer.Option(
            "-c",
            "--component",
            metavar="NAME",
            help="xx, xy, ..., vonmises, hydrostatic, max_shear; x, y, z, magnitude.",
            show_default=False,
        ),
    ] = None,
    slice: Annotated[
        str | None,
        typer.Option(
            "--slice",
            metavar="AXIS=POS",
            help="Plane of a 3-D grid, e.g. z=0.5 (fraction of the axis) or z=12.5A (length).",
            show_default=False,
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option("--axis", metavar="AXIS", help="Axis normal to the plane (with --index).", show_default=False),
    ] = None,
    index: Annotated[
        int | None, typer.Option("--index", metavar="K", help="Index of the plane along --axis.", show_default=False)
    ] = None,
    frame: Annotated[
        str,
        typer.Option(
            "--frame",
            metavar="N|mean|all",
            help="Frame counted from 0 (-1 is the last), the mean over frames, or all: a profile against time.",
        ),
    ] = "-1",
    mean: Annotated[
        str | None,
        typer.Option(
            "--mean", metavar="AXES", help="Take means over these axes of the grid, e.g. y or x,y.", show_default=False
        ),
    ] = None,
    limits: Annotated[
        str | None, typer.Option("--limits", metavar="LO,HI", help="Limits of the colour scale.", show_default=False)
    ] = None,
    robust: Annotated[
        bool | None,
        typer.Option(
            "--robust/--full",
            help="Limits at the 2nd and 98th percentile, or at the extremes; default: robust where a few points are "
            "far beyond all others.",
            show_default=False,
        ),
    ] = None,
    arrows: Annotated[
        str | None,
        typer.Option("--arrows", metavar="NAME", help="Draw a vector field over the map.", show_default=False),
    ] = None,
    streamlines: Annotated[
        str | None,
        typer.Option("--streamlines", metavar="NAME", help="The same as streamlines.", show_default=False),
    ] = None,
    principal: Annotated[
        str | None,
        typer.Option(
            "--principal", metavar="NAME", help="Draw principal stresses in the plane as crosses.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="The picture: .png, .pdf or .svg; default next to OUT.",
            show_default=False,
        ),
    ] = None,
    movie: Annotated[
        Path | None,
        typer.Option(
            "--movie",
            metavar="FILE",
            help="All frames instead of one, with one scale: .gif or .mp4 (which needs ffmpeg).",
            show_default=False,
        ),
    ] = None,
    rate: Annotated[float, typer.Option("--rate", metavar="N", help="Frames a second of the movie.")] = 5.0,
    overlay: Annotated[
        Path | None,
        typer.Option(
            "--overlay",
            metavar="SCENE",
            help="Draw the atoms of this scene's trajectory near the plane.",
            show_default=False,
        ),
    ] = None,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Do not print the picture's name.")] = False,
) -> None:
    """Draw a slice, plane or profile of a field."""
    from ..config.scene import Scene
    from ..pictures import plotting

    options = {
        "component": component,
        "slice": slice,
        "axis": axis,
        "index": index,
        "mean": mean,
        "limits": _parse_limits(limits),
        "robust": robust,
        "species": species,
        "units": units,
        "arrows": arrows,
        "streamlines": streamlines,
        "principal": principal,
        "overlay": None if overlay is None else Scene.load(overlay).trajectory(),
    }
    if movie is not None:
        if output is not None:
            raise AtcError("--output and --movie: a picture or a movie, not both")
        path = plotting.movie_file(out, movie, quantity, rate=rate, **options)
    else:
        path = plotting.plot_file(out, quantity, frame=frame, output=output, **options)
    if not quiet:
        print(path)


def _parse_limits(text: str | None):
    if text is None:
        return None
    try:
        lo, hi = (float(v) for v in text.split(","))
        if not lo < hi:
            raise ValueError
    except ValueError:
        raise AtcError(f"--limits {text}: expected two increasing numbers, e.g. --limits -2e4,2e4") from None
    return lo, hi
