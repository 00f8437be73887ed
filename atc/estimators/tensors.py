"""Symmetric tensors as six components xx, yy, zz, yz, xz, xy, others with three more; quotients of fields."""

from __future__ import annotations

import numpy as np

_FULL = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])


def full(a_6) -> np.ndarray:
    """(..., 6) symmetric components xx, yy, zz, yz, xz, xy to (..., 3, 3)."""
    return np.asarray(a_6)[..., _FULL]


_ACROSS = np.array([[0, 2, 1], [2, 0, 0], [1, 0, 0]])
_SIGN = np.array([[0.0, 1.0, 1.0], [-1.0, 0.0, 1.0], [-1.0, -1.0, 0.0]])


def general(a_9) -> np.ndarray:
    """(..., 9) the components of the symmetric part, then yz, xz, xy of the antisymmetric one, to (..., 3, 3)."""
    a_9 = np.asarray(a_9)
    return full(a_9[..., :6]) + _SIGN * a_9[..., 6:][..., _ACROSS]


def outer6(v_nc) -> np.ndarray:
    """v⊗v as 6 components, (n, 3) to (n, 6)."""
    x, y, z = v_nc.T
    return np.stack([x * x, y * y, z * z, y * z, x * z, x * y], axis=1)


def quotient(a, w) -> np.ndarray:
    """a/w, w along the first axes of a; 0 where w is not positive."""
    w = w.reshape(w.shape + (1,) * (a.ndim - w.ndim))
    return np.divide(a, w, out=np.zeros_like(a), where=w > 0)
