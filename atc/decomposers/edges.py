"""Energies of atoms that depend on the vectors to their own neighbours and on nothing else (one hop): the stages that
such terms share.

U = Σ_j U^(j), U^(j) a function of the edges r_e = x_n − x_j to the neighbours n of j. With g_e = ∂U^(j)/∂r_e the two
edges of a pair are one bond with F_ij = g_ij − g_ji, D_0 = g_ij, D_1 = g_ji. A frame is done in four stages: the half
neighbour list; which pairs meet at which atom; the energy of each atom with its gradients, into slots of their own
(one for each end of a pair); one bond a pair. A subclass of `Edges` gives the third.
"""

from __future__ import annotations

import numpy as np

from ..bonds import Bonds
from ..compiled import njit
from ..frame import Frame
from .base import Term, Work
from .neighbor_work import NeighborWork, room, shares


class Edges(Term):
    """A term as the module says. Subclasses set `style` and `cutoff`."""

    central, edges = False, True
    style: str

    def map(self, frame: Frame):
        """The `ElementMap` of a frame."""
        raise NotImplementedError

    def centres(self, work: EdgesWork, task: int, g_end, energies) -> float:
        """The energy of the atoms of a chunk; into g_end[pair, side] the gradient of the energy of the atom at that
        side by the vector from it to the other one.

        energies : (n,) to add the energies of atoms to, or (0,)
        """
        raise NotImplementedError

    def prepare(self, frame: Frame) -> Work:
        return EdgesWork(self, frame)


class EdgesWork(NeighborWork):
    again = 3

    def __init__(self, term: Edges, frame: Frame):
        super().__init__(term, frame, term.style, *term.map(frame).apply(frame))

    @property
    def own(self):
        return self.centres, self.merged

    def joined(self, acc):
        self.g_end = np.zeros((len(self.near.a), 2, 3))

    def centres(self, task, acc):
        acc.energy += self.term.centres(self, task, self.g_end, shares(acc))

    def merged(self, task, acc):
        """One bond a pair, without G: the force is not along it."""
        near = self.near
        p0, p1 = self.pairs(task)
        m = p1 - p0
        i, j, r, _, D = room(acc, m)
        F = np.empty((m, 3))
        self.require_finite(merge(p0, p1, near.a, near.b, near.r_pc, self.g_end, near.atom, acc.sources, i, j, r, F, D))
        return Bonds(i[:m], j[:m], r[:m], np.full(m, np.nan), D if acc.sources else None, F)


@njit(cache=True, nogil=True, error_model="numpy")
def merge(p0, p1, a, b, r, g_end, atom, sources, out_i, out_j, out_r, out_F, out_D):
    """One bond a pair. Returns the first pair whose force is not a finite number, −1 if there is none."""
    bad = -1
    for p in range(p0, p1):
        m = p - p0
        out_i[m], out_j[m] = atom[a[p]], atom[b[p]]
        for c in range(3):
            out_r[m, c] = r[p, c]
            F = g_end[p, 0, c] - g_end[p, 1, c]
            out_F[m, c] = F
            if bad < 0 and not np.isfinite(F):
                bad = p
            if sources:
                out_D[m, 0, c] = g_end[p, 0, c]
                out_D[m, 1, c] = g_end[p, 1, c]
    return bad
