"""Pictures of fields: slices and planes as maps, slabs and lines as profiles, points and atoms as scatter plots.

Everything is drawn in the units of the dataset and at its true positions (triclinic grids too). Signed components get a diverging map
that is symmetric about zero, quantities that cannot be negative a sequential one; where a field is undefined (vacuum) the map is grey.
"""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from .errors import AtcError
from .layout import cut, grid_dims, layout, placed, rank, unit_text

STDERR = "_stderr"
TENSOR = ["xx", "yy", "zz", "xy", "xz", "yz", "yx", "zx", "zy"]
TENSOR_SCALARS = ["hydrostatic", "pressure", "vonmises", "max_shear", "principal1", "principal2", "principal3"]
VECTOR = ["x", "y", "z", "magnitude"]

# what cannot be negative
_POSITIVE = {"number_density", "density", "temperature", "vonmises", "max_shear", "magnitude"}
_MAPS = {"temperature": "inferno", "vonmises": "magma", "max_shear": "magma"}
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


def fields_of(ds) -> list[str]:
    """The variables of a dataset that are fields on its grid (standard errors and the like left out)."""
    return [n for n, da in ds.data_vars.items() if grid_dims(da) and da.dtype.kind == "f" and not n.endswith(STDERR) and placed(ds, da)]


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
            if quantity in ds and not grid_dims(ds[quantity])
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
    order = rank(da)
    if order == 0:
        if wanted not in (None, "all"):
            raise AtcError(f"{da.name} is a scalar: it has no component {wanted!r}")
        return [None]
    if wanted in (None, "all"):
        if order == 1:
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
        name += f"$_{{{comp}}}$" if comp in TENSOR or comp in ("x", "y", "z") else f", {_SYMBOL[comp]}"
    units = unit_text(units)
    return f"{name} ({units})" if units else name


def _colours(name, comp, values, limits, robust, floor=0.0):
    """Colour map and limits for one panel; a signed map never reaches less far than `floor`, so that rounding does not look like a field."""
    import matplotlib as mpl

    finite = values[np.isfinite(values)]
    positive = comp in _POSITIVE or (comp is None and name in _POSITIVE)
    if positive or (comp is None and finite.size and finite.min() >= 0):
        cmap = _MAPS.get(comp or name, "viridis")
        lo, hi = 0.0, 1.0
        if finite.size:
            lo, hi = np.percentile(finite, [2, 98]) if robust else (finite.min(), finite.max())
    else:
        cmap = "RdBu_r"
        top = 1.0
        if finite.size:
            top = max(np.percentile(np.abs(finite), 98) if robust else np.abs(finite).max(), floor)
        lo, hi = -top, top
    if limits is not None:
        lo, hi = limits
    if not hi - lo > 1e-12 * abs(hi):  # a constant field
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
    if ds.attrs.get("kind") == "peridynamics":
        from .node_pictures import plot_nodes

        return plot_nodes(ds, quantity, component=component, slice=slice, axis=axis, frame=frame, limits=limits, robust=robust)
    panels = []
    wanted = [q.strip() for q in quantity.split(",")] if quantity else [None]
    for q in wanted:
        name = _pick(ds, q)
        da, when = _at_frame(ds, name, frame)
        da = da.transpose(*grid_dims(da), ...)
        comps = _scalars(da, component if rank(da) or len(wanted) == 1 else None)
        if len(wanted) > 1 and component is None and rank(da):
            comps = ["magnitude" if rank(da) == 1 else "vonmises"]
        panels += [(name, da, c) for c in comps]
    dims = {tuple(grid_dims(da)) for _, da, _ in panels}
    if len(dims) > 1:
        raise AtcError("fields on different grids cannot share a picture: plot them one by one")
    place = layout(ds, panels[0][1])
    if place.kind == "volume":
        place, selection, where = cut(place, slice, axis, index)
    else:
        if slice is not None or axis is not None or index is not None:
            raise AtcError(f"this output is on a {place.kind}, not on a 3-D grid: there is nothing to slice")
        selection, where = {}, ""
    title = ", ".join(t for t in (kernel_title(ds), where, when) if t)
    with mpl.rc_context(_STYLE):
        if place.kind in ("line", "slab"):
            return _profiles(Figure, ds, panels, place, title, limits, frame)
        values = []
        for _, da, c in panels:
            v = da.isel(selection).values
            values.append(v if c is None else globals()["component"](v, c))
        return _maps(Figure, panels, values, place, title, limits, robust, atoms)


def kernel_title(ds, unit=unit_text) -> str:
    """Kernel and radius: without them a Hardy field means little."""
    kernel, radius = ds.attrs.get("kernel"), ds.attrs.get("radius")
    if not kernel:
        return ""
    text = f"{str(kernel).partition(',')[0]} kernel"
    if isinstance(radius, (int, float, np.number)):
        text += f", R = {float(radius):.4g} {unit(ds.attrs.get('radius_units', ''))}".rstrip()
    return text


def _figure(Figure, n, width, height, columns=3):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    columns = min(n, 2 if n in (2, 4) and columns > 1 else columns)
    rows = -(-n // columns)
    fig = Figure(figsize=(width * columns, height * rows + 0.3), layout="constrained")
    FigureCanvasAgg(fig)
    return fig, fig.subplots(rows, columns, squeeze=False)


def _map(fig, ax, place, drawn_as, v, cmap, low, high, extend, title):
    """One map with its colour bar, at true positions and equal aspect."""
    flat, labels, _, _ = drawn_as
    lo, hi = flat.reshape(-1, 2).min(0), flat.reshape(-1, 2).max(0)
    wide = hi[1] - lo[1] < 0.45 * (hi[0] - lo[0])
    if place.kind == "plane":
        drawn = ax.pcolormesh(
            flat[..., 0], flat[..., 1], np.ma.masked_invalid(v), cmap=cmap, vmin=low, vmax=high, rasterized=True, shading="flat"
        )
        ax.set_xlim(lo[0], hi[0])
        ax.set_ylim(lo[1], hi[1])
    else:
        good = np.isfinite(v)
        order = np.argsort(np.where(good, np.abs(v), -1), kind="stable")  # the largest on top
        order = order[good[order]]
        size = float(np.clip(1.5e4 / max(len(v), 1), 2, 40))
        ax.scatter(*flat[~good].T, s=size, c="0.82", linewidths=0)
        drawn = ax.scatter(*flat[order].T, s=size, c=v[order], cmap=cmap, vmin=low, vmax=high, rasterized=len(v) > 5000)
        drawn.set(edgecolor="0.3", linewidth=0.2)
        ax.margins(0.03)
    ax.set_aspect("equal")
    ax.set_xlabel(labels[0])
    ax.set_ylabel(labels[1])
    ax.set_title(title)
    where = {"location": "bottom", "shrink": 0.8, "aspect": 40} if wide else {"fraction": 0.046, "pad": 0.02}
    bar = fig.colorbar(drawn, ax=ax, extend=extend, **where)
    bar.outline.set_linewidth(0.6)
    return drawn


def _panel_size(flat, panels):
    """Width and height of one panel, and how many go side by side."""
    span = np.maximum(np.ptp(flat.reshape(-1, 2), axis=0), 1e-12)
    aspect = float(np.clip(span[1] / span[0], 0.1, 2.5))
    if aspect < 0.45:
        width = 6.0
        return width, 0.88 * width * aspect + 1.25, 1
    width = 4.6 if panels == 1 else 3.3
    return width, (width - 1.15) * aspect + 0.75, 3


def _maps(Figure, panels, values, place, title, limits, robust, atoms):
    drawn_as = place.flat()
    flat, _, basis, origin = drawn_as
    width, height, columns = _panel_size(flat, len(panels))
    fig, axs = _figure(Figure, len(panels), width, height, columns)
    largest: dict[str, float] = {}
    for (name, _, _), v in zip(panels, values):
        largest[name] = max(largest.get(name, 0.0), float(np.nanmax(np.abs(v), initial=0.0)))
    for ax, (name, da, comp), v in zip(axs.flat, panels, values):
        colours = _colours(name, comp, v, limits, robust, 1e-3 * largest[name])
        _map(fig, ax, place, drawn_as, v, *colours, _label(da, comp, da.attrs.get("units", "")))
        if atoms is not None and len(atoms):
            near = np.abs((atoms - origin) @ basis[2]) <= place.thickness
            size = float(np.clip(3e3 / max(near.sum(), 1), 1.5, 16))
            ax.scatter(*(atoms[near] @ basis[:2].T).T, s=size, facecolors="w", edgecolors="k", linewidths=0.4, alpha=0.8)
    for ax in list(axs.flat)[len(panels) :]:
        ax.remove()
    fig.suptitle(title, fontsize=9)
    return fig


def _profiles(Figure, ds, panels, place, title, limits, frame):
    """Curves along the one dimension, one panel a field, with the standard error as a band where the output has one."""
    groups: dict[str, list] = {}
    for name, da, comp in panels:
        groups.setdefault(name, []).append((da, comp))
    fig, axs = _figure(Figure, len(groups), 5.0, 3.1)
    s, label = place.abscissa()
    for ax, (name, members) in zip(axs.flat, groups.items()):
        error = _stderr(ds, name, frame)
        for da, comp in members:
            v = da.values if comp is None else component(da.values, comp)
            (line,) = ax.plot(s, v, label=comp, marker="o" if len(s) == 1 else None)
            # the error of an invariant is not the invariant of the errors
            if error is not None and (comp is None or comp in TENSOR or comp in ("x", "y", "z")):
                e = error.transpose(*da.dims).values
                e = e if comp is None else component(e, comp)
                ax.fill_between(s, v - e, v + e, color=line.get_color(), alpha=0.25, linewidth=0)
        ax.set_xlabel(label)
        ax.set_ylabel(_label(members[0][0], None if len(members) > 1 else members[0][1], members[0][0].attrs.get("units", "")))
        if len(s) > 1:
            ax.set_xlim(s[0], s[-1])
        if limits is not None:
            ax.set_ylim(*limits)
        lo, hi = ax.get_ylim()
        if lo < 0 < hi:
            ax.axhline(0, color="0.6", lw=0.6, zorder=0)
        if len(members) > 1:
            ax.legend(ncols=1 if len(members) < 4 else 2)
        ax.spines[["top", "right"]].set_visible(False)
    for ax in list(axs.flat)[len(groups) :]:
        ax.remove()
    fig.suptitle(title, fontsize=9)
    return fig


def _stderr(ds, name, frame):
    """The standard error that belongs to the entry drawn; None for a mean over several entries, whose error is not theirs."""
    if name + STDERR not in ds:
        return None
    error = ds[name + STDERR]
    if "frame" not in error.dims:
        return error
    if frame == "mean":
        return error.isel(frame=0) if error.sizes["frame"] == 1 else None
    return error.isel(frame=int(frame))


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
        nodes = ds.attrs.get("kind") == "peridynamics"
        words = [path.stem, quantity or ("damage" if nodes else _pick(ds, None)), options.get("component")]
        output = path.with_name("-".join(w.replace(",", "-") for w in words if w) + ".png")
    return save(fig, output)


def _atoms(scene, ds, frame):
    """Positions, in the cell, in the dataset's length unit, of the atoms of the frame that is drawn."""
    from .scene import Scene

    trajectory = Scene.load(scene).trajectory()
    k = int(ds["frame"].values[0 if frame == "mean" else int(frame)])
    if k >= len(trajectory):
        raise AtcError(f"--overlay {scene}: the picture shows frame {k} of the run, the scene selects only {len(trajectory)} frames")
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
        ax.set_xlabel(f"kernel radius ({unit_text(result.attrs['radius_units'])})" if result.attrs.get("radius_units") else "kernel radius")
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
    """Box averages, for each axis the profiles of Hardy (full lines) and smoothed virial (dashed), and maps of the difference."""
    data, place = result.data, result.place
    axes = [n.removeprefix("profile_").removesuffix("_hardy") for n in data.data_vars if n.endswith("_hardy")]
    boxes = [r for r in result.rows if r["section"] == "box average"] or [r for r in result.rows if r["section"].startswith("box average")]
    maps, where = [], ""
    if "difference" in data and place.kind != "slab" and place.kind != "line":
        d = data["difference"]
        if place.kind == "volume":
            place, selection, where = cut(place)
            d = d.isel(selection)
        maps = [c for c in ("hydrostatic", "vonmises") if np.isfinite(component(d.values, c)).any()]
    panels = bool(boxes) + len(axes) + len(maps)
    if not panels:
        raise AtcError("there is nothing to draw: neither box averages nor pointwise differences could be compared")
    fig, axs = _figure(Figure, panels, 3.9, 3.1)
    axs = list(axs.flat)
    units = f" ({unit_text(result.units)})" if unit_text(result.units) else ""
    if boxes:
        ax = axs.pop(0)
        at = np.arange(len(boxes))
        errors = [r.get("stderr_virial") or 0 for r in boxes]
        ax.bar(at - 0.2, [r["hardy"] for r in boxes], 0.4, label="Hardy", color="C0")
        ax.bar(at + 0.2, [r["virial"] for r in boxes], 0.4, label="virial", color="C1", yerr=errors if any(errors) else None)
        ax.set_xticks(at, [{"hydrostatic": "mean", "vonmises": "Mises"}.get(r["name"], r["name"]) for r in boxes])
        ax.axhline(0, color="0.4", lw=0.6)
        ax.set_title(f"average over the box{units}")
        ax.legend()
    for k, dim in enumerate(axes):
        ax = axs.pop(0)
        x = data[f"profile_{dim}_position"]
        for c, colour in zip(("hydrostatic", "xx", "yy", "zz", "vonmises"), ("k", "C0", "C1", "C2", "C3")):
            h, v = (component(data[f"profile_{dim}_{w}"].values, c) for w in ("hardy", "virial"))
            ax.plot(x.values, h, color=colour, label=_SYMBOL.get(c, c))
            ax.plot(x.values, v, color=colour, ls=(0, (3, 2)), lw=1.0)
        ax.set_xlabel(x.attrs.get("label", dim))
        ax.set_title(
            (f"mean over the other axes{units}" if len(axes) > 1 else f"profile{units}")
            + ("\nfull: Hardy, dashed: smoothed virial" if k == 0 else "")
        )
        ax.set_xlim(x.values.min(), x.values.max())
        lines = ax.get_legend_handles_labels()
    for ax in fig.axes:
        ax.spines[["top", "right"]].set_visible(False)
    for c in maps:
        h = component(d.values, c)
        top = float(np.nanmax(np.abs(h))) or 1.0
        sign = _colours("", c, h, None if c == "vonmises" else (-top, top), False)
        _map(
            fig,
            axs.pop(0),
            place,
            place.flat(),
            h,
            *sign,
            f"{_SYMBOL[c]} of Hardy - smoothed virial{units}" + (f"\n{where}" if where else ""),
        )
    for ax in axs:
        ax.remove()
    if axes:
        fig.legend(*lines, loc="outside lower center", ncols=5)
    fig.suptitle(result.title, fontsize=9)
    return fig
