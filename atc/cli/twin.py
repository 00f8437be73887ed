"""``atc twin``: a molecular-dynamics run and its peridynamic twin side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import (
    Dataset,
    Overwrite,
    Quiet,
    SceneFile,
    SceneFlags,
    option,
    output_asked,
    progress_bar,
    show,
    write_result,
)


def twin(
    scene: SceneFile,
    flags: SceneFlags,
    output: Dataset = None,
    picture: Annotated[Path | None, option("--picture FILE", "Draw MD, PD and their difference.")] = None,
    movie: Annotated[Path | None, option("--movie FILE", "The same, frame by frame: .gif or .mp4.")] = None,
    report: Annotated[Path | None, option("--report FILE.html", "One page about it all.")] = None,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """A molecular-dynamics run and its peridynamic twin side by side: body, conditions and material from the run
    and its potential.

    Needs [trajectory] with a reference, [potential], [kernel], [grid] and [twin].
    """
    from ..analysis.page import page_path
    from ..analysis.page import report as write_page
    from ..pictures.drawing import picture_kind
    from ..pictures.movies import movie_path
    from ..twins.run import twin as twin_of

    made = flags.load(scene)
    out = output_asked(made, output, overwrite)
    if picture is not None:
        picture_kind(picture)
    if movie is not None:
        movie_path(movie)
    if report is not None:
        page_path(report)
    kind = made.get("grid", "kind")
    for what, path in (("--movie", movie), ("--picture", picture)):
        if path is not None and kind not in ("regular", "plane", "line"):
            raise AtcError(f"{made.where('grid', 'kind')}: {what} needs a regular, plane or line grid, not {kind}")
    with progress_bar(quiet) as progress:
        result = twin_of(made, tell=None if quiet else print, progress=progress)
    show(result, quiet=quiet)
    write_result(result, out, picture, tell=not quiet)
    if movie is not None:
        result.movie(movie)
        if not quiet:
            print(f"movie: {movie}")
    if report is not None:
        write_page(result.dataset, report)
        if not quiet:
            print(f"report: {report}")
