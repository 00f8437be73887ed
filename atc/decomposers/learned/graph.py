"""Directed edges of a frame, and the part of them that the energies of some atoms depend on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass
class Edges:
    """Edges centre → neighbour, ordered by their centres.

    Attributes
    ----------
    centre, neighbour : (e,) int64; r_ec : (e, 3) x_neighbour + image − x_centre
    start : (n + 1,) edges of each centre
    there, back : (p,) the edges a → b and b → a of each pair of the neighbour list they were made of
    """

    centre: np.ndarray
    neighbour: np.ndarray
    r_ec: np.ndarray
    start: np.ndarray
    there: np.ndarray
    back: np.ndarray

    @classmethod
    def of(cls, a, b, r_pc, n: int) -> Edges:
        """From pairs with r = x_a − x_b."""
        pairs = len(a)
        c, nb = np.concatenate([a, b]).astype(np.int64), np.concatenate([b, a]).astype(np.int64)
        order = np.argsort(c, kind="stable")
        place = np.empty(2 * pairs, np.int64)
        place[order] = np.arange(2 * pairs)
        c = c[order]
        r = np.concatenate([-r_pc, r_pc])[order]
        return cls(c, nb[order], r, np.searchsorted(c, np.arange(n + 1)), place[:pairs], place[pairs:])

    def __len__(self):
        return len(self.centre)

    @property
    def n(self) -> int:
        return len(self.start) - 1

    def around(self, atoms, hops: int) -> Part:
        """All that energies of `atoms` depend on, if no more than `hops` messages reach them."""
        seen = np.zeros(self.n, bool)
        seen[atoms] = True
        taken = np.zeros(len(self), bool)
        shell = np.asarray(atoms)
        for _ in range(hops):
            edges = self._of(shell)
            taken[edges] = True
            reached = np.unique(self.neighbour[edges])
            shell = reached[~seen[reached]]
            seen[shell] = True
        place = np.cumsum(seen) - 1
        which = np.flatnonzero(taken)
        counted = np.zeros(int(seen.sum()), bool)
        counted[place[atoms]] = True
        ends = place[self.centre[which]], place[self.neighbour[which]]
        return Part(np.flatnonzero(seen), which, *ends, self.r_ec[which], counted)

    def whole(self) -> Part:
        every = np.ones(self.n, bool)
        return Part(np.arange(self.n), slice(None), self.centre, self.neighbour, self.r_ec, every)

    def _of(self, centres) -> np.ndarray:
        """The edges of these centres."""
        k = self.start[centres + 1] - self.start[centres]
        first = np.repeat(self.start[centres] - np.concatenate([[0], np.cumsum(k)[:-1]]), k)
        return first + np.arange(int(k.sum()))


@dataclass
class Place:
    """Where atoms are, in the model's unit of length: for models that want to know it besides the edges.

    x_nc : (n, 3); cell : (3, 3), rows; periodic : (3,) of bool
    """

    x_nc: np.ndarray
    cell: np.ndarray
    periodic: np.ndarray


@dataclass
class Part:
    """Atoms, and edges between them by their places among these.

    atoms : (m,) indices in the frame's edges; edges : of the frame; counted : (m,) whether the energy of the atom is of
    interest, the others being there for it
    """

    atoms: np.ndarray
    edges: np.ndarray | slice
    centre: np.ndarray
    neighbour: np.ndarray
    r_ec: np.ndarray
    counted: np.ndarray

    def __len__(self):
        return len(self.centre)
