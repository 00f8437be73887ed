"""`twin`: from a scene of a molecular-dynamics run to its peridynamic twin, run and compared."""

from __future__ import annotations

import math
import time
import warnings
from copy import copy
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from .. import pd
from ..config.scene import Scene
from ..errors import AtcError, AtcWarning, heard
from ..frame import Frame
from ..pictures.twins import movie, picture
from ..planar import planar
from ..readers.planar import matched
from ..running.whole import write_dataset
from ..upscaling.crystal import PLANAR_STRUCTURES, STRUCTURES, Crystal, evaluate, relax
from .body import TwinBody, body_of, body_of_atoms
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
    between,
    clock,
    deform,
    gripped,
    history,
    require_moved,
    smoothed_displacement,
)
from .crack import add_crack, crack_lines, crack_of, notches_of, require_crossed
from .damage import NearestBonds, add_damage, on_grid
from .linear import kept_place
from .nodes import add_nodes, classical_of, nodes_line
from .outside import add_indenters, from_script, indenters
from .same_crystal import require_same_crystal

#: Steps in parts of the stable one: those of velocity Verlet put the phase of a wave (ω dt)²/24 ahead.
SAFETY = 0.7


@dataclass
class Twin:
    """What `twin` found.

    Attributes
    ----------
    dataset : xarray.Dataset in the trajectory's units: md_*, pd_* and difference_* of density, displacement, velocity
        and stress (frame, the grid's dimensions), md_box_stress and pd_box_stress; md_, pd_ (and classical_)
        node_displacement (frame, node, i); norm_*, elastic_*
    rows : the norms, one dict for each field and region
    lines : what was decided before the run
    body : TwinBody. material : what `twin_material` made. simulation : pd.Simulation after the run (internal units)
    cost : {"nodes", "steps" (of a static twin: evaluations of the forces), "material", "seconds"}: CPU seconds that
        making the material and running the nodes took
    """

    dataset: object
    rows: list
    lines: list
    body: TwinBody
    material: object
    simulation: object
    name: str = field(default="twin")
    cost: dict = field(default_factory=dict)

    def print(self, console) -> None:
        from rich.table import Table

        ds = self.dataset
        table = Table(box=None, padding=(0, 2, 0, 0))
        noise = any(np.isfinite(r["md_standard_error"]) for r in self.rows)
        keys = ["md_rms", "pd_rms", "difference_rms", "relative", *(["md_standard_error"] if noise else [])]
        heads = ["MD rms", "PD rms", "PD - MD rms", "relative", *(["MD std. error"] if noise else [])]
        for head in ("field", "where", "points", *heads):
            table.add_column(head, justify="left" if head in ("field", "where") else "right")
        for r in self.rows:
            units = ds[f"md_{r['field']}"].attrs.get("units", "")
            table.add_row(f"{r['field']} ({units})", r["where"], str(r["points"]), *(f"{r[k]:.4g}" for k in keys))
        console.print(table)
        console.print(f"(rms over points and components, {ds.attrs['norms']})")
        if "md_box_stress" in ds:
            md, pd = (ds[f"{s}_box_stress"].mean("frame").values for s in ("md", "pd"))
            for c, i in zip("xyz", range(self.body.body.dimension)):
                console.print(
                    f"mean stress of the box, {c}{c}: MD {md[i, i]:.5g}, PD {pd[i, i]:.5g} "
                    f"{ds['md_box_stress'].attrs.get('units', '')}"
                )
        console.print(f"the twin's run: {cost_line(self.cost)}")

    def save(self, path) -> None:
        """Write the dataset: .nc or .zarr."""
        write_dataset(self.dataset, path)

    def picture(self, path) -> Path:
        """MD, PD and difference of the displacement and the stress along the axis of the largest mean stress."""
        frames = self.dataset.sizes["frame"]
        return picture(self.dataset, path, f"{self.name}: means of {frames} frames")

    def movie(self, path) -> Path:
        """The same, and damage where bonds break, frame by frame: an animated GIF."""
        return movie(self.dataset, path, self.name)


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
    given = _inputs(scene)
    traj, pot, kern, grid, reference = (given[k] for k in ("traj", "pot", "kern", "grid", "reference"))
    u = traj.units
    length = u.factor("length")
    kernel = kern.scaled(length)
    # A crystal is no frame of the script's run: what the script says of single atoms is not for it.
    law = copy(pot)
    law.setup = None
    crystal = _crystal(scene, get, reference, law, u)
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
    script = from_script(pot, reference, made, _indenter(scene, get, u), bool(grips.any()))
    held = np.repeat(grips[:, None], 3, axis=1)
    for c in range(3) if script.held_nc.any() else ():
        held[:, c] |= made.smoothing.share(script.held_nc[:, c]) >= 0.5
    require_moved(frames, reference, made, held)
    conditions = _grips(held, frames, reference, made, times)
    sim = _start(frames[0], reference, made, material, conditions, script.forces, motion)
    lines = _lines(
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
        start = time.process_time()
        cost["steps"] += _advance(sim, frames, times, k, motion, safety)
        cost["seconds"] += time.process_time() - start
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


def cost_line(c: dict) -> str:
    """What a twin cost, for a person."""
    return (
        f"{c['nodes']} nodes, {c['steps']} steps, {c['seconds']:.3g} CPU seconds; its material before that "
        f"{c['material']:.3g}"
    )


def _inputs(scene) -> dict:
    """Everything of the scene that a twin needs, or one line that says what is missing."""
    for section, example in (
        ("twin", 'structure = "fcc" and lattice_constant = 5.3'),
        ("potential", 'lammps = """pair_style ..."""'),
        ("kernel", 'name = "quartic" and radius = 8.0'),
        ("grid", 'kind = "regular" and spacing = 2.0'),
    ):
        if section not in scene.data:
            raise scene.need(section, f"a twin needs it, e.g. {example}")
    traj = scene.trajectory()
    traj, pot = matched(traj, scene.potential())
    d = traj.units.dimension
    if d == 2 and (scene.get("twin", "material", "isotropic") != "isotropic" or scene.get("twin", "reference_stress")):
        raise AtcError(
            f'{scene.where("twin", "material")}: [twin] the twin of a run in the plane is of material = "isotropic", '
            "without reference_stress"
        )
    grid = scene.grid()
    if grid.kind not in ("regular", "plane", "line", "points"):
        raise AtcError(
            f"{scene.where('grid', 'kind')}: [grid] kind: MD and PD are compared at the same points: take a regular, "
            f"plane, line or points grid, not {grid.kind}"
        )
    reference = scene.reference()
    reference = traj[0] if reference is None else planar(reference) if d == 2 else reference
    reference = pot.complete(reference)
    reference.require("masses", why="the body of a twin")
    grid.require_dimension(d)
    kern = scene.kernel().in_dimension(d)
    return {"traj": traj, "pot": pot, "kern": kern, "grid": grid, "reference": reference}


def _crystal(scene, get, reference, pot, units):
    """The crystal at rest under the potential."""
    structure, a = get("structure"), get("lattice_constant")
    if structure is None or a is None:
        raise AtcError(
            f'{scene.where("twin")}: [twin] needs structure and lattice_constant (a start), e.g. structure = "fcc" and '
            "lattice_constant = 5.3"
        )
    flat = units.dimension == 2
    if flat != (structure in PLANAR_STRUCTURES):
        raise AtcError(
            f"{scene.where('twin', 'structure')}: [twin] structure: a run in {'the plane' if flat else 'space'} has "
            f"one of {', '.join(PLANAR_STRUCTURES if flat else STRUCTURES)}, not {structure}"
        )
    kinds = np.unique(reference.types)
    masses = [float(units.to_user("mass", reference.masses[reference.types == t][0])) for t in kinds]
    if len(kinds) > 2 or (len(kinds) == 2 and structure != "diamond"):
        # Types that only name groups of the same atoms.
        if np.ptp(masses) > 1e-9 * max(masses):
            raise AtcError(
                f"{scene.where('twin')}: [twin] the run has atoms of {len(kinds)} masses, which {structure} has no "
                "places for"
            )
        masses = masses[:1]
    elif np.ptp(masses) == 0:
        masses = masses[:1]
    crystal = Crystal.planar(structure, a, masses[0], units) if flat else Crystal.cubic(structure, a, masses, units)
    crystal.types = np.full(len(crystal), kinds[0]) if len(masses) == 1 else crystal.types
    return relax(crystal, pot)


def _grips(held, frames, reference, made, times) -> list:

    nodes = held.any(axis=1)
    if not nodes.any():
        return []
    u_tgc = np.array([smoothed_displacement(f, reference, made.smoothing, made.body.X_nc)[nodes] for f in frames])
    at = history(times, u_tgc)
    return [pd.Prescribed(nodes, displacement=lambda t: np.where(held[nodes], at(t), np.nan))]


def _indenter(scene, get, units):
    """(centre, velocity, radius, stiffness) of [twin], internal units, or None."""
    keys = ("indenter_centre", "indenter_radius", "indenter_stiffness")
    given = [k for k in (*keys, "indenter_velocity") if get(k) is not None]
    if not given:
        return None
    if missing := [k for k in keys if get(k) is None]:
        raise AtcError(f"{scene.where('twin', given[0])}: [twin] {given[0]} needs {missing[0]} too")
    velocity = np.array(get("indenter_velocity", [0.0, 0.0, 0.0]), float)
    return (
        np.array(get(keys[0]), float) * units.length,
        units.to_internal("velocity", velocity),
        get(keys[1]) * units.length,
        get(keys[2]) * units.factor("force") / units.length**2,
    )


def _start(first, reference, made, material, conditions, forces, motion):
    """The simulation in the state of the run's first frame."""
    X = made.body.X_nc
    v = None
    if motion == "dynamic":
        first.require("velocities", why="the start of a dynamic twin")
        v = made.smoothing.mean(first.velocities)
    options = {"damage": material.damage, "conditions": conditions, "walls": forces, "velocities": v}
    sim = pd.Simulation(made.body, material.material, **options)
    # The cell first, which moves the nodes; then they go to where the atoms are.
    deform(sim, first.cell)
    sim._z[:, :3] = smoothed_displacement(first, reference, made.smoothing, X)
    sim._contact_energy, sim._rigid_energy = sim._all_forces(damage=False)
    return sim


def _advance(sim, frames, times, k, motion, safety) -> int:
    """From frame k − 1 to frame k, the cell on the straight way between theirs; the evaluations of forces it took."""
    if motion == "static":
        if k == 0 or sim.cell != frames[k].cell or sim.prescribed or sim.rigid:
            deform(sim, frames[k].cell)
            return pd.relax(sim, time=times[k]).evaluations
        return 0
    if k == 0:
        return 0
    a, b, gap = frames[k - 1].cell, frames[k].cell, times[k] - times[k - 1]
    count = max(1, math.ceil(gap / (safety * sim.time_step_stable)))
    sim.dt = gap / count
    if a == b:
        sim.step(count)
        return count
    for m in range(count):
        deform(sim, between(a, b, (m + 1) / count))
        sim.step()
    return count


def _nodes(sim, units):
    """The nodes where they are, as a frame."""
    return Frame(sim.positions_nc, sim.cell, units, masses=sim.mass_n)


def _lines(
    units, reference, pot, made, material, held, motion, safety, sim, frames, script, added, breaks
) -> list[str]:
    """What the twin is, before it runs."""
    p = lambda what, v: f"{units.to_user(what, v):.5g} {units.label(what)}"  # noqa: E731
    body = made.body
    edges = ", ".join(f"{units.to_user('length', e):.4g}" for e in made.edges)
    stress = pot.stream(reference).virial_cc / body.V_n.sum()
    own = ", ".join(f"{units.to_user('pressure', v):.3g}" for v in np.diag(stress))
    lines = [
        f"body: {len(body)} nodes of {len(reference)} atoms, {edges} {units.label('length')} apart, horizon "
        f"{p('length', body.horizon)}; mass as the atoms', density {made.density / made.bulk:.4g} of the crystal's",
        *material.lines(units),
        f"reference: {reference.source}; its own mean stress (xx, yy, zz) "
        f"{own} {units.label('pressure')} is " + ("added to the twin's" if added else "not in the twin"),
    ]
    moved = any(f.cell != reference.cell for f in frames)
    lines.append(
        "conditions: "
        + ("the cell's history" if moved else "the cell stays as it is")
        + (f"; {int(held.sum())} nodes are held at the smoothed displacement of their atoms" if held.any() else "")
        + (
            "; an equilibrium for every frame"
            if motion == "static"
            else "; starts from smoothed displacement, velocity"
        )
    )
    lines += script
    stable = p("time", sim.time_step_stable)
    if motion == "dynamic":
        lines.append(
            f"stable step: surely below {stable}; taken are at most {p('time', safety * sim.time_step_stable)}"
        )
    elif np.isfinite(sim.time_step_stable):
        lines.append(f"stable step: {stable}; of no use in an equilibrium")
    lines.append(
        "left out: "
        + ("" if material.temperature else "temperature (kinetic stress, expansion, softening), ")
        + ("" if breaks else "fracture, ")
        + ("what surface stress does beside adding to it" if added else "surface stress")
    )
    size = np.abs(stress).max() / material.bulk
    if size > 3e-3 and not added:
        warnings.warn(
            f"{reference.source}: the reference is not free of stress: it has {100 * size:.2g} % of the bulk modulus, "
            "which the twin lacks: give as [trajectory] reference a frame or file of the unloaded body",
            AtcWarning,
            stacklevel=3,
        )
    return lines
