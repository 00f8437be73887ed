"""Energy-based surface correction of bond-based bodies (Le & Bobaru 2018, "energy method"; Oterkus & Madenci).

Near a surface a family is cut off, so that a node is too soft. Each node is stretched along every axis in turn, its
strain energy is compared with that of the classical solid, and bonds get the mean factor of their ends, along their own
direction (an ellipsoid through the axes' factors).
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


def surface_factors(body, weight_b, materials) -> np.ndarray:
    """(b,) factors for bond forces; `weight_b` is c ω ν V_i V_j. Raises AtcError for an unknown kind of correction."""
    kind = next(iter(materials.values())).surface_correction
    if kind != "energy":
        raise AtcError(f'surface_correction must be None or "energy", got {kind!r}')
    t, d, n = body.bonds, body.dimension, len(body)
    i, j = t.i_b, t.j_b
    xi = t.xi_bc(body.X_nc)
    direction = xi / t.r0_b[:, None]
    mu = np.zeros(n)
    for m, material in materials.items():
        mu[body.material_n == m] = material.lame(body)[1]
    # Uniaxial strain ε along an axis: classical ½ (λ + 2μ) ε² = 3/2 μ ε² with λ = μ; bonds stretch by n²ε.
    factor_nc = np.ones((n, 3))
    for c in range(d):
        w = 0.25 * weight_b * direction[:, c] ** 4 * t.r0_b
        energy = np.bincount(i, w, n) + np.bincount(j, w, n)
        with np.errstate(divide="ignore"):
            factor_nc[:, c] = np.where(energy > 0, 1.5 * mu * body.V_n / energy, 1.0)
    mean = 0.5 * (factor_nc[i] + factor_nc[j])
    # The radius of the ellipsoid with these semi-axes, in the bond's direction.
    return 1.0 / np.sqrt(((direction[:, :d] / mean[:, :d]) ** 2).sum(axis=1))
