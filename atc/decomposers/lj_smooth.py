"""Lennard-Jones whose force is joined to zero, or to another Lennard-Jones, by polynomials of the distance."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair_input import fill, mix_distance
from .radial import RadialStyle, inner_outer, mix_lj_distances, several_cutoffs
from .registry import StyleInput, pair_style

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


class LennardJonesCubic(RadialStyle):
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


def _in_order(*numbers):
    si, so, ci, co = numbers[-4:]
    return None if 0 < si <= so <= ci <= co else "the cutoffs must be positive and not decrease"


inner_outer(LennardJonesSmooth, mix=mix_lj_distances)


@pair_style("lj/cubic")
def _cubic_style(inp: StyleInput):
    inp.numbers(inp.args, [])
    given = {}
    for line in inp.coeffs:
        values = inp.numbers(line.words, _LJ, line)
        for pair in line.covers(inp.n_types):
            given[pair] = (*values, 1.0)
    return LennardJonesCubic.internal(
        *fill(inp, given, 3, lambda a, b, rule: (*mix_lj_distances(a[:2], b[:2], rule), 1.0))
    )


@pair_style("lj/relres")
def _relres_style(inp: StyleInput):
    wants = RelativeResolution.numbers
    cutoffs = inp.numbers(inp.args, wants[4:])
    wrong = _in_order(*cutoffs)
    if wrong:
        raise inp.error(f"{inp.command}: {wrong}, got {' '.join(inp.args)}")

    def mix(a, b, rule):
        cutoffs = (mix_distance(x, y, rule) for x, y in zip(a[4:], b[4:], strict=True))
        return (*mix_lj_distances(a[:2], b[:2], rule), *mix_lj_distances(a[2:4], b[2:4], rule), *cutoffs)

    return RelativeResolution.internal(*several_cutoffs(inp, wants, cutoffs, mix, _in_order), shift=inp.modify.shift)


@njit(cache=True, nogil=True, error_model="numpy")
def _smooth(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            t = d - p[3]
            if t > 0.0:
                u = p[4] - t * (p[5] + t * (p[6] / 2.0 + t * (p[7] / 3.0 + t * p[8] / 4.0)))
                g = (p[5] + t * (p[6] + t * (p[7] + t * p[8]))) / d
            else:
                s2 = 1.0 / d2[b]
                s6 = s2 * s2 * s2
                a = p[1] * s6 * s6
                c = p[2] * s6
                u = a - c
                g = (12.0 * a - 6.0 * c) * s2
            U[b] += w * (u - p[9])
            G[b] -= w * g


@njit(cache=True, nogil=True, error_model="numpy")
def _relres(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            if d < p[4] or (p[10] <= d and d < p[13]):
                # Lennard-Jones: fine with its constant, or coarse.
                near = d < p[4]
                s2 = 1.0 / d2[b]
                s6 = s2 * s2 * s2
                a = (p[1] if near else p[11]) * s6 * s6
                c = (p[2] if near else p[12]) * s6
                u = a - c + (p[3] if near else 0.0)
                g = (12.0 * a - 6.0 * c) * s2
            else:
                k = 5 if d < p[10] else 14
                t = d - (p[4] if d < p[10] else p[13])
                u = p[k] - t * (p[k + 1] + t * (p[k + 2] / 2.0 + t * (p[k + 3] / 3.0 + t * p[k + 4] / 4.0)))
                g = (p[k + 1] + t * (p[k + 2] + t * (p[k + 3] + t * p[k + 4]))) / d
            U[b] += w * (u - p[19])
            G[b] -= w * g


LennardJonesSmooth.kernel = LennardJonesCubic.kernel = staticmethod(_smooth)
RelativeResolution.kernel = staticmethod(_relres)
