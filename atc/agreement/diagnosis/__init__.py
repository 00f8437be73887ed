"""What a difference between the forces of a run and those of a potential looks like: where it probably comes from.

Every test asks whether D_i = F_i(run) − F_i(model) follows one law, D = g m_i, D = q_i E, D = −γ v_i, Σ λ_b e_b along
bonds ..., to within what the digits hide. The first law that holds is named; where none does, it is said which atoms
differ and whether the differences add up to zero, as those of forces between atoms must.
"""

from __future__ import annotations

import numpy as np

from .bonds import bonded, rigid
from .case import Case, norm, which
from .charges import charges
from .laws import factor, friction, held, no_forces, one_coordinate, per_atom, random_forces


def looks_like(frame, pot, model_nc, noise, odd, threads: int = 1) -> str:
    """In words, what makes the forces of a frame differ from `model_nc` on the atoms `odd`; "" where there is nothing
    to say.

    Parameters
    ----------
    frame : Frame with forces. pot : Potential that gave model_nc (n, 3)
    noise : (n,) size of a difference that the digits of the file explain
    odd : (n,) bool
    """
    if not odd.any():
        return ""
    case = Case(frame, pot, model_nc, noise, odd, threads)
    for test in (no_forces, factor, held, rigid, per_atom, friction, random_forces, one_coordinate, bonded, charges):
        found = test(case)
        if found:
            return found
    return _rest(case)


def _rest(c: Case) -> str:
    """Which atoms, and whether the differences add up to zero."""
    D = c.D_nc
    total = np.linalg.norm(D.sum(axis=0))
    random = norm(D)
    noise = 3.0 * norm(c.noise) + 1e-9 * random
    where = which(c)
    of = "everything" if c.odd.mean() > 0.9 or not c.same.any() else where
    if total <= noise:
        why = (
            "forces between atoms that the potential has not, or has otherwise: wrong or missing coefficients, "
            "styles, exclusions or units"
        )
        return f"{of}: {why}"
    return (
        f"{of}, and the differences do not add up to zero: forces from outside (a fix that adds forces), or wrong "
        "forces together with them"
    )
