"""What the force kernels of all materials do with a row of bonds once its forces are known: deal them out, and see what
breaks.

No kernel may reorder or fuse its arithmetic (that gains nothing here): where a bond stands in a vector, and how wide
vectors are, changes no bit.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
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
def open_block(f):
    """Nothing yet: no force, no smallest stretch."""
    f[:, :3] = 0.0
    f[:, 3] = np.inf


@njit(**INLINE)
def settle(m, b0, i, base, j, node, w, f, own, intact, kind, s00, alpha, smin, s_low, damage, first, gone_b, gone):
    """Forces (columns 0-2 of w) of m bonds of row i into f and `own`. With `damage`, bonds beyond their critical
    stretch break after they have pulled: they are listed in gone_b from the block's first bond on, `gone` so far.
    Column 6: stretches, +∞ if broken; 7: −∞ if broken."""
    deal(m, base, node, w, f, own)
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
def close_row(f, own):
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
