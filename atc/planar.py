"""Two-dimensional runs (LAMMPS's ``dimension 2``): frames in a plane z = const; trajectories: `readers.planar`.

A frame in two dimensions is one whose atoms all lie in the plane, in a cell whose third edge is one internal unit of
length along z and does not repeat; the plane goes through its middle. The cell's volume is then an area, so that
everything divided by it is per area; bonds have no z component, and what is summed over them knows nothing of the third
dimension. What is left to differ has it from one of two places: the units (`Units.planar`: names, factors, degrees of
freedom) and the kernel (`Kernel.planar`: its normalisation ∫φ dA = 1, its transform, its integral along a line).
"""

from __future__ import annotations

import numpy as np

from .errors import AtcError
from .frame import Cell, Frame

#: How far from the plane an atom may be, in cell sizes; and how fast out of it, over the largest speed: what a change
#: of units leaves.
FLAT = 1e-9


def planar(frame: Frame) -> Frame:
    """A frame as one of a two-dimensional run.

    Parameters
    ----------
    frame : Frame, all of whose atoms have the same z and no velocity along it; the edges a and b of its cell lie in the
        xy plane

    Returns
    -------
    Frame with the same z, in a cell whose third edge is 1 (internal) along z and open, with `Units.planar`

    Raises
    ------
    AtcError that names an atom off the plane or moving out of it, or the edge that is not in the plane.
    """
    if frame.dimension == 2:
        return frame
    v = frame.cell.vectors
    size = float(np.linalg.norm(v[:2], axis=1).max())
    for name, edge in zip("ab", v[:2]):
        if abs(edge[2]) > FLAT * size:
            raise AtcError(
                f"{frame.source}: a two-dimensional run lies in the xy plane, but edge {name} of the cell has a z "
                "component: rotate it, or use dimension = 3"
            )
    if not abs(v[0, 0] * v[1, 1] - v[0, 1] * v[1, 0]) > 1e-14 * size**2:
        raise AtcError(f"{frame.source}: the edges a and b of the cell enclose no area")
    x_nc = frame.positions
    z = float(np.median(x_nc[:, 2])) if len(x_nc) else float(frame.cell.origin[2] + 0.5 * v[2, 2])
    if z != 0.0 and abs(z) <= FLAT * size:
        z = 0.0
    _flat(
        frame,
        x_nc[:, 2] - z,
        FLAT * size,
        lambda k: f"lies at z = {_shown(frame, 'length', x_nc[k, 2])}, others at {_shown(frame, 'length', z)}",
    )
    changes = {}
    if frame.velocities is not None:
        v_nc = frame.velocities
        fastest = float(np.abs(v_nc).max(initial=0.0))
        _flat(
            frame,
            v_nc[:, 2],
            FLAT * fastest,
            lambda k: f"has the velocity vz = {_shown(frame, 'velocity', v_nc[k, 2])}",
        )
        changes["velocities"] = v_nc * [1.0, 1.0, 0.0]
    if frame.images is not None:
        changes["images"] = frame.images * np.array([1, 1, 0], dtype=frame.images.dtype)
    flat = x_nc.copy()
    flat[:, 2] = z
    edges = np.array([[*v[0, :2], 0.0], [*v[1, :2], 0.0], [0.0, 0.0, 1.0]])
    cell = Cell(edges, [*frame.cell.origin[:2], z - 0.5], [*frame.cell.periodic[:2], False])
    return frame.replace(positions=flat, cell=cell, units=frame.units.planar, **changes)


def _flat(frame, off_n, limit, what):
    off = np.flatnonzero(np.abs(off_n) > limit)
    if len(off):
        k = int(off[0])
        raise AtcError(
            f"{frame.source}: a two-dimensional run lies in a plane, but atom {frame.ids[k]} {what(k)} ({len(off)} of "
            f"{len(frame)} atoms are off): "
            "use fix enforce2d in the run, or dimension = 3"
        )


def _shown(frame, dimension, value) -> str:
    return f"{frame.units.to_user(dimension, float(value)):.10g} {frame.units.label(dimension)}"


def thin(frame: Frame) -> bool:
    """Whether a frame looks like one of a two-dimensional run: all atoms at one z, in a cell that repeats along z and
    is hardly thicker than an atom."""
    n, cell = len(frame), frame.cell
    # Nodes with a volume of their own are pieces of a continuum.
    if frame.dimension == 2 or n < 16 or "volume" in frame.extra or not cell.periodic[2] or not cell.volume > 0:
        return False
    height = float(cell.heights[2])
    apart = np.sqrt(cell.volume / height / n)
    z = frame.positions[:, 2]
    moving = frame.velocities is not None and bool(frame.velocities[:, 2].any())
    return bool(np.ptp(z) <= FLAT * height and height <= 1.2 * apart and not moving)
