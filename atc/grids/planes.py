"""Planes across the cell, whole or cut into patches, through which fluxes are counted: no kernel, no points in between
(the method of planes; Todd, Evans & Daivis, Phys. Rev. E 52 (1995) 1627).
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from . import checks

#: Planes lie this share of the cell's height lower than they are said to: atoms on a plane, to rounding, are above it.
BELOW = 1e-9
#: The interval that is not a time.
BY_FRAMES = "frames"


def through_planes(grid) -> bool:
    """Whether sums on this grid are counted, without a kernel."""
    return grid is not None and grid.counts_crossings


def by_frames(grid) -> bool:
    """Whether atoms are seen to pass from the frame before to this one, not by their velocities."""
    return grid._["interval"] == BY_FRAMES


def checked(*, axis, positions, n, shift, patches, interval) -> dict:
    """The parameters of such a grid. AtcError for what cannot be meant."""
    if (positions is None) == (n is None):
        raise AtcError("planes: give either their positions or n, how many there are over the cell")
    out: dict = {"axis": axis, "positions": None, "n": None, "shift": shift, "patches": None, "interval": None}
    if n is None:
        at = checks.numbers("positions of planes", positions, (None,))
        if not len(at) or (np.diff(at) <= 0).any():
            raise AtcError(f"positions of planes: expected one or more, ascending, got {positions!r}")
        out["positions"] = at
    else:
        (out["n"],) = checks.counts("number of planes", n, 1)
    if patches is not None:
        out["patches"] = checks.counts("patches of a plane", patches, 2)
    if isinstance(interval, str):
        if interval != BY_FRAMES:
            raise AtcError(f'interval {interval!r}: expected a time, or "frames" (from the frame before to this one)')
        out["interval"] = interval
    elif interval is not None:
        out["interval"] = float(checks.numbers("interval of planes", interval, ()))
        if out["interval"] <= 0:
            raise AtcError(f"interval {interval!r}: expected a time greater than 0")
    return out


def described(p) -> str:
    """One line for reports."""
    many = p["n"] or len(p["positions"])
    text = f"planes normal to {'xyz'[p['axis']]}, {many}"
    if p["patches"]:
        text += f", each of {p['patches'][0]} x {p['patches'][1]} patches"
    if p["interval"] == BY_FRAMES:
        return text + ", crossed from frame to frame"
    return text + (f", crossings counted over {p['interval']:g}" if p["interval"] else "")


def bound(p, cell, factor) -> dict:
    """The planes in a cell: xyz (g, 3) their middles, or those of their patches; dims, counts; along, the coordinates;
    shares_p, where they are along the cell's edge; internal units, lengths times `factor`."""
    a, height = p["axis"], cell.heights[p["axis"]]
    normal = cell.inverse[:, a] * height
    # Orthogonal cells: the coordinate itself; else the distance from the cell's lower face.
    zero = cell.origin[a] if cell.orthogonal and normal[a] > 0 else 0.0
    if p["n"] is None:
        along = p["positions"] * factor
        shares_p = (along - zero) / height
    else:
        shares_p = (np.arange(p["n"]) + p["shift"]) / p["n"]
        along = zero + shares_p * height
    others = [k for k in range(3) if k != a]
    patches = p["patches"] or ()
    dims: tuple[str, ...] = ("xyz"[a],)
    counts = (len(shares_p), *patches)
    middles = [(np.arange(m) + 0.5) / m for m in patches] or [np.array([0.5])] * 2
    values = {"xyz"[a]: along}
    if patches:
        dims += tuple("xyz"[k] for k in others)
        for k, s in zip(others, middles):
            start = cell.origin[k] if cell.orthogonal else 0.0
            values["xyz"[k]] = start + s * np.linalg.norm(cell.vectors[k])
    s = np.zeros((len(shares_p), *(len(m) for m in middles), 3))
    s[..., a] = shares_p[:, None, None]
    s[..., others[0]], s[..., others[1]] = middles[0][:, None], middles[1]
    return {
        "xyz": np.ascontiguousarray(cell.cartesian(s.reshape(-1, 3))),
        "dims": dims, "counts": counts, "along": values, "shares_p": shares_p,
    }  # fmt: skip
