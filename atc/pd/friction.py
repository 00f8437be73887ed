"""Coulomb friction of contacts: across the force N that pushes two nodes (or a node and an indenter or a wall) apart
acts one of at most μN, against the velocity at which they slide.

Forces of a pair are opposite, so that friction changes no momentum; as they do not act along the line between the
nodes, it turns angular momentum into the spin that nodes do not have. What it takes is in the ledger.

No contact is made to slide backward: the force is at most that which takes a share of the sliding in a step. So what
sticks creeps, at a velocity of a few times what the load gives within one step.
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .bonds import JIT

#: Of the force that would end the sliding of a pair within a step: a node may have eight of equal ones.
SHARE = 0.25


@njit(**JIT)
def rub_pairs(active, i, j, shift, z, d, V, index, m, c_k, mu, v, mass, dt, F):
    """Friction of the pairs `active` (see `contact._push`, whose N this is) into F."""
    x = np.empty(3)
    for p in active:
        a = i[p]
        b = j[p]
        r2 = 0.0
        for c in range(3):
            x[c] = (z[b, c] + z[b, 3 + c]) - (z[a, c] + z[a, 3 + c])
            if len(shift):
                x[c] += shift[p, c]
            r2 += x[c] * x[c]
        r = np.sqrt(r2)
        if r == 0.0:
            continue
        k = c_k[min(index[a], index[b]) * m + max(index[a], index[b])] * V[a] * V[b]
        along = 0.0
        for c in range(3):
            x[c] /= r
            along += x[c] * (v[b, c] - v[a, c])
        slide2 = 0.0
        for c in range(3):
            x[c] = v[b, c] - v[a, c] - along * x[c]
            slide2 += x[c] * x[c]
        if slide2 == 0.0:
            continue
        slide = np.sqrt(slide2)
        stop = SHARE * mass[a] * mass[b] / (mass[a] + mass[b]) / dt
        f = min(mu * k * (d[p] - r) / slide, stop)
        for c in range(3):
            F[a, c] += f * x[c]
            F[b, c] -= f * x[c]


@njit(**JIT)
def rub_rigid(N_nc, mu, at, v, mass, dt, F):
    """Friction on nodes that something rigid, moving with the velocity `at`, pushes with N; returns its power
    Σ f·at."""
    power = 0.0
    for n in range(len(v)):
        N2 = N_nc[n, 0] ** 2 + N_nc[n, 1] ** 2 + N_nc[n, 2] ** 2
        if N2 == 0.0:
            continue
        N = np.sqrt(N2)
        along = 0.0
        for c in range(3):
            along += (v[n, c] - at[c]) * N_nc[n, c] / N
        slide2 = 0.0
        for c in range(3):
            slide2 += ((v[n, c] - at[c]) - along * N_nc[n, c] / N) ** 2
        if slide2 == 0.0:
            continue
        f = min(mu * N / np.sqrt(slide2), mass[n] / dt)
        for c in range(3):
            t = -f * ((v[n, c] - at[c]) - along * N_nc[n, c] / N)
            F[n, c] += t
            power += t * at[c]
    return power
