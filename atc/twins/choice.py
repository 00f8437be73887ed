"""Which material a twin is made of: what ``[twin]`` asks for."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..upscaling.cauchy_born import turned
from .material import isotropic


def horizon_of(get) -> float:
    """The default horizon of the material that [twin] asks for, in distances of nodes."""
    if get("material", "isotropic") in ("cauchy-born", "smoothed"):
        from .cauchy_born import HORIZON

        return HORIZON
    from .body import HORIZON

    return HORIZON


def atoms_horizon(get, crystal, model) -> float:
    """The horizon where the nodes are the atoms: as far as two of them feel each other."""
    if get("material", "isotropic") not in ("linear", "smoothed"):
        raise AtcError('[twin] nodes: only the materials "linear" and "smoothed" take "atoms": leave it out')
    from ..upscaling.force_constants import force_constants

    return 1.02 * float(np.linalg.norm(force_constants(crystal, model).r_bc, axis=1).max())


def twin_material(get, crystal, model, axes, made, reference, equilibrium=None):
    """The material that [twin] asks for, `get(key, default)`, of a relaxed crystal, a `TwinBody` and its frame.
    `equilibrium()` : the run whose fluctuations are measured."""
    for key in ("fracture_energy", "notches"):
        if get(key) is not None and not get("fracture"):
            raise AtcError(f"[twin] {key}: goes with fracture = true")
    if get("fracture") and get("material", "isotropic") not in ("isotropic", "smoothed"):
        raise AtcError(
            '[twin] fracture: only the bonds of material = "isotropic" break, and atoms that "smoothed" carries part: '
            "leave it out"
        )
    if get("fracture") and get("motion", "dynamic") != "dynamic":
        raise AtcError('[twin] fracture: bonds break in dynamic twins only: motion = "dynamic"')
    if get("fracture") and get("material") == "smoothed":
        for key in ("fracture_energy", "notches"):
            if get(key) is not None:
                raise AtcError(f'[twin] {key}: material = "smoothed" parts as the potential has it: leave it out')
    influence = _influence(get, crystal.units, made.body.horizon)
    if get("material", "isotropic") == "cauchy-born":
        from .cauchy_born import cauchy_born

        return cauchy_born(crystal, model, axes, made.step_cc, made.body.horizon, get("temperature"), influence)
    if get("temperature") is not None:
        raise AtcError('[twin] temperature: only material = "cauchy-born" knows one: leave it out')
    if get("material") == "linear":
        from .linear import linear

        return linear(crystal, model, axes, made, get("nodes") == "atoms")
    if get("material") == "coarsened":
        from .linear import coarsened

        return coarsened(crystal, model, axes, made)
    if get("material") == "measured":
        from .linear import measured

        return measured(crystal, axes, made, equilibrium())
    if get("material") == "smoothed":
        from .smoothed import smoothed

        return smoothed(crystal, model, axes, reference, made, get("nodes") == "atoms")
    found = isotropic(crystal, model, get("model", "lps"), made.step_cc, made.body.horizon, influence)
    found.crystal_vv = turned(found.C.C_vv, axes)
    if get("fracture"):
        from ..pd import CriticalStretch
        from ..upscaling.surfaces import cleavage, strength

        found.surface = cleavage(crystal, model)
        u, found.given = crystal.units, get("fracture_energy") is not None
        per_area = u.to_internal("energy", 1.0) / u.length ** (crystal.dimension - 1)
        found.Gc = get("fracture_energy") * per_area if found.given else 2 * found.surface.energy
        found.strength = strength(crystal, model, found.surface.plane)
        found.damage = CriticalStretch.from_energy(found.Gc, found.material, made.body)
    return found


def _influence(get, units, horizon):
    """The influence function that [twin] asks for, None where it does not; lengths in its formula are the user's."""
    said, kind = get("influence"), get("material", "isotropic")
    if said is None:
        return None
    if kind not in ("isotropic", "cauchy-born"):
        raise AtcError(
            f"[twin] influence: the springs of {kind} are the crystal's: leave it out, or take isotropic or cauchy-born"
        )
    from .. import pd
    from ..cases.influence import influence_of

    cls = pd.Hyperelastic if kind == "cauchy-born" else {"lps": pd.LPS, "pmb": pd.PMB}[get("model", "lps")]
    try:
        return influence_of(cls, said, horizon, units.length)
    except AtcError as e:
        raise AtcError(f"[twin] {e}") from None


def orientation(scene, dimension: int = 3) -> np.ndarray:
    """(3, 3) rows: where the crystal's x, y, z point in the run, from the crystal directions along the run's axes."""
    from ..upscaling.crystal import axes_of

    told = f"{scene.where('twin', 'orient')}: [twin] orient: the crystal directions along the run's x, y, z"
    axes = axes_of(scene.get("twin", "orient"), lambda why: AtcError(f"{told} {why}"))
    if dimension == 2 and not abs(axes[2, 2]) > 1 - 1e-9:
        raise AtcError(
            f"{told}: a run in the plane keeps the crystal's z along z: the third must be [0, 0, 1], the others have "
            "no z, e.g. [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]"
        )
    return axes
