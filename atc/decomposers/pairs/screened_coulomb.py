"""Coulomb interactions whose charges are screened, smeared, or in a medium whose dielectric constant depends on the
distance."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .input import mix_distance, one_cutoff_each, pair_values
from .loop import pair_law
from .radial import ChargedStyle, one_cutoff

_CUTOFF = ("cutoff", "length")
_PER_LENGTH = {"length": -1}


class CoulombDebye(ChargedStyle):
    """U = C q_i q_j e^{−κd}/d for d < cutoff (LAMMPS ``coul/debye``). Numbers: kappa, cutoff; see `ChargedStyle`."""

    name = "coul/debye"
    numbers = (("kappa", _PER_LENGTH), _CUTOFF)

    @pair_law
    def law(d2, c, kappa):
        d = np.sqrt(d2)
        u = c * np.exp(-kappa * d) / d
        return u, -u * (kappa + 1.0 / d) / d


class CoulombSlater(ChargedStyle):
    """U = C q_i q_j/d [1 − (1 + d/λ) e^{−2d/λ}]: smeared charges (LAMMPS ``coul/slater/cut``). Numbers: decay λ,
    cutoff; see `ChargedStyle`."""

    name = "coul/slater/cut"
    numbers = (("decay", "length"), _CUTOFF)

    def columns(self, decay, cutoff):
        return (1 / decay,)

    @pair_law
    def law(d2, c, inverse_decay):
        d = np.sqrt(d2)
        u = c / d
        x = d * inverse_decay
        e = np.exp(-2.0 * x)
        return u * (1.0 - (1.0 + x) * e), -u * (1.0 - (1.0 + 2.0 * x * (1.0 + x)) * e) / d2


class CoulombDiel(ChargedStyle):
    """U = C q_i q_j/d [ε/ε_D(d) − 1], ε_D = (5.2 + ε)/2 + (ε − 5.2)/2 tanh[(d − r_me)/σ_e] (LAMMPS ``coul/diel``).

    A correction to a Coulomb interaction in a medium ε for charges close to each other (Lenart, Jusufi &
    Panagiotopoulos, J. Chem. Phys. 126, 044509). Numbers: epsilon, r_me, sigma_e, cutoff; see `ChargedStyle`.
    """

    name = "coul/diel"
    numbers = (("epsilon", "dimensionless"), ("r_me", "length"), ("sigma_e", "length"), _CUTOFF)

    def columns(self, epsilon, r_me, sigma_e, cutoff):
        return epsilon, r_me, 1 / sigma_e

    @pair_law
    def law(d2, c, epsilon, r_me, per_sigma):
        d = np.sqrt(d2)
        u = c / d
        half = 0.5 * (epsilon - 5.2)
        t = np.tanh((d - r_me) * per_sigma)
        eps = 5.2 + half * (1.0 + t)
        return u * (epsilon / eps - 1.0), -u * (
            (epsilon / eps - 1.0) / d + epsilon / (eps * eps) * half * (1.0 - t * t) * per_sigma
        ) / d


class CoulombExclude(ChargedStyle):
    """U = (γ − 1) C q_i q_j/d for the pairs with special_bonds weight γ < 1 only: takes what they lose off a full sum
    (LAMMPS ``coul/exclude``).

    LAMMPS counts such pairs up to the reach of its neighbour list, a little beyond the cutoff. Numbers: cutoff; see
    `ChargedStyle`.
    """

    name = "coul/exclude"
    keeps_excluded = True
    numbers = (_CUTOFF,)

    @pair_law
    def law(d2, c):
        return 0.0, 0.0


def _mix_cutoffs(a, b, rule):
    return (mix_distance(a[0], b[0], rule),)


one_cutoff(CoulombDebye, mix=_mix_cutoffs, line=("kappa", "cutoff"))
one_cutoff(CoulombSlater, mix=_mix_cutoffs, line=("decay", "cutoff"))


@pair_style("coul/diel")
def _diel_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [_CUTOFF])
    epsilon, *more = pair_values(inp, CoulombDiel.numbers, optional=1, defaults=[rc])
    if inp.coeffs:
        # LAMMPS (22 Jul 2025) keeps one epsilon for all pairs of types, that of the last line; measured, not
        # documented.
        last = float(inp.coeffs[-1].words[0])
        if (epsilon[more[-1] > 0] != last).any():
            inp.note(
                f"pair_style coul/diel: all pairs of types have the epsilon of the last pair_coeff line, {last:g}, as "
                "in LAMMPS"
            )
        epsilon = np.full_like(epsilon, last)
    return CoulombDiel.of(inp, epsilon, *more)


@pair_style("coul/exclude")
def _exclude_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [_CUTOFF])
    return CoulombExclude.of(inp, one_cutoff_each(inp, rc, own=False))
