"""What people write of grids, checked: numbers, shapes, spacings, axes, regions."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError

_AXES = {"x": 0, "y": 1, "z": 2, "a": 0, "b": 1, "c": 2, 0: 0, 1: 1, 2: 2}


def floats(what, value):
    """`value` as an array of floats."""
    try:
        return np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise AtcError(f"{what} must be numbers, got {value!r}") from None


def numbers(what, value, shape):
    """`value` as a float array of `shape` (None: any length along that axis), all finite, or an AtcError."""
    a = floats(what, value)
    if a.ndim != len(shape) or any(s is not None and s != n for s, n in zip(shape, a.shape)):
        want = " x ".join("n" if s is None else str(s) for s in shape)
        raise AtcError(f"{what}: expected {want} numbers, got shape {a.shape}")
    if not np.isfinite(a).all():
        raise AtcError(f"{what} must be finite, got {value!r}" if a.size < 10 else f"{what} must all be finite")
    return a


def counts(what, value, n):
    """`value` as n positive integers (one is repeated)."""
    a = np.asarray(value)
    whole = a.dtype.kind in "iu" or (a.dtype.kind == "f" and np.isfinite(a).all() and (a == np.round(a)).all())
    if not whole or a.ndim > 1 or a.size not in (1, n):
        raise AtcError(f"{what} must be {n} whole numbers, got {value!r}")
    a = np.array(np.broadcast_to(a.reshape(-1), (n,)), dtype=np.int64)
    if (a <= 0).any():
        raise AtcError(f"{what} must be positive, got {value!r}: a grid needs at least one point along each axis")
    return tuple(int(k) for k in a)


def distances(value, n):
    """A spacing as n positive lengths (one is repeated)."""
    a = floats("grid spacing", value)
    if a.ndim > 1 or a.size not in (1, n) or not np.isfinite(a).all() or (a <= 0).any():
        raise AtcError(f"grid spacing must be positive and finite, one number or {n}, got {value!r}")
    return np.array(np.broadcast_to(a.reshape(-1), (n,)))


def points(what, value, shape):
    """Points (or one point, or vectors) as float arrays: ``shape`` with a 3 last. Those of two numbers get NaN for z,
    which is filled in when the plane is known."""
    a = floats(what, value)
    if a.ndim == len(shape) and a.shape[-1:] == (2,):
        two = numbers(what, value, (*shape[:-1], 2))
        return np.concatenate([two, np.full((*two.shape[:-1], 1), np.nan)], axis=-1)
    return numbers(what, value, shape)


def axis(axis) -> int:
    """The number of an axis of the cell."""
    try:
        return _AXES[axis]
    except (KeyError, TypeError):
        raise AtcError(f"axis must be one of 'x', 'y', 'z' (or 0, 1, 2), got {axis!r}") from None


def at(at) -> float:
    """Where in its cell a point lies: ½ in the middle, 0 at the corner."""
    if at not in ("centers", "corners"):
        raise AtcError(f"grid points are at 'centers' or at 'corners', got {at!r}")
    return 0.5 if at == "centers" else 0.0


def shape_or_spacing(shape, spacing, n):
    """(numbers of points, None) or (None, distances) along n axes. Of a grid in the plane 0 layers, or −n where one
    number n stands for all axes: which it is, is known when it is bound."""
    if (shape is None) == (spacing is None):
        raise AtcError("a grid needs either a shape (numbers of points) or a spacing")
    given = shape if spacing is None else spacing
    if n == 3 and np.ndim(given) == 1 and len(given) == 2:
        if spacing is None:
            return (*counts("grid shape", shape, 2), 0), None
        return None, np.append(distances(spacing, 2), np.nan)
    if n == 3 and spacing is None and np.ndim(shape) == 0:
        return (*counts("grid shape", shape, 2), -counts("grid shape", shape, 1)[0]), None
    return (counts("grid shape", shape, n), None) if spacing is None else (None, distances(spacing, n))


def padding(value) -> dict:
    """{"padding": a length or "auto"}, nothing for None."""
    if value is None:
        return {}
    if isinstance(value, str):
        if value != "auto":
            raise AtcError(f'grid padding {value!r}: expected a length, or "auto" for the reach of the kernel')
        return {"padding": value}
    length = numbers("grid padding", value, ())
    if length < 0:
        raise AtcError(f"grid padding {value!r}: expected a length of 0 or more")
    return {"padding": float(length)}


def region(cell) -> np.ndarray:
    """(3, 3) edge vectors of a region given by lengths or edge vectors, two or three; of two, NaN at the end."""
    v = np.asarray(cell, dtype=object)
    n = 2 if v.shape[:1] == (2,) else 3
    if v.ndim == 1:
        given = np.diag(numbers("grid region", cell, (n,)))
    else:
        given = points("grid region", cell, (2, 3)) if n == 2 else numbers("grid region", cell, (3, 3))
    out = np.eye(3)
    out[:n, :n] = given[:, :n]
    lengths = np.linalg.norm(out, axis=1)
    if (lengths == 0).any() or abs(np.linalg.det(out)) <= 1e-14 * lengths.prod():
        raise AtcError(f"the grid's region has no volume: edge vectors {out.tolist()}")
    if n == 2:
        out[2, 2] = np.nan
    return out
