"""Lennard-Jones pair styles: cut, shifted in force, expanded, and with a quadratic term that makes energy and force
vanish at the cutoff."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, mix_lj, one_cutoff

_NUMBERS = (("epsilon", "energy"), ("sigma", "length"), ("cutoff", "length"))


class LennardJones(RadialStyle):
    """U = 4ε[(σ/d)¹² − (σ/d)⁶] − offset for d < cutoff (LAMMPS ``lj/cut``).

    Parameters
    ----------
    epsilon, sigma, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n;
        cutoff 0 = no interaction
    units : unit style of these numbers
    shift : whether offset = U(cutoff), so that the energy has no step (``pair_modify shift yes``); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "lj/cut"
    numbers = _NUMBERS

    simd = True

    def columns(self, epsilon, sigma, cutoff):
        return 4 * epsilon * sigma**12, 4 * epsilon * sigma**6

    @pair_law
    def law(d2, a12, c6):
        s2 = 1.0 / d2
        s6 = s2 * s2 * s2
        a = a12 * s6 * s6
        c = c6 * s6
        return a - c, -(12.0 * a - 6.0 * c) * s2


_lj = LennardJones.law


class LennardJonesSmoothLinear(RadialStyle):
    """Lennard-Jones minus its value and slope at the cutoff: U = u(d) − u(r_c) − (d − r_c) u'(r_c) (LAMMPS
    ``lj/smooth/linear``).

    Parameters as for `LennardJones`, without `shift`.
    """

    name = "lj/smooth/linear"
    numbers = _NUMBERS

    shifts = False

    def columns(self, epsilon, sigma, cutoff):
        a, c, s6 = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, 1.0 / cutoff**6
        return a, c, a * s6 * s6 - c * s6, -(12 * a * s6 * s6 - 6 * c * s6) / cutoff, cutoff

    @pair_law
    def law(d2, a12, c6, at_cutoff, slope, cutoff):
        u, g = _lj(d2, a12, c6)
        d = np.sqrt(d2)
        return u - at_cutoff - slope * (d - cutoff), g - slope / d


class LennardJonesQuadratic(RadialStyle):
    """Lennard-Jones plus a quadratic term: U = 4ε[(σ/d)¹² − (σ/d)⁶] + A d² + B for d < cutoff, with A and B such that U
    and U' vanish there.

    What continuum-stress codes use as "Lennard-Jones with quadratic smoothing": A = −u'(r_c)/(2 r_c), B = −u(r_c) − A
    r_c². Parameters as for `LennardJones`, without `shift`.
    """

    name = "lj/quadratic"
    numbers = _NUMBERS

    shifts = False

    def columns(self, epsilon, sigma, cutoff):
        a, c, s2 = 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, 1.0 / cutoff**2
        s6 = s2**3
        A = 0.5 * (12 * a * s6 * s6 - 6 * c * s6) * s2
        return a, c, A, -(a * s6 * s6 - c * s6) - A * cutoff**2

    @pair_law
    def law(d2, a12, c6, A, B):
        u, g = _lj(d2, a12, c6)
        return u + A * d2 + B, g + 2.0 * A


class LennardJonesExpand(RadialStyle):
    """Lennard-Jones of d − Δ for d < cutoff + Δ (LAMMPS ``lj/expand``).

    Parameters as for `LennardJones`, with `delta`, the shift of the distance, before the cutoff. With `shift`, LAMMPS
    subtracts the unexpanded Lennard-Jones at cutoff + Δ (not the value at the cutoff); so does this class.
    """

    name = "lj/expand"
    numbers = (*_NUMBERS[:2], ("delta", "length"), _NUMBERS[2])

    def reach(self, epsilon, sigma, delta, cutoff):
        return np.where(cutoff > 0, cutoff + delta, 0.0)

    def columns(self, epsilon, sigma, delta, cutoff):
        return 4 * epsilon * sigma**12, 4 * epsilon * sigma**6, delta

    def at_cutoff(self):
        cut2, a, c = np.moveaxis(self.table[..., :3], -1, 0)
        s6 = 1.0 / np.where(cut2 > 0, cut2, np.inf) ** 3
        return a * s6 * s6 - c * s6

    @pair_law
    def law(d2, a12, c6, delta):
        d = np.sqrt(d2)
        s = 1.0 / (d - delta)
        s2 = s * s
        s6 = s2 * s2 * s2
        a = a12 * s6 * s6
        c = c6 * s6
        return a - c, -(12.0 * a - 6.0 * c) * s / d


for _cls, _names in (
    (LennardJones, ()),
    (LennardJonesSmoothLinear, ("lj/smooth/linear", "lj/sf")),
    (LennardJonesExpand, ()),
):
    # lj/sf: its old name in LAMMPS
    one_cutoff(_cls, mix=mix_lj, names=_names)
