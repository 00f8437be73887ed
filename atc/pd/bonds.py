"""Families of nodes as a bond table: every pair of nodes within the horizon once, row by row.

A bond belongs to the row of its smaller node number. Its reference vector ξ = X_j − X_i + image and length |ξ| never
change; whether it still holds is the state's business (`State.intact_b`).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from ..compiled import njit
from ..errors import AtcError
from ..frame import Cell

JIT = dict(cache=True, nogil=True, error_model="numpy")
# A horizon that is an exact multiple of the spacing is reached or missed by rounding; a hair more decides for reached.
HORIZON_SLACK = 1e-10


@dataclass
class Families:
    """The half bond table of a body.

    Attributes
    ----------
    start_n : (n + 1,) int64. The bonds of row i are start_n[i]:start_n[i+1].
    i_b, j_b : (b,) int32 with i ≤ j (equal where a node sees its own periodic image)
    image_b : (b,) uint8 or empty when nothing is periodic: row of `images_tc`, the translation added to X_j
    r0_b : (b,) |ξ|
    on_horizon : whether some bond is as long as the horizon to rounding
    """

    start_n: np.ndarray
    j_b: np.ndarray
    image_b: np.ndarray
    images_tc: np.ndarray
    r0_b: np.ndarray
    on_horizon: bool

    def __len__(self):
        return len(self.j_b)

    @property
    def i_b(self) -> np.ndarray:
        return np.repeat(np.arange(len(self.start_n) - 1, dtype=np.int32), np.diff(self.start_n))

    def rows_of(self, bonds) -> np.ndarray:
        """i of the numbered bonds only."""
        return (np.searchsorted(self.start_n, bonds, side="right") - 1).astype(np.int32)

    def xi_bc(self, X_nc) -> np.ndarray:
        """(b, 3) reference vectors from i to j."""
        xi = X_nc[self.j_b] - X_nc[self.i_b]
        if len(self.image_b):
            xi += self.images_tc[self.image_b]
        return xi

    def sums(self, at_i_b, at_j_b=None) -> np.ndarray:
        """(n,) sums over each node's whole family: `at_i_b` goes to i, `at_j_b` (default the same) to j."""
        n = len(self.start_n) - 1
        at_j_b = at_i_b if at_j_b is None else at_j_b
        # Without bonds numpy would count in integers.
        return np.bincount(self.i_b, at_i_b, n).astype(float, copy=False) + np.bincount(self.j_b, at_j_b, n)

    def keep(self, mask_b) -> Families:
        """The table without the bonds where `mask_b` is False."""
        n = len(self.start_n) - 1
        counts = np.bincount(self.i_b[mask_b], minlength=n)
        image = self.image_b[mask_b] if len(self.image_b) else self.image_b
        start = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        return Families(start, self.j_b[mask_b], image, self.images_tc, self.r0_b[mask_b], self.on_horizon)


def families(X_nc, cell: Cell, horizon: float, *, coincident: bool = False) -> Families:
    """All pairs of nodes with |ξ| ≤ `horizon` (1 + 1e-10), through every periodic image.

    Parameters
    ----------
    X_nc : (n, 3) reference positions. cell : Cell (open axes have no images). horizon : float, one length unit
        throughout.
    coincident : whether nodes may be at the same place (an error otherwise)
    """
    from ..neighbors.cell_list import CellList, Workspace

    reach = horizon * (1 + HORIZON_SLACK)
    n = len(X_nc)
    periodic = bool(cell.periodic.any())
    cl = CellList(X_nc, cell, reach * (1 + 1e-9))
    ws = Workspace()
    rows, columns, shifts = [], [], []
    for chunk in range(cl.n_chunks):
        m = cl.half(chunk, ws)
        i, j = ws.i[:m].copy(), ws.j[:m].copy()
        if periodic:
            S = np.rint((X_nc[i] - X_nc[j] - ws.r[:m]) @ cl.cell.inverse).astype(np.int16)
            # i < j; a node and its own image: the lexicographically positive one.
            swap = (i > j) | (
                (i == j) & ((S[:, 0] < 0) | ((S[:, 0] == 0) & ((S[:, 1] < 0) | ((S[:, 1] == 0) & (S[:, 2] < 0)))))
            )
            S[swap] *= -1
            shifts.append(S)
        else:
            swap = i > j
        i[swap], j[swap] = j[swap], i[swap]
        rows.append(i)
        columns.append(j)
    del ws
    i = np.concatenate(rows) if rows else np.zeros(0, np.int32)
    j = np.concatenate(columns) if columns else np.zeros(0, np.int32)
    del rows, columns
    if periodic:
        S = np.concatenate(shifts) if shifts else np.zeros((0, 3), np.int16)
        # r = X_i − X_j − S·cell, so ξ = −r = X_j − X_i + S·cell.
        lo = S.min(axis=0) if len(S) else np.zeros(3, np.int64)
        span = (S.max(axis=0) if len(S) else lo) - lo + 1
        if int(np.prod(span.astype(int))) > 255:
            raise AtcError(
                f"the horizon {horizon:g} spans more than 6 periodic cells: make the cell larger, or the horizon "
                "smaller"
            )
        code = ((S[:, 0] - lo[0]) * span[1] + (S[:, 1] - lo[1])) * span[2] + (S[:, 2] - lo[2])
        images = np.stack(
            np.meshgrid(
                *(np.arange(a, a + s) for a, s in zip(lo.astype(int), span.astype(int), strict=True)), indexing="ij"
            ),
            -1,
        )
        images_tc = images.reshape(-1, 3).astype(float) @ cl.cell.vectors
        image_b = code.astype(np.uint8)
        del S, code
    else:
        image_b, images_tc = np.zeros(0, np.uint8), np.zeros((1, 3))
    start, j, image_b = _rows(n, i, j, image_b)
    del i
    r0 = np.empty(len(j))
    _lengths(np.ascontiguousarray(X_nc), start, j, image_b, images_tc, r0)
    table = Families(start, j, image_b, images_tc, r0, bool((r0 > horizon * (1 - HORIZON_SLACK)).any()))
    if (r0 > reach).any():
        table = table.keep(r0 <= reach)
    if len(r0) and not coincident and r0.min() == 0:
        b = int(np.argmin(r0))
        raise AtcError(
            f"nodes {table.i_b[b]} and {table.j_b[b]} are at the same place: every node needs a place of its own"
        )
    return table


@njit(**JIT)
def _rows(n, i, j, image):
    """Counting sort by i, then each row by j (and image): the order does not depend on how the pairs were found."""
    start = np.zeros(n + 1, np.int64)
    for b in range(len(i)):
        start[i[b] + 1] += 1
    for k in range(n):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    out = np.empty_like(j)
    out_image = np.empty_like(image)
    for b in range(len(i)):
        p = place[i[b]]
        place[i[b]] += 1
        out[p] = j[b]
        if len(image):
            out_image[p] = image[b]
    for k in range(n):
        for a in range(start[k] + 1, start[k + 1]):
            jj = out[a]
            im = out_image[a] if len(image) else np.uint8(0)
            m = a
            while m > start[k] and (out[m - 1] > jj or (len(image) > 0 and out[m - 1] == jj and out_image[m - 1] > im)):
                out[m] = out[m - 1]
                if len(image):
                    out_image[m] = out_image[m - 1]
                m -= 1
            out[m] = jj
            if len(image):
                out_image[m] = im
    return start, out, out_image


@njit(**JIT)
def _lengths(X, start, j, image, images, r0):
    for i in range(len(start) - 1):
        for b in range(start[i], start[i + 1]):
            x = X[j[b], 0] - X[i, 0]
            y = X[j[b], 1] - X[i, 1]
            z = X[j[b], 2] - X[i, 2]
            if len(image):
                x += images[image[b], 0]
                y += images[image[b], 1]
                z += images[image[b], 2]
            r0[b] = np.sqrt(x * x + y * y + z * z)


class Notch:
    """A cut: a flat parallelogram with a corner at `origin` and edges `a` and `b`. Bonds that cross it do not exist.

    `as_damage` : the bonds stay in the families and count as broken from the start (the cut shows as damage; LPS's
    weighted volume is that of the uncut body).
    """

    def __init__(self, origin, a, b, *, as_damage: bool = False):
        self.origin, self.a, self.b = (np.array(v, float) for v in (origin, a, b))
        self.as_damage = bool(as_damage)
        finite = np.isfinite([self.origin, self.a, self.b]).all()
        self.normal = np.cross(self.a, self.b) if finite else np.zeros(3)
        if not np.linalg.norm(self.normal) > 1e-9 * np.linalg.norm(self.a) * np.linalg.norm(self.b):
            raise AtcError(
                f"a notch needs a place and two edge vectors that span a plane, got {self.a.tolist()} and "
                f"{self.b.tolist()}"
            )

    @classmethod
    def line(cls, start, end, *, as_damage: bool = False) -> Notch:
        """For plates in the x-y plane: from (x, y) to (x, y), through the whole thickness."""
        (x0, y0), (x1, y1) = start, end
        if not 0 < np.hypot(x1 - x0, y1 - y0) < np.inf:
            raise AtcError(f"a notch needs a length: it goes from {list(start)} to {list(end)}")
        big = 1e3 * float(np.hypot(x1 - x0, y1 - y0))
        return cls((x0, y0, -big), (x1 - x0, y1 - y0, 0.0), (0.0, 0.0, 2 * big), as_damage=as_damage)

    def crosses(self, x_bc, xi_bc) -> np.ndarray:
        """(b,) whether the segment from x to x + ξ meets the parallelogram (its border included)."""
        n = self.normal / np.linalg.norm(self.normal)
        rel = self.origin - x_bc
        height = rel @ n
        slope = xi_bc @ n
        t = np.divide(height, slope, out=np.full(len(slope), -1.0), where=slope != 0)
        hit = (t >= 0) & (t <= 1)
        p = t[:, None] * xi_bc - rel
        gram = np.array([[self.a @ self.a, self.a @ self.b], [self.a @ self.b, self.b @ self.b]])
        uv = np.stack([p @ self.a, p @ self.b], axis=1) @ np.linalg.inv(gram)
        eps = 1e-12
        return hit & (uv >= -eps).all(axis=1) & (uv <= 1 + eps).all(axis=1)

    def crosses_periodic(self, x_bc, xi_bc, image_bc, vectors) -> np.ndarray:
        """(b,) the same in a periodic cell, for bonds that end in its images (b, 3), whole numbers: those pass the cell
        in several pieces."""
        hit = self.crosses(x_bc, xi_bc)
        for axes in list(product((0, 1), repeat=3))[1:]:
            some = np.flatnonzero((image_bc * axes).any(axis=1))
            if len(some):
                hit[some] |= self.crosses(x_bc[some] - (image_bc[some] * axes) @ vectors, xi_bc[some])
        return hit
