"""`twin`: from a scene of a molecular-dynamics run to its peridynamic twin, run and compared."""

from __future__ import annotations

import time
import warnings
from copy import copy

import numpy as np

from ..config.scene import Scene
from ..errors import AtcError, AtcWarning, heard
from ..frame import Frame
from ..upscaling.crystal import evaluate
from .body import body_of, body_of_atoms
from .choice import atoms_horizon, horizon_of, orientation, twin_material
from .comparison import (
    add_constants,
    add_norms,
    away_from_surfaces,
    dataset_of,
    fields_of_atoms,
    fields_of_nodes,
    norms,
    without_cohesion,
)
from .conditions import (
    Run,
    clock,
    gripped,
    require_moved,
    smoothed_displacement,
)
from .crack import add_crack, crack_lines, crack_of, notches_of, require_crossed
from .damage import NearestBonds, add_damage, on_grid
from .description import lines_of
from .inputs import crystal_of, indenter_of, inputs_of
from .linear import kept_place
from .motion import SAFETY, advance, grips_of, start
from .nodes import add_nodes, classical_of, nodes_line
from .outside import add_indenters, from_script, indenters
from .result import Twin, cost_line
from .same_crystal import require_same_crystal


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
        found = _twin(scene, tell, progress)
    found.dataset.attrs["warnings"] = "\n".join(dict.fromkeys(warned))
    return found


def _twin(scene, tell, progress) -> Twin:

    began = time.perf_counter()
    get = lambda key, default=None: scene.get("twin", key, default)  # noqa: E731
    given = inputs_of(scene)
    traj, pot, kern, grid, reference = (given[k] for k in ("traj", "pot", "kern", "grid", "reference"))
    u = traj.units
    length = u.factor("length")
    kernel = kern.scaled(length)
    # A crystal is no frame of the script's run: what the script says of single atoms is not for it.
    law = copy(pot)
    law.setup = None
    crystal = crystal_of(scene, get, reference, law, u)
    axes, turned = orientation(scene), get("material", "isotropic") != "isotropic"
    require_same_crystal(reference, crystal, axes, get("structure"), scene.where("twin", "structure"), turned)
    spacing = length * get("spacing") if get("spacing") else u.to_internal("length", crystal.lattice_constant)
    horizon = length * get("horizon") if get("horizon") else None
    axes = orientation(scene, reference.dimension)
    if get("nodes") == "atoms":
        made = body_of_atoms(reference, crystal.density, horizon or atoms_horizon(get, crystal, law))
    else:
        notches = notches_of(scene, get, length, reference.dimension)
        through = None
        if get("material") == "coarsened":
            through = kept_place(reference, crystal, axes)
        made = body_of(reference, kernel, crystal.density, spacing, horizon, horizon_of(get), notches, through)
        require_crossed(scene, made.body)
    made_from = time.process_time()
    material = twin_material(get, crystal, law, axes, made, reference, scene.equilibrium)
    cost = {"nodes": len(made.body), "steps": 0, "material": time.process_time() - made_from, "seconds": 0.0}

    run = Run(traj, reference)
    frames = [run[k] for k in range(len(run))]
    step = get("timestep")
    motion, safety = get("motion", "dynamic"), get("safety", SAFETY)
    if motion == "dynamic" and get("material") == "coarsened":
        warnings.warn(
            "[twin] material: coarsened springs are those of rest: waves of theirs are too slow (see the errors of ω): "
            'take material = "linear" for waves, or motion = "static"',
            AtcWarning,
            stacklevel=3,
        )
    if motion == "static" and get("safety") is not None:
        raise AtcError(f"{scene.where('twin', 'safety')}: [twin] safety: of steps in time, which a static twin has not")
    times = np.arange(float(len(frames)))
    if motion == "dynamic" or get("indenter_velocity") is not None:
        times = clock(frames, step and u.to_internal("time", step))
    boxes = [np.array(b, float) * length for b in get("grips", [])]
    grips = gripped(made, reference, boxes, get("grip_types", []))
    script = from_script(pot, reference, made, indenter_of(scene, get, u), bool(grips.any()))
    held = np.repeat(grips[:, None], 3, axis=1)
    for c in range(3) if script.held_nc.any() else ():
        held[:, c] |= made.smoothing.share(script.held_nc[:, c]) >= 0.5
    require_moved(frames, reference, made, held)
    conditions = grips_of(held, frames, reference, made, times)
    sim = start(frames[0], reference, made, material, conditions, script.forces, motion)
    lines = lines_of(
        u,
        reference,
        pot,
        made,
        material,
        held.any(axis=1),
        motion,
        safety,
        sim,
        frames,
        script.lines,
        get("reference_stress"),
        get("fracture"),
    )
    for line in lines:
        if tell is not None:
            tell(line)

    bonds = NearestBonds(reference, crystal, made.body.notches) if get("fracture") else None
    # Nodes that carry atoms lose what bonds these lose.
    carried = (lambda: material.frame(sim)[0]) if material.carries_atoms else None
    crack = crack_of(scene, get, made, reference, kernel, bonds, sim, carried)
    md_damage, pd_damage, broken, tips, spent = [], [], [], [], []
    indenting, md_push, pd_push = indenters(script.forces), [], []
    md_nodes = [smoothed_displacement(f, reference, made.smoothing, made.body.X_nc) for f in frames]
    pd_nodes = []
    at_rest = None
    if get("reference_stress"):
        from .. import fields as fields_of

        stresses = ["stress_potential", "virial_stress_potential"]
        at_rest = fields_of([reference], pot, kern, grid, stresses, forces="ignore")
    found, names = [], ["density", "displacement", *(["velocity"] if motion == "dynamic" else []), "stress"]
    names.append("energy")
    for k in range(len(frames)):
        before = time.process_time()
        cost["steps"] += advance(sim, frames, times, k, motion, safety)
        cost["seconds"] += time.process_time() - before
        pd_nodes.append(sim.state.u_nc.copy())
        if indenting:
            md_push.append(-sum(law.on_atoms(frames[k], times[k]) for law in indenting))
            pd_push.append(-sum(law.force for law in indenting))
        with warnings.catch_warnings():
            if k:  # what is wrong with the grid has been said of the first
                warnings.simplefilter("ignore", AtcWarning)
            found.append(fields_of_nodes(sim, material, u, kern, grid, names, reference))
        if at_rest is not None:
            found[-1]["peridynamic_stress"].values += np.nan_to_num(at_rest["stress_potential"].values)
            found[-1]["virial_stress_potential"].values += at_rest["virial_stress_potential"].values
        if bonds is not None:
            points = grid.bind(u, frames[k].cell).points_gc
            mine = carried() if carried else _nodes(sim, u)
            lost = bonds.lost(frames[k]), bonds.lost(mine) if carried else sim.damage()
            md_damage.append(on_grid(frames[k], kernel, points, lost[0]))
            pd_damage.append(on_grid(mine, kernel, points, lost[1]))
            broken.append([d.mean() for d in lost])
            spent.append(sim.energies().dissipated_fracture)
        if crack is not None:
            tips.append(crack.measure(frames[k]))
        if progress is not None:
            progress(k + 1, len(frames), (k + 1) / (time.perf_counter() - began))
    md = fields_of_atoms(scene, run, frames, pot, kern, grid, names, reference)
    data = dataset_of(md, found, names)
    cohesion = evaluate(law, crystal.frame())[0] / crystal.masses.sum()
    without_cohesion(data, ("md", "pd") if material.carries_atoms else ("md",), u, cohesion)
    if bonds is not None:
        add_damage(data, md_damage, pd_damage, broken, carried is not None)
        if not carried:
            attrs = {"units": u.label("energy"), "long_name": "energy that went with broken bonds, PD"}
            data["pd_dissipated_energy"] = ("frame", u.to_user("energy", np.array(spent)), attrs)
        names.append("damage")
    said = list(material.after(sim))
    if crack is not None:
        add_crack(data, u, times, tips)
        said += crack_lines(data)
    if indenting:
        said += add_indenters(data, u, md_push, pd_push)
    if any(f.velocities is None for f in frames):
        said.append("stress of the MD: the frames have no velocities, so that its kinetic part is not in it")
    lines += said
    for line in said if tell is not None else ():
        tell(line)
    bulk = float(u.to_user("density", crystal.density))
    bound = grid.bind(u, sim.cell)
    deep = away_from_surfaces(sim, bound.points_gc, kernel.support).reshape(bound.shape)
    acted = bool(held.any() or script.forces or motion == "static")
    waves = classical_of(made, material, reference, frames, times, md_nodes[0], acted)
    add_nodes(data, u, made, md_nodes, pd_nodes, waves)
    if waves is not None:
        lines.append(nodes_line(data))
        if tell is not None:
            tell(lines[-1])
    each_frame = motion == "dynamic" and len(frames) > 1
    rows = norms(data, names, bulk, deep, each_frame)
    add_norms(data, rows, each_frame)
    add_constants(data, u, material)
    data["bulk_density"] = ((), bulk, {"units": u.label("density"), "long_name": "density of the crystal at rest"})
    data.attrs.update(
        name=scene.name,
        title="a molecular-dynamics run and its peridynamic twin",
        twin="\n".join(lines),
        kernel=md.attrs.get("kernel", ""),
        grid=md.attrs.get("grid", ""),
        scene=scene.to_toml(),
        bulk_density=bulk,
        nodes=len(made.body),
        motion=motion,
        cost=cost_line(cost),
        **{f"{r['field']}_{r['where']}_{k}": r[k] for r in rows for k in ("difference_rms", "relative")},
    )
    return Twin(data, rows, lines, made, material, sim, scene.name, cost)


def _nodes(sim, units):
    """The nodes where they are, as a frame."""
    return Frame(sim.positions_nc, sim.cell, units, masses=sim.mass_n)
