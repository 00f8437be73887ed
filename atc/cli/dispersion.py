"""``atc dispersion``: frequencies of a crystal from its force constants, phonopy, peridynamic models and a
trajectory."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from .common import (
    Dataset,
    Json,
    Overwrite,
    Quiet,
    SceneFile,
    SceneFlags,
    console,
    option,
    output_asked,
    show,
    write_result,
)


def dispersion(
    scene: SceneFile,
    flags: SceneFlags,
    output: Dataset = None,
    picture: Annotated[Path | None, option("--picture FILE", "Draw everything in one picture.")] = None,
    phonopy: Annotated[
        Path | None,
        option(
            "--phonopy FOLDER", "Write phonopy.yaml, FORCE_CONSTANTS and band.yaml there, for phonopy and Euphonic."
        ),
    ] = None,
    json: Json = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Phonon dispersion of a crystal: lattice, phonopy, peridynamic models and a trajectory side by side, with
    elastic constants, linewidths and structure factors.

    Needs [dispersion] and [potential], [trajectory] or both.
    """
    from ..upscaling.dispersion import dispersion_of_scene

    made = flags.load(scene)
    out = output_asked(made, output, overwrite)
    result = dispersion_of_scene(made)
    if made.get("dispersion", "twin"):
        from ..twins.waves import add_twin

        add_twin(result, made)
    show(result, json, quiet=quiet)
    written = result.write_phonopy(phonopy) if phonopy is not None else []
    write_result(result, out, picture, tell=not (json or quiet))
    if written and not (json or quiet):
        console().print(f"phonopy: {', '.join(map(str, written))}", soft_wrap=True)
