"""Soft pair style: a cosine bump without a singularity."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, mix_prefactor, one_cutoff


class Soft(RadialStyle):
    """U = A[1 + cos(πd/r_c)] for d < cutoff r_c (LAMMPS ``soft``).

    Parameters
    ----------
    A, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0 = no
        interaction
    units : unit style of these numbers
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "soft"
    numbers = (("A", "energy"), ("cutoff", "length"))

    shifts = False

    def columns(self, A, cutoff):
        return A, np.pi / cutoff

    @pair_law
    def law(d2, A, k):
        d = np.sqrt(d2)
        # sin(kd)/d has the limit k: coincident atoms feel no force.
        return A * (1.0 + np.cos(k * d)), -A * k * (np.sin(k * d) / d if d > 0.0 else k)


one_cutoff(Soft, mix=mix_prefactor)
