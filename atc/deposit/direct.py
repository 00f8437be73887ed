"""The exact deposits: on a lattice, at scattered points, averaged over slabs. Buffers, bins and bounds; the loops are
in `_lattice`, `_points`, `_slab`."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cache
from math import ceil

import numpy as np

from ..compiled import as_tuple, njit
from ..errors import AtcError
from ..kernels import TINY
from ..kernels.binned import profile_of
from ..kernels.lanes import ROOM
from ..neighbors.cell_list import sorted_by_bin
from ..simd import ENTRY, specialise
from . import _lattice, _points, _slab

# Bonds whose geometry is prepared at once.
PIECE = 8192
# Room for the points in reach of one atom, and for (bond, point) pairs (more are taken in turns); not multiples of 4096
# bytes, as in `LatticeDeposit`.
POINTS, PAIRS = 1032, 8200
# Up to so many points bins are marked that have one in reach; so many bins on that way.
_FEW, _BINS_EACH = 300, 8

_NOT_FINITE = (
    "an atom's position or a bond's vector is not a finite number: check the trajectory and the potential for "
    "coincident atoms"
)


@cache
def _core(loop, compiled):
    """The loop's copy for a family of kernels, or of profiles."""
    if loop is _points.sum_pairs:
        return specialise(loop, compiled.name, BETA=compiled.pairs)
    if loop is _slab.slab_bonds:
        return specialise(loop, compiled.name, MEAN=compiled.mean, CONSTANTS=compiled.constants)
    return specialise(loop, compiled.name, BETA=compiled.beta, CONSTANTS=compiled.constants)


def stress_components(r_bc, G_b):
    """G r⊗r: xx, yy, zz, yz, xz, xy."""
    b_bk = np.empty((len(G_b), 6))
    put_stress(_array(r_bc), _array(G_b), 0, b_bk)
    return b_bk


@njit(**ENTRY)
def put_stress(r_bc, G_b, at, out_bk):
    """G r⊗r in columns at .. at+5: xx, yy, zz, yz, xz, xy."""
    for b in range(len(G_b)):
        x, y, z, G = r_bc[b, 0], r_bc[b, 1], r_bc[b, 2], G_b[b]
        out_bk[b, at], out_bk[b, at + 1], out_bk[b, at + 2] = G * x * x, G * y * y, G * z * z
        out_bk[b, at + 3], out_bk[b, at + 4], out_bk[b, at + 5] = G * y * z, G * x * z, G * x * y


def _array(a, dtype=np.float64):
    """Contiguous and writable: a read-only array is another type to numba, and would have everything compiled again."""
    a = np.ascontiguousarray(a, dtype=dtype)
    return a if a.flags.writeable else a.copy()


def in_bins(cell, s, support, most):
    """Bins of a cell for points at fractional coordinates s (n, 3), in the cell along periodic axes: about as wide as
    half the support, but not many more of them than points; `most` along an axis.

    Returns
    -------
    (bins, low, scale) : (3,) how many, where they begin, how many to a whole edge
    order : of the points by bin. start : the first of each bin
    """
    low = np.where(cell.periodic, 0.0, s.min(0))
    span = np.where(cell.periodic, 1.0, np.maximum(s.max(0) - low, 1e-9))
    edge = max(0.5 * support, (cell.volume * span.prod() / len(s)) ** (1.0 / 3.0))
    bins = np.clip((span * cell.heights / edge).astype(np.int64), 1, most)
    scale = bins / span
    at = np.clip(((s - low) * scale).astype(np.int64), 0, bins - 1)
    return (bins, low, scale), *sorted_by_bin(np.ravel_multi_index(tuple(at.T), tuple(bins)), int(bins.prod()))


class Deposit:
    """What all deposits share: the accumulators and the three ways to add. See `atc.deposit.make`."""

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads):
        self.grid, self.kernel = grid, kernel
        self.cell = cell if cell.complete else cell.completed(grid.points_gc)
        self._origin, self._vectors, self._inverse = (
            _array(a) for a in (self.cell.origin, self.cell.vectors, self.cell.inverse)
        )
        self.n_site, self.n_bond, self.threads = int(n_site), int(n_bond), int(threads)
        self._buffers = {}
        self._visits = [0] * self.threads

    @property
    def visits(self) -> int:
        """How many (bond, point) and (site, point) pairs have been evaluated."""
        return int(sum(self._visits))

    def add_sites(self, x_nc, a_nk, thread=0):
        """Add Σ_j a_j φ(x − x_j), all periodic images: x_nc (n, 3), a_nk (n, n_site)."""
        x_nc, a_nk = _array(x_nc), _array(a_nk)
        n = len(x_nc)
        if a_nk.shape != (n, self.n_site):
            raise ValueError(f"site values must have shape {(n, self.n_site)}, got {a_nk.shape}")
        if n and self.n_site:
            self._add("site", x_nc, np.arange(n, dtype=np.int32), np.zeros((n, 3)), a_nk, thread)

    def add_bonds(self, x_bc, r_bc, b_bk, thread=0):
        """Add Σ_b b β(x), all periodic images; bond b runs from x_b to x_b − r_b: x_bc, r_bc (b, 3), b_bk (b,
        n_bond)."""
        x_bc, r_bc, b_bk = _array(x_bc), _array(r_bc), _array(b_bk)
        n = len(x_bc)
        if r_bc.shape != (n, 3) or b_bk.shape != (n, self.n_bond):
            raise ValueError(
                f"bond vectors and values must have shapes {(n, 3)} and {(n, self.n_bond)}, got {r_bc.shape} and "
                f"{b_bk.shape}"
            )
        if n and self.n_bond:
            self._add("bond", x_bc, np.arange(n, dtype=np.int32), r_bc, b_bk, thread)

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0, j_b=None):
        """Add Σ_b G r⊗r β(x), components xx, yy, zz, yz, xz, xy; bond b starts at x_nc[i_b], and ends at x_nc[j_b] or a
        periodic image of it, if given."""
        x_nc, i_b, r_bc, G_b = _array(x_nc), _array(i_b, np.int32), _array(r_bc), _array(G_b)
        if self.n_bond != 6:
            raise ValueError(f"bond stress has 6 components, this deposit was made for {self.n_bond}")
        n = len(G_b)
        if r_bc.shape != (n, 3) or i_b.shape != (n,):
            raise ValueError(f"i_b and r_bc must have shapes {(n,)} and {(n, 3)}, got {i_b.shape} and {r_bc.shape}")
        if n:
            if i_b.min() < 0 or i_b.max() >= len(x_nc):
                raise ValueError("i_b holds indices outside x_nc")
            self._add("bond", x_nc, i_b, r_bc, stress_components(r_bc, G_b), thread)

    def site_sums(self) -> np.ndarray:
        """(g, n_site), points in the grid's order."""
        return self._sums("site", self.n_site)

    def bond_sums(self) -> np.ndarray:
        """(g, n_bond), points in the grid's order."""
        return self._sums("bond", self.n_bond)

    def _sums(self, what, n_comp):
        total = None
        for thread in range(self.threads):
            acc = self._buffers.get((what, thread))
            if acc is not None:
                total = acc.copy() if total is None else total.__iadd__(acc)
        return np.zeros((len(self.grid), n_comp)) if total is None else self._finish(total, n_comp)

    def _buffer(self, what, thread, shape):
        if not 0 <= thread < self.threads:
            raise ValueError(f"thread {thread} of a deposit made for {self.threads}")
        key = (what, thread)
        if key not in self._buffers:
            # Aligned to a cache line, which numpy does not promise.
            size = int(np.prod(shape))
            raw = np.zeros(size + 8)
            skip = -(raw.ctypes.data // 8) % 8
            self._buffers[key] = raw[skip : skip + size].reshape(shape)
        return self._buffers[key]

    def _count(self, thread, visits):
        if visits < 0:
            raise AtcError(_NOT_FINITE)
        self._visits[thread] += visits

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread):
        raise NotImplementedError

    def _finish(self, total, n_comp):
        raise NotImplementedError


class LatticeDeposit(Deposit):
    """On a regular grid, a plane or a line: rows of points cut to chords."""

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads):
        super().__init__(grid, kernel, cell, n_site, n_bond, threads)
        self.radii, self.coef = kernel.pieces
        self._core = _core(_lattice.lattice_bonds, kernel.compiled)
        n_axes = len(grid.counts)
        steps, counts, wrap = np.zeros((3, 3)), np.ones(3, np.int64), np.zeros(3, bool)
        steps[:n_axes], counts[:n_axes] = grid.steps, grid.counts
        # Axes the grid does not have: one point, steps normal to the others.
        for a in range(n_axes):
            if not steps[a].any():
                steps[a] = _normal_to(steps[[k for k in range(n_axes) if steps[k].any()]])
        for a in range(n_axes, 3):
            steps[a] = _normal_to(steps[:a]) * np.linalg.norm(steps[0])
        if grid.wraps:
            wrap[:] = self.cell.periodic
        # Rows along the axis on which a ball covers most points.
        reach = 2.0 * self.radii[0] / np.linalg.norm(steps, axis=1)
        points = np.where(wrap, reach, np.minimum(reach, counts))
        row = 2 if points[2] >= 0.99 * points.max() else int(points.argmax())
        self._order = [a for a in range(3) if a != row] + [row]
        self.steps, self.counts, self.wrap = (
            np.ascontiguousarray(steps[self._order]),
            counts[self._order],
            wrap[self._order],
        )
        self.inverse = np.linalg.inv(self.steps)
        self.reach = np.linalg.norm(self.inverse, axis=0)
        self._lattice = [as_tuple(a) for a in (grid.origin, self.steps, self.inverse, self.counts, self.wrap)]
        # Where the lattice does not close on itself, periodic images of a bond are bonds of their own: shifts along
        # these axes.
        self.image = np.flatnonzero(self.cell.periodic) if not grid.wraps else np.zeros(0, np.int64)
        corners = (
            np.stack(np.meshgrid(*[(0, n - 1) for n in self.counts], indexing="ij"), -1).reshape(-1, 3) @ self.steps
            + grid.origin
        )
        corners = corners @ self._inverse
        self.region = np.stack([corners.min(0), corners.max(0)])
        n, chord = int(self.counts[2]), 2.0 * self.radii[0] / np.linalg.norm(self.steps[2])
        # A run of four may stick out of an open row by three; on a periodic row whole chords may.
        # Odd, so that rows do not fight for the same lines of the cache.
        self.ext = (n + 3 if not self.wrap[2] else n + int(min(1.5 * chord, max(64, n))) + 4) | 1

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread):
        # In pieces that stay in the processor's cache.
        for s in range(0, len(i_b), PIECE):
            part = slice(s, s + PIECE)
            if not len(self.image):
                self._add_piece(what, x_nc, i_b[part], r_bc[part], b_bk[part], self._origin, thread)
                continue
            x_bc, r, b = x_nc[i_b[part]] - self._origin, r_bc[part], b_bk[part]
            if not (np.isfinite(x_bc).all() and np.isfinite(r).all()):
                raise AtcError(_NOT_FINITE)
            for index, shift_bc in self._images(x_bc, r):
                every = np.arange(len(index), dtype=np.int32)
                self._add_piece(what, x_bc[index] + shift_bc, every, r[index], b[index], np.zeros(3), thread)

    def _images(self, x_bc, r_bc):
        """(bonds, shifts) in pieces: every periodic image of a bond that can reach the lattice."""
        start = x_bc @ self._inverse
        end = start - r_bc @ self._inverse
        pad = self.radii[0] * np.linalg.norm(self._inverse, axis=0) + 1e-9
        lo, hi = np.zeros((2, len(x_bc), 3), np.int64)
        for a in self.image:
            lo[:, a] = np.ceil(self.region[0, a] - pad[a] - np.maximum(start, end)[:, a])
            hi[:, a] = np.floor(self.region[1, a] + pad[a] - np.minimum(start, end)[:, a])
        span = np.maximum(hi - lo + 1, 0)
        stop = np.cumsum(span.prod(1))
        for first in range(0, int(stop[-1]), PIECE):
            k = np.arange(first, min(first + PIECE, int(stop[-1])))
            index = np.searchsorted(stop, k, side="right")
            k -= stop[index] - span[index].prod(1)
            k, c2 = np.divmod(k, span[index, 2])
            c0, c1 = np.divmod(k, span[index, 1])
            yield index, (lo[index] + np.stack([c0, c1, c2], 1)) @ self._vectors

    def _add_piece(self, what, x_nc, i_b, r_bc, b_bk, origin, thread):
        """Bonds without images, x relative to `origin`."""
        n = len(i_b)
        map_bk, end_bk, base_ba = np.empty((n, 12)), np.empty((n, 4)), np.empty((n, 3), np.int64)
        length_b, frame_bcc = np.empty(n), np.empty((n, 3, 3))
        longest = _lattice.prepare(
            x_nc,
            i_b,
            r_bc,
            as_tuple(origin),
            *self._lattice,
            TINY * self.radii[0],
            map_bk,
            end_bk,
            base_ba,
            length_b,
            frame_bcc,
        )
        if longest < 0:
            raise AtcError(_NOT_FINITE)
        b_bk = _padded(b_bk)
        acc = self._buffer(what, thread, int(self.counts[0] * self.counts[1]) * self.ext * b_bk.shape[1])
        width = int((2.0 * self.radii[0] + longest) * self.reach[1]) + 12
        rows = width if self.wrap[1] else min(width, int(self.counts[1]) + 12)
        # Not a multiple of 4096 bytes, or the buffers of one row fight for the same lines of the cache.
        rows = 512 * (1 + rows // 512) + 8
        self._visits[thread] += self._core(
            map_bk, end_bk, base_ba, length_b, r_bc, frame_bcc, b_bk, self.radii, self.coef,
            as_tuple(self.reach), *self._lattice[3:], acc, self.ext, np.zeros((15, rows)), np.zeros(ROOM),
        )  # fmt: skip

    def _finish(self, total, n_comp):
        n0, n1, n = (int(k) for k in self.counts)
        a = total.reshape(n0 * n1, self.ext, -1).swapaxes(1, 2)[:, :n_comp]
        a = _folded(a, n, self.wrap[2]).reshape(n0, n1, n_comp, n)
        # Axes of `a` are the lattice's in row order, components third: back to the grid's order, components last.
        at = {axis: (0, 1, 3)[position] for position, axis in enumerate(self._order)}
        return np.ascontiguousarray(a.transpose(at[0], at[1], at[2], 2)).reshape(len(self.grid), n_comp)


def _padded(b_bk):
    """Components filled up with zeros to a multiple of four."""
    n, k = b_bk.shape
    if k % 4 == 0:
        return b_bk
    out = np.zeros((n, 4 * ceil(k / 4)))
    out[:, :k] = b_bk
    return out


def _folded(a, n, periodic):
    """The first n positions of the last axis; on a periodic row what lies beyond is added to them."""
    if periodic:
        for k in range(n, a.shape[-1], n):
            part = a[..., k : k + n]
            a[..., : part.shape[-1]] += part
    return a[..., :n]


def _normal_to(rows):
    """A unit vector normal to one or two vectors (any, for none)."""
    if len(rows) == 0:
        return np.array([1.0, 0.0, 0.0])
    if len(rows) == 1:
        e = np.eye(3)[np.abs(rows[0]).argmin()]
        n = e - (e @ rows[0]) / (rows[0] @ rows[0]) * rows[0]
    else:
        n = np.cross(rows[0], rows[1])
    return n / np.linalg.norm(n)


class PointsDeposit(Deposit):
    """At scattered points, in bins of the cell."""

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads):
        super().__init__(grid, kernel, cell, n_site, n_bond, threads)
        self.radii, self.coef = kernel.pieces
        self._core = _core(_points.sum_pairs, kernel.compiled)
        self._cartesian, self._series = kernel.compiled.cartesian, kernel.compiled.series(self.radii, self.coef)
        cell, p = self.cell, np.ascontiguousarray(grid.relative_points_gc)
        s = p @ cell.inverse
        images = np.where(cell.periodic, np.floor(s), 0.0)
        p, s = p - images @ cell.vectors, s - images
        bins, self._sorted, self.start = in_bins(cell, s, self.radii[0], 1024)
        self.points = np.ascontiguousarray(p[self._sorted])
        self._fullest = int(np.diff(self.start).max(initial=0))
        self._periodic = _array(cell.periodic, bool)
        self._geometry = tuple(
            as_tuple(a) for a in (self._origin, self._vectors, self._inverse, 1.0 / cell.heights, self._periodic)
        )
        self._bins = tuple(map(as_tuple, bins))
        self._room: dict = {}
        # Without `expect`: none of them, and nothing is left out by them.
        self._marked, self._mark_bins, self._length = np.ones((1, 1, 1), bool), (3 * (0.0,), 3 * (1.0,)), -1.0

    def expect(self, length: float) -> None:
        """Most bonds will not be longer than this: those that start where no point is in reach are passed over quickly,
        longer ones are looked at.

        A few points only: there is nothing to be gained with many.
        """
        cell, reach = self.cell, (self.radii[0] + length) * (1 + 1e-9)
        pad = reach / cell.heights
        s = self.points @ cell.inverse
        if not 0 < len(s) <= _FEW or length < 0 or (self._periodic & (pad > 1.0)).any():
            return
        low = np.where(self._periodic, 0.0, s.min(0) - 1.01 * pad)
        span = np.where(self._periodic, 1.0, s.max(0) + 1.01 * pad - low)
        bins = np.clip((span * cell.heights * _BINS_EACH / reach).astype(np.int64), 1, 128)
        edges = np.ascontiguousarray(cell.vectors * (span / bins)[:, None])
        half = 0.5 * max(np.linalg.norm(np.array(sign) @ edges) for sign in itertools.product((-1, 1), repeat=3))
        scale = bins / span
        self._marked, self._mark_bins, self._length = (
            np.zeros(bins, bool),
            (as_tuple(low), as_tuple(scale)),
            float(length),
        )
        far = (reach + half) * (1 + 1e-9)
        _points.mark((s - low) * scale, far / cell.heights * scale, far**2, edges, self._periodic, self._marked)

    def find(self, x_nc, i_b, r_bc, thread=0):
        """Which bonds have points within reach: pieces, each to be given to `add_found` before the next is asked for.
        Bond b starts at x_nc[i_b].

        Yields
        ------
        Found; a bond with many points may be in several
        """
        r_bc = _array(r_bc)
        for n, pairs in self._pairs(_array(x_nc), _array(i_b, np.int32), r_bc, thread):
            if n:
                bonds = np.empty(n, np.int64)
                bonds = bonds[: _points.renumber(n, pairs[1], bonds)]
                yield Found(bonds, n, pairs, r_bc[bonds])

    def add_found(self, found, b_bk, thread=0):
        """Add b β of what was found, b_bk (len(found), n_bond)."""
        b_bk = _array(b_bk)
        if b_bk.shape != (len(found), self.n_bond):
            raise ValueError(f"values of the bonds found must have shape {(len(found), self.n_bond)}, got {b_bk.shape}")
        self._sum("bond", found.n, found.pairs, found.r_bc, _padded(b_bk), thread)

    def _rooms(self, thread):
        if thread not in self._room:
            apart = max(POINTS, self._fullest + 8) | 8
            most = max(PAIRS, 2 * apart) | 8
            self._room[thread] = (
                np.empty((8, apart)),
                np.empty((3, most)),
                np.empty(most, np.int64),
                np.empty(most, np.int64),
            )
        return self._room[thread]

    def _pairs(self, x_nc, i_b, r_bc, thread):
        """(how many, arrays) of pairs, as many at a time as there is room for."""
        room, *pairs = self._rooms(thread)
        state = np.zeros(3, np.int64)
        while state[0] < len(r_bc):
            n = _points.find_pairs(
                state,
                x_nc,
                i_b,
                r_bc,
                float(self.radii[0]),
                self._cartesian,
                self._geometry,
                self.points,
                self.start,
                self._bins,
                self._marked,
                self._mark_bins,
                self._length,
                room,
                *pairs,
            )
            self._count(thread, n)
            yield n, pairs

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread):
        b_bk = _padded(b_bk)
        for n, pairs in self._pairs(x_nc, i_b, r_bc, thread):
            self._sum(what, n, pairs, r_bc, b_bk, thread)

    def _sum(self, what, n, pairs, r_bc, b_bk, thread):
        acc = self._buffer(what, thread, (len(self.points), b_bk.shape[1]))
        self._core(n, *pairs, r_bc, b_bk, self.radii, self.coef, self._series, acc, np.full(ROOM, -1.0))

    def _finish(self, total, n_comp):
        out = np.empty((len(total), n_comp))
        out[self._sorted] = total[:, :n_comp]
        return out


@dataclass
class Found:
    """Some of the bonds given to `PointsDeposit.find`, by their numbers there, and their pairs with points."""

    bonds: np.ndarray
    n: int
    pairs: list
    r_bc: np.ndarray

    def __len__(self):
        return len(self.bonds)


class SlabDeposit(Deposit):
    """Averages over the cell's cross-section, in closed form: Σ a φ₁(z − z_j)/area."""

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads):
        super().__init__(grid, kernel, cell, n_site, n_bond, threads)
        a = grid.axis
        self.height = self.cell.heights[a]
        self.normal = _array(self.cell.inverse[:, a] * self.height)
        marginal = profile_of(kernel, grid)
        self.radii, self.coef = marginal.pieces
        self._core = _core(_slab.slab_bonds, marginal.compiled)
        self.step = self.height / len(grid)
        self.area = self.cell.volume / self.height
        self.periodic = bool(self.cell.periodic[grid.axis])
        n, chord = len(grid), 2.0 * self.radii[0] / self.step
        self.ext = n + int(min(2.0 * chord, max(64, n))) + 4 if self.periodic else n + 3

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread):
        acc = self._buffer(what, thread, b_bk.shape[1] * self.ext)
        self._count(thread, self._core(
            x_nc, i_b, r_bc, b_bk, self._origin, self.normal, self.radii, self.coef,
            self.step, len(self.grid), self.periodic, acc, self.ext,
        ))  # fmt: skip

    def _finish(self, total, n_comp):
        a = _folded(total.reshape(n_comp, self.ext), len(self.grid), self.periodic)
        return np.ascontiguousarray(a.T) / self.area
