"""Slow twins of the two sums, a checkable line at a time: every image, every atom, every bond, at every point."""

import itertools

import numpy as np

from atc.bonds import Bonds


def images(cell, reach):
    """Lattice translations that can bring anything within `reach` of the cell's content (which may lie a cell outside)."""
    counts = [int(np.ceil(reach / h)) + 1 if p else 0 for h, p in zip(cell.heights, cell.periodic)]
    return [np.array(n) @ cell.vectors for n in itertools.product(*(range(-c, c + 1) for c in counts))]


def site_sum(points_gc, x_nc, a_nk, kern, cell):
    """Σ_j a_j φ(x − x_j) over all atoms and their images, (g, k)."""
    out = np.zeros((len(points_gc), a_nk.shape[1]))
    x = cell.wrap(x_nc)[0]
    for shift in images(cell, kern.support + np.linalg.norm(cell.vectors, axis=1).max()):
        for g, p in enumerate(points_gc):
            out[g] += kern.phi(x + shift - p) @ a_nk
    return out


def bond_sum(points_gc, x_bc, r_bc, b_bk, kern, cell):
    """Σ_bonds b β(x) over all bonds and their images, (g, k); bonds run from x to x − r."""
    out = np.zeros((len(points_gc), b_bk.shape[1]))
    x, n = cell.wrap(x_bc)
    longest = np.linalg.norm(r_bc, axis=1).max(initial=0.0)
    for shift in images(cell, kern.support + longest + np.linalg.norm(cell.vectors, axis=1).max()):
        for g, p in enumerate(points_gc):
            out[g] += kern.beta(x + shift - p, r_bc) @ b_bk
    return out


def lj_bonds(x_nc, cell, epsilon, sigma, cutoff):
    """Lennard-Jones bonds by brute force over images, and the forces (n, 3) and energies (n,) (half of each pair)."""
    i, j, r, G, e = [], [], [], [], np.zeros(len(x_nc))
    forces = np.zeros_like(x_nc)
    for shift in images(cell, cutoff + np.ptp(cell.fractional(x_nc), axis=0).max(initial=0.0) * np.linalg.norm(cell.vectors, axis=1).sum()):
        for a in range(len(x_nc)):
            for b in range(len(x_nc)):
                d = x_nc[a] - x_nc[b] - shift
                # each bond once: a < b, or the half of the images of an atom with itself
                if not (a < b or (a == b and tuple(shift) > (0.0, 0.0, 0.0))) or d @ d >= cutoff**2:
                    continue
                s6 = (sigma**2 / (d @ d)) ** 3
                g = -24 * epsilon * (2 * s6**2 - s6) / (d @ d)
                i.append(a), j.append(b), r.append(d), G.append(g)
                forces[a] -= g * d
                forces[b] += g * d
                e[[a, b]] += 0.5 * 4 * epsilon * (s6**2 - s6)
                if a == b:
                    e[a] += 0.5 * 4 * epsilon * (s6**2 - s6)
    return Bonds(np.array(i, np.int32), np.array(j, np.int32), np.array(r).reshape(-1, 3), np.array(G)), forces, e
