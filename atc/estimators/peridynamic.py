"""The weighted virials of peridynamics: sums over the bonds around a point that are no bond functions (W eq. 7).

The stress of Lehoucq and Silling needs nothing of this: smoothed with φ it is the bond sum Σ −r⊗F β, Hardy's potential
stress. W proposes instead −½ Σ_IJ F_IJ⊗ê_I |x_IJ| over all I, J within the horizon of X, ê_I the unit vector from X to
I. By unordered bonds the weight is ½|x|(ê_I − ê_J): the bond itself where X lies on it, 0 where X is in line with it
but outside. As printed its unit is force × length; here it is divided by the volume of the horizon.

Because both ends must lie within the horizon, a bond of length d contributes on average only λ(d/δ) of −x⊗F to the
field (`mean_weight`), about a fifth for the bonds of a solid: `weighted_virial_normalised` divides each bond by its λ,
so that homogeneous stress is recovered in the mean over points.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ..errors import AtcError

# A point this close to an end, in horizons, is the end: its unit vector is taken as 0. Nodes at exactly the horizon are
# within it: 1 + this.
NEAR = 1e-10

_WORDS = {1: "length", 2: "area", 3: "volume"}


def mean_weight(s, dimension: int = 3) -> np.ndarray:
    """λ(s): the mean over X in the ball of radius 1 around one end of a bond of length s of the weight ½(ê_I − ê_J)·x̂,
    0 where an end is out of reach.

    Parameters
    ----------
    s : array, lengths of bonds over the horizon, 0 ≤ s < 2 (λ = 0 from 2 on)
    dimension : 1, 2 or 3

    Notes
    -----
    With r the distance of X from I and u the cosine of the angle from the bond, ê_I·x̂ = u and X is within reach of J
    where u > (r² + s² − 1)/(2 r s); both ends contribute the same. In three dimensions λ = ¾ ∫ [r² − (r² + s² − 1)²/(4
    s²)] dr from |1 − s| to 1, a polynomial up to s = 1; λ → s/2 for short bonds. In two dimensions λ = (2/π) ∫
    √(((1+s)² − r²)(r² − (1−s)²))/(2 s) dr, an elliptic integral, by Gauss-Legendre quadrature after r² = a² cosh² y, a
    = |1 − s|, and tabulated; 1-D: s/2, and 1 − s/2 beyond 1.
    """
    s = np.asarray(s, dtype=np.float64)
    if dimension == 1:
        return np.clip(np.minimum(0.5 * s, 1.0 - 0.5 * s), 0.0, None)
    if dimension == 2:
        inner, outer = _table_2d()
        return np.where(
            s < 1.0, s * inner(np.clip(s, 0.0, 1.0)), np.maximum(2.0 - s, 0.0) ** 1.5 * outer(np.clip(s, 1.0, 2.0))
        )
    # For s > 1 by powers of the width 2 − s of the lens, so that nothing cancels where it is small.
    h, k = np.clip(2.0 - s, 0.0, 1.0), np.maximum(s * s, 1.0)
    beyond = 0.75 * h * (1.0 - 0.25 * k - h * (0.5 - h * ((0.5 - 1.0 / k) / 3.0 + h * (0.25 - 0.05 * h) / k)))
    return np.where(s < 1.0, s * (0.5 - s * (0.1875 + 0.1 * s)), beyond)


def exact_2d(s: np.ndarray, order: int = 96) -> np.ndarray:
    """λ(s) in two dimensions by quadrature; 0 < s < 2."""
    y, w = np.polynomial.legendre.leggauss(order)
    a = np.abs(1.0 - s)[:, None]
    a = np.maximum(a, 1e-14)
    top = np.arcsinh(np.sqrt(np.maximum((1.0 - a) * (1.0 + a), 0.0)) / a)
    # Only the last e^-20 of the range counts: below, the integrand falls as e^(2y).
    low = np.maximum(top - 20.0, 0.0)
    y = low + 0.5 * (top - low) * (1.0 + y)
    v = a * np.sinh(y)
    b2 = (1.0 + s[:, None]) ** 2 - a * a
    integrand = 2.0 * v * v * np.sqrt(np.maximum(b2 - v * v, 0.0))
    return (integrand @ w) * (0.5 * (top - low))[:, 0] / (2.0 * np.pi * s)


@cache
def _table_2d():
    """Cubic splines of λ/s below and λ/(2 − s)^1.5 beyond s = 1, where its second derivative has a logarithm: nodes
    crowd there."""
    from scipy.interpolate import CubicSpline

    t = np.linspace(0.0, 1.0, 1025)
    low, high = 1.0 - (1.0 - t) ** 3, 1.0 + t**3
    # The ends, 0 and 2, are limits.
    inner = np.concatenate([[0.5], exact_2d(low[1:]) / low[1:]])
    high[-1] -= 1e-9
    outer = exact_2d(high) / (2.0 - high) ** 1.5
    high[-1] = 2.0
    return CubicSpline(low, inner), CubicSpline(high, outer)


# --------------------------------------------------------------------------------------------------------------------
# What it needs


def ball_volume(horizon: float, pot, cell) -> float:
    """The volume of the horizon: of a ball; in a body of fewer dimensions of a disc through its thickness, or a stretch
    of its cross-section.

    Such a body fills the cell along the axes it does not extend in (z; y and z).
    """
    dimension = pot.dimension
    if dimension == 3:
        return 4.0 / 3.0 * np.pi * horizon**3
    if dimension == 2:
        return np.pi * horizon**2 * cell.heights[2]
    return 2.0 * horizon * cell.volume / cell.heights[0]


def horizon_of(given, pot, grid, units, users) -> float:
    """The horizon, internal units: the one given (the user's unit), else the potential's own, else its reach."""
    if grid.kind == "slab":
        raise AtcError(
            f"{users[0]} belongs to points, not to bins of a slab: take a regular, plane, line or points grid, or "
            "peridynamic_stress"
        )
    if given is not None:
        if isinstance(given, bool) or not isinstance(given, (int, float, np.number)) or not 0 < given < np.inf:
            raise AtcError(f"horizon {given!r}: expected a length greater than 0 in the trajectory's units")
        return float(given) * units.factor("length")
    found = pot.horizon or pot.cutoff
    if not found > 0:
        raise AtcError(
            f"{users[0]} needs a horizon, and the potential has no cutoff to take for it: give horizon, a length"
        )
    return float(found)


def node_volumes(frame) -> np.ndarray:
    """(n,) volumes of the nodes from the frame's column ``volume``, internal units."""
    volumes = frame.extra.get("volume")
    if volumes is None:
        raise AtcError(
            f"{frame.source}: the nodal virial is divided by the volume of each node, but there is no column "
            "'volume': add it, or ask for "
            "virial_stress_per_atom_potential (stress times volume)"
        )
    volumes = np.asarray(volumes, dtype=np.float64)
    if volumes.shape != (len(frame),) or not (volumes > 0).all():
        raise AtcError(f"{frame.source}: the column 'volume' must hold one volume greater than 0 for each atom")
    return frame.units.to_internal("volume", volumes)


# --------------------------------------------------------------------------------------------------------------------
# The sums


class WeightedVirials:
    """Collects bonds for current and reference positions, at the points of both places (the grid, and the points of the
    error check)."""

    def __init__(self, pot, threads, work, here, reference, horizon):
        self.names = [list(work.point), list(work.reference_point)]
        self.columns = [[], []]
        for side, place in enumerate((here, reference)):
            if self.names[side]:
                kinds = [name.removeprefix("reference_") for name in self.names[side]]
                points = (deposits.bound.relative_points_gc for deposits in place.both)
                self.columns[side] = [WeightedVirial(x_gc, place.cell, kinds, horizon, pot, threads) for x_gc in points]

    def add(self, x_nc, bonds, X_bc, R_bc, thread):
        F_bc = bonds.forces()
        for side, (x_bc, r_bc) in enumerate(((x_nc[bonds.i] if self.columns[0] else None, bonds.r_bc), (X_bc, R_bc))):
            for column in self.columns[side]:
                column.add(x_bc, r_bc, F_bc, thread)

    def sums(self, k) -> dict[str, np.ndarray]:
        """On the grid (k = 0), or at the points of the check (1)."""
        out = {}
        for names, columns in zip(self.names, self.columns):
            if columns:
                out.update(zip(names, columns[k].sums()))
        return out


class WeightedVirial:
    """W's sum at given points.

    Parameters
    ----------
    points_gc : (g, 3) relative to the cell's origin, internal units
    cell : Cell; its periodic images count
    kinds : "weighted" and/or "weighted_normalised", the sums wanted
    horizon : float
    pot : where the bonds come from; only its `dimension` counts (3 if it has none): in two dimensions z is disregarded,
        in one y and z
    threads : int

    Notes
    -----
    Cost: about 30 ns for each bond and each point with both ends within its horizon (40 % of the points within the
    horizon of one end, for the bonds of a solid), the points that are only near included; a second kind costs a tenth
    more. The points lie in bins of a third of the horizon.
    """

    def __init__(self, points_gc, cell, kinds, horizon, pot, threads=1):
        self.kinds, self.horizon = kinds, horizon
        self.dimension = pot.dimension
        self.cell, self.origin = cell, np.array(cell.origin)
        self.scale = 1.0 / ball_volume(horizon, pot, cell)
        self.periodic = cell.periodic.copy()
        self.periodic[self.dimension :] = False
        p = np.array(points_gc)
        s = p @ cell.inverse
        if self.dimension < 3 and not _diagonal(cell, self.dimension):
            raise AtcError(f"a body of {self.dimension} dimensions needs a cell whose other edges are normal to it")
        whole = np.where(self.periodic, np.floor(s), 0.0)
        p, s = p - whole @ cell.vectors, s - whole
        p[:, self.dimension :] = s[:, self.dimension :] = 0.0
        low = np.where(self.periodic, 0.0, s.min(0))
        span = np.where(self.periodic, 1.0, np.maximum(s.max(0) - low, 1e-9))
        edge = max(0.35 * horizon, (cell.volume * span.prod() / len(p)) ** (1.0 / 3.0) if self.dimension == 3 else 0.0)
        bins = np.clip((span * cell.heights / edge).astype(np.int64), 1, 512)
        bins[self.dimension :] = 1
        b = np.clip(((s - low) * bins / span).astype(np.int64), 0, bins - 1)
        flat = (b[:, 0] * bins[1] + b[:, 1]) * bins[2] + b[:, 2]
        self._order = np.argsort(flat, kind="stable")
        self._points = np.ascontiguousarray(p[self._order].T)
        self._start = np.searchsorted(flat[self._order], np.arange(bins.prod() + 1)).astype(np.int64)
        self._bins, self._low, self._per_unit = bins, low, bins / span
        self._sums = [np.zeros((len(p), len(kinds), 9)) for _ in range(threads)]

    def add(self, x_bc, r_bc, F_bc, thread=0) -> None:
        """Bonds from x to x − r, with the forces on their ends x."""
        from . import _weighted

        x_bc = x_bc - self.origin
        r_bc = np.array(r_bc)
        x_bc[:, self.dimension :] = r_bc[:, self.dimension :] = 0.0
        d_b = np.sqrt(np.einsum("bc,bc->b", r_bc, r_bc))
        scale_bm = np.full((len(d_b), len(self.kinds)), self.scale)
        for m, kind in enumerate(self.kinds):
            if kind == "weighted_normalised":
                s = d_b / self.horizon
                if (s >= 2.0).any():
                    raise AtcError(
                        f"a bond is {s.max():.3g} horizons long, so that no point sees it and its weight cannot be "
                        "normalised: give a larger horizon"
                    )
                mean = mean_weight(s, self.dimension)
                scale_bm[:, m] = np.divide(self.scale, mean, out=np.zeros_like(mean), where=mean > 0)
        _weighted.add(
            x_bc,
            r_bc,
            np.ascontiguousarray(F_bc),
            d_b,
            scale_bm,
            self.horizon * (1.0 + NEAR),
            NEAR * self.horizon,
            self._points,
            self._start,
            self._bins,
            self._low,
            self._per_unit,
            self.periodic,
            np.array(self.cell.vectors),
            np.ascontiguousarray(self.cell.inverse),
            self._sums[thread],
        )

    def sums(self) -> list[np.ndarray]:
        """(g, 9) for each of `kinds`, points in the order given."""
        total = sum(self._sums[1:], self._sums[0])
        out = np.empty_like(total)
        out[self._order] = total
        return [np.ascontiguousarray(out[:, m]) for m in range(len(self.kinds))]


def _diagonal(cell, dimension) -> bool:
    """Whether the axes beyond `dimension` are normal to the others, and along z (y and z)."""
    v = np.array(cell.vectors)
    v[np.arange(3), np.arange(3)] = 0.0
    return not (
        np.abs(v[dimension:]).max(initial=0.0) > 1e-12 * cell.heights.max()
        or np.abs(v[:, dimension:]).max(initial=0.0) > 1e-12 * cell.heights.max()
    )
