"""Short-range contact (R 3.0.13-3.0.15): any two nodes, bonded or not, that come closer than d = min(0.9 |ξ|, 1.35 (r_i
+ r_j)) repel.

Force density on i: 15 c V_j (d − r)/δ, so that the pair's force is 15 c V_i V_j (d − r)/δ on both. Pairs in contact are
added in the order of their node numbers, so that nothing depends on when a list was last made.

Most of a body hardly moves while its debris flies. So there are two lists. The near list holds the pairs of slow nodes
that are about to touch: nodes are slow while they are within `reach` of where they were at the last survey of the whole
body. All others are movers, and each of these has its whole surroundings listed anew when movers have gone far enough.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from ..frame import Cell
from .bonds import JIT
from .friction import rub_pairs


@dataclass
class Contact:
    """Settings of the contact force.

    strength : the multiple of the micromodulus c (15). own : share of the reference distance (0.9). reach : of the
        radii's sum (1.35).
    skin : how much further than `reach` the list of fast nodes looks, in spacings. It makes nothing but speed.
    friction : Coulomb's coefficient μ between nodes in contact (see `friction`)
    """

    strength: float = 15.0
    own: float = 0.9
    reach: float = 1.35
    skin: float = 0.75
    friction: float = 0.0

    def __post_init__(self):
        if not (self.strength >= 0 and 0 < self.own <= 1 and self.reach > 0 and self.skin > 0):
            raise AtcError("contact needs strength >= 0, 0 < own <= 1, reach > 0 and skin > 0")
        if not (self.friction >= 0 and np.isfinite(self.friction)):
            raise AtcError(f"contact: friction is a coefficient, a number of 0 or more, got {self.friction!r}")


class ContactSearch:
    """The pairs that can come into contact, kept up as nodes move."""

    def __init__(self, body, contact: Contact, constant_k, kind_of, crew):
        self.body, self.contact, self.crew = body, contact, crew
        # Node by material index → c of a pair.
        self.c_k, (self.index_n, self.m) = constant_k * contact.strength / body.horizon, kind_of
        self.cut = contact.reach * 2 * float(body.radius_n.max())
        self.skin = contact.skin * body.spacing
        # Slow nodes: with the share of the gap that bonded neighbours at rest leave, so that an undamaged lattice has
        # no pairs in the near list.
        self.shortest = max(0.45 * (1 - contact.own), 0.02) * body.spacing
        self.reach = min(self.shortest, 0.5 * self.skin)
        self.periodic = bool(body.cell.periodic.any())
        self.home_nc = None
        self.rebuilt = 0
        self.age = 0
        self.strain = None

    def add(self, z, F_nc, rubbed=None):
        """Add contact forces to F (n, 3); returns their energy. `rubbed` : velocities, masses, the time step, and
        (n, 3) to which friction is added."""
        if self.home_nc is None:
            self._survey(z)
        self.age += 1
        slow, fast = np.max(self.crew.nodes(_moved, len(self.body), z, self.home_nc, self.mover_n), axis=0)
        if not np.isfinite(slow + fast):
            raise AtcError("the run has blown up: positions are no longer finite numbers; take a smaller time step")
        # Since the movers' list was made a slow node can have gone from one side of its home to the other.
        if slow > self.reach or fast + max(fast, 2 * self.reach) > self.skin + 2 * self.reach:
            self._renew(z)
        n = len(self.i)
        active = np.concatenate(self.crew.run(_touching, n, self.i, self.j, self.shift, z, self.d, grain=1 << 14))
        what = active, self.i, self.j, self.shift, z, self.d, self.body.V_n, self.index_n, self.m, self.c_k
        if rubbed is not None and self.contact.friction:
            rub_pairs(*what, self.contact.friction, *rubbed)
        return _push(*what, F_nc)

    def _renew(self, z):
        """New lists: of the movers if they are few, of the whole body otherwise."""
        n = len(self.body)
        away = np.empty(n)
        self.crew.nodes(_away, n, z, self.home_nc, away)
        # Well before they have to be, so that it is long until the next one starts to move.
        moves = self.mover_n | (away > 0.5 * self.reach)
        if np.count_nonzero(moves) > _MOST_MOVERS * n:
            # A survey a few steps after the last one: everything moves, and more room for it is cheaper.
            if self.age < 20:
                self.reach = min(2 * self.reach, 0.5 * self.skin)
            elif self.age > 200:
                self.reach = max(0.5 * self.reach, min(self.shortest, 0.5 * self.skin))
            self._survey(z)
            return
        self.mover_n = moves
        y = z[:, :3] + z[:, 3:6]
        self.home_nc[moves] = y[moves]
        both = self._pairs(y, self.cut + self.skin + 2 * self.reach, moves)
        still = ~(moves[self.near[0]] | moves[self.near[1]])
        self._take([np.concatenate([a[still] if len(a) else a, b]) for a, b in zip(self.near, both, strict=True)])

    def _survey(self, z):
        self.home_nc = z[:, :3] + z[:, 3:6]
        self.mover_n = np.zeros(len(self.body), bool)
        self.age = 0
        self.near = self._pairs(self.home_nc, self.cut + 2 * self.reach, None)
        self._take(self.near)

    def _pairs(self, y, cutoff, movers):
        """i ≤ j, shift (p, 6 or 0) and contact distance of all pairs within `cutoff` that have a mover in them; with
        `movers` None of those that are within twice the slow nodes' reach of touching. Shifts are the translations of
        j's image, now and in the reference configuration."""
        from ..neighbors.cell_list import CellList, Workspace

        self.rebuilt += 1
        cell = self.body.cell
        if self.strain is not None:
            cell = Cell(cell.vectors @ (np.eye(3) + self.strain).T, cell.origin, cell.periodic)
        cl = CellList(y, cell, cutoff)
        X, radius, own, reach = self.body.X_nc, self.body.radius_n, self.contact.own, self.contact.reach
        before, mask = self.body.cell.vectors, _NOBODY if movers is None else movers

        def search(first, last):
            ws, parts = Workspace(), []
            for chunk in range(first, last):
                m = cl.half(chunk, ws) if movers is None else cl.full(chunk, ws, movers)
                i, j, r2 = ws.i[:m], ws.j[:m], ws.d2[:m]
                S = np.rint((y[i] - y[j] - ws.r[:m]) @ cl.cell.inverse) if self.periodic else np.zeros((0, 3))
                parts.append(_select(i, j, r2, S, cl.cell.vectors, before, X, radius, own, reach, mask, 2 * self.reach))
            return parts

        found = [part for parts in self.crew.run(search, cl.n_chunks) for part in parts]
        return [np.concatenate(a) for a in zip(*found, strict=True)]

    def _take(self, pairs):
        """Pairs by number of their first node, then of the second, then by image: the order in which forces are
        added."""
        i, j, shift, _ = pairs
        if self.periodic:
            order = np.lexsort((shift[:, 5], shift[:, 4], shift[:, 3], j, i))
        else:
            order = np.argsort(i.astype(np.int64) * len(self.body) + j, kind="stable")
        self.i, self.j, self.shift, self.d = (a[order] if len(a) else a for a in pairs)


# More movers than this share of the nodes: the whole body is surveyed anew.
_MOST_MOVERS = 0.1
_NOBODY = np.zeros(0, np.bool_)


@njit(**JIT)
def _moved(a, b, z, home, mover):
    """How far the farthest slow node and the farthest mover are from their homes."""
    slow = 0.0
    fast = 0.0
    for n in range(a, b):
        d2 = 0.0
        for c in range(3):
            d = (z[n, c] + z[n, 3 + c]) - home[n, c]
            d2 += d * d
        # What is not a number counts as farther than any.
        if not d2 < np.inf:
            d2 = np.inf
        if mover[n]:
            fast = d2 if d2 > fast else fast
        else:
            slow = d2 if d2 > slow else slow
    return np.sqrt(slow), np.sqrt(fast)


@njit(**JIT)
def _away(a, b, z, home, out):
    for n in range(a, b):
        d2 = 0.0
        for c in range(3):
            d = (z[n, c] + z[n, 3 + c]) - home[n, c]
            d2 += d * d
        out[n] = np.sqrt(d2)


@njit(**JIT)
def _select(i, j, r2, S, now, before, X, radius, own, reach, mover, within):
    """Of a cell list's pairs (r = y_i − y_j − S·cell) those to keep, with i ≤ j, their shifts and contact distances.

    With movers, pairs come from each of their ends that is one, and are kept once. Without, pairs with a gap below
    `within` are kept.
    """
    kept = 0
    out_i = np.empty(len(i), np.int32)
    out_j = np.empty(len(i), np.int32)
    out_d = np.empty(len(i))
    shift = np.empty((len(S), 6))
    s = np.zeros(3)
    for p in range(len(i)):
        a = i[p]
        b = j[p]
        if len(S):
            s[0], s[1], s[2] = S[p, 0], S[p, 1], S[p, 2]
        swap = a > b or (a == b and (s[0] < 0 or (s[0] == 0 and (s[1] < 0 or (s[1] == 0 and s[2] < 0)))))
        if len(mover) and swap and mover[b]:
            continue
        if swap:
            a, b = b, a
            s *= -1.0
        r02 = 0.0
        for c in range(3):
            x = X[b, c] - X[a, c]
            if len(S):
                t = s[0] * before[0, c] + s[1] * before[1, c] + s[2] * before[2, c]
                shift[kept, c] = s[0] * now[0, c] + s[1] * now[1, c] + s[2] * now[2, c]
                shift[kept, 3 + c] = t
                x += t
            r02 += x * x
        far = reach * (radius[a] + radius[b])
        near = own * np.sqrt(r02)
        d = near if near < far else far
        # A hair more for rounding.
        if len(mover) == 0 and np.sqrt(r2[p]) > (d + within) * (1 + 1e-9):
            continue
        out_i[kept] = a
        out_j[kept] = b
        out_d[kept] = d
        kept += 1
    return out_i[:kept].copy(), out_j[:kept].copy(), shift[: min(kept, len(S))].copy(), out_d[:kept].copy()


@njit(**JIT)
def _apart(p, i, j, shift, z):
    """Vector from i to j's image of pair p."""
    a = np.uint64(i[p])
    b = np.uint64(j[p])
    x = (z[b, 0] + z[b, 3]) - (z[a, 0] + z[a, 3])
    y = (z[b, 1] + z[b, 4]) - (z[a, 1] + z[a, 4])
    w = (z[b, 2] + z[b, 5]) - (z[a, 2] + z[a, 5])
    if len(shift):
        x += shift[p, 0]
        y += shift[p, 1]
        w += shift[p, 2]
    return x, y, w


@njit(**JIT)
def _touching(a, b, i, j, shift, z, d):
    """The pairs in contact among a..b, in order."""
    active = np.empty(b - a, np.int64)
    n = 0
    for p in range(a, b):
        x, y, w = _apart(p, i, j, shift, z)
        if x * x + y * y + w * w < d[p] * d[p]:
            active[n] = p
            n += 1
    return active[:n].copy()


@njit(**JIT)
def _push(active, i, j, shift, z, d, V, index, m, c_k, F):
    energy = 0.0
    for p in active:
        x, y, w = _apart(p, i, j, shift, z)
        r = np.sqrt(x * x + y * y + w * w)
        a = i[p]
        b = j[p]
        k = c_k[min(index[a], index[b]) * m + max(index[a], index[b])] * V[a] * V[b]
        gap = d[p] - r
        energy += 0.5 * k * gap * gap
        # Nodes at the same place have no direction to be pushed in.
        if r > 0.0:
            k *= gap / r
            F[a, 0] -= k * x
            F[a, 1] -= k * y
            F[a, 2] -= k * w
            F[b, 0] += k * x
            F[b, 1] += k * y
            F[b, 2] += k * w
    return energy
