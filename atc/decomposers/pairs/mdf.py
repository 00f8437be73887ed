"""Potentials tapered by the function of Mei, Davenport and Fernando: value, slope and curvature go to zero at the outer
cutoff."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from .lennard_jones import LennardJones
from .loop import pair_law
from .radial import RadialStyle, inner_outer, mix_lj_distances

_lj = LennardJones.law
_CUTOFFS = (("inner", "length"), ("cutoff", "length"))


class LennardJonesMDF(RadialStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] f(d) (LAMMPS ``lj/mdf``).

    f = 1 for d < inner, (1 − x)³(1 + 3x + 6x²) with x = (d − inner)/(cutoff − inner) beyond (Mei, Davenport & Fernando,
    Phys. Rev. B 43, 4653). Numbers: epsilon, sigma, inner, cutoff; see `RadialStyle`.
    """

    name = "lj/mdf"
    numbers = (("epsilon", "energy"), ("sigma", "length"), *_CUTOFFS)
    shifts = False

    def columns(self, epsilon, sigma, inner, cutoff):
        return 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, inner, 1 / (cutoff - inner)

    @pair_law
    def law(d2, a12, c6, inner, inverse_width):
        u, g = _lj(d2, a12, c6)
        d = np.sqrt(d2)
        f, df = _taper(d, inner, inverse_width)
        return u * f, g * f + u * df / d


class LennardMDF(LennardJonesMDF):
    """U = (A/d¹² − B/d⁶) f(d), f as for `LennardJonesMDF` (LAMMPS ``lennard/mdf``). Numbers: A, B, inner, cutoff; see
    `RadialStyle`."""

    name = "lennard/mdf"
    numbers = (("A", {"energy": 1, "length": 12}), ("B", {"energy": 1, "length": 6}), *_CUTOFFS)

    def columns(self, A, B, inner, cutoff):
        return A, B, inner, 1 / (cutoff - inner)


class BuckinghamMDF(RadialStyle):
    """U = (A e^{−d/ρ} − C/d⁶) f(d), f as for `LennardJonesMDF` (LAMMPS ``buck/mdf``). Numbers: A, rho, C, inner,
    cutoff; see `RadialStyle`."""

    name = "buck/mdf"
    numbers = (("A", "energy"), ("rho", "length"), ("C", {"energy": 1, "length": 6}), *_CUTOFFS)
    shifts = False

    def columns(self, A, rho, C, inner, cutoff):
        return A, 1 / rho, C, inner, 1 / (cutoff - inner)

    @pair_law
    def law(d2, A, inverse_rho, C, inner, inverse_width):
        d = np.sqrt(d2)
        s2 = 1.0 / d2
        x = A * np.exp(-d * inverse_rho)
        c = C * s2 * s2 * s2
        f, df = _taper(d, inner, inverse_width)
        return (x - c) * f, -(x * inverse_rho * f / d - 6.0 * c * s2 * f - (x - c) * df / d)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def _taper(d, inner, inverse_width):
    """f and f'."""
    x = (d - inner) * inverse_width
    if x <= 0.0:
        return 1.0, 0.0
    y = 1.0 - x
    return y * y * y * (1.0 + 3.0 * x + 6.0 * x * x), -30.0 * x * x * y * y * inverse_width


inner_outer(LennardJonesMDF, mix=mix_lj_distances)
inner_outer(LennardMDF)
inner_outer(BuckinghamMDF)
