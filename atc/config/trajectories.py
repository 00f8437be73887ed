"""The frames that a scene means: its trajectory, reference, run in equilibrium, and logs."""

from __future__ import annotations

import os
from pathlib import Path

from ..errors import AtcError
from .toml import shown
from .words import frame_slice

#: Formats that hold coordinates and do not say whose.
_BARE = {f".{w}" for w in "dcd xtc trr nc ncdf mdcrd crdbox trj tng inpcrd rst7 coor".split()}


def trajectory(scene):
    """The frames asked for, as `atc.read` gives them. `AtcError` if there are none."""
    traj = whole(scene)
    frames = scene.get("trajectory", "frames")
    if streams(scene):
        if frames is not None:
            raise scene.bad(("trajectory", "frames"), "a stream has no numbered frames: leave it out")
        return traj
    part = traj if frames is None else traj[frame_slice(frames)]
    if len(part) == 0:
        why = f"{traj.source} has {len(traj)} complete frame{'s' * (len(traj) != 1)}, numbered from 0"
        said = "all" if frames is None else shown(frames)
        raise scene.bad(("trajectory", "frames"), f"{said} selects none: {why}")
    return part


def whole(scene):
    """All frames, completed by what the script says."""
    from ..readers.memory import completed

    if streams(scene):  # opened once; whoever takes its frames completes them
        if scene.stream is None:
            scene.stream = read_at(scene, files(scene), "file")
        return scene.stream
    traj, pot = read_at(scene, files(scene), "file"), script(scene)
    if pot is not None and pot.timestep is not None and scene.get("trajectory", "timestep") is None:
        from ..readers.declared import Declared

        traj = Declared(traj, timestep=traj.units.to_user("time", pot.timestep))
    return completed(traj, pot)


def streams(scene) -> bool:
    """Whether the frames come from a running simulation, by its address."""
    given = scene.get("trajectory", "file")
    return isinstance(given, str) and given.startswith("imd://")


def files(scene):
    """The path of the trajectory, or the paths of its files; or the address of a stream."""
    given = scene.get("trajectory", "file")
    if streams(scene):
        return given
    if isinstance(given, str):
        return scene.path("trajectory", "file")
    return scene.paths("trajectory", "file")


def read_at(scene, path, key):
    """The trajectory at a path that this key of [trajectory] names."""
    from .. import read
    from ..readers.chain import matching

    for one in [] if str(path).startswith("imd://") else listed(path):
        with scene.value_of("trajectory", key):
            if matching(one) is None and not os.path.exists(one):
                raise AtcError(f"there is no file {one}")
    topology = scene.path("trajectory", "topology")
    if topology is None:
        topology = _topology_of_system(scene, path)
    if topology is not None and not os.path.exists(topology):
        raise scene.bad(("trajectory", "topology"), f"there is no file {topology}")
    try:
        return _open(scene, read, path, topology)
    except AtcError as e:
        named = any(str(one) in str(e) for one in listed(path))
        if topology is not None and str(topology) in str(e):
            key = "topology"
        raise AtcError(str(e) if named else f"{scene.where('trajectory', key)}: {e}") from None


def _topology_of_system(scene, path):
    """The file of [potential] that says whose coordinates these are, where the trajectory does not."""
    if all(Path(one).suffix.lower() in _BARE for one in listed(path)):
        return next((p for k in ("prmtop", "psf") if (p := scene.path("potential", k)) is not None), None)
    return None


def listed(path) -> list:
    """One path, or a list of them, as a list."""
    return path if isinstance(path, list) else [path]


def _open(scene, read, path, topology):
    """The trajectory; where neither it nor the scene says its units or atom style, those of the script that made
    it."""
    units, masses = scene.get("trajectory", "units"), scene.get("trajectory", "masses")
    more = {k: scene.get("trajectory", k) for k in ("dimension", "atom_style", "cell", "pbc", "timestep")}
    try:
        return read(path, topology=topology, units=units, masses=masses, **more)
    except AtcError as e:
        pot = script(scene)
        if pot is None:
            raise
        more["atom_style"] = more["atom_style"] or pot.atom_style or None
        try:
            return read(path, topology=topology, units=units or pot.units.name, masses=masses, **more)
        except AtcError as again:
            data = pot.setup.data_files if pot.setup is not None else []
            # Plain XYZ of a run whose box is in the script's data file.
            if "give it as cell" not in str(again) or len(data) != 1 or not data[0].is_file():
                raise e from None
            return read(path, topology=data[0], units=units or pot.units.name, masses=masses, **more)


def script(scene):
    """The potential of the scene's LAMMPS script, None if it has none."""
    return scene.potential() if scene.get("potential", "input") is not None else None


def reference(scene):
    """The reference frame, or None: the index counts from the trajectory's first frame, whatever `frames` selects;
    of a file, its first frame."""
    value = scene.get("trajectory", "reference")
    if value is None:
        return None
    if isinstance(value, str):
        return read_at(scene, scene.path("trajectory", "reference"), "reference")[0]
    traj = whole(scene)
    if not -len(traj) <= value < len(traj):
        why = f"there is no frame {value}: {traj.source} has {len(traj)}, numbered from 0"
        raise scene.bad(("trajectory", "reference"), why)
    return traj[value]


def equilibrium(scene):
    """The run that [twin] measures springs in: that of `equilibrium`, else the scene's own."""
    if scene.get("twin", "equilibrium") is None:
        return trajectory(scene)
    path = scene.path("twin", "equilibrium")
    if path is None or not os.path.exists(path):
        raise scene.bad(("twin", "equilibrium"), f"there is no file {path}")
    from .. import read

    return _open(scene, read, path, None)


def log(scene):
    """The log files of the run, as a list of paths; None if the scene names none."""
    paths = scene.paths("trajectory", "log")
    for path in paths:
        if not os.path.isfile(path):
            raise scene.bad(("trajectory", "log"), f"there is no file {path}")
    return paths or None
