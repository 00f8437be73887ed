"""Damage of both sides on one grid: bonds that the reference had and the run has no more."""

from __future__ import annotations

import numpy as np

from ..estimators.tensors import quotient
from ..neighbors.cell_list import neighbor_list
from .same_crystal import shells
from .smoothing import Smoothing

#: Heights within a period of the crystal at which the bonds that a plane cuts are counted.
_HEIGHTS = 400


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
        self.reference, self.crystal = reference, crystal
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

    def area_b(self, normal, axes_cc) -> np.ndarray:
        """(b,) area of a plane with this normal that each bond stands for: see `areas_of`. axes_cc : (3, 3) rows, where
        the crystal's axes point in the run."""
        from scipy.spatial import cKDTree

        r_tc, area_t = areas_of(self.crystal.strained(np.asarray(axes_cc).T - np.eye(3)), normal, self.longest)
        return area_t[cKDTree(r_tc).query(self.r_bc)[1]]

    def share(self, gone_b) -> np.ndarray:
        """(n,) share of each atom's bonds that these are."""
        n = len(self.reference)
        return (np.bincount(self.i, gone_b, n) + np.bincount(self.j, gone_b, n)) / np.maximum(self.count_n, 1)

    def lost(self, frame) -> np.ndarray:
        """(n,) share of each atom's bonds that are longer now."""
        return self.share(self.gone(frame))


def areas_of(crystal, normal, longest):
    """Bonds of a crystal up to a length, and the area of a plane with this normal that each stands for, so that those
    which any plane across the perfect crystal cuts have its area together.

    A plane at the height s cuts N(s) bonds per area, and not the same number everywhere: in diamond one for each atom
    of a layer between double layers along [111], three within one. A bond's area is the mean of 1/N over the heights
    that it spans; of a bond that lies in the plane, one over the mean of N.

    Returns
    -------
    r_tc : (t, 3) bond vectors, each way. area_t : (t,)
    """
    n, vectors = len(crystal), crystal.vectors
    steps = np.arange(-3, 4)
    images = np.stack(np.meshgrid(steps, steps, steps if crystal.dimension == 3 else [0], indexing="ij"), axis=-1)
    x = crystal.positions
    r = (x[None, :, None] - x[:, None, None] + images.reshape(-1, 3) @ vectors).reshape(-1, 3)
    from_ = np.repeat(np.arange(n), len(r) // n)
    near = (np.linalg.norm(r, axis=1) > 1e-9 * longest) & (np.linalg.norm(r, axis=1) <= longest)
    r, up = r[near], r[near] @ normal
    low, span = x[from_[near]] @ normal + np.minimum(up, 0.0), np.abs(up)
    mean = 0.5 * span.sum() / crystal.volume  # each bond is there each way
    area = np.full(len(r), 1 / mean)
    period = 0.0
    for a in np.abs(vectors @ normal):
        while a > 1e-4 * longest:
            period, a = a, period % a
    if period > 0.01 * longest:
        s = (np.arange(_HEIGHTS) + 0.5) / _HEIGHTS * period
        lower, upper = (np.floor((s[:, None] - h) / period) for h in (low, low + span))
        each = crystal.volume / period / (0.5 * (lower - upper).sum(axis=1))
        total = np.concatenate([[0.0], np.cumsum(each)]) * period / _HEIGHTS
        edges = np.linspace(0, period, _HEIGHTS + 1)
        upto = lambda h: np.floor(h / period) * total[-1] + np.interp(h % period, edges, total)  # noqa: E731
        across = span > 1e-6 * longest
        area[across] = (upto(low + span) - upto(low))[across] / span[across]
    return r, area


def on_grid(frame, kernel, points_gc, damage_n) -> np.ndarray:
    """(g,) Σ m d φ/Σ m φ of atoms or nodes; NaN where there are none."""
    s = Smoothing(frame, kernel, points_gc)
    return quotient(s.weights_gn @ (frame.masses * damage_n), s.density_g)


def add_damage(data, md, pd, share, carried=False) -> None:
    """md_damage, pd_damage and their difference into a dataset, from one array a frame; and the mean of both over the
    body: `share`, (frames, 2). `carried` : whether the twin's bonds are those of atoms too."""
    dims = data["md_density"].dims
    shape = data["md_density"].shape
    for side, values in (("md", md), ("pd", pd)):
        data[f"{side}_damage"] = (dims, np.array(values).reshape(shape), {"units": "1"})
    data["md_damage"].attrs["long_name"] = "share of the reference's nearest-neighbour bonds that are lost, MD"
    what = "nearest-neighbour bonds that are lost" if carried else "families that is broken"
    data["pd_damage"].attrs["long_name"] = f"share of the reference's {what}, PD"
    data["difference_damage"] = data["pd_damage"] - data["md_damage"]
    data["difference_damage"].attrs = {"units": "1", "long_name": "PD - MD, damage"}
    for k, side in enumerate(("md", "pd")):
        data[f"{side}_damage_of_body"] = ("frame", np.array(share)[:, k], {"units": "1"})
