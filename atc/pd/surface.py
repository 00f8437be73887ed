"""Energy-based surface corrections: near a surface families are cut off, and nodes do not have the classical energy.

Bond-based bodies (Le & Bobaru 2018, "energy method"; Oterkus & Madenci): each node is stretched along every axis in
turn, its strain energy is compared with that of the classical solid, and bonds get the mean factor of their ends, along
their own direction (an ellipsoid through the axes' factors).

State-based bodies: bonds get those factors, as near to 1 as can be, for which dilatation and energy of every node but
those of edges and corners are the classical ones in every uniform strain, whatever its family looks like; the aim of
J. Mitchell, S. Silling and D. Littlewood, J. Mech. Mater. Struct. 10, 539 (2015), with one symmetric factor a bond.
"""

from __future__ import annotations

import warnings
from itertools import combinations_with_replacement

import numpy as np

from ..compiled import njit
from ..errors import AtcError, AtcWarning
from .bonds import JIT

#: Factors of state-based bonds stay within these.
LEAST, MOST = 0.1, 10.0
#: How far a family may lie to one side, |Σ w|ξ|² n|/Σ w|ξ|², by dimension: between a plane surface's (0.44 on a cubic
#: lattice) and an edge's (0.62). At edges and corners no positive factors meet all strains: these nodes are left alone.
ONE_SIDED = {1: 2.0, 2: 0.78, 3: 0.53}
#: What keeps factors near 1 where several would do, relative to Σ w|ξ|²: in three dimensions the moments of a family
#: nearly depend on each other, and faces come out right to 2 % instead of exactly.
RIDGE = {1: 1e-6, 2: 1e-6, 3: 1e-3}


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


def moment_factors(body, weight_b, tolerance: float = 1e-8) -> np.ndarray:
    """(b,) factors g for the bonds of an ordinary state-based body; `weight_b` is ω ν V_i V_j.

    With M = Σ w|ξ|² of a node's family, they give Σ g w|ξ|² n⊗n⊗n⊗n = M/(d(d+2)) (δδ + δδ + δδ), and so
    Σ g w ξ⊗ξ = (M/d) 1: of all such factors those of least Σ w|ξ|² (g − 1)², found by conjugate gradients for one
    multiplier a node and moment. Nodes of edges and corners are not asked (`ONE_SIDED`).

    Warns
    -----
    AtcWarning where other nodes stay off by more than a tenth.
    """
    t, d, n = body.bonds, body.dimension, len(body)
    if not len(t):
        return np.ones(0)
    i, j = np.ascontiguousarray(t.i_b), t.j_b
    u = t.xi_bc(body.X_nc) / t.r0_b[:, None]
    which = np.array(list(combinations_with_replacement(range(d), 4)))
    equal = lambda a, b: which[:, a] == which[:, b]  # noqa: E731
    aim = (equal(0, 1) & equal(2, 3)) * 1.0 + (equal(0, 2) & equal(1, 3)) + (equal(0, 3) & equal(1, 2))
    weight = weight_b * t.r0_b**2
    M = t.sums(weight)
    per = np.where(M > 0, M, 1.0)[:, None]
    side = np.stack([np.bincount(i, weight * u[:, c], n) - np.bincount(j, weight * u[:, c], n) for c in range(d)])
    asked = (np.linalg.norm(side, axis=0) < ONE_SIDED[d] * M)[:, None].astype(float)

    def moments(x_b):
        out = np.zeros((n, len(which)))
        _add_moments(i, j, u, which, x_b, out)
        return asked * out

    wanted = asked * M[:, None] * aim / (d * (d + 2))
    blocks = np.zeros((n, len(which), len(which)))
    _add_blocks(i, j, u, which, weight, blocks)
    inverse = np.linalg.inv(blocks + 2 * RIDGE[d] * per[:, :, None] * np.eye(len(which)))
    lam, r = np.zeros_like(wanted), wanted - moments(weight)
    z = np.einsum("nab,nb->na", inverse, r)
    p, rz = z.copy(), float((r * z).sum())
    for _ in range(500):
        if np.abs(r / per).max() <= tolerance or rz == 0.0:
            break
        q = moments(weight * _spread(i, j, u, which, p)) + RIDGE[d] * per * p
        step = rz / float((p * q).sum())
        lam += step * p
        r -= step * q
        z = np.einsum("nab,nb->na", inverse, r)
        rz, old = float((r * z).sum()), rz
        p = z + rz / old * p
    g = np.clip(1.0 + _spread(i, j, u, which, lam), LEAST, MOST)
    off = np.abs(moments(weight * g) - wanted).max(axis=1) / per[:, 0] * d * (d + 2) / 3
    if off.max(initial=0.0) > 0.1:
        warnings.warn(
            f"surface correction: {int((off > 0.1).sum())} of {n} nodes stay off by up to {100 * off.max():.2g} % in a "
            "stiffness: their families are too small; take a larger horizon or finer nodes",
            AtcWarning,
            stacklevel=2,
        )
    return g


def _spread(i, j, u, which, lam):
    """(b,) φ·(λ_i + λ_j), φ the products of four components of the bond's direction."""
    out = np.empty(len(i))
    _per_bond(i, j, u, which, lam, out)
    return out


@njit(**JIT)
def _add_moments(i, j, u, which, x, out):
    """Σ x n n n n of both ends of every bond."""
    for b in range(len(i)):
        for a in range(len(which)):
            p = x[b] * u[b, which[a, 0]] * u[b, which[a, 1]] * u[b, which[a, 2]] * u[b, which[a, 3]]
            out[i[b], a] += p
            out[j[b], a] += p


@njit(**JIT)
def _per_bond(i, j, u, which, lam, out):
    for b in range(len(i)):
        total = 0.0
        for a in range(len(which)):
            p = u[b, which[a, 0]] * u[b, which[a, 1]] * u[b, which[a, 2]] * u[b, which[a, 3]]
            total += p * (lam[i[b], a] + lam[j[b], a])
        out[b] = total


@njit(**JIT)
def _add_blocks(i, j, u, which, x, out):
    """Σ x φ φᵀ of both ends."""
    phi = np.empty(len(which))
    for b in range(len(i)):
        for a in range(len(which)):
            phi[a] = u[b, which[a, 0]] * u[b, which[a, 1]] * u[b, which[a, 2]] * u[b, which[a, 3]]
        for a in range(len(which)):
            for c in range(len(which)):
                out[i[b], a, c] += x[b] * phi[a] * phi[c]
                out[j[b], a, c] += x[b] * phi[a] * phi[c]
