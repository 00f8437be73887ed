"""A grid in one frame: where its points are, and what belongs to them."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import numpy as np

from ..frame import Cell


class BoundGrid:
    """A grid for one frame, in internal units.

    Attributes
    ----------
    kind : "regular", "plane", "line", "slab", "planes", "cylindrical", "spherical", "points" or "atoms"
    cell : Cell
    dims : names of the axes, as in the output
    shape : numbers of points along them
    origin, steps, counts : lattices only. Point (i, j, ..) is at cell.origin + origin + (i, j, ..) @ steps.
        The origin is relative to the cell's, so that nothing is lost in a box far from 0.
    axis : slabs and planes only: the cell axis
    shift : ½ where points are at cell centres, 0 at corners
    padding : slabs only: how far the bins reach beyond the frame's cell, out of `cell`
    """

    padding = 0.0
    #: of slabs: whether values are means over the width of bins
    means = False
    #: of curved grids: (g, 3, 3) local axes as rows, and {dimension: values along it} (angles in degrees)
    basis_gcc: np.ndarray | None = None
    #: (3,) how far it has moved with the atoms since the first frame
    moved_c: np.ndarray | None = None
    along: dict | None = None
    #: of planes: (p,) where they are, as shares of the cell's edge
    shares_p: np.ndarray | None = None

    def __init__(self, kind, cell, dims, *, xyz=None, origin=None, steps=None, counts=None, axis=None, shift=0.5):
        self.kind, self.cell, self.dims, self.axis, self.shift = kind, cell, dims, axis, shift
        self.xyz, self.origin, self.steps = xyz, origin, steps
        self.counts: tuple[int, ...] = () if counts is None else tuple(int(n) for n in counts)

    def moved(self, shift) -> BoundGrid:
        """The same grid at another place (internal)."""
        new = copy(self)
        new.__dict__.pop("points_gc", None)
        new.moved_c = np.asarray(shift, dtype=np.float64)
        if self.kind == "slab":
            new.cell = Cell(self.cell.vectors, self.cell.origin + shift, self.cell.periodic)
        elif self.is_lattice:
            new.origin = self.origin + shift
        else:
            new.xyz = self.xyz + shift
        return new

    @property
    def is_lattice(self) -> bool:
        return self.xyz is None

    @property
    def shape(self) -> tuple:
        return self.counts or (len(self.xyz),)

    def __len__(self):
        return int(np.prod(self.shape))

    @cached_property
    def points_gc(self) -> np.ndarray:
        """(g, 3) positions, the last axis of `shape` running fastest. For a slab: bin centres along the cell's edge."""
        if not self.is_lattice:
            return self.xyz
        return self.relative_points_gc + self.cell.origin

    @property
    def relative_points_gc(self) -> np.ndarray:
        """(g, 3) positions relative to the cell's origin."""
        if not self.is_lattice:
            return self.xyz - self.cell.origin
        index = np.indices(self.counts).reshape(len(self.counts), -1).T
        return index @ self.steps + self.origin

    def relative_points_of(self, which) -> np.ndarray:
        """(h, 3) positions of the points of these (flat) indices, relative to the cell's origin."""
        if not self.is_lattice:
            return self.xyz[which] - self.cell.origin
        return np.stack(np.unravel_index(which, self.counts), -1) @ self.steps + self.origin

    @cached_property
    def tiles(self) -> bool:
        """Whether this is a regular grid over the frame's whole cell, so that sums over points times `cell_volume` are
        integrals over it."""
        if not self.wraps or self.cell.periodic.all():
            return self.wraps
        # An open axis is only covered if the region starts where the cell does.
        s = self.origin @ self.cell.inverse * np.array(self.counts)
        open_axis = ~self.cell.periodic
        return bool(((s[open_axis] > -1e-9) & (s[open_axis] < 1 - 1e-9)).all())

    @property
    def wraps(self) -> bool:
        """Whether the lattice closes on itself through the cell's periodic axes (an open axis need not be covered)."""
        if self.kind != "regular":
            return False
        edges = self.steps * np.array(self.counts)[:, None]
        # 1e-12: vectors that went through another unit system differ by rounding.
        return bool(np.abs(edges - self.cell.vectors).max() <= 1e-12 * np.abs(self.cell.vectors).max())

    @property
    def cell_volume(self) -> float | None:
        """The volume that belongs to each point: of a grid cell, or of a slab; None where points have none."""
        if self.kind == "slab":
            return self.cell.volume / self.counts[0]
        return float(abs(np.linalg.det(self.steps))) if self.kind == "regular" else None

    @property
    def spacing(self) -> np.ndarray | None:
        """Distance between neighbouring points along each axis of a lattice (for a slab along the faces' normal)."""
        if self.kind == "slab":
            return np.array([self.cell.heights[self.axis] / self.counts[0]])
        return np.linalg.norm(self.steps, axis=1) if self.is_lattice else None

    def coords(self, units) -> dict:
        """Coordinates for an xarray Dataset in the user's units: {name: (dims, values, attrs)}.

        One coordinate per axis where the axis runs along x, y or z; else positions as auxiliary coordinates
        ``position_x`` ...
        """
        label = {"units": units.label("length")}
        to_user = lambda a: units.to_user("length", a)  # noqa: E731
        if self.kind == "slab":
            assert self.spacing is not None
            a = self.axis
            normal = self.cell.inverse[:, a] * self.cell.heights[a]
            # Orthogonal cells: the coordinate itself; else the distance from the cell's lower face.
            zero = self.cell.origin[a] if self.cell.orthogonal and normal[a] > 0 else -self.padding
            centres = zero + (np.arange(self.counts[0]) + 0.5) * self.spacing[0]
            what = f"{'xyz'[a]}" if self.cell.orthogonal else "distance from the cell's face along its normal"
            return {self.dims[0]: (self.dims, to_user(centres), {**label, "long_name": what})}
        out: dict = {}
        if self.along is not None:
            names = {
                "r": "distance from the axis" if "z" in self.along else "distance from the centre",
                "phi": "angle around the axis",
                "theta": "angle from the axis",
                "z": "along the axis",
            }
            if self.kind == "planes":
                names = dict.fromkeys(self.dims, "along the cell's edge, middle of the patch")
                names[self.dims[0]] = "position of the plane"
            for name, values in self.along.items():
                angle = name in ("phi", "theta")
                about = {**({"units": "degree"} if angle else label), "long_name": names[name]}
                out[name] = ((name,), values if angle else to_user(values), about)
            if self.kind == "planes":
                return out
        if self.kind == "line":
            distance = np.arange(self.counts[0]) * np.linalg.norm(self.steps[0])
            out["s"] = (("s",), to_user(distance), {**label, "long_name": "distance from the start of the line"})
        elif self.kind == "plane" and self.dims == ("u", "v"):
            for d, n, step in zip(self.dims, self.counts, self.steps):
                distance = (np.arange(n) + self.shift) * np.linalg.norm(step)
                out[d] = ((d,), to_user(distance), {**label, "long_name": f"distance along the plane's edge {d}"})
        elif self.is_lattice:
            along = [("xyz".index(d), s) for d, s in zip(self.dims, self.steps)]
            if all(np.count_nonzero(np.delete(s, k)) == 0 for k, s in along):
                for (k, s), d, n in zip(along, self.dims, self.counts):
                    x = self.cell.origin[k] + self.origin[k] + s[k] * np.arange(n)
                    out[d] = ((d,), to_user(x), {**label, "long_name": d})
                if self.kind == "regular":
                    return out
        xyz = to_user(self.points_gc)
        for k, d in enumerate("xyz"):
            about = {**label, "long_name": f"{d} of the points"}
            out[f"position_{d}"] = (self.dims, xyz[:, k].reshape(self.shape), about)
        return out
