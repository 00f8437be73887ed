"""Sums over what crosses planes: Σ b/|d_n| of lines that run from x to x − d, d_n their extent along the planes'
normal, over the area of a plane or of each of its patches.

1/|d_n| at each plane that the line crosses is the mean of δ(z − plane) along it: the bond function of a kernel without
width, averaged over planes. A bond so counted gives the force through the plane, the path of an atom over an interval
what the atom carries through.
"""

from __future__ import annotations

from math import floor

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from ..grids.planes import BELOW
from .direct import _NOT_FINITE, _array

#: A line whose end lies off its atom, in shares of the cell, does not run from atom to atom.
_OFF = 1e-6


@njit(cache=True, nogil=True, error_model="numpy")
def _cross(from_b, to_b, weight_b, from_b2, run_b2, b_bk, planes_p, periodic_3, patches_2, acc_pqk):
    """Add the components of every line, times its weight, to all planes p with from < p <= to or to < p <= from."""
    n_planes = len(planes_p)
    for b in range(len(from_b)):
        s0, s1 = from_b[b], to_b[b]
        lo, hi = min(s0, s1), max(s0, s1)
        if lo == hi:
            continue
        k0, k1 = (floor(lo), floor(hi)) if periodic_3[0] else (0.0, 0.0)
        k = k0
        while k <= k1:
            p = np.searchsorted(planes_p, lo - k, side="right")
            while p < n_planes and planes_p[p] <= hi - k:
                t = (s0 - (planes_p[p] + k)) / (s0 - s1)
                q = 0
                for e in range(2):
                    u = from_b2[b, e] - t * run_b2[b, e]
                    if periodic_3[e + 1]:
                        u -= floor(u)
                    q = q * patches_2[e] + min(max(floor(u * patches_2[e]), 0), patches_2[e] - 1)
                for c in range(b_bk.shape[1]):
                    acc_pqk[p, q, c] += weight_b[b] * b_bk[b, c]
                p += 1
            k += 1.0


class Crossings:
    """Of the planes of one bound grid. What is added on different threads goes into buffers of their own.

    Parameters
    ----------
    grid : BoundGrid of kind "planes"
    cell : Cell of the frame
    n : number of components
    """

    def __init__(self, grid, cell, n: int, threads: int = 1):
        self.grid, self.cell, self.n = grid, cell, int(n)
        a = grid.axis
        self._axes = [a, *(k for k in range(3) if k != a)]
        self.height = float(cell.heights[a])
        self._normal = cell.inverse[:, a] * self.height
        self._periodic = _array(cell.periodic[self._axes], bool)
        self._patches = np.array(grid.counts[1:] or (1, 1), dtype=np.int64)
        self.area = cell.volume / self.height / float(self._patches.prod())
        shares_p = grid.shares_p - BELOW
        if self._periodic[0]:
            shares_p = shares_p - np.floor(shares_p)
        self._order = np.argsort(shares_p, kind="stable")
        self._planes_p = _array(shares_p[self._order])
        self._buffers = [np.zeros((len(shares_p), int(self._patches.prod()), self.n)) for _ in range(threads)]

    def places(self, x_nc) -> np.ndarray:
        """(n, 3) of atoms: shares of the cell's edges, that of the normal first, where the cell repeats from 0 to
        1."""
        s = self.cell.fractional(x_nc)[:, self._axes]
        if not np.isfinite(s).all():
            raise AtcError(_NOT_FINITE)
        s = s - np.where(self._periodic, np.floor(s), 0.0)
        return np.where(self._periodic & (s >= 1.0), 0.0, s)

    def add_between(self, s_n3, i_b, j_b, r_bc, b_bk, thread: int = 0) -> None:
        """Lines from atoms i to images of atoms j, r = x_i − x_j; s_n3 : `places` of all atoms.

        On which side of a plane an end lies is asked of its atom, the same for all lines of the atom: what is between
        two planes is pulled by what crosses them, to rounding.
        """
        s_b, end_b = s_n3[i_b], s_n3[j_b]
        run_b = (r_bc @ self.cell.inverse)[:, self._axes]
        image = np.where(self._periodic, np.rint(s_b - end_b - run_b), 0.0)
        to_b = end_b[:, 0] + image[:, 0]
        off = ~(np.abs(s_b - end_b - image - run_b).max(1, initial=0.0) <= _OFF)
        to_b = np.where(off, s_b[:, 0] - run_b[:, 0], to_b)
        self._add(s_b, to_b, run_b, b_bk, thread)

    def add_paths(self, s_n3, d_nc, a_nk, thread: int = 0) -> None:
        """Paths of atoms over an interval, from x − d to x: s_n3 `places` of x."""
        run_n = (d_nc @ self.cell.inverse)[:, self._axes]
        self._add(s_n3, s_n3[:, 0] - run_n[:, 0], run_n, a_nk, thread)

    def _add(self, s_b, to_b, run_b, b_bk, thread):
        length_b = np.abs(run_b[:, 0]) * self.height
        # The least length that does not overflow what it divides: of such lines normal components are what they are.
        weight_b = 1.0 / np.maximum(length_b, 1e-30 * self.height)
        if not (np.isfinite(to_b).all() and np.isfinite(weight_b).all() and np.isfinite(b_bk).all()):
            raise AtcError(_NOT_FINITE)
        _cross(
            _array(s_b[:, 0]), _array(to_b), weight_b, _array(s_b[:, 1:]), _array(run_b[:, 1:]), _array(b_bk),
            self._planes_p, self._periodic, self._patches, self._buffers[thread],
        )  # fmt: skip

    def sums(self) -> np.ndarray:
        """(g, n) of planes, patches running fastest, over the area of each."""
        total = sum(self._buffers[1:], self._buffers[0].copy())
        out = np.empty_like(total)
        out[self._order] = total
        return out.reshape(len(self.grid), self.n) / self.area
