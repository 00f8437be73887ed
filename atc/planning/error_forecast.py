"""Before the first frame is deposited: how far above the tolerance the spectral method may start.

Its own tolerance is relative to a field of independent sources, whose sum grows as the root of their number. Stresses
are mostly coherent, larger; errors then are far below the tolerance asked for, in shaken argon fifty to a hundred
times. Not always: where a few strong bonds make both the largest value and the largest error they are not, nor where
attraction and repulsion cancel. One pass over the bonds tells: the field's mean, the strongest bonds, whose error is
computed alone at every grid point, and the sum of squares of the others, whose errors add up at random. The check of
the first frame has the last word.
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from ..deposit import make
from ..estimators.accuracy.random_points import BEYOND
from ..estimators.accuracy.strongest_bonds import WATCHED, StrongestBonds, error_map
from ..estimators.tensors import outer6

#: Largest over rms error of many points, and the rms error over the tolerance asked for: measured on shaken silicon.
PEAK, PART = 4.5, 0.3


class ErrorForecast:
    """What one pass over the bonds of a frame says of the stress's error.

    Parameters
    ----------
    pot, frame : Potential, and Frame in internal units
    bound : BoundGrid. kern : Kernel in internal units. tolerance : of the result
    """

    def __init__(self, pot, frame, bound, kern, tolerance, threads=1):
        kern, frame = kern.cut(BEYOND * tolerance), pot.carriers(frame)
        self.bound, self.kern, self.cell = bound, kern, frame.cell
        strongest = StrongestBonds(frame.positions, threads)
        totals = [np.zeros((2, 6)) for _ in range(threads)]

        def consume(bonds, thread):
            _add(bonds.r_bc, bonds.G_b, totals[thread])
            strongest.add(bonds, thread)

        pot.stream(frame, consume, threads=threads)
        total, square = np.sum(totals, axis=0)
        strong = strongest.sort_out()
        self.few = strongest.watched(frame.cell)
        self.typical = np.array([strongest.mean / 3.0])
        V, known = frame.cell.volume, strongest.ranked()
        rest = square - ((outer6(known.r_bc) * known.G_b[:, None]) ** 2).sum(0)
        self.noise = float(np.sqrt(max(rest.max(), 0.0) / V * roughness(kern)))
        self.mean = float(np.abs(total).max(initial=0.0)) / V
        # The largest value is at least what the strongest bonds make, and the others do not take away.
        strong = strong.taken(slice(WATCHED))
        exact = make("direct", bound, kern, frame.cell, 0, 6, threads)
        exact.add_bond_stress(frame.positions, strong.i, strong.r_bc, strong.G_b)
        peak = float(np.abs(exact.bond_sums()).max(initial=0.0))
        self.largest = max(self.mean, peak - self.mean - 3.0 * self.noise, 2.0 * self.noise)

    def error(self, deposit) -> float:
        """The expected largest error over the largest value of a spectral deposit's stress; `deposit` is empty, for one
        component."""
        if not len(self.few[0]) or not self.largest > 0:
            return 1.0
        at_random = self.at_random(deposit.tolerance)
        error_g = error_map(deposit, make("direct", self.bound, self.kern, self.cell, 0, 1), self.few, self.typical)
        # The strongest bonds' largest error and that of all the others are hardly ever at the same point.
        return float(np.hypot(error_g.max(initial=0.0) / self.largest, at_random))

    def at_random(self, tolerance: float) -> float:
        """What of `error` all but the strongest bonds make, by a deposit of this tolerance: no pass over the grid."""
        return PART * PEAK * tolerance * self.noise / self.largest if self.largest > 0 else 1.0


@njit(cache=True, nogil=True, error_model="numpy")
def _add(r_bc, G_b, totals):
    """Sums of the stress factors, and of their squares, xx yy zz yz xz xy."""
    for b in range(len(G_b)):
        x, y, z, G = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2], G_b[b]
        for k, v in enumerate((x * x, y * y, z * z, y * z, x * z, x * y)):
            totals[0, k] += G * v
            totals[1, k] += (G * v) ** 2


def roughness(kern) -> float:
    """∫ φ² dV (dA in the plane) of a kernel: what the variance of a field of independent sources is proportional to."""
    k = (np.arange(400) + 0.5) * (0.5 / kern.radius)
    dk = k[1] - k[0]
    along = [kern.hat(k[:, None] * axis) for axis in np.eye(3)[: kern.dimension]]
    if not kern.is_isotropic:
        return float(np.prod([2 * np.sum(hat**2) * dk / (2 * np.pi) for hat in along]))
    hat = along[0]
    if kern.dimension == 2:
        return float(np.sum(hat**2 * k) * dk / (2 * np.pi))
    return float(np.sum(hat**2 * k**2) * dk / (2 * np.pi**2))
