"""Both sides' fields on one grid with one kernel, over the frames, and how far apart they are."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcWarning
from ..frame import Frame
from .smoothing import with_images

#: name in the dataset: (quantity of the atoms, of the nodes)
PAIRS = {
    "density": ("density", "density"),
    "displacement": ("displacement", "displacement"),
    "velocity": ("velocity", "velocity"),
    "stress": ("stress", "peridynamic_stress"),
    "energy": ("energy_potential", "energy_potential"),
}


def fields_of_atoms(scene, run, frames, pot, kern, grid, names, reference):
    """Fields of the run; without velocities (a body at rest) stress is that of the potential alone."""
    from .. import fields

    still = any(f.velocities is None for f in frames)
    asked = [*(PAIRS[n][0] for n in names), "virial_stress"]
    if still:
        asked = [a + "_potential" if "stress" in a else a for a in asked]
    with warnings.catch_warnings():
        # Packets in a crystal at rest, and minimised bodies, are as cold as they are meant to be.
        warnings.filterwarnings("ignore", "(?s).*the atoms have a temperature of .*e-", AtcWarning)
        md = fields(
            run,
            pot,
            kern,
            grid,
            asked,
            tolerance=scene.get("fields", "tolerance", 1e-5),
            reference=reference,
            forces="ignore",
        )
    return md.rename({a: a.removesuffix("_potential") for a in asked if "stress" in a}) if still else md


def fields_of_nodes(sim, material, units, kern, grid, names, atoms):
    """Fields of the twin's present state, by the code that makes those of the atoms."""
    from .. import fields, pd

    if material.carries_atoms:
        frame, pot = material.frame(sim)
        found = fields(
            [frame],
            pot,
            kern,
            grid,
            [*(PAIRS[n][0] for n in names), "virial_stress_potential"],
            reference=atoms,
            forces="ignore",
        )
        return found.rename({PAIRS[n][0]: PAIRS[n][1] for n in names if PAIRS[n][0] != PAIRS[n][1]})
    # The twin's numbers are internal ones; results are reported in the run's units.
    frame, bonds = pd.snapshot(sim, units="lj", planar=units.dimension == 2)
    reference = pd.reference_frame(sim, units="lj", planar=units.dimension == 2)
    bonds.units = units
    frame, reference = frame.replace(units=units), reference.replace(units=units)
    asked = [*(PAIRS[n][1] for n in names), "virial_stress_potential"]
    return fields([frame], bonds, kern, grid, asked, reference=reference, forces="ignore")


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


def without_cohesion(data, sides, units, per_mass) -> None:
    """The energy densities of some sides from that of the crystal at rest, `per_mass` (internal), on: what strain,
    surfaces and vibrations have stored."""
    for side in sides:
        rho = units.to_internal("density", data[f"{side}_density"].values)
        data[f"{side}_energy"].values -= units.to_user("energy_density", per_mass * rho)
        data[f"{side}_energy"].attrs["sign"] = "0 for the crystal at rest"
    data["difference_energy"].values[:] = data["pd_energy"].values - data["md_energy"].values


def norms(data, names, bulk, deep=1.0, each_frame=False) -> list[dict]:
    """Of every field: rms difference of both sides, relative to the rms of the MD's, where both have at least half of
    the bulk's density (``matter``), where both have 95 % of it (``interior``), and where no surface is felt (``deep``,
    see `away_from_surfaces`).

    Of the time averages, with the MD's standard error beside it; or, `each_frame`, of every frame with its own, where
    frames differ because things move, and the spread of one run's frames is no error of anything. Frames in which a
    side has nothing at a point (a crack has opened) are left out there on both.

    A field that vanishes in the MD has relative norms that are not numbers.
    """
    rho_md, rho_pd = (data[f"{s}_density"].mean("frame").values for s in ("md", "pd"))
    least = np.fmin(rho_md, rho_pd) / bulk
    rows = []
    for name in names:
        if name == "density":
            continue
        md, pd = (data[f"{s}_{name}"].values for s in ("md", "pd"))
        for where, inside in (("matter", least >= 0.5), ("interior", least >= 0.95), ("deep", least * deep >= 0.95)):
            a, b = md[:, inside], pd[:, inside]
            known = np.isfinite(a) & np.isfinite(b)
            if not known.any():
                continue
            n = np.where(known.any(axis=0), known.sum(axis=0), np.nan)
            a, b = np.where(known, a, 0.0), np.where(known, b, 0.0)
            error = np.nan
            if not each_frame:
                mean = a.sum(axis=0) / n
                spread = (np.where(known, a - mean, 0.0) ** 2).sum(axis=0)
                if (n > 1).any():
                    error = float(np.sqrt(np.mean(spread[n > 1] / ((n - 1) * n)[n > 1])))
                a, b = mean, b.sum(axis=0) / n
                known = np.isfinite(n)
            rms = lambda v: float(np.sqrt(np.mean(v[known] ** 2)))  # noqa: B023, E731
            size, off = rms(a), rms(b - a)
            rows.append(
                {
                    "field": name,
                    "where": where,
                    "points": int(inside.sum()),
                    "md_rms": size,
                    "pd_rms": rms(b),
                    "difference_rms": off,
                    "relative": off / size if size > 0 else np.nan,
                    "md_standard_error": error,
                }
            )
    return rows


def add_norms(data, rows, each_frame) -> None:
    """The norms into the dataset, as norm_* over fields and regions."""
    data.attrs["norms"] = "of every frame with its own" if each_frame else "of the means over the frames"
    fields, places = (list(dict.fromkeys(r[k] for r in rows)) for k in ("field", "where"))
    data.coords["norm_field"], data.coords["norm_where"] = fields, places
    for key in ("points", "md_rms", "pd_rms", "difference_rms", "relative", "md_standard_error"):
        table = np.full((len(fields), len(places)), np.nan)
        for r in rows:
            table[fields.index(r["field"]), places.index(r["where"])] = r[key]
        data[f"norm_{key}"] = (("norm_field", "norm_where"), table)


def add_constants(data, units, material) -> None:
    """Elastic constants of the crystal, the material and its nodes along the run's axes, as far as it tells them."""
    names = ["xx", "yy", "zz", "yz", "xz", "xy"]
    data.coords["voigt_1"] = data.coords["voigt_2"] = names
    for name, key, what in (
        ("elastic_crystal", "crystal_vv", "of the crystal at rest"),
        ("elastic_material", "wanted_vv", "that the material means to have"),
        ("elastic_nodes", "sampled_vv", "that the sums over nodes make of it"),
    ):
        if (C := getattr(material, key)) is not None:
            values = units.to_user("pressure", C)
            attrs = {"units": units.label("pressure"), "long_name": f"elastic constants {what}"}
            data[name] = (("voigt_1", "voigt_2"), values, attrs)


def away_from_surfaces(simulation, points_gc, reach) -> np.ndarray:
    """(g,) which points have within `reach` only nodes whose families are whole: what surfaces do to a family does not
    show there."""
    from scipy.spatial import cKDTree

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
