"""What every picture shares: style, colours, labels, one map with its bar, files written whole or not at all."""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..running.whole import replacing
from ..units.words import converted, wanted_units
from .geometry import unit_text
from .symbols import label

# what cannot be negative
_POSITIVE = {"number_density", "density", "temperature", "vonmises", "max_shear", "magnitude"}
_MAPS = {"temperature": "inferno", "vonmises": "magma", "max_shear": "magma"}
STYLE = {
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


def at_frame(ds, name, frame):
    """The field at one frame (or averaged), and what to call that."""
    da = ds[name]
    if "frame" not in da.dims:
        return da, ""
    n = da.sizes["frame"]
    if frame == "mean" and n > 1:
        return da.mean("frame", skipna=True, keep_attrs=True), f"mean of {n} frames"
    try:
        k = require_frame(ds, 0 if frame == "mean" else int(frame))
    except ValueError:
        raise AtcError(f"frame {frame!r}: expected a number counted from 0 (-1 is the last), mean or all") from None
    return da.isel(frame=k), _frame_text(ds, k)


def require_frame(ds, k: int) -> int:
    """The number of an entry of an output, counted from its end if negative; AtcError if there is none."""
    n = ds.sizes.get("frame", 1)
    if not -n <= k < n:
        raise AtcError(f"frame {k}: the output has {n} frame{'s' * (n != 1)}, numbered 0 to {n - 1}")
    return k


def _frame_text(ds, k) -> str:
    one = ds.isel(frame=k)
    if "frames_averaged" in ds:
        n = int(one.frames_averaged)
        return f"average of {n} frame{'s' * (n != 1)}"
    text = f"frame {int(one.frame)}" if "frame" in one.coords else f"frame {k}"
    if "time" in one.coords and np.isfinite(float(one.time)):
        text += f", t = {float(one.time):.4g} {unit_text(one.time.attrs.get('units', ''))}".rstrip()
    elif "step" in one.coords and int(one.step) >= 0:
        text += f", step {int(one.step)}"
    return text


def label_of(da, comp) -> str:
    """Name, component and unit of a variable, for an axis."""
    axes = tuple(str(v) for v in da.coords["i"].values) if "i" in da.coords and "i" in da.dims else ()
    return label(str(da.name), comp, unit_text(da.attrs.get("units", "")), () if axes == ("x", "y", "z") else axes)


def kernel_title(ds, unit=unit_text) -> str:
    """Kernel and radius: without them a Hardy field means little."""
    kernel, radius = ds.attrs.get("kernel"), ds.attrs.get("radius")
    if not kernel:
        return ""
    text = f"{str(kernel).partition(',')[0]} kernel"
    if isinstance(radius, (int, float, np.number)):
        factor, have = 1.0, str(ds.attrs.get("radius_units", ""))
        if "output_units" in ds.attrs:
            factor, have = converted(have, wanted_units(ds.attrs["output_units"]))
        text += f", R = {factor * float(radius):.4g} {unit(have)}".rstrip()
    return text


#: Beyond so many times what 98 of 100 points have, extremes are singular (corners, crack tips): they would take all
#: colours for themselves.
SINGULAR = 1.6


def singular(values) -> bool:
    """Whether a few points are far beyond all others."""
    size = np.abs(values[np.isfinite(values)])
    if size.size < 100:
        return False
    usual = np.percentile(size, 98)
    return bool(size.max() > SINGULAR * usual > 0)


def colours(name, comp, values, limits, robust, floor=0.0):
    """Colour map and limits for one panel; a signed map never reaches less far than `floor`, so that rounding does not
    look like a field. robust : limits at the 2nd and 98th percentile; None: where a few points are singular"""
    import matplotlib as mpl

    finite = values[np.isfinite(values)]
    robust = singular(values) if robust is None else robust
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


def wrapped(fig, text: str, size: float) -> str:
    """A text broken into lines that fit into a figure; what holds a value, ``t = 0.8 ps``, stays together."""
    kept = ", ".join(part.replace(" ", "\xa0") if " = " in part else part for part in text.split(", "))
    return textwrap.fill(kept, max(20, int(fig.get_size_inches()[0] * 72 / (0.56 * size)))).replace("\xa0", " ")


def figure(n, width, height, columns=3):
    """A figure, drawn without a display, with axes for n panels, and a list of these axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    columns = min(n, 2 if n in (2, 4) and columns > 1 else columns)
    rows = -(-n // columns)
    fig = Figure(figsize=(width * columns, height * rows + 0.3), layout="constrained")
    FigureCanvasAgg(fig)
    axes = list(fig.subplots(rows, columns, squeeze=False).flat)
    for ax in axes[n:]:
        ax.remove()
    return fig, axes[:n]


def draw_map(fig, ax, place, drawn_as, v, cmap, low, high, extend, title):
    """One map with its colour bar, at true positions and equal aspect."""
    flat, labels, _, _ = drawn_as
    lo, hi = flat.reshape(-1, 2).min(0), flat.reshape(-1, 2).max(0)
    wide = hi[1] - lo[1] < 0.45 * (hi[0] - lo[0])
    if place.kind == "plane":
        how = {"cmap": cmap, "vmin": low, "vmax": high, "rasterized": True, "shading": "flat"}
        drawn = ax.pcolormesh(flat[..., 0], flat[..., 1], np.ma.masked_invalid(v), **how)
        ax.set(xlim=(lo[0], hi[0]), ylim=(lo[1], hi[1]))
    else:
        good = np.isfinite(v)
        order = np.argsort(np.where(good, np.abs(v), -1), kind="stable")  # the largest on top
        order = order[good[order]]
        size = float(np.clip(1.5e4 / max(len(v), 1), 2, 40))
        ax.scatter(*flat[~good].T, s=size, c="0.82", linewidths=0)
        drawn = ax.scatter(*flat[order].T, s=size, c=v[order], cmap=cmap, vmin=low, vmax=high, rasterized=len(v) > 5000)
        drawn.set(edgecolor="0.3", linewidth=0.2)
        ax.margins(0.03)
    ax.set(aspect="equal", xlabel=labels[0], ylabel=labels[1], title=title)
    # as high as the map, whose height follows from its aspect
    where = {"ax": ax, "location": "bottom", "shrink": 0.8, "aspect": 40} if wide else {
        "cax": ax.inset_axes([1.03, 0.0, 0.045, 1.0])}  # fmt: skip
    bar = fig.colorbar(drawn, extend=extend, **where)
    bar.outline.set_linewidth(0.6)
    return drawn


def titled(fig, text: str, size: float = 9) -> None:
    """A title over everything, in as many lines as it takes, with room for them."""
    lines = wrapped(fig, text, size)
    fig.suptitle(lines, fontsize=size)
    width, height = fig.get_size_inches()
    fig.set_size_inches(width, height + 1.35 * size / 72 * lines.count("\n"))


def fitted(fig):
    """The figure, large enough for all that is drawn: maps of equal aspect leave labels too little room otherwise."""
    for _ in range(3):
        fig.draw_without_rendering()
        box, size = fig.get_tightbbox(), fig.get_size_inches()
        over = np.maximum(-box.min, 0.0) + np.maximum(box.max - size, 0.0)
        if over.max() < 0.02:
            break
        fig.set_size_inches(*(size + over + 0.02))
    return fig


def picture_kind(path) -> str:
    """Of a picture that can be written there, the suffix; an `AtcError` if none can."""
    path = Path(path)
    kind = path.suffix.lower().lstrip(".")
    if kind not in ("png", "pdf", "svg"):
        raise AtcError(f"{path}: a picture's name must end in .png, .pdf or .svg")
    if not path.parent.is_dir():
        raise AtcError(f"{path}: there is no directory {path.parent}")
    return kind


def save(fig, path) -> Path:
    """Write a figure (.png, .pdf, .svg) atomically."""
    path, kind = Path(path), picture_kind(path)
    # dates and software versions in the file would make equal pictures differ
    meta = {
        "png": {"Software": None},
        "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
        "svg": {"Date": None, "Creator": None},
    }[kind]
    import matplotlib as mpl

    with replacing(path) as part, mpl.rc_context(STYLE):
        fitted(fig).savefig(part, format=kind, metadata=meta)
    return path
