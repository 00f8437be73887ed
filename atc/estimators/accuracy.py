"""The error of a result, measured on the spot: the same sums at random grid points by the exact method, over a path of their own.

The points are taken out of their grid and handed to the direct sum as scattered points: other rows, other order of summation, no mesh.
For the exact method itself what is left is rounding; for an approximate one it is its error.
"""

from __future__ import annotations

import numpy as np


def kernel_internal(kern, units):
    """The user's kernel in internal units."""
    return kern if units.length == 1.0 else kern.scaled(units.length)


class Check:
    """Random points of a grid at which every field is computed a second time.

    Parameters
    ----------
    bound : bound grid
    kern : kernel in internal units
    cell, x_nc : of the frame
    threads : int
    index : int
        Number of the frame: the same points whoever computes it, and whenever.
    count : int
    """

    def __init__(self, bound, kern, cell, units, x_nc, threads, index, count):
        from .compute import Target

        total = int(np.prod(bound.shape))
        rng = np.random.default_rng([20240229, index])
        self.which = np.sort(rng.choice(total, min(total, count), replace=False))
        self.target = Target("direct", bound.subset(self.which), kern, cell, threads)

    def errors(self, field_g, at_points) -> dict[str, float]:
        """Largest and rms difference between the field and its second computation.

        Returns
        -------
        error_max : largest difference of any component over the largest value of the field
        error_l2 : rms difference over the rms of the field
        error_of_fluctuation : largest difference over the largest deviation of the field from its mean
        """
        difference = np.abs(field_g[self.which] - at_points)
        worst = float(difference.max(initial=0.0))
        rms = float(np.sqrt(np.mean(difference**2))) if difference.size else 0.0
        largest = float(np.abs(field_g).max(initial=0.0))
        spread = float(np.abs(field_g - field_g.mean(0)).max(initial=0.0)) if len(field_g) else 0.0
        return {
            "error_max": _ratio(worst, largest),
            "error_l2": _ratio(rms, float(np.sqrt(np.mean(field_g**2))) if field_g.size else 0.0),
            "error_of_fluctuation": _ratio(worst, spread),
        }


def _ratio(a: float, b: float) -> float:
    return a / b if b > 0 else 0.0 if a == 0 else float("inf")
