"""Lennard-Jones whose force is joined to zero, or to another Lennard-Jones, by polynomials of the distance."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ..registry import StyleInput, pair_style
from .input import fill, mix_distance
from .lennard_jones import LennardJones
from .loop import pair_law
from .radial import RadialStyle, inner_outer, mix_lj_distances, several_cutoffs

_law = LennardJones.law
_LJ = (("epsilon", "energy"), ("sigma", "length"))


def _lj(epsilon, sigma, d):
    """4εσ¹², 4εσ⁶, and energy, force and slope of the force at d."""
    a, c = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6
    return a, c, a / d**12 - c / d**6, 12 * a / d**13 - 6 * c / d**7, -156 * a / d**14 + 42 * c / d**8


def _cubic(F0, dF0, F1, dF1, width):
    """Coefficients of the cubic in t that has these values and slopes at t = 0 and t = width; 0 for no width."""
    with np.errstate(all="ignore"):
        c3 = (3 * (F1 - F0) - (2 * dF0 + dF1) * width) / width**2
        c4 = (2 * (F0 - F1) + (dF0 + dF1) * width) / width**3
    on = width > 0
    return F0, dF0, np.where(on, c3, 0.0), np.where(on, c4, 0.0)


def _work(c, t):
    """∫ of the cubic from 0 to t."""
    return t * (c[0] + t * (c[1] / 2 + t * (c[2] / 3 + t * c[3] / 4)))


@njit(nogil=True, error_model="numpy", inline="always")
def _lj_of(d2, a12, c6, constant):
    """U and U'/d of Lennard-Jones and a constant."""
    u, g = _law(d2, a12, c6)
    return u + constant, g


@njit(nogil=True, error_model="numpy", inline="always")
def _cubic_of(d, start, u, f0, f1, f2, f3):
    """U and U'/d of a force that is a cubic of d − start, u the energy there."""
    t = d - start
    return u - t * (f0 + t * (f1 / 2.0 + t * (f2 / 3.0 + t * f3 / 4.0))), -(f0 + t * (f1 + t * (f2 + t * f3))) / d


class LennardJonesSmooth(RadialStyle):
    """4ε[(σ/d)¹² − (σ/d)⁶] for d < inner; beyond, a force cubic in d that joins smoothly and ends at the cutoff with no
    slope (LAMMPS ``lj/smooth``).

    The energy is continuous at the inner cutoff; with `shift` it is 0 at the outer one. Numbers: epsilon, sigma, inner,
    cutoff; see `RadialStyle`.
    """

    name = "lj/smooth"
    numbers = (*_LJ, ("inner", "length"), ("cutoff", "length"))

    def columns(self, epsilon, sigma, inner, cutoff):
        a, c, u, F, dF = _lj(epsilon, sigma, inner)
        zero = np.zeros_like(inner)
        return a, c, inner, u, *_cubic(F, dF, zero, zero, cutoff - inner)

    @pair_law
    def law(d2, a, c, inner, u, f0, f1, f2, f3):
        d = np.sqrt(d2)
        return _cubic_of(d, inner, u, f0, f1, f2, f3) if d > inner else _lj_of(d2, a, c, 0.0)


class LennardJonesCubic(LennardJonesSmooth):
    """Lennard-Jones up to its inflection point, and a cubic of the distance from there to zero energy and force (LAMMPS
    ``lj/cubic``).

    The inflection point is at (26/7)^{1/6} σ; the cubic u + u' t − A₃ t³/6 with the values u, u' there ends at r_c =
    67/48 of it (Holian & Ravelo, Phys. Rev. B 51, 11275). Numbers: epsilon, sigma, on (1, or 0 for pairs of types that
    do not interact); see `RadialStyle`.
    """

    name = "lj/cubic"
    numbers = (*_LJ, ("on", "dimensionless"))
    shifts = False
    inflection = (26 / 7) ** (1 / 6)

    def reach(self, epsilon, sigma, on):
        return np.where(on > 0, 67 / 48 * self.inflection * sigma, 0.0)

    def columns(self, epsilon, sigma, on):
        r = self.inflection * sigma
        a, c, u, F, _ = _lj(epsilon, sigma, r)
        # Energy and force vanish at the cutoff: F + A₃ t²/2 = 0.
        zero = np.zeros_like(r)
        return a, c, r, u, F, zero, -F / (19 / 48 * r) ** 2, zero


class RelativeResolution(RadialStyle):
    """A fine Lennard-Jones near, a coarse one far, and forces cubic in d between them and before the cutoff (LAMMPS
    ``lj/relres``).

    The fine one (ε, σ) acts for d < switch_inner, the coarse one (ε_cg, σ_cg) from switch_outer to inner, and nothing
    beyond the cutoff. The force is continuous where a zone between two cutoffs has a width (its slope not at
    switch_outer: LAMMPS has its sign reversed there), the energy everywhere; with `shift` it is 0 at the cutoff.
    Numbers: epsilon, sigma, epsilon_cg, sigma_cg, switch_inner, switch_outer, inner, cutoff; see `RadialStyle`.
    """

    name = "lj/relres"
    numbers = (
        *_LJ,
        ("epsilon_cg", "energy"),
        ("sigma_cg", "length"),
        *((w, "length") for w in ("switch_inner", "switch_outer", "inner", "cutoff")),
    )

    def columns(self, e, s, e_cg, s_cg, si, so, ci, cutoff):
        a, c, u_si, F_si, dF_si = _lj(e, s, si)
        a_cg, c_cg, u_so, F_so, dF_so = _lj(e_cg, s_cg, so)
        _, _, u_ci, F_ci, dF_ci = _lj(e_cg, s_cg, ci)
        zero = np.zeros_like(ci)
        # LAMMPS (22 Jul 2025) joins the outer end with the slope's sign reversed; measured, not documented.
        switch = _cubic(F_si, dF_si, F_so, -dF_so, so - si)
        end = _cubic(F_ci, dF_ci, zero, zero, cutoff - ci)
        at_si = u_so + np.where(so > si, _work(switch, so - si), 0.0)
        return a, c, at_si - u_si, si, at_si, *switch, so, a_cg, c_cg, ci, u_ci, *end

    @pair_law
    def law(d2, a, c, more, si, u_si, s0, s1, s2, s3, so, a_cg, c_cg, ci, u_ci, e0, e1, e2, e3):
        d = np.sqrt(d2)
        # Lennard-Jones: fine with its constant, or coarse; or a cubic force.
        if d < si:
            return _lj_of(d2, a, c, more)
        if d < so:
            return _cubic_of(d, si, u_si, s0, s1, s2, s3)
        if d < ci:
            return _lj_of(d2, a_cg, c_cg, 0.0)
        return _cubic_of(d, ci, u_ci, e0, e1, e2, e3)


def _in_order(*numbers):
    si, so, ci, co = numbers[-4:]
    return None if 0 < si <= so <= ci <= co else "the cutoffs must be positive and not decrease"


inner_outer(LennardJonesSmooth, mix=mix_lj_distances)


@pair_style("lj/cubic")
def _cubic_style(inp: StyleInput):
    inp.numbers(inp.args, [])
    given = inp.by_pair(lambda line: (*inp.numbers(line.words, _LJ, line), 1.0))
    mix = lambda a, b, rule: (*mix_lj_distances(a[:2], b[:2], rule), 1.0)  # noqa: E731
    return LennardJonesCubic.internal(*fill(inp, given, 3, mix))


@pair_style("lj/relres")
def _relres_style(inp: StyleInput):
    wants = RelativeResolution.numbers
    cutoffs = inp.numbers(inp.args, wants[4:])
    inp.require(_in_order(*cutoffs))

    def mix(a, b, rule):
        cutoffs = (mix_distance(x, y, rule) for x, y in zip(a[4:], b[4:], strict=True))
        return (*mix_lj_distances(a[:2], b[:2], rule), *mix_lj_distances(a[2:4], b[2:4], rule), *cutoffs)

    return RelativeResolution.internal(*several_cutoffs(inp, wants, cutoffs, mix, _in_order), shift=inp.modify.shift)
