"""Pictures of fields: slices and planes as maps, slabs and lines as profiles, points and atoms as scatter plots.

Everything is drawn in the units of the dataset and at its true positions (triclinic grids too). Signed components get a
diverging map that is symmetric about zero, quantities that cannot be negative a sequential one; where a field is
undefined (vacuum) the map is grey.
"""

from __future__ import annotations

import difflib
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..running.opening import load, of_species
from ..units.words import converted, in_units, unit_of
from . import components
from .against_time import time_figure
from .components import TENSOR
from .drawing import STYLE, at_frame, colours, draw_map, figure, kernel_title, label_of, save, singular, titled
from .geometry import PROFILES, STDERR, cut, fields_of, grid_dims, over_angles, over_axes, points_of_grid, rank
from .movies import RATE, movie_path, write_movie
from .nodes import plot_nodes
from .overlays import Overlays, legend
from .symbols import symbol


def plot(
    ds,
    quantity=None,
    *,
    component=None,
    slice=None,
    axis=None,
    index=None,
    frame=-1,
    mean=None,
    limits=None,
    robust=None,
    atoms=None,
    species=None,
    units=None,
    arrows=None,
    streamlines=None,
    principal=None,
    one_scale=False,
):
    """Draw one field, one panel a component.

    Parameters
    ----------
    ds : xarray.Dataset or path, an output of `atc.fields`
    quantity : name of a field, or several separated by commas; default the stress, else the first field
    component : ``xx`` … ``zz``, ``hydrostatic``, ``pressure``, ``vonmises``, ``max_shear``, ``principal1``…``3``;
        ``x``, ``y``, ``z``,
        ``magnitude``; several separated by commas; default every component
    slice : for a 3-D grid, ``"z=0.5"`` (fraction of the axis) or ``"z=12.5A"`` (distance along the axis, in the
        dataset's length unit)
    axis, index : the same by index
    frame : index, ``"mean"``, or ``"all"``: a profile against time, position to the right and time upwards
    mean : axes of the grid that means are taken over first, e.g. ``"y"`` or ``"x,y"``: a map or a profile is left
    limits : (lo, hi) of the colours; robust : limits at the 2nd and 98th percentile; None: only where a few points are
        far beyond all others (corners, crack tips); False: never
    arrows, streamlines : name of a vector field (velocity, heat_flux, ...) to draw over maps
    principal : name of a tensor field whose principal values in the plane are drawn over maps as crosses: along their
        directions, as long as they are large, tension red, compression blue
    species : which of the species, or molecules, that the fields are taken apart by
    one_scale : the same limits whichever frame is drawn: those of all frames
    units : to draw in, e.g. ``"GPa, nm"`` or a preset, see `atc.fields`
    atoms : (n, 3) positions in the dataset's units to draw on maps, those near the plane

    Returns
    -------
    matplotlib.figure.Figure, drawn without a display (Agg)

    Raises
    ------
    AtcError : for a field, component, frame or plane that is not there
    """
    import matplotlib as mpl

    ds = in_units(of_species(load(ds), species), units)
    if "equation" in ds.attrs and "x" in ds.dims:
        raise AtcError("this is an output of atc advect, whose picture was written beside it (the same name, .png)")
    if ds.attrs.get("kind") == "peridynamics":
        how = {"limits": limits, "robust": robust, "one_scale": one_scale}
        return plot_nodes(ds, quantity, component=component, slice=slice, axis=axis, frame=frame, **how)
    axes = tuple(str(ds.attrs.get("axes", "")).split())
    if axes:
        ds = over_angles(ds)
        component = _cartesian_names(component, axes)
    if mean is not None:
        ds = over_axes(ds, mean)
    panels = []
    dimension = int(ds.attrs.get("dimension", 3))
    wanted = [q.strip() for q in quantity.split(",")] if quantity else [None]
    for q in wanted:
        name = pick(ds, q)
        da, when = (ds[name], "") if frame == "all" else at_frame(ds, name, frame)
        da = da.transpose(*(["frame"] if frame == "all" and "frame" in da.dims else []), *grid_dims(da), ...)
        chosen = component or through(ds, da)
        comps = _scalars(da, chosen if rank(da) or len(wanted) == 1 else None, dimension)
        if len(wanted) > 1 and chosen is None and rank(da):
            dims = grid_dims(da)
            along = [str(dims[0])] if len(dims) == 1 and dims[0] in ("x", "y", "z")[:dimension] else ["magnitude"]
            comps = along if rank(da) == 1 else ["vonmises"]
        panels += [(name, da, c) for c in comps]
    dims = {tuple(grid_dims(da)) for _, da, _ in panels}
    if len(dims) > 1:
        raise AtcError("fields on different grids cannot share a picture: plot them one by one")
    if frame == "all":
        if slice is not None or axis is not None or index is not None or arrows or streamlines or principal:
            raise AtcError("frame all: a map of position and time has no slices, arrows, streamlines or crosses")
        return time_figure(ds, panels, limits, robust, dimension, mean)
    place = points_of_grid(ds, panels[0][1])
    if place.kind == "volume":
        place, selection, where = cut(place, slice, axis, index)
    else:
        if slice is not None or axis is not None or index is not None:
            raise AtcError(f"this output is on a {place.kind}, not on a 3-D grid: there is nothing to slice")
        selection, where = {}, ""
    names = ", ".join(dict.fromkeys(str(da.attrs.get("long_name", name)) for name, da, _ in panels))
    where = ", ".join(t for t in (where, "" if mean is None else f"mean over {mean}") if t)
    title = ", ".join(t for t in (names[:1].upper() + names[1:], kernel_title(ds), where, when) if t)
    if place.kind in PROFILES and (arrows or streamlines or principal):
        raise AtcError("arrows, streamlines and principal stresses are drawn over maps, not over profiles")
    with mpl.rc_context(STYLE):
        if place.kind in PROFILES:
            return _profiles(ds, panels, place, title, limits, frame, dimension, one_scale)
        values = [_values(da.isel(selection), c, dimension) for _, da, c in panels]
        over = Overlays(ds, place, selection, frame, dimension, arrows, streamlines, principal, one_scale)
        scaled = [_all_frames(ds, n, c, selection, dimension) for n, _, c in panels] if one_scale else values
        return _maps(panels, values, place, title, limits, robust, atoms, over, scaled)


def _values(da, comp, dimension):
    return components.component(da.values, comp, dimension, rank=rank(da))


def _all_frames(ds, name, comp, selection, dimension):
    """The values of one panel in every frame."""
    da = ds[name]
    da = da.transpose(*(d for d in ("frame",) if d in da.dims), *grid_dims(da), ...).isel(selection)
    return _values(da, comp, dimension)


def through(ds, da) -> str | None:
    """What of a field on planes passes through them: the components of their normal."""
    if not str(ds.attrs.get("grid", "")).startswith("planes") or not rank(da):
        return None
    n, letters = grid_dims(da)[0], "xyz"[: int(ds.attrs.get("dimension", 3))]
    return n if rank(da) == 1 else ",".join(n + j for j in letters)


def _cartesian_names(component, axes):
    """Components along other axes (rr, rphi) by the names that they have as places in the arrays (xx, xy)."""
    if component is None:
        return None
    named = {a + b: "xyz"[i] + "xyz"[j] for i, a in enumerate(axes) for j, b in enumerate(axes)}
    named |= {a: "xyz"[i] for i, a in enumerate(axes)}
    return ",".join(named.get(w.strip(), w.strip()) for w in component.split(","))


def pick(ds, quantity):
    """The variable called `quantity`, or the first one worth a picture; AtcError where there is none."""
    names = fields_of(ds)
    if quantity is None:
        for name in ("stress", "stress_potential", "smoothed_virial_stress", *names):
            if name in names:
                return name
        raise AtcError(
            "this output holds no field on a grid (only box totals): there is nothing to draw; its numbers are in atc "
            "compare"
        )
    if quantity.endswith(STDERR) and quantity.removesuffix(STDERR) in names and quantity in ds:
        return quantity
    if quantity not in names:
        near = difflib.get_close_matches(quantity, names, n=1)
        why = "is not in this output"
        if quantity in ds and not grid_dims(ds[quantity]):
            why = "is one number for the box, not a field: nothing to draw"
        raise AtcError(
            f"{quantity} {why}: {f'did you mean {near[0]!r}? ' if near else ''}it holds "
            f"{', '.join(names) or 'no fields'}"
        )
    return quantity


def _scalars(da, wanted, dimension=3) -> list[str | None]:
    """The components to draw, one a panel."""
    order = rank(da)
    if order == 0:
        if wanted not in (None, "all"):
            raise AtcError(f"{da.name} is a scalar: it has no component {wanted!r}")
        return [None]
    if wanted in (None, "all"):
        if order == 1:
            return components.names(1, dimension)
        v, size = da.values, float(np.nanmax(np.abs(da.values), initial=0))
        if np.allclose(v, np.swapaxes(v, -1, -2), rtol=1e-9, atol=1e-12 * size, equal_nan=True):
            return components.names(2, dimension)
        return [a + b for a in "xyz"[:dimension] for b in "xyz"[:dimension]]
    return [w.strip() for w in wanted.split(",")]


def _panel_size(flat, panels):
    """Width and height of one panel, and how many go side by side."""
    span = np.maximum(np.ptp(flat.reshape(-1, 2), axis=0), 1e-12)
    aspect = float(np.clip(span[1] / span[0], 0.1, 2.5))
    if aspect < 0.45:
        width = 6.0
        return width, 0.88 * width * aspect + 1.25, 1
    width = 4.6 if panels == 1 else 3.3
    return width, (width - 1.15) * aspect + 0.75, 3


def _maps(panels, values, place, title, limits, robust, atoms, over=None, scaled=None):
    """Maps, one panel each. scaled : the values that scales are made for, if not those drawn"""
    scaled = values if scaled is None else scaled
    drawn_as = place.flat()
    flat, _, basis, origin = drawn_as
    width, height, columns = _panel_size(flat, len(panels))
    fig, axs = figure(len(panels), width, height, columns)
    largest: dict[str, float] = {}
    for (name, _, _), v in zip(panels, scaled):
        few = robust is not False and singular(v)
        usual = np.nanpercentile(np.abs(v), 98) if few else np.nanmax(np.abs(v), initial=0)
        largest[name] = max(largest.get(name, 0.0), float(usual))
    for ax, (name, da, comp), v, s in zip(axs, panels, values, scaled):
        painted = colours(name, comp, s, limits, robust, 1e-3 * largest[name])
        draw_map(fig, ax, place, drawn_as, v, *painted, label_of(da, comp))
        if over is not None:
            over.draw(ax, drawn_as)
        if atoms is not None and len(atoms):
            near = np.abs((atoms - origin) @ basis[2]) <= place.thickness
            how = {"facecolors": "w", "edgecolors": "k", "linewidths": 0.4, "alpha": 0.8}
            size = float(np.clip(3e3 / max(near.sum(), 1), 1.5, 16))
            ax.scatter(*(atoms[near] @ basis[:2].T).T, s=size, **how)
    legend(fig, any(not np.isfinite(v).all() for v in values), over)
    titled(fig, title)
    return fig


def _profiles(ds, panels, place, title, limits, frame, dimension=3, one_scale=False):
    """Curves along the one dimension, one panel a field, with the standard error as a band where the output has one."""
    groups: dict[str, list] = {}
    for name, da, comp in panels:
        groups.setdefault(name, []).append((da, comp))
    fig, axs = figure(len(groups), 5.0, 3.1)
    axes = tuple(str(ds.attrs.get("axes", "")).split())
    s, label = place.abscissa()
    for ax, (name, members) in zip(axs, groups.items()):
        error, banded = _stderr(ds, name, frame), False
        for da, comp in members:
            v = _values(da, comp, dimension)
            called = None if comp is None else symbol(name, comp, axes) or comp
            (line,) = ax.plot(s, v, label=called, marker="o" if len(s) == 1 else None)
            # the error of an invariant is not the invariant of the errors
            if error is not None and (comp is None or comp in TENSOR or comp in ("x", "y", "z")):
                e = _values(error.transpose(*da.dims), comp, dimension)
                ax.fill_between(s, v - e, v + e, color=line.get_color(), alpha=0.25, linewidth=0)
                banded = True
        ax.set_xlabel(label)
        ax.set_ylabel(label_of(members[0][0], None if len(members) > 1 else members[0][1]))
        if len(s) > 1:
            ax.set_xlim(s[0], s[-1])
        if one_scale:
            every = np.concatenate([_all_frames(ds, name, comp, {}, dimension).ravel() for _, comp in members])
            if np.isfinite(every).any():
                ax.update_datalim([(s[0], np.nanmin(every)), (s[0], np.nanmax(every))], updatex=False)
                ax.autoscale_view()
        if limits is not None:
            ax.set_ylim(*limits)
        lo, hi = ax.get_ylim()
        if lo < 0 < hi:
            ax.axhline(0, color="0.6", lw=0.6, zorder=0)
        handles, labels = ax.get_legend_handles_labels()
        if banded:
            from matplotlib.patches import Patch

            handles, labels = [*handles, Patch(color="0.5", alpha=0.35)], [*labels, "± std. error"]
        if len(members) > 1 or banded:
            ax.legend(handles, labels, ncols=1 if len(members) < 4 else 2)
        ax.spines[["top", "right"]].set_visible(False)
    titled(fig, title)
    return fig


def _stderr(ds, name, frame):
    """The standard error that belongs to the entry drawn; None for a mean over several entries, whose error is not
    theirs."""
    if name + STDERR not in ds or frame == "all":
        return None
    error = ds[name + STDERR]
    if "frame" not in error.dims:
        return error
    if frame == "mean":
        return error.isel(frame=0) if error.sizes["frame"] == 1 else None
    return error.isel(frame=int(frame))


def _loaded(path, options):
    """The output, of the species and in the units that options ask for: they are taken out of these."""
    return in_units(of_species(load(path), options.pop("species", None)), options.pop("units", None))


def plot_file(path, quantity=None, *, output=None, overlay=None, frame=-1, **options) -> Path:
    """`plot` of an output file into a picture next to it (or `output`); returns the picture's path.

    `overlay`: a trajectory whose atoms are drawn on the map, at the frame shown.
    """
    path, ds = Path(path), _loaded(path, options)
    atoms = None if overlay is None else _atoms(overlay, ds, frame)
    fig = plot(ds, quantity, frame=frame, atoms=atoms, **options)
    if output is None:
        nodes = ds.attrs.get("kind") == "peridynamics"
        drawn = quantity or ("damage" if nodes else pick(ds, None))
        words = [path.stem, "t" if frame == "all" else None, drawn, options.get("component")]
        output = path.with_name("-".join(w.replace(",", "-") for w in words if w) + ".png")
    return save(fig, output)


def movie_file(path, movie, quantity=None, *, rate=RATE, overlay=None, **options) -> Path:
    """`plot` of every frame of an output file as a movie (.gif, .mp4) with one scale, `rate` frames a second."""
    movie, ds = movie_path(movie), _loaded(path, options)
    n = ds.sizes.get("frame", 1)
    if n < 2:
        raise AtcError(f"{path}: it has one frame, which makes no movie: compute more (average = false, or a window)")
    atoms = lambda k: None if overlay is None else _atoms(overlay, ds, k)  # noqa: E731
    figures = (plot(ds, quantity, frame=k, one_scale=True, atoms=atoms(k), **options) for k in range(n))
    return write_movie(movie, figures, rate)


def _atoms(trajectory, ds, frame):
    """Positions, in the cell, in the dataset's length unit, of the atoms of the frame that is drawn."""
    if frame == "all":
        raise AtcError("--overlay: atoms are drawn on maps of one frame: leave --frame all or --overlay out")
    k = int(ds["frame"].values[0 if frame == "mean" else int(frame)])
    if k >= len(trajectory):
        raise AtcError(
            f"--overlay {trajectory.source}: the picture shows frame {k} of the run, the scene selects only "
            f"{len(trajectory)} frames"
        )
    one = trajectory[k]
    x_nc = one.units.to_user("length", one.cell.wrap(one.positions)[0])
    there = next(
        (ds[c].attrs["units"] for c in ("x", "y", "z", "cell") if c in ds.coords and "units" in ds[c].attrs), ""
    )
    have = one.units.label("length")
    return x_nc if there in ("", have) else x_nc * converted(have, (unit_of(there),))[0]
