"""Grids and open faces: the kernel carries what atoms have beyond the faces of the cell, where the grid ends.

A cell that is shrink-wrapped around the atoms cuts off the outer half of each surface atom's kernel, and with it that
part of every integral over the grid (mass, section forces).
"""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..frame import Cell

#: A share of the mass beyond the grid that deserves a warning.
WORTH_A_WARNING = 0.01


def open_axes(kind, axis, cell: Cell, dimension: int = 3) -> list[int]:
    """The axes of the cell along which a grid that follows it ends at an open face."""
    axes = [axis] if kind == "slab" else [a for a in range(dimension) if kind == "regular" or a != axis]
    return [a for a in axes if not cell.periodic[a]]


def extended(cell: Cell, axes, padding: float) -> Cell:
    """The cell with its faces normal to these axes moved outward by a length (internal units)."""
    if not len(axes):
        return cell
    share = np.where(np.isin(range(3), axes), padding / cell.heights, 0.0)
    return Cell(cell.vectors * (1.0 + 2.0 * share)[:, None], cell.origin - share @ cell.vectors, cell.periodic)


def resolved(grid, kern, frame):
    """The grid with ``padding = "auto"`` replaced by a length in the user's units: the kernel's support if an atom of
    this frame is within reach of an open face, else 0.

    Raises
    ------
    AtcError : if there is no kernel
    """
    if grid is None or grid.padding != "auto":
        return grid
    if kern is None:
        raise AtcError('grid padding = "auto" is the reach of the kernel, but there is none: give a length')
    units = frame.units
    reach = units.to_internal("length", kern.support)
    cell = frame.cell if frame.cell.complete else frame.cell.completed(frame.positions)
    axes = open_axes(grid.kind, grid._.get("axis"), cell, units.dimension)
    d_nk = (cell.fractional(frame.positions) * cell.heights)[:, axes]
    near = len(frame) and bool(((d_nk < reach) | (cell.heights[axes] - d_nk < reach)).any())
    return type(grid)(grid.kind, {**grid._, "padding": float(kern.support) if near else 0.0})


def beyond(grid, kern, frame) -> tuple[float, str]:
    """The share of the mass (of the number of atoms, if there are no masses) that the kernel carries beyond the open
    faces where a grid over the cell ends, and the names of their axes.

    0 for grids that are no such grids. Axis by axis, with the kernel integrated over planes: exact for one open axis.
    """
    if grid is None or not grid.over_cell or not len(frame):
        return 0.0, ""
    bound = grid.bind(frame.units, frame.cell, frame.positions)
    cell, p = bound.cell, grid._
    axes = open_axes(grid.kind, p.get("axis"), cell, frame.units.dimension)
    if not axes:
        return 0.0, ""
    region = extended(cell, axes, p["padding"] * frame.units.length) if "padding" in p and grid.kind != "slab" else cell
    inside_n = np.ones(len(frame))
    for a in axes:
        normal = region.inverse[:, a] * region.heights[a]
        try:
            profile = kern.marginal(normal)
        except AtcError:  # a kernel that is not known over planes
            return 0.0, ""
        z_n = (frame.positions - region.origin) @ normal
        inside_n *= profile.cumulative(z_n) - profile.cumulative(z_n - region.heights[a])
    w_n = np.ones(len(frame)) if frame.masses is None else frame.masses
    share = float(1.0 - (inside_n @ w_n) / w_n.sum()) if w_n.sum() > 0 else 0.0
    return share, ", ".join("xyz"[a] for a in axes)


def warn_of_open_faces(grid, kern, frame) -> None:
    """An AtcWarning if a part of the mass that matters lies beyond the grid."""
    share, axes = beyond(grid, kern, frame)
    if share > WORTH_A_WARNING:
        warnings.warn(
            f"the grid ends at the open faces of the cell ({axes}), but the kernel carries {100 * share:.2g} % of the "
            'mass beyond them: integrals over the grid lack it, and section forces a like part; padding = "auto" in '
            "[grid] extends the grid by the reach of the kernel",
            AtcWarning,
            stacklevel=2,
        )
