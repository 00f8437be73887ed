"""The two sums averaged over planes: in one dimension, with the kernel integrated over the plane
(`kernels.Profile`)."""

from __future__ import annotations

from math import ceil, floor, isfinite

import numpy as np

from ..kernels.lanes import ROOM
from ..simd import address, axpy4, ramp4

# Replaced in each specialised copy (see `compiled.specialise`).
MEAN = None
CONSTANTS = None


def slab_bonds(x_nc, i_b, r_bc, b_bk, origin_c, normal_c, radii_m, coef_mk, step, n, periodic, acc, ext):
    """Σ_b b β₁ in n bins whose centres are at (k + ½) step from the cell's lower face. Returns the number of visits, −1
    if something is not finite.

    `acc` is flat, components × ext; positions beyond n are folded back, or dropped, at the end (as in `_lattice`).
    """
    n_comp = b_bk.shape[1]
    R = radii_m[0]
    k_ = np.zeros(ROOM)
    acc_at, k_at = address(acc), address(k_)
    visits = 0
    for b in range(len(r_bc)):
        o = i_b[b]
        r = r_bc[b, 0] * normal_c[0] + r_bc[b, 1] * normal_c[1] + r_bc[b, 2] * normal_c[2]
        z = (
            (x_nc[o, 0] - origin_c[0]) * normal_c[0]
            + (x_nc[o, 1] - origin_c[1]) * normal_c[1]
            + (x_nc[o, 2] - origin_c[2]) * normal_c[2]
        )
        if not isfinite(r + z):
            return -1
        f = z / step - 0.5
        base = floor(f + 0.5)
        # From the nearest bin centre.
        d = (f - base) * step
        lo = ceil((min(d, d - r) - R) / step - 1e-9)
        hi = floor((max(d, d - r) + R) / step + 1e-9)
        if not periodic:
            lo = max(lo, -base)
            hi = min(hi, n - 1 - base)
        left = hi - lo + 1
        if left <= 0:
            continue
        visits += left
        CONSTANTS(r, radii_m, coef_mk, k_)
        at = base + lo
        k = lo
        while left > 0:
            if periodic:
                at %= n
            runs = min((left + 3) >> 2, (ext - at) >> 2)
            for _ in range(runs):
                mean = MEAN(ramp4(d - k * step, -step), r, radii_m, coef_mk, k_at)
                for c in range(n_comp):
                    axpy4(acc_at, c * ext + at, b_bk[b, c], mean)
                at += 4
                k += 4
            left -= 4 * runs
    return visits
