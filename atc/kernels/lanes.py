"""β in fours where a family knows it at one point only, and the room that compiled functions share.

`Compiled.constants` fills an array of `ROOM` numbers whose address β gets; from `SCRATCH` on they are free for what is
done one point at a time.
"""

from __future__ import annotations

from ..compiled import njit
from ..simd import JIT_FMA, load4, peek, peek_int, poke, store4

SCRATCH, ROOM = 64, 128
# Where the functions on pairs, which have no constants, keep the numbers of four: the first four are the loop's.
LANES = 4


@njit(**JIT_FMA)
def cartesian_constants(length, R, c_mk, piece, r_bc, frame_bcc, b, k):
    """r, |r|, the bond's frame, and the coefficients from 13 on."""
    k[3] = length
    # One frame a bond, or a buffer with the frame of this bond.
    f = min(b, len(frame_bcc) - 1)
    for a in range(3):
        k[a] = r_bc[b, a]
        for c in range(3):
            k[4 + 3 * a + c] = frame_bcc[f, a, c]
    for j in range(c_mk.shape[1]):
        k[13 + j] = c_mk[piece, j]


@njit(**JIT_FMA)
def cartesian(D, Y, M, k):
    """d = x_i − x of four points along x, y and z, from the bond's frame."""
    D = D * peek(k, 3)
    Y = Y * peek(k, 3)
    M = M * peek(k, 3)
    return (
        D * peek(k, 4) + Y * peek(k, 7) + M * peek(k, 10),
        D * peek(k, 5) + Y * peek(k, 8) + M * peek(k, 11),
        D * peek(k, 6) + Y * peek(k, 9) + M * peek(k, 12),
    )


@njit(**JIT_FMA)
def bond_vectors(bond_at, r_at, k):
    """r of the bonds of four pairs along x, y and z."""
    for l in range(4):
        b = 3 * peek_int(bond_at, l)
        for c in range(3):
            poke(k, LANES + 12 + 4 * c + l, peek(r_at, b + c))
    return load4(k, LANES + 12), load4(k, LANES + 16), load4(k, LANES + 20)


# Replaced in each copy (see `base.Compiled.pointwise`).
MEAN = None


def point_by_point(D, Y, M, k):
    """β of a family that is computed one point at a time, at four points."""
    d0, d1, d2 = cartesian(D, Y, M, k)
    store4(k, SCRATCH, d0)
    store4(k, SCRATCH + 4, d1)
    store4(k, SCRATCH + 8, d2)
    for l in range(4):
        d0, d1, d2 = peek(k, SCRATCH + l), peek(k, SCRATCH + 4 + l), peek(k, SCRATCH + 8 + l)
        poke(
            k,
            SCRATCH + 12 + l,
            MEAN(d0, d1, d2, peek(k, 0), peek(k, 1), peek(k, 2), k + 8 * 13, k + 8 * (SCRATCH + 16)),
        )
    return load4(k, SCRATCH + 12)


def pair_by_pair(x, y, z, R2, c_at, series_at, bond_at, r_at, k):
    """β of such a family for four pairs of a bond and a point."""
    store4(k, LANES, x)
    store4(k, LANES + 4, y)
    store4(k, LANES + 8, z)
    bond_vectors(bond_at, r_at, k)
    for l in range(4):
        d0, d1, d2 = peek(k, LANES + l), peek(k, LANES + 4 + l), peek(k, LANES + 8 + l)
        r0, r1, r2 = peek(k, LANES + 12 + l), peek(k, LANES + 16 + l), peek(k, LANES + 20 + l)
        poke(k, l, MEAN(d0, d1, d2, r0, r1, r2, c_at, k + 8 * 32))
    return load4(k, 0)
