"""Morse pair styles: cut, shifted in force, and with a repulsion or a dispersion of its own."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, one_cutoff


class Morse(RadialStyle):
    """U = D₀[e^{−2α(d − r₀)} − 2 e^{−α(d − r₀)}] − offset for d < cutoff (LAMMPS ``morse``).

    Parameters
    ----------
    d0, alpha, r0, cutoff : float for one value for all pairs of types, or symmetric (n, n) arrays for types 1..n;
        cutoff 0 = no interaction
    units : unit style of these numbers (alpha: 1/length)
    shift : whether offset = U(cutoff); else 0
    n_types : number of types that single numbers stand for (default 1)
    """

    name = "morse"
    numbers = (("d0", "energy"), ("alpha", {"length": -1}), ("r0", "length"), ("cutoff", "length"))

    @pair_law
    def law(d2, d0, alpha, r0):
        d = np.sqrt(d2)
        x = np.exp(-alpha * (d - r0))
        return d0 * (x * x - 2.0 * x), -(2.0 * d0 * alpha * (x * x - x) / d)


_morse = Morse.law


class MorseSmoothLinear(RadialStyle):
    """Morse minus its value and slope at the cutoff: U = u(d) − u(r_c) − (d − r_c) u'(r_c) (LAMMPS
    ``morse/smooth/linear``).

    Numbers: d0, alpha, r0, cutoff; see `RadialStyle`.
    """

    name = "morse/smooth/linear"
    numbers = Morse.numbers
    shifts = False

    def columns(self, d0, alpha, r0, cutoff):
        x = np.exp(-alpha * (cutoff - r0))
        slope = -2 * d0 * alpha * (x * x - x)
        return d0, alpha, r0, d0 * (x * x - 2 * x) - cutoff * slope, slope

    @pair_law
    def law(d2, d0, alpha, r0, constant, slope):
        u, g = _morse(d2, d0, alpha, r0)
        d = np.sqrt(d2)
        return u - constant - slope * d, g - slope / d


class Pedone(RadialStyle):
    """U = C₀/d¹² + D₀[e^{−2α(d − r₀)} − 2 e^{−α(d − r₀)}] − offset (LAMMPS ``pedone``; Pedone et al., J. Phys. Chem. B
    110, 11780).

    With `shift`, LAMMPS's offset is the Morse part at the cutoff minus (not plus) C₀/r_c¹²; so is this one.

    Numbers: d0, alpha, r0, c0, cutoff; see `RadialStyle`.
    """

    name = "pedone"
    numbers = (*Morse.numbers[:3], ("c0", {"energy": 1, "length": 12}), Morse.numbers[3])

    def fill(self, *numbers, shift):
        super().fill(*numbers, shift=shift)
        if shift:
            c0, cutoff = numbers[-2:]
            self.table[..., -1] -= np.where(cutoff > 0, 2 * c0 / np.where(cutoff > 0, cutoff, 1.0) ** 12, 0.0)

    @pair_law
    def law(d2, d0, alpha, r0, c0):
        u, g = _morse(d2, d0, alpha, r0)
        s2 = 1.0 / d2
        s6 = s2 * s2 * s2
        c = c0 * s6 * s6
        return u + c, g - 12.0 * c * s2


class MOMB(RadialStyle):
    """Morse with Grimme's dispersion: U = u(d) − s₆ C₆/d⁶ / (1 + e^{−D(d/R_r − 1)}) − offset, u that of `Morse` (LAMMPS
    ``momb``).

    Numbers: d0, alpha, r0, c6, rr, s6, damping D, cutoff; see `RadialStyle`.
    """

    name = "momb"
    numbers = (
        *Morse.numbers[:3], ("c6", {"energy": 1, "length": 6}), ("rr", "length"), ("s6", "dimensionless"),
        ("damping", "dimensionless"), Morse.numbers[3],
    )  # fmt: skip

    def columns(self, d0, alpha, r0, c6, rr, s6, damping, cutoff):
        return d0, alpha, r0, s6 * c6, damping / rr, damping

    @pair_law
    def law(d2, d0, alpha, r0, c6, per_rr, damping):
        u, g = _morse(d2, d0, alpha, r0)
        d = np.sqrt(d2)
        s2 = 1.0 / d2
        e = np.exp(-(per_rr * d - damping))
        f = 1.0 / (1.0 + e)
        c = c6 * s2 * s2 * s2 * f
        return u - c, g - c * per_rr * e * f / d + 6.0 * c * s2


one_cutoff(Morse)
one_cutoff(MorseSmoothLinear)
one_cutoff(Pedone)


one_cutoff(MOMB, line=("cutoff", "s6", "damping"))
