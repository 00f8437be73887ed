"""Trajectories of two-dimensional runs, and potentials for them; see `atc.planar`."""

from __future__ import annotations

from copy import copy

from ..errors import AtcError
from ..frame import Frame
from ..planar import planar
from .trajectory import Over, Trajectory


class Planar(Over):
    """Another trajectory, of a two-dimensional run."""

    def __init__(self, base: Trajectory):
        super().__init__(base)
        self.units, self.dimension = base.units.planar, 2

    def _frame(self, k):
        return planar(self.base._frame(k))


def in_dimension(trajectory: Trajectory, dimension) -> Trajectory:
    """A trajectory read as one of a run in 2 or 3 dimensions; None: whatever the potential says later, else 3."""
    if dimension is None:
        return trajectory
    if isinstance(dimension, bool) or dimension not in (2, 3):
        raise AtcError(f"dimension {dimension!r}: expected 2 (a run in the plane, LAMMPS's dimension 2) or 3")
    if trajectory.units.dimension == 2:
        if dimension == 3:
            raise AtcError(
                f"{trajectory.source} was opened as a two-dimensional run, but the dimension argument says 3"
            )
        return trajectory
    if dimension == 2:
        return Planar(trajectory)
    from .memory import Adapted

    said = Adapted(trajectory)
    said.dimension = 3
    return said


def matched(frames, pot=None):
    """Frames and a potential for the same number of dimensions: what one of them says, the other one is told.

    Parameters
    ----------
    frames : Frame, list of Frames or Trajectory
    pot : Potential or None (or a model of another make, without terms, which says nothing of it)

    Returns
    -------
    frames, pot

    Raises
    ------
    AtcError where they contradict each other.
    """
    one = frames if isinstance(frames, (Frame, Trajectory)) else frames[0] if len(frames) else None
    if one is None:
        return frames, pot
    flat = one.units.dimension == 2
    if pot is None or not pot.terms:
        return frames, pot
    if flat and pot.dimension == 3:
        if pot.dimension_said:
            raise AtcError(
                f"{one.source} is read as a two-dimensional run, but the potential says dimension 3: make them agree"
            )
        pot = copy(pot)
        pot.dimension = 2
    elif not flat and pot.dimension == 2:
        if isinstance(one, Trajectory) and one.dimension == 3:
            raise AtcError(
                f"{one.source} is read with dimension = 3, but the potential says dimension 2: make them agree"
            )
        if isinstance(frames, Frame):
            frames = planar(frames)
        elif isinstance(frames, Trajectory):
            frames = Planar(frames)
        else:
            frames = [planar(f) for f in frames]
    return frames, pot
