"""Acoustic branches of a cubic crystal along [100], [110] and [111], and the frequencies that a model gives them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .crystal import Crystal
from .elasticity import ElasticConstants
from .force_constants import signed_root

#: Where residuals are taken, fractions of the zone boundary.
FRACTIONS = (0.1, 0.25, 0.5, 0.75, 1.0)


#: Directions and the polarisations that symmetry keeps pure along them: (direction, name, polarisation).
CUBIC_BRANCHES = (
    ((1, 0, 0), "L", (1, 0, 0)),
    ((1, 0, 0), "T", (0, 1, 0)),
    ((1, 1, 0), "L", (1, 1, 0)),
    ((1, 1, 0), "T1", (0, 0, 1)),
    ((1, 1, 0), "T2", (1, -1, 0)),
    ((1, 1, 1), "L", (1, 1, 1)),
    ((1, 1, 1), "T", (1, -1, 0)),
)


@dataclass(frozen=True)
class Branch:
    """One acoustic branch along a ray: where, how polarised, and how long the ray is (the zone boundary)."""

    direction: tuple
    name: str
    polarisation: np.ndarray
    unit: np.ndarray
    boundary: float

    @property
    def label(self) -> str:
        return "[" + "".join(f"{d:g}" for d in self.direction) + "] " + self.name

    def k(self, fractions) -> np.ndarray:
        """(f, 3) wave vectors."""
        return np.asarray(fractions)[:, None] * self.boundary * self.unit


def is_cubic(elastic: ElasticConstants, tolerance: float = 1e-6) -> bool:
    """Whether the elastic constants have the cube's symmetry, axes along x, y, z."""
    c11, c12, c44 = elastic.cubic
    ideal = np.zeros((6, 6))
    ideal[:3, :3] = c12
    ideal[[0, 1, 2], [0, 1, 2]] = c11
    ideal[[3, 4, 5], [3, 4, 5]] = c44
    return bool(np.abs(elastic.C_vv - ideal).max() < tolerance * abs(c11))


def cubic_branches(crystal: Crystal, factor: float = 1.0) -> list[Branch]:
    """The seven branches of a cubic crystal; `factor` divides the zone (coarse lattices)."""
    out = []
    for direction, name, p in CUBIC_BRANCHES:
        p = np.array(p, float) / np.linalg.norm(p)
        out.append(Branch(direction, name, p, crystal.direction(direction), crystal.zone_boundary(direction) / factor))
    return out


def branch_values(model, branch: Branch, fractions, velocities: bool = False):
    """ω² of the branch at `fractions` of its ray (negative: unstable); with `velocities` dω/dk too.

    Models of one displacement field: p·D·p, exact where symmetry keeps p pure. With more atoms a cell the branch is
    followed from long waves on, step by step by the overlap of eigenvectors, through whatever crosses it.
    """
    fractions = np.asarray(fractions, float)
    k = branch.k(fractions)
    D = model.dynamical_matrix(k)
    if D.shape[1] == 3:
        p = branch.polarisation
        value = np.einsum("i,kij,j->k", p, D.real, p)
        if not velocities:
            return value
        slope = np.einsum("i,kij,j->k", p, model.radial_gradient(k).real, p)
        with np.errstate(invalid="ignore", divide="ignore"):
            return value, slope / (2 * signed_root(value))
    path = np.unique(np.concatenate([np.linspace(1e-3, 1.0, 240), fractions]))
    values, modes = np.linalg.eigh(model.dynamical_matrix(branch.k(path)))
    n = len(model.crystal)
    whole = (np.sqrt(model.crystal.masses / model.crystal.masses.sum())[:, None, None] * np.eye(3)).reshape(3 * n, 3)
    current = whole @ branch.polarisation + 0j
    chosen = np.empty(len(path))
    vectors = np.empty((len(path), 3 * n), complex)
    for s in range(len(path)):
        # Project on each (nearly) degenerate space, so that an arbitrary basis within it does not matter.
        weight, at, start = -1.0, 0, 0
        for end in range(1, 3 * n + 1):
            if end < 3 * n and values[s, end] - values[s, end - 1] < 1e-7 * np.abs(values[s]).max():
                continue
            space = modes[s][:, start:end]
            inside = space @ (space.conj().T @ current)
            w = np.linalg.norm(inside)
            if w > weight:
                weight, at, best = w, start, inside / w
            start = end
        chosen[s], vectors[s], current = values[s, at], best, best
    where = np.searchsorted(path, fractions)
    if not velocities:
        return chosen[where]
    e = vectors[where]
    slope = np.einsum("ki,kij,kj->k", e.conj(), model.radial_gradient(k), e).real
    return chosen[where], slope / (2 * signed_root(chosen[where]))
