"""Buckingham and Born-Mayer-Huggins pair styles: an exponential wall and inverse powers."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, one_cutoff

_C = ("C", {"energy": 1, "length": 6})


class Born(RadialStyle):
    """U = A e^{(σ − d)/ρ} − C/d⁶ + D/d⁸ − offset for d < cutoff (LAMMPS ``born``).

    Parameters
    ----------
    A, rho, sigma, C, D, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n;
        cutoff 0 = no interaction
    units : unit style of these numbers
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "born"
    numbers = (
        ("A", "energy"), ("rho", "length"), ("sigma", "length"), _C, ("D", {"energy": 1, "length": 8}),
        ("cutoff", "length"),
    )  # fmt: skip

    def columns(self, A, rho, sigma, C, D, cutoff):
        return A, 1.0 / np.where(rho > 0, rho, np.inf), sigma, C, D

    @pair_law
    def law(d2, A, inverse, sigma, C, D):
        d = np.sqrt(d2)
        s2 = 1.0 / d2
        s6 = s2 * s2 * s2
        x = A * np.exp((sigma - d) * inverse)
        c = C * s6
        e = D * s6 * s2
        return x - c + e, -(x * inverse / d - (6.0 * c - 8.0 * e) * s2)


class Buckingham(Born):
    """U = A e^{−d/ρ} − C/d⁶ − offset for d < cutoff (LAMMPS ``buck``).

    Parameters
    ----------
    A, rho, C, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n; cutoff 0
        = no interaction
    units : unit style of these numbers
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "buck"
    numbers = (("A", "energy"), ("rho", "length"), _C, ("cutoff", "length"))

    def columns(self, A, rho, C, cutoff):
        zero = np.zeros_like(A)
        return super().columns(A, rho, zero, C, zero, cutoff)


def positive_rho(*numbers) -> str | None:
    """What is wrong with these numbers, None if nothing."""
    return None if numbers[1] > 0 else "rho must be positive"


one_cutoff(Buckingham, check=positive_rho)
one_cutoff(Born, check=positive_rho)
