"""The error of a result, measured on the spot: the same sums at random grid points by the exact method, over a path of
their own.

The points are taken out of their grid and handed to the direct sum as scattered points: other rows, other order of
summation, no mesh. For the exact method itself what is left is rounding; for an approximate one it is its error.
"""

from __future__ import annotations

from types import SimpleNamespace
from typing import NamedTuple

import numpy as np

from ...kernels.binned import profile_of

# Bins of a slab profile that are computed twice.
SLAB_BINS = 5
# What of the tolerance the cut tails of a Gaussian may make.
BEYOND = 2e-2
# A field this small against what it is the difference of is 0.
ZERO = 1e-10


def kernel_internal(kern, units):
    """The user's kernel in internal units, normalised in as many dimensions as the run has."""
    kern = kern.in_dimension(units.dimension)
    return kern if units.length == 1.0 else kern.scaled(units.length)


def checking_kernel(kern, methods, tolerance):
    """The kernel that errors are measured with: the kernel itself, but for Gaussians whose far tails are far below the
    tolerance (of the result) if any sum is approximate."""
    return kern if all(m.exact for m in methods.values()) else kern.cut(max(BEYOND * tolerance, 1e-14))


class Check:
    """Random points of a grid at which every field is computed a second time.

    Parameters
    ----------
    bound : BoundGrid
    kern : kernel in internal units
    cell : Cell of the frame
    threads : int
    index : int
        Number of the frame: the same points whoever computes it, and whenever.
    count : int
    which : indices of points to take instead of random ones
    summed : kernel of the sums, if not `kern` (see `checking_kernel`)

    Notes
    -----
    Scattered points go through the direct sum with everything relative to the cell's origin, so that a box far from 0
    costs no digits. Bins of a slab profile are summed in plain numpy (a few only: there every bond is looked at for
    every bin).
    """

    def __init__(self, bound, kern, cell, threads, index, count, which=None, summed=None):
        from ...frame import Cell
        from ...grids import BoundGrid
        from ..deposits import Deposits

        slab = bound.kind == "slab"
        total = int(np.prod(bound.shape))
        rng = np.random.default_rng([20240229, index])
        self.which = (
            np.sort(rng.choice(total, min(total, count, SLAB_BINS if slab else total), replace=False))
            if which is None
            else which
        )
        if slab:
            self.deposits = SlabBins(bound, self.which, kern)
        else:
            home = Cell(cell.vectors, (0.0, 0.0, 0.0), cell.periodic)
            points = BoundGrid(
                "points", home, ("point",), xyz=np.ascontiguousarray(bound.relative_points_of(self.which))
            )
            self.deposits = Deposits({}, points, kern, home, threads, origin=cell.origin, summed=summed)

    def errors(self, field_g, at_points, scale: float = 0.0, extent=None) -> dict[str, float]:
        """Largest and rms difference between the field and its second computation.

        Parameters
        ----------
        extent : `extent_of(field_g)`, if it is known
        scale : the size of what the field is the difference of. A field that is nothing but rounding of it is measured
            against it.

        Returns
        -------
        error_max : largest difference of any component over the largest value of the field
        error_l2 : rms difference over the rms of the field
        error_of_fluctuation : largest difference over the largest deviation of the field from its mean
        error_of_terms : 1 if the field is 0 within rounding, so that its errors are relative to `scale` (else not
            there)
        """
        difference = np.abs(field_g[self.which] - at_points)
        worst = float(difference.max(initial=0.0))
        rms = float(np.sqrt(np.mean(difference**2))) if difference.size else 0.0
        extent = _without_error(extent or extent_of(field_g), worst, float(np.abs(at_points).max(initial=0.0)))
        if extent.largest <= ZERO * scale:
            found = {
                "error_max": ratio(worst, scale),
                "error_l2": ratio(rms, scale),
                "error_of_fluctuation": ratio(worst, scale),
            }
            return found | ({"error_of_terms": 1.0} if scale > 0 else {})
        return {
            "error_max": ratio(worst, extent.largest),
            "error_l2": ratio(rms, extent.rms),
            "error_of_fluctuation": ratio(worst, extent.spread),
        }

    def expected(self, field_g, at_points, scale: float = 0.0, extent=None) -> float:
        """The largest error of all points over the largest value, if errors are normally distributed, by those found:
        √(2 ln N) standard deviations."""
        worst = float(np.abs(field_g[self.which] - at_points).max(initial=0.0))
        largest = _without_error(extent or extent_of(field_g), worst, float(np.abs(at_points).max(initial=0.0))).largest
        largest = scale if largest <= ZERO * scale else largest
        if len(self.which) < 20 or largest == 0.0:
            return 0.0
        rms = float(np.sqrt(np.mean((field_g[self.which] - at_points) ** 2)))
        return rms * float(np.sqrt(2.0 * np.log(field_g.size))) / largest


class Extent(NamedTuple):
    """How large a field is: its largest value, its largest deviation from its mean, of any component; the rms of
    all."""

    largest: float
    spread: float
    rms: float


def _without_error(extent: Extent, worst: float, exactly: float) -> Extent:
    """How large a field is whose error is a good part of it: as exact values say. worst : the largest error found;
    exactly : the largest exact value known, a field of nothing but error has none"""
    if worst > 0.1 * extent.largest and exactly > 0.0:
        largest = min(exactly, extent.largest)
        return extent._replace(largest=largest, spread=min(largest, extent.spread))
    return extent


def extent_of(field_g) -> Extent:
    """The `Extent` of the values of a field."""
    if not field_g.size:
        return Extent(0.0, 0.0, 0.0)
    field_gk = np.ascontiguousarray(field_g, dtype=np.float64).reshape(len(field_g), -1)
    values = field_gk.ravel()
    with np.errstate(all="ignore"):  # what is not finite is seen by those who ask
        low, high, mean = np.fmin.reduce(field_gk), np.fmax.reduce(field_gk), field_gk.mean(0)
        return Extent(
            float(max(high.max(), -low.min())),
            float(max((high - mean).max(), (mean - low).max())),
            float(np.sqrt(np.einsum("n,n->", values, values) / len(values))),
        )


def tolerance_kept(errors: dict[str, float], tolerance: float) -> str | None:
    """What an output says of a field whose error is, or may well be, larger than the one allowed; None of others.
    errors : as in `Check.errors`"""
    for found, what in (
        (errors.get("error_max", 0.0), "no: error found"),
        (errors.get("error_expected", 0.0), "perhaps not: error expected somewhere"),
    ):
        if not found <= tolerance:
            return f"{what} {found:.1e}, {found / tolerance:.2g} times the tolerance"
    return None


def without_nan(values):
    """`np.nan_to_num`, without a copy where there is nothing to be replaced."""
    return values if np.isfinite(values.sum()) else np.nan_to_num(values)


class SlabBins:
    """A few bins of a slab profile, from the kernel's own marginal: Σ a φ₁(z_j − z)/A and Σ b β₁(z)/A over images along
    the axis."""

    def __init__(self, bound, which, kern):
        cell = bound.cell
        self.bound = bound
        self.normal = cell.inverse[:, bound.axis] * cell.heights[bound.axis]
        self.height = cell.heights[bound.axis]
        self.area = cell.volume / self.height
        self.origin = cell.origin
        self.periodic = bool(cell.periodic[bound.axis])
        self.z_g = (which + 0.5) / bound.shape[0] * self.height
        self.marginal = profile_of(kern, bound)

    def sites(self, x_nc, a_nk) -> np.ndarray:
        """(g, k) Σ a φ₁/A."""
        return self._sum(x_nc, None, a_nk)

    def place(self, x_nc):
        return x_nc

    def squares(self, x_nc, a_nk, beyond: float = 0.0) -> np.ndarray:
        """(g, k) Σ a w², w = φ₁/A summed over the atom's images."""
        out = np.zeros((len(self.z_g), a_nk.shape[1]))
        s_n = (x_nc - self.origin) @ self.normal
        for g, z in enumerate(self.z_g):
            d_n, w_n = s_n - z, np.zeros(len(s_n))
            if not self.periodic:
                w_n = self.marginal.phi(d_n)
            else:
                d_n = d_n - np.rint(d_n / self.height) * self.height
                most = int(np.ceil(self.marginal.support / self.height + 0.5))
                for image in range(-most, most + 1):
                    w_n = w_n + self.marginal.phi(d_n + image * self.height)
            out[g] = (w_n / self.area) ** 2 @ a_nk
        return out

    def gather(self, x_nc, a_nk, w_n, gradient, key="gather"):
        """Σ a φ₁/A and its derivative along the normal."""
        slopes = None
        if gradient:
            # d = z_j − z, so that the derivative with respect to z has the other sign.
            slopes = self._sum(x_nc, None, a_nk, lambda d: -self.marginal.slope(d))[:, :, None] * self.normal
        return self._sum(x_nc, None, a_nk), slopes

    def open(self, n_bond, key="bond", length=None):
        """A deposit of bonds: what `add_bonds` and `add_bond_stress` bring is in `bond_sums`."""
        return _SlabDeposit(self, n_bond)

    def _sum(self, x_bc, r_bc, b_bk, phi=None):
        out = np.zeros((len(self.z_g), b_bk.shape[1]))
        if not len(x_bc):
            return out
        s = (x_bc - self.origin) @ self.normal
        r = np.zeros(1) if r_bc is None else r_bc @ self.normal
        reach = self.marginal.support
        low, high = np.minimum(s, s - r), np.maximum(s, s - r)
        for g, z in enumerate(self.z_g):
            shifts = [0.0]
            if self.periodic:
                first = int(np.ceil((z - reach - high.max()) / self.height))
                last = int(np.floor((z + reach - low.min()) / self.height))
                shifts = [k * self.height for k in range(first, last + 1)]
            for shift in shifts:
                near = np.flatnonzero((low + shift <= z + reach) & (high + shift >= z - reach))
                d = s[near] + shift - z
                weight = (phi or self.marginal.phi)(d) if r_bc is None else self.marginal.beta(d, r[near])
                out[g] += weight @ b_bk[near]
        return out / self.area


class _SlabDeposit:
    def __init__(self, bins, n_bond):
        from threading import Lock

        self.bins, self.lock = bins, Lock()
        self.parts: dict[int, np.ndarray] = {}
        self.empty = np.zeros((len(bins.z_g), n_bond))

    def add_bonds(self, x_bc, r_bc, b_bk, thread=0):
        part = self.bins._sum(x_bc, r_bc, b_bk)
        with self.lock:
            self.parts[thread] = self.parts.get(thread, self.empty) + part

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0, j_b=None):
        from ..tensors import outer6

        self.add_bonds(x_nc[i_b], r_bc, outer6(r_bc) * G_b[:, None], thread)

    def find(self, x_nc, i_b, r_bc, thread=0):
        """As `PointsDeposit.find`: all of them."""
        yield SimpleNamespace(bonds=slice(None), x_bc=x_nc[i_b], r_bc=r_bc)

    def add_found(self, found, b_bk, thread=0):
        self.add_bonds(found.x_bc, found.r_bc, b_bk, thread)

    def bond_sums(self):
        return sum((self.parts[t] for t in sorted(self.parts)), self.empty)


def ratio(a: float, b: float) -> float:
    """a/b; 0 over 0 is 0."""
    return a / b if b > 0 else 0.0 if a == 0 else float("inf")
