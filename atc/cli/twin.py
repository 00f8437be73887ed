"""``atc twin``: a molecular-dynamics run and its peridynamic twin side by side."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .common import Begin, End, Quiet, SceneFile, Set, Step, console, load_scene, progress_bar


def register(app: typer.Typer) -> None:
    """Add the command to `app`."""

    @app.command()
    def twin(
        scene: SceneFile,
        output: Annotated[
            Path | None,
            typer.Option("-o", "--output", metavar="OUT", help="Write a dataset: .nc or .zarr.", show_default=False),
        ] = None,
        set: Set = None,
        begin: Begin = None,
        end: End = None,
        step: Step = None,
        picture: Annotated[
            Path | None,
            typer.Option("--picture", metavar="FILE", help="Draw MD, PD and their difference.", show_default=False),
        ] = None,
        overwrite: Annotated[bool, typer.Option("--overwrite", help="Replace OUT if it exists.")] = False,
        quiet: Quiet = False,
    ) -> None:
        """A molecular-dynamics run and its peridynamic twin side by side: body, conditions and material from the run
        and its potential.

        Needs [trajectory] with a reference, [potential], [kernel], [grid] and [twin].
        """
        from ..pictures.drawing import picture_kind
        from ..twins.run import twin as twin_of

        made = load_scene(scene, set, begin, end, step)
        out = (
            made.output(output, overwrite=overwrite)
            if output is not None or made.get("output", "file") is not None
            else None
        )
        if picture is not None:
            picture_kind(picture)
        with progress_bar(quiet) as progress:
            result = twin_of(made, tell=None if quiet else print, progress=progress)
        if out is not None:
            result.save(out)
        if picture is not None:
            result.picture(picture)
        if not quiet:
            result.print(console())
            for what, path in (("dataset", out), ("picture", picture)):
                if path is not None:
                    print(f"{what}: {path}")
