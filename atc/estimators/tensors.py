"""Symmetric tensors as six components xx, yy, zz, yz, xz, xy."""

from __future__ import annotations

import numpy as np

_FULL = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def full(a_6) -> np.ndarray:
    """(..., 6) symmetric components xx, yy, zz, yz, xz, xy to (..., 3, 3)."""
    return np.asarray(a_6)[..., _FULL]


def outer6(v_nc) -> np.ndarray:
    """v⊗v as 6 components, (n, 3) to (n, 6)."""
    x, y, z = v_nc.T
    return np.stack([x * x, y * y, z * z, y * z, x * z, x * y], axis=1)
