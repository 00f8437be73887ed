"""Grids of two-dimensional runs: points of two numbers, one layer in the plane of the atoms."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


def layers(shape, flat: bool):
    """Three numbers of points: of one layer if `flat`. See `checks.shape_or_spacing` for what 0 and less mean."""
    if shape is None:
        return None
    n = shape[-1]
    two = " x ".join(map(str, shape[:2]))
    if flat and n > 1:
        why = f"in two dimensions a regular grid has one layer: give two numbers, e.g. {list(shape[:2])}"
        raise AtcError(f"grid shape {two} x {n}: {why}")
    if not flat and n == 0:
        raise AtcError(f"grid shape {two}: two numbers are a grid of a two-dimensional run: give three")
    return (*shape[:2], 1 if flat else abs(n))


def in_space(z, units, what, points):
    """Points that were given by two numbers or three, in the plane z (None: three dimensions, as they are); an error
    for points off the plane."""
    if z is None:
        return points
    at = np.where(np.isnan(points[..., 2]), z, points[..., 2])
    # 1e-9: vectors that went through another unit system differ by rounding.
    near = 1e-9 * max(1.0, float(np.abs(np.nan_to_num(points)).max(initial=0.0)))
    off = np.flatnonzero(np.abs(np.atleast_1d(at) - z) > near)
    if len(off):
        bad, plane = (units.to_user("length", float(v)) for v in (np.atleast_1d(at)[off[0]], z))
        number = f" {off[0]}" if points.ndim > 1 else ""
        where = f"z = {bad:g}, off the plane z = {plane:g} {units.label('length')} of a two-dimensional run"
        raise AtcError(f"{what}{number} lies at {where}: give x and y only")
    out = points.copy()
    out[..., 2] = z
    return out


def directions(what, vectors, flat: bool):
    """Edge vectors, given by two numbers or three."""
    if not flat:
        return vectors
    out = vectors.copy()
    out[:, 2] = np.nan_to_num(out[:, 2])
    if np.abs(out[:, 2]).max() > 1e-9 * np.abs(out).max():
        raise AtcError(f"{what}: its edges leave the plane of a two-dimensional run: give two numbers for each")
    out[:, 2] = 0.0
    return out
