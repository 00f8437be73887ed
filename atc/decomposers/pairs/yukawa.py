"""Yukawa pair style."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, mix_prefactor, one_cutoff


class Yukawa(RadialStyle):
    """U = A e^{−κd}/d − offset for d < cutoff (LAMMPS ``yukawa``).

    Parameters
    ----------
    A, kappa, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0 =
        no interaction
    units : unit style of these numbers (A: energy·length, kappa: 1/length)
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "yukawa"
    numbers = (("A", {"energy": 1, "length": 1}), ("kappa", {"length": -1}), ("cutoff", "length"))

    @pair_law
    def law(d2, A, kappa):
        d = np.sqrt(d2)
        s = 1.0 / d
        u = A * np.exp(-kappa * d) * s
        return u, -u * (kappa + s) * s


one_cutoff(Yukawa, mix=mix_prefactor, line=("kappa", "cutoff"))
