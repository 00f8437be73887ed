"""Both sides' fields on one grid with one kernel, over the frames, and how far apart they are."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError

#: name in the dataset: (quantity of the atoms, of the nodes)
PAIRS = {
    "density": ("density", "density"),
    "displacement": ("displacement", "displacement"),
    "velocity": ("velocity", "velocity"),
    "stress": ("stress", "peridynamic_stress"),
}


def dataset_of(md, pd_frames, names):
    """One dataset of md_*, pd_* and difference_* from that of the run and one for each frame of the twin."""
    import xarray as xr

    pd = xr.concat(pd_frames, "frame", coords="minimal", compat="override", join="override", combine_attrs="override")
    out = xr.Dataset(coords=md.coords)
    for name in names:
        atoms, nodes = PAIRS[name]
        out[f"md_{name}"] = md[atoms]
        out[f"pd_{name}"] = (md[atoms].dims, pd[nodes].transpose(*md[atoms].dims).values, dict(pd[nodes].attrs))
        out[f"difference_{name}"] = (md[atoms].dims, out[f"pd_{name}"].values - md[atoms].values)
        out[f"difference_{name}"].attrs.update(units=md[atoms].attrs.get("units", ""), long_name=f"PD - MD, {name}")
    for name, source, what in (
        ("md_box_stress", md, "virial_stress"),
        ("pd_box_stress", pd, "virial_stress_potential"),
    ):
        if what in source:
            out[name] = (md["virial_stress"].dims, source[what].values, dict(source[what].attrs))
    for v in out.data_vars.values():
        v.attrs = {k: a for k, a in v.attrs.items() if isinstance(a, (str, int, float, np.number))}
    return out


def norms(data, names, bulk, deep=1.0) -> list[dict]:
    """Of every field: rms difference of the time averages, relative to the rms of the MD's, where both have at least
    half of the bulk's density (``matter``), where both have 95 % of it (``interior``), and where no surface is felt
    (``deep``, see `away_from_surfaces`); beside it the MD's standard error.

    A field that vanishes in the MD has relative norms that are not numbers.
    """
    rho_md, rho_pd = (data[f"{s}_density"].mean("frame").values for s in ("md", "pd"))
    least = np.fmin(rho_md, rho_pd) / bulk
    rows = []
    n = data.sizes["frame"]
    for name in names:
        if name == "density":
            continue
        md, pd = (data[f"{s}_{name}"].values for s in ("md", "pd"))
        for where, inside in (("matter", least >= 0.5), ("interior", least >= 0.95), ("deep", least * deep >= 0.95)):
            if not inside.any():
                continue
            a, b = md[:, inside], pd[:, inside]
            rms = lambda v: float(np.sqrt(np.mean(v**2)))  # noqa: E731
            size, off = rms(a.mean(0)), rms(b.mean(0) - a.mean(0))
            rows.append(
                {
                    "field": name,
                    "where": where,
                    "points": int(inside.sum()),
                    "md_rms": size,
                    "pd_rms": rms(b.mean(0)),
                    "difference_rms": off,
                    "relative": off / size if size > 0 else np.nan,
                    "md_standard_error": rms(a.std(0, ddof=1) / np.sqrt(n)) if n > 1 else np.nan,
                }
            )
    return rows


def away_from_surfaces(simulation, points_gc, reach) -> np.ndarray:
    """(g,) which points have within `reach` only nodes whose families are whole: what surfaces do to a family does not
    show there."""
    from scipy.spatial import cKDTree

    from ..frame import Frame
    from .smoothing import with_images

    body, t = simulation.body, simulation.body.bonds
    family = np.bincount(t.i_b, body.V_n[t.j_b], len(body)) + np.bincount(t.j_b, body.V_n[t.i_b], len(body))
    own = body.V_n + family
    cut = own < (1 - 1e-6) * own.max()
    if not cut.any():
        return np.ones(len(points_gc), bool)
    nodes = Frame(simulation.positions_nc[cut], simulation.cell, "lj")
    x_nc, _ = with_images(nodes, reach)
    inside, _ = simulation.cell.wrap(points_gc)
    return cKDTree(x_nc).query(inside)[0] > reach


def picture(data, path, components, title):
    """MD, PD and their difference as maps of time averages, one row for each component (field, index, label)."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from ..pictures.drawing import STYLE, colours, draw_map, figure, save
    from ..pictures.geometry import cut, points_of_grid, unit_text

    with mpl.rc_context(STYLE):
        place = points_of_grid(data, data["md_density"].isel(frame=0))
        if place.kind not in ("volume", "plane"):
            raise AtcError(f"a picture of the twin needs a regular or plane grid, this is one of kind {place.kind}")
        selection, where = {}, ""
        if place.kind == "volume":
            place, selection, where = cut(place)
        fig, axs = figure(Figure, 3 * len(components), 4.2, 3.7, columns=3)
        axs = axs.reshape(-1, 3)
        for row, (name, index, label) in zip(axs, components):
            values = []
            for side in ("md", "pd"):
                v = data[f"{side}_{name}"].mean("frame").isel(selection).values[(..., *index)]
                density = data[f"{side}_density"].mean("frame").isel(selection).values
                values.append(np.where(density >= 0.5 * data.attrs["bulk_density"], v, np.nan))
            values.append(values[1] - values[0])
            units = unit_text(data[f"md_{name}"].attrs.get("units", ""))
            both = np.abs(np.stack(values[:2]))
            top = np.nanmax(both) if np.isfinite(both).any() else 1.0
            for ax, v, side in zip(row, values, ("MD", "PD", "PD - MD")):
                limits = (-top, top) if side != "PD - MD" else None
                draw = colours("", "xx", v, limits, False)
                draw_map(fig, ax, place, place.flat(), v, *draw, f"{side}, {label}" + (f" ({units})" if units else ""))
        fig.suptitle(title + (f"; {where}" if where else ""), fontsize=9)
        return save(fig, path)
