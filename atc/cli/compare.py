"""``atc compare``: Hardy's stress against the virial stress, or fields against LAMMPS's own averages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import (
    Jobs,
    PublishedUnits,
    Quiet,
    SceneFlags,
    Species,
    argument,
    option,
    parse_numbers,
    progress_bar,
    show,
)


def compare(
    what: Annotated[
        list[Path],
        argument(
            "OUT...|SCENE",
            "Outputs of atc fields; or one and a file of LAMMPS (dump grid, fix ave/chunk); or a scene together "
            "with --radii.",
        ),
    ],
    flags: SceneFlags,
    radii: Annotated[
        str | None, option("--radii R1,R2,...", "Compute the scene's stress for these kernel radii and compare them.")
    ] = None,
    jobs: Jobs = 1,
    picture: Annotated[Path | None, option("--picture FILE", "Where the picture goes; default: next to OUT.")] = None,
    column: Annotated[
        list[str] | None,
        option(
            "--column 'FIELD = COLUMN'",
            "Which field a column of LAMMPS is, e.g. 'stress_xx = f_1:grid:data[2]', or a product: "
            "'smoothed_virial_stress_xx = c_st[1] * density/number'. Repeatable.",
        ),
    ] = None,
    json: Annotated[bool, option("--json", "The table as JSON.")] = False,
    csv: Annotated[bool, option("--csv", "The table as CSV.")] = False,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Quiet = False,
) -> None:
    """Hardy's stress against the virial stress, or fields against LAMMPS's own averages: a table and a picture."""
    from ..analysis.against_lammps import compare_with_lammps
    from ..analysis.compare import compare as compare_output
    from ..analysis.compare import compare_radii
    from ..analysis.comparison import side_by_side
    from ..readers.lammps.grid import is_grid

    if json and csv:
        raise AtcError("give --json or --csv, not both")
    if radii is not None:
        if len(what) != 1:
            raise AtcError("--radii goes with one scene: atc compare SCENE --radii 4,6,8")
        made = flags.load(what[0], selects=True)
        lengths = parse_numbers(
            "--radii",
            radii,
            "lengths greater than 0 in the trajectory's units, e.g. --radii 4,6,8,10",
            lambda values: values and min(values) > 0,
        )
        with progress_bar(quiet or json or csv) as progress:
            result = compare_radii(made, lengths, jobs=jobs, progress=progress)
    else:
        for path in what:
            if path.suffix == ".toml":
                raise AtcError(
                    f"{path}: is a scene; give it with --radii (atc compare {path} --radii 4,6,8), or give the output "
                    "of atc fields"
                )
        if flags != SceneFlags():
            raise AtcError("--set, -b, -e and --step go with a scene and --radii; an output is compared as it is")
        if len(what) == 2 and what[1].suffix not in (".nc", ".zarr") and is_grid(what[1]):
            result = compare_with_lammps(what[0], what[1], column)
        elif column:
            raise AtcError("--column goes with an output and a file of LAMMPS: atc compare OUT FILE --column ...")
        else:
            results = [compare_output(path, species=species, units=units) for path in what]
            result = results[0] if len(results) == 1 else side_by_side(results)
    target = picture or what[0].with_name(what[0].stem + "-compare.png")
    result.picture(target)
    show(result, json, csv)
    if not (quiet or json or csv):
        print(f"picture: {target}")
