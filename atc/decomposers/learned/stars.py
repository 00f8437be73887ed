"""Central forces in the place of those of an atom's edges: the tensions of the pairs of a star (an atom and its
neighbours) that have the same forces on all of its atoms.

U^(j) is a function of the distances in its star, but there are more of these than degrees of freedom, and derivatives
by them differ by self-stresses. Of all tensions with B^T t = F (B the rigidity matrix) those that minimise Σ t²/s,

    t = s B λ,   (B^T s B) λ = F,   s_ab = f_c(d_ja) f_c(d_jb),

f_c = ½ (1 + cos π d/r_c), 1 for the centre. The weights let a neighbour that comes in at the cutoff bring nothing with
it; with s = 1 (the covariant central-force decomposition of Torres-Sánchez, Vanegas and Arroyo, 2016) tensions jump.
"""

from __future__ import annotations

import numpy as np


class Torque(Exception):
    """The forces on a star have a torque, so that no central forces are equal to them."""


def tensions(r_kc, g_kc, cutoff: float):
    """Central forces of one star.

    Parameters
    ----------
    r_kc : (k, 3) neighbours − centre; g_kc : (k, 3) ∂U^(j)/∂r

    Returns
    -------
    a, b : (p,) places in the star, 0 the centre; r_pc = x_a − x_b; G_p = t/d, attracting > 0
    """
    k = len(r_kc)
    x = np.concatenate([np.zeros((1, 3)), r_kc])
    F = np.concatenate([g_kc.sum(0, keepdims=True), -g_kc])
    a, b = np.triu_indices(k + 1, 1)
    r = x[a] - x[b]
    d = np.sqrt((r * r).sum(1))
    n = -r / d[:, None]  # from a to b
    inside = np.maximum(1.0 - np.sqrt((r_kc * r_kc).sum(1)) / cutoff, 1e-100)
    f = np.concatenate([[1.0], np.sin(0.5 * np.pi * inside) ** 2])  # ½ (1 + cos π d/r_c), with all digits near r_c
    s = f[a] * f[b]
    # In units of √f for each atom, which keeps the matrix from being as small as the weights at the cutoff.
    unit = 1.0 / np.sqrt(f)
    block = s[:, None, None] * n[:, :, None] * n[:, None, :]
    A = np.zeros((k + 1, 3, k + 1, 3))
    A[a, :, b, :] = -block * (unit[a] * unit[b])[:, None, None]
    A[b, :, a, :] = A[a, :, b, :]
    np.add.at(A, (a, slice(None), a, slice(None)), block * (unit[a] ** 2)[:, None, None])
    np.add.at(A, (b, slice(None), b, slice(None)), block * (unit[b] ** 2)[:, None, None])
    A = A.reshape(3 * k + 3, 3 * k + 3)
    value, vector = np.linalg.eigh(A)
    keep = value > 1e-11 * value[-1]
    right = (F * unit[:, None]).reshape(-1)
    small = vector[:, keep]
    solution = small @ ((small.T @ right) / value[keep])
    lam = solution.reshape(-1, 3) * unit[:, None]
    t = s * ((lam[a] - lam[b]) * n).sum(1)
    found = np.zeros_like(F)
    np.add.at(found, a, t[:, None] * n)
    np.add.at(found, b, -t[:, None] * n)
    size = np.abs(F).max(initial=0.0)
    if not np.abs(found - F).max(initial=0.0) <= 1e-8 * size:
        raise Torque
    return a, b, r, t / d
