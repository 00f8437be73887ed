"""How far a run's own Coulomb sum may be from the exact one, where it computes it by Ewald's split.

LAMMPS's near part has erfc by the polynomial of Abramowitz & Stegun 7.1.26, which is good to 1.5e-7, or interpolates
linearly, in d², in a table of C q_i q_j f(αd)/d³ with f = erfc(x) + 2x e^{−x²}/√π (Wolff & Rudd, Comput. Phys. Commun.
120 (1999) 20). Both errors are relative to the bare Coulomb force C q_i q_j/d² of a pair, so that pairs at bond length
have the largest ones, also where special bonds take their Coulomb force away. α, and with it the error itself, is the
run's secret; its bound is not.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from math import ceil, floor, log, log2

import numpy as np

from ..decomposers.constraints.virtual_sites import only_atoms
from ..decomposers.long_range.kspace import coulomb_of
from ..decomposers.pairs.coulomb_long import CoulombLong
from ..decomposers.pairs.pairs import Pairs

#: Largest error of Abramowitz & Stegun's polynomial.
POLYNOMIAL = 1.5e-7
#: Linear interpolation in s = d² errs by h² |y''|/8 within a step h. For y = s^{−3/2} f, s^{7/2} |y''| is at most 15/4
#: (its value for f = 1), so that steps of s/2^m have an error of 15/32 4^{−m}, relative to the bare force.
CURVATURE = 15.0 / 32.0
#: LAMMPS's table begins at the square of this distance, by default (units of length of the run).
INNER2 = 2.0
#: Distances are told apart so finely: α times such a step is 0.02, over which the polynomial's error hardly changes.
BINS = 250


@dataclass
class CoulombDoubt:
    """force_n (n,) of the forces, run : the part of it that is the accuracy which the run was asked for (both internal
    units); energy, virial_cc : of energy and virial; relative : of the near part's pairs."""

    force_n: np.ndarray
    run: float
    energy: float
    virial_cc: np.ndarray
    relative: float

    def describe(self, units) -> str:
        asked = f"forces to {units.to_user('force', self.run):.3g} {units.label('force')} were asked for, and " * (
            self.run > 0
        )
        return f"the accuracy of the run's Coulomb sum ({asked}its erfc is good to {self.relative:.2g} of a pair's)"


def relative_error(style: CoulombLong, length: float) -> float:
    """Bound of the run's error of a pair's near part, over the bare Coulomb force. length : the run's unit."""
    cutoff2 = (style.reach / length) ** 2
    if not style.run_table or cutoff2 <= INNER2:
        return POLYNOMIAL
    # A table is indexed by the leading bits of d² as a binary number: those that tell its power of 2, and m of its
    # fraction. It is made with the polynomial.
    powers = floor(log2(cutoff2)) - floor(log2(INNER2)) + 1
    m = style.run_table - ceil(log2(powers))
    return POLYNOMIAL + CURVATURE * 4.0**-m


class _Bare(CoulombLong):
    """The bare Coulomb force of pairs inside the cutoff, whatever special bonds say."""

    def __init__(self, style: CoulombLong):
        self.on, self.split, self.reach, self.table = style.on, style.split, style.reach, style.table
        self.own_special, self.water = style.own_special, style.water

    def add(self, types, i, j, d2, weights, U, G, prepared):
        near = d2 < self.table[types[i], types[j], 0]
        G[near] += self.split.constant * (prepared[i] * prepared[j] / d2**1.5)[near]


def coulomb_doubt(frame, pot, threads: int = 1) -> CoulombDoubt | None:
    """What of a difference between a run and a potential is due to the run's own Coulomb sum; None for a potential
    without one.

    Errors of an atom's pairs are taken as independent in its force. In energy and virial all pairs at one distance
    have the same, and different distances may add up. What the accuracy that was asked for, δF, leaves out there is of
    pairs near the cutoff r_c and of short waves, alike for like atoms. If all of it adds up, r·F over the atoms is
    N r_c δF, a third of it along each axis; and erfc(αd)/d, whose derivative is 2α²d times itself where it is small,
    has an energy of N δF/(2α²r_c), in which e^{−(αr_c)²} is about the relative accuracy.
    """
    runs = [t.run for t in pot.fields if t.run is not None]
    terms = [t for t in pot.terms if isinstance(t, Pairs) and coulomb_of([t])]
    if not runs or not terms or not len(frame):
        return None
    frame = pot.carriers(frame)
    n = len(frame)
    near = copy(pot)
    near.constraints = None
    near.terms = []
    for t in terms:
        grow = t.grow and (lambda top, grow=t.grow: [_Bare(s) for s in grow(top) if isinstance(s, CoulombLong)])
        bare = [_Bare(s) for s in coulomb_of([t])]
        near.terms.append(type(t)(bare, t.n_types, t.special, grow, t.exclusions, t.kinds))
    styles = coulomb_of(terms)
    relative = max(relative_error(s, pot.units.length) for s in styles)
    cutoff = max(s.reach for s in styles)
    step = cutoff / BINS
    squares = [np.zeros(n) for _ in range(threads)]
    by_distance = [np.zeros((7, BINS + 1)) for _ in range(threads)]

    def consume(bonds, thread):
        d2 = (bonds.r_bc**2).sum(1)
        f2 = bonds.G_b**2 * d2
        squares[thread] += np.bincount(bonds.i, f2, n) + np.bincount(bonds.j, f2, n)
        bins = np.minimum((np.sqrt(d2) / step).astype(int), BINS)
        sums = by_distance[thread]
        sums[0] += np.bincount(bins, bonds.G_b * d2, BINS + 1)
        for k, (a, b) in enumerate(zip(*np.triu_indices(3)), 1):
            sums[k] += np.bincount(bins, bonds.G_b * bonds.r_bc[:, a] * bonds.r_bc[:, b], BINS + 1)

    near.stream(frame, consume, threads=threads)
    of = relative * np.abs(sum(by_distance)).sum(1)
    virial = np.zeros((3, 3))
    virial[np.triu_indices(3)] = of[1:]
    asked = float(sum(r.force for r in runs))
    # What is on a virtual site its parents have, as if it came from one pair.
    near_n = only_atoms(frame, np.sqrt(sum(squares)))
    force, far = np.hypot(asked, relative * near_n), len(near_n) * cutoff * asked
    unit = pot.units.coulomb * pot.units.charge**2 / pot.units.length**2
    falls = max(log(unit / asked), 1.0) if asked > 0 else 1.0
    return CoulombDoubt(
        force, asked, float(of[0]) + far / (2 * falls), np.maximum(virial, virial.T) + far / 3, relative
    )
