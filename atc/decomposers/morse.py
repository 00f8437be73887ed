"""Morse pair styles: cut, shifted in force, and with a repulsion or a dispersion of its own."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import pair_values
from .radial import RadialStyle, one_cutoff
from .registry import StyleInput, pair_style


class Morse(PairStyle):
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

    def __init__(self, d0, alpha, r0, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((d0, alpha, r0, cutoff), units, n_types, shift)

    def fill(self, d0, alpha, r0, cutoff, shift):
        x = np.exp(-alpha * (cutoff - r0))
        self._set(cutoff, d0, alpha, r0, d0 * (x * x - 2 * x) if shift else np.zeros_like(d0))

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _morse(types, i, j, d2, weights, self.table, U, G)


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


class Pedone(RadialStyle):
    """U = C₀/d¹² + D₀[e^{−2α(d − r₀)} − 2 e^{−α(d − r₀)}] − offset (LAMMPS ``pedone``; Pedone et al., J. Phys. Chem. B
    110, 11780).

    With `shift`, LAMMPS's offset is the Morse part at the cutoff minus (not plus) C₀/r_c¹²; so is this one.

    Numbers: d0, alpha, r0, c0, cutoff; see `RadialStyle`.
    """

    name = "pedone"
    numbers = (*Morse.numbers[:3], ("c0", {"energy": 1, "length": 12}), Morse.numbers[3])

    def columns(self, d0, alpha, r0, c0, cutoff):
        return d0, alpha, r0, c0

    def fill(self, *numbers, shift):
        super().fill(*numbers, shift=shift)
        if shift:
            c0, cutoff = numbers[-2:]
            self.table[..., -1] -= np.where(cutoff > 0, 2 * c0 / np.where(cutoff > 0, cutoff, 1.0) ** 12, 0.0)


class MOMB(RadialStyle):
    """Morse with Grimme's dispersion: U = u(d) − s₆ C₆/d⁶ / (1 + e^{−D(d/R_r − 1)}) − offset, u that of `Morse` (LAMMPS
    ``momb``).

    Numbers: d0, alpha, r0, c6, rr, s6, damping D, cutoff; see `RadialStyle`.
    """

    name = "momb"
    numbers = (
        *Morse.numbers[:3],
        ("c6", {"energy": 1, "length": 6}),
        ("rr", "length"),
        ("s6", "dimensionless"),
        ("damping", "dimensionless"),
        Morse.numbers[3],
    )

    def columns(self, d0, alpha, r0, c6, rr, s6, damping, cutoff):
        return d0, alpha, r0, s6 * c6, damping / rr, damping


one_cutoff(MorseSmoothLinear)
one_cutoff(Pedone)


@pair_style("momb")
def _momb_style(inp: StyleInput):
    rc, s6, damping = inp.numbers(inp.args, [("cutoff", "length"), ("s6", "dimensionless"), ("d", "dimensionless")])
    d0, alpha, r0, c6, rr, cutoff = pair_values(inp, (*MOMB.numbers[:5], MOMB.numbers[-1]), optional=1, defaults=[rc])
    return MOMB.internal(
        d0, alpha, r0, c6, rr, np.full_like(d0, s6), np.full_like(d0, damping), cutoff, shift=inp.modify.shift
    )


@pair_style("morse")
def _morse_style(inp: StyleInput):
    (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
    return Morse.internal(*pair_values(inp, Morse.numbers, optional=1, defaults=[rc]), shift=inp.modify.shift)


@njit(cache=True, nogil=True, error_model="numpy")
def _morse(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            d0, alpha = table[ti, tj, 1], table[ti, tj, 2]
            x = np.exp(-alpha * (d - table[ti, tj, 3]))
            U[b] += w * (d0 * (x * x - 2.0 * x) - table[ti, tj, 4])
            G[b] -= w * (2.0 * d0 * alpha * (x * x - x) / d)


@njit(cache=True, nogil=True, error_model="numpy")
def _morse_smooth_linear(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            x = np.exp(-p[2] * (d - p[3]))
            U[b] += w * (p[1] * (x * x - 2.0 * x) - p[4] - p[5] * d)
            G[b] -= w * (2.0 * p[1] * p[2] * (x * x - x) + p[5]) / d


@njit(cache=True, nogil=True, error_model="numpy")
def _pedone(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            s2 = 1.0 / d2[b]
            s6 = s2 * s2 * s2
            x = np.exp(-p[2] * (d - p[3]))
            c = p[4] * s6 * s6
            U[b] += w * (p[1] * (x * x - 2.0 * x) + c - p[5])
            G[b] -= w * (2.0 * p[1] * p[2] * (x * x - x) / d + 12.0 * c * s2)


@njit(cache=True, nogil=True, error_model="numpy")
def _momb(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            s2 = 1.0 / d2[b]
            x = np.exp(-p[2] * (d - p[3]))
            e = np.exp(-(p[5] * d - p[6]))
            f = 1.0 / (1.0 + e)
            c = p[4] * s2 * s2 * s2 * f
            U[b] += w * (p[1] * (x * x - 2.0 * x) - c - p[7])
            G[b] -= w * ((2.0 * p[1] * p[2] * (x * x - x) + c * p[5] * e * f) / d - 6.0 * c * s2)


MorseSmoothLinear.kernel = staticmethod(_morse_smooth_linear)
Pedone.kernel = staticmethod(_pedone)
MOMB.kernel = staticmethod(_momb)
