"""The loop over bonds in which the force law of a material is compiled: gather a row, let the law say what its bonds
pull, deal that out, see what breaks.

No kernel may reorder or fuse its arithmetic (that gains nothing here): where a bond stands in a vector, and how wide
vectors are, changes no bit.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ...compiled import njit, specialise, tag_of
from ..bonds import JIT
from ..lanes import INLINE, C, deal


@njit(**INLINE, fastmath={"nnan", "nsz"})
def _largest(m, w):
    """Largest of column 7: the stretches of intact bonds."""
    high = -np.inf
    for k in range(m):
        high = max(high, w[7 * C + k])
    return high


@njit(**INLINE)
def _break(m, b0, i, j, w, intact, kind, rule, first, gone_b, gone):
    """Of m bonds of row i those beyond their critical stretch break: they are listed in gone_b from the block's first
    bond on, `gone` so far. Column 6 of w: stretches, +∞ if broken; 7: −∞ if broken."""
    s00, alpha, smin, s_low, damage = rule
    if damage and _largest(m, w) > s_low:
        for k in range(m):
            b = b0 + k
            if w[7 * C + k] > s_low and intact[b] == 1:
                t = kind[b] if len(kind) else 0
                if w[7 * C + k] > threshold(s00[t], alpha[t], smin[i], smin[j[b]]):
                    intact[b] = 0
                    gone_b[first + gone] = b - first
                    gone += 1
    return gone


@njit(**INLINE)
def _close_row(f, own):
    """The row's own node: the sum of its forces, and its smallest stretch; `own` is empty again."""
    for c in range(3):
        f[c] += own[c]
        own[c] = 0.0
    if own[3] < f[3]:
        f[3] = own[3]
    own[3] = np.inf


@njit(**JIT)
def threshold(s00, alpha, smin_i, smin_j):
    """min(s0_i, s0_j) with s0 = s00 − α·(the node's smallest stretch); infinite while a node has none yet (R 3.0.9)."""
    si = np.inf if smin_i == -np.inf else s00 - alpha * smin_i
    sj = np.inf if smin_j == -np.inf else s00 - alpha * smin_j
    return si if si < sj else sj


@njit(**INLINE)
def lengthened(k, w, L):
    """|ξ+η|² − |ξ|² of the bond in columns 0-5 of w, without the digits that the difference of squares would lose; and
    |ξ+η|, L = |ξ|."""
    ex = w[k]
    ey = w[C + k]
    ez = w[2 * C + k]
    x = w[3 * C + k]
    y = w[4 * C + k]
    z = w[5 * C + k]
    q = ex * (x + x + ex) + ey * (y + y + ey) + ez * (z + z + ez)
    r2 = L * L + q
    return q, np.sqrt(r2 if r2 > 0.0 else 0.0)


@njit(**INLINE)
def note(k, w, s, whole):
    """The stretch of a bond where the loop looks for it."""
    w[6 * C + k] = s if whole else np.inf
    w[7 * C + k] = s if whole else -np.inf


@njit(**INLINE)
def eights(m, b0, intact):
    """How many bonds a law does at once if it likes whole vectors of eight: those beyond the row's m have no extent,
    and pull nothing."""
    return min((m + 7) & ~7, len(intact) - b0)


# Replaced in each copy of the loop, see `force_loop`.
GATHER = LAW = None


def _forces(first, last, blocks, rows, images, z, data, rule, buf, gone_b, gone_k):
    """Blocks first..last: forces and smallest stretches into their buffers. With `damage` bonds break after they have
    pulled: they are listed in gone_b, block by block from the block's first bond on, gone_k of them.

    blocks : edges, lo, offset. rows : of a `Standing`: start, j, image, intact, kind. rule : s00, alpha, the nodes'
    smallest stretches, what no bond breaks below, damage
    """
    edges, lo, offset = blocks
    start, j, image, intact, kind = rows
    w = np.empty(8 * C)
    v = np.empty(10 * C)
    node = np.empty(C + 8, np.int32)
    own = np.array([0.0, 0.0, 0.0, np.inf])
    for block in range(first, last):
        f = buf[offset[block] : offset[block + 1]]
        f[:, :3] = 0.0
        f[:, 3] = np.inf
        base = lo[block]
        b_first = start[edges[block]]
        gone = 0
        for i in range(edges[block], edges[block + 1]):
            for b0 in range(start[i], start[i + 1], C):
                m = min(C, start[i + 1] - b0)
                GATHER(b0, m, i, j, image, images, z, node, w)
                LAW(m, b0, i, node, w, v, intact, data)
                deal(m, base, node, w, f, own)
                gone = _break(m, b0, i, j, w, intact, kind, rule, b_first, gone_b, gone)
            _close_row(f[i - base], own)
        gone_k[block] = gone


@cache
def force_loop(gather, law):
    """`_forces` with a material's law in it.

    gather : what it needs of the nodes, `lanes.gather` (displacements, reference vectors) or `lanes.gather_positions`
    law : compiled function (m, b0, i, node, w, v, intact, data), ``njit(**lanes.INLINE)``, of the m bonds of row i from
        bond b0 on. It finds what was gathered in
        columns 0-5 of w and leaves forces on i in columns 0-2, stretches in column 6 (+∞ if broken) and 7 (−∞ if
        broken); v is ten columns of its own. `data` is the tuple that the model hands over, node the bonds' other ends.
    """
    return specialise(_forces, tag_of(law, gather), JIT, GATHER=gather, LAW=law)
