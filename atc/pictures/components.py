"""Scalars of tensors and vectors, by the names that pictures, tables and the command line use."""

from __future__ import annotations

import difflib

import numpy as np

from ..errors import AtcError

TENSOR = ["xx", "yy", "zz", "xy", "xz", "yz", "yx", "zx", "zy"]
TENSOR_SCALARS = ["hydrostatic", "pressure", "vonmises", "max_shear", "principal1", "principal2", "principal3"]
VECTOR = ["x", "y", "z", "magnitude"]


def names(rank: int, dimension: int = 3) -> list[str]:
    """The components of a vector (rank 1) or symmetric tensor (rank 2) that say anything: in two dimensions those
    without z."""
    every = VECTOR if rank == 1 else TENSOR[:6]
    return [c for c in every if dimension == 3 or c == "magnitude" or "z" not in c]


def component(values, name: str | None, dimension: int = 3, rank: int | None = None):
    """One scalar of a tensor (..., 3, 3) or vector (..., 3) field, as an array (...); the field itself for None.

    Tensors: ``xx`` … ``zz``; ``hydrostatic`` = tr σ/d (tension positive; d the `dimension`), ``pressure`` its negative,
    ``vonmises`` = √(3/2 s:s) of the symmetric part's deviator s, ``max_shear`` = (σ₁ − σ₃)/2, ``principal1`` ≥
    ``principal2`` ≥ ``principal3``. Vectors: ``x``, ``y``, ``z``, ``magnitude``. `rank`: 1 or 2; not given it is told
    from the shape, by which vectors at three points are taken for a tensor.
    """
    values = np.asarray(values)
    if name is None:
        return values
    tensor = values.ndim >= 2 and values.shape[-2:] == (3, 3) if rank is None else rank == 2
    if tensor and name in TENSOR:
        return values[..., "xyz".index(name[0]), "xyz".index(name[1])]
    if not tensor and name in ("x", "y", "z"):
        return values[..., "xyz".index(name)]
    if not tensor and name == "magnitude":
        return np.sqrt((values * values).sum(axis=-1))
    if not tensor or name not in TENSOR_SCALARS:
        known = TENSOR + TENSOR_SCALARS if tensor else VECTOR
        near = difflib.get_close_matches(name, known, n=1)
        raise AtcError(
            f"unknown component {name!r}: {f'did you mean {near[0]!r}? ' if near else ''}known: {', '.join(known)}"
        )
    trace = np.einsum("...ii->...", values)
    if name == "hydrostatic":
        return trace / dimension
    if name == "pressure":
        return -trace / dimension
    sym = 0.5 * (values + np.swapaxes(values, -1, -2))
    if name == "vonmises":
        dev = sym - (trace / 3)[..., None, None] * np.eye(3)
        return np.sqrt(1.5 * (dev * dev).sum(axis=(-1, -2)))
    # eigvalsh refuses NaN: undefined points stay undefined
    good = np.isfinite(sym).all(axis=(-1, -2))
    principal = np.full(sym.shape[:-1], np.nan)
    principal[good] = np.linalg.eigvalsh(sym[good])[..., ::-1]
    if dimension == 2:
        # The principal values in the plane; the third one, of the direction that there is none of, comes last.
        flat = np.full((*sym.shape[:-2], 3), np.nan)
        flat[good, :2] = np.linalg.eigvalsh(sym[good][..., :2, :2])[..., ::-1]
        flat[good, 2] = 0.0
        principal = flat
        if name == "max_shear":
            return 0.5 * (principal[..., 0] - principal[..., 1])
    if name == "max_shear":
        return 0.5 * (principal[..., 0] - principal[..., 2])
    return principal[..., int(name[-1]) - 1]


#: What a scalar is called in a label.
SYMBOL = {
    "hydrostatic": "hydrostatic part",
    "pressure": "pressure",
    "vonmises": "von Mises",
    "max_shear": "maximum shear",
    "principal1": "first principal value",
    "principal2": "second principal value",
    "principal3": "third principal value",
    "magnitude": "magnitude",
}
