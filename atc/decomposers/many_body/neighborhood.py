"""Pairs of neighbours held for one frame, and which of them meet at which atom: what terms of three and more atoms are
built on."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ...neighbors.verlet import cell_list


def by_place(frame: Frame, who, cutoff: float) -> tuple:
    """The cell list of the atoms `who` (None: all) in which an atom is called by its place in the list's order, where
    neighbours are near each other; and the frame's indices by place."""
    cells = cell_list(frame.positions if who is None else frame.positions[who], frame.cell, cutoff, who)
    atom = cells.order if who is None else who[cells.order]
    cells.order = np.arange(len(atom), dtype=np.int32)
    return cells, atom


def impossible(frame: Frame, i: int, j: int, d: float, what: str) -> AtcError:
    """What to say of two atoms of a frame whose `what` force cannot be computed at their distance d."""
    a, b = sorted((frame.ids[i], frame.ids[j]))
    if d == 0.0:
        return AtcError(
            f"{frame.source}: atoms {a} and {b} are at the same place, where the {what} force is undefined; remove one "
            "of them"
        )
    shown = frame.units.to_user("length", d)
    return AtcError(
        f"{frame.source}: the {what} force between atoms {a} and {b} at distance {shown:.3g} is not a finite number"
    )


class Neighborhood:
    """The half neighbour list of a frame, filled by tasks (`collect`), then joined (`join`).

    Inside, atoms are called by their place, see `by_place`.

    Attributes (after `join`)
    ----------
    a, b : (pairs,) int32, r_pc : (pairs, 3) = x_a − x_b, d_p : (pairs,) distances
    edges : (chunks + 1,) the pairs whose first atom is in each chunk
    first : (chunks + 1,) the atoms of each chunk
    start : (n + 1,), pair, end : each atom's neighbours are the entries start[s]..start[s+1]: the pair and which end of
        it the atom is (0: it is a)
    """

    def __init__(self, frame: Frame, who, cutoff: float, what: str):
        self.frame, self.what = frame, what
        self.list, self.atom = by_place(frame, who, cutoff)
        cells = self.list
        self.first = cells.start[cells.chunk_edges]
        self.chunks = cells.n_chunks
        self.parts: list = [None] * self.chunks

    def collect(self, task: int, ws) -> None:
        n = self.list.half(task, ws)
        d = np.sqrt(ws.d2[:n])
        if n and not d.min() > 0.0:
            bad = int(np.argmin(d))
            raise impossible(self.frame, self.atom[ws.i[bad]], self.atom[ws.j[bad]], d[bad], self.what)
        self.parts[task] = ws.i[:n].copy(), ws.j[:n].copy(), ws.r[:n].copy(), d

    def join(self) -> None:
        a, b, r, d = zip(*self.parts, strict=True)
        self.parts = []
        self.edges = np.concatenate([[0], np.cumsum([len(p) for p in a])])
        self.a, self.b, self.r_pc, self.d_p = np.concatenate(a), np.concatenate(b), np.concatenate(r), np.concatenate(d)
        self.start, self.pair, self.end = _index(self.a, self.b, len(self.atom))

    def most(self, task: int) -> tuple[int, int]:
        """The most neighbours of an atom of a chunk, and the number of pairs of neighbours."""
        k = np.diff(self.start[self.first[task] : self.first[task + 1] + 1])
        return int(k.max(initial=0)), int((k * (k - 1) // 2).sum())

    def runs(self, limit: int) -> tuple[np.ndarray, int, int]:
        """Edges of runs of atoms with at most `limit` pairs of neighbours (or one atom); the most neighbours of an
        atom; the most pairs of a run."""
        return runs_of(self.start, limit)


@njit(cache=True, nogil=True, error_model="numpy")
def runs_of(start, limit):
    """Edges of runs of atoms, see `Neighborhood.runs`; an atom's neighbours are start[s + 1] − start[s]."""
    n = len(start) - 1
    edges = [0]
    most = room = here = 0
    for s in range(n):
        k = start[s + 1] - start[s]
        t = k * (k - 1) // 2
        if here + t > limit and s > edges[-1]:
            edges.append(s)
            here = 0
        here += t
        most = max(most, k)
        room = max(room, here)
    edges.append(n)
    return np.array(edges), most, room


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def share_half(energies, i, j, u):
    """The energy of a pair, half to each atom, if anybody asked."""
    if len(energies) > 0:
        energies[i] += 0.5 * u
        energies[j] += 0.5 * u


@njit(cache=True, nogil=True, error_model="numpy")
def around(s, near, who, arm, dist):
    """The neighbours of atom s: their names, x_s − x_k and distances into who, arm, dist. Returns how many. near : as
    `NeighborWork.lists`"""
    start, pair, end, a, b, r, d = near[:7]
    k = start[s + 1] - start[s]
    for e in range(k):
        p = pair[start[s] + e]
        sign = 1.0
        who[e] = b[p]
        if end[start[s] + e] == 1:
            sign = -1.0
            who[e] = a[p]
        dist[e] = d[p]
        for c in range(3):
            arm[e, c] = sign * r[p, c]
    return k


@njit(cache=True, nogil=True, error_model="numpy")
def between_sharing_neighbors(k, near, who, arm, share, slope, out, m):
    """Bonds without G between the k neighbours of an atom s that `around` gave, behind the first m of `out`:
    ∂U^(e)/∂x_f = share_e slope_f (x_s − x_f), and the same with e and f exchanged. Returns how many there are then."""
    atom = near[8]
    out_i, out_j, out_r, out_G, out_D = out
    for e in range(k):
        for f in range(e + 1, k):
            if share[e] * slope[f] == 0.0 and share[f] * slope[e] == 0.0:
                continue
            out_i[m], out_j[m], out_G[m] = atom[who[e]], atom[who[f]], 0.0
            for c in range(3):
                out_r[m, c] = arm[f, c] - arm[e, c]
                out_D[m, 0, c] = share[e] * slope[f] * arm[f, c]
                out_D[m, 1, c] = share[f] * slope[e] * arm[e, c]
            m += 1
    return m


@njit(cache=True, nogil=True, error_model="numpy")
def between_neighbors(k, near, who, arm, G, S, sources, out, m):
    """Bonds between the k neighbours of an atom that `around` gave, behind the first m of `out`: G[e, f], e < f, and
    S[e, f] = ∂U^(e)/∂x_f; those that are all 0 are dropped. Returns how many there are then."""
    atom = near[8]
    out_i, out_j, out_r, out_G, out_D = out
    for e in range(k):
        for f in range(e + 1, k):
            keep = G[e, f] != 0.0
            out_i[m], out_j[m], out_G[m] = atom[who[e]], atom[who[f]], G[e, f]
            for c in range(3):
                out_r[m, c] = arm[f, c] - arm[e, c]
                if sources:
                    out_D[m, 0, c], out_D[m, 1, c] = S[e, f, c], S[f, e, c]
                    keep = keep or S[e, f, c] != 0.0 or S[f, e, c] != 0.0
            m += 1 if keep else 0
    return m


@njit(cache=True, nogil=True, error_model="numpy")
def _index(a, b, n):
    start = np.zeros(n + 1, np.int64)
    for p in range(len(a)):
        start[a[p] + 1] += 1
        start[b[p] + 1] += 1
    for s in range(n):
        start[s + 1] += start[s]
    fill = start[:-1].copy()
    pair = np.empty(2 * len(a), np.int32)
    end = np.empty(2 * len(a), np.int8)
    for p in range(len(a)):
        pair[fill[a[p]]], end[fill[a[p]]] = p, 0
        fill[a[p]] += 1
        pair[fill[b[p]]], end[fill[b[p]]] = p, 1
        fill[b[p]] += 1
    return start, pair, end
