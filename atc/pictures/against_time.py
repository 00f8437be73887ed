"""Profiles against time: a map of position and time for each component (an x–t diagram)."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .components import component as one_of
from .drawing import STYLE, colours, figure, kernel_title, label_of, titled
from .geometry import grid_dims, points_of_grid, rank, with_unit


def time_figure(ds, panels, limits=None, robust=None, dimension=3, mean=None):
    """A map for each panel: position to the right, time upwards.

    panels : [(name, xarray.DataArray with dims (frame, one of the grid, …), component or None)]
    mean : the axes that means have been taken over, for the title

    Raises
    ------
    AtcError for maps and volumes, and for outputs of one entry
    """
    import matplotlib as mpl

    dims = grid_dims(panels[0][1])
    if len(dims) != 1 or dims[0] in ("point", "atom"):
        raise AtcError(
            f"frame all: profiles are drawn against time, but {panels[0][0]} is along {', '.join(dims)}: take means "
            "over the other axes (--mean x,y), or one frame"
        )
    if ds.sizes.get("frame", 1) < 2:
        raise AtcError("frame all: the output has one frame only (an average?): leave --frame out")
    time, label, upwards = _times(ds)
    place = points_of_grid(ds, panels[0][1].isel(frame=0))
    x, along = place.abscissa()
    moving = ds.coords.get(f"position_{dims[0]}")
    if moving is not None and moving.dims == ("frame", dims[0]):
        x = moving.values
    edges = _edges(np.broadcast_to(x, (len(time), place.x_gc.shape[0]))), _edges(time[None])[0]
    # A row of edges between every two frames.
    right = np.concatenate([edges[0][:1], 0.5 * (edges[0][1:] + edges[0][:-1]), edges[0][-1:]])
    upward = np.broadcast_to(edges[1][:, None], right.shape)
    with mpl.rc_context(STYLE):
        fig, axs = figure(len(panels), 4.4 if len(panels) == 1 else 3.4, 3.4 if len(panels) == 1 else 2.9)
        for ax, (name, da, comp) in zip(axs, panels):
            v = one_of(da.values, comp, dimension, rank=rank(da))
            cmap, low, high, extend = colours(name, comp, v, limits, robust)
            drawn = ax.pcolormesh(
                right, upward, np.ma.masked_invalid(v), cmap=cmap, vmin=low, vmax=high, shading="flat", rasterized=True
            )
            ax.set(xlim=(right.min(), right.max()), ylim=(upward.min(), upward.max()), xlabel=along, ylabel=label)
            ax.set_title(label_of(da, comp))
            fig.colorbar(drawn, ax=ax, extend=extend, pad=0.02).outline.set_linewidth(0.6)
        names = ", ".join(dict.fromkeys(str(da.attrs.get("long_name", name)) for name, da, _ in panels))
        over = "" if mean is None else f"mean over {mean}"
        title = ", ".join(t for t in (names[:1].upper() + names[1:], kernel_title(ds), over, upwards) if t)
        titled(fig, title)
    return fig


def _times(ds):
    """Times of the entries, else their steps, else their numbers; a label; and what is against what, in words."""
    windows = "averages" if "frames_averaged" in ds else "frames"
    text = f"{ds.sizes['frame']} {windows}"
    for name, label in (("time", "t"), ("step", "step"), ("frame", "frame")):
        if name not in ds.coords:
            continue
        t = np.asarray(ds.coords[name].values, dtype=float)
        known = np.isfinite(t).all() and not (name == "step" and (t < 0).any())
        if known and (np.diff(t) > 0).all():
            return t, with_unit(label, ds.coords[name].attrs.get("units")), text
    return np.arange(ds.sizes["frame"], dtype=float), "frame", text


def _edges(x_tz):
    """(t, z + 1) the middles between points, and as far beyond the first and the last."""
    if x_tz.shape[1] < 2:
        return np.concatenate([x_tz - 0.5, x_tz + 0.5], axis=1)
    middle = 0.5 * (x_tz[:, 1:] + x_tz[:, :-1])
    return np.concatenate([2 * x_tz[:, :1] - middle[:, :1], middle, 2 * x_tz[:, -1:] - middle[:, -1:]], axis=1)
