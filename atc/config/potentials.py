"""The model of the interactions that a scene means: LAMMPS lines, a script, a learned model, another code's system."""

from __future__ import annotations

import os
import re

from .trajectories import files, listed, whole

#: What makes a potential of a learned model's file, or of a name, and what else [potential] may tell it.
LEARNED = {
    "nep": ("types", "reference"),
    "mace": ("types", "head", "stress", "reference", "device"),
    "nequip": ("types", "stress", "reference", "device"),
    "metatomic": ("types", "stress", "reference", "device"),
    "kim": ("types",),
}
#: Systems of other codes, and what [potential] may tell of the run besides.
RUN = ("method", "cutoff", "switch", "switching", "chiral", "constraints", "rigid_water")
SYSTEMS = {
    "openmm": ("switching", "chiral"),
    "prmtop": RUN,
    "psf": ("parameters", *RUN),
    "top": ("defines", "include", *RUN),
}


def potential(scene):
    """The model of the interactions; None if the scene has none. Files it names are relative to the scene."""
    if "potential" not in scene.data:
        return None
    from .. import potential

    units, partition = scene.get("potential", "units"), scene.get("potential", "partition")
    for maker in LEARNED:
        if maker in scene.data["potential"]:
            return _shared(scene, _learned(scene, maker), partition)
    for kind in SYSTEMS:
        if kind in scene.data["potential"]:
            return _shared(scene, _of_system(scene, kind), partition)
    path = scene.path("potential", "input")
    if path is not None:
        if not os.path.isfile(path):
            raise scene.bad(("potential", "input"), f"there is no file {path}")
        return _shared(scene, _of_script(scene, path, units), partition)
    text = scene.data["potential"]["lammps"]
    if units is None and "trajectory" in scene.data and not re.search(r"^\s*units\s", text, re.MULTILINE):
        units = scene.get("trajectory", "units") or whole(scene).units.name
    # Empty lines in front, so that what is wrong with line 3 of the text is reported at its line of the scene.
    line = 0
    if ("potential", "lammps") not in scene.flags:
        line = scene.lines.get(("potential", "lammps"), 0)
        opening = scene.text.split("\n")[line - 1].partition("=")[2].strip() if line else ""
        line -= bool(line) and opening not in ('"""', "'''")
    name = scene.flags.get(("potential", "lammps"), scene.name)
    return _shared(scene, potential("\n" * line + text + "\n", units=units, folder=scene.folder, name=name), partition)


def _learned(scene, maker):
    """The machine-learned potential that is named."""
    import atc

    options = {k: v for k in LEARNED[maker] if (v := scene.get("potential", k)) is not None}
    with scene.placed_at("potential", maker):
        # A model of KIM has a name, the others are files.
        model = scene.get("potential", maker) if maker == "kim" else scene.path("potential", maker)
        return getattr(atc, maker)(model, **options)


def _of_system(scene, kind):
    """The potential of another code's system, read once."""
    from ..decomposers.openmm import potential_from_openmm

    options = {k: v for k in SYSTEMS[kind] if (v := scene.get("potential", k)) is not None}
    if "parameters" in options:
        options["parameters"] = tuple(scene.paths("potential", "parameters"))
    if "include" in options:
        options["include"] = scene.path("potential", "include")
    path = scene.path("potential", kind)
    key = (path, str(options))
    if scene.made[0] != key:
        with scene.placed_at("potential", kind):
            scene.made = (key, potential_from_openmm(path, kind, **options))
    return scene.made[1]


def _of_script(scene, path, units):
    """The potential of a script: read once, for the trajectory needs it too."""
    from .. import potential

    run, of = scene.get("potential", "run"), files(scene)
    key = (path, units, run, str(of))
    if scene.made[0] != key:
        scene.made = (key, potential(path, units=units, run=run, trajectory=listed(of)))
    return scene.made[1]


def _held(scene, pot):
    """The potential with the constraints of the scene."""
    table = dict(scene.data.get("constraints", {}))
    if not table:
        return pot
    from ..decomposers.constraints.scene import constrained
    from ..units import units

    if isinstance(table.get("pairs"), str):
        table["pairs"] = scene.columns("constraints", "pairs", 2).astype(int).tolist()
    named = bool({"bonds", "pairs"} & {*table}) or bool(table.get("molecules"))
    if table.get("topology") and named:
        raise scene.bad(("constraints", "topology"), "bonds, molecules and pairs say it, too: leave one of them out")
    if table.get("topology") is False and pot.constraints is None and not named:
        return pot.constrained(None)
    if pot.constraints is None and not named and not _says_constraints(scene):
        raise scene.need("constraints", "the potential has none: say what is held: bonds, molecules or pairs")
    own = scene.get("trajectory", "units")
    return constrained(pot, table, units(own) if own else pot.units, f"{scene.where('constraints')}: [constraints]")


def _says_constraints(scene) -> bool:
    """Whether the topology is of the kind that says which distances the run held."""
    names = [*listed(files(scene)), scene.get("trajectory", "topology")]
    return any(str(name).lower().endswith(".tpr") for name in names if name is not None)


def _shared(scene, pot, partition):
    pot, alpha = _held(scene, pot), scene.get("potential", "alpha")
    if alpha is not None:
        from ..decomposers.long_range.kspace import with_alpha

        with scene.placed_at("potential", "alpha"):
            pot = with_alpha(pot, alpha)
    if partition is None:
        return pot
    with scene.placed_at("potential", "partition"):
        return pot.partitioned(partition)
