"""What the tests of a difference look at, and the words for which atoms it is."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...frame import Frame

#: A law holds when what it leaves is below this share of the difference, or what the digits explain.
UNEXPLAINED = 0.02


@dataclass
class Case:
    """What the tests look at. D_nc : F_run − F_model. odd : (n,) atoms that differ. noise : (n,) what the digits
    explain of |D|."""

    frame: Frame
    pot: object
    model_nc: np.ndarray
    noise: np.ndarray
    odd: np.ndarray
    threads: int

    @cached_property
    def D_nc(self):
        return self.frame.forces - self.model_nc

    @cached_property
    def size(self):
        return norm(self.D_nc[self.odd])

    @cached_property
    def same(self):
        """(n,) atoms that certainly do not differ: a difference as large as those of the others would have been seen in
        spite of the digits."""
        return ~self.odd & (8.0 * self.noise < self.size / np.sqrt(self.odd.sum()))

    def holds(self, left, over=None, share: float = UNEXPLAINED) -> bool:
        """Whether what a law leaves of D on the atoms that differ is nothing."""
        noise = norm(self.noise[self.odd][:, None]) if over is None else over
        return norm(left) <= max(3.0 * noise, share * self.size)


def norm(a) -> float:
    """The root of the sum of squares."""
    return float(np.sqrt((np.asarray(a) ** 2).sum()))


def which(c: Case, law_n=None) -> str:
    """The atoms that differ, as types, a range of ids, or their number. law_n : (n,) size of the force that a law would
    have on each atom."""
    ids, types = c.frame.ids, c.frame.types
    same = c.same if law_n is None else ~c.odd & (8.0 * c.noise < law_n)
    if not same.any():
        return "all atoms"
    theirs, others = set(np.unique(types[c.odd]).tolist()), set(np.unique(types[same]).tolist())
    if not theirs & others:
        return f"the atoms of type {', '.join(map(str, sorted(theirs)))}"
    at = np.flatnonzero(c.odd)
    if len(at) == 1:
        return f"atom {ids[at[0]]}"
    if not same[at[0] : at[-1] + 1].any():
        return f"atoms {ids[at[0]]} to {ids[at[-1]]}"
    only = f", all of type {next(iter(theirs))}" if len(theirs) == 1 else ""
    return f"{len(at)} of {len(ids)} atoms{only}"
