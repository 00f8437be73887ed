"""Short-range contact (R 3.0.13-3.0.15): any two nodes, bonded or not, that come closer than d = min(0.9 |ξ|, 1.35 (r_i + r_j)) repel.

Force density on i: 15 c V_j (d − r)/δ, so that the pair's force is 15 c V_i V_j (d − r)/δ on both. Pairs in contact are added in the order of their
node numbers, so that nothing depends on when the list was last made.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from ..errors import AtcError
from ..frame import Cell
from .bonds import JIT


@dataclass
class Contact:
    """Settings of the contact force.

    strength : the multiple of the micromodulus c (15). own : share of the reference distance (0.9). reach : of the radii's sum (1.35).
    skin : how much further than `reach` the list looks, in spacings
    """

    strength: float = 15.0
    own: float = 0.9
    reach: float = 1.35
    skin: float = 0.75

    def __post_init__(self):
        if not (self.strength >= 0 and 0 < self.own <= 1 and self.reach > 0 and self.skin > 0):
            raise AtcError("contact needs strength >= 0, 0 < own <= 1, reach > 0 and skin > 0")


class ContactSearch:
    """The list of pairs that can come into contact, renewed when nodes have moved half a skin since it was made."""

    def __init__(self, body, contact: Contact, constant_k, kind_of, crew):
        self.body, self.contact, self.crew = body, contact, crew
        # Node by material index → c of a pair.
        self.c_k, (self.index_n, self.m) = constant_k * contact.strength / body.horizon, kind_of
        self.cut = contact.reach * 2 * float(body.radius_n.max())
        self.skin = contact.skin * body.spacing
        self.periodic = bool(body.cell.periodic.any())
        self.ref = None
        self.rebuilt = 0
        self.strain = None

    def _build(self, z):
        y = z[:, :3] + z[:, 3:6]
        self.rebuilt += 1
        cell = self.body.cell
        if self.strain is not None:
            cell = Cell(cell.vectors @ (np.eye(3) + self.strain).T, cell.origin, cell.periodic)
        self.start, self.j, self.image, now = contact_pairs(y, cell, self.cut + self.skin)
        # Translations of images now, and in the reference configuration.
        self.images = np.concatenate([now, now if self.strain is None else now @ np.linalg.inv(np.eye(3) + self.strain).T], axis=1)
        self.d = np.empty(len(self.j))
        self.margin = np.empty(len(self.body))
        # Nodes move less than this between searches, or the list is renewed.
        self.crew.nodes(
            _limits, len(self.body), self.start, self.j, self.image, self.images, z, self.body.radius_n, self.contact.own, self.contact.reach,
            self.d, self.margin,
        )  # fmt: skip
        self.ref = y
        self.active = np.empty(len(self.j), np.int64)
        self.counts = np.zeros(len(self.body) // _CHUNK + 1, np.int64)

    def add(self, z, F_nc):
        """Add contact forces to F (n, 3); returns their energy."""
        moved = max(self.crew.nodes(_moved, len(self.body), z, self.ref)) if self.ref is not None else np.inf
        if not np.isfinite(moved) and self.ref is not None:
            raise AtcError("the run has blown up: positions are no longer finite numbers; take a smaller time step")
        if 2 * moved > self.skin:
            self._build(z)
            moved = 0.0
        n_chunks = -(-len(self.body) // _CHUNK)
        self.crew.run(
            _touching, n_chunks, self.start, self.j, self.image, self.images, z, self.ref, self.d, self.margin, moved, self.active, self.counts,
            grain=8,
        )  # fmt: skip
        return _push(
            n_chunks, self.start, self.j, self.image, self.images, z, self.d, self.active, self.counts, self.body.V_n, self.index_n, self.m,
            self.c_k, F_nc,
        )  # fmt: skip


_CHUNK = 1024


def contact_pairs(y_nc, cell: Cell, cutoff: float):
    """All pairs i ≤ j closer than `cutoff` in the current configuration, as rows sorted by j: start, j, image and the translations."""
    from .bonds import families

    t = families(y_nc, cell, cutoff, coincident=True)
    return t.start_n, t.j_b, t.image_b, t.images_tc


@njit(**JIT)
def _moved(a, b, z, ref):
    top = 0.0
    for n in range(a, b):
        d2 = 0.0
        for c in range(3):
            d = (z[n, c] + z[n, 3 + c]) - ref[n, c]
            d2 += d * d
        if not d2 <= top:
            top = d2
    return np.sqrt(top)


@njit(**JIT)
def _limits(a, b, start, j, image, images, z, radius, own, reach, d, margin):
    """Contact distance of every pair, and how much each row's nearest pair has left until it touches."""
    for i in range(a, b):
        margin[i] = np.inf
        for p in range(start[i], start[i + 1]):
            n = j[p]
            r2 = 0.0
            r02 = 0.0
            for c in range(3):
                t = images[image[p], c] if len(image) else 0.0
                x = z[n, 3 + c] - z[i, 3 + c] + (images[image[p], 3 + c] if len(image) else 0.0)
                r02 += x * x
                x = (z[n, 3 + c] + z[n, c]) - (z[i, 3 + c] + z[i, c]) + t
                r2 += x * x
            far = reach * (radius[i] + radius[n])
            near = own * np.sqrt(r02)
            d[p] = near if near < far else far
            left = np.sqrt(r2) - d[p]
            if left < margin[i]:
                margin[i] = left


@njit(**JIT)
def _touching(a, b, start, j, image, images, z, ref, d, margin, moved, active, counts):
    """The pairs in contact, chunk of rows by chunk, in order; `active` is filled from the chunk's first pair on."""
    for chunk in range(a, b):
        i0 = chunk * _CHUNK
        i1 = min(len(margin), i0 + _CHUNK)
        out = start[i0]
        for i in range(i0, i1):
            y0 = z[i, 0] + z[i, 3]
            y1 = z[i, 1] + z[i, 4]
            y2 = z[i, 2] + z[i, 5]
            own = np.sqrt((y0 - ref[i, 0]) ** 2 + (y1 - ref[i, 1]) ** 2 + (y2 - ref[i, 2]) ** 2)
            # A hair more for rounding.
            if margin[i] > (own + moved) * (1 + 1e-9):
                continue
            for p in range(start[i], start[i + 1]):
                n = j[p]
                x = (z[n, 0] + z[n, 3]) - y0
                y = (z[n, 1] + z[n, 4]) - y1
                w = (z[n, 2] + z[n, 5]) - y2
                if len(image):
                    x += images[image[p], 0]
                    y += images[image[p], 1]
                    w += images[image[p], 2]
                if x * x + y * y + w * w < d[p] * d[p]:
                    active[out] = p
                    out += 1
        counts[chunk] = out - start[i0]


@njit(**JIT)
def _push(n_chunks, start, j, image, images, z, d, active, counts, V, index, m, c_k, F):
    energy = 0.0
    for chunk in range(n_chunks):
        i = chunk * _CHUNK
        first = start[i]
        for q in range(first, first + counts[chunk]):
            p = active[q]
            while start[i + 1] <= p:
                i += 1
            n = j[p]
            x = (z[n, 0] + z[n, 3]) - (z[i, 0] + z[i, 3])
            y = (z[n, 1] + z[n, 4]) - (z[i, 1] + z[i, 4])
            w = (z[n, 2] + z[n, 5]) - (z[i, 2] + z[i, 5])
            if len(image):
                x += images[image[p], 0]
                y += images[image[p], 1]
                w += images[image[p], 2]
            r = np.sqrt(x * x + y * y + w * w)
            a = index[i]
            b = index[n]
            k = c_k[min(a, b) * m + max(a, b)] * V[i] * V[n]
            gap = d[p] - r
            energy += 0.5 * k * gap * gap
            # Nodes at the same place have no direction to be pushed in.
            if r > 0.0:
                k *= gap / r
                F[i, 0] -= k * x
                F[i, 1] -= k * y
                F[i, 2] -= k * w
                F[n, 0] += k * x
                F[n, 1] += k * y
                F[n, 2] += k * w
    return energy
