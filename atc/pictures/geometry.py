"""Where the points of a field are, in two and three dimensions: what pictures and comparisons need to know of an
output's geometry."""

from __future__ import annotations

import re

import numpy as np

from ..errors import AtcError

_TEX = {
    "angstrom": "Å",
    "sigma": "$\\sigma$",
    "K": "K",
    "epsilon/kB": "$\\epsilon/k_B$",
    "epsilon/sigma^3": "$\\epsilon/\\sigma^3$",
    "m/sigma^3": "$m/\\sigma^3$",
    "1": "",
    "sigma/tau": "$\\sigma/\\tau$",
    "1/sigma^3": "$1/\\sigma^3$",
}

#: How the name of a field's standard error ends.
STDERR = "_stderr"
#: Kinds of places that are drawn as curves.
PROFILES = ("line", "slab", "planes")


def unit_text(units: str) -> str:
    """The unit as drawn: Å for angstrom, Greek letters, powers raised."""
    if units in _TEX:
        return _TEX[units]
    text = units.replace("angstrom", "Å").replace("*", "·").replace("kB", "$k_B$")
    text = re.sub(r"\b(sigma|epsilon|tau)\b", r"$\\\1$", text)
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", text)


def with_unit(text: str, units: str | None) -> str:
    """A label with its unit as drawn behind it, if it has one."""
    unit = unit_text(units or "")
    return f"{text} ({unit})" if unit else text


def rank(da) -> int:
    """0 for scalars, 1 for vectors, 2 for tensors."""
    return sum(d in ("i", "j") for d in da.dims)


def grid_dims(da) -> list[str]:
    """The dimensions of a variable that are the grid's."""
    return [d for d in da.dims if d not in ("frame", "i", "j")]


def fields_of(ds) -> list[str]:
    """The variables of a dataset that are fields on its grid (standard errors and the like left out)."""
    return [
        n
        for n, da in ds.data_vars.items()
        if grid_dims(da) and da.dtype.kind == "f" and not n.endswith(STDERR) and placed(ds, da)
    ]


class Places:
    """The points of a field in space, in the dataset's length unit.

    Attributes
    ----------
    kind : ``volume``, ``plane``, ``line``, ``slab``, ``planes``, ``points`` or ``atoms``
    dims : the grid's dimensions, in the order of `x_gc`
    x_gc : (*shape, 3) the points
    steps : (dims, 3) from one point to the next
    edges : what to call the directions of the dimensions where they are not Cartesian
    tiles : whether the mean over the points is a mean over the whole cell
    thickness : of the layer that a plane cut from a volume stands for, half of it on either side
    """

    def __init__(self, kind, dims, x_gc, unit, tiles=False, steps=None, edges="abc"):
        self.kind, self.dims, self.x_gc, self.unit, self.tiles = kind, list(dims), np.asarray(x_gc, float), unit, tiles
        self.edges = edges
        self.steps = steps
        self.thickness = np.inf
        if self.steps is None and kind in ("volume", "plane", *PROFILES):
            self.steps = np.array([self._step(k) for k in range(len(self.dims))])

    def _step(self, k):
        """From one point to the next along dimension k (a lattice: the same everywhere)."""
        n = self.x_gc.shape[k]
        if n < 2:
            return np.zeros(3)
        first = (0,) * (self.x_gc.ndim - 1)
        last = tuple(n - 1 if a == k else 0 for a in range(self.x_gc.ndim - 1))
        return (self.x_gc[last] - self.x_gc[first]) / (n - 1)

    def _named(self, k):
        """The unit vector that dimension k is named after, of any other name x's: for a single point along it."""
        return np.eye(3)["xyz".find(self.dims[k]) if self.dims[k] in ("x", "y", "z") else 0]

    def cut(self, k, i):
        """The plane of a volume at index i of dimension k."""
        keep = [d for d in range(3) if d != k]
        dims, edges = ([of[d] for d in keep] for of in (self.dims, self.edges))
        out = Places("plane", dims, np.take(self.x_gc, i, axis=k), self.unit, steps=self.steps[keep], edges=edges)
        normal = np.cross(*out.steps)
        size = np.linalg.norm(normal)
        out.thickness = 0.5 * abs(self.steps[k] @ normal) / size if size > 0 else np.inf
        return out

    def flat(self):
        """The points in two dimensions: for a plane the (n+1, m+1, 2) corners of its tiles, else (n, 2) points; labels,
        basis (3, 3) and origin."""
        x = self.x_gc.reshape(-1, 3)
        unit = with_unit("", self.unit)
        if self.kind != "plane":
            extent = np.ptp(x, axis=0)
            u, v = sorted(np.argsort(-extent, kind="stable")[:2])
            basis = np.eye(3)[[u, v, 3 - u - v]]
            return x @ basis[:2].T, [f"{'xyz'[u]}{unit}", f"{'xyz'[v]}{unit}"], basis, x.mean(0)
        a, b = (s if np.linalg.norm(s) > 0 else None for s in self.steps)
        if a is None or b is None:  # a single row of points: the axis it is named after, or any direction across it
            one = a if b is None else b
            one = self._named(0) if one is None else one
            other = self._named(1 if b is None else 0)
            if np.linalg.norm(np.cross(other, one)) < 1e-9 * np.linalg.norm(one):
                other = np.eye(3)[np.argmin(np.abs(one))]
            other = np.cross(np.cross(one, other), one)
            other *= np.linalg.norm(one) / np.linalg.norm(other)
            a, b = (one, other) if b is None else (other, one)
        normal = np.cross(a, b)
        normal /= np.linalg.norm(normal)
        along = [k for k in range(3) if abs(abs(normal[k]) - 1) < 1e-9]
        if along:
            u, v = (d for d in range(3) if d != along[0])
            basis = np.array([np.eye(3)[u], np.eye(3)[v], np.eye(3)[along[0]]])
            labels = [f"{'xyz'[u]}{unit}", f"{'xyz'[v]}{unit}"]
        else:
            e = a / np.linalg.norm(a)
            basis = np.array([e, np.cross(normal, e), normal])
            labels = [f"along {self.edges[0]}{unit}", f"in the plane, normal to {self.edges[0]}{unit}"]
        n, m = self.x_gc.shape[:2]
        i, j = np.arange(n + 1) - 0.5, np.arange(m + 1) - 0.5
        corners = self.x_gc[0, 0] + i[:, None, None] * a + j[None, :, None] * b
        origin = self.x_gc[0, 0]
        return corners @ basis[:2].T, labels, basis, origin

    def abscissa(self, k=0):
        """Distance along dimension k and its label. Along a Cartesian axis it is the coordinate itself."""
        index = tuple(slice(None) if a == k else 0 for a in range(self.x_gc.ndim - 1))
        x = self.x_gc[index]
        step = self.steps[k]
        length = np.linalg.norm(step)
        unit = with_unit("", self.unit)
        along = [c for c in range(3) if length > 0 and abs(abs(step[c]) - length) <= 1e-9 * length]
        if along or length == 0:
            c = along[0] if along else int(np.argmax(self._named(k)))
            return x[:, c], f"{'r' if self.dims[k] == 'r' else 'xyz'[c]}{unit}"
        return (x - x[0]) @ (step / length), f"distance along {self.edges[k]}{unit}"


def cut(place, text=None, axis=None, index=None):
    """A plane of a volume: its points, the selection that gives it, and what to call it.

    `text` is ``"z=0.5"`` (fraction of the axis) or ``"z=12.5A"`` (distance along it); or `axis` and `index`. Default:
    the middle of the axis with the fewest points.
    """
    if text is not None:
        if axis is not None or index is not None:
            raise AtcError("give --slice, or --axis and --index, not both")
        axis, eq, where = text.partition("=")
        if not eq:
            raise AtcError(
                f"slice {text!r}: expected AXIS=POSITION, e.g. z=0.5 (fraction of the axis) or z=12.5A (length)"
            )
    else:
        shape = place.x_gc.shape[:3]
        axis, where = axis if axis is not None else place.dims[2 - int(np.argmin(shape[::-1]))], None
    names = {letter: k for letters in ("012", "abc", "xyz", place.dims) for k, letter in enumerate(letters)}
    if str(axis) not in names:
        raise AtcError(f"axis {axis!r}: expected one of {', '.join(place.dims)}")
    k = names[str(axis)]
    n, dim = place.x_gc.shape[k], place.dims[k]
    s, label = place.abscissa(k)
    if where is None:
        i = n // 2 if index is None else index
        if not -n <= i < n:
            raise AtcError(f"index {index}: the grid has {n} points along {dim}, numbered 0 to {n - 1}")
        i %= n
    else:
        try:
            i = _index_at(where.strip(), s, n)
        except ValueError:
            raise AtcError(
                f"slice {text!r}: expected a fraction between 0 and 1 (z=0.5), or a length with an A behind it "
                "(z=12.5A)"
            ) from None
    plane = place.cut(k, i)
    x = plane.x_gc.reshape(-1, 3)
    flat = [c for c in range(3) if np.ptp(x[:, c]) <= 1e-9 * max(np.ptp(place.x_gc[..., c]), 1e-300)]
    position = f"plane {i + 1} of {n} along {place.edges[k]}"
    if flat:
        position = f"{'xyz'[flat[0]]} = {x[0, flat[0]]:.4g} {unit_text(place.unit)}".rstrip()
    return plane, {dim: i}, position


def _index_at(where, s, n):
    if where.endswith("A"):
        return int(np.argmin(np.abs(s - float(where[:-1]))))
    fraction = float(where)
    if not 0 <= fraction <= 1:
        raise ValueError
    return int(np.clip(round(fraction * n - 0.5), 0, n - 1))


def placed(ds, da) -> bool:
    """Whether the output says where the points of a field are."""
    return _positions(ds, da) is not None


def over_angles(ds):
    """Of an output on a cylindrical or spherical grid its profiles in r: plain means over the other dimensions, which
    are means over cylinders and spheres."""
    axes = str(ds.attrs["axes"]).split()
    others = [d for d in axes if d != "r"]
    out = _without_places(ds)
    return out.mean([d for d in others if d in out.dims], skipna=True, keep_attrs=True)


def _without_places(ds):
    """What means over points can be taken of (standard errors of means are not the means of the errors), and of how
    many frames each entry is."""
    out = ds.drop_vars([f"position_{c}" for c in "xyz"], errors="ignore")
    lost = [n for n in out.data_vars if out[n].dtype.kind != "f" or str(n).endswith(STDERR)]
    return out.drop_vars([n for n in lost if n != "frames_averaged"])


def over_axes(ds, axes: str):
    """Of an output on a grid along x, y, z (or u, v) the means over some of its axes, e.g. ``"y"`` or ``"x,y"``. Where
    nothing is, sums (density, stress) count as 0; of quotients (velocity, temperature) it is the plain mean of what is
    known."""
    from ..estimators.registry import QUANTITIES

    wanted = [a.strip() for a in str(axes).split(",") if a.strip()]
    there = list(dict.fromkeys(d for n in fields_of(ds) for d in grid_dims(ds[n]) if d not in ("point", "atom")))
    if "axes" in ds.attrs or not wanted or [a for a in wanted if a not in there] or len(there) <= len(set(wanted)):
        raise AtcError(f"mean over {axes}: expected some, not all, of the grid's axes: {', '.join(there) or 'none'}")
    out = _without_places(ds)
    out = out.drop_vars([n for n in out.data_vars if "atom" in out[n].dims])
    for name in out.data_vars:
        if not (name in QUANTITIES and QUANTITIES[name].weight is not None):
            out[name] = out[name].fillna(0.0)
    return out.mean(wanted, skipna=True, keep_attrs=True)


def _positions(ds, da):
    """(*shape, 3) positions of the points of a field's grid, or None if the output does not hold them. Points that move
    are where they are in the frame of `da`; where it has none (a mean) they are where the first frame has them."""
    dims = grid_dims(da)
    if dims == ["r"] and "r" in ds.coords:
        return np.stack([ds.coords["r"].values, np.zeros(ds.sizes["r"]), np.zeros(ds.sizes["r"])], axis=-1)
    shape = tuple(ds.sizes[d] for d in dims)
    names = [f"position_{c}" for c in "xyz"]
    for coords in (da.coords, ds.coords):
        found = [coords[n].isel(frame=0) if "frame" in coords[n].dims else coords[n] for n in names if n in coords]
        if len(found) == 3 and all(set(c.dims) == set(dims) for c in found):
            return np.stack([c.transpose(*dims).values for c in found], axis=-1)
    axes = ["xyz".index(d) if d in ("x", "y", "z") and d in ds.coords else None for d in dims]
    if None in axes:
        return None
    out = np.zeros((*shape, 3))
    for k, (d, c) in enumerate(zip(dims, axes)):
        here = da.coords.get(f"position_{d}")
        axis = here if here is not None and here.dims == (d,) else ds.coords[d]
        out[..., c] = axis.values.reshape([-1 if m == k else 1 for m in range(len(dims))])
    return out


def points_of_grid(ds, da) -> Places:
    """Where the points of the field `da` of an output are."""
    dims = grid_dims(da)
    if "axes" in ds.attrs and len(dims) > 1:
        kind = "cylindrical" if "z" in dims else "spherical"
        raise AtcError(
            f"{da.name}: is on a {kind} grid, with components along {ds.attrs['axes']}: atc plot draws its profiles in "
            "r; for anything else compute it on points or a regular grid"
        )
    x = _positions(ds, da)
    if x is None:
        raise AtcError(f"{da.name}: the output does not say where its points are")
    found = [ds.coords[n].attrs for n in ("position_x", *dims) if n in ds.coords]
    unit = next((attrs["units"] for attrs in found if "units" in attrs), "")
    if dims[0] in ("point", "atom"):
        return Places("points" if dims[0] == "point" else "atoms", dims, x, unit)
    grid = str(ds.attrs.get("grid", ""))
    profile = "slab" if grid.startswith("slab") else "planes" if grid.startswith("planes") else "line"
    kind = {3: "volume", 2: "plane"}.get(len(dims)) or profile
    edges = {"x": "a", "y": "b", "z": "c", "s": "the line"}
    out = Places(kind, dims, x, unit, edges=[edges.get(d, d) for d in dims])
    out.tiles = _tiles(ds, out)
    return out


def _tiles(ds, place) -> bool:
    """Whether the points stand for the whole cell, so that their mean is a box average."""
    if place.kind not in ("volume", "slab") or "cell" not in ds.coords:
        return False
    cell = ds.coords["cell"].values.reshape(-1, 3, 3)[0]
    size = np.abs(cell).max()
    spans = place.steps * np.array(place.x_gc.shape[:-1])[:, None]
    if place.kind == "volume":
        return all(
            n == 1 or np.allclose(span, edge, atol=1e-6 * size) for n, span, edge in zip(place.x_gc.shape, spans, cell)
        )
    heights = np.linalg.det(cell) / np.array(
        [np.linalg.norm(np.cross(cell[(k + 1) % 3], cell[(k + 2) % 3])) for k in range(3)]
    )
    return bool(np.isclose(np.linalg.norm(spans[0]), np.abs(heights), atol=1e-6 * size).any())
