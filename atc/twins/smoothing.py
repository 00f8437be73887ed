"""Sums over atoms with the localisation function φ at points of the reference: density, displacement, velocity."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import AtcError
from ..estimators.tensors import quotient


class Smoothing:
    """Weights φ(X − X_j) of the atoms of a frame at given points, through its periodic images.

    Parameters
    ----------
    frame : Frame, the reference
    kernel : of lengths in internal units
    points_gc : (g, 3) internal units
    """

    def __init__(self, frame, kernel, points_gc):
        from scipy.sparse import csr_array
        from scipy.spatial import cKDTree

        frame.require("masses", why="a smoothed displacement")
        x_nc, atom_n = with_images(frame, kernel.support)
        near = cKDTree(x_nc).query_ball_point(points_gc, kernel.support * (1 + 1e-9), return_sorted=True)
        counts = np.array([len(a) for a in near], np.int64)
        found = np.concatenate([np.asarray(a, np.int64) for a in near]) if counts.sum() else np.zeros(0, np.int64)
        phi = kernel.phi(x_nc[found] - np.repeat(points_gc, counts, axis=0))
        start = np.concatenate([[0], np.cumsum(counts)])
        # One atom may come twice, through two images: entries of the same place add up.
        self.weights_gn = csr_array((phi, atom_n[found], start), shape=(len(points_gc), len(frame)))
        self.mass_n = frame.masses
        self.density_g = self.weights_gn @ frame.masses

    def mean(self, a_nc) -> np.ndarray:
        """(g, 3) mass-weighted mean Σ m a φ / Σ m φ."""
        if not (self.density_g > 0).all():
            raise AtcError(
                "no atom of the reference is within the kernel's radius of some node: take a larger kernel radius"
            )
        return (self.weights_gn @ (self.mass_n[:, None] * a_nc)) / self.density_g[:, None]

    def share(self, chosen_n) -> np.ndarray:
        """(g,) share of the smoothed mass that belongs to the chosen atoms."""
        mine = self.weights_gn @ np.where(chosen_n, self.mass_n, 0.0)
        return quotient(mine, self.density_g)


class Same:
    """In the place of a `Smoothing` where the nodes are the atoms: nothing is smoothed."""

    def __init__(self, frame):
        frame.require("masses", why="the nodes' masses")

    def mean(self, a_nc) -> np.ndarray:
        return np.array(a_nc, float)

    def share(self, chosen_n) -> np.ndarray:
        return np.asarray(chosen_n, float)


def with_images(frame, reach):
    """Positions of all atoms and of their periodic images within `reach` of the cell, and whose image each one is."""
    cell = frame.cell
    x, _ = cell.wrap(frame.positions)
    s, margin = cell.fractional(x), reach / cell.heights
    whole = np.where(cell.periodic, np.ceil(margin), 0).astype(int)
    places, atoms = [], []
    for shift in product(*(range(-w, w + 1) for w in whole)):
        t = s + shift
        inside = (((t >= -margin) & (t <= 1 + margin)) | ~cell.periodic).all(axis=1)
        places.append(x[inside] + np.array(shift) @ cell.vectors)
        atoms.append(np.flatnonzero(inside))
    return np.concatenate(places), np.concatenate(atoms)
