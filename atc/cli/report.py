"""``atc report``: an output as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .common import PublishedUnits, Species


def register(app) -> None:
    """Add the command to `app`."""
    app.command("report")(report)


def report(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Output of atc fields or atc twin.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="PAGE", help="The page; default OUT.html.", show_default=False),
    ] = None,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Do not print the page's name.")] = False,
) -> None:
    """Write one HTML page about an output: pictures, profiles, Hardy against virial, errors, warnings, the scene; of a
    twin its material, norms and differences."""
    from ..analysis.page import report as write

    path = write(out, output, species=species, units=units)
    if not quiet:
        print(path)
