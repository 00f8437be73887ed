"""Cylindrical and spherical grids: points around an axis or a centre, vectors and tensors in the local axes there.

Points lie in the middle of bins of equal width in r, of equal angle, and (spheres) of equal area in θ: uniform in
cos θ. So plain means over the angles are means over circles, cylinders and spheres.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from . import checks

#: kind: names of the local axes, which are the grid's dimensions
AXES = {"cylindrical": ("r", "phi", "z"), "spherical": ("r", "theta", "phi")}


def checked(kind, *, center, radius, inner, shape, axis, length) -> dict:
    """The parameters of such a grid. AtcError for what cannot be meant."""
    out = {"center": None, "axis": axis, "shape": checks.counts(f"{kind} grid shape", shape, 3), "length": None}
    out["radius"], out["inner"] = (
        float(checks.numbers(f"{kind} grid {k}", v, ())) for k, v in (("radius", radius), ("inner", inner))
    )
    if not 0 <= out["inner"] < out["radius"]:
        raise AtcError(f"{kind} grid: expected 0 <= inner < radius, got inner {inner!r}, radius {radius!r}")
    if center is not None:
        out["center"] = checks.numbers(f"{kind} grid center", center, (3,))
    if length is not None:
        out["length"] = float(checks.numbers(f"{kind} grid length", length, ()))
        if out["length"] <= 0:
            raise AtcError(f"{kind} grid length {length!r}: expected a length greater than 0")
    return out


def settled(kind, p, units, cell) -> dict:
    """The same with the centre and the length that the first frame gives."""
    out = dict(p)
    if p["center"] is None:
        out["center"] = units.to_user("length", cell.cartesian(np.full((1, 3), 0.5))[0])
    if kind == "cylindrical" and p["length"] is None:
        # along the axis from face to face
        out["length"] = float(units.to_user("length", abs(cell.vectors[:, p["axis"]]).sum()))
    return out


def points(kind, p, factor) -> tuple[np.ndarray, np.ndarray, dict]:
    """(g, 3) positions, (g, 3, 3) local axes as rows, and the coordinates of the dimensions, lengths times `factor`."""
    e3 = np.eye(3)[p["axis"]]
    e1, e2 = np.eye(3)[(p["axis"] + 1) % 3], np.eye(3)[(p["axis"] + 2) % 3]
    center = p["center"] * factor
    n = p["shape"]
    r = (p["inner"] + (np.arange(n[0]) + 0.5) / n[0] * (p["radius"] - p["inner"])) * factor
    if kind == "cylindrical":
        phi = 2.0 * np.pi * (np.arange(n[1]) + 0.5) / n[1]
        z = ((np.arange(n[2]) + 0.5) / n[2] - 0.5) * p["length"] * factor
        R, P, Z = (a.ravel() for a in np.meshgrid(r, phi, z, indexing="ij"))
        out = _unit(e1, e2, P)
        around = _unit(e2, -e1, P)
        xyz = center + R[:, None] * out + Z[:, None] * e3
        basis = np.stack([out, around, np.broadcast_to(e3, out.shape)], axis=1)
        return xyz, basis, {"r": r, "phi": np.degrees(phi), "z": z + center[p["axis"]]}
    cos = 1.0 - 2.0 * (np.arange(n[1]) + 0.5) / n[1]
    phi = 2.0 * np.pi * (np.arange(n[2]) + 0.5) / n[2]
    R, C, P = (a.ravel() for a in np.meshgrid(r, cos, phi, indexing="ij"))
    S = np.sqrt(1.0 - C * C)
    flat = _unit(e1, e2, P)
    out = S[:, None] * flat + C[:, None] * e3
    down = C[:, None] * flat - S[:, None] * e3
    around = _unit(e2, -e1, P)
    return center + R[:, None] * out, np.stack([out, down, around], axis=1), {
        "r": r, "theta": np.degrees(np.arccos(cos)), "phi": np.degrees(phi)}  # fmt: skip


def _unit(a, b, angle):
    return np.cos(angle)[:, None] * a + np.sin(angle)[:, None] * b


def in_local_axes(x, basis_gcc, rank: int) -> np.ndarray:
    """(g, …) vectors or tensors in local axes from Cartesian ones."""
    if rank == 1:
        return np.einsum("gac,gc->ga", basis_gcc, x)
    if rank == 2:
        return np.einsum("gac,gcd,gbd->gab", basis_gcc, x, basis_gcc)
    return x
