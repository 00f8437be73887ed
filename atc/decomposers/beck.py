"""Beck's potential of helium."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .radial import RadialStyle, one_cutoff
from .registry import StyleInput

# Å², and LAMMPS takes it as a square of its own unit of length.
_BECK = 2.709


class Beck(RadialStyle):
    """U = A e^{−αd − βd⁶} − B/(d² + a²)³ [1 + (2.709 + 3a²)/(d² + a²)] for d < cutoff (LAMMPS ``beck``; Beck, Mol.
    Phys. 14, 311).

    2.709 is a squared length in the unit style's unit, as in LAMMPS: meant in Å². Numbers: A, B, a, alpha, beta, square
    (2.709 in that unit), cutoff; see `RadialStyle`.
    """

    name = "beck"
    numbers = (
        ("A", "energy"),
        ("B", {"energy": 1, "length": 6}),
        ("a", "length"),
        ("alpha", {"length": -1}),
        ("beta", {"length": -6}),
        ("square", {"length": 2}),
        ("cutoff", "length"),
    )
    shifts = False

    def columns(self, A, B, a, alpha, beta, square, cutoff):
        return A, alpha, beta, B, a**2, square + 3 * a**2


def _beck_lines(inp: StyleInput) -> StyleInput:
    """The lines with the constant put in its place."""
    lines = tuple(
        line.__class__(line.types, (*line.words[:5], str(_BECK), *line.words[5:]), line.where) for line in inp.coeffs
    )
    for line in inp.coeffs:
        inp.numbers(line.words, (*Beck.numbers[:5], Beck.numbers[6]), line, optional=1)
    return inp.replace(coeffs=lines)


one_cutoff(Beck, lines=_beck_lines)


@njit(cache=True, nogil=True, error_model="numpy")
def _beck(types, i, j, d2, weights, table, U, G):
    weighted = len(weights) > 0
    for b in range(len(d2)):
        p = table[types[i[b]], types[j[b]]]
        if d2[b] < p[0]:
            w = weights[b] if weighted else 1.0
            d = np.sqrt(d2[b])
            d4 = d2[b] * d2[b]
            x = p[1] * np.exp(-p[2] * d - p[3] * d4 * d2[b])
            s = 1.0 / (d2[b] + p[5])
            c = p[4] * s * s * s
            U[b] += w * (x - c * (1.0 + p[6] * s))
            G[b] -= w * (x * (p[2] / d + 6.0 * p[3] * d4) - c * s * (6.0 + 8.0 * p[6] * s))


Beck.kernel = staticmethod(_beck)
