"""``atc export``: outputs for ParaView, OVITO and others."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import AtcError
from .common import Begin, End, Step


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(export)


def export(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Output of atc fields or atc pd.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="What to write: .pvd (default), .vtu, .vti, .vts, .grid or .extxyz.",
            show_default=False,
        ),
    ] = None,
    quantity: Annotated[
        str | None,
        typer.Option(
            "-q",
            "--quantity",
            metavar="NAMES",
            help="Which fields, separated by commas; default all.",
            show_default=False,
        ),
    ] = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Do not print the file's name.")] = False,
) -> None:
    """Write an output for ParaView (VTK), OVITO (.grid: LAMMPS's dump grid) or as extended XYZ."""
    from ..export.export import export as write

    if step is not None and step < 1:
        raise AtcError(f"--step {step}: expected a whole number, 1 or more")
    names = [q.strip() for q in quantity.split(",")] if quantity else None
    path = write(out, output, quantities=names, frames=slice(begin, end, step))
    if not quiet:
        print(path)
