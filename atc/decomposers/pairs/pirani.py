"""The improved Lennard-Jones potential of Pirani and others, whose repulsive power grows with the distance."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, one_cutoff

_PLAIN = "dimensionless"


class Pirani(RadialStyle):
    """U = ε[γ/(n − γ) (r_m/d)^n − n/(n − γ) (r_m/d)^γ] − offset with n = β + α(d/r_m)² (LAMMPS ``lj/pirani``; Pirani et
    al., PCCP 10, 5489).

    Numbers: alpha, beta, gamma, rm, epsilon, cutoff; see `RadialStyle`.
    """

    name = "lj/pirani"
    numbers = (
        ("alpha", _PLAIN), ("beta", _PLAIN), ("gamma", _PLAIN), ("rm", "length"), ("epsilon", "energy"),
        ("cutoff", "length"),
    )  # fmt: skip

    @pair_law
    def law(d2, alpha, beta, gamma, rm, epsilon):
        x2 = d2 / (rm * rm)
        log = 0.5 * np.log(x2)
        n = beta + alpha * x2
        r = np.exp(-n * log)
        a = np.exp(-gamma * log)
        k = 1.0 / (n - gamma)
        # d n' = 2αx², and n appears in both prefactors and in the first power.
        dn = 2.0 * alpha * x2
        du = gamma * k * r * (-n - dn * (log + k)) + n * k * a * gamma + gamma * k * k * a * dn
        return epsilon * (gamma * r - n * a) * k, epsilon * du / d2


one_cutoff(Pirani, check=lambda *v: None if v[3] > 0 else "rm must be positive")
