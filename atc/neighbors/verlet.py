"""One neighbour list for many frames: pairs within the cutoff plus a skin, found once, stand for every frame in which
no atom has moved half the skin.

The list is that of the first frame, never of the one before: which bonds a frame gets, and in which order, depends on
the frame and the first one alone, so that runs in parallel, and runs that go on after an interruption, add up the same
numbers in the same order. It serves solids and whatever else stays near where it was; a frame that does not is searched
anew.
"""

from __future__ import annotations

import contextlib
from contextvars import ContextVar
from threading import Lock

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from .cell_list import CellList, Workspace

#: Skins beyond this part of the cutoff find so many more pairs than they save.
WIDEST = 0.35
#: Pairs that a kept list may hold.
MOST_PAIRS = 5e7

_current: ContextVar = ContextVar("atc_verlet", default=None)


def cell_list(positions, cell, cutoff, who=None):
    """The pairs of these atoms (all of a frame, or those of the indices `who`): a kept list if the frame in work is
    near enough to it, else a new one."""
    at = _current.get()
    if at is not None:
        anchor, moved_nc = at
        kept = anchor.kept(cutoff, who)
        if kept is not None:
            return KeptList(kept, moved_nc if who is None else moved_nc[who], cutoff)
    return CellList(positions, cell, cutoff)


@contextlib.contextmanager
def using(at):
    """Inside, `cell_list` takes pairs from `at`: something whose ``kept(cutoff, who)`` gives them, as an `Anchor` does,
    and (n, 3) how far atoms are from where they are kept; or None."""
    token = _current.set(at)
    try:
        yield
    finally:
        _current.reset(token)


class Anchor:
    """The frame whose neighbours are kept.

    Parameters
    ----------
    frame : Frame
    skin : length, internal
    """

    def __init__(self, frame, skin: float):
        self.positions, self.cell, self.ids, self.skin = frame.positions, frame.cell, frame.ids, float(skin)
        self._kept: dict = {}
        self._lock = Lock()

    def __getstate__(self):
        return {k: v for k, v in self.__dict__.items() if k not in ("_kept", "_lock")}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._kept, self._lock = {}, Lock()

    def moved(self, frame) -> np.ndarray | None:
        """(n, 3) how far each atom is from where it was, through whichever image is nearer; None unless the kept pairs
        hold for this frame."""
        if frame.cell != self.cell or not np.array_equal(frame.ids, self.ids):
            return None
        d = frame.positions - self.positions
        s = d @ self.cell.inverse
        whole = np.where(self.cell.periodic, np.rint(s), 0.0)
        if whole.any():
            d = d - whole @ self.cell.vectors
        return d if np.einsum("nc,nc->n", d, d).max(initial=0.0) < (0.5 * self.skin) ** 2 * (1 - 1e-9) else None

    @contextlib.contextmanager
    def at(self, frame):
        """Inside, `cell_list` knows about this anchor, if it fits the frame."""
        moved = self.moved(frame)
        with using(None if moved is None else (self, moved)):
            yield

    def kept(self, cutoff, who):
        key = cutoff, None if who is None else (len(who), hash(np.ascontiguousarray(who).tobytes()))
        with self._lock:
            if key not in self._kept:
                x = self.positions if who is None else self.positions[who]
                self._kept[key] = _Kept(x, self.cell, cutoff + self.skin)
            return self._kept[key] if self._kept[key].pairs <= MOST_PAIRS else None


class _Kept:
    """Pairs within a wide cutoff as (i, j, image), by chunks; atoms called by their place in the sorted list."""

    def __init__(self, x_nc, cell, wide):
        self.list = cells = CellList(x_nc, cell, wide)
        self.order, cells.order = cells.order, np.arange(cells.n, dtype=np.int32)
        self.chunks, self.pairs = [], 0
        ws, inverse, vectors = Workspace(), cells.cell.inverse, cells.cell.vectors
        for c in range(cells.n_chunks):
            n = cells.half(c, ws)
            i, j = ws.i[:n].copy(), ws.j[:n].copy()
            image = np.rint((cells.x_sorted[i] - cells.x_sorted[j] - ws.r[:n]) @ inverse).astype(np.int64)
            low = image.min(0, initial=0)
            many = image.max(0, initial=0) - low + 1
            kinds = np.indices(many).reshape(3, -1).T + low
            code = ((image[:, 0] - low[0]) * many[1] + image[:, 1] - low[1]) * many[2] + image[:, 2] - low[2]
            self.chunks.append((i, j, code.astype(np.int32), kinds @ vectors))
            self.pairs += n
            if self.pairs > MOST_PAIRS:
                self.chunks = []
                return


class KeptList:
    """Like a `CellList` of the moved atoms as far as `half` goes, from kept pairs."""

    def __init__(self, kept, moved_nc, cutoff):
        self._kept, self.cutoff = kept, float(cutoff)
        cells = kept.list
        self.n, self.start, self.chunk_edges, self.n_chunks, self.cell = (
            cells.n,
            cells.start,
            cells.chunk_edges,
            cells.n_chunks,
            cells.cell,
        )
        self.order = kept.order
        self.x_sorted = cells.x_sorted + moved_nc[kept.order]

    def half(self, chunk: int, ws: Workspace) -> int:
        i, j, code, shifts = self._kept.chunks[chunk]
        while ws.capacity < len(i) + 1:
            ws.grow()
        return _near(i, j, code, shifts, self.x_sorted, self.order, self.cutoff**2, ws.i, ws.j, ws.r, ws.d2)


@njit(cache=True, nogil=True, error_model="numpy")
def _near(i, j, code, shifts, x, order, cut2, iout, jout, rout, d2out):
    """The kept pairs that are within the cutoff now."""
    n = 0
    for p in range(len(i)):
        a, b, k = i[p], j[p], code[p]
        dx = x[a, 0] - x[b, 0] - shifts[k, 0]
        dy = x[a, 1] - x[b, 1] - shifts[k, 1]
        dz = x[a, 2] - x[b, 2] - shifts[k, 2]
        d2 = dx * dx + dy * dy + dz * dz
        iout[n] = order[a]
        jout[n] = order[b]
        rout[n, 0] = dx
        rout[n, 1] = dy
        rout[n, 2] = dz
        d2out[n] = d2
        n += 1 if d2 < cut2 else 0
    return n


def anchor_of(job) -> Anchor | None:
    """An anchor at the first frame of a request, with a skin from how far its second frame has moved; None where a list
    is not worth keeping."""
    pot = job.request.pot
    if not job.work.bond_users or job.n_frames < 3 or job.request.tiles is not None or not pot.cutoff > 0:
        return None
    try:
        second = job.frames[1]
    except (AtcError, IndexError):  # its own turn will come to say what is wrong with it
        return None
    skin = skin_for(job.first, second, pot.cutoff)
    pairs = job.load.pairs * (1 + skin / pot.cutoff) ** 3
    return Anchor(job.first, skin) if skin <= WIDEST * pot.cutoff and pairs <= MOST_PAIRS else None


def skin_for(first, second, cutoff: float) -> float:
    """A skin by how far atoms move from one frame to the next; ∞ where a list of one does not do for the other at
    all."""
    moved = Anchor(first, np.inf).moved(second)
    if moved is None:
        return np.inf
    farthest = float(np.sqrt(np.einsum("nc,nc->n", moved, moved).max(initial=0.0)))
    # Half as far again, each way.
    return max(3.0 * farthest, 0.05 * cutoff)


class Following:
    """An anchor for frames that are computed one after the other, each once: a new list begins where they have moved
    too far, if the last one was worth it.

    Making a list with a skin costs about four without one; going through it half of one.
    """

    #: Frames that a list must have served before another is made.
    WORTH = 10
    #: The least skin, in parts of the cutoff: half as many pairs again, looked at for a tenth of the time of a frame.
    LEAST = 0.15

    def __init__(self, cutoff: float):
        self.cutoff, self.anchor, self._last, self._served = cutoff, None, None, self.WORTH

    def at(self, frame):
        """The anchor for the next frame, None if there is to be none."""
        last, self._last = self._last, frame
        if self.anchor is not None and self.anchor.moved(frame) is None:
            self.anchor = None
        if self.anchor is None and last is not None and self._served >= self.WORTH and self.cutoff > 0:
            skin, self._served = max(skin_for(last, frame, self.cutoff), self.LEAST * self.cutoff), 0
            self.anchor = Anchor(frame, skin) if skin <= WIDEST * self.cutoff else None
        self._served += self.anchor is not None
        return self.anchor
