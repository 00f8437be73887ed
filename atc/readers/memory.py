"""Frames that are in memory already."""

from __future__ import annotations

from ..errors import AtcError
from ..frame import Frame
from .masses import Masses, check_units
from .trajectory import Over, Trajectory


class FrameList(Trajectory):
    """A trajectory of given frames (internal units). `units` only checks; `masses` replaces theirs."""

    def __init__(self, frames, units=None, masses=None):
        super().__init__()
        self._frames = [frames] if isinstance(frames, Frame) else list(frames)
        if not self._frames:
            raise AtcError("there are no frames in the list")
        self.units = self._frames[0].units
        self.source = self._frames[0].source
        for k, f in enumerate(self._frames):
            if not isinstance(f, Frame):
                raise AtcError(f"item {k} of the list is a {type(f).__name__}, expected a Frame like the first")
            if f.units.name != self.units.name:
                raise AtcError(
                    f"frame {k} of the list has units {f.units.name!r}, the first {self.units.name!r}: they must agree"
                )
            if f.dimension != self.units.dimension:
                raise AtcError(
                    f"frame {k} of the list is of a {f.dimension}-D run, the first of a {self.units.dimension}-D one: "
                    "they must agree"
                )
        check_units(units, self.units, f"the frames are in {self.units.name!r} units")
        self.dimension = 2 if self.units.dimension == 2 else None
        self._masses = None if masses is None else Masses(masses, self.units)

    @property
    def type_names(self):
        return dict(self._frames[0].type_names)

    def __len__(self):
        return len(self._frames)

    def _frame(self, k):
        return _with_masses(self._frames[k], self._masses)


def _with_masses(frame: Frame, masses: Masses | None) -> Frame:
    return frame if masses is None else frame.replace(masses=masses(frame.types, frame.type_names, frame.source))


class Completed(Over):
    """Another trajectory, its frames with what the LAMMPS script of a potential says of their atoms (see
    `Potential.complete`)."""

    def __init__(self, base: Trajectory, pot):
        super().__init__(base)
        self.pot = pot

    def _frame(self, k):
        return self.pot.complete(self.base[k])


class Since(Over):
    """Another trajectory from its second frame on, every frame with the one before it."""

    def __init__(self, base: Trajectory):
        super().__init__(base)
        self._last: tuple = (None, None)

    def __len__(self):
        return len(self.base) - 1

    def _has(self, k):
        return self.base._has(k + 1)

    def _frame(self, k):
        before = self._last[1] if self._last[0] == k else self.base[k]
        now = self.base[k + 1]
        self._last = (k + 1, now)
        return now.replace(before=before)


def since_the_frame_before(frames):
    """Frames, or a trajectory, from the second on, each with the one before it.

    Raises
    ------
    AtcError : if there is one frame only
    """
    if len(frames) < 2:
        raise AtcError('interval = "frames": counts what passes from frame to frame, but there is one frame only')
    return Since(frames if isinstance(frames, Trajectory) else FrameList(frames))


def completed(frames, pot):
    """Frames or a trajectory, as a potential's script completes them."""
    if pot is None or pot.setup is None or _is_completed(frames, pot.setup):
        return frames
    if isinstance(frames, Trajectory):
        return Completed(frames, pot)
    return [pot.complete(f) for f in frames]


def _is_completed(frames, setup) -> bool:
    """Whether a trajectory, or the one it is a part of, has been completed by this script: once is enough."""
    while isinstance(frames, Over):
        if isinstance(frames, Completed) and frames.pot.setup is setup:
            return True
        frames = frames.base
    return False


class Adapted(Over):
    """Another trajectory with other masses."""

    def __init__(self, base: Trajectory, units=None, masses=None):
        super().__init__(base)
        check_units(units, base.units, f"{base.source} was opened in {base.units.name!r} units")
        self._masses = None if masses is None else Masses(masses, self.units)

    def _frame(self, k):
        return _with_masses(self.base[k], self._masses)


def comes_once(traj) -> bool:
    """Whether something gives frames one after the other, once, and does not know how many: a generator, an iterator,
    a stream."""
    if hasattr(traj, "__next__"):
        return True
    if isinstance(traj, Trajectory):
        return traj.streamed
    reader = getattr(getattr(traj, "universe", traj), "trajectory", None)
    if reader is None:
        return False
    from .mdanalysis import is_stream

    return is_stream(reader)
