"""How many points a bond becomes: Gauss-Legendre rules of 1, 2, .. points, by a bond's length and strength."""

from __future__ import annotations

from functools import cached_property
from math import ceil

import numpy as np

from . import fourier, spread

# Points a bond gets at most before it is cut into pieces.
MOST = 10
# Bonds among which the loosest sufficient choice of points is looked for, and how far it may go (in powers of two).
SAMPLE, LOOSEST = 600, 8


class BondPoints:
    """The rules for bonds of a kernel. share : what their error may be, of a bond of mean strength; gradients : whether
    it is meant for gradients as well."""

    def __init__(self, kernel, share, gradients):
        self.kernel, self.share, self.gradients = kernel, share, gradients

    @cached_property
    def rules(self):
        """Nodes and weights of all rules."""
        return fourier.legendre_rules(MOST)

    @cached_property
    def levels(self) -> np.ndarray:
        """What a bond's error may be, by its strength. Not below what rounding lets a rule do."""
        return np.maximum(self.share * 2.0 ** np.arange(-spread.LEVELS, spread.LEVELS + 1), 1e-13)

    @cached_property
    def longest(self) -> np.ndarray:
        """The longest bonds that the rules do for, by level."""
        return fourier.longest_bonds(self.kernel, self.levels, MOST, self.gradients)

    @cached_property
    def _longest_of_mean(self) -> np.ndarray:
        """The longest bonds of about mean strength that 1, 2, .. points do for."""
        return fourier.longest_bonds(self.kernel, np.array([2.0 * self.share]), MOST, self.gradients)[0]

    def points_of(self, length: float) -> int:
        """How many points a bond of this length and of mean strength becomes: an estimate, see `slack`."""
        longest = self._longest_of_mean
        enough = np.flatnonzero(longest >= length)
        return int(enough[0]) + 1 if len(enough) else MOST * ceil(length / longest[-1])

    def slack(self, i_b, r_bc, b_bk, weight_k, collapse=None):
        """By how much the error of a bond may exceed its share of the tolerance, as a power of two, when that of all
        together does not.

        With one number of points or another most bonds do far better than they must. collapse : the longest bonds that
        do not become points, by level, and their error as a function of the length.
        """
        some = slice(None, None, max(1, len(i_b) // SAMPLE))
        strength = (np.abs(b_bk[some]) * weight_k).max(1)
        length = np.linalg.norm(r_bc[some], axis=1)
        length, strength = length[strength > 0], strength[strength > 0]
        longest = self.longest
        level = spread.LEVELS - np.frexp(strength)[1]
        for slack in range(LOOSEST, 0, -1):
            enough = longest[np.clip(level + slack, 0, 2 * spread.LEVELS)]
            m = np.minimum((length[:, None] > enough).sum(1), MOST - 1)
            pieces = np.maximum(1.0, np.ceil(length / enough[np.arange(len(m)), m]))
            part = fourier.rule_error(self.kernel, m, length / pieces, self.gradients)
            if collapse is not None:
                short = length <= collapse[0][np.clip(level + slack, 0, 2 * spread.LEVELS)]
                part[short] = collapse[1](length[short])
            part *= strength
            # Mean strength is 1 or more: sums in step, and of squares.
            if part.mean() <= self.share and np.sqrt((part**2).mean()) <= self.share * np.sqrt((strength**2).mean()):
                return slack
        return 0
