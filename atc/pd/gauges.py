"""Strain gauges: strain and stress at points of a body, by least squares from the displacements of the nodes around, at
free surfaces too.

Within a horizon of a surface the strain across it is not the classical one, whatever corrects the bonds: nodes have the
classical energy there, but their forces balance only in the mean over the skin. The strains along the surface are
right. So a gauge on a free surface does what one glued to it does: it measures along, and has the rest from there being
no traction.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import AtcError


def strain_gauge(sim, points, normals=None, *, reach=5.0, degree=3):
    """Small strain and stress at points.

    Parameters
    ----------
    sim : Simulation of pmb, lps, elastic or correspondence, without a temperature
    points : (p, 3) places in the reference body; near a surface the polynomial is one-sided, which is allowed
    normals : (p, 3) or (3,) normals of the free surface on which the points lie; None where there is none
    reach : how far nodes count, in spacings, with weights 1 − (distance/reach)². degree : of the polynomial that is
        fitted to their displacements: strains are off by the order of (reach · spacing)^degree

    Returns
    -------
    strain_pcc, stress_pcc : (p, 3, 3), in plates those in their plane. Stress in the units of the moduli, tension
        positive

    Raises AtcError where too few nodes lie around a point, and for materials whose stress is not that of the strain.
    """
    body, d = sim.body, sim.body.dimension
    points = np.atleast_2d(np.asarray(points, float))
    if points.ndim != 2 or points.shape[1] != 3 or not np.isfinite(points).all():
        raise AtcError(f"a gauge needs finite points of shape (p, 3), got shape {points.shape}")
    if not (degree >= 1 and int(degree) == degree and reach > 0):
        raise AtcError(f"a gauge needs reach > 0 and a whole degree of 1 or more, got {reach!r} and {degree!r}")
    for m in sim.materials.values():
        if not (m.elastic and m.springs):
            raise AtcError(
                f"gauge: the stress of {m.name} is not that of its strain alone: take pmb, lps, correspondence"
            )
    if sim.model.rest_b is not None:
        raise AtcError("gauge: of a body with a temperature the strain is not elastic alone: none is computed")
    if normals is not None:
        normals = np.broadcast_to(np.asarray(normals, float), points.shape).copy()
        length = np.linalg.norm(normals, axis=1, keepdims=True)
        if not (np.isfinite(length) & (length > 0)).all():
            raise AtcError("gauge: a normal is a direction, three finite numbers that are not all 0")
        normals /= length
    from scipy.spatial import cKDTree

    X, h = body.X_nc, body.spacing
    tree = cKDTree(X[:, :d])
    powers = [p for p in product(range(int(degree) + 1), repeat=d) if sum(p) <= degree]
    first = [powers.index(tuple(int(a == c) for a in range(d))) for c in range(d)]
    lame = {number: m.lame(body) for number, m in sim.materials.items()}
    strain, stress = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3, 3))
    for k, x in enumerate(points):
        near = tree.query_ball_point(x[:d], reach * h)
        terms = np.ones((len(near), len(powers)))
        q = (X[near, :d] - x[:d]) / h
        for t, p in enumerate(powers):
            terms[:, t] = np.prod(q**p, axis=1)
        weight = np.sqrt(np.maximum(1 - (q**2).sum(axis=1) / reach**2, 0.0))[:, None]
        u, _, rank, _ = np.linalg.lstsq(weight * terms, weight * sim.state.u_nc[near, :d], rcond=1e-10)
        if rank < len(powers):
            raise AtcError(
                f"gauge: {len(near)} nodes within {reach:g} spacings of {x.tolist()} do not tell a polynomial of "
                f"degree {degree}: take a larger reach or a lower degree"
            )
        H = u[first] / h
        e = 0.5 * (H + H.T)
        lam, mu = lame[int(body.material_n[near[int((q**2).sum(axis=1).argmin())]])]
        if normals is not None:
            n = normals[k, :d]
            along = np.eye(d) - np.outer(n, n)
            e = along @ e @ along
            # No traction: σ n = 0.
            e -= lam / (lam + 2 * mu) * np.trace(e) * np.outer(n, n)
        strain[k, :d, :d] = e
        stress[k, :d, :d] = lam * np.trace(e) * np.eye(d) + 2 * mu * e
    return strain, stress
