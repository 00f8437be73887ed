"""The body of a twin: nodes on a lattice along the cell's edges wherever the reference frame has matter."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from itertools import product

import numpy as np

from .. import pd
from ..errors import AtcError, AtcWarning
from .smoothing import Same, Smoothing

#: Points along each edge of a node's own cell, whose share inside the matter is the share of volume the node has.
_SAMPLES = 4
#: The horizon in distances of nodes, unless a material says otherwise.
HORIZON = 3.015


@dataclass
class TwinBody:
    """A `pd.Body` (internal units) and what it was made of.

    body : pd.Body. smoothing : weights of the atoms at the nodes. step_cc : (3, 3) rows: from one node to the next.
    density : ρ of the nodes, so that Σ ρ V is the mass of the atoms. bulk : the crystal's density
    """

    body: object
    smoothing: Smoothing
    step_cc: np.ndarray
    density: float
    bulk: float

    @property
    def edges(self) -> np.ndarray:
        """Distances of neighbouring nodes along the lattice's axes, two of a body in the plane."""
        return np.linalg.norm(self.step_cc, axis=1)[: self.body.dimension]


def body_of(
    reference,
    kernel,
    bulk: float,
    spacing: float,
    horizon: float | None,
    spacings: float = HORIZON,
    notches=(),
    through=None,
) -> TwinBody:
    """Nodes where the smoothed density is at least half of the bulk's; holes, surfaces and cracks included.

    Parameters
    ----------
    reference : Frame. kernel : of internal lengths
    bulk : mass density of the undisturbed crystal
    spacing : wanted distance of nodes; along each edge the nearest one that divides the cell's edge is taken
    horizon : default `spacings` times the largest distance of neighbouring nodes
    notches : `pd.Notch` objects that cut bonds, which count as broken from the start
    through : (3,) a place that the lattice of nodes goes through, along periodic axes; default: it lies as far from
        one face of the cell as from the other

    Returns
    -------
    TwinBody. V_I is the share of node I's own cell in which the smoothed density is at least half of the bulk's; ρ is
    the same everywhere, such that the mass agrees. Of a run in the plane: a body in plane strain, one internal unit of
    length thick.
    """
    cell, d = reference.cell, reference.dimension
    lengths = np.linalg.norm(cell.vectors, axis=1)
    counts = np.where(np.arange(3) < d, np.maximum(np.rint(lengths / spacing).astype(int), 1), 1)
    step = cell.vectors / counts[:, None]
    shift = np.full(3, 0.5)
    if through is not None:
        shift = np.where(cell.periodic, cell.fractional(np.reshape(through, (1, 3)))[0] * counts % 1.0, shift)
    s = np.stack(np.meshgrid(*((np.arange(n) + o) / n for n, o in zip(counts, shift)), indexing="ij"), axis=-1)
    s = s.reshape(-1, 3)
    X = cell.cartesian(s)
    if d == 2:
        X[:, 2] = reference.positions[0, 2]
    inside = Smoothing(reference, kernel, X).density_g >= 0.5 * bulk
    if not inside.any():
        raise AtcError(
            f"{reference.source}: nowhere does the smoothed density reach half of the crystal's: is this the crystal's "
            "potential and lattice constant, and does [kernel] radius reach over several atoms?"
        )
    X = X[inside]
    offsets = (np.arange(_SAMPLES) + 0.5) / _SAMPLES - 0.5
    share = np.zeros(len(X))
    for shift in product(offsets, repeat=d):
        share += Smoothing(reference, kernel, X + np.array(shift) @ step[:d]).density_g >= 0.5 * bulk
    volume = abs(np.linalg.det(step))
    V = volume * np.maximum(share, 1.0) / _SAMPLES**d
    rho = float(reference.masses.sum() / V.sum())
    if not 0.9 < rho / bulk < 1.1:
        warnings.warn(
            f"{reference.source}: with the mass of the atoms the density of the nodes is {rho / bulk:.3g} of the "
            "crystal's: take a smaller spacing or kernel radius",
            AtcWarning,
            stacklevel=3,
        )
    edge = np.linalg.norm(step, axis=1)[:d].max()
    horizon = spacings * edge if horizon is None else horizon
    if horizon < 1.5 * edge:
        u = reference.units
        horizon, edge = (f"{u.to_user('length', v):.5g} {u.label('length')}" for v in (horizon, edge))
        raise AtcError(
            f"[twin] horizon: {horizon} is less than 1.5 times the distance of nodes, {edge}: take a larger horizon or "
            "a smaller spacing"
        )
    plane = {"dimension": 2, "plane": "strain"} if d == 2 else {}
    body = pd.Body(X, V, rho, horizon, cell=cell, spacing=volume ** (1 / d), notches=notches, **plane)
    return TwinBody(body, Smoothing(reference, kernel, X), step, rho, bulk)


def body_of_atoms(reference, bulk: float, horizon: float) -> TwinBody:
    """Every atom of the reference is a node: what is derived from the potential can then be held to the run bond by
    bond. V_I = m/ρ of the crystal. `horizon` : of the body; parameters and result otherwise as `body_of`."""
    V = reference.masses / bulk
    X = np.array(reference.positions)
    size = float(V.mean() ** (1 / 3))
    body = pd.Body(X, V, bulk, horizon, cell=reference.cell, spacing=size, crowded=True, warn=False)
    return TwinBody(body, Same(reference), np.eye(3) * size, bulk, bulk)
