"""Pictures of peridynamic bodies: every node a square of its size, where it is now, seen along the axis in which the
body is thinnest."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .components import component as scalar
from .drawing import STYLE, at_frame, colours, figure, label_of, titled
from .geometry import rank, with_unit


def plot_nodes(ds, quantity=None, *, component=None, slice=None, axis=None, frame=-1, limits=None, robust=None,
               one_scale=False):  # fmt: skip
    """Draw quantities of the nodes, one panel each (or one a component).

    Parameters
    ----------
    ds : output of ``atc pd``
    quantity : damage (default), displacement, velocity, energy, force, stress; several separated by commas
    component : as for fields; default the magnitude of vectors and the von Mises stress
    slice : ``"z=0.5"`` (fraction of the body's extent) or ``"z=0.001m"``: only the layer of nodes there, seen along
        that axis
    axis : the axis along which one looks, from its positive end; default the thinnest
    frame : number of the output, -1 the last
    one_scale : the same limits whichever it is

    Returns
    -------
    matplotlib.figure.Figure
    """
    import matplotlib as mpl

    names = [n for n, da in ds.data_vars.items() if "node" in da.dims]
    wanted = [q.strip() for q in quantity.split(",")] if quantity else ["damage" if "damage" in names else names[0]]
    X = np.stack([ds[f"position_{a}"].values for a in "xyz"], axis=1)
    unit = ds["position_x"].attrs.get("units", "")
    spacing = float(ds.attrs["spacing"])
    which, view = _layer(X, slice, axis, spacing)
    panels = []
    for q in wanted:
        if q not in names:
            raise AtcError(f"{q} is not in this output: it holds {', '.join(names)}")
        da, when = at_frame(ds, q, frame)
        order = rank(da)
        comps = [[None], ["magnitude"], ["vonmises"]][order]
        if component and order:
            comps = [c.strip() for c in component.split(",")]
        for c in comps:
            values = scalar(da.values[which], c)
            scaled = scalar(ds[q].isel(node=which).values, c) if one_scale else values
            panels.append((da, c, values, scaled))
    x = X[which]
    if "displacement" in ds:
        x = x + ds["displacement"].isel(frame=0 if frame == "mean" else int(frame)).values[which]
    across = [k for k in range(3) if k != view]
    # Seen from the positive end of the axis: what is nearer is drawn last.
    nearer = np.argsort(x[:, view], kind="stable")
    lo, hi = X[which][:, across].min(0), X[which][:, across].max(0)
    pad = 0.08 * (hi - lo).max() + spacing
    span = hi - lo + 2 * pad
    width = 5.2 if len(panels) == 1 else 4.0
    with mpl.rc_context(STYLE):
        fig, axes = figure(len(panels), width, max(1.3, (width - 1.3) * min(span[1] / span[0], 2.5)) + 0.7)
        for ax, (da, c, values, scaled) in zip(axes, panels):
            cmap, low, high, extend = colours(da.name, c, scaled, limits, robust)
            if da.name == "damage" and limits is None:
                cmap, low, high = mpl.colormaps["inferno_r"], 0.0, max(1e-12, float(scaled.max(initial=0.0)))
                extend = "neither"
            ax.set(xlim=(lo[0] - pad, hi[0] + pad), ylim=(lo[1] - pad, hi[1] + pad), aspect="equal")
            ax.set_facecolor("0.96")
            art = _squares(ax, x[nearer][:, across], values[nearer], spacing, cmap, low, high)
            said = label_of(da, c)
            fig.colorbar(art, cax=ax.inset_axes([1.03, 0.0, 0.045, 1.0]), extend=extend, label=said)
            ax.set(**{axis: with_unit("xyz"[k], unit) for axis, k in zip(("xlabel", "ylabel"), across)})
        titled(fig, ", ".join(t for t in (str(ds.attrs.get("materials", "")).upper(), when) if t))
    return fig


def _squares(ax, x, values, size, cmap, low, high):
    from matplotlib.collections import PolyCollection

    h = 0.5 * size
    corners = np.array([[-h, -h], [h, -h], [h, h], [-h, h]])
    how = {"cmap": cmap, "edgecolors": "face", "linewidths": 0.1, "rasterized": True}
    squares = PolyCollection(x[:, None] + corners, array=np.asarray(values, float), **how)
    squares.set_clim(low, high)
    ax.add_collection(squares)
    return squares


def _layer(X, where, axis, spacing):
    """Which nodes are drawn, and the axis along which one looks."""
    extent = np.ptp(X, axis=0)
    view = int(np.argmin(extent + 1e-9 * extent.max() * np.array([2, 1, 0])))
    if axis is not None:
        if axis not in ("x", "y", "z"):
            raise AtcError(f"--axis {axis}: expected x, y or z, the axis along which the body is seen")
        view = "xyz".index(axis)
    if where is None:
        return np.arange(len(X)), view
    name, eq, text = where.partition("=")
    try:
        k = "xyz".index(name.strip())
        text = text.strip()
        number = text.rstrip("abcdefghijklmnopqrstuvwxyzA")
        value = float(number)
        if number == text:
            value = X[:, k].min() + value * extent[k]
    except ValueError:
        raise AtcError(
            f"--slice {where}: expected AXIS=FRACTION or AXIS=LENGTH with a unit, e.g. z=0.5 or z=0.001m"
        ) from None
    near = np.abs(X[:, k] - value)
    return np.flatnonzero(near <= near.min() + 0.5 * spacing), k
