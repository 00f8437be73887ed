"""Which image of an atom is meant by a bond."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from ..frame import Cell


class Images:
    """Finds the vector from one atom to the closest image of another.

    This is LAMMPS's rule for bonded atoms, also where the cell is so small or so tilted that rounding fractional
    coordinates finds another one. Two images at the same distance (a bond across exactly half a cell): one of them.
    """

    def __init__(self, cell: Cell):
        self.vectors, self.inverse, self.periodic = cell.vectors, np.ascontiguousarray(cell.inverse), cell.periodic
        # Within half the smallest thickness there is no closer image.
        self.safe2 = (0.5 * cell.heights[cell.periodic].min()) ** 2 if cell.periodic.any() else np.inf
        self.heights = cell.heights

    def vectors_to(self, x_nc, i, j, r_bc):
        """Fill r = x_i − x_j (closest image)."""
        _closest(x_nc, i, j, self.vectors, self.inverse, self.periodic, self.heights, self.safe2, r_bc)


@njit(cache=True, nogil=True, error_model="numpy")
def _closest(x, i, j, vectors, inverse, periodic, heights, safe2, r):
    s = np.empty(3)
    d = np.empty(3)
    best = np.empty(3)
    reach = np.zeros(3, np.int64)
    for b in range(len(i)):
        for c in range(3):
            d[c] = x[i[b], c] - x[j[b], c]
        for k in range(3):
            s[k] = 0.0
            if periodic[k]:
                s[k] = np.rint(d[0] * inverse[0, k] + d[1] * inverse[1, k] + d[2] * inverse[2, k])
        d2 = 0.0
        for c in range(3):
            d[c] -= s[0] * vectors[0, c] + s[1] * vectors[1, c] + s[2] * vectors[2, c]
            best[c] = d[c]
            d2 += d[c] * d[c]
        if d2 > safe2:
            # A closer image lies within this distance: at most this many cells away along each axis.
            for k in range(3):
                reach[k] = int(np.sqrt(d2) / heights[k] + 0.5 + 1e-9) if periodic[k] else 0
            for n0 in range(-reach[0], reach[0] + 1):
                for n1 in range(-reach[1], reach[1] + 1):
                    for n2 in range(-reach[2], reach[2] + 1):
                        e2 = 0.0
                        for c in range(3):
                            e = d[c] + n0 * vectors[0, c] + n1 * vectors[1, c] + n2 * vectors[2, c]
                            e2 += e * e
                        if e2 < d2:
                            d2 = e2
                            for c in range(3):
                                best[c] = d[c] + n0 * vectors[0, c] + n1 * vectors[1, c] + n2 * vectors[2, c]
        for c in range(3):
            r[b, c] = best[c]
