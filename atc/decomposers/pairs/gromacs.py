"""GROMACS's shift function: a polynomial beyond the inner cutoff that takes energy, force and its slope to zero at the
outer one."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .input import fill
from .lennard_jones import LennardJones, mix_lj
from .loop import pair_law
from .radial import ChargedStyle, RadialStyle, four_cutoffs, inner_outer, mix_lj_distances

_lj = LennardJones.law


def joined_to_zero(e, e1, e2, inner, outer):
    """A/3, B/4, C of S(d) = A/3 t³ + B/4 t⁴ + C, t = d − inner, for a term with value, slope and curvature e, e1, e2 at
    the outer cutoff."""
    t = outer - inner
    A = (-3 * e1 + t * e2) / t**2
    B = (2 * e1 - t * e2) / t**3
    C = -e + t / 2 * e1 - t * t / 12 * e2
    return A / 3, B / 4, C


def shifted_powers(a, c, inner, cutoff):
    """Coefficients of the law of `LennardJonesGromacs`, of a/d¹² − c/d⁶."""
    r = cutoff
    e, e1, e2 = a / r**12 - c / r**6, -12 * a / r**13 + 6 * c / r**7, 156 * a / r**14 - 42 * c / r**8
    return a, c, inner, *joined_to_zero(e, e1, e2, inner, r)


class LennardJonesGromacs(RadialStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] + S(d) (LAMMPS ``lj/gromacs``).

    S = C for d < inner and A/3 t³ + B/4 t⁴ + C, t = d − inner, beyond, such that U, U' and U'' vanish at the cutoff.
    Numbers: epsilon, sigma, inner, cutoff; see `RadialStyle`.
    """

    name = "lj/gromacs"
    numbers = (("epsilon", "energy"), ("sigma", "length"), ("inner", "length"), ("cutoff", "length"))
    shifts = False

    def columns(self, epsilon, sigma, inner, cutoff):
        return shifted_powers(4 * epsilon * sigma**12, 4 * epsilon * sigma**6, inner, cutoff)

    @pair_law
    def law(d2, a12, c6, inner, A, B, C):
        u, g = _lj(d2, a12, c6)
        u += C
        d = np.sqrt(d2)
        t = d - inner
        if t > 0.0:
            u += t * t * t * (A + B * t)
            g += t * t * (3.0 * A + 4.0 * B * t) / d
        return u, g


class CoulombGromacs(ChargedStyle):
    """U = C q_i q_j (1/d + S(d)), S as for `LennardJonesGromacs` (the Coulomb part of LAMMPS
    ``lj/gromacs/coul/gromacs``).

    Numbers: inner, cutoff; see `ChargedStyle`.
    """

    name = "coul/gromacs"
    numbers = (("inner", "length"), ("cutoff", "length"))

    def columns(self, inner, cutoff):
        return inner, *joined_to_zero(1 / cutoff, -1 / cutoff**2, 2 / cutoff**3, inner, cutoff)

    @pair_law
    def law(d2, c, inner, A, B, C):
        d = np.sqrt(d2)
        s = 1.0 / d
        u = s + C
        du = -s * s
        t = d - inner
        if t > 0.0:
            u += t * t * t * (A + B * t)
            du += t * t * (3.0 * A + 4.0 * B * t)
        return c * u, c * du * s


inner_outer(LennardJonesGromacs, mix=mix_lj_distances)


@pair_style("lj/gromacs/coul/gromacs")
def _both(inp: StyleInput):
    inner, outer, inner_c, outer_c = four_cutoffs(inp)
    inp.require(None if 0 <= inner_c < outer_c else "the inner Coulomb cutoff must be less than the outer one")
    given = inp.by_pair(lambda line: (*inp.numbers(line.words, LennardJonesGromacs.numbers[:2], line), 1.0))
    epsilon, sigma, on = fill(inp, given, 3, mix=mix_lj)
    return [
        LennardJonesGromacs.internal(epsilon, sigma, on * inner, on * outer),
        CoulombGromacs.of(inp, on * inner_c, on * outer_c),
    ]
