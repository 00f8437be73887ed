"""How a frame is cut into tiles: the atoms of each, the copies around them, and the listed terms and special pairs
among these.

A tile holds its own atoms and, around them, copies of all others (periodic images too) that their bonds can depend on:
r_c deep for pair potentials, 2 r_c for many-body ones, whose force between two atoms depends on the neighbours of both.
Terms that are listed (bonds, angles, ... of the topology; tuples of a user) are in every tile that owns one of their
atoms, once for each image of the term that has such an atom at home, with copies of all their other atoms wherever
these are. Images are told apart on the whole frame: the tile is an open cluster, in which every listed atom is the one
that is meant.
"""

from __future__ import annotations

import itertools
from copy import copy
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from ..compiled import njit
from ..decomposers.atom_columns import NAMES
from ..decomposers.images import Images
from ..decomposers.pairs.special_bonds import SpecialBonds, special_hints
from ..errors import AtcError
from ..frame import Cell, Frame, Topology


@dataclass
class Tile:
    """One tile; picklable.

    frame : the tile's particles as an open cluster
    own_p : which are its own atoms; index_p, image_pc : which atom of the whole frame each is, and which image
    listed : for each listed term of the potential (see `Cut.terms`) its tuples of particles, and their types
    reference : the particles' `ReferenceBonds`, or None
    """

    frame: Frame
    own_p: np.ndarray
    index_p: np.ndarray
    image_pc: np.ndarray
    listed: list = field(default_factory=list)
    reference: object = None

    def potential(self, pot):
        """`pot` of a whole frame, as it acts on the particles of this tile."""
        new, lists = copy(pot), iter(self.listed)
        new.setup = None  # the whole frame is complete
        new.terms = [_with_tuples(term, next(lists)) if term.listed else term for term in pot.terms]
        return new


def _with_tuples(term, tuples):
    new = copy(term)
    new.terms_of = lambda frame: tuples
    return new


class Cut:
    """A frame, ready to be cut.

    Parameters
    ----------
    frame : Frame
    counts : tiles along the cell's edges
    pot : Potential; `pot` of this object is the same with its terms taken apart into those that tiles know how to share
    to_reference : ReferenceBonds of the whole frame, or None
    """

    def __init__(self, frame, counts, pot, to_reference=None):
        self.frame, self.counts, self.to_reference = frame, np.array(counts), to_reference
        self.pot = copy(pot)
        if pot.setup is not None:
            self.frame = frame = pot.complete(frame)
        self.pot.terms = [leaf for term in pot.terms for leaf in term.leaves(frame)]
        lists = [(term, term.terms_of(frame)) for term in self.pot.terms if term.listed]
        for term, found in lists:
            if found is None:
                raise AtcError(
                    f"tiles: {term.describe().split(',')[0]} does not say which atoms it acts on: leave tiles out"
                )
        cell = frame.cell
        self.s_nc = cell.fractional(frame.positions)
        self.wraps_nc = np.where(cell.periodic, np.floor(self.s_nc), 0.0)
        self.s_nc -= self.wraps_nc
        self.home_nc = cell.cartesian(self.s_nc)
        self.halo = depth(self.pot, listed=True)
        self.listed = [self._images(*found) for _, found in lists]
        self.special = self._special()

    def _images(self, atoms, types):
        """(m, K) atoms, (m, K, 3) the image of each atom's home that belongs to the tuple (with its first atom in no
        particular one), types."""
        frame, images = self.frame, Images(self.frame.cell)
        at = np.zeros((*atoms.shape, 3))
        for k in range(1, atoms.shape[1]):
            # The same question that the terms themselves ask, the middle atom of an angle being the origin.
            i, j = (k - 1, k) if k == 1 and atoms.shape[1] <= 3 else (k, k - 1)
            first, second = (np.ascontiguousarray(atoms[:, a], dtype=np.int32) for a in (i, j))
            r = np.empty((len(atoms), 3))
            images.vectors_to(frame.positions, first, second, r)
            # x_i + n_i H − x_j − n_j H = r
            apart = np.rint((frame.positions[first] - frame.positions[second] - r) @ frame.cell.inverse)
            at[:, k] = at[:, k - 1] + (apart if i < k else -apart)
        at[:, :, ~frame.cell.periodic] = 0.0
        return np.asarray(atoms), (at + self.wraps_nc[atoms]).astype(np.int64), types

    def _special(self):
        """Special neighbours of all atoms (CSR: start, neighbour, how many bonds apart), if the potential has any."""
        top = self.frame.topology
        if top is not None and top.weighted is not None:
            top = top.weighted
        for term in self.pot.terms:
            special = term.special
            if isinstance(special, SpecialBonds) and top is not None and len(top.bonds) and not special.trivial:
                return special.lists(top, len(self.frame))[:3]
        return None

    def tiles(self):
        """The tiles that have atoms, one after the other; of a frame without any, one that is empty."""
        cell, s = self.frame.cell, self.s_nc
        low = np.where(cell.periodic, 0.0, s.min(0, initial=0.0))
        span = np.where(cell.periodic, 1.0, np.maximum(s.max(0, initial=1.0) - low, 1e-9))
        place = np.clip(np.floor((s - low) / span * self.counts), 0, self.counts - 1).astype(int)
        h = self.halo / cell.heights
        for at in np.ndindex(*self.counts):
            own = (place == at).all(1)
            if not own.any() and (len(s) or any(at)):
                continue
            # The atoms' own extent, not the tile's: an atom on the border may have been put on either side.
            lo, hi = s[own].min(0, initial=np.inf) - h, s[own].max(0, initial=-np.inf) + h
            ranges = [
                range(int(np.ceil(lo[a] - 1)), int(np.floor(hi[a])) + 1) if cell.periodic[a] and own.any() else range(1)
                for a in range(3)
            ]
            parts = []
            for image in itertools.product(*ranges):
                near = np.flatnonzero(((s + image >= lo) & (s + image <= hi)).all(1))
                if len(near):
                    parts.append((near, np.tile(np.array(image, np.int64), (len(near), 1))))
            index = np.concatenate([np.zeros(0, np.int64), *(p[0] for p in parts)])
            image = np.concatenate([np.zeros((0, 3), np.int64), *(p[1] for p in parts)])
            copies = [_copies(own, *listed) for listed in self.listed]
            index, image, tuples = _with_members(index, image, copies)
            yield self._tile(own, index, image.astype(np.int32), tuples)

    def _tile(self, own, index, image, tuples):
        frame, topology = self.frame, None
        if self.special is not None:
            start, other, apart = _special_of(*self.special, index, len(frame))
            topology = Topology(bonds=np.zeros((1, 2), np.int64))
            topology.special = SimpleNamespace(
                start=start, other=other, apart=apart, hints=special_hints(start, other), cell=frame.cell
            )
        particles = cluster(frame, self.home_nc[index], index, image).replace(topology=topology)
        reference = None if self.to_reference is None else self.to_reference.of(index)
        return Tile(particles, own[index] & ~image.any(1), index, image, tuples, reference)


def cluster(frame, home_pc, index, image):
    """The chosen atoms and images as an open frame without topology; home : where image 0 of each of them is."""
    names = ("types", "masses", "velocities", "charges", "ids", "molecules", "groups")
    take = {name: None if getattr(frame, name) is None else getattr(frame, name)[index] for name in names}
    take["extra"] = {name: frame.extra[name][index] for name in NAMES if name in frame.extra}
    open_cell = Cell(frame.cell.vectors, frame.cell.origin, (False, False, False))
    return Frame(
        home_pc + image @ frame.cell.vectors, open_cell, frame.units, step=frame.step, source=frame.source, **take
    )


def depth(pot, listed: bool = False) -> float:
    """How far around its own atoms a tile must know the others. Terms that find their atoms in a list do not count if
    `listed`; else they are refused."""
    for term in pot.terms:
        if term.listed and not listed:
            raise AtcError(f"{term.describe().split(',')[0]} finds its atoms in a list, not around each other")
    return max((t.cutoff * (1.0 if t.pairwise else t.depth) for t in pot.terms), default=0.0) * (1 + 1e-9)


def _copies(own, atoms, images, types):
    """The images of listed tuples that have an atom of the tile at home: (c, K) atoms, (c, K, 3) images, (c,) types."""
    rows, slots = np.nonzero(own[atoms])
    # Moved so that the atom in that slot is at home; two atoms at home together are one copy.
    moves = np.concatenate([rows[:, None], -images[rows, slots]], axis=1)
    moves = np.unique(moves, axis=0)
    rows = moves[:, 0]
    return atoms[rows], images[rows] + moves[:, None, 1:], types[rows]


def _with_members(index, image, copies):
    """Particles, with those that listed tuples need besides, and the tuples by particle."""
    if not copies:
        return index, image, []
    wanted = [c[0].reshape(-1) for c in copies], [c[1].reshape(-1, 3) for c in copies]
    atom, at = np.concatenate([index, *wanted[0]]), np.concatenate([image, *wanted[1]])
    low = at.min(0, initial=0)
    many = at.max(0, initial=0) - low + 1
    key = ((atom * many[0] + at[:, 0] - low[0]) * many[1] + at[:, 1] - low[1]) * many[2] + at[:, 2] - low[2]
    _, first, of = np.unique(key, return_index=True, return_inverse=True)
    # The particles that were there keep their places.
    new = np.sort(first[first >= len(index)])
    order = np.concatenate([np.arange(len(index)), new])
    number = np.empty(len(first), np.int32)
    number[of[order]] = np.arange(len(order))
    particle, tuples, done = number[of], [], len(index)
    for atoms, _, types in copies:
        tuples.append(
            (np.ascontiguousarray(particle[done : done + atoms.size].reshape(atoms.shape)), np.ascontiguousarray(types))
        )
        done += atoms.size
    return atom[order], at[order], tuples


@njit(cache=True, nogil=True, error_model="numpy")
def _special_of(start, other, apart, index, n):
    """The special neighbours of particles among each other, from those of their atoms: every image of a neighbour is
    one, as far as `SpecialBonds` is concerned."""
    first = np.zeros(n + 1, np.int64)
    for p in range(len(index)):
        first[index[p] + 1] += 1
    for a in range(n):
        first[a + 1] += first[a]
    put = first[:-1].copy()
    particle = np.empty(len(index), np.int64)
    for p in range(len(index)):
        particle[put[index[p]]] = p
        put[index[p]] += 1
    out_start = np.zeros(len(index) + 1, np.int64)
    for p in range(len(index)):
        a, m = index[p], 0
        for k in range(start[a], start[a + 1]):
            m += first[other[k] + 1] - first[other[k]]
        out_start[p + 1] = out_start[p] + m
    out, out_apart = np.empty(out_start[-1], np.int32), np.empty(out_start[-1], np.int8)
    for p in range(len(index)):
        a, m = index[p], out_start[p]
        for k in range(start[a], start[a + 1]):
            for q in range(first[other[k]], first[other[k] + 1]):
                out[m], out_apart[m] = particle[q], apart[k]
                m += 1
    return out_start, out, out_apart


@njit(cache=True, nogil=True, error_model="numpy")
def owned(i, j, index, own, image):
    """The bonds that belong to this tile."""
    out = np.empty(len(i), np.int64)
    n = 0
    for b in range(len(i)):
        p, q = i[b], j[b]
        if index[p] != index[q]:
            mine = own[p] if index[p] < index[q] else own[q]
        else:
            # An atom and its own image, or two images: the one at home has the other on its positive side.
            if own[q]:
                p, q = q, p
            mine = own[p]
            if mine:
                positive = False
                for c in range(3):
                    if image[q, c] != 0:
                        positive = image[q, c] > 0
                        break
                mine = positive
        out[n] = b
        n += 1 if mine else 0
    return out[:n]
