"""One frame of a potential of neighbourhoods: what all of them share.

A frame is done in stages. The half neighbour list; which pairs meet at which atom; then the potential's own: sums
around atoms (densities, charges, screening), bonds of the pairs, bonds between two neighbours of an atom. A stage's
tasks are chunks of atoms, or of the pairs whose first atoms those are.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...frame import Frame
from ..base import Accumulator, Term, Work
from .neighborhood import Neighborhood, by_place, impossible, runs_of
from .stillinger_weber_kernels import ODD, sw_index, sw_merge, sw_triplets

JIT = dict(cache=True, nogil=True, error_model="numpy")
NOTHING = np.zeros(0)
#: Sources at the ends of pairs, and of bonds, where nobody wants them.
NO_S = np.zeros((0, 2, 2, 3))
NO_D = np.zeros((0, 2, 3))
#: Outer bonds that a task may make: as many as a fresh workspace holds; a dense liquid must not cost memory.
OUTER_PER_TASK = 1 << 16


def law(function):
    """Decorator of a law that `specialise` compiles into a loop."""
    return staticmethod(njit(nogil=True, error_model="numpy", forceinline=True)(function))


def shares(acc: Accumulator) -> np.ndarray:
    """Where the atoms' shares of the energy go; of no length where nobody wants them."""
    return acc.energies if acc.energies is not None else NOTHING


def room(acc: Accumulator, count: int, fill: Callable = np.empty, without=NO_D) -> tuple:
    """(i, j, r, G, D) for up to `count` bonds of a task; D is `without` where no sources are wanted."""
    ws = acc.ws
    while ws.capacity < count:
        ws.grow()
    return ws.i, ws.j, ws.r, ws.G, fill((count, 2, 3)) if acc.sources else without


def made(acc: Accumulator, out: tuple, m: int) -> Bonds:
    """The first m bonds of a `room`."""
    i, j, r, G, D = out
    return Bonds(i[:m], j[:m], r[:m], G[:m], D[:m] if acc.sources else None)


class NeighborTerm(Term):
    """A term of the neighbourhoods of atoms."""

    #: what does it on a frame
    work: type[Work]
    style: str

    @property
    def word(self) -> str:
        """What messages call the force."""
        return self.style

    def kinds(self, frame: Frame) -> tuple:
        """What atoms are to the potential, and which take part (None: all), see `ElementMap.apply`."""
        return self.map.apply(frame)

    def prepare(self, frame: Frame) -> Work:
        return self.work(self, frame)


class NeighborWork(Work):
    """The stages named above; a subclass says its own in `own`, and in `joined` what they need.

    Attributes
    ----------
    near : Neighborhood. element : (atoms,) what they are, in its order
    """

    #: the methods (task, acc) -> Bonds or None of each further stage
    own: tuple[str, ...]

    def __init__(self, term: NeighborTerm, frame: Frame):
        self.term, self.frame = term, frame
        kind_n, who = term.kinds(frame)
        self.near = near = Neighborhood(frame, who, term.cutoff, term.word)
        self.element = kind_n[near.atom]
        self.stages = (near.chunks, 1, *[near.chunks] * len(self.own))

    def joined(self, acc: Accumulator) -> None:
        """Once, when all pairs are known."""

    def run(self, stage, task, acc: Accumulator):
        if stage == 0:
            return self.near.collect(task, acc.ws)
        if stage == 1:
            self.near.join()
            return self.joined(acc)
        return getattr(self, self.own[stage - 2])(task, acc)

    @property
    def lists(self) -> tuple:
        """What loops over pairs and around atoms go through, as one argument: see `Neighborhood`; what the atoms are;
        the frame's indices."""
        near = self.near
        return near.start, near.pair, near.end, near.a, near.b, near.r_pc, near.d_p, self.element, near.atom

    def atoms(self, task: int) -> tuple[int, int]:
        """The first atom of a chunk, and the one behind its last."""
        return self.near.first[task], self.near.first[task + 1]

    def pairs(self, task: int) -> tuple[int, int]:
        """Likewise of its pairs."""
        return self.near.edges[task], self.near.edges[task + 1]

    def require_finite(self, bad: int) -> None:
        """Raise AtcError for pair number `bad`, if it is one."""
        if bad >= 0:
            near = self.near
            raise impossible(self.frame, near.atom[near.a[bad]], near.atom[near.b[bad]], near.d_p[bad], self.term.word)

    def of_pairs(self, task: int, acc: Accumulator, kernel: Callable, *args, more: int = 0) -> Bonds:
        """The bonds of a chunk's pairs, and `more`, by ``kernel(p0, p1, lists, *args, out, energies)``: how many, their
        energy, and the first pair that is not finite (−1: none)."""
        p0, p1 = self.pairs(task)
        out = room(acc, p1 - p0 + more)
        m, energy, bad = kernel(p0, p1, self.lists, *args, out, shares(acc))
        self.require_finite(bad)
        acc.energy += energy
        return made(acc, out, m)

    def of_runs(self, task: int, acc: Accumulator, kernel: Callable, *args, fill: Callable = np.empty) -> Bonds:
        """The outer bonds of a run of atoms, by ``kernel(s0, s1, most, lists, *args, out, energies)``: how many, and
        the energy."""
        out = room(acc, self.room, fill)
        m, energy = kernel(*self.runs[task : task + 2], self.most, self.lists, *args, out, shares(acc))
        acc.energy += energy
        return made(acc, out, m)


class TripletWork(Work):
    """Stages 2 to 4 of Stillinger and Weber's form, behind the pairs: a triplet's arms go to its pairs, and these
    become bonds in the end.

    A subclass gives the first stage, `pairs`, which puts (a, b, rec, G) of each task's pairs into `parts`. Atoms are
    called by their place, see `by_place`: `atom` are the frame's indices, `element` what they are.
    """

    def __init__(self, term: NeighborTerm, frame: Frame):
        self.term, self.frame = term, frame
        element_n, who = term.kinds(frame)
        self.list, self.atom = by_place(frame, who, term.cutoff)
        self.element = element_n[self.atom]
        self.parts: list = [None] * self.list.n_chunks
        self.stages = (self.list.n_chunks, 1, self.list.n_chunks, self.list.n_chunks)

    def run(self, stage, task, acc: Accumulator):
        return (self.pairs, self.joined, self.triplets, self.merged)[stage](task, acc)

    def pairs(self, task, acc):
        raise NotImplementedError

    def require_finite(self, bad: int, ws) -> None:
        """Raise AtcError for pair number `bad` of a workspace, if it is one."""
        if bad >= 0:
            raise impossible(self.frame, self.atom[ws.i[bad]], self.atom[ws.j[bad]], ws.d2[bad] ** 0.5, self.term.word)

    def joined(self, task, acc):
        """All pairs in one list, and the runs of centres that tasks do."""
        a, b, rec, G = zip(*self.parts, strict=True)
        self.parts = []
        self.edges = np.concatenate([[0], np.cumsum([len(p) for p in a])])
        self.a, self.b, self.rec, self.G = np.concatenate(a), np.concatenate(b), np.concatenate(rec), np.concatenate(G)
        self.G_end = np.zeros((len(self.a), 2))
        # Slot (pair, end) with the triplet's centre at that end: ∂U^(centre)/∂x_other and ∂U^(other)/∂x_centre.
        self.S_end = np.zeros((len(self.a), 2, 2, 3)) if acc.sources else None
        self.out_start, self.in_start, self.in_pair = sw_index(self.a, self.b, len(self.atom))
        self.runs, self.most, self.room = runs_of(self.out_start + self.in_start, OUTER_PER_TASK)
        pairs, join, _, merge = self.stages
        self.stages = (pairs, join, len(self.runs) - 1, merge)

    def triplets(self, task, acc):
        """Bonds between the outer atoms; arms into G_end and S_end."""
        term, out = self.term, room(acc, self.room, without=None)
        lists = self.out_start, self.in_start, self.in_pair, self.a, self.b, self.rec, self.element, self.atom
        runs, law = self.runs[task : task + 2], (term.triplet, term.prune, *term.weights)
        where = term.angular, *runs, self.most, lists
        m, energy, odd = sw_triplets(*where, *law, self.G_end, self.S_end, out[:4], out[4], shares(acc))
        acc.energy += energy
        acc.note(ODD.get(term.angular, ""), odd)
        return made(acc, out, m)

    def merged(self, task, acc):
        """One bond a pair."""
        p0, p1 = self.edges[task], self.edges[task + 1]
        out = room(acc, p1 - p0, without=None)
        m = sw_merge(p0, p1, self.a, self.b, self.rec, self.G, self.G_end, self.S_end, self.atom, *out)
        return made(acc, out, m)
