"""The sums at one set of points, each by its own method."""

from __future__ import annotations

import itertools

import numpy as np

from .methods import EXACT

#: What sums of φ² may lack of the share 1/N that they are for, of the tolerance.
SQUARES = 0.1
#: How much closer sums of φ² are taken by their modes: what they correct grows by 1/(1 - 1/N), and its errors with it.
CLOSER_SQUARES = 0.1


def squared_kernel(kern, cell):
    """c and a kernel ψ with φ² = c ψ; None where there is none, or where atoms are in reach of a point more than once:
    two images of an atom move together, and their product counts, too."""
    found = kern.squared()
    half = cell.heights[cell.periodic] / 2.0
    if found is None or not len(half):
        return found
    return found if kern.phi(np.array([half.min(), 0.0, 0.0])) ** 2 < 1e-14 * kern.peak**2 else None


class Deposits:
    """Points at which sums are wanted, with a method for each deposit; `origin` is subtracted from all positions first.

    summed : the kernel that deposits use, if it is not `kern`; gradients always use that
    """

    def __init__(self, methods, bound, kern, cell, threads, origin=None, summed=None):
        # The bins of a padded slab profile divide a higher cell, open there.
        cell = bound.cell if bound.kind == "slab" else cell
        self.methods, self.bound, self.kern, self.cell, self.threads = methods, bound, kern, cell, threads
        self.summed_kern = kern if summed is None else summed
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

    def open(self, n_bond, key="bond", length=None):
        """An empty deposit of bonds with this many components; at a few points, with the `length` that most bonds do
        not have."""
        deposit = self.make(key, 0, n_bond)
        if length is not None:
            deposit.expect(length)
        return deposit if self.origin is None else _Placed(deposit, self)

    def sites(self, x_nc, a_nk) -> np.ndarray:
        """(g, k) Σ a φ over all atoms."""
        deposit = self.make("site", a_nk.shape[1], 0)
        self.add_sites(deposit, self.place(x_nc), a_nk)
        return deposit.site_sums()

    def squares(self, x_nc, a_nk, below: float = 0.0) -> np.ndarray:
        """(g, k) Σ a φ² over all atoms; on slabs of what they count in the average. below : where the kernel is smaller
        it may be left out, if that makes the sum quicker; `Σ φ φ` then lacks no more than below Σ φ"""
        from ..deposit import make
        from ..deposit.gradient import gather

        kern = self.summed_kern.above(below) if below > 0.0 else self.summed_kern
        found = None if self.bound.kind == "slab" else squared_kernel(kern, self.cell)
        if found is None:
            return gather(self.bound, kern, self.cell, self.place(x_nc), a_nk, None, False, self.threads, True)[0]
        factor, kern = found
        m = self.methods.get("site", EXACT)
        tolerance = CLOSER_SQUARES * m.tolerance or 1e-5
        deposit = make(m.name, self.bound, kern, self.cell, a_nk.shape[1], 0, self.threads, tolerance)
        self.add_sites(deposit, self.place(x_nc), a_nk)
        return factor * deposit.site_sums()

    def add_sites(self, deposit, x_nc, a_nk) -> None:
        """Atoms to a deposit, shared among the threads; positions are placed."""
        if self.threads == 1 or len(x_nc) < 2 * self.threads:
            deposit.add_sites(x_nc, a_nk, thread=0)
        else:
            from concurrent.futures import ThreadPoolExecutor

            cuts = np.linspace(0, len(x_nc), self.threads + 1).astype(int)
            with ThreadPoolExecutor(self.threads) as pool:
                jobs = [
                    pool.submit(deposit.add_sites, x_nc[a:b], a_nk[a:b], thread=t)
                    for t, (a, b) in enumerate(itertools.pairwise(cuts))
                ]
                for job in jobs:
                    job.result()

    @property
    def points_gc(self) -> np.ndarray:
        """(g, 3) where the points are, in the frame's own coordinates."""
        return self.bound.points_gc if self.origin is None else self.bound.points_gc + self.origin

    def gather(self, x_nc, a_nk, w_n, gradient, key="gather"):
        """Σ a φ and Σ a ∂φ/∂x, see `atc.deposit.gradient`; by the modes where the method of `key` says so and there are
        no first moments."""
        from ..deposit.gradient import gather

        if w_n is None and not self.methods.get(key, EXACT).exact:
            a_nk = np.ascontiguousarray(a_nk, dtype=np.float64)
            deposit = self.make(key, a_nk.shape[1], 0, gradients=gradient)
            self.add_sites(deposit, self.place(x_nc), a_nk)
            return deposit.site_sums_and_gradients() if gradient else (deposit.site_sums(), None)

        return gather(self.bound, self.kern, self.cell, self.place(x_nc), a_nk, w_n, gradient, self.threads)


class _Placed:
    """A deposit that gets its positions relative to another origin."""

    def __init__(self, deposit, points):
        self.deposit, self.points = deposit, points
        self.bond_sums, self.add_found = deposit.bond_sums, deposit.add_found

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0, j_b=None):
        self.deposit.add_bond_stress(self.points.place(x_nc), i_b, r_bc, G_b, thread=thread, j_b=j_b)

    def add_bonds(self, x_bc, r_bc, b_bk, thread=0):
        self.deposit.add_bonds(x_bc - self.points.origin, r_bc, b_bk, thread=thread)

    def find(self, x_nc, i_b, r_bc, thread=0):
        return self.deposit.find(self.points.place(x_nc), i_b, r_bc, thread)
