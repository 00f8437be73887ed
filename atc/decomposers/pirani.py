"""The improved Lennard-Jones potential of Pirani and others, whose repulsive power grows with the distance."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .radial import RadialStyle, one_cutoff

_PLAIN = "dimensionless"


class Pirani(RadialStyle):
    """U = ε[γ/(n − γ) (r_m/d)^n − n/(n − γ) (r_m/d)^γ] − offset with n = β + α(d/r_m)² (LAMMPS ``lj/pirani``; Pirani et
    al., PCCP 10, 5489).

    Numbers: alpha, beta, gamma, rm, epsilon, cutoff; see `RadialStyle`.
    """

    name = "lj/pirani"
    numbers = (
        ("alpha", _PLAIN),
        ("beta", _PLAIN),
        ("gamma", _PLAIN),
        ("rm", "length"),
        ("epsilon", "energy"),
        ("cutoff", "length"),
    )

    def columns(self, alpha, beta, gamma, rm, epsilon, cutoff):
        return alpha, beta, gamma, rm, epsilon


one_cutoff(Pirani, check=lambda *v: None if v[3] > 0 else "rm must be positive")


@njit(cache=True, nogil=True, error_model="numpy")
def _pirani(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            x2 = d2[b] / (p[4] * p[4])
            log = 0.5 * np.log(x2)
            n = p[2] + p[1] * x2
            gamma = p[3]
            r = np.exp(-n * log)
            a = np.exp(-gamma * log)
            k = 1.0 / (n - gamma)
            U[b] += w * (p[5] * (gamma * r - n * a) * k - p[6])
            # d n' = 2αx², and n appears in both prefactors and in the first power.
            dn = 2.0 * p[1] * x2
            du = gamma * k * r * (-n - dn * (log + k)) + n * k * a * gamma + gamma * k * k * a * dn
            G[b] += w * p[5] * du / d2[b]


Pirani.kernel = staticmethod(_pirani)
