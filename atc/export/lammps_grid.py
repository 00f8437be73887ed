"""Fields on a lattice in the form of LAMMPS's ``dump grid``, which OVITO shows as voxel grids: cells around the points,
a column for each component by its name (``stress_xy``)."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..running.whole import renamed
from ..units import LAMMPS_STYLES

_LETTERS = "xyz"


def columns_of(arrays: dict, rank: int) -> dict:
    """{column: values} of {name: values}, the first `rank` axes those of the lattice: vectors as ``name_x``, tensors as
    ``name_xy``. A colon would divide a name into what LAMMPS's own names consist of."""
    out = {}
    for name, a in arrays.items():
        name = name.replace(":", "_").replace(" ", "_")
        tail = a.shape[rank:]
        if len(tail) == 0:
            out[name] = a
        elif len(tail) == 1:
            out |= {f"{name}_{_LETTERS[i]}": a[..., i] for i in range(tail[0])}
        else:
            out |= {f"{name}_{_LETTERS[i]}{_LETTERS[j]}": a[..., i, j] for i in range(tail[0]) for j in range(tail[1])}
    return out


def region_of(points, cell, periodic: str):
    """The box of which the points are the centres of equal cells.

    Parameters
    ----------
    points : (nx, ny, nz, 3), a lattice
    cell : (3, 3) of the frame: along an axis with one point a grid cell is as long as it
    periodic : three of "p" and "f", of the frame's cell

    Returns
    -------
    vectors (3, 3), origin (3,), flags ("pp" or "ff", three): periodic where the box has the length of a periodic cell
    """
    n = points.shape[:3]
    steps = np.empty((3, 3))
    for k in range(3):
        if n[k] > 1:
            last = tuple(n[k] - 1 if a == k else 0 for a in range(3))
            steps[k] = (points[last] - points[0, 0, 0]) / (n[k] - 1)
        else:
            steps[k] = cell[k]
    vectors = steps * np.array(n)[:, None]
    size = np.abs(cell).max()
    flags = ["pp" if p == "p" and np.allclose(v, c, atol=1e-9 * size) else "ff"
             for p, v, c in zip(periodic, vectors, cell)]  # fmt: skip
    return vectors, points[0, 0, 0] - 0.5 * steps.sum(0), flags


def header(vectors, origin, flags, shape, columns, step: int, time: float | None, units: str | None, where) -> str:
    """What stands above the numbers of one frame."""
    size = np.abs(vectors).max()
    above = np.abs(vectors[np.triu_indices(3, 1)]).max()
    if above > 1e-12 * size or (np.diag(vectors) <= 0).any():
        raise AtcError(
            f"{where}: LAMMPS's dump grid holds boxes with a along x and b in the x-y plane, this grid's edges are "
            f"{np.round(vectors, 6).tolist()}: take .pvd"
        )
    xy, xz, yz = vectors[1, 0], vectors[2, 0], vectors[2, 1]
    lo, hi = origin.copy(), origin + np.diag(vectors)
    tilted = any((xy, xz, yz))
    if tilted:  # what is printed is the box around the tilted one
        lo[0] += min(0.0, xy, xz, xy + xz)
        hi[0] += max(0.0, xy, xz, xy + xz)
        lo[1] += min(0.0, yz)
        hi[1] += max(0.0, yz)
    tilts = (xy, xz, yz) if tilted else (None,) * 3
    bounds = "\n".join(
        " ".join(f"{v:.16e}" for v in (a, b, t) if v is not None) for a, b, t in zip(lo, hi, tilts, strict=True)
    )
    lines = []
    if units in LAMMPS_STYLES:
        lines += ["ITEM: UNITS", units]
    if time is not None:
        lines += ["ITEM: TIME", repr(time)]
    lines += ["ITEM: TIMESTEP", str(step)]
    lines += [f"ITEM: BOX BOUNDS {'xy xz yz ' if tilted else ''}{' '.join(flags)}", bounds]
    lines += ["ITEM: DIMENSION", "3", "ITEM: GRID SIZE nx ny nz", " ".join(map(str, shape))]
    return "\n".join([*lines, f"ITEM: GRID CELLS {' '.join(columns)}"]) + "\n"


def write_grid(target, frames) -> None:
    """Write frames one after another.

    frames : iterable of (vectors, origin, flags, {column: (nx, ny, nz)}, step, time or None, units or None)
    """
    with renamed(target) as part, open(part, "w") as f:
        for k, (vectors, origin, flags, columns, step, time, units) in enumerate(frames):
            shape = next(iter(columns.values())).shape
            # LAMMPS names the units once, above the first frame, and OVITO finds no more frames if they come again.
            f.write(header(vectors, origin, flags, shape, columns, step, time, None if k else units, target))
            texts = [
                map(repr, (a.astype(int) if a.dtype.kind in "bi" else a).transpose(2, 1, 0).ravel().tolist())
                for a in columns.values()
            ]
            f.writelines(" ".join(row) + "\n" for row in zip(*texts, strict=True))
