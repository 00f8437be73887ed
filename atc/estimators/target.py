"""Points at which sums are wanted, and the ways to get them there."""

from __future__ import annotations

import itertools

import numpy as np
from numba import njit

from ..bonds import Bonds
from .methods import EXACT


class Target:
    """Points at which sums are wanted, with a method for each deposit; `origin` is subtracted from all positions first."""

    def __init__(self, methods, bound, kern, cell, threads, origin=None):
        self.methods, self.bound, self.kern, self.cell, self.threads = methods, bound, kern, cell, threads
        self.summed_kern = kern  # what deposits use; gradients always use `kern`
        self.origin = None if origin is None or not np.any(origin) else origin
        self._moved: tuple = (None, None)

    def place(self, x_nc) -> np.ndarray:
        """Positions relative to `origin`; the last ones are remembered."""
        if self.origin is None:
            return x_nc
        if self._moved[0] is not x_nc:
            self._moved = (x_nc, x_nc - self.origin)
        return self._moved[1]

    def make(self, key, n_site, n_bond, **more):
        from ..deposit import make

        m = self.methods.get(key, EXACT)
        return make(
            m.name,
            self.bound,
            self.summed_kern,
            self.cell,
            n_site,
            n_bond,
            threads=self.threads,
            tolerance=m.tolerance or 1e-5,
            order=m.order,
            **more,
        )

    def open(self, n_bond, key="bond"):
        """An empty deposit of bonds with this many components."""
        deposit = self.make(key, 0, n_bond)
        return deposit if self.origin is None else _Placed(deposit, self)

    def sites(self, x_nc, a_nk) -> np.ndarray:
        """(g, k) Σ a φ over all atoms."""
        deposit = self.make("site", a_nk.shape[1], 0)
        self._add(deposit, self.place(x_nc), a_nk)
        return deposit.site_sums()

    def _add(self, deposit, x_nc, a_nk):
        if self.threads == 1 or len(x_nc) < 2 * self.threads:
            deposit.add_sites(x_nc, a_nk, thread=0)
        else:
            from concurrent.futures import ThreadPoolExecutor

            cuts = np.linspace(0, len(x_nc), self.threads + 1).astype(int)
            with ThreadPoolExecutor(self.threads) as pool:
                jobs = [pool.submit(deposit.add_sites, x_nc[a:b], a_nk[a:b], thread=t) for t, (a, b) in enumerate(itertools.pairwise(cuts))]
                for job in jobs:
                    job.result()

    @property
    def points_gc(self) -> np.ndarray:
        """(g, 3) where the points are, in the frame's own coordinates."""
        return self.bound.points_gc if self.origin is None else self.bound.points_gc + self.origin

    def gather(self, x_nc, a_nk, w_n, gradient, key="gather"):
        """Σ a φ and Σ a ∂φ/∂x, see `atc.deposit.gradient`; by the modes where the method of `key` says so and there are no first moments."""
        from ..deposit.gradient import gather

        if w_n is None and not self.methods.get(key, EXACT).exact:
            a_nk = np.ascontiguousarray(a_nk, dtype=np.float64)
            deposit = self.make(key, a_nk.shape[1], 0, gradients=gradient)
            self._add(deposit, self.place(x_nc), a_nk)
            return deposit.site_sums_and_gradients() if gradient else (deposit.site_sums(), None)

        return gather(self.bound, self.kern, self.cell, self.place(x_nc), a_nk, w_n, gradient, self.threads)


class _Placed:
    """A deposit that gets its positions relative to another origin."""

    def __init__(self, deposit, target):
        self.deposit, self.target = deposit, target
        self.bond_sums = deposit.bond_sums

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0, j_b=None):
        self.deposit.add_bond_stress(self.target.place(x_nc), i_b, r_bc, G_b, thread=thread, j_b=j_b)

    def add_bonds(self, x_bc, r_bc, b_bk, thread=0):
        self.deposit.add_bonds(x_bc - self.target.origin, r_bc, b_bk, thread=thread)


class NearPoints:
    """Which bonds can reach a few points: the others need not be looked at by the error check.

    A bond of length L whose two ends are farther than √(R² + L²/4) from a point is nowhere nearer to it than R. Atoms are judged in coarse bins, with
    room to spare; bonds longer than `length` are always kept: nothing that counts is ever left out.

    Parameters
    ----------
    points_gc : (g, 3) relative to the cell's origin
    reach : support of the kernel
    length : most bonds are shorter
    x_nc : (n, 3) positions. The ends of a bond must be atoms, or their periodic images.
    """

    def __init__(self, points_gc, reach, length, cell, x_nc):
        self.length2 = float(length) ** 2
        radius = float(np.sqrt(reach**2 + 0.25 * self.length2)) * (1 + 1e-9)
        s = np.asarray(points_gc) @ cell.inverse
        a_n = (np.asarray(x_nc) - cell.origin) @ cell.inverse
        low = np.where(cell.periodic, 0.0, np.minimum(s.min(0), a_n.min(0, initial=np.inf)) if len(a_n) else s.min(0))
        high = np.where(cell.periodic, 1.0, np.maximum(s.max(0), a_n.max(0, initial=-np.inf)) if len(a_n) else s.max(0))
        span = np.maximum(high - low, 1e-9)
        bins = np.clip((span * cell.heights / (0.25 * radius)).astype(np.int64), 1, 64)
        edges = np.ascontiguousarray(cell.vectors * (span / bins)[:, None])
        half = 0.5 * max(np.linalg.norm(np.array(sign) @ edges) for sign in itertools.product((-1, 1), repeat=3))
        marked = np.zeros(bins, np.bool_)
        pad = (radius + half) / cell.heights / span * bins
        _mark((s - low) / span * bins, pad, (radius + half) ** 2, edges, np.array(cell.periodic), marked)
        self.near_n = _marked(a_n, low, bins / span, np.array(cell.periodic), marked)
        self.all = bool(self.near_n.mean() > 0.7) if len(a_n) else True

    def which(self, i, j, r_bc):
        """Indices of the bonds that may reach a point, in their order (or all)."""
        return slice(None) if self.all else _near_bonds(i, j, r_bc, self.near_n, self.length2)

    def take(self, bonds: Bonds) -> Bonds:
        """Those bonds."""
        if self.all:
            return bonds
        return bonds.taken(self.which(bonds.i, bonds.j, bonds.r_bc))


@njit(cache=True, nogil=True, error_model="numpy")
def _mark(p_ga, pad, limit2, edges, periodic, marked):
    """Mark the bins whose centre is near a point; p_ga in bins."""
    n0, n1, n2 = marked.shape
    for g in range(len(p_ga)):
        p0, p1, p2 = p_ga[g, 0], p_ga[g, 1], p_ga[g, 2]
        for c0 in range(int(np.floor(p0 - pad[0])), int(np.floor(p0 + pad[0])) + 1):
            if not periodic[0] and not 0 <= c0 < n0:
                continue
            for c1 in range(int(np.floor(p1 - pad[1])), int(np.floor(p1 + pad[1])) + 1):
                if not periodic[1] and not 0 <= c1 < n1:
                    continue
                for c2 in range(int(np.floor(p2 - pad[2])), int(np.floor(p2 + pad[2])) + 1):
                    if not periodic[2] and not 0 <= c2 < n2:
                        continue
                    d2 = 0.0
                    for c in range(3):
                        d = (c0 + 0.5 - p0) * edges[0, c] + (c1 + 0.5 - p1) * edges[1, c] + (c2 + 0.5 - p2) * edges[2, c]
                        d2 += d * d
                    if d2 <= limit2:
                        marked[c0 % n0, c1 % n1, c2 % n2] = True


@njit(cache=True, nogil=True, error_model="numpy")
def _marked(a_nc, low, scale, periodic, marked):
    """Whether each atom's bin is marked."""
    out = np.empty(len(a_nc), np.bool_)
    at = np.empty(3, np.int64)
    for n in range(len(a_nc)):
        for c in range(3):
            k = np.int64(np.floor((a_nc[n, c] - low[c]) * scale[c]))
            m = marked.shape[c]
            at[c] = k % m if periodic[c] else min(max(k, 0), m - 1)
        out[n] = marked[at[0], at[1], at[2]]
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _near_bonds(i, j, r, near, length2):
    out = np.empty(len(i), np.int64)
    n = 0
    for b in range(len(i)):
        out[n] = b
        keep = near[i[b]] | near[j[b]] | (r[b, 0] * r[b, 0] + r[b, 1] * r[b, 1] + r[b, 2] * r[b, 2] > length2)
        n += 1 if keep else 0
    return out[:n]
