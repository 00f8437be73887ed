"""Surface energies of a crystal: γ(hkl) = (U_slab − U_bulk)/2A, of the cheapest termination, without reconstruction; in
the plane of its rows (hk), A their length.

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
#: Rows along which triangular crystals do: close-packed ones and those between.
LOW_INDEX_ROWS = ((0, 1), (1, -1))


@dataclass
class Surface:
    """plane : (h, k, l), of a row (h, k). energy : γ relaxed, energy/area. unrelaxed : of the bulk cut in two.
    spacing : of the lattice planes"""

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
    plane : (h, k, l); (h, k) of a crystal in the plane
    relaxed : whether the slab's atoms come to rest, cell by cell of the surface (no reconstruction)
    """
    vectors, height = _along(crystal, plane)
    sides = np.cross(vectors[0], vectors[1])
    area = np.linalg.norm(sides)
    normal = sides / area
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
        open_below = (True, crystal.dimension == 3, False)
        cell = Cell(np.array([vectors[0], vectors[1], thick]), x.min(axis=0) - 0.5 * thick, open_below)
        frame = crystal.copies(x, cell, f"{crystal.name} slab")
        cold = evaluate(model, frame)[0]
        warm = _at_rest(frame, model, cold) if relaxed else cold
        found.append(((warm - layers * bulk) / (2 * area), (cold - layers * bulk) / (2 * area)))
    energy, unrelaxed = min(found)
    return Surface(tuple(plane), float(energy), float(unrelaxed), float(height))


@dataclass
class Strength:
    """stress : the largest first Piola stress along the normal of a plane in uniaxial strain, of the crystal without
    defects, at `strain`"""

    stress: float
    strain: float


def strength(crystal: Crystal, model, plane, step: float = 0.01, most: float = 1.0) -> Strength:
    """How strong a crystal at rest is when its planes (h, k, l) are pulled apart in uniaxial strain, its basis relaxed
    along the way: the maximum of P_nn before it has fallen to half of that."""
    vectors, _ = _along(crystal, plane)
    sides = np.cross(vectors[0], vectors[1])
    nn = np.outer(sides, sides) / (sides @ sides)
    u, P = np.zeros((len(crystal), 3)), [0.0]
    while P[-1] >= 0.5 * max(P):
        strain = step * len(P)
        if strain > most:
            raise AtcError(f"{crystal.name}: it is not torn apart at a strain of {most}: no strength was found")
        strained = crystal.strained(strain * nn, u)
        if len(crystal) > 1:
            u = u + _rest(strained.frame(), model) - strained.positions
            strained = crystal.strained(strain * nn, u)
        _, _, virial = evaluate(model, strained.frame())
        P.append(float((nn * virial).sum() / (crystal.volume * (1 + strain))))
    top = int(np.argmax(P))
    before, most_, after = P[top - 1 : top + 2]
    bend = before - 2 * most_ + after  # of the parabola through the three
    return Strength(most_ - 0.125 * (before - after) ** 2 / bend, step * (top + 0.5 * (before - after) / bend))


def cleavage(crystal: Crystal, model, planes=None) -> Surface:
    """The surface of the smallest energy among some planes; default: `LOW_INDEX`, or `LOW_INDEX_ROWS`."""
    planes = planes or (LOW_INDEX if crystal.dimension == 3 else LOW_INDEX_ROWS)
    return min((surface_energy(crystal, model, p) for p in planes), key=lambda s: s.energy)


def _along(crystal, plane):
    """(3, 3) vectors of a primitive cell, the first two in the plane, and the height of the third. In two dimensions
    the second is one internal unit along z."""
    flat_crystal = crystal.dimension == 2
    g = np.linalg.inv(crystal.conventional) @ np.array([*plane, *([0] if flat_crystal else [])], float)
    normal = g / np.linalg.norm(g)
    steps = range(-3, 4)
    n = np.array(list(product(steps, steps, (0,) if flat_crystal else steps)))
    R = n @ crystal.vectors
    size, h = np.linalg.norm(R, axis=1), R @ normal
    flat = R[(np.abs(h) < 1e-8 * size.max()) & (size > 0)]
    flat = flat[np.argsort(np.linalg.norm(flat, axis=1), kind="stable")][:12]
    up = np.flatnonzero(h > 1e-6 * size.max())
    none = AtcError(f"{crystal.name}: no lattice vectors were found in the plane {tuple(plane)}: take low indices")
    if len(flat) < 2:
        raise none
    height = h[up].min()
    third = R[up[h[up] < height * (1 + 1e-6)]]
    third = third[np.argmin(np.linalg.norm(third, axis=1))]
    pairs = ((a, crystal.vectors[2]) for a in flat) if flat_crystal else combinations(flat, 2)
    for a, b in pairs:
        cell = np.array([a, b, third])
        if abs(abs(np.linalg.det(cell)) / crystal.volume - 1) < 1e-6:
            return (cell if np.linalg.det(cell) > 0 else cell * [[-1], [1], [1]]), height
    raise none


def _at_rest(frame, model, start) -> float:
    """The least energy of the atoms of a frame near where they are."""
    return start + float(_minimum(frame, model, start).fun)


def _rest(frame, model) -> np.ndarray:
    """(n, 3) where the atoms of a frame come to rest, the first one held."""
    x = _minimum(frame, model, evaluate(model, frame)[0]).x.reshape(-1, 3)
    return x - x[0] + frame.positions[0]


def _minimum(frame, model, start):
    from scipy.optimize import minimize

    def both(x):
        energy, f, _ = evaluate(model, frame.replace(positions=x.reshape(-1, 3)))
        return energy - start, -f.ravel()

    return minimize(both, frame.positions.ravel(), jac=True, method="L-BFGS-B", options={"gtol": 1e-8, "ftol": 1e-15})
