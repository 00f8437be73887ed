"""Surface energies of a crystal: γ(hkl) = (U_slab − U_bulk)/2A, of the cheapest termination, without reconstruction.

Internal units.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from .crystal import Crystal, evaluate

#: Planes along which crystals cleave.
LOW_INDEX = ((1, 0, 0), (1, 1, 0), (1, 1, 1))


@dataclass
class Surface:
    """plane : (h, k, l). energy : γ relaxed, energy/area. unrelaxed : of the bulk cut in two. spacing : of the lattice
    planes"""

    plane: tuple
    energy: float
    unrelaxed: float
    spacing: float


def surface_energy(crystal: Crystal, model, plane, *, relaxed: bool = True) -> Surface:
    """γ of a lattice plane of the conventional cell.

    Parameters
    ----------
    crystal : Crystal at rest
    model : potential of `atc.potential` or an ASE calculator with a `cutoff`
    plane : (h, k, l)
    relaxed : whether the slab's atoms come to rest, cell by cell of the surface (no reconstruction)
    """
    vectors, height = _along(crystal, plane)
    area = np.linalg.norm(np.cross(vectors[0], vectors[1]))
    normal = np.cross(vectors[0], vectors[1]) / area
    reach = float(getattr(model, "cutoff", 0.0)) or 3 * height
    layers = int(np.ceil(3.0 * reach / height)) + 2
    bulk = evaluate(model, crystal.frame())[0]
    heights = crystal.positions @ normal / height
    heights -= np.floor(heights + 1e-9)
    found = []
    for cut in np.unique(np.round(heights, 6)):
        # Atoms below the cut go to the other side: a slab of whole cells that begins with this layer.
        below = heights < cut - 1e-6
        base = crystal.positions - np.outer(np.floor(crystal.positions @ normal / height + 1e-9), vectors[2])
        base = base + np.outer(below, vectors[2])
        x = (np.arange(layers)[:, None, None] * vectors[2] + base).reshape(-1, 3)
        thick = 2 * layers * height * normal
        cell = Cell(np.array([vectors[0], vectors[1], thick]), x.min(axis=0) - 0.5 * thick, (True, True, False))
        frame = crystal.copies(x, cell, f"{crystal.name} slab")
        cold = evaluate(model, frame)[0]
        warm = _at_rest(frame, model, cold) if relaxed else cold
        found.append(((warm - layers * bulk) / (2 * area), (cold - layers * bulk) / (2 * area)))
    energy, unrelaxed = min(found)
    return Surface(tuple(plane), float(energy), float(unrelaxed), float(height))


def cleavage(crystal: Crystal, model, planes=LOW_INDEX) -> Surface:
    """The surface of the smallest energy among some planes."""
    return min((surface_energy(crystal, model, p) for p in planes), key=lambda s: s.energy)


def _along(crystal, plane):
    """(3, 3) vectors of a primitive cell, the first two in the plane, and the height of the third."""
    g = np.linalg.inv(crystal.conventional) @ np.array(plane, float)
    normal = g / np.linalg.norm(g)
    n = np.array(list(product(range(-3, 4), repeat=3)))
    R = n @ crystal.vectors
    size, h = np.linalg.norm(R, axis=1), R @ normal
    flat = R[(np.abs(h) < 1e-8 * size.max()) & (size > 0)]
    flat = flat[np.argsort(np.linalg.norm(flat, axis=1), kind="stable")][:12]
    up = np.flatnonzero(h > 1e-6 * size.max())
    if len(flat) < 2:
        raise AtcError(f"{crystal.name}: no lattice vectors were found in the plane {tuple(plane)}: take low indices")
    height = h[up].min()
    third = R[up[h[up] < height * (1 + 1e-6)]]
    third = third[np.argmin(np.linalg.norm(third, axis=1))]
    for a, b in combinations(flat, 2):
        cell = np.array([a, b, third])
        if abs(abs(np.linalg.det(cell)) / crystal.volume - 1) < 1e-6:
            return (cell if np.linalg.det(cell) > 0 else cell[[1, 0, 2]]), height
    raise AtcError(f"{crystal.name}: no lattice vectors were found in the plane {tuple(plane)}: take low indices")


def _at_rest(frame, model, start) -> float:
    """The least energy of the atoms of a frame near where they are."""
    from scipy.optimize import minimize

    def both(x):
        energy, f, _ = evaluate(model, frame.replace(positions=x.reshape(-1, 3)))
        return energy - start, -f.ravel()

    return start + float(minimize(both, frame.positions.ravel(), jac=True, method="L-BFGS-B").fun)
