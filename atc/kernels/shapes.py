"""Named polynomials of s = r/R, with the normalisation in closed form (formulas: `radial`)."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from .base import positive
from .radial import Radial


@dataclass(frozen=True)
class Shape:
    """A family of kernels by their shape.

    pieces : (radius as a fraction of R, coefficients of (ρ/R_m)^k, k = 0..4) of each piece
    normalisation : 1/∫ of their sum over space, times R³; in the plane it is computed
    """

    name: str
    pieces: tuple
    normalisation: float
    aliases: tuple[str, ...] = ()
    takes: tuple[str, ...] = ("radius",)

    def of(self, dimension=None, *, radius) -> Radial:
        R = positive("radius", radius, self.name)
        coef_mk = np.zeros((len(self.pieces), 5))
        for m, (_, c) in enumerate(self.pieces):
            coef_mk[m, : len(c)] = c
        return Radial(self.name, np.array([f * R for f, _ in self.pieces]), coef_mk, self.normalisation / R**3)


SHAPES = (
    Shape("step", ((1.0, (1.0,)),), 3 / (4 * pi)),
    Shape("linear", ((1.0, (1.0, -1.0)),), 3 / pi),
    # LAMMPS fix atc's cubic_sphere and quartic_sphere; its step is the one above.
    Shape("cubic", ((1.0, (1.0, 0.0, -3.0, 2.0)),), 15 / (4 * pi), ("cubic_sphere",)),
    Shape("quartic", ((1.0, (1.0, 0.0, -2.0, 0.0, 1.0)),), 105 / (32 * pi), ("quartic_sphere",)),
    Shape("lucy", ((1.0, (1.0, 0.0, -6.0, 8.0, -3.0)),), 105 / (16 * pi)),
    # MDStressLab's: 1 up to R/2, then 2(1 − s).
    Shape("hardy", ((1.0, (2.0, -2.0)), (0.5, (-1.0, 1.0))), 8 / (5 * pi)),
)
