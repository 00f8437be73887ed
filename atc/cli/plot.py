"""``atc plot``: pictures of fields."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import PublishedUnits, Species, argument, option, parse_numbers


def plot(
    out: Annotated[Path, argument("OUT", "Output of atc fields.")],
    quantity: Annotated[
        str | None, option("-q --quantity NAME", "Which field; default: the first stress, else the first field.")
    ] = None,
    component: Annotated[
        str | None, option("-c --component NAME", "xx, xy, ..., vonmises, hydrostatic, max_shear; x, y, z, magnitude.")
    ] = None,
    slice: Annotated[
        str | None,
        option("--slice AXIS=POS", "Plane of a 3-D grid, e.g. z=0.5 (fraction of the axis) or z=12.5A (length)."),
    ] = None,
    axis: Annotated[str | None, option("--axis AXIS", "Axis normal to the plane (with --index).")] = None,
    index: Annotated[int | None, option("--index K", "Index of the plane along --axis.")] = None,
    frame: Annotated[
        str,
        option(
            "--frame N|mean|all",
            "Frame counted from 0 (-1 is the last), the mean over frames, or all: a profile against time.",
        ),
    ] = "-1",
    mean: Annotated[str | None, option("--mean AXES", "Take means over these axes of the grid, e.g. y or x,y.")] = None,
    limits: Annotated[str | None, option("--limits LO,HI", "Limits of the colour scale.")] = None,
    robust: Annotated[
        bool | None,
        option(
            "--robust/--full",
            "Limits at the 2nd and 98th percentile, or at the extremes; default: robust where a few points are "
            "far beyond all others.",
        ),
    ] = None,
    arrows: Annotated[str | None, option("--arrows NAME", "Draw a vector field over the map.")] = None,
    streamlines: Annotated[str | None, option("--streamlines NAME", "The same as streamlines.")] = None,
    principal: Annotated[
        str | None, option("--principal NAME", "Draw principal stresses in the plane as crosses.")
    ] = None,
    output: Annotated[
        Path | None, option("-o --output FILE", "The picture: .png, .pdf or .svg; default next to OUT.")
    ] = None,
    movie: Annotated[
        Path | None,
        option("--movie FILE", "All frames instead of one, with one scale: .gif or .mp4 (which needs ffmpeg)."),
    ] = None,
    rate: Annotated[float, option("--rate N", "Frames a second of the movie.")] = 5.0,
    overlay: Annotated[
        Path | None, option("--overlay SCENE", "Draw the atoms of this scene's trajectory near the plane.")
    ] = None,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Annotated[bool, option("--quiet", "Do not print the picture's name.")] = False,
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
        "limits": parse_numbers(
            "--limits",
            limits,
            "two increasing numbers, e.g. --limits -2e4,2e4",
            lambda values: len(values) == 2 and values[0] < values[1],
        ),
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
