"""What bonds add up to: forces on atoms, the virial, and the energy sources of bonds of two bodies."""

from __future__ import annotations

import numpy as np

from ..bonds import Bonds
from ..compiled import njit


def two_body_sources(bonds: Bonds) -> np.ndarray:
    """∂U^(i)/∂x_j = −½ G r and ∂U^(j)/∂x_i = +½ G r: half of a two-body energy belongs to each end."""
    if bonds.F_bc is not None:
        return 0.5 * np.stack([bonds.F_bc, -bonds.F_bc], axis=1)
    D = np.empty((len(bonds), 2, 3))
    _halves(bonds.r_bc, bonds.G_b, D)
    return D


@njit(cache=True, nogil=True, error_model="numpy")
def _halves(r, G, D):
    for b in range(len(G)):
        g = 0.5 * G[b]
        for c in range(3):
            D[b, 0, c] = -g * r[b, c]
            D[b, 1, c] = g * r[b, c]


@njit(cache=True, nogil=True, error_model="numpy")
def add_given(i, j, F_bc, forces):
    """Add forces that bonds carry as vectors."""
    for b in range(len(F_bc)):
        for c in range(3):
            forces[i[b], c] += F_bc[b, c]
            forces[j[b], c] -= F_bc[b, c]


@njit(cache=True, nogil=True, error_model="numpy")
def _add_forces(i, j, r, G, forces):
    xx = yy = zz = yz = xz = xy = 0.0
    for b in range(len(G)):
        g = G[b]
        x, y, z = r[b, 0], r[b, 1], r[b, 2]
        gx, gy, gz = g * x, g * y, g * z
        p, q = i[b], j[b]
        forces[p, 0] -= gx
        forces[p, 1] -= gy
        forces[p, 2] -= gz
        forces[q, 0] += gx
        forces[q, 1] += gy
        forces[q, 2] += gz
        xx += gx * x
        yy += gy * y
        zz += gz * z
        yz += gy * z
        xz += gx * z
        xy += gx * y
    return xx, yy, zz, yz, xz, xy


@njit(cache=True, nogil=True, error_model="numpy")
def _virial(r, G):
    xx = yy = zz = yz = xz = xy = 0.0
    for b in range(len(G)):
        g = G[b]
        x, y, z = r[b, 0], r[b, 1], r[b, 2]
        xx += g * x * x
        yy += g * y * y
        zz += g * z * z
        yz += g * y * z
        xz += g * x * z
        xy += g * x * y
    return xx, yy, zz, yz, xz, xy


def virial_of(r, G, i=None, j=None, forces=None) -> np.ndarray:
    """(3, 3) Σ G r⊗r; with atoms i, j and their forces, these are added too."""
    xx, yy, zz, yz, xz, xy = _virial(r, G) if forces is None else _add_forces(i, j, r, G, forces)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
