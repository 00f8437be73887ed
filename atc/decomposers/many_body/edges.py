"""Energies of atoms that depend on the vectors to their own neighbours and on nothing else (one hop): the stages that
such terms share.

U = Σ_j U^(j), U^(j) a function of the edges r_e = x_n − x_j to the neighbours n of j. With g_e = ∂U^(j)/∂r_e the two
edges of a pair are one bond with F_ij = g_ij − g_ji, D_0 = g_ij, D_1 = g_ji. A frame is done in four stages: the half
neighbour list; which pairs meet at which atom; the energy of each atom with its gradients, into slots of their own
(one for each end of a pair); one bond a pair. A subclass of `Edges` gives the third.
"""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from .neighbor_work import NeighborTerm, NeighborWork, room, shares

#: Torques of a star above this, of what its edges bring, are not rounding.
GUARD = 1e-9


class EdgesWork(NeighborWork):
    """The stages of a term of edges on one frame."""

    again = 3
    own = ("centres", "merged")

    def joined(self, acc):
        self.g_end = np.zeros((len(self.near.a), 2, 3))

    def centres(self, task, acc):
        acc.energy += self.term.centres(self, task, self.g_end, shares(acc))
        worst = torque(*self.atoms(task), self.lists, self.g_end)
        if worst > GUARD:
            raise AtcError(
                f"{self.frame.source}: {self.term.describe().split(',')[0]}: the energy of an atom changes when all is "
                f"turned (torque on its neighbours: {worst:.1e} of what they bring), so its stress would not balance: "
                "please report it, with the potential's file"
            )

    def merged(self, task, acc):
        """One bond a pair, without G: the force is not along it."""
        p0, p1 = self.pairs(task)
        m = p1 - p0
        i, j, r, _, D = room(acc, m)
        F = np.empty((m, 3))
        self.require_finite(merge(p0, p1, self.lists, self.g_end, acc.sources, i, j, r, F, D))
        return Bonds(i[:m], j[:m], r[:m], np.full(m, np.nan), D if acc.sources else None, F)


class Edges(NeighborTerm):
    """A term as the module says. Subclasses set `style` and `cutoff`, and `reference`: what the energies of single
    atoms are relative to."""

    work = EdgesWork
    central, edges = False, True
    style: str
    reference: str

    @property
    def attributes(self):
        return {
            "energy_path": "edges from neighbour to centre",
            "energy_identity": "by construction: the energy of an atom depends on its own edges alone",
            "precision": "float64",
            "energy_reference": self.reference,
        }

    def kinds(self, frame: Frame):
        return self.map(frame).apply(frame)

    def map(self, frame: Frame):
        """The `ElementMap` of a frame."""
        raise NotImplementedError

    def centres(self, work: EdgesWork, task: int, g_end, energies) -> float:
        """The energy of the atoms of a chunk; into g_end[pair, side] the gradient of the energy of the atom at that
        side by the vector from it to the other one.

        energies : (n,) to add the energies of atoms to, or (0,)
        """
        raise NotImplementedError


@njit(cache=True, nogil=True, error_model="numpy")
def torque(s0, s1, near, g_end):
    """The largest |Σ r × g| of a star over its Σ |r| |g|. Stars with numbers that are none do not count: `merge` tells
    of them."""
    start, pair, end, _, _, r, _, _, _ = near
    worst = 0.0
    for s in range(s0, s1):
        x = y = z = size = 0.0
        for e in range(start[s], start[s + 1]):
            p, side = pair[e], end[e]
            a, b, c = r[p, 0], r[p, 1], r[p, 2]
            f, g, h = g_end[p, side, 0], g_end[p, side, 1], g_end[p, side, 2]
            sign = -1.0 if side == 0 else 1.0
            x += sign * (b * h - c * g)
            y += sign * (c * f - a * h)
            z += sign * (a * g - b * f)
            size += np.sqrt((a * a + b * b + c * c) * (f * f + g * g + h * h))
        if size > 0.0:
            worst = max(worst, np.sqrt(x * x + y * y + z * z) / size)
    return worst


@njit(cache=True, nogil=True, error_model="numpy")
def merge(p0, p1, near, g_end, sources, out_i, out_j, out_r, out_F, out_D):
    """One bond a pair. Returns the first pair whose force is not a finite number, −1 if there is none."""
    _, _, _, a, b, r, _, _, atom = near
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
