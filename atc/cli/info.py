"""``atc info``: what is in a trajectory, a scene or an output."""

from __future__ import annotations

from typing import Annotated

from ..errors import AtcError
from .common import Json, Masses, SceneFlags, Topology, UnitsOption, argument, option, parse_masses, show


def info(
    trajectory: Annotated[
        list[str],
        argument(
            "TRAJ...",
            "A trajectory: LAMMPS dump or data file, or anything ASE or MDAnalysis reads; several files are "
            "joined. Or a scene.",
        ),
    ],
    topology: Topology = None,
    units: UnitsOption = None,
    masses: Masses = None,
    dimension: Annotated[int | None, option("--dimension 2|3", "2: a run in the plane (LAMMPS's dimension 2).")] = None,
    atom_style: Annotated[
        str | None, option("--atom-style STYLE", "What the columns of a LAMMPS data file are, e.g. full.")
    ] = None,
    json: Json = False,
) -> None:
    """What is in a trajectory, in which units, how precise, and what can be computed from it; or what is in an output
    of atc.

    Of a scene also whether the forces in its trajectory are those of its potential.
    """
    from ..analysis.info import describe, describe_output, describe_scene, is_output

    if len(trajectory) == 1 and is_output(trajectory[0]):
        report = describe_output(trajectory[0])
    elif len(trajectory) == 1 and trajectory[0].endswith(".toml"):
        given = {"topology": topology, "units": units, "masses": masses, "dimension": dimension}
        given |= {"atom-style": atom_style}
        given = [f"--{name}" for name, value in given.items() if value is not None]
        if given:
            raise AtcError(f"{given[0]} goes with a trajectory; in a scene it is a key of [trajectory]")
        report = describe_scene(SceneFlags().load(trajectory[0]))
    else:
        source = trajectory if len(trajectory) > 1 else trajectory[0]
        how = {"topology": topology, "units": units, "dimension": dimension, "atom_style": atom_style}
        report = describe(source, masses=parse_masses(masses), **how)
    show(report, json)
