"""Pictures of a run and its twin: MD, PD and their difference, of the means over the frames or frame by frame; profiles
and histories of both."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import AtcError
from .drawing import STYLE, colours, draw_map, figure, save, titled
from .geometry import cut, points_of_grid, unit_text, with_unit
from .movies import write_movie


def components_of(data) -> list:
    """[(field, index, label)] to draw: displacement and stress along the axis of the largest mean stress, damage."""
    k = int(np.argmax(np.abs(np.diag(data["md_box_stress"].mean("frame").values))))
    c = "xyz"[k]
    damage = [("damage", (), "damage")] if "md_damage" in data else []
    return [("displacement", (k,), f"u_{c}"), ("stress", (k, k), f"stress {c}{c}"), *damage]


def picture(data, path, title, components=None):
    """MD, PD and their difference as maps, one row for each component (field, index, label): of time averages, of a
    dynamic twin in the middle of the run and at its end; of a line grid what `over_line` draws."""
    import matplotlib as mpl

    with mpl.rc_context(STYLE):
        if _kind(data) == "line":
            return save(over_line(data, title.partition(": means of")[0], components), path)
        frames = shown_frames(data)
        if frames:
            title = title.partition(": means of")[0]
        return save(drawn(data, title, components, frames=frames), path)


def shown_frames(data) -> list[int]:
    """The frames that stand for a run whose fields move, in the middle and at the end; none where means do."""
    n = data.sizes["frame"]
    return sorted({n // 2, n - 1}) if data.attrs.get("motion") == "dynamic" and n > 1 else []


def over_line(data, title, components=None, frames=None, limits=None):
    """Figure of a line grid: both sides at some frames, by default the first, the middle and the last, one row for each
    component, by default the displacement and the stress that vary most over time. limits : largest |value| of each
    row; default: that of all frames"""
    place = points_of_grid(data, data["md_density"].isel(frame=0))
    if place.kind != "line":
        raise AtcError(f"a picture along a line needs a line grid, this is one of kind {place.kind}")
    s, text = place.abscissa(0)
    n = data.sizes["frame"]
    frames = sorted({0, n // 2, n - 1}) if frames is None else frames
    components = components or [_varying(data, "displacement"), _varying(data, "stress")]
    limits = limits or [_largest(data, name, index)[0] for name, index, _ in components]
    fig, axs = figure(len(frames) * len(components), 4.2, 2.9, columns=len(frames))
    rows = np.reshape(axs, (-1, len(frames)))
    for row, (name, index, label), top in zip(rows, components, limits):
        for ax, k in zip(row, frames):
            inside = _matter(data)[k]
            _both(ax, s, text, data, name, label, lambda v: np.where(inside, v[(k, ..., *index)], np.nan))  # noqa: B023
            ax.set_ylim(-1.06 * top, 1.06 * top)
            ax.set_title(_moment(data, k))
        row[0].legend()
    titled(fig, title)
    return fig


def at_nodes(data):
    """Figure of a plane wave at the nodes: the displacement that varies most, of the run (smoothed once), the twin and
    the classical wave equation, at the first, the middle and the last frame; None where the dataset has no classical
    waves, or the displacement does not vary along one axis."""
    if "classical_node_displacement" not in data:
        return None
    sides = {s: data[f"{s}_node_displacement"].values for s in ("md", "pd", "classical")}
    c = int(np.argmax(sides["md"].var(axis=(0, 1))))
    X, u = data["node_position"].values, sides["md"][0, :, c]
    mean = lambda v, group: np.bincount(group, v) / np.bincount(group)  # noqa: E731
    found = []
    for axis in range(3):
        places, group = np.unique(np.round(X[:, axis], 4), return_inverse=True)
        found.append((float(((u - mean(u, group)[group]) ** 2).mean()), axis, places, group))
    rest, axis, places, group = min(found, key=lambda f: f[0])
    if not rest < 1e-2 * u.var() or len(places) < 4:
        return None
    n = data.sizes["frame"]
    frames = sorted({0, n // 2, n - 1})
    fig, axs = figure(len(frames), 4.2, 2.9, columns=len(frames))
    units = data["md_node_displacement"].attrs.get("units", "")
    for ax, k in zip(axs, frames):
        for side, style, name in (("md", "k.-", "MD"), ("pd", "C3-", "PD"), ("classical", "C0--", "classical")):
            ax.plot(places, mean(sides[side][k, :, c], group), style, label=name, lw=1.0, ms=3)
        ax.set(xlabel=f"{'xyz'[axis]} ({unit_text(units)})", ylabel=f"u_{'xyz'[c]} ({unit_text(units)})")
        ax.set_title(_moment(data, k))
        ax.spines[["top", "right"]].set_visible(False)
    axs[0].legend()
    return fig


def _moment(data, k) -> str:
    """Which frame, and when."""
    text = f"frame {k + 1} of {data.sizes['frame']}" if data.sizes["frame"] > 1 else ""
    if "time" in data.coords and np.isfinite(t := float(data["time"].values[k])):
        text += f"{', ' if text else ''}t = {t:.4g} {unit_text(str(data['time'].attrs.get('units', '')))}".rstrip()
    return text


def _both(ax, s, text, data, name, label, of_values) -> None:
    """Curves of both sides over s, `of_values` of what the dataset has of a field."""
    for side, style in (("md", "k.-"), ("pd", "C3-")):
        ax.plot(s, of_values(data[f"{side}_{name}"].values), style, label=side.upper(), lw=1.0, ms=3)
    ax.set(xlabel=text, ylabel=with_unit(label, data[f"md_{name}"].attrs.get("units")))
    ax.spines[["top", "right"]].set_visible(False)


def _varying(data, name):
    """(field, index, label) of the component of the MD's that varies most over time; in one frame, over the grid."""
    v = data[f"md_{name}"].values
    v = v[:, _matter(data).all(axis=0)]
    spread = v.var(axis=0).mean(axis=0) if len(v) > 1 else v[0].var(axis=0)
    index = tuple(int(i) for i in np.unravel_index(np.argmax(spread), spread.shape))
    axes = "".join("xyz"[i] for i in index)
    return name, index, f"u_{axes}" if name == "displacement" else f"{name} {axes}"


def _kind(data) -> str:

    return points_of_grid(data, data["md_density"].isel(frame=0)).kind


def movie(data, path, title, components=None, rate: float = 5.0) -> Path:
    """The same frame by frame as a movie (.gif, .mp4), `rate` frames a second, with the same colours in all of them."""
    frames = range(data.sizes["frame"])
    if _kind(data) == "line":
        return write_movie(path, (over_line(data, title, components, [k]) for k in frames), rate)
    components = components or components_of(data)
    limits = [_largest(data, name, index) for name, index, _ in components]
    return write_movie(path, (drawn(data, title, components, limits, [k]) for k in frames), rate)


def _largest(data, name, index) -> tuple[float, float]:
    """The largest |value| of both sides, and of their difference, in matter and over all frames."""
    inside = _matter(data)
    out = []
    for sides in (("md", "pd"), ("difference",)):
        v = np.concatenate([data[f"{s}_{name}"].values[inside][(slice(None), *index)] for s in sides])
        v = np.abs(v[np.isfinite(v)])
        out.append(float(v.max()) if len(v) and v.max() > 0 else 1.0)
    return out[0], out[1]


def drawn(data, title, components=None, limits=None, frames=()):
    """The figure of `picture`. limits : of the colours, (both sides, difference) of each component; default: their
    own. frames : those to draw, one row for each and each component; none: the means over all"""
    components = components or components_of(data)
    place = points_of_grid(data, data["md_density"].isel(frame=0))
    if place.kind not in ("volume", "plane"):
        raise AtcError(f"a picture of the twin needs a regular or plane grid, this is one of kind {place.kind}")
    selection, where = {}, ""
    if place.kind == "volume":
        place, selection, where = cut(place)
    moments = [(data.isel(frame=[k]), _moment(data, k)) for k in frames] or [(data, "")]
    fig, axs = figure(3 * len(components) * len(moments), 4.2, 3.7, columns=3)
    limits = limits or [None] * len(components)
    rows = [(c, bound, m) for c, bound in zip(components, limits) for m in moments]
    for row, ((name, index, label), bound, (ds, when)) in zip(np.reshape(axs, (-1, 3)), rows):
        values = []
        for side in ("md", "pd"):
            v = ds[f"{side}_{name}"].mean("frame").isel(selection).values[(..., *index)]
            density = ds[f"{side}_density"].mean("frame").isel(selection).values
            values.append(np.where(density >= 0.5 * float(data["bulk_density"]), v, np.nan))
        values.append(values[1] - values[0])
        units = data[f"md_{name}"].attrs.get("units")
        both = np.abs(np.stack(values[:2]))
        top = bound[0] if bound else np.nanmax(both) if np.isfinite(both).any() else 1.0
        for ax, v, side in zip(row, values, ("MD", "PD", "PD - MD")):
            if side == "PD - MD":
                draw = colours("", "xx", v, (-bound[1], bound[1]) if bound else None, False)
            elif name == "damage":  # from 0 on
                draw = colours("", None, v, (0.0, top or 1.0), False)
            else:
                draw = colours("", "xx", v, (-top, top), False)
            draw_map(fig, ax, place, place.flat(), v, *draw, with_unit(f"{side}, {label}", units))
            if len(moments) > 1:
                ax.set_title(f"{ax.get_title()}, {when}")
    only = moments[0][1] if len(moments) == 1 else ""
    titled(fig, "; ".join(t for t in (title, only, where) if t))
    return fig


def profiles(data, components=None):
    """Figure of both sides along an axis of the grid: means over the frames and, in matter, over the cross-section; the
    MD's with its standard error. Of a displacement the axis is its own, of other fields the longest of the others."""
    components = components or components_of(data)
    place = points_of_grid(data, data["md_density"].isel(frame=0))
    if place.kind not in ("volume", "plane", "line"):
        raise AtcError(f"profiles need a regular, plane or line grid, this is one of kind {place.kind}")
    matter = _matter(data)
    fig, axs = figure(len(components), 4.2, 3.2)
    for ax, (name, index, label) in zip(axs, components):
        along = _axis(place, components[0][1][0], name == "displacement")
        s, text = place.abscissa(along)
        _both(ax, s, text, data, name, label, lambda v: _section_means(v, matter, index, along).mean(axis=0))  # noqa: B023
        md = _section_means(data[f"md_{name}"].values, matter, index, along)
        if len(md) > 1:
            error = md.std(axis=0, ddof=1) / len(md) ** 0.5
            ax.fill_between(s, md.mean(0) - error, md.mean(0) + error, color="0.8", lw=0)
        ax.legend()
    return fig


def _section_means(values, matter, index, along):
    """(frame, place) means over the cross-section's matter."""
    v = np.moveaxis(np.where(matter, values[(..., *index)], np.nan), along + 1, 1)
    v = v.reshape(*v.shape[:2], -1)
    counted = np.maximum(np.isfinite(v).sum(axis=2), 1)
    return np.where(np.isfinite(v).any(axis=2), np.nansum(v, axis=2) / counted, np.nan)


def _axis(place, c, itself) -> int:
    """The dimension of a grid that is nearest to the Cartesian axis c, or the longest of the others."""
    steps = np.array([s / max(np.linalg.norm(s), 1e-300) for s in place.steps])
    own = int(np.argmax(np.abs(steps[:, c])))
    lengths = [np.linalg.norm(s) * n for s, n in zip(place.steps, place.x_gc.shape)]
    others = [k for k in range(len(lengths)) if k != own]
    return own if itself or not others else max(others, key=lengths.__getitem__)


#: What has a value a frame and is drawn over time: name without md_ and pd_, index, label.
_HISTORIES = (
    *(("box_stress", (k, k), f"mean stress {c}{c}") for k, c in enumerate("xyz")),
    ("damage_of_body", (), "bonds lost, share"),
    ("crack_tip", (), "crack tip"),
    ("crack_area", (), "cracked area"),
)


def histories(data):
    """Figure of what has one value a frame: the mean stress, damage and the crack, of both sides over time; None where
    there is one frame."""
    if data.sizes["frame"] < 2:
        return None
    t, text = np.arange(data.sizes["frame"]), "frame"
    if "time" in data.coords and np.isfinite(data["time"].values).all():
        t, text = data["time"].values, with_unit("time", str(data["time"].attrs.get("units", "")))
    flat = "md_displacement" in data and data["md_displacement"].sizes.get("i", 3) == 2
    shown = [h for h in _HISTORIES if f"md_{h[0]}" in data and f"pd_{h[0]}" in data and not (flat and h[1] == (2, 2))]
    fig, axs = figure(len(shown), 3.9, 2.8)
    for ax, (name, index, label) in zip(axs, shown):
        _both(ax, t, text, data, name, label, lambda v: v[(..., *index)])  # noqa: B023
        ax.legend()
    return fig


def _matter(data):
    """(frame, grid) where both sides have at least half of the bulk's density."""
    return np.fmin(data["md_density"].values, data["pd_density"].values) >= 0.5 * float(data["bulk_density"])
