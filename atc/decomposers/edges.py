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
from ..errors import AtcError
from ..frame import Frame
from .base import Accumulator, Term, Work
from .neighborhood import Neighborhood

_NO_D = np.zeros((0, 2, 3))
#: What `Edges.centres` is given where no energies of atoms are wanted.
NO_ENERGIES = np.zeros(0)


class Edges(Term):
    """A term as the module says. Subclasses set `style` and `cutoff`."""

    central, edges = False, True
    style: str

    def map(self, frame: Frame):
        """The `ElementMap` of a frame."""
        raise NotImplementedError

    def centres(self, near: Neighborhood, element, task: int, g_end, energies) -> float:
        """The energy of the atoms of a chunk; into g_end[pair, side] the gradient of the energy of the atom at that
        side by the vector from it to the other one.

        element : of the atoms in the order of `near`. energies : (n,) to add the energies of atoms to, or (0,)
        """
        raise NotImplementedError

    def prepare(self, frame: Frame) -> Work:
        return EdgesWork(self, frame)


class EdgesWork(Work):
    def __init__(self, term: Edges, frame: Frame):
        self.term, self.frame = term, frame
        element_n, who = term.map(frame).apply(frame)
        self.near = near = Neighborhood(frame, who, term.cutoff, term.style)
        self.element = element_n[near.atom]
        self.stages = (near.chunks, 1, near.chunks, near.chunks)

    def run(self, stage, task, acc: Accumulator):
        return (self._collect, self._join, self._centres, self._merge)[stage](task, acc)

    def _collect(self, task, acc):
        self.near.collect(task, acc.ws)

    def _join(self, task, acc):
        self.near.join()
        self.g_end = np.zeros((len(self.near.a), 2, 3))

    def _centres(self, task, acc):
        energies = acc.energies if acc.energies is not None else NO_ENERGIES
        acc.energy += self.term.centres(self.near, self.element, task, self.g_end, energies)

    def _merge(self, task, acc):
        near, ws = self.near, acc.ws
        p0, p1 = near.edges[task], near.edges[task + 1]
        m = p1 - p0
        while ws.capacity < m:
            ws.grow()
        F, D = np.empty((m, 3)), np.empty((m, 2, 3)) if acc.sources else _NO_D
        bad = merge(p0, p1, near.a, near.b, near.r_pc, self.g_end, near.atom, acc.sources, ws.i, ws.j, ws.r, F, D)
        if bad >= 0:
            a, b = self.frame.ids[near.atom[near.a[bad]]], self.frame.ids[near.atom[near.b[bad]]]
            raise AtcError(
                f"{self.frame.source}: the {self.term.style} force between atoms {a} and {b} at distance "
                f"{near.d_p[bad]:.3g} is not a finite number"
            )
        # No G: the force is not along the bond.
        return Bonds(ws.i[:m], ws.j[:m], ws.r[:m], np.full(m, np.nan), D if acc.sources else None, F)


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
