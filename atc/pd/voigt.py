"""Voigt's order of the components of symmetric tensors."""

from __future__ import annotations

import numpy as np

#: The six symmetric unit strains, Voigt order xx yy zz yz xz xy; shear strains have 1/2 at both places (engineering
#: strain 1).
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))


def unit_strain(v: int) -> np.ndarray:
    """The strain tensor of Voigt component v: shears with ½ on either side."""
    e = np.zeros((3, 3))
    i, j = VOIGT[v]
    e[i, j] = e[j, i] = 1.0 if i == j else 0.5
    return e


def to_voigt(tensor) -> np.ndarray:
    """The six components of a symmetric (3, 3)."""
    return np.array([tensor[i, j] for i, j in VOIGT])
