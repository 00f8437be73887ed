"""Bonds that speak for the pair interaction of their two atoms: LAMMPS's ``quartic`` takes it away while the bond
holds, ``special`` adds a part of it."""

from __future__ import annotations

import warnings

import numpy as np

from ...errors import AtcWarning
from ...frame import Frame
from ..pairs.pairs import ONES, Pairs, PairStyle
from .bond import BondStyle, lengths
from .cluster import ClusterWork, first_not_finite
from .topology import energy, length, per_length4, plain


class OwnPairs:
    """The pair styles of a model, evaluated between bonded atoms only."""

    def __init__(self, pairs: Pairs | list[PairStyle] | None, frame: Frame):
        top = int(frame.types.max()) if len(frame) else 0
        if isinstance(pairs, Pairs):
            styles = pairs.styles if top <= pairs.n_types or pairs.grow is None else pairs.grow(top)
        else:
            styles = pairs or []
        if any(s.needs_charges for s in styles):
            frame.require("charges", why="a coulomb pair style")
        self.types = frame.types.astype(np.int32)
        self.styles = [(s, s.prepare(frame)) for s in styles]

    def of(self, i, j, d, lj=None, coul=None):
        """U and G of the pairs i, j at distances d, all (b,), weighted by lj and coul (b,) (None: 1)."""
        U, G = np.zeros(len(d)), np.zeros(len(d))
        weights = {"lj": ONES if lj is None else lj, "coul": ONES if coul is None else coul, None: ONES}
        for s, prepared in self.styles:
            s.add(self.types, i, j, d * d, weights[s.weight], U, G, prepared)
        return U, G


class PairedBond(BondStyle):
    """Base of bonds that need the pair styles of their model.

    pairs : the `Pairs` term or the list of PairStyle of the same potential; None where it has no pair interaction
    """

    pairs: Pairs | list[PairStyle] | None = None

    def __init__(self, coeffs, *, units="metal", pairs=None):
        super().__init__(coeffs, units=units)
        self.pairs = pairs

    def with_pairs(self, own: OwnPairs, i, j, types, d):
        """U and G of bonds of lengths d, all (b,)."""
        raise NotImplementedError

    def prepare(self, frame):
        return _PairedWork(self, frame)

    @classmethod
    def build(cls, inp):
        self = super().build(inp)
        self.pairs = inp.pairs
        self.check_pairs(inp)
        return self

    def check_pairs(self, inp):
        """Whether pair and special_bonds settings are those the style needs, or an error."""


class _PairedWork(ClusterWork):
    def __init__(self, term: PairedBond, frame: Frame):
        super().__init__(term, frame)
        self.own = OwnPairs(term.pairs, frame)

    def evaluate(self, atoms, x, types, U, G, acc):
        d = lengths(x)
        U[:], G[:, 0] = self.term.with_pairs(self.own, *atoms.T, types, d)
        acc.note(self.term.noted, self.term.count(types, d))
        return first_not_finite(U, G)


class QuarticBond(PairedBond):
    """A bond that breaks (LAMMPS ``quartic``): U = K y² (y − B1)(y − B2) + U0 + LJ − U_pair for y = d − R_c ≤ 0, and 0
    beyond.

    LJ is 4[d⁻¹² − d⁻⁶] + 1 up to 2^(1/6), in the units of the coefficients. U_pair is what the pair style gives these
    two atoms: it is left to broken bonds, so special_bonds must be 1 1 1. Coefficients K [energy/length⁴], B1, B2, R_c
    [length], U0 [energy].

    LAMMPS breaks a bond for good once it is longer than R_c (its type becomes 0). Bonds longer than R_c are counted in
    the notes: one that broke before this frame and is shorter again cannot be told from the positions; only a topology
    of the frame itself knows.
    """

    name = "quartic"
    wants = (("K", per_length4), ("B1", length), ("B2", length), ("R_c", length), ("U0", energy))
    noted = (
        "quartic bonds longer than their cutoff: broken, without a force (bonds that broke earlier and are short again "
        "are not known)"
    )

    def check_pairs(self, inp):
        special = inp.pair_weights
        charged = any(s.needs_charges for s in inp.pair_styles)
        if special is not None and {*special.lj, *(special.coul if charged else ())} != {1.0}:
            raise inp.error(
                "bond_style quartic needs 'special_bonds lj/coul 1 1 1': it takes the pair interaction of its atoms "
                "away itself"
            )

    def count(self, types, d):
        return np.count_nonzero(d > self.table[types, 3])

    def with_pairs(self, own, i, j, types, d):
        U, G, holds = np.zeros(len(d)), np.zeros(len(d)), d <= self.table[types, 3]
        i, j, d, types = i[holds], j[holds], d[holds], types[holds]
        K, B1, B2, Rc, U0 = self.columns(types)
        y = d - Rc
        p, q = y - B1, y - B2
        u = K * y * y * p * q + U0
        slope = K * y * (2.0 * p * q + y * (p + q))
        with np.errstate(divide="ignore", invalid="ignore"):  # said by `complaint`
            s6 = np.where(d < 2.0 ** (1 / 6) * self.units.length, (self.units.length / d) ** 6, 0.0)
            u += self.units.energy * np.where(s6 > 0, 4.0 * s6 * (s6 - 1.0) + 1.0, 0.0)
            slope -= self.units.energy * 48.0 * s6 * (s6 - 0.5) / d
            pair_U, pair_G = own.of(i, j, d)
            U[holds], G[holds] = u - pair_U, slope / d - pair_G
        return U, G

    def refuse(self, t, d):
        return "where its repulsion is infinite: two bonded atoms are at the same place"


class SpecialBond(PairedBond):
    """A part of the pair interaction between two listed atoms (LAMMPS ``special``). Coefficients: two weights between 0
    and 1.

    LAMMPS's manual names the first the weight of the Lennard-Jones part and the second that of the Coulomb part. LAMMPS
    itself (22 Jul 2025, measured) applies them the other way round, and so does this: a trajectory has what was
    computed. Where the two differ and there are charges, a warning says so.

    In LAMMPS these pairs are then 1-2 neighbours, which special_bonds must leave out of the pair style (weight 0).
    """

    name = "special"
    wants = (("w1", plain), ("w2", plain))

    def row(self, w1, w2):
        if not (0 <= w1 <= 1 and 0 <= w2 <= 1):
            raise ValueError("the weights must be between 0 and 1")
        return w1, w2

    def check_pairs(self, inp):
        special = inp.pair_weights
        if inp.pairs is None:
            raise inp.error(
                "bond_style special weighs the pair interaction of its atoms, but there is none that is a sum over "
                "pairs: add a pair_style"
            )
        if special is not None and (special.lj[0] or special.coul[0]):
            raise inp.error(
                "bond_style special needs the special_bonds weights of 1-2 neighbours to be 0: it adds their pair "
                "interaction itself"
            )
        if (self.table[:, 0] != self.table[:, 1]).any() and any(s.needs_charges for s in inp.pairs.styles):
            warnings.warn(
                f"{inp.where}: bond_style special: LAMMPS applies the first weight to the Coulomb and the second to "
                "the Lennard-Jones part, other than its manual says, and so does atc: compare energies with the run if "
                "its LAMMPS is not of 2025",
                AtcWarning,
                stacklevel=2,
            )
        if any(s.keeps_excluded for s in inp.pairs.styles):
            raise inp.error(
                "bond_style special is not supported with coul/dsf and coul/wolf, which count excluded pairs in part"
            )

    def with_pairs(self, own, i, j, types, d):
        w = self.table[types]
        return own.of(i, j, d, np.ascontiguousarray(w[:, 1]), np.ascontiguousarray(w[:, 0]))

    def refuse(self, t, d):
        return "where the pair interaction is not finite"
