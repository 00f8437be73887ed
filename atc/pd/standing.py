"""The bonds that still hold, as force kernels walk them.

In a shattered body most of the time would go to bonds that are no more. So the rows are drawn together now and then.
Force kernels add bond by bond in the order of the table, and a broken bond adds zero: results are bitwise the same
whenever that is done, or never.
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .bonds import JIT

# Rows are drawn together once this share of what is walked has broken.
_SHARE = 0.1
_WRAP = (1 << 64) - 1


class Standing:
    """Rows of a bond table without the bonds that broke long ago.

    columns : (b,) arrays that go with the bonds. kind_b : their kinds, or empty.

    Attributes of what is walked now: start_n, j_b, image_b, kind_b, intact_b, columns; bond_b, their numbers in the
    table, or None for all.
    """

    def __init__(self, table, crew, kind_b, *columns):
        self.table, self.crew = table, crew
        self._whole = (table.start_n, table.j_b, table.image_b, kind_b, columns)
        self._state_b = None

    def follow(self, intact_b):
        """Make what is walked right for this state."""
        if self._state_b is not intact_b or (self.bond_b is not None and self._print() != self._expected):
            # Another state, or somebody has changed this one by hand.
            self.start_n, self.j_b, self.image_b, self.kind_b, self.columns = self._whole
            self._state_b = self.intact_b = intact_b
            self.bond_b = None
            self._broken = len(intact_b) - int(np.count_nonzero(intact_b))
        if self._broken > _SHARE * len(self.j_b):
            self._draw_together()

    @property
    def walked(self):
        """What of the table's arrays goes with what is walked."""
        return slice(None) if self.bond_b is None else self.bond_b

    def broke(self, walked):
        """The table's numbers of bonds that a kernel has just broken (`walked`: their numbers among what is walked);
        tells the state."""
        self._broken += len(walked)
        if self.bond_b is None:
            return walked
        which = self.bond_b[walked].astype(np.int64)
        at, byte = which.astype(np.uint64) >> np.uint64(3), np.uint64(8) * (which & 7).astype(np.uint64)
        was = self._state_b[which].astype(np.uint64)
        self._expected = (self._expected - int(((was << byte) * _weight(at)).sum())) & _WRAP
        self._state_b[which] = 0
        return which

    def _draw_together(self):
        keep = self.intact_b != 0
        # Each column on its own: never two copies of everything.
        self.bond_b = np.flatnonzero(keep).astype(np.uint32) if self.bond_b is None else self.bond_b[keep]
        self.start_n = _starts(self.start_n, keep)
        self.intact_b = self.intact_b[keep]
        self.j_b = self.j_b[keep]
        self.image_b, self.kind_b = (a[keep] if len(a) else a for a in (self.image_b, self.kind_b))
        columns = list(self.columns)
        self.columns = None
        for k in range(len(columns)):
            columns[k] = columns[k][keep]
        self.columns = tuple(columns)
        self._broken = 0
        self._expected = self._print()

    def _print(self):
        """A number that any change of the state's bonds changes."""
        b = np.ascontiguousarray(self._state_b)
        whole = len(b) // 8
        rest = int.from_bytes(b[8 * whole :].tobytes(), "little") * (2 * whole + 1)
        return (sum(self.crew.run(_weighted, whole, b[: 8 * whole].view(np.uint64), grain=1 << 16)) + rest) & _WRAP


def _weight(word):
    """An odd number for every word, so that a change of one of them cannot vanish modulo 2^64."""
    return np.uint64(2) * word + np.uint64(1)


@njit(**JIT)
def _weighted(a, b, words):
    total = np.uint64(0)
    for k in range(a, b):
        # Unsigned: no test for negative indices, so that loads are whole vectors.
        n = np.uint64(k)
        total += words[n] * (n + n + np.uint64(1))
    return total


@njit(**JIT)
def _starts(start, keep):
    out = np.empty_like(start)
    total = 0
    out[0] = 0
    for i in range(len(start) - 1):
        for b in range(start[i], start[i + 1]):
            total += keep[b]
        out[i + 1] = total
    return out
