"""LAMMPS's composite styles: a short-range formula and a Coulomb part in one line."""

from __future__ import annotations

import numpy as np

from ..registry import StyleInput, pair_style
from .buckingham import Born, Buckingham, positive_rho
from .coulomb import CoulombCut, CoulombDSF, CoulombDSFExact, CoulombWolf, positive, wanted_pairs
from .input import fill, mix_distance
from .inverse_powers import NM, Class2
from .lennard_jones import LennardJones, mix_lj
from .radial import COULOMB_CUTOFF, CUTOFF, both_cutoffs, mix_lj6, short_values
from .screened_coulomb import CoulombDebye
from .soft_core import Class2Soft, CoulombSoft, LennardJonesSoft, mix_soft, mix_soft6

_PLAIN = "dimensionless"


def two_cutoffs(inp: StyleInput, front, numbers, mix=None, check=None):
    """The numbers of ``pair_style NAME <front> cutoff [cutoff_coul]`` and ``pair_coeff i j <numbers> [cutoff
    [cutoff_coul]]``.

    One cutoff on a line is for both parts. Cutoffs of unlike types are mixed if `mix` (of the other numbers and the
    first cutoff) is there.

    Returns
    -------
    the front numbers, the arrays of `numbers`, the short-range cutoffs and the Coulomb cutoffs, internal units
    """
    *front, rc, rcoul = both_cutoffs(inp, inp.args, front)

    def read(line):
        *values, a, b = inp.numbers(line.words, [*numbers, CUTOFF, COULOMB_CUTOFF], line, optional=2)
        inp.require(check(*values) if check is not None else None, line)
        a, b = (rc, rcoul) if a is None else (a, a) if b is None else (a, b)
        return (*values, a, b)

    def both(x, y, rule):
        return (*mix(x[:-1], y[:-1], rule), mix_distance(x[-1], y[-1], rule))

    *arrays, cut, cut_coul = fill(inp, inp.by_pair(read), len(numbers) + 2, both if mix is not None else None)
    return front, arrays, cut, cut_coul


def _with_coul_cut(name, cls, mix=None, check=None):
    def build(inp: StyleInput):
        _, arrays, cut, cut_coul = two_cutoffs(inp, [], cls.numbers[:-1], mix, check)
        return [cls.of(inp, *arrays, cut), CoulombCut.of(inp, cut_coul)]

    pair_style(name)(build)


_with_coul_cut("lj/cut/coul/cut", LennardJones, mix_lj)
_with_coul_cut("buck/coul/cut", Buckingham, check=positive_rho)
_with_coul_cut("nm/cut/coul/cut", NM)
_with_coul_cut("lj/class2/coul/cut", Class2, mix_lj6)


@pair_style("lj/cut/coul/debye")
def _lj_debye(inp: StyleInput):
    (kappa,), arrays, cut, cut_coul = two_cutoffs(inp, [("kappa", {"length": -1})], LennardJones.numbers[:-1], mix_lj)
    return [LennardJones.of(inp, *arrays, cut), CoulombDebye.of(inp, np.full_like(cut, kappa), cut_coul)]


def _both_soft(name, cls, mix):
    def build(inp: StyleInput):
        front = [("n", _PLAIN), ("alpha_LJ", _PLAIN), ("alpha_C", {"length": 2})]
        (n, alpha, alpha_c), (e, s, activation), cut, cut_coul = two_cutoffs(inp, front, cls.numbers[:3], mix)
        n = np.full_like(e, n)
        return [
            cls.of(inp, e, s, activation, n, np.full_like(e, alpha), cut),
            CoulombSoft.of(inp, activation, n, np.full_like(e, alpha_c), cut_coul),
        ]

    pair_style(name)(build)


_both_soft("lj/cut/coul/cut/soft", LennardJonesSoft, mix_soft)
_both_soft("lj/class2/coul/cut/soft", Class2Soft, mix_soft6)


def _with_damped(names, cls, damped, mix=None, check=None):
    """``pair_style NAME alpha cutoff [cutoff_coul]``; the Coulomb part has one cutoff for all pairs of types."""

    def build(inp: StyleInput):
        alpha, rc, rcoul = both_cutoffs(inp, inp.args, [("alpha", {"length": -1})])
        coulomb = damped.everywhere(wanted_pairs(inp), alpha, positive(inp, rcoul), inp.coulomb)
        return [cls.of(inp, *short_values(inp, cls.numbers, rc, mix, check)), coulomb]

    pair_style(*names)(build)


# The core/shell variants differ by 1e-20 length² in d², for charges at the same place.
_with_damped(("born/coul/dsf", "born/coul/dsf/cs"), Born, CoulombDSFExact, check=positive_rho)
_with_damped(("born/coul/wolf", "born/coul/wolf/cs"), Born, CoulombWolf, check=positive_rho)
_with_damped(("lj/cut/coul/wolf",), LennardJones, CoulombWolf, mix_lj)
_with_damped(("lj/cut/coul/dsf",), LennardJones, CoulombDSF, mix_lj)
