"""Dispersion of a crystal in one place: the lattice, phonopy, peridynamic models and a trajectory, with elastic
constants and residuals."""

from __future__ import annotations

import os
from collections.abc import Sequence

import numpy as np

from ..errors import AtcError
from .branches import FRACTIONS, is_cubic
from .crystal import Crystal, of_atc, relax, response
from .dispersion_result import Dispersion, Ray
from .elasticity import elastic_constants
from .force_constants import force_constants, frequency_unit, signed_root, supercell_repeat
from .matching import MODELS, make_model, match
from .primitive import folded, primitive
from .vibrations import measure
from .zone import outside_zone, zone_path

DIRECTIONS = ((1, 0, 0), (1, 1, 0), (1, 1, 1))
_POINTS = 61
#: What [dispersion] hands on as it is.
_SAID = ("models", "horizon", "knots", "width", "order", "reach", "phonopy", "blocks", "timestep", "linewidths")
_SAID += ("structure_factors",)


def dispersion(
    crystal: Crystal,
    model=None,
    traj=None,
    *,
    directions: Sequence = DIRECTIONS,
    path: str | None = None,
    models: Sequence[str] = (),
    lattice_constant="auto",
    horizon=None,
    knots: int = 12,
    width=None,
    order: int = 4,
    reach=None,
    phonopy: bool = True,
    blocks: int = 5,
    timestep=None,
    linewidths: str | None = None,
    structure_factors: bool = False,
) -> Dispersion:
    """Phonon dispersion of a crystal: of its force constants, by phonopy, of peridynamic models, and measured in a
    trajectory.

    Parameters
    ----------
    crystal : Crystal; its lattice constant is a start
    model : potential of `atc.potential`, or an ASE calculator; None: the trajectory alone
    traj : trajectory of the vibrating crystal, or None
    directions : rays in the conventional cell
    path : instead of directions, a path through the zone by the names of its points, "auto", "seekpath" or such as
        "Γ-X-W-K-Γ-L"; see `zone.zone_path`
    models : of `atc.upscaling.matching.MODELS` (cubic crystals)
    lattice_constant : "auto" (the trajectory's if there is one, else "relaxed"), "relaxed" (zero pressure), or a length
        in the user's unit
    horizon, width, reach : lengths in the user's unit; see `fitting.fit_kernel`,
        `peridynamic_kernels.MollifiedLattice`, `force_constants`
    knots, order : see the same
    phonopy : whether to run phonopy too
    blocks, timestep : see `vibrations.measure`
    linewidths : "lorentzian" or "oscillator": fit the lines of the trajectory's modes (`lineshapes`)
    structure_factors : S(q), S(q, ω) and currents of the trajectory at its wave vectors (`structure_factors`)

    Returns
    -------
    Dispersion

    Raises
    ------
    AtcError for whatever does not fit together; an unstable crystal is reported in the notes, its imaginary frequencies
    as negative ones.
    """
    from ..units import require_compatible

    u = crystal.units
    inner = lambda x: None if x is None else float(u.to_internal("length", x))  # noqa: E731
    unknown = [m for m in models if m not in MODELS]
    if unknown:
        raise AtcError(f"model {unknown[0]!r}: expected some of {', '.join(MODELS)}")
    if model is None and traj is None:
        raise AtcError("there is nothing to compute: give a potential, a trajectory or both")
    if traj is None and (linewidths is not None or structure_factors):
        what = "linewidths" if linewidths is not None else "structure_factors"
        raise AtcError(f"{what} are measured in a run: give a trajectory")
    if model is None and models:
        raise AtcError(f"model {models[0]!r} is fitted to force constants: give a potential")
    if model is not None and of_atc(model):
        require_compatible(model.units, u, "the potential", crystal.name)
    said = folded(crystal)
    notes, relaxed = [said] if said else [], None
    out = Dispersion(crystal, [], notes=notes, folded=said)
    if model is not None:
        out.potential = model.describe() if of_atc(model) else type(model).__name__
        if isinstance(lattice_constant, str):
            relaxed = relax(crystal, model)
            crystal = relaxed
        else:
            crystal = _basis_at_rest(crystal.with_lattice_constant(lattice_constant), model)
    elif not isinstance(lattice_constant, str):
        crystal = crystal.with_lattice_constant(lattice_constant)

    def constants(c):
        return force_constants(_basis_at_rest(c, model), model, reach=reach)

    if traj is not None:
        out.measured = measure(
            traj,
            crystal,
            directions if path is None else zone_path(crystal, path),
            fc=constants if model is not None else None,
            blocks=blocks,
            timestep=timestep,
            lines=linewidths,
        )
        if structure_factors:
            q = np.unique(np.round(out.measured.k_kc, 12), axis=0) / u.to_user("length", 1.0)
            out.structure_factors = _structure_factors(traj, q, timestep)
        notes += out.measured.notes
        if lattice_constant == "auto":
            crystal = out.measured.crystal
    if model is not None:
        crystal = _basis_at_rest(crystal, model)
        out.fc = force_constants(crystal, model, reach=reach)
        r = response(crystal, model)
        out.pressure = -float(u.to_user("pressure", r.stress_v[:3].mean()))
        out.relaxed = relaxed
        try:
            out.elastic = elastic_constants(crystal, model)
            if not out.elastic.stable:
                notes.append(
                    "the elastic constants are not positive definite: this crystal is unstable under homogeneous strain"
                )
        except AtcError as e:
            notes.append(str(e))
    out.crystal = crystal
    fractions = np.linspace(0.0, 1.0, _POINTS)
    for d in directions if path is None else ():
        boundary = crystal.zone_boundary(d)
        out.rays.append(Ray(tuple(d), boundary, fractions, fractions[:, None] * boundary * crystal.direction(d)))
    for segment in () if path is None else zone_path(crystal, path):
        a, b = segment.k_ec
        k = a + fractions[:, None] * (b - a)
        out.rays.append(Ray((b - a) / segment.length, segment.length, fractions, k, ends=segment.ends))
    if model is None:
        return out
    made = []
    if models:
        if out.elastic is None or not is_cubic(out.elastic, 1e-4):
            raise AtcError(
                f"{crystal.name}: there are no peridynamic models of this crystal (models = {list(models)}): they are "
                "for stable cubic crystals with the cube's edges along x, y, z, and not for hcp and others; leave "
                "models out, or give such a crystal"
            )
        made = [
            make_model(m, out.fc, out.elastic, horizon=inner(horizon), knots=knots, width=inner(width), order=order)
            for m in models
        ]
        out.matches = [match(m, out.fc, FRACTIONS) for m in made]
    bands = None
    if phonopy:
        from .phonopy_bridge import frequencies, phonopy_of

        bands = phonopy_of(crystal, model, supercell_repeat(crystal, 2.0 * out.fc.reach * 1.0001))
        _, hertz = frequency_unit(u)
    for ray in out.rays:
        ray.lattice_km = out.fc.frequencies(ray.k_kc)
        along = crystal.direction(ray.direction) if ray.ends is None else ray.direction
        ray.velocity_km = out.fc.group_velocities(ray.k_kc, along)
        if bands is not None:
            ray.phonopy_km = frequencies(bands, crystal, ray.k_kc) / hertz
        for m in made:
            values = signed_root(np.linalg.eigvalsh(m.dynamical_matrix(ray.k_kc)))
            # A coarse lattice stands for the waves of its own zone only.
            factor = m.factor
            beyond = ray.fractions > 1.0000001 / factor if ray.ends is None else outside_zone(crystal, ray.k_kc, factor)
            ray.models[m.label] = np.where(beyond[:, None], np.nan, values)
    if bands is not None:
        # As sets: branches are in ascending order in both; near k = 0 the root of rounding is left out.
        out.phonopy_difference = float(max(np.abs(r.phonopy_km - r.lattice_km)[r.moving].max() for r in out.rays))
    worst = min(r.lattice_km[r.moving].min() for r in out.rays)
    if worst < -1e-6 * max(r.lattice_km.max() for r in out.rays):
        unit, factor = frequency_unit(u)
        notes.append(
            f"the lattice is unstable: imaginary frequencies down to {-factor * worst:.4g}i {unit} (negative in "
            "tables and pictures)"
        )
    return out


def _structure_factors(traj, q, timestep):
    """Structure factors at wave vectors of the run, S(q) only where its frames make no spectra."""
    from .structure_factors import structure_factors

    try:
        return structure_factors(traj, q, timestep=timestep)
    except AtcError as e:
        if "time" not in str(e):
            raise
        return structure_factors(traj, q, lags=0)


def _basis_at_rest(crystal: Crystal, model) -> Crystal:
    """The crystal with its basis relaxed and its cell as it is."""
    if len(crystal) == 1 or model is None:
        return crystal
    for _ in range(30):
        r = response(crystal, model)
        u = np.linalg.lstsq(r.phi_xx, r.forces_nc.reshape(-1), rcond=1e-9)[0].reshape(-1, 3)
        largest = np.abs(u).max() / np.linalg.norm(crystal.vectors, axis=1).min()
        crystal = crystal.strained(None, u * min(1.0, 0.03 / largest) if largest > 0 else u)
        if largest < 1e-10:
            return crystal
    raise AtcError(f"{crystal.name}: its basis does not come to rest: give positions nearer to equilibrium")


def dispersion_of_scene(scene, *, progress=None) -> Dispersion:
    """`dispersion` of a scene: [potential], [trajectory] (either may be missing) and [dispersion]."""
    get = lambda key, default=None: scene.get("dispersion", key, default)  # noqa: E731
    if "dispersion" not in scene.data:
        raise AtcError(
            f'{scene.name}: no [dispersion] section: say which crystal it is, e.g. structure = "fcc" and '
            "lattice_constant = 5.3"
        )
    traj = scene.trajectory() if scene.get("trajectory", "file") is not None else None
    pot = scene.potential()
    if traj is None and pot is None:
        raise AtcError(f"{scene.where('dispersion')}: needs a [potential], a [trajectory] or both")
    for what, dimension in (("[trajectory]", traj and traj.units.dimension), ("[potential]", pot and pot.dimension)):
        if dimension == 2:
            raise scene.wrong(
                ("dispersion",), f"is about crystals in three dimensions, but {what} is of a two-dimensional run"
            )
    units = traj.units if traj is not None else pot.units
    crystal = _crystal_of(scene, get, traj, units)
    a = get("lattice_constant")
    fixed = a if get("keep_lattice_constant", False) else "auto"
    directions = [tuple(d) for d in get("directions", [list(d) for d in DIRECTIONS])]
    path = get("path")
    if path is not None and get("directions") is not None:
        raise scene.wrong(("dispersion", "path"), "give path or directions, not both")
    out = dispersion(
        crystal,
        pot,
        traj,
        directions=directions,
        path=path,
        lattice_constant=fixed,
        **{key: get(key) for key in _SAID if get(key) is not None},
    )
    out.scene = scene.to_toml()
    return out


def _crystal_of(scene, get, traj, units) -> Crystal:
    cell = scene.path("dispersion", "unit_cell")
    if cell is not None:
        if get("structure") is not None:
            raise scene.wrong(("dispersion", "unit_cell"), "give structure or unit_cell, not both")
        frame = scene.read(cell, "unit_cell") if os.path.exists(cell) else None
        if frame is None:
            raise scene.bad(("dispersion", "unit_cell"), f"there is no file {cell}")
        crystal = Crystal.from_frame(frame[0], name=cell.name)
        return primitive(crystal) if get("primitive") else crystal
    if get("primitive") is not None:
        raise scene.bad(("dispersion", "primitive"), "of a unit_cell; cells of structure are primitive")
    structure, a = get("structure"), get("lattice_constant")
    if structure is None or a is None:
        what = "structure" if structure is None else "lattice_constant"
        raise scene.wrong(
            ("dispersion",),
            f'needs {what}, e.g. structure = "fcc" and lattice_constant = 5.3, or unit_cell = "cell.data"',
        )
    masses = get("masses")
    if masses is None:
        if traj is None:
            raise scene.wrong(("dispersion",), "needs masses, one for each atom of the basis, e.g. masses = [39.948]")
        frame = traj[0]
        frame.require("masses", why="the dispersion")
        kinds = np.unique(frame.types)
        masses = [float(units.to_user("mass", frame.masses[frame.types == t][0])) for t in kinds]
    return Crystal.cubic(structure, a, masses, units)
