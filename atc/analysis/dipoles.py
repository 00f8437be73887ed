"""Dipoles of molecules along a normal: polarisation, and how they are turned.

Each molecule's dipole µ = Σ q (x − its centre of mass) sits at its centre of mass: P(z) = Σ µ_n φ₁(z − z_m)/A, and with
θ the angle between µ and the normal the means of cos θ and of (3 cos² θ − 1)/2, weighted with φ₁.
"""

from __future__ import annotations

import numpy as np

from .heat_currents import connected
from .profile_table import Column, series_quotient

#: A molecule whose charge is less than this share of its absolute charges is neutral.
NEUTRAL = 1e-6
#: Dipoles below this share of charge times extent have no direction.
_NONE = 1e-9


def labels_of(frame) -> np.ndarray | None:
    """(n,) the number of each atom's molecule, by the frame's own numbers (0: none) or by its bonds; None where nothing
    says which atoms belong together."""
    if frame.molecules is not None:
        return np.asarray(frame.molecules)
    if frame.topology is None or not len(frame.topology.bonds):
        return None
    return 1 + connected(len(frame), frame.topology.bonds)[1]


def dipoles_of(frame, axis: int):
    """Centres of mass (m, 3), dipoles along the normal of the faces that `axis` leaves (m,), cos θ (m,), and how many
    molecules were left out because they are longer than half the cell; of neutral molecules with a dipole."""
    labels = labels_of(frame)
    order = np.argsort(labels, kind="stable")
    order = order[labels[order] > 0]
    _, start, size = np.unique(labels[order], return_index=True, return_counts=True)
    owner = np.repeat(np.arange(len(start)), size)
    q, m, cell = frame.charges[order], frame.masses[order], frame.cell
    s = cell.fractional(frame.positions[order])
    s -= s[start][owner]
    s[:, cell.periodic] -= np.rint(s[:, cell.periodic])
    span = np.maximum.reduceat(s, start) - np.minimum.reduceat(s, start)
    whole = ~(span[:, cell.periodic] > 0.5).any(axis=1)
    r = s @ cell.vectors

    def total(a):
        return np.add.reduceat(a, start)

    centre = total(m[:, None] * r) / total(m)[:, None]
    mu = total(q[:, None] * (r - centre[owner]))
    absolute, length = total(np.abs(q)), np.linalg.norm(mu, axis=1)
    neutral = np.abs(total(q)) <= NEUTRAL * np.maximum(absolute, 1e-300)
    extent = np.linalg.norm(span @ np.abs(cell.vectors), axis=1)
    kept = whole & neutral & (length > _NONE * absolute * extent)
    a, b = (k for k in range(3) if k != axis)
    normal = np.cross(cell.vectors[a], cell.vectors[b])
    normal *= np.sign(normal @ cell.vectors[axis]) / np.linalg.norm(normal)
    along = mu[kept] @ normal
    return frame.positions[order[start]][kept] + centre[kept], along, along / length[kept], int((~whole).sum())


def add_dipoles(out, sums_tzk, u) -> None:
    """Columns from Σ φ₁/A of every frame: 1, µ_n, cos θ, (3 cos² θ − 1)/2."""
    size, label = u.factor("charge") / u.factor("length") ** 2, f"{u.label('charge')}/{u.label('length')}^2"
    out.add("polarisation", sums_tzk[:, :, 1] / size, label, "P", "polarisation", "dipoles")
    for name, k, shown in (("dipole_cosine", 2, "<cos θ>"), ("dipole_order", 3, "<(3 cos² θ − 1)/2>")):
        mean, stderr, correlated = series_quotient(sums_tzk[:, :, k], sums_tzk[:, :, 0])
        out.columns[name] = Column(mean, stderr, "1", shown, "order of dipoles", correlated, "dipoles")
