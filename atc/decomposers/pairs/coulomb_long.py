"""Pair styles with long-range Coulomb: the bonds of Ewald's split inside the cutoff, for LAMMPS's ``…/coul/long``
styles.

The smooth part is a term of its own, which ``kspace_style`` asks for: see `long_range`.
"""

from __future__ import annotations

from math import erfc

import numpy as np

from ...compiled import njit
from ..long_range.split import ACCURACY, Split
from ..registry import StyleInput, pair_style
from .buckingham import Born, Buckingham
from .charmm import (
    LennardJonesCharmm,
    LennardJonesCharmmFSW,
    OneFour,
    charmm_coefficients,
    three_cutoffs,
)
from .coulomb import positive, wanted_pairs
from .input import named
from .inverse_powers import NM, Class2, _exponents
from .lennard_jones import LennardJones, mix_lj
from .pairs import PairStyle
from .radial import both_cutoffs, mix_lj6, short_values
from .with_coulomb import positive_rho


class CoulombLong(PairStyle):
    """U = C q_i q_j [erfc(αd)/d − (1 − w)/d], w the pair's weight: the bonds of Ewald's split (LAMMPS ``coul/long``).

    A pair of weight w < 1 loses 1 − w of its whole Coulomb energy, the smooth part's share included, if it is within
    the script's cutoff. erfc is exact; LAMMPS's is a polynomial (1.5e-7), or a table of it. α follows from the script's
    cutoff and need not be the run's.

    Parameters
    ----------
    on : (n_types + 1, n_types + 1) bool, pairs of types
    split : Split, internal units
    reach : the script's cutoff; None: that of the split
    """

    name = "coul/long"
    weight = "coul"
    needs_charges = True
    keeps_excluded = True
    numbers = (("cutoff", "length"),)
    #: the run's own table of it has 2 to this many entries, 0: none (``pair_modify table``)
    run_table = 12

    def __init__(self, on, split: Split, reach: float | None = None):
        self.on, self.split, self.reach = np.asarray(on, bool), split, split.cutoff if reach is None else reach
        self._set(np.where(self.on, max(split.cutoff, self.reach), 0.0))

    def at(self, accuracy: float, alpha: float | None = None) -> CoulombLong:
        """The same with another accuracy, or α."""
        new = CoulombLong(self.on, self.split.at(accuracy, alpha), self.reach)
        new.run_table = self.run_table
        new.own_special, new.water = self.own_special, self.water
        return new

    def prepare(self, frame):
        return frame.charges

    def add(self, types, i, j, d2, weights, U, G, prepared):
        near2, lost2 = self.split.cutoff**2, self.reach**2
        _long(types, i, j, d2, weights, self.table, near2, lost2, self.split.constant, self.split.alpha, prepared, U, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _long(types, i, j, d2, weights, table, near2, lost2, constant, alpha, q, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p, k = i[b], j[b]
        if d2[b] < table[types[p], types[k], 0]:
            near = d2[b] < near2
            share = weights[b] - 1.0 if weighted and d2[b] < lost2 else 0.0
            c = constant * q[p] * q[k]
            if c == 0.0 or not (near or share != 0.0):
                continue
            d = np.sqrt(d2[b])
            c /= d
            slope = 0.0
            if near:
                share += erfc(alpha * d)
                slope = 2.0 / np.sqrt(np.pi) * alpha * d * np.exp(-alpha * alpha * d2[b])
            U[b] += c * share
            G[b] -= c * (share + slope) / d2[b]


# LAMMPS's lines
# ----------------------------------------------------------------------------------------------------------------------


def long_style(inp: StyleInput, cutoff: float) -> CoulombLong:
    """A composite style's ``coul/long`` part."""
    style = CoulombLong(wanted_pairs(inp), Split.of(positive(inp, cutoff), inp.coulomb, ACCURACY))
    style.run_table = inp.modify.table
    return style


@pair_style("coul/long")
def _coul_long(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    named(inp)
    return long_style(inp, rc)


def _with_long(name, cls, mix=None, check=None):
    """``pair_style NAME cutoff [cutoff_coul]``; the Coulomb part has one cutoff for all pairs of types."""

    def build(inp: StyleInput):
        rc, rcoul = both_cutoffs(inp, inp.args)
        return [cls.of(inp, *short_values(inp, cls.numbers, rc, mix, check)), long_style(inp, rcoul)]

    pair_style(name)(build)


_with_long("lj/cut/coul/long", LennardJones, mix_lj)
_with_long("buck/coul/long", Buckingham, check=positive_rho)
_with_long("born/coul/long", Born, check=positive_rho)
_with_long("lj/class2/coul/long", Class2, mix_lj6)
_with_long("nm/cut/coul/long", NM, check=_exponents)


def _charmm_long(name, cls, shifted):
    def build(inp: StyleInput):
        inner, outer, rc = three_cutoffs(inp)
        *lj, e14, s14, _ = charmm_coefficients(inp, inner, outer)
        style = cls.internal(*lj)
        # Dihedral style charmmfsw leaves the charges of its pairs alone here.
        style.one_four = OneFour(e14, s14, inp.coulomb, cutoffs=(inner, outer, np.inf) if shifted else None)
        return [style, long_style(inp, outer if rc is None else rc)]

    pair_style(name)(build)


_charmm_long("lj/charmm/coul/long", LennardJonesCharmm, False)
_charmm_long("lj/charmmfsw/coul/long", LennardJonesCharmmFSW, True)


def lj_long(inp: StyleInput, words, coulomb) -> list:
    """The styles of ``lj/long/…`` lines, `words` behind what they say of water: two flags and one or two cutoffs.

    coulomb : function of a cutoff, the long-range Coulomb style
    """
    if len(words) < 3:
        raise inp.wrong(f"{inp.command} takes two flags and one or two cutoffs")
    lj, coul, *cutoffs = words
    if lj not in ("long", "cut", "off") or coul not in ("long", "off"):
        raise inp.error(
            f"{inp.command} takes the flags long, cut or off (Lennard-Jones) and long or off (Coulomb), as LAMMPS, got "
            f"{lj} {coul}"
        )
    rc, rcoul = both_cutoffs(inp, cutoffs)
    arrays = short_values(inp, LennardJones.numbers, rc, mix_lj)
    out = []
    if lj == "long":
        from .lj_long import long_dispersion

        out = [long_dispersion(inp, *arrays)]
    elif lj == "cut":
        out = [LennardJones.of(inp, *arrays)]
    return [*out, coulomb(rcoul)] if coul == "long" else out


@pair_style("lj/long/coul/long")
def _lj_long(inp: StyleInput):
    return lj_long(inp, inp.args, lambda rc: long_style(inp, rc))
