"""The periodic cell list: all pairs of atoms closer than a cutoff, through every image, for any cell.

Atoms are sorted into bins in fractional coordinates. Around each bin the search runs over columns of bins along the
third axis (contiguous in memory after sorting); wrapping a bin index gives the image shift, so that cutoffs larger than
the box, one-atom cells and rotated or left-handed cells are the ordinary case. Bond vectors are taken through the image
found, never re-wrapped.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..compiled import as_tuple, njit
from ..errors import AtcError
from ..frame import Cell
from ..simd import lesser

# Columns of bins around one that are still searched: a cutoff of a thousand times the cell's thickness along two axes.
_MOST_COLUMNS = 4e6
# Bins a cutoff along each axis. Fine bins along the third axis are free, since columns are contiguous; measured on
# argon (36 half bonds/atom).
_BINS_PER_CUTOFF = (1, 1, 4)
_ATOMS_PER_CHUNK = 2048
_EVERY = np.zeros(0, np.bool_)


@dataclass
class Workspace:
    """Buffers of one thread that grow and are reused, so that a chunk costs no allocation."""

    capacity: int = 1 << 16

    def __post_init__(self):
        self._allocate()

    def _allocate(self):
        n = self.capacity
        self.i = np.empty(n, np.int32)
        self.j = np.empty(n, np.int32)
        self.r = np.empty((n, 3))
        self.d2 = np.empty(n)
        self.U = np.empty(n)
        self.G = np.empty(n)

    def grow(self):
        self.capacity *= 2
        self._allocate()


class CellList:
    """Atoms sorted into bins, ready to be searched chunk by chunk for pairs closer than `cutoff`.

    Parameters
    ----------
    positions : (n, 3) array. Need not lie inside the cell.
    cell : Cell. On open axes only atoms inside the atoms' own extent exist; there are no images.
    cutoff : float. May exceed the box.
    """

    def __init__(self, positions, cell: Cell, cutoff: float):
        if not (np.isfinite(cutoff) and cutoff > 0):
            raise AtcError(f"the neighbour cutoff must be a positive number, got {cutoff}")
        positions = np.ascontiguousarray(positions, dtype=np.float64)
        self.cell = cell = cell.completed(positions)
        self.cutoff = float(cutoff)
        self.n = n = len(positions)
        periodic = cell.periodic
        x, s = _folded(positions, cell)
        lo = np.zeros(3)
        extent = np.ones(3)
        if n:
            for k in range(3):
                if not periodic[k]:
                    lo[k] = s[:, k].min()
                    extent[k] = max(s[:, k].max() - lo[k], cutoff / cell.heights[k])
        thickness = cell.heights * extent
        # Not many more bins than atoms: a nearly empty box must not cost memory.
        nb = np.maximum(1.0, np.floor(thickness * np.array(_BINS_PER_CUTOFF) / cutoff))
        limit = max(64, 4 * n)
        while nb.prod() > limit:
            nb = np.maximum(1.0, np.floor(nb * max(0.5, (limit / nb.prod()) ** (1 / 3) * 0.98)))
        nb = nb.astype(np.int64)
        self.n_bins = nb
        # What is not a number is in the first bin, near nothing.
        c = np.fmin(np.fmax((s - lo) * (nb / extent), 0.0), nb - 1.0).astype(np.int64)
        order, self.start = sorted_by_bin((c[:, 0] * nb[1] + c[:, 1]) * nb[2] + c[:, 2], int(nb.prod()))
        self.order, self.x_sorted = order.astype(np.int32), x[order]
        self.columns, self.half_from = self._stencil(thickness / nb, extent / nb)
        self._bins, self._geometry = as_tuple(nb), (as_tuple(cell.vectors), as_tuple(periodic))
        self.most_runs = int((2 * self.columns[:, 2] // nb[2] + 3).sum())
        self._chunks()

    def _stencil(self, width, step):
        """Column offsets (ox, oy, mz) within reach. Those of the half stencil come last, the home column first among
        them."""
        rc = self.cutoff
        # A relative hair wider: rounding in the bin index must not lose a pair at the cutoff.
        reach = np.ceil(rc * (1 + 1e-9) / width).astype(int)
        reach = np.where(self.cell.periodic, reach, np.minimum(reach, self.n_bins - 1))
        if np.prod(2.0 * reach[:2] + 1.0) > _MOST_COLUMNS or reach[2] > _MOST_COLUMNS:
            heights = ", ".join(f"{h:.3g}" for h in self.cell.heights)
            raise AtcError(
                f"the cell is nearly flat: its faces are {heights} apart (internal lengths) and the cutoff is "
                f"{rc:.3g}, so that each atom would see "
                "millions of images of the cell: check the cell vectors, or declare the thin axis open"
            )
        v = self.cell.vectors * step[:, None]
        e = v[2] / np.linalg.norm(v[2])
        a, b = v[0] - (v[0] @ e) * e, v[1] - (v[1] @ e) * e
        cols = []
        for ox in range(-reach[0], reach[0] + 1):
            for oy in range(-reach[1], reach[1] + 1):
                lateral = _distance_to_parallelogram(a, b, ox, oy)
                if lateral > rc * (1 + 1e-9):
                    continue
                mz = int(reach[2])
                if self.cell.orthogonal:
                    mz = min(mz, int(np.ceil(np.sqrt(max(0.0, (rc * (1 + 1e-9)) ** 2 - lateral**2)) / width[2] + 1e-9)))
                cols.append((ox, oy, mz))
        back = [c for c in cols if c[:2] < (0, 0)]
        forth = [c for c in cols if c[:2] > (0, 0)]
        home = [c for c in cols if c[:2] == (0, 0)]
        return np.array(back + home + forth, np.int64).reshape(-1, 3), len(back)

    def _chunks(self):
        """Cut the bins into runs of about the same number of atoms."""
        n_bins = len(self.start) - 1
        targets = np.arange(0, self.n + _ATOMS_PER_CHUNK, _ATOMS_PER_CHUNK)
        edges = np.unique(np.searchsorted(self.start, targets, side="left").clip(0, n_bins))
        edges[-1] = n_bins
        self.chunk_edges = np.unique(np.concatenate([[0], edges]))

    @property
    def n_chunks(self) -> int:
        return len(self.chunk_edges) - 1

    def _runs(self):
        """Room for the runs of atoms around a bin (see `_segments`)."""
        return np.empty(self.most_runs, np.int64), np.empty(self.most_runs, np.int64), np.empty((self.most_runs, 3))

    def half(self, chunk: int, ws: Workspace) -> int:
        """Fill `ws` with every unordered pair whose first atom is in `chunk`; return their number. All chunks together
        give each pair once."""
        while True:
            n = _half(
                self.x_sorted,
                self.order,
                self.start,
                self._bins,
                self.columns,
                self._runs(),
                self.half_from,
                *self._geometry,
                self.cutoff**2,
                self.chunk_edges[chunk],
                self.chunk_edges[chunk + 1],
                ws.i,
                ws.j,
                ws.r,
                ws.d2,
            )
            if n >= 0:
                return n
            ws.grow()

    def full(self, chunk: int, ws: Workspace, only=None) -> int:
        """Like `half`, but every ordered pair (i, j): the neighbours of one atom i are contiguous, r = x_i − x_j.

        only : (n,) bool, the atoms i that are looked at
        """
        only = _EVERY if only is None else only
        while True:
            n = _full(
                self.x_sorted, self.order, self.start, self._bins, self.columns, self._runs(),
                *self._geometry, self.cutoff**2, self.chunk_edges[chunk],
                self.chunk_edges[chunk + 1], only, ws.i, ws.j, ws.r, ws.d2,
            )  # fmt: skip
            if n >= 0:
                return n
            ws.grow()


def neighbor_list(positions, cell: Cell, cutoff: float, *, half: bool = True, threads: int = 1):
    """All pairs of atoms closer than `cutoff`, through every periodic image.

    Parameters
    ----------
    positions : (n, 3), cell : Cell, cutoff : float, all in one length unit
    half : each unordered pair once (default), or every ordered pair

    Returns
    -------
    i, j : (b,) int32
    r_bc : (b, 3) = x_i − x_j through the image
    S_bc : (b, 3) int, with r = x_i − x_j − S @ cell.vectors
    """
    from concurrent.futures import ThreadPoolExecutor

    cl = CellList(positions, cell, cutoff)

    def run(k):
        ws = Workspace()
        n = cl.half(k, ws) if half else cl.full(k, ws)
        return ws.i[:n].copy(), ws.j[:n].copy(), ws.r[:n].copy()

    if threads > 1:
        with ThreadPoolExecutor(threads) as pool:
            parts = list(pool.map(run, range(cl.n_chunks)))
    else:
        parts = [run(k) for k in range(cl.n_chunks)]
    if not parts:
        return np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros((0, 3), np.int64)
    i, j, r = (np.concatenate(p) for p in zip(*parts, strict=True))
    return i, j, r, image_shifts(positions, cl.cell, i, j, r)


def image_shifts(positions, cell: Cell, i, j, r_bc):
    """The integers S with r = x_i − x_j − S @ cell.vectors, from the bonds' own vectors (so that any re-wrapping of
    atoms is followed)."""
    x = np.asarray(positions)
    return np.rint((x[i] - x[j] - r_bc) @ cell.inverse).astype(np.int64)


def _distance_to_parallelogram(a, b, ox, oy):
    """Smallest |u a + v b| for u in [ox−1, ox+1], v in [oy−1, oy+1]: how near two columns of bins can come."""
    if abs(ox) <= 1 and abs(oy) <= 1:
        return 0.0
    best = np.inf
    for p, q, u0, v0 in ((a, b, ox, oy), (b, a, oy, ox)):
        for u in (u0 - 1, u0 + 1):
            v = np.clip(-(u * p) @ q / (q @ q), v0 - 1, v0 + 1)
            best = min(best, float(np.linalg.norm(u * p + v * q)))
    return best


def _folded(positions, cell):
    """Positions relative to the origin (a box 1e6 lengths away must not cost digits) and their fractions, folded into
    the cell along periodic axes."""
    x = positions - cell.origin
    s = sum(x[:, k, None] * cell.inverse[k] for k in range(3))
    for k in np.flatnonzero(cell.periodic):
        whole = np.floor(s[:, k])
        if whole.any():
            s[:, k] -= whole
            x -= whole[:, None] * cell.vectors[k]
    return x, s


def sorted_by_bin(bin_a, many):
    """The order of atoms by bin, in that of their indices within a bin, and the first of each of the `many` bins."""
    # Numbers of sixteen bits are sorted by counting: first by the lower sixteen, then by the rest.
    order = np.argsort(bin_a.astype(np.uint16), kind="stable")
    if many > 1 << 16:
        order = order[np.argsort((bin_a >> 16).astype(np.min_scalar_type(many >> 16))[order], kind="stable")]
    return order, np.concatenate([[0], np.cumsum(np.bincount(bin_a, minlength=many))])


@njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True)
def _segments(b, c0, home, columns, nb, vectors, periodic, start, lo, hi, shift):
    """Runs of sorted atoms that the columns from c0 on around bin b reach, with the Cartesian shift of their image: how
    many runs and atoms.

    home < 0: full stencil.
    """
    n0, n1, n2 = nb
    (v00, v01, v02), (v10, v11, v12), (v20, v21, v22) = vectors
    bz = b % n2
    by = (b // n2) % n1
    bx = b // (n2 * n1)
    n = 0
    atoms = 0
    for c in range(c0, len(columns)):
        x = bx + columns[c, 0]
        y = by + columns[c, 1]
        sx = x // n0
        sy = y // n1
        if (sx != 0 and not periodic[0]) or (sy != 0 and not periodic[1]):
            continue
        x -= sx * n0
        y -= sy * n1
        base = (x * n1 + y) * n2
        m = columns[c, 2]
        z = bz - m
        if c == home:
            z = bz
        end = bz + m
        while z <= end:
            sz = z // n2
            last = lesser(end, (sz + 1) * n2 - 1)  # type: ignore[call-arg, var-annotated]  # as all of numba's intrinsics
            if sz == 0 or periodic[2]:
                off = sz * n2
                at = start[base + z - off]
                to = start[base + last - off + 1]
                if to > at:
                    lo[n] = at
                    hi[n] = to
                    atoms += to - at
                    shift[n, 0] = sx * v00 + sy * v10 + sz * v20
                    shift[n, 1] = sx * v01 + sy * v11 + sz * v21
                    shift[n, 2] = sx * v02 + sy * v12 + sz * v22
                    n += 1
            z = last + 1
    return n, atoms


@njit(cache=True, nogil=True, error_model="numpy", no_cpython_wrapper=True)
def _scan(x, order, xi, yi, zi, a, b, cut2, jout, rout, d2out, n):
    """Append the atoms a..b of the sorted list that lie within the cutoff of (xi, yi, zi). Without a branch: every
    candidate is written, only hits advance."""
    for s in range(a, b):
        dx = xi - x[s, 0]
        dy = yi - x[s, 1]
        dz = zi - x[s, 2]
        d2 = dx * dx + dy * dy + dz * dz
        jout[n] = order[s]
        rout[n, 0] = dx
        rout[n, 1] = dy
        rout[n, 2] = dz
        d2out[n] = d2
        n += 1 if d2 < cut2 else 0
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _half(x, order, start, nb, columns, runs, home, vectors, periodic, cut2, bin0, bin1, iout, jout, rout, d2out):
    capacity = len(jout)
    lo, hi, shift = runs
    n = np.int64(0)  # not the literal, for which `_scan` would be compiled once more
    for b in range(bin0, bin1):
        a0, a1 = start[b], start[b + 1]
        if a0 == a1:
            continue
        m, candidates = _segments(b, home, home, columns, nb, vectors, periodic, start, lo, hi, shift)
        if n + candidates * (a1 - a0) + 1 > capacity:
            return -1
        for s in range(a0, a1):
            xi, yi, zi = x[s, 0], x[s, 1], x[s, 2]
            n0 = n
            for k in range(m):
                n = _scan(
                    x,
                    order,
                    xi - shift[k, 0],
                    yi - shift[k, 1],
                    zi - shift[k, 2],
                    # The first run starts with the home bin itself: only atoms after this one.
                    lo[k] if k else s + 1,
                    hi[k],
                    cut2,
                    jout,
                    rout,
                    d2out,
                    n,
                )
            for p in range(n0, n):
                iout[p] = order[s]
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _full(x, order, start, nb, columns, runs, vectors, periodic, cut2, bin0, bin1, only, iout, jout, rout, d2out):
    capacity = len(jout)
    lo, hi, shift = runs
    n = np.int64(0)  # not the literal, for which `_scan` would be compiled once more
    for b in range(bin0, bin1):
        a0, a1 = start[b], start[b + 1]
        wanted = a1 > a0
        if len(only):
            wanted = False
            for s in range(a0, a1):
                wanted = wanted or only[order[s]]
        if not wanted:
            continue
        m, candidates = _segments(b, 0, -1, columns, nb, vectors, periodic, start, lo, hi, shift)
        if n + candidates * (a1 - a0) + 1 > capacity:
            return -1
        for s in range(a0, a1):
            if len(only) and not only[order[s]]:
                continue
            xi, yi, zi = x[s, 0], x[s, 1], x[s, 2]
            n0 = n
            for k in range(m):
                unshifted = shift[k, 0] == 0.0 and shift[k, 1] == 0.0 and shift[k, 2] == 0.0
                if unshifted and lo[k] <= s < hi[k]:
                    n = _scan(x, order, xi, yi, zi, lo[k], s, cut2, jout, rout, d2out, n)
                    n = _scan(x, order, xi, yi, zi, s + 1, hi[k], cut2, jout, rout, d2out, n)
                else:
                    n = _scan(
                        x,
                        order,
                        xi - shift[k, 0],
                        yi - shift[k, 1],
                        zi - shift[k, 2],
                        lo[k],
                        hi[k],
                        cut2,
                        jout,
                        rout,
                        d2out,
                        n,
                    )
            for p in range(n0, n):
                iout[p] = order[s]
    return n
