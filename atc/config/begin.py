"""A first scene for a run: what its files say, sensible numbers for the rest, and comments that say what to change."""

from __future__ import annotations

import math
import os
from glob import has_magic
from pathlib import Path

from ..errors import AtcError
from .toml import toml_key, toml_value

#: Atoms that a kernel of the radius proposed holds, and points of the grid at most.
_IN_REACH, _POINTS = 60, 250_000
#: Points across the kernel's diameter.
_ACROSS = 8


def scene_for(files, model, target, topology=None, units=None, masses=None) -> tuple[str, str]:
    """The text of a scene, and in one line what it will compute.

    Parameters
    ----------
    files : paths of the trajectory. model : path of the LAMMPS script, or of a nep.txt, or None
    target : where the scene will stand, which its paths are relative to
    topology, units, masses : as for `atc.read`, where the files do not say them

    Raises
    ------
    AtcError for whatever would be wrong with the scene.
    """
    from .scene import Scene

    folder = Path(target).parent
    trajectory: dict = {
        "file": _relative(files[0], folder) if len(files) == 1 else [_relative(f, folder) for f in files]
    }
    if units is not None:
        trajectory["units"] = units
    if topology is not None:
        trajectory["topology"] = _relative(topology, folder)
    if masses is not None:
        trajectory["masses"] = masses if isinstance(masses, list) else {str(k): v for k, v in masses.items()}
    potential: dict = {}
    if model is not None:
        nep = Path(model).read_bytes()[:3] == b"nep"
        potential = {"nep" if nep else "input": _relative(model, folder)}
    data: dict = {"trajectory": trajectory, **({"potential": potential} if potential else {})}
    scene = Scene.load(data)
    scene.folder = folder
    traj, pot = scene.trajectory(), scene.potential()
    frame = traj[0]
    if pot is not None:
        from ..readers.planar import matched

        frame = matched(frame, pot)[0]
        frame = pot.complete(frame)
    u = frame.units
    if units is None and not scene.get("trajectory", "units") and u.name not in ("ase", "mdanalysis"):
        trajectory["units"] = u.name
    flat = u.dimension == 2
    radius = _radius(frame)
    shape = _shape(frame, radius)
    quantities, left_out = _quantities(frame, pot)
    many = len(traj) > 1
    out = [
        f"# A scene for {', '.join(Path(f).name for f in files)}: {len(frame)} atoms, {len(traj)} "
        f"frame{'s' * many}, {u.name} units (stress in {u.label('pressure')}).",
        "# atc plan says what it does and how long it takes, atc fields computes, atc report shows.",
        "",
        "[trajectory]",
        *_table(trajectory),
        '# frames = "0:100:5"       # of a long run a part: begin, end, step',
    ]
    if frame.given.get("cell") == "none":
        out += ["# The file has no cell: if the run was periodic, say which one.", '# cell = [20.0, 20.0, 20.0]',
                '# pbc = "ppp"']  # fmt: skip
    out += [""]
    if potential:
        out += ["[potential]", *_table(potential), ""]
    else:
        out += [
            "# Stress needs a potential: the script of the run, or its pair lines.",
            "# [potential]",
            '# input = "in.run"',
            "",
        ]
    length = u.label("length")
    if pot is not None and pot.fields:
        # The modes of others go much further.
        kernel = 'name = "gaussian"          # with long-range Coulomb much the quickest, and what atc check takes'
    else:
        kernel = 'name = "quartic"           # others: lucy, gaussian, hardy, ...'
    out += [
        "[kernel]",
        kernel,
        f"radius = {radius:g}".ljust(27) + f"# {length}; about {_IN_REACH} atoms: wider is smoother, narrower sharper",
        "",
        "[grid]",
        'kind = "regular"           # others: slab (a profile), plane, line, points, atoms',
        f"shape = {toml_value(shape)}".ljust(27) + f"# points {_step(frame, shape):.2g} {length} apart",
    ]
    if not frame.cell.periodic[: u.dimension].all():
        out += ['padding = "auto"           # the kernel carries what surface atoms have beyond the open faces']
    out += ["", "[fields]", f"quantities = {toml_value(quantities)}"]
    out += [f"# {line}" for line in left_out]
    out += ["tolerance = 1e-4           # of the largest value of each field; measured, and kept"]
    if many:
        out += ["average = true             # the mean of all frames with its error; false: every frame"]
    out += [
        "",
        "# [select]                 # fields of some atoms, or of each species",
        "# types = [1]",
        '# by = "type"',
        "",
        "[output]",
        f'file = "{_output_name(files[0] if Path(target).stem == "scene" else target)}"',
        '# units = "GPa, nm"        # or "metal-gpa"' if not u.reduced else "# (lj units have no others)",
        "",
    ]
    text = "\n".join(out)
    made = Scene.loads(text, name=str(target), folder=folder)
    made.require_complete()
    return text, f"{', '.join(quantities)} at {' x '.join(map(str, shape))} points" + (
        ", averaged over all frames" if many else ""
    ) + (" (two dimensions)" if flat else "")


def _relative(path, folder) -> str:
    path = Path(path)
    try:
        return Path(os.path.relpath(path if has_magic(str(path)) else path.resolve(), folder.resolve())).as_posix()
    except ValueError:  # another drive
        return path.as_posix()


def _output_name(file) -> str:
    name = Path(str(file).replace("*", "")).name
    stem = name.split(".")[0] or "fields"
    return f"{stem}-fields.nc"


def _table(table):
    return [f"{toml_key(k)} = {toml_value(v)}" for k, v in table.items()]


def _occupied(frame) -> float:
    """The volume (area) of the box around the atoms, in the cell."""
    import numpy as np

    cell, d = frame.cell, frame.dimension
    s = cell.fractional(cell.wrap(frame.positions)[0])
    extent = [1.0 if cell.periodic[k] else max(float(np.ptp(s[:, k])), 1e-3) for k in range(d)]
    whole = cell.volume if d == 3 else cell.volume / np.linalg.norm(cell.vectors[2])
    return float(whole * np.prod(extent))


def _radius(frame) -> float:
    """A radius, in the user's units, that holds `_IN_REACH` atoms at the mean density; two digits."""
    if not len(frame):
        raise AtcError(f"{frame.source}: there are no atoms")
    each = _occupied(frame) / len(frame)
    ball, inverse = (4 * math.pi / 3, 1 / 3) if frame.dimension == 3 else (math.pi, 0.5)
    r = (_IN_REACH * each / ball) ** inverse
    r = frame.units.to_user("length", r)
    digits = 1 - math.floor(math.log10(r))
    return round(r, digits)


def _shape(frame, radius) -> list[int]:
    """Numbers of points: an eighth of the kernel's diameter apart, fewer where that would be too many."""
    lengths = frame.units.to_user("length", frame.cell.heights[: frame.dimension])
    step = 2 * radius / _ACROSS
    step = max(step, (math.prod(lengths) / _POINTS) ** (1 / len(lengths)))
    return [max(1, round(length / step)) for length in lengths]


def _step(frame, shape) -> float:
    lengths = frame.units.to_user("length", frame.cell.heights[: frame.dimension])
    return float(max(a / n for a, n in zip(lengths, shape)))


def _quantities(frame, pot) -> tuple[list[str], list[str]]:
    """What can be computed, and lines that say what cannot, or could be added."""
    moving, heavy = frame.velocities is not None, frame.masses is not None
    full = moving and heavy
    part = "" if full else "_potential"
    out, lines = [], []
    if pot is not None:
        out += [f"stress{part}", f"virial_stress{part}"]
        if pot.central and not pot.fields:
            out += [f"smoothed_virial_stress{part}"]
    out += ["density"] if heavy else ["number_density"]
    if full:
        out += ["temperature", "velocity"]
        if pot is not None:
            lines.append('more: "heat_flux", "energy", "velocity_gradient", ... (the README has all of them)')
    else:
        missing = " and ".join(["velocities"] * (not moving) + ["masses"] * (not heavy))
        lines.append(f"the trajectory has no {missing}: kinetic parts and temperature need them")
    return out, lines
