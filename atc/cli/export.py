"""``atc export``: outputs for ParaView, OVITO and others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import Begin, End, Species, Step, argument, option


def export(
    out: Annotated[Path, argument("OUT", "Output of atc fields or atc pd.")],
    output: Annotated[
        Path | None, option("-o --output FILE", "What to write: .pvd (default), .vtu, .vti, .vts, .grid or .extxyz.")
    ] = None,
    quantity: Annotated[
        str | None, option("-q --quantity NAMES", "Which fields, separated by commas; default all.")
    ] = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    species: Species = None,
    quiet: Annotated[bool, option("--quiet", "Do not print the file's name.")] = False,
) -> None:
    """Write an output for ParaView (VTK), OVITO (.grid: LAMMPS's dump grid) or as extended XYZ."""
    from ..export.export import export as write

    if step is not None and step < 1:
        raise AtcError(f"--step {step}: expected a whole number, 1 or more")
    names = [q.strip() for q in quantity.split(",")] if quantity else None
    path = write(out, output, quantities=names, frames=slice(begin, end, step), species=species)
    if not quiet:
        print(path)
