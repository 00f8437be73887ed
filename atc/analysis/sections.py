"""Forces through cross-sections: what a wire, a plate or a film carries.

F_j = ∫ σ_ij dA_i over the plane through each point of a grid along its normal i: of a slab profile, and of planes, the
average times the area of the cell, of a regular grid the sum over the points of a layer times the area of each
(quadrature: it converges as the grid resolves the kernel). A grid that ends at open faces lacks what the kernel carries
beyond them: padding. Over the area of matter in the section it is the net section stress.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..pictures.geometry import grid_dims, points_of_grid
from ..units import units
from ..units.words import NotAUnit, unit_of

#: Kinds of grids whose values are averages over the whole cross-section of the cell.
WHOLE = ("slab", "planes")
#: The least share of the largest section of matter that has a stress.
THINNEST = 0.02


def _sections(ds, axis, quantity, what):
    """(stress, axis, dims of the grid, place) of an output that has cross-sections."""
    name = quantity or next((n for n in ("stress", "stress_potential") if n in ds), None)
    if name is None or name not in ds or not {"i", "j"} <= {*ds[name].dims}:
        raise AtcError(f"{what}: {name or 'stress'}: is no stress of this output")
    one = ds.isel(species=0, drop=True) if "species" in ds.dims else ds
    dims, place = grid_dims(one[name]), points_of_grid(one, one[name])
    if place.kind not in (*WHOLE, "volume") or any(d not in "xyz" for d in dims):
        raise AtcError(f"{what}: of a slab profile, planes, or a regular grid along x, y, z; this is a {place.kind}")
    axis = axis or (dims[0] if place.kind in WHOLE else None)
    if axis not in dims:
        raise AtcError(f"{what}: axis {axis!r}: expected {' or '.join(dims)}")
    return name, axis, dims, place


def section_force(ds, axis=None, quantity=None):
    """The force that the material beyond each cross-section exerts through it, tension positive along the normal.

    Parameters
    ----------
    ds : output of `atc.fields` on a slab profile, on planes, or a regular grid whose edges run along x, y and z
    axis : "x", "y" or "z", the normal of the sections; default that of the profile
    quantity : which stress; default ``stress``, else ``stress_potential``

    Returns
    -------
    xarray.DataArray with dims (…, axis, i): component i of the force, in the force unit of the trajectory's style

    Raises
    ------
    AtcError for other grids, fields that are no stress, cells whose edges are tilted against the normal.
    """
    name, axis, dims, place = _sections(ds, axis, quantity, "section force")
    da, k = ds[name], "xyz".index(axis)
    if place.kind in WHOLE:
        cells = ds["cell"].values.reshape(-1, 3, 3)
        if any(np.abs(c[m, k]) > 1e-9 * np.abs(c).max() for c in cells for m in range(3) if m != k):
            raise AtcError("section force: the cell is tilted: its faces are not normal to the axis")
        area_t = np.linalg.norm(np.cross(cells[:, (k + 1) % 3], cells[:, (k + 2) % 3]), axis=1)
        force = da.isel(i=k, drop=True).rename(j="i")
        shape = [len(area_t) if d == "frame" else 1 for d in force.dims]
        if "frame" not in force.dims and len(area_t) > 1:
            area_t = area_t[:1]
        force = force * area_t.reshape(shape if "frame" in force.dims else [1] * force.ndim)
    else:
        others = [d for d in dims if d != axis]
        steps = {d: place.steps[m] for m, d in enumerate(place.dims)}
        area = abs(np.cross(steps[others[0]], steps[others[1]])[k])
        # Where there is no mass there is no stress: undefined points count as empty.
        force = da.isel(i=k, drop=True).rename(j="i").fillna(0.0).sum(others) * area
    u = units(str(ds.attrs["units"]))
    label, factor = u.label("force"), 1.0
    if not u.reduced:
        length = next(str(ds[c].attrs["units"]) for c in (axis, "cell") if "units" in ds[c].attrs)
        wrong = AtcError(f"section force: {name} is in {da.attrs.get('units')}, which is no unit of a stress")
        try:
            have, want = unit_of(f"({da.attrs['units']})*{length}^2"), unit_of(label)
        except NotAUnit:
            raise wrong from None
        if have.powers != want.powers:
            raise wrong
        factor = have.size / want.size
    what = f"force through the cross-section normal to {axis}"
    return _called("section_force", force * factor, axis, label, what, f"integral of {name} over the section")


def _called(name, values, axis, units, what, comment):
    """(…, axis, i) with its name, unit and sign."""
    out = values.transpose(..., axis, "i").assign_coords(i=["x", "y", "z"])
    out.name = name
    sign = f"component {axis} positive in tension"
    out.attrs = {"units": units, "long_name": what, "sign_convention": sign, "comment": comment}
    return out


def section_stress(ds, axis=None, quantity=None, bulk=None):
    """Net section stress: the force through each cross-section over the area of matter there.

    The area is the mass of a section over that of as much bulk, ∫ρ dA / ρ_bulk, whatever the kernel smears: holes,
    necks and vacuum around a wire count by what is not there.

    Parameters
    ----------
    ds : output of `atc.fields` with a stress and ``density`` (or ``number_density``) on a slab profile, or on a regular
        grid whose edges run along x, y and z
    axis : "x", "y" or "z", the normal of the sections; default that of the profile
    quantity : which stress; default ``stress``, else ``stress_potential``
    bulk : density of the bulk, in the unit of the output's. Default on a regular grid: the median of where it is more
        than half of nearly its largest value.

    Returns
    -------
    xarray.DataArray with dims (…, axis, i): component i of the force over the area, in the unit of the stress, tension
    positive along the normal; NaN where there is less than a fiftieth of the largest section's matter.

    Raises
    ------
    AtcError without a density, for a profile without `bulk`, for other grids, and for species apart.
    """
    name, axis, dims, place = _sections(ds, axis, quantity, "section stress")
    mass = next((n for n in ("density", "number_density") if n in ds), None)
    if mass is None:
        raise AtcError("section stress: the output has no density: ask for quantities stress and density")
    if "species" in ds[name].dims:
        raise AtcError("section stress: species share sections: add them up, .sum('species')")
    others = [] if place.kind in WHOLE else [d for d in dims if d != axis]
    rho = ds[mass].fillna(0.0)
    if bulk is None:
        if place.kind in WHOLE:
            raise AtcError("section stress: say the bulk's density, bulk=…: a profile does not know what is empty")
        there = rho.values[rho.values > 0.5 * np.percentile(rho.values, 99)]
        bulk = float(np.median(there)) if len(there) else np.nan
    if not bulk > 0:
        raise AtcError(f"section stress: the bulk's density must be a positive number, got {bulk!r}")
    share = rho.mean(others) / bulk
    through = ds[name].isel(i="xyz".index(axis), drop=True).rename(j="i").fillna(0.0).mean(others)
    stress = through / share.where(share > THINNEST * share.max())
    what = f"force over the area of matter in the cross-section normal to {axis}"
    comment = f"integral of {name} over that of {mass} in units of {bulk:.6g} {ds[mass].attrs.get('units', '')}"
    return _called("section_stress", stress, axis, ds[name].attrs.get("units", ""), what, comment)
