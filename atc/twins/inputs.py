"""What a twin takes from its scene: the run, potential, kernel, grid, reference; the crystal at rest; an indenter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..planar import planar
from ..readers.planar import matched
from ..upscaling.crystal import PLANAR_STRUCTURES, STRUCTURES, Crystal, relax


@dataclass
class Inputs:
    """The run, its potential and reference; the kernel and the grid, in the user's units."""

    traj: object
    pot: object
    kern: object
    grid: object
    reference: object


def inputs_of(scene) -> Inputs:
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
        raise scene.wrong(
            ("twin", "material"),
            'the twin of a run in the plane is of material = "isotropic", without reference_stress',
        )
    grid = scene.grid()
    if grid.kind not in ("regular", "plane", "line", "points"):
        raise scene.bad(
            ("grid", "kind"),
            f"MD and PD are compared at the same points: take a regular, plane, line or points grid, not {grid.kind}",
        )
    reference = scene.reference()
    reference = traj[0] if reference is None else planar(reference) if d == 2 else reference
    reference = pot.complete(reference)
    reference.require("masses", why="the body of a twin")
    grid.require_dimension(d)
    return Inputs(traj, pot, scene.kernel().in_dimension(d), grid, reference)


def crystal_of(scene, get, reference, pot, units):
    """The crystal at rest under the potential."""
    structure, a = get("structure"), get("lattice_constant")
    if structure is None or a is None:
        raise scene.wrong(
            ("twin",),
            'needs structure and lattice_constant (a start), e.g. structure = "fcc" and lattice_constant = 5.3',
        )
    flat = units.dimension == 2
    if flat != (structure in PLANAR_STRUCTURES):
        raise scene.bad(
            ("twin", "structure"),
            f"a run in {'the plane' if flat else 'space'} has "
            f"one of {', '.join(PLANAR_STRUCTURES if flat else STRUCTURES)}, not {structure}",
        )
    kinds = np.unique(reference.types)
    masses = [float(units.to_user("mass", reference.masses[reference.types == t][0])) for t in kinds]
    if len(kinds) > 2 or (len(kinds) == 2 and structure != "diamond"):
        # Types that only name groups of the same atoms.
        if np.ptp(masses) > 1e-9 * max(masses):
            raise scene.wrong(
                ("twin",), f"the run has atoms of {len(kinds)} masses, which {structure} has no places for"
            )
        masses = masses[:1]
    elif np.ptp(masses) == 0:
        masses = masses[:1]
    crystal = Crystal.planar(structure, a, masses[0], units) if flat else Crystal.cubic(structure, a, masses, units)
    crystal.types = np.full(len(crystal), kinds[0]) if len(masses) == 1 else crystal.types
    return relax(crystal, pot)


def indenter_of(scene, get, units):
    """(centre, velocity, radius, stiffness) of [twin], internal units, or None."""
    keys = ("indenter_centre", "indenter_radius", "indenter_stiffness")
    given = [k for k in (*keys, "indenter_velocity") if get(k) is not None]
    if not given:
        return None
    if missing := [k for k in keys if get(k) is None]:
        raise scene.wrong(("twin", given[0]), f"{given[0]} needs {missing[0]} too")
    velocity = np.array(get("indenter_velocity", [0.0, 0.0, 0.0]), float)
    return (
        np.array(get(keys[0]), float) * units.length,
        units.to_internal("velocity", velocity),
        get(keys[1]) * units.length,
        get(keys[2]) * units.factor("force") / units.length**2,
    )
