"""How bond sums are shared out: blocks of rows, each with a buffer of its own for the nodes it touches.

The blocks depend on the body alone and their buffers are added in a fixed order, so results do not depend on the number
of threads.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np

from ..compiled import njit
from .bonds import JIT, Families

# Enough work a block to hide its overhead; a window of a few thousand nodes still fits into the second-level cache.
_BONDS_PER_BLOCK = 1 << 17
_NODES_PER_CHUNK = 1 << 14


def node_rows(n: int) -> np.ndarray:
    """(n, 8) zeros, one cache line a node: displacement, reference position, and two columns for what a material passes
    between its sums."""
    return _on_lines(n, 8)


def _on_lines(n, width):
    """(n, width) zeros that start on a cache line."""
    raw = np.zeros(width * n + 8)
    shift = (-raw.ctypes.data // 8) % 8
    return raw[shift : shift + width * n].reshape(n, width)


class Blocks:
    """Blocks of rows of a half bond table and the window [lo, hi) of nodes that each one touches."""

    def __init__(self, bonds: Families, n: int):
        start = bonds.start_n
        count = max(1, min(256, len(bonds) // _BONDS_PER_BLOCK))
        while True:
            targets = np.linspace(0, len(bonds), count + 1)
            edges = np.unique(np.searchsorted(start, targets, side="left").clip(0, n))
            edges[0], edges[-1] = 0, n
            self.edges = edges.astype(np.int64)
            self.lo, self.hi = _windows(start, bonds.j_b, self.edges)
            sizes = self.hi - self.lo
            # Nodes in no spatial order: every window is nearly the whole body. Fewer blocks then, so that buffers stay
            # small.
            if count <= 2 or sizes.sum() <= max(4 * n, 1 << 16):
                break
            count = max(2, count // 2)
        self.offset = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        self.count = len(self.edges) - 1

    def buffer(self, width: int) -> np.ndarray:
        return _on_lines(int(self.offset[-1]), width)


class Crew:
    """Runs kernels over ranges, serially or on a few threads. `threads` = 0 is all cores."""

    def __init__(self, threads: int = 0):
        import os

        self.threads = threads or os.cpu_count() or 1
        self._pool = None

    def run(self, kernel, total: int, *args, grain: int = 1):
        """Call kernel(a, b, *args) on ranges that together are [0, total); return the results in the order of the
        ranges."""
        groups = min(4 * self.threads, total // grain) if self.threads > 1 else 1
        if groups <= 1:
            return [kernel(0, total, *args)]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads)
        edges = [total * g // groups for g in range(groups + 1)]
        futures = [self._pool.submit(kernel, a, b, *args) for a, b in pairwise(edges)]
        return [f.result() for f in futures]

    def nodes(self, kernel, n: int, *args):
        return self.run(kernel, n, *args, grain=_NODES_PER_CHUNK)


@njit(**JIT)
def _windows(start, j, edges):
    nb = len(edges) - 1
    lo = np.empty(nb, np.int64)
    hi = np.empty(nb, np.int64)
    for b in range(nb):
        lo[b] = edges[b]
        top = edges[b + 1]
        for k in range(start[edges[b]], start[edges[b + 1]]):
            if j[k] + 1 > top:
                top = j[k] + 1
        hi[b] = top
    return lo, hi


@njit(**JIT)
def collect(a, b, lo, hi, offset, buf, F, smin, with_smin):
    """F[n] = Σ over blocks of their buffers, in the order of the blocks; smin[n] = the smallest of the column behind
    F's.

    Returns the largest finite smin.
    """
    largest = -np.inf
    width = F.shape[1]
    F[a:b] = 0.0
    if with_smin:
        smin[a:b] = np.inf
    for k in range(len(lo)):
        first = max(a, lo[k])
        last = min(b, hi[k])
        shift = offset[k] - lo[k]
        for n in range(first, last):
            for c in range(width):
                F[n, c] += buf[n + shift, c]
        if with_smin:
            for n in range(first, last):
                if buf[n + shift, width] < smin[n]:
                    smin[n] = buf[n + shift, width]
    if with_smin:
        for n in range(a, b):
            if smin[n] < np.inf and smin[n] > largest:
                largest = smin[n]
    return largest
