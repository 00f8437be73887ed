"""What a person says of a trajectory whose files cannot: the cell, which of its axes repeat, the time of one step."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from .trajectory import Over

_WORDS = {"p": True, "t": True, "true": True, "f": False, "s": False, "m": False, "n": False, "false": False}


def cell_of(given, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Edge vectors and origin (internal) of a cell as users give it: three lengths, three edge vectors, or three pairs
    lo, hi. AtcError for anything else."""
    try:
        a = np.array(given, dtype=np.float64)
    except (TypeError, ValueError):
        a = np.zeros(0)
    origin = np.zeros(3)
    if a.shape == (3, 2):
        origin, a = a[:, 0], a[:, 1] - a[:, 0]
    if a.shape == (3,):
        a = np.diag(a)
    if a.shape != (3, 3) or not np.isfinite(a).all() or not abs(np.linalg.det(a)) > 0:
        raise AtcError(
            f"cell {given!r}: expected three lengths, three edge vectors, or three pairs [lo, hi], e.g. [20.0, 20.0, "
            "40.0]"
        )
    return a * length, origin * length


def periodic_of(given) -> tuple[bool, bool, bool]:
    """Which axes repeat: "ppf" or "p p f" (as LAMMPS's boundary), a bool, or three. AtcError for anything else."""
    words = given
    if isinstance(given, str):
        words = given.split() if len(given.split()) > 1 else list(given.strip())
        words = [_WORDS.get(w[:1].lower()) if w.lower() not in _WORDS else _WORDS[w.lower()] for w in words]
    elif isinstance(given, (bool, np.bool_)):
        words = [given] * 3
    three = isinstance(words, (list, tuple, np.ndarray)) and len(words) == 3
    if not three or not all(isinstance(w, (bool, np.bool_)) for w in words):
        raise AtcError(f'pbc {given!r}: expected which of the axes repeat, e.g. "ppf" or [true, true, false]')
    return tuple(bool(w) for w in words)


class Declared(Over):
    """Another trajectory with a cell, periodic axes or times that its files do not say.

    Parameters
    ----------
    base : trajectory
    cell : three lengths, edge vectors or pairs lo, hi in the user's units, or None
    pbc : see `periodic_of`, or None: all axes of a cell that is given here repeat
    timestep : the time of one step in the user's units, for frames with a step and no time; or None
    """

    def __init__(self, base, cell=None, pbc=None, timestep=None):
        super().__init__(base)
        self._vectors = None if cell is None else cell_of(cell, self.units.length)
        self._periodic = None if pbc is None else periodic_of(pbc)
        number = isinstance(timestep, (int, float)) and not isinstance(timestep, bool)
        if timestep is not None and not (number and 0 < timestep < np.inf):
            raise AtcError(f"timestep {timestep!r}: expected the time of one step, greater than 0")
        self._timestep = None if timestep is None else self.units.to_internal("time", float(timestep))

    def _frame(self, k):
        frame = self.base[k]
        changes: dict = {}
        if self._vectors is not None:
            vectors, origin = self._vectors
            if frame.given.get("cell") != "none" and not np.allclose(frame.cell.vectors, vectors, rtol=1e-9):
                u = self.units
                there = u.to_user("length", np.linalg.norm(frame.cell.vectors, axis=1))
                raise AtcError(
                    f"{frame.source}: cell: it has a cell of its own, {' x '.join(f'{x:g}' for x in there)} "
                    f"{u.label('length')}: leave cell out"
                )
            if frame.given.get("cell") == "none":
                changes["cell"] = Cell(vectors, origin, self._periodic or (True, True, True))
                changes["given"] = {**_without_boundary(frame.given), "cell": "declared"}
        if self._periodic is not None and "cell" not in changes:
            known = frame.given.get("boundary") != "assumed"
            if frame.given.get("cell") == "none":
                if not any(self._periodic):
                    return self._timed(frame, changes)
                raise AtcError(f"{frame.source}: pbc: axes repeat by the cell, which it does not have: give cell, too")
            if known and tuple(frame.cell.periodic) != self._periodic:
                says = "".join("p" if p else "f" for p in frame.cell.periodic)
                raise AtcError(f"{frame.source}: pbc: it says itself which axes repeat, {says}: leave pbc out")
            changes["cell"] = Cell(frame.cell.vectors, frame.cell.origin, self._periodic)
            changes["given"] = _without_boundary(frame.given)
        return self._timed(frame, changes)

    def _timed(self, frame, changes):
        if self._timestep is not None and frame.time is None and frame.step is not None:
            changes["time"] = frame.step * self._timestep
        return frame.replace(**changes) if changes else frame


def _without_boundary(given) -> dict:
    return {k: v for k, v in given.items() if k != "boundary"}
