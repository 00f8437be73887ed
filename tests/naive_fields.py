"""Slow twins of the two sums, a checkable line at a time: every image, every atom, every bond, at every point."""

import itertools

import numpy as np

from atc.bonds import Bonds
from atc.contracts import Interactions


def images(cell, reach):
    """Lattice translations that bring anything within `reach` of the cell, for content and points inside it."""
    counts = [int(np.floor(reach / h + 1)) if p else 0 for h, p in zip(cell.heights, cell.periodic)]
    return [np.array(n) @ cell.vectors for n in itertools.product(*(range(-c, c + 1) for c in counts))]


def site_sum(points_gc, x_nc, a_nk, kern, cell):
    """Σ_j a_j φ(x − x_j) over all atoms and their images, (g, k)."""
    points, x = cell.wrap(points_gc)[0], cell.wrap(x_nc)[0]
    d = x[None] - points[:, None]
    return sum(kern.phi(d + shift) @ a_nk for shift in images(cell, kern.support))


def bond_sum(points_gc, x_bc, r_bc, b_bk, kern, cell):
    """Σ_bonds b β(x) over all bonds and their images, (g, k); bonds run from x to x − r."""
    points, x = cell.wrap(points_gc)[0], cell.wrap(x_bc)[0]
    out = np.zeros((len(points), b_bk.shape[1]))
    longest = np.linalg.norm(r_bc, axis=1).max(initial=0.0)
    for shift in images(cell, kern.support + longest):
        for g, p in enumerate(points):
            d = x + shift - p
            near = (d * d).sum(1) < (kern.support + longest) ** 2  # the others are 0
            out[g] += kern.beta(d[near], r_bc[near]) @ b_bk[near]
    return out


def lj_bonds(x_nc, cell, epsilon, sigma, cutoff):
    """Lennard-Jones bonds by brute force over images, and the forces (n, 3) and energies (n,) (half of each pair)."""
    n = len(x_nc)
    x = cell.wrap(x_nc)[0]
    parts, e, forces = [Bonds.empty()], np.zeros(n), np.zeros((n, 3))
    a, b = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    for shift in images(cell, cutoff) if n else []:
        d = x[:, None] - x[None] - shift
        d2 = (d**2).sum(-1)
        # each bond once: a < b, or half of the images of an atom with itself
        take = (d2 < cutoff**2) & ((a < b) | ((a == b) & (tuple(shift) > (0.0, 0.0, 0.0))))
        i, j = np.nonzero(take)
        s6 = (sigma**2 / d2[take]) ** 3
        G = -24 * epsilon * (2 * s6**2 - s6) / d2[take]
        r = d[take]
        np.add.at(forces, i, -G[:, None] * r)
        np.add.at(forces, j, G[:, None] * r)
        for end in (i, j):
            np.add.at(e, end, 0.5 * 4 * epsilon * (s6**2 - s6))
        parts.append(Bonds(i.astype(np.int32), j.astype(np.int32), r, G))
    return Bonds.concatenate(parts), forces, e


class BruteLJ(Interactions):
    """A potential with the interface of `atc.potential`'s, by brute force; counts its calls."""

    def __init__(self, epsilon=0.0104, sigma=3.4, cutoff=5.0, units="metal"):
        from atc.units import units as unit_system

        self.units = unit_system(units)
        self.parameters = epsilon, sigma, cutoff
        self.cutoff = cutoff
        self.calls = []

    def describe(self):
        return f"brute lj {self.parameters}"

    def evaluate(self, frame):
        """Bonds, forces and energies of a frame."""
        return lj_bonds(frame.positions, frame.cell, *self.parameters)

    def stream(self, frame, consume=None, *, threads=1, energies=False, forces=False, sources=False):
        from atc.decomposers.base import Decomposition

        self.calls.append({"energies": energies, "forces": forces, "sources": sources, "threads": threads})
        bonds, F_nc, e_n = self.evaluate(frame)
        if consume is not None:
            # Unequal chunks on different threads, as a real potential gives them.
            cuts = np.linspace(0, len(bonds), 4).astype(int) ** 2 // max(len(bonds), 1)
            for k, (a, b) in enumerate(itertools.pairwise(cuts)):
                r, G = bonds.r_bc[a:b], bonds.G_b[a:b]
                # half of the energy belongs to each end
                D = np.stack([-0.5 * G[:, None] * r, 0.5 * G[:, None] * r], axis=1) if sources else None
                consume(Bonds(bonds.i[a:b], bonds.j[a:b], r, G, D), k % threads)
        return Decomposition(
            float(e_n.sum()), bonds.virial(), e_n if energies else None, F_nc if forces else None, n_bonds=len(bonds)
        )
