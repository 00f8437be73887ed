"""Damage of both sides on one grid: bonds that the reference had and the run has no more."""

from __future__ import annotations

import numpy as np

from ..estimators.tensors import quotient
from ..neighbors.cell_list import neighbor_list
from .same_crystal import shells
from .smoothing import Smoothing


class NearestBonds:
    """Bonds of a reference to its nearest neighbours. One is lost while it is longer than half-way to the second ones.

    Parameters
    ----------
    reference : Frame. crystal : Crystal, says how far neighbours are
    notches : `pd.Notch` objects: bonds across them are lost from the start
    """

    def __init__(self, reference, crystal, notches=()):
        first, second, _ = shells(crystal)
        self.longest = 0.5 * (first + second)
        self.i, self.j, self.r_bc, self.image = neighbor_list(reference.positions, reference.cell, self.longest)
        self.reference = reference
        self.cut = np.zeros(len(self.i), bool)
        for notch in notches:
            x_bc, vectors = reference.positions[self.i], reference.cell.vectors
            self.cut |= notch.crosses_periodic(x_bc, -self.r_bc, self.image, vectors)
        self.count_n = np.bincount(self.i, minlength=len(reference)) + np.bincount(self.j, minlength=len(reference))

    def gone(self, frame) -> np.ndarray:
        """(b,) which bonds are longer now."""
        from .conditions import displacement

        x = self.reference.positions + displacement(frame, self.reference)
        r = x[self.i] - x[self.j] - self.image @ frame.cell.vectors
        return self.cut | (np.einsum("bc,bc->b", r, r) > self.longest**2)

    def share(self, gone_b) -> np.ndarray:
        """(n,) share of each atom's bonds that these are."""
        n = len(self.reference)
        return (np.bincount(self.i, gone_b, n) + np.bincount(self.j, gone_b, n)) / np.maximum(self.count_n, 1)

    def lost(self, frame) -> np.ndarray:
        """(n,) share of each atom's bonds that are longer now."""
        return self.share(self.gone(frame))


def on_grid(frame, kernel, points_gc, damage_n) -> np.ndarray:
    """(g,) Σ m d φ/Σ m φ of atoms or nodes; NaN where there are none."""
    s = Smoothing(frame, kernel, points_gc)
    return quotient(s.weights_gn @ (frame.masses * damage_n), s.density_g)


def add_damage(data, md, pd, share) -> None:
    """md_damage, pd_damage and their difference into a dataset, from one array a frame; and the mean of both over the
    body: `share`, (frames, 2)."""
    dims = data["md_density"].dims
    shape = data["md_density"].shape
    for side, values in (("md", md), ("pd", pd)):
        data[f"{side}_damage"] = (dims, np.array(values).reshape(shape), {"units": "1"})
    data["md_damage"].attrs["long_name"] = "share of the reference's nearest-neighbour bonds that are lost, MD"
    data["pd_damage"].attrs["long_name"] = "share of the reference's families that is broken, PD"
    data["difference_damage"] = data["pd_damage"] - data["md_damage"]
    data["difference_damage"].attrs = {"units": "1", "long_name": "PD - MD, damage"}
    for k, side in enumerate(("md", "pd")):
        data[f"{side}_damage_of_body"] = ("frame", np.array(share)[:, k], {"units": "1"})
