"""``atc report``: an output as one HTML page."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from .common import PublishedUnits, Species, argument, option


def report(
    out: Annotated[Path, argument("OUT", "Output of atc fields or atc twin.")],
    output: Annotated[Path | None, option("-o --output PAGE", "The page; default OUT.html.")] = None,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Annotated[bool, option("-q --quiet", "Do not print the page's name.")] = False,
) -> None:
    """Write one HTML page about an output: pictures, profiles, Hardy against virial, errors, warnings, the scene; of a
    twin its material, norms and differences."""
    from ..analysis.page import report as write

    path = write(out, output, species=species, units=units)
    if not quiet:
        print(path)
