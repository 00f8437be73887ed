"""Sums of a frame's atoms at points, exactly, with their gradients; which points are looked at."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError


class Sites:
    """The atoms and images within reach of points: Σ a φ and its gradient as sparse matrices.

    x_gc are the points; sums are exact, over all periodic images.
    """

    def __init__(self, x_gc, x_nc, cell, kern, margin: float = 0.0):
        from scipy.sparse import csr_matrix

        reach = kern.support + margin
        s_n = cell.fractional(x_nc)
        s_n -= np.where(cell.periodic, np.floor(s_n), 0.0)
        point, atom, d = [], [], []
        counts = np.where(cell.periodic, np.floor(reach / cell.heights + 0.5), 0).astype(int)
        images = np.stack(np.meshgrid(*[np.arange(-c, c + 1) for c in counts], indexing="ij"), -1).reshape(-1, 3)
        for g, s_g in enumerate(cell.fractional(x_gc)):
            s = s_n - s_g
            s -= np.where(cell.periodic, np.rint(s), 0.0)
            for image in images:
                t = s + image
                near = np.flatnonzero((np.abs(t) * cell.heights <= reach).all(1))
                r = t[near] @ cell.vectors
                inside = (r * r).sum(1) <= reach * reach
                point.append(np.full(inside.sum(), g))
                atom.append(near[inside])
                d.append(r[inside])
        shape = (len(x_gc), len(x_nc))
        point, atom = np.concatenate(point or [[]]).astype(int), np.concatenate(atom or [[]]).astype(int)
        d = np.concatenate(d) if d else np.zeros((0, 3))
        phi, slope = kern.phi(d), kern.grad_phi(d)
        self.phi = csr_matrix((phi, (point, atom)), shape)
        # with respect to the point: minus that with respect to d = x_j − x
        self.gradient = [csr_matrix((-slope[:, c], (point, atom)), shape) for c in range(3)]
        self.kink_g = np.full(len(x_gc), np.inf)
        np.minimum.at(self.kink_g, point, kern.kink_distance(d))

    def sum(self, a_n) -> np.ndarray:
        """(g, ...) Σ a φ."""
        return (self.phi @ a_n.reshape(len(a_n), -1)).reshape(-1, *a_n.shape[1:])

    def grad(self, a_n) -> np.ndarray:
        """(g, 3, ...) ∂_µ Σ a φ."""
        flat = a_n.reshape(len(a_n), -1)
        return np.stack([(m @ flat).reshape(-1, *a_n.shape[1:]) for m in self.gradient], axis=1)

    def div(self, a_nc) -> np.ndarray:
        """(g, ...) ∂_µ Σ a^µ φ for a (n, 3, ...)."""
        return sum(
            (m @ a_nc[:, c].reshape(len(a_nc), -1)).reshape(-1, *a_nc.shape[2:]) for c, m in enumerate(self.gradient)
        )


#: Points with less than this share of the typical density are taken for empty.
_EMPTY = 0.05


def choose_points(frame, kern, count: int, rng, bound=None) -> tuple[np.ndarray, int]:
    """`count` random points where there is matter and, from `bound` (a grid in this frame), as many of its points.

    Points whose stencils would touch a kink of the kernel are not taken.

    Returns
    -------
    (g, 3) points, the random ones first, and how many of them are random.
    """
    clear = 5.0 * kern.difference_step
    typical = float(frame.masses.mean()) * len(frame) / frame.cell.volume
    first = Sites(
        frame.positions[rng.choice(len(frame), min(len(frame), 20), replace=False)], frame.positions, frame.cell, kern
    )
    typical = min(typical, float(np.median(first.sum(frame.masses))))  # the whole cell may be mostly empty

    def fit(x_gc, want):
        if not len(x_gc):
            return x_gc
        sites = Sites(x_gc, frame.positions, frame.cell, kern, margin=clear)
        good = (sites.kink_g > clear) & (sites.sum(frame.masses) > _EMPTY * typical)
        return x_gc[good][:want]

    found = []
    for _ in range(20):
        missing = count - sum(map(len, found))
        if missing <= 0:
            break
        u = rng.normal(size=(2 * missing + 4, 3))
        if frame.dimension == 2:
            u[:, 2] = 0.0
        u *= (0.5 * kern.radius * rng.random(len(u)) ** (1 / frame.dimension) / np.sqrt((u * u).sum(1)))[:, None]
        found.append(fit(frame.positions[rng.integers(len(frame), size=len(u))] + u, missing))
    n = sum(map(len, found))
    if bound is not None and bound.kind != "slab":
        some = (
            rng.permutation(len(bound))[: 8 * count] if len(bound) < 10**6 else rng.integers(len(bound), size=8 * count)
        )
        found.append(fit(bound.relative_points_gc[some] + frame.cell.origin, count))
    x_gc = np.concatenate(found) if found else np.zeros((0, 3))
    if not len(x_gc):
        raise AtcError(
            f"{frame.source}: found no point in the matter that keeps clear of the kernel's kinks: take another "
            "kernel or radius"
        )
    return x_gc, n
