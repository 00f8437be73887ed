"""Several files as one trajectory: a run written in parts, or one file a snapshot."""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from functools import partial
from glob import glob, has_magic
from pathlib import Path

from ..errors import AtcError
from ..frame import Frame
from .times import same_moment
from .trajectory import Trajectory, warn

# Files kept open: a run in a few parts is never opened twice, and a thousand snapshots do not use up the system's file
# handles.
_OPEN = 16


def matching(pattern) -> list[Path] | None:
    """The files of a pattern (``dump.*``), numbers in their names in numerical order; None if it is no pattern, or
    itself the name of a file."""
    text = str(pattern)
    try:
        if not has_magic(text) or Path(text).exists():
            return None
        found = [Path(p) for p in glob(text, recursive=True) if Path(p).is_file()]
    except (OSError, ValueError):  # no possible name of a file: said where it is opened
        return None
    if not found:
        raise AtcError(f"{text}: no file matches this pattern")
    return sorted(found, key=_numerical)


def _numerical(path):
    return [(0, int(w), "") if w.isdigit() else (1, 0, w) for w in re.split(r"(\d+)", str(path)) if w]


class Chain(Trajectory):
    """The frames of several files, one after the other.

    Parameters
    ----------
    paths : files of any kind that `atc.read` takes, all in the same units
    topology, units, masses, atom_style : as for `atc.read`, for every file

    Notes
    -----
    Files are opened when they are needed. Where a file begins at a moment that the one before it has reached already
    (a run that was continued, perhaps from a restart file some way back), that frame and what follows it in the file
    before are left out: each moment is there once, as the later file has it. More than the one frame that a continued
    run writes again is told in a warning, as are steps that go back without such a moment.
    """

    def __init__(self, read, paths, topology=None, units=None, masses=None, atom_style=None):
        super().__init__()
        self.paths = [Path(p) for p in paths]
        if not self.paths:
            raise AtcError("there are no files in the list: expected paths of trajectories")
        self._read = read  # `atc.read`, for one file
        self._given, self._atom_style = (topology, units, masses), atom_style
        self._open: OrderedDict[int, Trajectory] = OrderedDict()
        self._starts: list[int] = [0]
        self._declared: dict[int, str] = {}
        self._learnt = 0  # files, from the first on, whose species are all known
        self._seen: dict[int, int] = {}  # frames of each file whose species have been looked at
        first = self._part(0)
        self.units, self.assumed = first.units, first.assumed
        self.source = f"{self.paths[0]} .. {self.paths[-1]}" if len(self.paths) > 1 else str(self.paths[0])
        # LAMMPS files share the data file: it is read once.
        self._data = first._data

    def _part(self, p: int) -> Trajectory:
        with self._guard:
            if p in self._open:
                self._open.move_to_end(p)
                return self._open[p]
            topology, units, masses = self._given
            units = units or (self.units.name if p else None)
            part = self._read(self.paths[p], self._data or topology, units, masses, atom_style=self._atom_style)
            if p and part.units.name != self.units.name:
                raise AtcError(
                    f"{part.source} is in {part.units.name!r} units, {self.paths[0]} in {self.units.name!r}: read "
                    "them one by one"
                )
            # Where types come from names, all files share them, numbered in order of first appearance in the whole
            # trajectory, whichever frames are asked for first. One lock, since files ask each other.
            self._agree(part)
            part._names, part._guard, part._names_seen = self._names, self._guard, self._seen.get(p, 0)
            part._earlier = partial(self._learn_before, p)
            self._open[p] = part
            while len(self._open) > _OPEN:
                q, old = self._open.popitem(last=False)
                self._seen[q] = old._names_seen
            return part

    def _learn_before(self, p, wanted) -> None:
        """Types for the names in the files before p, until all wanted ones have one."""
        for q in range(self._learnt, p):
            if all(u in self._names for u in wanted):
                return
            earlier = self._part(q)
            earlier._learn_own_names(wanted, len(earlier))
            if earlier._names_seen < len(earlier):
                return
            self._learnt = q + 1

    def _agree(self, part) -> None:
        """Files that number their types themselves (data files, topologies) must mean the same by a number."""
        for t, name in part.type_names.items():
            for there, known in self._declared.items():
                if (t == there) != (name == known):
                    raise AtcError(
                        f"{part.source}: type {t} is {name!r}, but in files before it type {there} is {known!r}: give "
                        "the files to atc.read one by one"
                    )
        self._declared.update(part.type_names)

    def _start(self, p: int) -> int:
        """The number of the first frame of file p (of all frames, for p = number of files)."""
        with self._guard:
            while len(self._starts) <= p:
                at = len(self._starts) - 1
                self._starts.append(self._starts[-1] + self._counted(at))
            return self._starts[p]

    def _counted(self, p: int) -> int:
        """How many frames of file p count: where the next one begins at a moment that it holds, those before it."""
        part = self._part(p)
        n = len(part)
        if p + 1 == len(self.paths) or not n:
            return n
        try:
            if not self._part(p + 1)._has(0):
                return n
            begin = self._part(p + 1)[0]
        except AtcError:  # what is wrong with it is told when it is its turn
            return n
        part = self._part(p)
        end = part[n - 1].step
        if begin.step is None or end is None or begin.step > end:
            return n
        k = bisect_left(range(n), begin.step, key=lambda m: part[m].step or 0)
        if k < n and same_moment(part[k], begin):
            if k < n - 1:  # more than the step that a continued run writes once more
                warn(
                    f"{self.paths[p + 1]} goes on from step {begin.step}, {self.paths[p]} ends at step {end}: of the "
                    f"latter the {n - k} frames from there on are left out"
                )
            return k
        if n > 1:
            warn(
                f"{self.paths[p + 1]} begins at step {begin.step}, {self.paths[p]} ends at step {end}, but they do not "
                "have that moment in common: all frames of both are there, and steps go back"
            )
        return n

    def _locate(self, k: int) -> tuple[int, int] | None:
        """(file, frame in it) of frame k, opening no file beyond the next one."""
        last = len(self.paths) - 1
        for p in range(len(self._starts) - 1, len(self.paths)):
            if k < self._start(p):
                break
            if p < last and k < self._start(p + 1):
                return p, k - self._starts[p]
            if p == last and self._part(p)._has(k - self._starts[p]):
                return p, k - self._starts[p]
        if k >= self._starts[-1]:
            return None
        p = bisect_right(self._starts, k) - 1
        return p, k - self._starts[p]

    def __len__(self):
        return self._start(len(self.paths))

    def _has(self, k):
        return self._locate(k) is not None

    def _frame(self, k) -> Frame:
        p, m = self._locate(k)
        return self._part(p)[m]

    def __getstate__(self):
        state = super().__getstate__()
        state["_open"] = OrderedDict()
        return state

    @property
    def type_names(self):
        return self._part(0).type_names

    def _precision(self, frame):
        first = self._part(0)._precision(frame)
        for p in (1, 3, 7, 15, 31):
            if first[0] or p >= len(self.paths):
                break
            # Atoms that start on a lattice do not show how many digits they are written with.
            later = self._part(p)._precision(frame)
            if later[0]:
                return later
        return first

    def _numbered(self):
        return self._part(0)._numbered()

    def close(self):
        for part in self._open.values():
            part.close()
        self._open.clear()
