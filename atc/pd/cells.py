"""Cells of a lattice that the surface of a region cuts: how much of them is inside, and where its middle is."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..frame import Cell
from .regions import Region

#: Samples along an edge of a cell, by dimension.
SAMPLES = {1: 256, 2: 16, 3: 8}
AT_ONCE = 1 << 20


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
