"""A `Grid` is what the user asks for, in the user's units and possibly relative to a cell that changes from frame to
frame. `Grid.bind` turns it into a `BoundGrid`: positions in internal units for one frame. In two dimensions points may
be given by two numbers, and all of them lie in the plane of the atoms: a regular grid has one layer.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import partial

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from . import checks, curved, planes
from .bound import BoundGrid
from .flat import directions, in_space, layers
from .padding import extended, open_axes

#: What grids may move with: the centre of mass, or the interface on one side of the denser phase.
FOLLOWS = ("mass", "+x", "-x", "+y", "-y", "+z", "-z")


def _same(a: dict, b: dict) -> bool:
    def equal(x, y):
        if isinstance(x, np.ndarray) and isinstance(y, np.ndarray):
            return np.array_equal(x, y, equal_nan=True)
        return type(x) is type(y) and x == y

    return a.keys() == b.keys() and all(equal(a[k], b[k]) for k in a)


@dataclass(frozen=True, eq=False)
class Grid:
    """Where fields are wanted; made by `regular`, `plane`, `line`, `slab`, `planes`, `points`, `cylindrical`,
    `spherical` or `atoms`. Lengths in the user's units.

    Points of regular grids and planes lie at the cell centres (i + ½)/n of their edges, or at the corners i/n.
    """

    kind: str
    _: dict = field(default_factory=dict, repr=False)

    @classmethod
    def regular(
        cls, cell=None, spacing=None, shape=None, at="centers", origin=None, vectors=None, padding=None
    ) -> Grid:
        """Points on a regular three-dimensional grid; in two dimensions on one layer of it, in the plane of the atoms.

        Parameters
        ----------
        cell : None, Cell, three lengths or three edge vectors
            The region. None: each frame's own cell, followed as it changes. A `Cell` is in internal units; anything
            else in the user's.
        spacing : float or three floats
            The wanted distance between points along each edge; the edge is divided into the nearest whole number of
            parts. `atc.fields` does so in the first frame: as the cell changes, the points move with it and stay as
            many.
        shape : int or three ints
            Numbers of points, instead of a spacing. Of both, two for two dimensions.
        at : "centers" or "corners"
        origin : three floats
            The region's corner; 0, or the cell's own, if not given.
        vectors : three lengths or edge vectors
            Another name for `cell` when it is not a `Cell`.
        padding : length or "auto"
            How far the grid reaches beyond the open faces of each frame's cell; "auto": as far as the kernel carries
            what atoms near them have (so that nothing is lost of integrals over a shrink-wrapped cell). Periodic axes
            are as they are.

        Raises
        ------
        AtcError
            For a zero shape, a spacing that is not positive, numbers that are not finite, a region without volume.
        """
        shape, spacing = checks.shape_or_spacing(shape, spacing, 3)
        shift = checks.at(at)
        if vectors is not None:
            if cell is not None:
                raise AtcError("give a grid's region as cell or as vectors, not both")
            cell = vectors
        origin = None if origin is None else checks.points("grid origin", origin, (3,))
        if cell is not None and not isinstance(cell, Cell):
            cell = checks.region(cell)
        if padding is not None and not (cell is None and origin is None):
            raise AtcError("padding extends a grid over the cell: give a region of your own as large as it should be")
        if isinstance(cell, Cell) and not cell.complete:
            raise AtcError("the grid's cell has an edge without length: give the region's edge vectors")
        given = {"cell": cell, "spacing": spacing, "shape": shape, "shift": shift, "origin": origin}
        return cls("regular", {**given, **checks.padding(padding)})

    @classmethod
    def plane(
        cls,
        origin=None,
        u=None,
        v=None,
        *,
        axis=None,
        position=None,
        shape=None,
        spacing=None,
        at="centers",
        padding=None,
    ) -> Grid:
        """Points on a parallelogram: from `origin` along the edge vectors `u` and `v`, or a cross-section of each
        frame's cell.

        Parameters
        ----------
        origin, u, v : three floats each
        axis, position : "x", "y" or "z", and a length
            Instead: the cell's cross-section spanned by its two other edges, at this distance from the cell's face
            along `axis` (the middle, if no position is given).
        shape, spacing : two ints, or two floats
        at : "centers" or "corners"
        padding : length or "auto"
            How far a cross-section of the cell reaches beyond its open faces, as for `regular`.
        """
        shape, spacing = checks.shape_or_spacing(shape, spacing, 2)
        points = {"shape": shape, "spacing": spacing, "shift": checks.at(at)}
        if axis is not None:
            if not (origin is None and u is None and v is None):
                raise AtcError("give a plane as origin, u and v or as axis and position, not both")
            position = None if position is None else float(checks.numbers("plane position", position, ()))
            return cls("plane", {"axis": checks.axis(axis), "position": position, **points, **checks.padding(padding)})
        if padding is not None:
            raise AtcError("padding extends a cross-section of the cell: give u and v as long as they should be")
        if u is None or v is None:
            raise AtcError("a plane needs two edge vectors u and v, or an axis")
        origin = checks.points("plane origin", (0, 0, 0) if origin is None else origin, (3,))
        u, v = checks.points("plane u", u, (3,)), checks.points("plane v", v, (3,))
        a, b = np.nan_to_num(u), np.nan_to_num(v)
        if np.linalg.norm(np.cross(a, b)) <= 1e-14 * np.linalg.norm(a) * np.linalg.norm(b):
            raise AtcError("the plane's edge vectors u and v are parallel or zero")
        return cls("plane", {"axis": None, "origin": origin, "u": u, "v": v, **points})

    @classmethod
    def line(cls, start, end, n) -> Grid:
        """`n` points from `start` to `end`, both included (with n = 1, `start`)."""
        start, end = checks.points("line start", start, (3,)), checks.points("line end", end, (3,))
        (n,) = checks.counts("number of points on the line", n, 1)
        if n > 1 and not np.nan_to_num(end - start).any():
            raise AtcError("the line's start and end are the same point")
        return cls("line", {"start": start, "end": end, "n": n})

    @classmethod
    def slab(cls, axis, bins, padding=None, means=False) -> Grid:
        """A profile along a cell axis: at each bin centre the average of the field over the cell's cross-section.

        The distance is measured along the normal of the faces (for an orthogonal cell the axis itself). The average is
        over the plane through the bin's centre: the kernel is integrated in closed form, no three-dimensional grid is
        used. Where a side face is open, kernels are not cut off at it. `padding` (a length, or "auto" for the reach of
        the kernel): how far the bins reach beyond the open faces at the ends. `means`: over the width of each bin in
        place of the plane through its centre, exactly: the sum over bins times their width is the whole, however wide
        they are.
        """
        (bins,) = checks.counts("number of bins", bins, 1)
        if not isinstance(means, bool):
            raise AtcError(f"slab means {means!r}: expected true (over the width of bins) or false (at their centres)")
        more = checks.padding(padding) | ({"means": True} if means else {})
        return cls("slab", {"axis": checks.axis(axis), "bins": bins, **more})

    @classmethod
    def planes(cls, axis, positions=None, *, n=None, at="centers", patches=None, interval=None) -> Grid:
        """Planes across the cell, through which momentum and energy flow: the method of planes. No kernel: each bond
        acts through the planes that it crosses, each atom carries what it has through those that it passes.

        Parameters
        ----------
        axis : "x", "y" or "z", the edge of the cell that leaves the faces that the planes are parallel to
        positions : lengths, ascending
            Coordinates along the axis; in a tilted cell distances from its lower face along the normal.
        n, at : how many instead, evenly over each frame's cell: "centers" at (k + ½)/n of it, "corners" at k/n
        patches : two ints
            Cut each plane into so many parallelograms along the two other edges: stress and fluxes of each.
        interval : time, or "frames"
            Over which passages of atoms are counted: back from each frame along its velocities (as velocity Verlet
            went, where the frame has forces), or really from the frame before to this one. Default: the time step of
            the run's script.

        Raises
        ------
        AtcError
            For positions that do not ascend, or both positions and n.
        """
        given = {"positions": positions, "n": n, "patches": patches, "interval": interval, "shift": checks.at(at)}
        return cls("planes", planes.checked(axis=checks.axis(axis), **given))

    @classmethod
    def points(cls, xyz) -> Grid:
        """These points, (n, 3); (n, 2) in two dimensions."""
        a = np.asarray(xyz, dtype=object)
        if a.size == 0:
            raise AtcError("the grid has no points")
        return cls(
            "points", {"xyz": checks.points("grid points", [xyz] if a.shape in ((2,), (3,)) else xyz, (None, 3))}
        )

    @classmethod
    def atoms(cls) -> Grid:
        """The positions of the atoms of each frame."""
        return cls("atoms", {})

    @classmethod
    def cylindrical(cls, radius, shape, *, center=None, axis="z", inner=0.0, length=None) -> Grid:
        """Points around an axis, with vectors and tensors in the local axes r, phi, z there: pores, wires.

        Parameters
        ----------
        radius, inner : from which radius to which
        shape : three ints
            Numbers of points along r, around, and along the axis, each in the middle of its bin.
        center : three floats
            A point on the axis, the middle of its length; default the middle of the first frame's cell.
        axis : "x", "y" or "z"; phi is counted from the next axis to the one after it (z: from x to y).
        length : along the axis; default the first frame's cell.
        """
        given = {"center": center, "radius": radius, "inner": inner, "shape": shape, "axis": checks.axis(axis)}
        return cls._curved("cylindrical", length=length, **given)

    @classmethod
    def spherical(cls, radius, shape, *, center=None, axis="z", inner=0.0) -> Grid:
        """Points around a centre, with vectors and tensors in the local axes r, theta, phi there: bubbles, droplets.

        Parameters
        ----------
        radius, inner : from which radius to which
        shape : three ints
            Numbers of points along r, theta (equal areas) and phi: plain means over the angles are means over spheres.
        center : three floats; default the middle of the first frame's cell.
        axis : "x", "y" or "z", which theta is counted from
        """
        given = {"center": center, "radius": radius, "inner": inner, "shape": shape, "axis": checks.axis(axis)}
        return cls._curved("spherical", length=None, **given)

    @classmethod
    def _curved(cls, kind, **given) -> Grid:
        return cls(kind, curved.checked(kind, **given))

    def following(self, what="mass") -> Grid:
        """The same grid, moving since the first frame with the atoms, or with those selected.

        what : "mass", their centre of mass, along axes of the cell that they do not fill; "+z", "-z", "+x", ...: the
            interface on this side of the denser of two phases (Gibbs' dividing surface), along this axis
        """
        if what not in FOLLOWS:
            known = ", ".join(f'"{w}"' for w in FOLLOWS)
            raise AtcError(f"grid follow {what!r}: expected {known}")
        if self.kind == "atoms":
            raise AtcError("a grid of atoms moves with each of them: leave follow out")
        if self.kind == "planes":
            raise AtcError("what flows through planes is known of planes at rest: leave follow out, or take a slab")
        return Grid(self.kind, {**self._, "follow": what})

    @property
    def follows_mass(self) -> bool:
        return self.follows is not None

    @property
    def follows(self) -> str | None:
        """What the grid moves with, of `FOLLOWS`."""
        return self._.get("follow")

    @property
    def local_axes(self) -> tuple[str, ...]:
        """What vectors and tensors are components along, if not x, y, z: (r, phi, z) or (r, theta, phi)."""
        return curved.AXES.get(self.kind, ())

    def __eq__(self, other):
        return isinstance(other, Grid) and self.kind == other.kind and _same(self._, other._)

    __hash__ = None  # type: ignore[assignment]

    @property
    def follows_cell(self) -> bool:
        """Whether the positions of the points depend on the frame's cell."""
        if self.kind == "planes":
            return self._["positions"] is None
        return self.kind == "slab" or (
            self.kind in ("regular", "plane") and self._.get("cell", self._.get("u")) is None
        )

    @property
    def padding(self) -> float | str | None:
        """How far it reaches beyond open faces of the cell; "auto": as far as the kernel."""
        return self._.get("padding")

    @property
    def over_cell(self) -> bool:
        """Whether it ends at the faces of the cell (or, with padding, beyond the open ones)."""
        p = self._
        if self.kind == "regular":
            return p["cell"] is None and p["origin"] is None
        return self.kind == "slab" or (self.kind == "plane" and p["axis"] is not None)

    @property
    def follows_atoms(self) -> bool:
        return self.kind == "atoms"

    @property
    def bin_means(self) -> bool:
        """Whether values are means over the width of bins."""
        return "means" in self._

    @property
    def counts_crossings(self) -> bool:
        """Whether it is planes, on which sums are counted that need no kernel."""
        return self.kind == "planes"

    def describe(self) -> str:
        """One line for reports."""
        p = self._
        if self.follows_mass:
            fixed = Grid(self.kind, {k: v for k, v in p.items() if k != "follow"})
            what = "centre of mass" if p["follow"] == "mass" else f"interface on the {p['follow']} side"
            return f"{fixed.describe()}, moving with the {what}"
        how = f"{' x '.join(str(abs(n)) for n in p['shape'] if n)} points" if p.get("shape") else ""
        if not how and "spacing" in p:
            how = f"spacing {np.unique(p['spacing'][np.isfinite(p['spacing'])]).tolist()}"
        if "padding" in p and self.kind != "regular":
            return Grid(self.kind, {k: v for k, v in p.items() if k != "padding"}).describe() + ", padded at open faces"
        if self.kind == "regular":
            where = "each frame's cell" if p["cell"] is None else "a region"
            where += ", padded at open faces" * ("padding" in p)
            return f"regular, {how}, {where}, at {'centers' if p['shift'] else 'corners'}"
        if self.kind == "plane":
            return f"plane, {how}" + (f", normal to {'xyz'[p['axis']]}" if p["axis"] is not None else "")
        if self.local_axes:
            reach = (f" from {p['inner']:g}" if p["inner"] else "") + f" to radius {p['radius']:g}"
            return f"{self.kind},{reach}, {how}, components along {', '.join(self.local_axes)}"
        if self.kind == "planes":
            return planes.described(p)
        if self.kind == "line":
            return f"line, {p['n']} points"
        if self.kind == "slab":
            return f"slab profile along {'xyz'[p['axis']]}, {p['bins']} bins" + ", means over them" * ("means" in p)
        return f"{len(p['xyz'])} points" if self.kind == "points" else "the atoms"

    def _repr_html_(self):
        """For notebooks."""
        from ..terminal import html_table

        return html_table(f"grid {self.kind}", [("points", self.describe())])

    def fixed(self, units, cell: Cell, positions=None) -> Grid:
        """This grid with the numbers of points that its spacing gives in this cell: where the cell changes, the points
        move with it and stay as many."""
        if self.local_axes:
            cell = cell if cell.complete else cell.completed(np.zeros((0, 3)) if positions is None else positions)
            return Grid(self.kind, curved.settled(self.kind, self._, units, cell))
        if self._.get("spacing") is None:
            return self
        return Grid(self.kind, {**self._, "spacing": None, "shape": self.bind(units, cell, positions).counts})

    def require_dimension(self, dimension: int) -> None:
        """Raise AtcError unless the grid has a meaning in so many dimensions: points of two numbers in the plane only,
        and there one layer and no planes across."""
        p, shown = self._, {"cell": "vectors", "xyz": "points"}
        if self.kind == "regular":
            layers(p["shape"], dimension == 2)
        if dimension == 3:
            for key, value in p.items():
                if isinstance(value, np.ndarray) and np.isnan(value).any():
                    why = "two numbers are of a two-dimensional run, but this one has three dimensions: give "
                    why += "one or three" if key == "spacing" else "x, y and z"
                    raise AtcError(f"grid {shown.get(key, key)}: {why}")
        elif self.local_axes:
            raise AtcError(f"a {self.kind} grid is one of three dimensions: take points in a two-dimensional run")
        elif self.kind == "slab" and p["axis"] == 2:
            raise AtcError("a slab profile along axis z: a two-dimensional run has no extent there: take x or y")
        elif self.kind == "planes" and (p["axis"] == 2 or p["patches"]):
            raise AtcError("planes in a two-dimensional run are lines: take x or y as axis, and no patches")
        elif self.kind == "plane" and p["axis"] in (0, 1):
            why = "in two dimensions that is a line: use a line or a slab profile"
            raise AtcError(f"a plane normal to axis {'xyz'[p['axis']]}: {why}")
        elif self.kind == "plane" and p.get("position") is not None:
            raise AtcError("a plane at a position along z: a two-dimensional run has only one: leave the position out")

    def bind(self, units, cell: Cell, positions=None) -> BoundGrid:
        """The grid for one frame: positions in internal units.

        Parameters
        ----------
        units : atc.units.Units, the user's
        cell : Cell, the frame's, internal units
        positions : (n, 3), needed by `Grid.atoms`
        """
        p, f = self._, units.factor("length")
        self.require_dimension(units.dimension)
        flat = units.dimension == 2
        # Where the plane of a two-dimensional run is: in the middle of its cell.
        place = partial(in_space, cell.origin[2] + 0.5 * cell.vectors[2, 2] if flat else None, units)
        if self.kind == "atoms":
            if positions is None or len(positions) == 0:
                raise AtcError("a grid of atoms needs a frame with atoms")
            return BoundGrid("atoms", cell, ("atom",), xyz=np.ascontiguousarray(positions, dtype=np.float64))
        if self.kind == "points":
            return BoundGrid("points", cell, ("point",), xyz=place("grid point", p["xyz"] * f))
        if not cell.complete:
            cell = cell.completed(np.zeros((0, 3)) if positions is None else positions)
        if self.local_axes:
            xyz, basis, values = curved.points(self.kind, curved.settled(self.kind, p, units, cell), f)
            bound = BoundGrid(self.kind, cell, self.local_axes, xyz=np.ascontiguousarray(xyz), counts=p["shape"])
            bound.basis_gcc, bound.along = basis, values
            return bound
        if self.kind == "planes":
            found = planes.bound(p, cell, f)
            bound = BoundGrid("planes", cell, found["dims"], xyz=found["xyz"], counts=found["counts"], axis=p["axis"])
            bound.along, bound.shares_p = found["along"], found["shares_p"]
            return bound
        own, cell = cell, self._padded(cell, f)
        if self.kind == "line":
            n, start, _ = p["n"], place("line start", p["start"] * f), place("line end", p["end"] * f)
            steps = directions("line", (p["end"] - p["start"])[None] * f / max(n - 1, 1), flat)
            return BoundGrid("line", cell, ("s",), origin=start - cell.origin, steps=steps, counts=(n,))
        if self.kind == "slab":
            n, a = p["bins"], p["axis"]  # deposited in the padded cell, whose cross-section is the same
            step = cell.vectors[a] / n
            bound = BoundGrid("slab", cell, ("xyz"[a],), origin=0.5 * step, steps=step[None], counts=(n,), axis=a)
            bound.means = "means" in p
            bound.padding = float((own.origin - cell.origin) @ cell.inverse[:, a] * cell.heights[a])
            return bound
        if self.kind == "plane":
            if p["axis"] is None:
                origin, edges = place("plane origin", p["origin"] * f) - cell.origin, np.stack([p["u"], p["v"]]) * f
                edges = directions("plane edge", edges, flat)
                name: tuple[str, ...] = ("u", "v")
            else:
                a = p["axis"]
                others = [k for k in range(3) if k != a]
                share = 0.5 if p["position"] is None else p["position"] * f / cell.heights[a]
                origin, edges = share * cell.vectors[a] + (cell.origin - own.origin), cell.vectors[others]
                name = tuple("xyz"[k] for k in others)
        else:
            region, name = p["cell"], ("x", "y", "z")
            if region is None:
                origin, edges = cell.origin - own.origin, cell.vectors
            elif isinstance(region, Cell):
                origin, edges = region.origin - own.origin, region.vectors
            else:
                origin, edges = -own.origin, region * f
            if p["origin"] is not None:
                origin = p["origin"] * f - own.origin
        layer = flat and self.kind == "regular"  # in the plane; what the region says of z is of no account
        edges = directions("grid region", edges[:2], True) if layer else edges
        shape = layers(p["shape"], flat) if self.kind == "regular" else p["shape"]
        if shape is None:
            wanted = np.linalg.norm(edges, axis=1) / (p["spacing"][: len(edges)] * f)
            shape = (*(int(k) for k in np.maximum(np.round(wanted), 1)), *([1] if layer else []))
        steps = edges / np.array(shape[: len(edges)])[:, None]
        origin = origin + p["shift"] * steps.sum(0)
        if layer:
            steps, origin = np.vstack([steps, own.vectors[2]]), np.array([*origin[:2], 0.0]) + 0.5 * own.vectors[2]
        return BoundGrid(self.kind, own, name, origin=origin, steps=steps, counts=shape, shift=p["shift"])

    def _padded(self, cell, factor) -> Cell:
        """The cell with its open faces as far out as the grid's padding says."""
        if self.padding is None:
            return cell
        if isinstance(self.padding, str):
            raise AtcError('grid padding = "auto" is the reach of a kernel: give a length where there is none')
        return extended(cell, open_axes(self.kind, self._.get("axis"), cell), self.padding * factor)
