"""Energies of an atom and all its neighbours, beside pair energies: the stages that such terms share.

U = Σ_pairs U2(d) + Σ_i U_i, U_i a function of the arms of atom i (to its neighbours within the cutoff) and of the
distances between their ends. A frame is done in four stages: the half neighbour list; which pairs meet at which atom;
around each atom, G of the arms into slots of their own (one for each end of a pair) and the outer distances as bonds of
their own; one bond a pair. A subclass of `Centred` gives the loop over
centres, and the law of its pairs.

With more than three neighbours the distances are not independent: G is that of the function as its formula is written,
in arms and cosines, where the cosine at i between b and c stands for (ξ_ib + ξ_ic − ξ_bc)/(d_ib d_ic), and r_ib · r_ic
for ξ_ib + ξ_ic − ξ_bc.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from ...compiled import specialise, tag_of
from .elements import ElementMap
from .neighbor_work import JIT, NO_S, OUTER_PER_TASK, NeighborTerm, NeighborWork, made, room, shares
from .neighborhood import share_half
from .stillinger_weber_kernels import sw_merge


class CentredWork(NeighborWork):
    """One frame: its neighbours, then chunks of centres."""

    own = ("_centres", "_merge")

    def joined(self, acc):
        near = self.near
        pairs = len(near.a)
        self.G_p = np.zeros(pairs)
        self.G_end = np.zeros((pairs, 2))
        self.S_end = np.zeros((pairs, 2, 2, 3)) if acc.sources else NO_S
        self.runs, self.most, self.room = near.runs(OUTER_PER_TASK)
        self.room *= self.term.outer_per_pair
        self.stages = (near.chunks, 1, len(self.runs) - 1, near.chunks)

    def _centres(self, task, acc):
        return self.of_runs(task, acc, self.term.centres, self.G_end, self.S_end, fill=np.zeros)

    def _merge(self, task, acc):
        near = self.near
        p0, p1 = self.pairs(task)
        out = room(acc, p1 - p0, without=None)
        energy, bad = self.term.pairs(p0, p1, self.lists, self.G_p, shares(acc))
        if bad < 0:
            odd = ~np.isfinite(self.G_p[p0:p1] + self.G_end[p0:p1].sum(axis=1))
            bad = p0 + int(np.argmax(odd)) if odd.any() else -1
        self.require_finite(bad)
        acc.energy += energy
        S_end = self.S_end if acc.sources else None
        m = sw_merge(p0, p1, near.a, near.b, near.r_pc, self.G_p, self.G_end, S_end, near.atom, *out)
        return made(acc, out, m)


class Centred(NeighborTerm):
    """A term as the module says. Subclasses set `style`, `map` and `cutoff`."""

    work = CentredWork
    bodies = 3
    style: str
    map: ElementMap
    #: How many outer bonds k neighbours make at most, in units of k (k − 1)/2.
    outer_per_pair = 1
    #: The law (`neighbor_work.law`) of its pair energies: U2 and U2'/d of the elements of a and b, d, and `of_pair`.
    pair: Callable | None = None
    of_pair: tuple = ()

    def pairs(self, p0: int, p1: int, near: tuple, G_p, energies) -> tuple[float, int]:
        """Fill G_p[p0:p1] with G of the pair energies; return their sum and the first pair that is not finite, or
        −1. near : as `NeighborWork.lists`"""
        return pair_energies(self.pair)(p0, p1, near, self.of_pair, G_p, energies) if self.pair else (0.0, -1)

    def centres(self, s0, s1, most, near: tuple, G_end, S_end, out: tuple, energies) -> tuple[int, float]:
        """Around the atoms s0..s1: arms into G_end (pair, end) and S_end (pair, end, 2, 3), outer bonds to out = (i, j,
        r, G, D); return their number and Σ U_i.

        S_end[p, end] : ∂U^(centre)/∂x_other and ∂U^(other)/∂x_centre. It and D have no rows where no sources are
        wanted, energies none where no shares are.
        most : the most neighbours an atom has
        """
        raise NotImplementedError


@cache
def pair_energies(law):
    """The loop over pairs with the law compiled in."""
    return specialise(_pair_energies, tag_of(law), JIT, LAW=law)


LAW = None


def _pair_energies(p0, p1, near, of_pair, G, energies):
    _, _, _, a, b, _, d, element, atom = near
    total = 0.0
    for p in range(p0, p1):
        u, G[p] = LAW(element[a[p]], element[b[p]], d[p], *of_pair)
        if not np.isfinite(G[p] + u):
            return 0.0, p
        total += u
        share_half(energies, atom[a[p]], atom[b[p]], u)
    return total, -1
