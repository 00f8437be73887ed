"""Voigt's order of the components of symmetric tensors."""

from __future__ import annotations

import numpy as np

#: Places of the six components, Voigt order xx yy zz yz xz xy.
VOIGT = ((0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1))
_I, _J = np.array(VOIGT).T
#: Which component each place of a tensor has.
_PLACE = np.array([[0, 5, 4], [5, 1, 3], [4, 3, 2]])
#: The six symmetric matrices of the components: 1 wherever a component stands.
BASIS = (_PLACE == np.arange(6)[:, None, None]).astype(float)


def unit_strain(v: int) -> np.ndarray:
    """The strain tensor of Voigt component v: shears with ½ on either side (engineering strain 1)."""
    return BASIS[v] * (1.0 if v < 3 else 0.5)


def to_voigt(tensor) -> np.ndarray:
    """(..., 6) the components of symmetric tensors (..., 3, 3)."""
    return np.asarray(tensor)[..., _I, _J]


def from_voigt(v, shears: float = 1.0) -> np.ndarray:
    """(..., 3, 3) symmetric tensors of components (..., 6); `shears` multiplies those off the diagonal."""
    return np.where(np.eye(3, dtype=bool), 1.0, shears) * np.asarray(v, float)[..., _PLACE]


def tensor_of(C_vv) -> np.ndarray:
    """(3, 3, 3, 3) C_ijkl of elastic constants in Voigt's notation."""
    return np.asarray(C_vv)[_PLACE[:, :, None, None], _PLACE]


def constants_of(C) -> np.ndarray:
    """(6, 6) elastic constants in Voigt's notation of C_ijkl."""
    return C[_I[:, None], _J[:, None], _I, _J]


def of_springs(S_bcc, xi_bc) -> np.ndarray:
    """(6, 6) the constants whose acoustic tensor C_ijkl k_j k_l is that of springs: C_ijkl = [ik, jl] + [jk, il] −
    [ij, kl] with [ik, jl] = Σ S_ik ξ_j ξ_l (Born and Huang)."""
    q = np.einsum("bik,bj,bl->ikjl", S_bcc, xi_bc, xi_bc)
    return constants_of(np.einsum("ikjl->ijkl", q) + np.einsum("jkil->ijkl", q) - q)
