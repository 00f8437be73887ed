"""Beck's potential of helium."""

from __future__ import annotations

import numpy as np

from .loop import pair_law
from .radial import RadialStyle, one_cutoff

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
        ("A", "energy"), ("B", {"energy": 1, "length": 6}), ("a", "length"), ("alpha", {"length": -1}),
        ("beta", {"length": -6}), ("square", {"length": 2}), ("cutoff", "length"),
    )  # fmt: skip
    shifts = False

    def columns(self, A, B, a, alpha, beta, square, cutoff):
        return A, alpha, beta, B, a**2, square + 3 * a**2

    @pair_law
    def law(d2, A, alpha, beta, B, a2, square):
        d = np.sqrt(d2)
        d4 = d2 * d2
        x = A * np.exp(-alpha * d - beta * d4 * d2)
        s = 1.0 / (d2 + a2)
        c = B * s * s * s
        return x - c * (1.0 + square * s), -(x * (alpha / d + 6.0 * beta * d4) - c * s * (6.0 + 8.0 * square * s))


one_cutoff(Beck, constants={"square": _BECK})
