"""``atc init``: a scene with comments, ready to run, from what a run left behind."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import Masses, Overwrite, Topology, UnitsOption, argument, option, parse_masses


def init(
    trajectory: Annotated[list[str], argument("TRAJ... [SCRIPT]", "The trajectory, and the LAMMPS script.")],
    output: Annotated[
        Path | None, option("-o --output SCENE", "The scene to write; default scene.toml beside TRAJ.")
    ] = None,
    topology: Topology = None,
    units: UnitsOption = None,
    masses: Masses = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a scene with comments for a trajectory and the LAMMPS script of its run (or its nep.txt).

    It is ready for atc plan and atc fields."""
    from ..config.begin import scene_for

    *files, last = trajectory
    model = None
    if files and _is_model(last):
        model, trajectory = last, files
    target = output or Path(trajectory[0]).parent / "scene.toml"
    if target.suffix != ".toml":
        raise AtcError(f"-o {target}: expected a name that ends in .toml")
    if target.exists() and not overwrite:
        raise AtcError(f"{target} exists: give --overwrite to replace it, or another name with -o")
    if not target.parent.is_dir():
        raise AtcError(f"-o {target}: there is no directory {target.parent}")
    text, said = scene_for(trajectory, model, target, topology=topology, units=units, masses=parse_masses(masses))
    target.write_text(text)
    print(f"{target}: {said}")
    print(f"next: atc plan {target}   then: atc fields {target}")


def _is_model(path: str) -> bool:
    """Whether a file is a LAMMPS script or a neuroevolution potential, and no trajectory."""
    try:
        head = Path(path).read_bytes()[:65536]
    except OSError as e:
        raise AtcError(f"{path}: cannot be read: {e.strerror or e}") from None
    if head[:3] == b"nep" or b"\x00" in head:
        return head[:3] == b"nep"
    lines = head.decode("utf-8", "replace").splitlines()
    first = {line.split()[0] for line in lines if line.split() and not line.lstrip().startswith("#")}
    return bool(first & {"pair_style", "pair_coeff", "units", "read_data", "read_restart", "include", "run"})
