"""Pictures of a run and its twin: MD, PD and their difference, of the means over the frames or frame by frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import AtcError


def picture(data, path, components, title):
    """MD, PD and their difference as maps of time averages, one row for each component (field, index, label)."""
    import matplotlib as mpl

    from ..pictures.drawing import STYLE, save

    with mpl.rc_context(STYLE):
        return save(drawn(data, components, title), path)


def movie(data, path, components, title, rate: float = 5.0) -> Path:
    """The same frame by frame as a movie (.gif, .mp4), `rate` frames a second, with the same colours in all of them."""
    from ..pictures.movies import write_movie

    limits = [_largest(data, name, index) for name, index, _ in components]
    figures = (
        drawn(data.isel(frame=[k]), components, f"{title}, frame {k + 1}", limits) for k in range(data.sizes["frame"])
    )
    return write_movie(path, figures, rate)


def _largest(data, name, index) -> tuple[float, float]:
    """The largest |value| of both sides, and of their difference, in matter and over all frames."""
    inside = np.fmin(data["md_density"].values, data["pd_density"].values) >= 0.5 * data.attrs["bulk_density"]
    out = []
    for sides in (("md", "pd"), ("difference",)):
        v = np.concatenate([data[f"{s}_{name}"].values[inside][(slice(None), *index)] for s in sides])
        v = np.abs(v[np.isfinite(v)])
        out.append(float(v.max()) if len(v) and v.max() > 0 else 1.0)
    return out[0], out[1]


def drawn(data, components, title, limits=None):
    """The figure of `picture`. limits : of the colours, (both sides, difference) of each component; default: their
    own."""
    from matplotlib.figure import Figure

    from ..pictures.drawing import colours, draw_map, figure, titled
    from ..pictures.geometry import cut, points_of_grid, unit_text

    place = points_of_grid(data, data["md_density"].isel(frame=0))
    if place.kind not in ("volume", "plane"):
        raise AtcError(f"a picture of the twin needs a regular or plane grid, this is one of kind {place.kind}")
    selection, where = {}, ""
    if place.kind == "volume":
        place, selection, where = cut(place)
    fig, axs = figure(Figure, 3 * len(components), 4.2, 3.7, columns=3)
    axs = axs.reshape(-1, 3)
    for row, (name, index, label), bound in zip(axs, components, limits or [None] * len(components)):
        values = []
        for side in ("md", "pd"):
            v = data[f"{side}_{name}"].mean("frame").isel(selection).values[(..., *index)]
            density = data[f"{side}_density"].mean("frame").isel(selection).values
            values.append(np.where(density >= 0.5 * data.attrs["bulk_density"], v, np.nan))
        values.append(values[1] - values[0])
        units = unit_text(data[f"md_{name}"].attrs.get("units", ""))
        both = np.abs(np.stack(values[:2]))
        top = bound[0] if bound else np.nanmax(both) if np.isfinite(both).any() else 1.0
        for ax, v, side in zip(row, values, ("MD", "PD", "PD - MD")):
            span = (-top, top) if side != "PD - MD" else (-bound[1], bound[1]) if bound else None
            draw = colours("", "xx", v, span, False)
            draw_map(fig, ax, place, place.flat(), v, *draw, f"{side}, {label}" + (f" ({units})" if units else ""))
    titled(fig, title + (f"; {where}" if where else ""))
    return fig
