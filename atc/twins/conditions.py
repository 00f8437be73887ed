"""What was done to the atoms, as it is done to the nodes: the cell's history, and the smoothed motion of what was
held."""

from __future__ import annotations

import warnings

import numpy as np

from ..errors import AtcError, AtcWarning
from ..frame import Cell
from ..readers.trajectory import Over


def held_open(cell, reference) -> Cell:
    """A frame's cell with the reference's edges along open axes: where the box was drawn there is no deformation."""
    p = cell.periodic
    if not np.array_equal(p, reference.periodic):
        raise AtcError("the reference frame and the trajectory are not periodic along the same axes")
    if p.all():
        return cell
    return Cell(np.where(p[:, None], cell.vectors, reference.vectors), np.where(p, cell.origin, reference.origin), p)


def mapped(x_nc, old: Cell, new: Cell) -> np.ndarray:
    """Positions that move with the cell, as those of LAMMPS's ``remap x`` and of barostats do."""
    return new.cartesian(old.fractional(x_nc))


def gradient(old: Cell, new: Cell) -> np.ndarray:
    """(3, 3) F of the homogeneous deformation of one cell into the other."""
    return (old.inverse @ new.vectors).T


class Run(Over):
    """The frames of a run in cells that have the reference's edges along open axes."""

    def __init__(self, traj, reference):
        super().__init__(traj)
        self.reference = reference

    def _frame(self, k):
        frame = self.base[k]
        if not np.array_equal(frame.ids, self.reference.ids):
            raise AtcError(
                f"{frame.source}: its atoms are not those of the reference {self.reference.source} (by id): give as "
                "[trajectory] reference a frame of the same atoms"
            )
        return frame.replace(cell=held_open(frame.cell, self.reference.cell))


def displacement(frame, reference) -> np.ndarray:
    """(n, 3) x − X of the atoms, unwrapped: what they moved against the cell is less than half of it."""
    affine = mapped(reference.positions, reference.cell, frame.cell)
    s = (frame.positions - affine) @ frame.cell.inverse
    s -= np.where(frame.cell.periodic, np.rint(s), 0.0)
    return s @ frame.cell.vectors + affine - reference.positions


def smoothed_displacement(frame, reference, smoothing, X_gc) -> np.ndarray:
    """(g, 3) u at nodes: that of the cell, and the smoothed rest (linear fields come out exactly)."""
    moved = reference.positions + displacement(frame, reference)
    rest = moved - mapped(reference.positions, reference.cell, frame.cell)
    return mapped(X_gc, reference.cell, frame.cell) - X_gc + smoothing.mean(rest)


def gripped(twin_body, reference, boxes, types) -> np.ndarray:
    """(g,) which nodes are held: those in a box of the reference, or with at least half of their smoothed mass of the
    given types."""
    X = twin_body.body.X_nc
    held = np.zeros(len(X), bool)
    for k, (lo, hi) in enumerate(boxes):
        inside = ((X >= lo) & (X <= hi)).all(axis=1)
        if not inside.any():
            raise AtcError(f"no node of the twin lies in box {k + 1} of grips: check its corners")
        held |= inside
    for t in types:
        inside = twin_body.smoothing.share(reference.types == t) >= 0.5
        if not inside.any():
            raise AtcError(f"no node of the twin is made of atoms of type {t}: check grip_types")
        held |= inside
    return held


def require_moved(frames, reference, made, held) -> None:
    """Warn about atoms that stand still in all frames while others move, if nothing holds the nodes made of them:
    LAMMPS holds whom no fix integrates, and no command says so."""
    if len(frames) < 2 or any(f.velocities is None for f in frames):
        return
    still = np.ones(len(reference), bool)
    for f in frames:
        still &= (f.velocities == 0).all(axis=1) & (f.positions == frames[0].positions).all(axis=1)
    if still.all() or not still.any():
        return
    free = (made.smoothing.share(still) >= 0.5) & ~held.any(axis=1)
    if free.any():
        warnings.warn(
            f"{frames[0].source}: {int(still.sum())} atoms stand still in all frames while others move, and "
            f"{int(free.sum())} nodes made of them are free: if the run held them (no fix integrates them), name them "
            "by grips or grip_types in [twin]",
            AtcWarning,
            stacklevel=3,
        )


def history(times, values):
    """A function t → values, twice differentiable through the frames; constant where there is one frame."""
    if len(times) == 1:
        return lambda t: values[0]
    from scipy.interpolate import CubicSpline, interp1d

    if len(times) < 4:
        return interp1d(times, values, axis=0, bounds_error=False, fill_value=(values[0], values[-1]))
    spline = CubicSpline(times, values, axis=0)
    return lambda t: spline(min(max(t, times[0]), times[-1]))


def between(a: Cell, b: Cell, share: float) -> Cell:
    """The cell on the straight way from one frame's to the next one's."""
    return Cell(a.vectors + share * (b.vectors - a.vectors), a.origin + share * (b.origin - a.origin), a.periodic)


def deform(sim, new: Cell) -> None:
    """Move the cell of a simulation and its nodes with it; velocities stay."""
    if sim.cell == new:
        return
    reference = sim.body.cell
    H = gradient(reference, new) - np.eye(3)
    sim._z[:, :3] = mapped(sim.positions_nc, sim.cell, new) - sim.body.X_nc
    sim.model.images[:, 3:] = sim.model.images[:, :3] @ H.T
    sim.cell, sim.strained = new, True
    for law in sim.rigid:  # forces on atoms look for images in it
        law.cell = new
    sim._contact_energy, sim._rigid_energy = sim._all_forces(damage=False)


def clock(frames, timestep) -> np.ndarray:
    """(frames,) times in internal units, from 0."""
    times = [f.time for f in frames]
    if any(t is None for t in times):
        if timestep is None or any(f.step is None for f in frames):
            raise AtcError(
                f"{frames[0].source}: the frames have no times: give timestep, the time of one step, in [twin]"
            )
        times = [f.step * timestep for f in frames]
    times = np.array(times, float) - times[0]
    if (np.diff(times) <= 0).any():
        k = int(np.flatnonzero(np.diff(times) <= 0)[0]) + 1
        raise AtcError(f"{frames[k].source}: its time is not after that of the frame before: leave it out by frames")
    return times
