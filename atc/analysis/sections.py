"""Forces through cross-sections: what a wire, a plate or a film carries.

F_j = ∫ σ_ij dA_i over the plane through each point of a grid along its normal i: of a slab profile, and of planes, the
average times the area of the cell, of a regular grid the sum over the points of a layer times the area of each
(quadrature: it converges as the grid resolves the kernel). A grid that ends at open faces lacks what the kernel carries
beyond them: padding.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


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
    from ..pictures.geometry import grid_dims, points_of_grid
    from ..unit_words import NotAUnit, unit_of
    from ..units import units

    name = quantity or next((n for n in ("stress", "stress_potential") if n in ds), None)
    if name is None or name not in ds or not {"i", "j"} <= {*ds[name].dims}:
        raise AtcError(f"section force: {name or 'stress'}: is no stress of this output")
    da = ds[name]
    dims = grid_dims(da.isel(species=0, drop=True) if "species" in da.dims else da)
    one = ds.isel(species=0, drop=True) if "species" in ds.dims else ds
    place = points_of_grid(one, one[name])
    if place.kind not in ("slab", "planes", "volume") or any(d not in "xyz" for d in dims):
        raise AtcError(
            f"section force: of a slab profile, planes, or a regular grid along x, y, z; this is a {place.kind}"
        )
    whole = place.kind in ("slab", "planes")
    axis = axis or (dims[0] if whole else None)
    if axis not in dims:
        raise AtcError(f"section force: axis {axis!r}: expected {' or '.join(dims)}")
    k = "xyz".index(axis)
    if whole:
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
    if u.reduced:
        factor = 1.0
    else:
        length = next(str(ds[c].attrs["units"]) for c in (axis, "cell") if "units" in ds[c].attrs)
        try:
            have, want = unit_of(f"({da.attrs['units']})*{length}^2"), unit_of(label)
        except NotAUnit:
            raise AtcError(
                f"section force: {name} is in {da.attrs.get('units')}, which is no unit of a stress"
            ) from None
        if have.powers != want.powers:
            raise AtcError(f"section force: {name} is in {da.attrs['units']}, which is no unit of a stress")
        factor = have.size / want.size
    out = (force * factor).transpose(..., axis, "i")
    out = out.assign_coords(i=["x", "y", "z"])
    out.name = "section_force"
    out.attrs = {
        "units": label,
        "long_name": f"force through the cross-section normal to {axis}",
        "sign_convention": f"component {axis} positive in tension",
        "comment": f"integral of {name} over the section",
    }
    return out
