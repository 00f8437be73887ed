"""`twin`: from a scene of a molecular-dynamics run to its peridynamic twin, run and compared."""

from __future__ import annotations

import time
import warnings
from copy import copy

import numpy as np

from ..config.scene import Scene
from ..errors import AtcWarning, heard
from ..upscaling.crystal import evaluate
from .body import body_of, body_of_atoms
from .choice import atoms_horizon, horizon_of, orientation, twin_material
from .comparison import (
    add_constants,
    add_norms,
    away_from_surfaces,
    dataset_of,
    fields_of_atoms,
    norms,
    without_cohesion,
)
from .conditions import Run, clock, gripped, require_moved
from .crack import notches_of, require_crossed
from .description import lines_of
from .inputs import crystal_of, indenter_of, inputs_of
from .linear import kept_place
from .motion import SAFETY, advance, grips_of, start
from .nodes import add_nodes, classical_of, nodes_line
from .outside import from_script
from .record import Record
from .result import Twin, cost_line
from .same_crystal import require_same_crystal

__all__ = ["SAFETY", "Twin", "twin"]


def twin(scene, *, set=None, tell=None, progress=None) -> Twin:
    """The peridynamic twin of the run of a scene, run under the run's own conditions and compared with it.

    Parameters
    ----------
    scene : path of a scene, a mapping or a Scene, with [trajectory] (and its reference), [potential], [kernel], [grid]
        and [twin]
    set : overrides, as for `Scene.load`
    tell : called with each line that says what body, material and conditions are, before anything is run
    progress : callable(done, total, rate), frames

    Returns
    -------
    Twin

    Raises
    ------
    AtcError where the scene lacks something, the reference's atoms are not the run's, or nodes do not sample the
    material.

    Notes
    -----
    Body, conditions and comparison: see ``docs/twin.md``. The twin is cold: the kinetic part of the MD's stress, its
    thermal expansion and its thermal softening have no counterpart in it.
    """
    scene = scene if isinstance(scene, Scene) and not set else Scene.load(scene, set)
    with heard() as warned:
        found = _twin(scene, tell or (lambda line: None), progress or (lambda *done: None))
    found.dataset.attrs["warnings"] = "\n".join(dict.fromkeys(warned))
    return found


def _twin(scene, tell, progress) -> Twin:
    began = time.perf_counter()
    get = lambda key, default=None: scene.get("twin", key, default)  # noqa: E731
    given = inputs_of(scene)
    traj, pot, reference = given.traj, given.pot, given.reference
    u, motion = traj.units, get("motion", "dynamic")
    # A crystal is no frame of the script's run: what the script says of single atoms is not for it.
    law = copy(pot)
    law.setup = None
    crystal = crystal_of(scene, get, reference, law, u)
    made = _body(scene, get, given, crystal, law)
    made_from = time.process_time()
    axes = orientation(scene, reference.dimension)
    material = twin_material(get, crystal, law, axes, made, reference, scene.equilibrium)
    cost = {"nodes": len(made.body), "steps": 0, "material": time.process_time() - made_from, "seconds": 0.0}

    run = Run(traj, reference)
    frames = [run[k] for k in range(len(run))]
    _require_steps(scene, get, motion)
    times = np.arange(float(len(frames)))
    if motion == "dynamic" or get("indenter_velocity") is not None:
        times = clock(frames, get("timestep") and u.to_internal("time", get("timestep")))
    held, script = _held(scene, get, given, made)
    require_moved(frames, reference, made, held)
    sim = start(
        frames[0], reference, made, material, grips_of(held, frames, reference, made, times), script.forces, motion
    )
    lines = lines_of(get, given, made, material, held.any(axis=1), sim, frames, script.lines)
    for line in lines:
        tell(line)

    names = ["density", "displacement", *(["velocity"] if motion == "dynamic" else []), "stress", "energy"]
    record = Record(scene, get, given, made, crystal, material, sim, frames, times, script.forces, names)
    for k in range(len(frames)):
        before = time.process_time()
        cost["steps"] += advance(sim, frames, times, k, motion, get("safety", SAFETY))
        cost["seconds"] += time.process_time() - before
        record.take(k)
        progress(k + 1, len(frames), (k + 1) / (time.perf_counter() - began))

    md = fields_of_atoms(scene, run, frames, pot, given.kern, given.grid, names, reference)
    data = dataset_of(md, record.fields, names)
    cohesion = evaluate(law, crystal.frame())[0] / crystal.masses.sum()
    without_cohesion(data, ("md", "pd") if material.carries_atoms else ("md",), u, cohesion)
    said = record.add_to(data)
    acted = bool(held.any() or script.forces or motion == "static")
    waves = classical_of(made, material, reference, frames, times, record.md_nodes[0], acted)
    add_nodes(data, u, made, record.md_nodes, record.pd_nodes, waves)
    if waves is not None:
        said.append(nodes_line(data))
    for line in said:
        tell(line)
    rows = _compared(data, given, crystal, material, sim, names, motion == "dynamic" and len(frames) > 1)
    lines += said
    data.attrs.update(
        name=scene.name,
        title="a molecular-dynamics run and its peridynamic twin",
        twin="\n".join(lines),
        kernel=md.attrs.get("kernel", ""),
        grid=md.attrs.get("grid", ""),
        scene=scene.to_toml(),
        bulk_density=float(data["bulk_density"]),
        nodes=len(made.body),
        motion=motion,
        cost=cost_line(cost),
        **{f"{r['field']}_{r['where']}_{k}": r[k] for r in rows for k in ("difference_rms", "relative")},
    )
    return Twin(data, rows, lines, made, material, sim, scene.name, cost)


def _body(scene, get, given, crystal, law):
    """The `TwinBody`: nodes of the reference's atoms, or these themselves."""
    reference, length = given.reference, given.traj.units.factor("length")
    axes, turned = orientation(scene), get("material", "isotropic") != "isotropic"
    require_same_crystal(reference, crystal, axes, get("structure"), scene.where("twin", "structure"), turned)
    spacing = length * (get("spacing") or crystal.lattice_constant)
    horizon = length * get("horizon") if get("horizon") else None
    if get("nodes") == "atoms":
        return body_of_atoms(reference, crystal.density, horizon or atoms_horizon(get, crystal, law))
    notches = notches_of(scene, get, length, reference.dimension)
    through = None
    if get("material") == "coarsened":
        through = kept_place(reference, crystal, orientation(scene, reference.dimension))
    kernel = given.kern.scaled(length)
    made = body_of(reference, kernel, crystal.density, spacing, horizon, horizon_of(get), notches, through)
    require_crossed(scene, made.body)
    return made


def _require_steps(scene, get, motion) -> None:
    """Warn of a material whose waves are too slow; refuse steps where there are none."""
    if motion == "dynamic" and get("material") == "coarsened":
        warnings.warn(
            "[twin] material: coarsened springs are those of rest: waves of theirs are too slow (see the errors of ω): "
            'take material = "linear" for waves, or motion = "static"',
            AtcWarning,
            stacklevel=4,
        )
    if motion == "static" and get("safety") is not None:
        raise scene.bad(("twin", "safety"), "of steps in time, which a static twin has not")


def _held(scene, get, given, made):
    """(n, 3) which components of nodes are held, by [twin] or by the script; and what the script does."""
    reference, length = given.reference, given.traj.units.factor("length")
    boxes = [np.array(b, float) * length for b in get("grips", [])]
    grips = gripped(made, reference, boxes, get("grip_types", []))
    indenter = indenter_of(scene, get, given.traj.units)
    script = from_script(given.pot, reference, made, indenter, bool(grips.any()))
    held = np.repeat(grips[:, None], 3, axis=1)
    for c in range(3) if script.held_nc.any() else ():
        held[:, c] |= made.smoothing.share(script.held_nc[:, c]) >= 0.5
    return held, script


def _compared(data, given, crystal, material, sim, names, each_frame) -> list:
    """Norms of the differences, elastic constants and the crystal's density into the dataset; the norms."""
    u = given.traj.units
    bulk = float(u.to_user("density", crystal.density))
    bound = given.grid.bind(u, sim.cell)
    reach = given.kern.scaled(u.factor("length")).support
    deep = away_from_surfaces(sim, bound.points_gc, reach).reshape(bound.shape)
    rows = norms(data, names, bulk, deep, each_frame)
    add_norms(data, rows, each_frame)
    add_constants(data, u, material)
    data["bulk_density"] = ((), bulk, {"units": u.label("density"), "long_name": "density of the crystal at rest"})
    return rows
