"""Cells of a lattice: whether they fill a periodic cell, and those that the surface of a region cuts: how much of them
is inside, and where its middle is."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from .regions import Region

#: Samples along an edge of a cell, by dimension.
SAMPLES = {1: 256, 2: 16, 3: 8}
AT_ONCE = 1 << 20
#: How far, in spacings, the edges of a periodic cell may be from whole numbers: rounding.
_SEAM = 1e-6
#: Samples of a region's volume.
_POINTS = 1 << 20


def require_fit(x_nc, cell: Cell, spacing: float, horizon: float, dimension: int) -> None:
    """Raise where a lattice goes on through a face of a periodic cell whose edge is no whole number of spacings: its
    cells would overlap there, or leave a gap, and the body would have another volume than its nodes.

    A body that stays further than the horizon from its own images has no such seam.
    """
    s = cell.fractional(x_nc)
    gap = (1.0 - np.ptp(s, axis=0)) * cell.heights
    through = cell.periodic & (np.arange(3) < dimension) & (gap <= horizon)
    edges = cell.vectors / spacing
    off = np.abs(edges - np.rint(edges)).max(axis=1)
    # Nodes a hair before the face are nearly those of its other side; those on it are found as equal places.
    double = (gap < 0.5 * spacing) & (gap > _SEAM * spacing)
    wrong = np.flatnonzero(through & ((off > _SEAM) | double))
    if not len(wrong):
        return
    k = int(wrong[0])
    said = f"a spacing of {spacing:g} does not divide the periodic cell's edge along {'xyz'[k]}"
    if not cell.orthogonal:
        raise AtcError(
            f"{said}, {np.round(cell.vectors[k], 10).tolist()}: the lattice would not meet its own image: take edges "
            "of whole spacings along x, y and z, or nodes from a file"
        )
    lengths = np.abs(np.diag(cell.vectors))
    rows = round(float(np.ptp(x_nc[:, k])) / spacing) + 1
    more = 100 * (rows * spacing / lengths[k] - 1)
    near = _spacings(lengths[through], spacing)
    raise AtcError(
        f"{said}, {lengths[k]:g}: {rows} rows of nodes take {abs(more):.3g} % {'more' if more > 0 else 'less'} than "
        "that; "
        + (
            f"nearest spacings that fit: {', '.join(f'{a:.10g}' for a in near)}"
            if near
            else "no spacing near it fits all periodic edges: take edges with a common part"
        )
    )


def _spacings(lengths, spacing) -> list[float]:
    """The nearest spacing below and above that divides all these lengths, between half and twice the given one."""
    counts = np.arange(max(1, np.ceil(0.5 * lengths[0] / spacing)), np.floor(2.0 * lengths[0] / spacing) + 1)
    fits = lengths[0] / counts
    rows = lengths / fits[:, None]
    fits = fits[(np.abs(rows - np.rint(rows)) <= _SEAM).all(axis=1)]
    return [float(f) for part, pick in ((fits[fits < spacing], max), (fits[fits > spacing], min)) if len(part)
            for f in [pick(part)]]  # fmt: skip


def volume_of(region: Region, x_nc, dimension: int, cell: Cell | None = None) -> float:
    """Volume (area, length) of what of a bounded region lies in a cell along its periodic axes, by a million samples:
    of a box exact. `x_nc` : its nodes, for the coordinates that a body of less than three dimensions has not."""
    lo, hi = (np.array(b, float) for b in region.bounds)
    periodic = np.zeros(3, bool) if cell is None else cell.periodic & (np.arange(3) < dimension)
    if periodic.any() and cell.orthogonal:
        ends = np.sort([cell.origin, cell.origin + np.diag(cell.vectors)], axis=0)
        lo, hi = np.where(periodic, np.maximum(lo, ends[0]), lo), np.where(periodic, np.minimum(hi, ends[1]), hi)
        periodic[:] = False
    size = (hi - lo)[:dimension]
    if not (size > 0).all():
        return 0.0
    n = np.maximum(1, np.rint(size * (_POINTS / size.prod()) ** (1 / dimension))).astype(int)
    axes = [a + (np.arange(m) + 0.5) / m * length for a, m, length in zip(lo, n, size)]
    count = 0
    for x in np.array_split(axes[0], min(n[0], 16)):
        part = np.stack(np.meshgrid(x, *axes[1:], indexing="ij"), axis=-1).reshape(-1, dimension)
        points = np.tile(x_nc[0], (len(part), 1))
        points[:, :dimension] = part
        inside = region.contains(points)
        if periodic.any():
            s = cell.fractional(points)
            inside &= np.where(periodic, (s >= 0) & (s < 1), True).all(axis=1)
        count += int(inside.sum())
    return float(size.prod() * count / n.prod())


def cut_cells(x_nc, region: Region, spacing: float, dimension: int, cell: Cell | None = None):
    """Middles (m, 3) and shares (m,) of the parts inside the region of cells around the points of a lattice.

    Parts of less than half a cell go to that neighbour across a face, of half a cell or more, which has the largest;
    without one they stay. Along the axes on which `cell` is periodic, cells reach through its faces, and points outside
    of it are left out.
    """
    periodic = np.zeros(3, bool) if cell is None else np.asarray(cell.periodic, bool)

    def inside(x):
        if periodic.any():
            s = cell.fractional(x)
            x = x - np.where(periodic, np.floor(s + 1e-9), 0.0) @ cell.vectors
        return region.contains(x)

    if periodic.any():
        s = cell.fractional(x_nc)
        x_nc = x_nc[np.where(periodic, (s > -1e-9) & (s < 1 - 1e-9), True).all(axis=1)]

    def shares(centre_nc, steps):
        """Share inside and middle of it, by samples at `steps` (in spacings) along each axis."""
        sample = np.zeros((len(steps) ** dimension, 3))
        sample[:, :dimension] = list(product(steps * spacing, repeat=dimension))
        share, middle = np.zeros(len(centre_nc)), centre_nc.copy()
        size = max(1, AT_ONCE // len(sample))
        for a in range(0, len(centre_nc), size):
            x = centre_nc[a : a + size, None] + sample
            hit = inside(x.reshape(-1, 3)).reshape(x.shape[:2])
            count = hit.sum(axis=1)
            share[a : a + size] = count / len(sample)
            some = count > 0
            off = (hit[some, :, None] * sample).sum(axis=1) / count[some, None]
            middle[a : a + size][some] += off
        return share, middle

    # Corners a hair inward: a surface along the faces of cells cuts none of them.
    share, middle = shares(x_nc, np.linspace(-0.5 + 1e-6, 0.5 - 1e-6, 5))
    whole = share == 1.0
    middle[whole] = x_nc[whole]
    q = SAMPLES[dimension]
    partly = np.flatnonzero(~whole & (share > 0))
    share[partly], middle[partly] = shares(x_nc[partly], (np.arange(q) + 0.5) / q - 0.5)
    _join(x_nc, share, middle, spacing, dimension, cell if periodic.any() else None)
    kept = share > 0
    return np.ascontiguousarray(middle[kept]), share[kept]


def _join(x_nc, share, middle, spacing, dimension, cell):
    """Small parts to their neighbours, in place."""
    from scipy.spatial import cKDTree

    large = np.flatnonzero(share >= 0.5)
    small = np.flatnonzero((share > 0) & (share < 0.5))
    if not len(large) or not len(small):
        return
    tree = cKDTree(x_nc[large])
    best, to, shift = np.zeros(len(small)), np.full(len(small), -1), np.zeros((len(small), 3))
    for step in np.vstack([np.eye(3)[:dimension], -np.eye(3)[:dimension]]) * spacing:
        there = x_nc[small] + step
        back = np.zeros_like(there)
        if cell is not None:
            back = np.where(cell.periodic, np.floor(cell.fractional(there) + 1e-9), 0.0) @ cell.vectors
        distance, k = tree.query(there - back, distance_upper_bound=1e-3 * spacing)
        found = np.isfinite(distance)
        value = np.where(found, share[large[np.where(found, k, 0)]], 0.0)
        better = value > best
        best[better], to[better], shift[better] = value[better], large[k[better]], back[better]
    moved = to >= 0
    small, to, shift = small[moved], to[moved], shift[moved]
    weight, moment = share.copy(), share[:, None] * middle
    np.add.at(weight, to, share[small])
    np.add.at(moment, to, share[small, None] * (middle[small] - shift))
    middle[to] = moment[to] / weight[to, None]
    share[to] = weight[to]
    share[small] = 0.0
