"""CHARMM's pair interactions: energies switched off, or forces switched and shifted off, towards the outer cutoff."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...compiled import njit
from ..registry import StyleInput, pair_style
from .coulomb import positive
from .input import fill
from .lennard_jones import LennardJones
from .loop import pair_law
from .radial import ChargedStyle, RadialStyle, four_cutoffs, inner_below_outer, mix_lj_distances

_lj = LennardJones.law
_LJ = (("epsilon", "energy"), ("sigma", "length"), ("inner", "length"), ("cutoff", "length"))


class LennardJonesCharmm(RadialStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] S(d), the Lennard-Jones part of LAMMPS ``lj/charmm/coul/charmm``.

    S = 1 for d < inner and (r_c² − d²)²(r_c² + 2d² − 3 inner²)/(r_c² − inner²)³ beyond, r_c the cutoff.
    Numbers: epsilon, sigma, inner, cutoff; see `RadialStyle`.

    Attributes
    ----------
    one_four : `OneFour` or None, what dihedral style charmm needs for the pairs at the ends of dihedrals
    """

    name = "lj/charmm"
    numbers = _LJ
    shifts = False

    def columns(self, epsilon, sigma, inner, cutoff):
        return 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, inner**2, (cutoff**2 - inner**2) ** -3.0, cutoff**2

    @pair_law
    def law(d2, a12, c6, inner2, inverse, outer2):
        u, g = _lj(d2, a12, c6)
        S, dS = _switch(d2, outer2, inner2, inverse)
        return u * S, g * S + 2.0 * u * dS


def force_switched_powers(a, c, inner, cutoff):
    """Of a/d¹² − c/d⁶ with CHARMM's force switch: what is added up to the inner cutoff, what the squares beyond are
    multiplied by, and 1/cutoff³."""
    i3, c3 = inner**3, cutoff**3
    k12, k6 = a * c3**2 / (c3**2 - i3**2), c * c3 / (c3 - i3)
    return -a / (i3 * c3) ** 2 + c / (i3 * c3), k12, k6, 1 / c3


class LennardJonesCharmmFSW(RadialStyle):
    """Lennard-Jones with CHARMM's force switch, the Lennard-Jones part of LAMMPS ``lj/charmmfsw/coul/charmmfsh``.

    U = A(1/d¹² − 1/(r_i r_c)⁶) − B(1/d⁶ − 1/(r_i r_c)³) for d < r_i, the inner cutoff, and beyond U = A r_c⁶/(r_c⁶ −
    r_i⁶) (1/d⁶ − 1/r_c⁶)² − B r_c³/(r_c³ − r_i³) (1/d³ − 1/r_c³)² (Steinbach & Brooks, J. Comput. Chem. 15, 667), A =
    4εσ¹², B = 4εσ⁶. The force beyond r_i is LAMMPS's: that of Lennard-Jones times S of `LennardJonesCharmm`, which is
    close to, but not, the slope of this energy. Numbers: epsilon, sigma, inner, cutoff; see `RadialStyle`.
    """

    name = "lj/charmmfsw"
    numbers = _LJ
    shifts = False

    def columns(self, epsilon, sigma, inner, cutoff):
        a, c = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6
        beyond = force_switched_powers(a, c, inner, cutoff)
        return a, c, inner**2, (cutoff**2 - inner**2) ** -3.0, *beyond, cutoff**2

    @pair_law
    def law(d2, a12, c6, inner2, inverse, offset, k12, k6, per_volume, outer2):
        u, g = _lj(d2, a12, c6)
        if d2 <= inner2:
            return u + offset, g
        s2 = 1.0 / d2
        s6 = s2 * s2 * s2
        x = s6 - per_volume * per_volume
        y = np.sqrt(s6) - per_volume
        return k12 * x * x - k6 * y * y, g * _switch(d2, outer2, inner2, inverse)[0]


class CoulombCharmm(ChargedStyle):
    """U = C q_i q_j S(d)/d, S as for `LennardJonesCharmm` (the Coulomb part of LAMMPS ``lj/charmm/coul/charmm``).

    The force is LAMMPS's, S(d) times that of the bare charges: where S changes it is not the slope of the energy.
    Numbers: inner, cutoff; see `ChargedStyle`.
    """

    name = "coul/charmm"
    numbers = (("inner", "length"), ("cutoff", "length"))

    def columns(self, inner, cutoff):
        return inner**2, (cutoff**2 - inner**2) ** -3.0, cutoff**2

    @pair_law
    def law(d2, c, inner2, inverse, outer2):
        S, _ = _switch(d2, outer2, inner2, inverse)
        u = c / np.sqrt(d2) * S
        return u, -u / d2


class CoulombCharmmImplicit(CoulombCharmm):
    """U = C q_i q_j S(d)/d², a dielectric constant that grows like the distance (the Coulomb part of LAMMPS
    ``lj/charmm/coul/charmm/implicit``).

    C q_i q_j/d² is an energy where lengths are in the unit style's unit. Numbers: inner, cutoff; see `ChargedStyle`.
    """

    name = "coul/charmm/implicit"

    @pair_law
    def law(d2, c, inner2, inverse, outer2):
        S, dS = _switch(d2, outer2, inner2, inverse)
        u = c / d2
        return u * S, -2.0 * u * (S / d2 - dS)


class CoulombCharmmFSH(ChargedStyle):
    """U = C q_i q_j (1/d + d/r_c² − 2/r_c), force C q_i q_j (1/d² − 1/r_c²) (the Coulomb part of LAMMPS
    ``lj/charmmfsw/coul/charmmfsh``).

    Numbers: cutoff; see `ChargedStyle`.
    """

    name = "coul/charmmfsh"
    numbers = (("cutoff", "length"),)

    def columns(self, cutoff):
        return (1 / cutoff,)

    @pair_law
    def law(d2, c, per_cutoff):
        d = np.sqrt(d2)
        return c * (1.0 / d + per_cutoff * (d * per_cutoff - 2.0)), -c * (1.0 / d2 - per_cutoff * per_cutoff) / d


class OneFour:
    """What the first and the fourth atom of a dihedral of style charmm do to each other: Lennard-Jones of their own and
    bare charges, no cutoff.

    a, c : (n_types + 1, n_types + 1) 4ε₁₄σ₁₄¹² and 4ε₁₄σ₁₄⁶, internal units
    constant : Coulomb constant; with `implicit` for C q_i q_j/d²
    cutoffs : (inner, outer, Coulomb) cutoffs of the force-switched and force-shifted style, on which energies of
        dihedral style charmmfsw depend
    """

    def __init__(self, epsilon, sigma, constant: float, implicit: bool = False, cutoffs=None):
        self.a, self.c = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6
        self.constant, self.implicit = constant, implicit
        self.shifted = cutoffs is not None
        inner, outer, coulomb = cutoffs or (np.inf, np.inf, np.inf)
        self.offset = -self.a / (inner * outer) ** 6 + self.c / (inner * outer) ** 3
        self.inverse_cutoff = 1 / coulomb


def charmm_coefficients(inp: StyleInput, inner, outer):
    """Arrays epsilon, sigma, inner, outer (0 where the style does not act), epsilon_14, sigma_14, and 1 where it
    acts."""
    # CHARMM mixes arithmetically unless told otherwise.
    inp = inp.replace(modify=replace(inp.modify, mix=inp.modify.mix or "arithmetic"))
    wants = (*_LJ[:2], ("epsilon_14", "energy"), ("sigma_14", "length"))

    def read(line):
        if len(line.words) not in (2, 4):
            raise inp.wrong(f"pair_coeff of {inp.name} takes epsilon sigma [epsilon_14 sigma_14]", line)
        e, s, e14, s14 = inp.numbers(line.words, wants, line, optional=2)
        return (e, s, *((e, s) if e14 is None else (e14, s14)), 1.0)

    def mix(a, b, rule):
        return (*mix_lj_distances(a[:2], b[:2], rule), *mix_lj_distances(a[2:4], b[2:4], rule), 1.0)

    epsilon, sigma, e14, s14, on = fill(inp, inp.by_pair(read), 5, mix)
    return epsilon, sigma, on * inner, on * outer, e14, s14, on


def three_cutoffs(inp: StyleInput) -> list[float | None]:
    """inner and outer cutoffs of Lennard-Jones, and the one of Coulomb or None."""
    names = ("inner LJ cutoff", "outer LJ cutoff", "Coulomb cutoff")
    inner, outer, rc = inp.numbers(inp.args, [(n, "length") for n in names], optional=1)
    inp.require(inner_below_outer(inner, outer, "LJ "))
    return [inner, outer, rc]


def _switched(coulomb, implicit):
    def build(inp: StyleInput):
        inner, outer, inner_c, outer_c = four_cutoffs(inp)
        inp.require(inner_below_outer(inner_c, outer_c, "Coulomb "))
        *lj, e14, s14, on = charmm_coefficients(inp, inner, outer)
        style = LennardJonesCharmm.internal(*lj)
        charges = coulomb.of(inp, on * inner_c, on * outer_c)
        if implicit:
            charges.constant *= inp.units.length
        style.one_four = OneFour(e14, s14, charges.constant, implicit)
        return [style, charges]

    return build


pair_style("lj/charmm/coul/charmm")(_switched(CoulombCharmm, False))
pair_style("lj/charmm/coul/charmm/implicit")(_switched(CoulombCharmmImplicit, True))


@pair_style("lj/charmmfsw/coul/charmmfsh")
def _force_switched(inp: StyleInput):
    inner, outer, rc = three_cutoffs(inp)
    rc = outer if rc is None else positive(inp, rc)
    *lj, e14, s14, on = charmm_coefficients(inp, inner, outer)
    style = LennardJonesCharmmFSW.internal(*lj)
    charges = CoulombCharmmFSH.of(inp, on * rc)
    style.one_four = OneFour(e14, s14, charges.constant, cutoffs=(inner, outer, rc))
    return [style, charges]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _switch(x, outer2, inner2, inverse):
    """S and dS/d(d²) at x = d²."""
    if x <= inner2:
        return 1.0, 0.0
    t = outer2 - x
    return t * t * (outer2 + 2.0 * x - 3.0 * inner2) * inverse, 6.0 * t * (inner2 - x) * inverse
