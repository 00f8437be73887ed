"""Buckingham and Born-Mayer-Huggins pair styles: an exponential wall and inverse powers."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .pair import PairStyle
from .pair_input import pair_values
from .registry import StyleInput, pair_style

_C = ("C", {"energy": 1, "length": 6})


class Buckingham(PairStyle):
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

    def __init__(self, A, rho, C, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((A, rho, C, cutoff), units, n_types, shift)

    def fill(self, A, rho, C, cutoff, shift):
        zero = np.zeros_like(A)
        _fill(self, A, rho, zero, C, zero, cutoff, shift)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _born(types, i, j, d2, weights, self.table, U, G)


class Born(PairStyle):
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
        ("A", "energy"),
        ("rho", "length"),
        ("sigma", "length"),
        _C,
        ("D", {"energy": 1, "length": 8}),
        ("cutoff", "length"),
    )

    def __init__(self, A, rho, sigma, C, D, cutoff, *, units, shift: bool = False, n_types: int | None = None):
        self._take((A, rho, sigma, C, D, cutoff), units, n_types, shift)

    def fill(self, A, rho, sigma, C, D, cutoff, shift):
        _fill(self, A, rho, sigma, C, D, cutoff, shift)

    def add(self, types, i, j, d2, weights, U, G, prepared):
        _born(types, i, j, d2, weights, self.table, U, G)


def _fill(style, A, rho, sigma, C, D, cutoff, shift):
    rc = np.where(cutoff > 0, cutoff, np.inf)
    inverse = 1.0 / np.where(rho > 0, rho, np.inf)
    offset = (
        A * np.exp((sigma - np.where(cutoff > 0, cutoff, 0.0)) * inverse) - C / rc**6 + D / rc**8
        if shift
        else np.zeros_like(A)
    )
    style._set(cutoff, A, inverse, sigma, C, D, offset)


def _builder(cls):
    def build(inp: StyleInput):
        (rc,) = inp.numbers(inp.args, [("cutoff", "length")])
        for line in inp.coeffs:
            if len(line.words) > 1 and inp.number(line.words[1], "length", "rho", line) <= 0:
                raise inp.error(f"{inp.command}: rho must be positive, got {line.words[1]}", line)
        return cls.internal(*pair_values(inp, cls.numbers, optional=1, defaults=[rc]), shift=inp.modify.shift)

    return build


for _cls in (Buckingham, Born):
    pair_style(_cls.name)(_builder(_cls))


@njit(cache=True, nogil=True, error_model="numpy")
def _born(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        ti, tj = types[i[b]], types[j[b]]
        if d2[b] < table[ti, tj, 0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            s2 = 1.0 / d2[b]
            s6 = s2 * s2 * s2
            inverse = table[ti, tj, 2]
            x = table[ti, tj, 1] * np.exp((table[ti, tj, 3] - d) * inverse)
            c = table[ti, tj, 4] * s6
            e = table[ti, tj, 5] * s6 * s2
            U[b] += w * (x - c + e - table[ti, tj, 6])
            G[b] -= w * (x * inverse / d - (6.0 * c - 8.0 * e) * s2)
