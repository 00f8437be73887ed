"""Pictures of fields: slices and planes as maps, slabs and lines as profiles, points and atoms as scatter plots.

Everything is drawn in the units of the dataset and at its true positions (triclinic grids too). Signed components get a diverging map
that is symmetric about zero, quantities that cannot be negative a sequential one; where a field is undefined (vacuum) the map is grey.
"""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from .errors import AtcError

STDERR = "_stderr"
TENSOR = ["xx", "yy", "zz", "xy", "xz", "yz", "yx", "zx", "zy"]
TENSOR_SCALARS = ["hydrostatic", "pressure", "vonmises", "max_shear", "principal1", "principal2", "principal3"]
VECTOR = ["x", "y", "z", "magnitude"]

# what cannot be negative
_POSITIVE = {"number_density", "density", "temperature", "vonmises", "max_shear", "magnitude"}
_MAPS = {"temperature": "inferno", "density": "viridis", "number_density": "viridis"}
_TEX = {
    "angstrom": "Å", "sigma": "$\\sigma$", "K": "K", "epsilon/kB": "$\\epsilon/k_B$", "epsilon/sigma^3": "$\\epsilon/\\sigma^3$", "m/sigma^3": "$m/\\sigma^3$",
    "1": "", "sigma/tau": "$\\sigma/\\tau$", "1/sigma^3": "$1/\\sigma^3$",
}  # fmt: skip
_STYLE = {
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.labelsize": 9,
    "axes.linewidth": 0.8,
    "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "figure.dpi": 100,
    "savefig.dpi": 200,
    "image.interpolation": "nearest",
    "lines.linewidth": 1.4,
    "mathtext.default": "regular",
    "svg.hashsalt": "atc",
}


def unit_text(units: str) -> str:
    """The unit as drawn: Å for angstrom, powers raised."""
    import re

    if units in _TEX:
        return _TEX[units]
    text = units.replace("angstrom", "Å").replace("*", "·")
    return re.sub(r"\^(-?\d+)", r"$^{\1}$", text)


# --------------------------------------------------------------------------------------------------------------------
# Scalars of tensors and vectors.


def component(values, name: str):
    """One scalar of a tensor (..., 3, 3) or vector (..., 3) field, as an array (...).

    Tensors: ``xx`` … ``zz``; ``hydrostatic`` = tr σ/3 (tension positive), ``pressure`` its negative, ``vonmises`` = √(3/2 s:s) of the symmetric
    part's deviator s, ``max_shear`` = (σ₁ − σ₃)/2, ``principal1`` ≥ ``principal2`` ≥ ``principal3``. Vectors: ``x``, ``y``, ``z``, ``magnitude``.
    """
    values = np.asarray(values)
    tensor = values.ndim >= 2 and values.shape[-2:] == (3, 3)
    if tensor and name in TENSOR:
        return values[..., "xyz".index(name[0]), "xyz".index(name[1])]
    if not tensor and name in ("x", "y", "z"):
        return values[..., "xyz".index(name)]
    if not tensor and name == "magnitude":
        return np.sqrt((values * values).sum(axis=-1))
    if not tensor or name not in TENSOR_SCALARS:
        known = TENSOR + TENSOR_SCALARS if tensor else VECTOR
        near = difflib.get_close_matches(name, known, n=1)
        raise AtcError(f"unknown component {name!r}: {f'did you mean {near[0]!r}? ' if near else ''}known: {', '.join(known)}")
    trace = np.einsum("...ii->...", values)
    if name == "hydrostatic":
        return trace / 3
    if name == "pressure":
        return -trace / 3
    sym = 0.5 * (values + np.swapaxes(values, -1, -2))
    if name == "vonmises":
        dev = sym - (trace / 3)[..., None, None] * np.eye(3)
        return np.sqrt(1.5 * (dev * dev).sum(axis=(-1, -2)))
    # eigvalsh refuses NaN: undefined points stay undefined
    good = np.isfinite(sym).all(axis=(-1, -2))
    principal = np.full(sym.shape[:-1], np.nan)
    principal[good] = np.linalg.eigvalsh(sym[good])[..., ::-1]
    if name == "max_shear":
        return 0.5 * (principal[..., 0] - principal[..., 2])
    return principal[..., int(name[-1]) - 1]


_SYMBOL = {
    "hydrostatic": "hydrostatic part", "pressure": "pressure", "vonmises": "von Mises", "max_shear": "maximum shear",
    "principal1": "first principal value", "principal2": "second principal value", "principal3": "third principal value", "magnitude": "magnitude",
}  # fmt: skip


def _rank(da) -> int:
    return sum(d in ("i", "j") for d in da.dims)


def _grid_dims(da) -> list[str]:
    return [d for d in da.dims if d not in ("frame", "i", "j")]


def fields_of(ds) -> list[str]:
    """The variables of a dataset that are fields on its grid (standard errors and the like left out)."""
    return [n for n, da in ds.data_vars.items() if _grid_dims(da) and da.dtype.kind == "f" and not n.endswith(STDERR) and _placed(ds, da)]


def load(path):
    """Open an output of ``atc fields`` (.zarr or .nc), or pass a Dataset through. `AtcError` for anything else."""
    import xarray as xr

    if isinstance(path, xr.Dataset):
        return path
    path = Path(path)
    if path.exists() and path.suffix not in (".zarr", ".nc"):
        raise AtcError(f"{path}: expected an output of atc fields, a name that ends in .zarr or .nc")
    from .output import open_dataset

    ds = open_dataset(path)
    if not ds.data_vars:
        raise AtcError(f"{path}: holds no fields: not an output of atc fields, or a damaged one")
    return ds


# --------------------------------------------------------------------------------------------------------------------
# What is drawn: a field brought to one frame, one scalar, and two or fewer dimensions.


def _pick(ds, quantity):
    names = fields_of(ds)
    if quantity is None:
        for name in ("stress", "stress_potential", "smoothed_virial_stress", *names):
            if name in names:
                return name
        raise AtcError("this output holds no field on a grid (only box totals): there is nothing to draw; its numbers are in atc compare")
    if quantity not in names:
        near = difflib.get_close_matches(quantity, names, n=1)
        why = (
            "is one number for the box, not a field: nothing to draw"
            if quantity in ds and not _grid_dims(ds[quantity])
            else "is not in this output"
        )
        raise AtcError(f"{quantity} {why}: {f'did you mean {near[0]!r}? ' if near else ''}it holds {', '.join(names) or 'no fields'}")
    return quantity


def _at_frame(ds, name, frame):
    """The field at one frame (or averaged), and what to call that."""
    da = ds[name]
    if "frame" not in da.dims:
        return da, ""
    n = da.sizes["frame"]
    if frame == "mean":
        if n == 1:
            return da.isel(frame=0), _frame_text(ds, 0)
        return da.mean("frame", skipna=True, keep_attrs=True), f"mean of {n} frames"
    try:
        k = int(frame)
    except ValueError:
        raise AtcError(f"frame {frame!r}: expected a number counted from 0 (-1 is the last) or mean") from None
    if not -n <= k < n:
        raise AtcError(f"frame {k}: the output has {n} frame{'s' * (n != 1)}, numbered 0 to {n - 1}")
    return da.isel(frame=k), _frame_text(ds, k)


def _frame_text(ds, k) -> str:
    one = ds.isel(frame=k)
    if "frames_averaged" in ds:
        return f"average of {int(one.frames_averaged)} frames"
    text = f"frame {int(one.frame)}" if "frame" in one.coords else f"frame {k}"
    if "time" in one.coords and np.isfinite(float(one.time)):
        text += f", t = {float(one.time):.4g} {unit_text(one.time.attrs.get('units', ''))}".rstrip()
    elif "step" in one.coords and int(one.step) >= 0:
        text += f", step {int(one.step)}"
    return text


def _scalars(da, wanted) -> list[str | None]:
    """The components to draw, one a panel."""
    rank = _rank(da)
    if rank == 0:
        if wanted not in (None, "all"):
            raise AtcError(f"{da.name} is a scalar: it has no component {wanted!r}")
        return [None]
    if wanted in (None, "all"):
        if rank == 1:
            return list(VECTOR)
        symmetric = np.allclose(
            da.values,
            np.swapaxes(da.values, -1, -2),
            rtol=1e-9,
            atol=1e-12 * float(np.nanmax(np.abs(da.values), initial=0)),
            equal_nan=True,
        )
        return TENSOR[:6] if symmetric else ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"]
    return [w.strip() for w in wanted.split(",")]


def _label(da, comp, units) -> str:
    name = da.name.replace("_", " ")
    if comp is not None:
        name += f" $_{{{comp}}}$" if comp in TENSOR or comp in ("x", "y", "z") else f", {_SYMBOL[comp]}"
    units = unit_text(units)
    return f"{name} ({units})" if units else name


def _colours(name, comp, values, limits, robust):
    """Colour map and limits for one panel."""
    import matplotlib as mpl

    finite = values[np.isfinite(values)]
    positive = comp in _POSITIVE or (comp is None and name in _POSITIVE)
    if positive or (comp is None and finite.size and finite.min() >= 0):
        cmap = _MAPS.get(name, "viridis" if comp is None else "cividis")
        lo, hi = 0.0, 1.0
        if finite.size:
            lo, hi = np.percentile(finite, [2, 98]) if robust else (finite.min(), finite.max())
    else:
        cmap = "RdBu_r"
        top = 1.0
        if finite.size:
            top = np.percentile(np.abs(finite), 98) if robust else np.abs(finite).max()
        lo, hi = -top, top
    if limits is not None:
        lo, hi = limits
    if not hi > lo:  # a constant field
        pad = abs(lo) * 1e-3 or 1.0
        lo, hi = lo - pad, hi + pad
    cmap = mpl.colormaps[cmap].with_extremes(bad="0.82")
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[
        bool(finite.size and finite.min() < lo), bool(finite.size and finite.max() > hi)
    ]
    return cmap, lo, hi, extend


def plot(ds, quantity=None, *, component=None, slice=None, axis=None, index=None, frame=-1, limits=None, robust=False, atoms=None):
    """Draw one field, one panel a component.

    Parameters
    ----------
    ds : xarray.Dataset or path, an output of `atc.fields`
    quantity : name of a field, or several separated by commas; default the stress, else the first field
    component : ``xx`` … ``zz``, ``hydrostatic``, ``pressure``, ``vonmises``, ``max_shear``, ``principal1``…``3``; ``x``, ``y``, ``z``,
        ``magnitude``; several separated by commas; default every component
    slice : for a 3-D grid, ``"z=0.5"`` (fraction of the axis) or ``"z=12.5A"`` (distance along the axis, in the dataset's length unit)
    axis, index : the same by index
    frame : index, or ``"mean"``
    limits : (lo, hi) of the colours; robust : limits at the 2nd and 98th percentile
    atoms : (n, 3) positions in the dataset's units to draw on maps, those near the plane

    Returns
    -------
    matplotlib.figure.Figure, drawn without a display (Agg)

    Raises
    ------
    AtcError : for a field, component, frame or plane that is not there
    """
    import matplotlib as mpl
    from matplotlib.figure import Figure

    ds = load(ds)
    panels = []
    wanted = [q.strip() for q in quantity.split(",")] if quantity else [None]
    for q in wanted:
        name = _pick(ds, q)
        da, when = _at_frame(ds, name, frame)
        da = da.transpose(*_grid_dims(da), ...)
        comps = _scalars(da, component if _rank(da) or len(wanted) == 1 else None)
        if len(wanted) > 1 and component is None and _rank(da):
            comps = ["magnitude" if _rank(da) == 1 else "vonmises"]
        panels += [(name, da, c) for c in comps]
    dims = {tuple(_grid_dims(da)) for _, da, _ in panels}
    if len(dims) > 1:
        raise AtcError("fields on different grids cannot share a picture: plot them one by one")
    place = layout(ds, panels[0][1])
    if place.kind == "volume":
        place, selection, where = _cut(place, slice, axis, index)
    else:
        if slice is not None or axis is not None or index is not None:
            raise AtcError(f"this output is on a {place.kind}, not on a 3-D grid: there is nothing to slice")
        selection, where = {}, ""
    title = ", ".join(t for t in (_title(ds), where, when) if t)
    with mpl.rc_context(_STYLE):
        if place.kind in ("line", "slab"):
            return _profiles(Figure, ds, panels, place, title, limits, frame)
        values = []
        for _, da, c in panels:
            v = da.isel(selection).values
            values.append(v if c is None else globals()["component"](v, c))
        return _maps(Figure, panels, values, place, title, limits, robust, atoms)


def _title(ds) -> str:
    """Kernel and radius: without them a Hardy field means little."""
    kernel, radius = ds.attrs.get("kernel"), ds.attrs.get("radius")
    if not kernel:
        return ""
    text = f"{str(kernel).partition(',')[0]} kernel"
    if isinstance(radius, (int, float, np.number)):
        text += f", R = {float(radius):.4g} {unit_text(ds.attrs.get('radius_units', ''))}".rstrip()
    return text


def _figure(Figure, n, width, height, columns=3):
    columns = min(n, columns if n not in (2, 4) else 2)
    rows = -(-n // columns)
    fig = Figure(figsize=(width * columns, height * rows), layout="constrained")
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    FigureCanvasAgg(fig)
    return fig, fig.subplots(rows, columns, squeeze=False)


def _maps(Figure, panels, values, place, title, limits, robust, atoms):
    flat, axes_labels, basis, origin = place.flat()
    lo, hi = flat.reshape(-1, 2).min(0), flat.reshape(-1, 2).max(0)
    span = np.maximum(hi - lo, 1e-12)
    aspect = float(np.clip(span[1] / span[0], 0.25, 2.5))
    width = 3.4 if len(panels) > 1 else 4.6
    fig, axs = _figure(Figure, len(panels), width, 0.78 * width * aspect + 0.65)
    for ax, (name, da, comp), v in zip(axs.flat, panels, values):
        cmap, low, high, extend = _colours(name, comp, v, limits, robust)
        masked = np.ma.masked_invalid(v)
        if place.kind == "plane":
            drawn = ax.pcolormesh(flat[..., 0], flat[..., 1], masked, cmap=cmap, vmin=low, vmax=high, rasterized=True, shading="flat")
        else:
            order = np.argsort(np.where(np.isfinite(v), np.abs(v), -1))
            size = float(np.clip(1.5e4 / max(len(v), 1), 3, 40))
            bad = ~np.isfinite(v)
            ax.scatter(*flat[bad].T, s=size, c="0.82", linewidths=0)
            order = order[~bad[order]]
            drawn = ax.scatter(*flat[order].T, s=size, c=v[order], cmap=cmap, vmin=low, vmax=high, linewidths=0, rasterized=len(v) > 5000)
        if atoms is not None and len(atoms):
            near = np.abs((atoms - origin) @ basis[2]) <= place.thickness
            ax.scatter(*((atoms[near] - origin * 0) @ basis[:2].T).T, s=2, facecolors="none", edgecolors="k", linewidths=0.3, alpha=0.6)
        ax.set_aspect("equal")
        ax.set_xlim(lo[0], hi[0])
        ax.set_ylim(lo[1], hi[1])
        if place.kind != "plane":
            ax.margins(0.03)
            ax.autoscale()
        ax.set_facecolor("white")
        ax.set_xlabel(axes_labels[0])
        ax.set_ylabel(axes_labels[1])
        bar = fig.colorbar(drawn, ax=ax, extend=extend, fraction=0.046, pad=0.02)
        bar.outline.set_linewidth(0.6)
        bar.set_label(_label(da, comp, da.attrs.get("units", "")))
    for ax in list(axs.flat)[len(panels) :]:
        ax.remove()
    fig.suptitle(title, fontsize=9)
    return fig


def _profiles(Figure, ds, panels, place, title, limits, frame):
    from collections import OrderedDict

    groups = OrderedDict()
    for name, da, comp in panels:
        groups.setdefault(name, []).append((da, comp))
    fig, axs = _figure(Figure, len(groups), 5.0, 3.1)
    s, label = place.abscissa()
    for ax, (name, members) in zip(axs.flat, groups.items()):
        err = ds.get(name + STDERR)
        if err is not None and "frame" in err.dims:
            err = None
        for da, comp in members:
            v = da.values if comp is None else component(da.values, comp)
            (line,) = ax.plot(s, v, label=comp, drawstyle="steps-mid" if place.kind == "slab" and len(s) < 60 else "default")
            if err is not None and (comp is None or comp in TENSOR or comp in ("x", "y", "z")):
                e = err.values if comp is None else component(err.values, comp)
                ax.fill_between(s, v - e, v + e, color=line.get_color(), alpha=0.2, linewidth=0)
        ax.set_xlabel(label)
        ax.set_ylabel(_label(members[0][0], None if len(members) > 1 else members[0][1], members[0][0].attrs.get("units", "")))
        ax.set_xlim(s[0], s[-1]) if len(s) > 1 else None
        if limits is not None:
            ax.set_ylim(*limits)
        if np.nanmin([m[0].values.min() for m in members]) < 0:
            ax.axhline(0, color="0.6", lw=0.6, zorder=0)
        if len(members) > 1:
            ax.legend(ncols=1 if len(members) < 4 else 2)
        ax.spines[["top", "right"]].set_visible(False)
    for ax in list(axs.flat)[len(groups) :]:
        ax.remove()
    fig.suptitle(title, fontsize=9)
    return fig


# --------------------------------------------------------------------------------------------------------------------
# Where the points are.


class Layout:
    """The points of a field in space, in the dataset's length unit.

    Attributes
    ----------
    kind : ``volume``, ``plane``, ``line``, ``slab``, ``points`` or ``atoms``
    dims : the grid's dimensions, in the order of `x_gc`
    x_gc : (*shape, 3) the points
    tiles : whether the mean over the points is a mean over the whole cell
    """

    def __init__(self, kind, dims, x_gc, unit, tiles=False, steps=None, labels=None):
        self.kind, self.dims, self.x_gc, self.unit, self.tiles = kind, list(dims), np.asarray(x_gc, float), unit, tiles
        self.labels = labels
        self.steps = steps
        self.thickness = np.inf
        if self.steps is None and kind in ("volume", "plane", "line", "slab"):
            self.steps = np.array([self._step(k) for k in range(len(self.dims))])

    def _step(self, k):
        """From one point to the next along dimension k (a lattice: the same everywhere)."""
        n = self.x_gc.shape[k]
        if n < 2:
            return np.zeros(3)
        first = (0,) * (self.x_gc.ndim - 1)
        last = tuple(n - 1 if a == k else 0 for a in range(self.x_gc.ndim - 1))
        return (self.x_gc[last] - self.x_gc[first]) / (n - 1)

    def cut(self, k, i):
        """The plane of a volume at index i of dimension k."""
        keep = [d for d in range(3) if d != k]
        out = Layout("plane", [self.dims[d] for d in keep], np.take(self.x_gc, i, axis=k), self.unit, steps=self.steps[keep])
        normal = np.cross(*out.steps)
        size = np.linalg.norm(normal)
        out.thickness = 0.5 * abs(self.steps[k] @ normal) / size if size > 0 else np.inf
        return out

    def flat(self):
        """The points in two dimensions: for a plane the (n+1, m+1, 2) corners of its tiles, else (n, 2) points; labels, basis (3, 3) and origin."""
        x = self.x_gc.reshape(-1, 3)
        unit = f" ({unit_text(self.unit)})" if unit_text(self.unit) else ""
        if self.kind != "plane":
            extent = np.ptp(x, axis=0)
            u, v = sorted(np.argsort(extent)[-2:])
            basis = np.eye(3)[[u, v, 3 - u - v]]
            return x @ basis[:2].T, [f"{'xyz'[u]}{unit}", f"{'xyz'[v]}{unit}"], basis, x.mean(0)
        a, b = (s if np.linalg.norm(s) > 0 else None for s in self.steps)
        if a is None or b is None:  # a single row of points: any direction across it will do
            one = a if b is None else b
            one = np.array([1.0, 0, 0]) if one is None else one
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
            labels = [f"distance along {_direction(basis[0])}{unit}", f"distance along {_direction(basis[1])}{unit}"]
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
        unit = f" ({unit_text(self.unit)})" if unit_text(self.unit) else ""
        along = [c for c in range(3) if length > 0 and abs(abs(step[c]) - length) <= 1e-9 * length]
        if along or length == 0:
            c = along[0] if along else 0
            return x[:, c], f"{'xyz'[c]}{unit}"
        return (x - x[0]) @ (step / length), f"distance along {_direction(step / length)}{unit}"


def _direction(e) -> str:
    return "(" + ", ".join(f"{v:.2g}" for v in np.where(np.abs(e) < 1e-9, 0.0, e)) + ")"


def _cut(place, text, axis, index):
    """The plane asked for: its layout, the selection that gives it, and its name."""
    if text is not None:
        if axis is not None or index is not None:
            raise AtcError("give --slice, or --axis and --index, not both")
        axis, eq, where = text.partition("=")
        if not eq:
            raise AtcError(f"slice {text!r}: expected AXIS=POSITION, e.g. z=0.5 (fraction of the axis) or z=12.5A (length)")
    else:
        axis, where = axis or place.dims[-1], None
    names = (
        {d: k for k, d in enumerate(place.dims)}
        | {n: k for k, n in enumerate("xyz")}
        | {n: k for k, n in enumerate("abc")}
        | {str(k): k for k in range(3)}
    )
    if str(axis) not in names:
        raise AtcError(f"axis {axis!r}: expected one of {', '.join(place.dims)}")
    k = names[str(axis)]
    n = place.x_gc.shape[k]
    dim = place.dims[k]
    if where is None:
        i = n // 2 if index is None else index
        if not -n <= i < n:
            raise AtcError(f"index {index}: the grid has {n} points along {dim}, numbered 0 to {n - 1}")
        i %= n
    else:
        s, _ = place.abscissa(k)
        try:
            if where.strip().endswith("A"):
                i = int(np.argmin(np.abs(s - float(where.strip()[:-1]))))
            else:
                fraction = float(where)
                if not 0 <= fraction <= 1:
                    raise AtcError(f"slice {text!r}: a fraction lies between 0 and 1; for a length write {dim}={where}A")
                i = int(np.clip(round(fraction * n - 0.5), 0, n - 1))
        except ValueError:
            raise AtcError(f"slice {text!r}: expected a fraction (z=0.5) or a length with an A behind it (z=12.5A)") from None
    s, label = place.abscissa(k)
    position = f"{label.split(' (')[0]} = {s[i]:.4g} {unit_text(place.unit)}".rstrip()
    return place.cut(k, i), {dim: i}, position


def _placed(ds, da) -> bool:
    """Whether the output says where the points of a field are."""
    return _positions(ds, _grid_dims(da)) is not None


def _positions(ds, dims):
    """(*shape, 3) positions of the points of a grid with these dimensions, or None if the output does not hold them."""
    shape = tuple(ds.sizes[d] for d in dims)
    out, found = np.zeros((*shape, 3)), False
    for c, letter in enumerate("xyz"):
        if letter not in ds.coords:
            continue
        x = ds.coords[letter]
        if x.dims and set(x.dims) <= set(dims) and x.dtype.kind == "f":
            missing = [d for d in dims if d not in x.dims]
            out[..., c] = x.expand_dims({d: ds.sizes[d] for d in missing}).transpose(*dims).values
            found = True
    return out if found else None


def layout(ds, da) -> Layout:
    """Where the points of the field `da` of an output are."""
    dims = _grid_dims(da)
    x = _positions(ds, dims)
    if x is None:
        raise AtcError(f"{da.name}: the output does not say where its points are")
    unit = next((ds.coords[c].attrs.get("units", "") for c in "xyz" if c in ds.coords and ds.coords[c].attrs.get("units")), "")
    if dims[0] in ("point", "atom"):
        return Layout("points" if dims[0] == "point" else "atoms", dims, x, unit)
    kind = {3: "volume", 2: "plane"}.get(len(dims)) or ("slab" if str(ds.attrs.get("grid", "")).startswith("slab") else "line")
    out = Layout(kind, dims, x, unit)
    out.tiles = _tiles(ds, out)
    return out


def _tiles(ds, place) -> bool:
    """Whether the points stand for the whole of a periodic cell, so that their mean is a box average."""
    if place.kind not in ("volume", "slab") or "cell" not in ds.coords or ds.attrs.get("periodic") != "ppp":
        return False
    cell = ds.coords["cell"].values.reshape(-1, 3, 3)[0]
    size = np.abs(cell).max()
    spans = place.steps * np.array(place.x_gc.shape[:-1])[:, None]
    if place.kind == "volume":
        return all(n == 1 or np.allclose(span, edge, atol=1e-6 * size) for n, span, edge in zip(place.x_gc.shape, spans, cell))
    heights = np.linalg.det(cell) / np.array([np.linalg.norm(np.cross(cell[(k + 1) % 3], cell[(k + 2) % 3])) for k in range(3)])
    return bool(np.isclose(np.linalg.norm(spans[0]), np.abs(heights), atol=1e-6 * size).any())


# --------------------------------------------------------------------------------------------------------------------
# Files.


def save(fig, path) -> Path:
    """Write a figure (.png, .pdf, .svg) atomically."""
    import os

    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("png", "pdf", "svg"):
        raise AtcError(f"{path}: a picture's name must end in .png, .pdf or .svg")
    if not path.parent.is_dir():
        raise AtcError(f"{path}: there is no directory {path.parent}")
    part = path.with_name(f".{path.name}.partial")
    # dates and software versions in the file would make equal pictures differ
    meta = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
        "svg": {"Date": None, "Creator": None},
    }[kind]
    import matplotlib as mpl

    try:
        with mpl.rc_context(_STYLE):
            fig.savefig(part, format=kind, metadata=meta)
        os.replace(part, path)
    except OSError as e:
        raise AtcError(f"{path}: cannot be written: {e.strerror or e}") from None
    finally:
        part.unlink(missing_ok=True)
    return path


def plot_file(path, quantity=None, *, output=None, overlay=None, frame=-1, **options) -> Path:
    """`plot` of an output file into a picture next to it (or `output`); returns the picture's path.

    `overlay`: a scene whose trajectory's atoms are drawn on the map, at the frame shown.
    """
    path = Path(path)
    ds = load(path)
    atoms = None
    if overlay is not None:
        atoms = _atoms(overlay, ds, frame)
    fig = plot(ds, quantity, frame=frame, atoms=atoms, **options)
    if output is None:
        words = [path.stem, quantity or _pick(ds, None), options.get("component")]
        output = path.with_name("-".join(w.replace(",", "-") for w in words if w) + ".png")
    return save(fig, output)


def _atoms(scene, ds, frame):
    """Positions, in the cell, in the dataset's length unit, of the atoms of the frame that is drawn."""
    from .scene import Scene

    trajectory = Scene.load(scene).trajectory()
    k = 0 if frame == "mean" else int(frame)
    one = trajectory[k]
    return one.units.to_user("length", one.cell.wrap(one.positions)[0])


def compare_figure(result):
    """The picture of a `Comparison`: profiles of both stresses and their difference, or the trend over several results."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(_STYLE):
        if "radius" in result.data.dims or "output" in result.data.dims:
            return _trend(Figure, result)
        return _against(Figure, result)


def _trend(Figure, result):
    dim = "radius" if "radius" in result.data.dims else "output"
    fig, axs = _figure(Figure, 1, 5.2, 3.4)
    ax = axs[0, 0]
    x = result.data[dim].values
    at = x if dim == "radius" else np.arange(len(x))
    styles = {"rms": ("-", "o"), "max": ("--", "s")}
    for k, c in enumerate(("hydrostatic", "vonmises")):
        for how, (line, marker) in styles.items():
            name = f"relative_{how}_{c}"
            if name in result.data:
                ax.plot(at, 100 * result.data[name].values, line, marker=marker, ms=4, color=f"C{k}", label=f"{_SYMBOL[c]}, {how}")
    if dim == "radius":
        ax.set_xlabel("kernel radius")
        ax.set_xlim(0, at.max() * 1.05)
    else:
        ax.set_xticks(at, [str(v).split(",")[0] for v in x], rotation=20, ha="right")
    ax.set_ylabel("Hardy - smoothed virial\n(% of the largest component)")
    ax.set_ylim(bottom=0)
    ax.legend()
    ax.spines[["top", "right"]].set_visible(False)
    ax.set_title(result.title or "Hardy and virial stress")
    return fig


def _against(Figure, result):
    """Left to right: box averages, then for each axis the profiles of Hardy (lines) and smoothed virial (dashed)."""
    data = result.data
    axes = [n.removeprefix("profile_").removesuffix("_hardy") for n in data.data_vars if n.endswith("_hardy")]
    boxes = [r for r in result.rows if r["section"] == "box average"] or [r for r in result.rows if r["section"].startswith("box average")]
    columns = (1 if boxes else 0) + len(axes)
    if columns == 0:
        columns = 1
    fig, axs = _figure(Figure, columns, 4.0, 3.2, columns=4 if columns > 3 else columns)
    axs = list(axs.flat)
    units = f" ({unit_text(result.units)})" if unit_text(result.units) else ""
    if boxes:
        ax = axs.pop(0)
        at = np.arange(len(boxes))
        ax.bar(at - 0.2, [r["hardy"] for r in boxes], 0.4, label="Hardy", color="C0")
        ax.bar(
            at + 0.2,
            [r["virial"] for r in boxes],
            0.4,
            label="virial",
            color="C1",
            yerr=[r.get("stderr_virial") or 0 for r in boxes] if any(r.get("stderr_virial") for r in boxes) else None,
        )
        ax.set_xticks(
            at, [{"hydrostatic": "hydr.", "vonmises": "v. Mises"}.get(r["name"], r["name"]) for r in boxes], rotation=45, ha="right"
        )
        ax.axhline(0, color="0.4", lw=0.6)
        ax.set_ylabel(f"box average{units}")
        ax.legend()
    for dim in axes:
        ax = axs.pop(0)
        x = data[f"profile_{dim}_position"]
        for k, c in enumerate(("hydrostatic", "vonmises", "xx", "yy", "zz")):
            h, v = (component(data[f"profile_{dim}_{w}"].values, c) for w in ("hardy", "virial"))
            ax.plot(x.values, h, color=f"C{k}", label=_SYMBOL.get(c, c))
            ax.plot(x.values, v, color=f"C{k}", ls=(0, (3, 2)), lw=1.0)
        ax.plot([], [], color="0.3", label="Hardy")
        ax.plot([], [], color="0.3", ls=(0, (3, 2)), lw=1.0, label="smoothed virial")
        ax.set_xlabel(x.attrs.get("label", dim))
        ax.set_ylabel(f"stress, mean over the other axes{units}" if len(axes) > 1 or "volume" else f"stress{units}")
        ax.legend(ncols=2, fontsize=7)
    if not boxes and not axes and "difference" in data:
        ax = axs.pop(0)
        d = component(data["difference"].values, "hydrostatic").ravel()
        ax.hist(d[np.isfinite(d)], bins=60, color="C0")
        ax.set_xlabel(f"Hardy - smoothed virial, hydrostatic{units}")
        ax.set_ylabel("points")
    for ax in fig.axes:
        ax.spines[["top", "right"]].set_visible(False)
    for ax in axs:
        ax.remove()
    fig.suptitle(result.title, fontsize=9)
    return fig
