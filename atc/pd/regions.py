"""Regions of space: where nodes are put, what is clamped, loaded, or kept from breaking. Points on the surface are
inside."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


class Region:
    """A set of points: ``region.contains(x_nc)`` gives (n,) bools. Regions combine with ``|``, ``&``, ``-`` and ``~``.

    ``bounds`` is ((3,) low, (3,) high) of a box around it; infinite where the region is.
    """

    bounds = (np.full(3, -np.inf), np.full(3, np.inf))

    def contains(self, x_nc) -> np.ndarray:
        raise NotImplementedError

    def __or__(self, other):
        lo = np.minimum(self.bounds[0], other.bounds[0])
        hi = np.maximum(self.bounds[1], other.bounds[1])
        return _Combined(lambda x: self.contains(x) | other.contains(x), lo, hi)

    def __and__(self, other):
        lo = np.maximum(self.bounds[0], other.bounds[0])
        hi = np.minimum(self.bounds[1], other.bounds[1])
        return _Combined(lambda x: self.contains(x) & other.contains(x), lo, hi)

    def __sub__(self, other):
        return _Combined(lambda x: self.contains(x) & ~other.contains(x), *self.bounds)

    def __invert__(self):
        return _Combined(lambda x: ~self.contains(x), *Region.bounds)


class _Combined(Region):
    def __init__(self, contains, lo, hi):
        self.contains = lambda x: contains(np.asarray(x, float))
        self.bounds = (lo, hi)


class Everywhere(Region):
    """All of space."""

    def contains(self, x_nc):
        return np.ones(len(x_nc), bool)


class Box(Region):
    """lo ≤ x ≤ hi, componentwise; None or ±inf leaves a side open."""

    def __init__(self, lo, hi):
        lo = np.array([-np.inf if a is None else a for a in lo], float)
        hi = np.array([np.inf if a is None else a for a in hi], float)
        if lo.shape != (3,) or hi.shape != (3,) or (lo > hi).any():
            raise AtcError(
                f"a box region needs three lower and three upper bounds with lower <= upper, got {lo.tolist()} and "
                f"{hi.tolist()}"
            )
        self.bounds = (lo, hi)

    def contains(self, x_nc):
        return ((x_nc >= self.bounds[0]) & (x_nc <= self.bounds[1])).all(axis=1)


class Cylinder(Region):
    """Within `radius` of a line along `axis` ("x", "y" or "z") through `center` (the two other coordinates), between lo
    and hi on the axis."""

    def __init__(self, axis: str, center, radius: float, lo: float = -np.inf, hi: float = np.inf):
        if axis not in ("x", "y", "z"):
            raise AtcError(f"a cylinder's axis must be x, y or z, got {axis!r}")
        self.axis = "xyz".index(axis)
        self.across = [k for k in range(3) if k != self.axis]
        self.center, self.radius, self.lo, self.hi = np.array(center, float), float(radius), float(lo), float(hi)
        if self.center.shape != (2,):
            raise AtcError("a cylinder's center needs two coordinates: those across its axis, in the order x, y, z")
        low, high = np.empty(3), np.empty(3)
        low[self.axis], high[self.axis] = lo, hi
        low[self.across], high[self.across] = self.center - radius, self.center + radius
        self.bounds = (low, high)

    def contains(self, x_nc):
        d = x_nc[:, self.across] - self.center
        along = x_nc[:, self.axis]
        # sqrt, not the squares: which nodes of a lattice lie on the mantle depends on it (LAMMPS's region does the
        # same).
        return (np.sqrt(d[:, 0] * d[:, 0] + d[:, 1] * d[:, 1]) <= self.radius) & (along >= self.lo) & (along <= self.hi)


class Sphere(Region):
    """Within `radius` of `center`."""

    def __init__(self, center, radius: float):
        self.center, self.radius = np.array(center, float), float(radius)
        self.bounds = (self.center - radius, self.center + radius)

    def contains(self, x_nc):
        d = x_nc - self.center
        return np.sqrt((d * d).sum(axis=1)) <= self.radius


class Nodes(Region):
    """The nodes of the given numbers (or a mask over the nodes), wherever they are."""

    def __init__(self, which):
        self.which = np.asarray(which)

    def contains(self, x_nc):
        if self.which.dtype == bool:
            if len(self.which) != len(x_nc):
                raise AtcError(f"a mask over {len(self.which)} nodes does not fit a body of {len(x_nc)} nodes")
            return self.which
        inside = np.zeros(len(x_nc), bool)
        inside[self.which] = True
        return inside


def nodes_of(region, x_nc) -> np.ndarray:
    """Node numbers of a region, a mask, a list of numbers, a function of positions, or None for all."""
    if region is None:
        return np.arange(len(x_nc))
    if callable(region) and not isinstance(region, Region):
        region = Nodes(np.asarray(region(x_nc), bool))
    if not isinstance(region, Region):
        region = Nodes(region)
    return np.flatnonzero(region.contains(x_nc))
