"""What a twin is, in words, before it runs."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcWarning
from .motion import SAFETY


def lines_of(get, given, made, material, held, sim, frames, script) -> list[str]:
    """What the twin is, before it runs. get : `[twin]`'s keys. held : (n,) which nodes are. script : lines on what the
    run's script does"""
    reference, units = given.reference, given.traj.units
    static, added = get("motion", "dynamic") == "static", get("reference_stress")
    p = lambda what, v: f"{units.to_user(what, v):.5g} {units.label(what)}"  # noqa: E731
    body = made.body
    edges = ", ".join(f"{units.to_user('length', e):.4g}" for e in made.edges)
    stress = given.pot.stream(reference).virial_cc / body.V_n.sum()
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
        + ("; an equilibrium for every frame" if static else "; starts from smoothed displacement, velocity")
    )
    lines += script
    stable = p("time", sim.time_step_stable)
    if not static:
        taken = p("time", get("safety", SAFETY) * sim.time_step_stable)
        lines.append(f"stable step: surely below {stable}; taken are at most {taken}")
    elif np.isfinite(sim.time_step_stable):
        lines.append(f"stable step: {stable}; of no use in an equilibrium")
    lines.append(
        "left out: "
        + ("" if material.temperature else "temperature (kinetic stress, expansion, softening), ")
        + ("" if get("fracture") else "fracture, ")
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
