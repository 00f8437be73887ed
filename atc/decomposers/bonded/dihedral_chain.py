"""The internal coordinates of four atoms in a chain, each with its derivatives by the six squared distances: torsions
that depend on more than cos φ.

Any U(d12, d23, d34, cos θ1, cos θ2, cos φ) is a function of distances; G of a pair is Σ_q ∂U/∂q ∂q/∂ξ over these six
coordinates (formulas §2). θ1 is the angle at atom 2, θ2 the one at atom 3. Where three atoms are in a line cos φ is
continued as in `atc.decomposers.bonded.dihedral`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ..base import Accumulator
from .cluster import first_not_finite
from .dihedral import FourAtoms, cosine_and_slopes

#: LAMMPS's SMALL: the least sine that is divided by
SMALL = 0.001


@dataclass
class Chain:
    """d (3, m): lengths 12, 23, 34. cos1, sin1, cos2, sin2, cos, sin (m,): of θ1, θ2, φ (sin φ ≥ 0). slopes (m, 6, 6):
    ∂q/∂ξ of the coordinates d12, d23, d34, cos θ1, cos θ2, cos φ by the pairs 12 13 14 23 24 34. near (m,): how many of
    the two angles are in a line."""

    d: np.ndarray
    cos1: np.ndarray
    sin1: np.ndarray
    cos2: np.ndarray
    sin2: np.ndarray
    cos: np.ndarray
    sin: np.ndarray
    slopes: np.ndarray
    near: np.ndarray

    @classmethod
    def of(cls, x_tkc) -> Chain:
        m = len(x_tkc)
        q, slopes, near = np.empty((9, m)), np.zeros((m, 6, 6)), np.empty(m, np.int64)
        _chain(np.ascontiguousarray(x_tkc), q, slopes, near)
        return cls(q[:3], *q[3:], slopes, near)

    def multiples(self):
        """cos nφ for n = 1, 2, 3, and their derivatives by cos φ."""
        c = self.cos
        return (c, 2.0 * c * c - 1.0, (4.0 * c * c - 3.0) * c), (1.0, 4.0 * c, 12.0 * c * c - 3.0)

    def angles(self):
        """θ1, θ2, and −1/sin of each (dθ/dcos θ), sines clamped at 0.001."""
        t1, t2 = np.arctan2(self.sin1, self.cos1), np.arctan2(self.sin2, self.cos2)
        return t1, t2, -1.0 / np.maximum(self.sin1, SMALL), -1.0 / np.maximum(self.sin2, SMALL)


class CoupledTorsion(FourAtoms):
    """Base of torsions of all coordinates of the chain. Subclasses implement `curve`. See `FourAtoms` for the
    parameters."""

    kind = "dihedral"

    def curve(self, chain: Chain, types):
        """U (m,) and ∂U/∂q (m, 6) in the order of `Chain.slopes`."""
        raise NotImplementedError

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        chain = Chain.of(x_tkc)
        u, partial = self.curve(chain, types)
        U[:] = u
        G[:] = np.einsum("tq,tqe->te", partial, chain.slopes)
        acc.note(f"{self.kind}s with three atoms in a line, where cos phi was continued to 0", int(chain.near.sum()))
        return first_not_finite(U, G)


@njit(cache=True, nogil=True, error_model="numpy")
def _angle(x, b, a, c):
    """cos and sin of the angle at atom a between b and c, and ∂cos/∂ξ of ab, ac, bc."""
    bx, by, bz = x[b, 0] - x[a, 0], x[b, 1] - x[a, 1], x[b, 2] - x[a, 2]
    cx, cy, cz = x[c, 0] - x[a, 0], x[c, 1] - x[a, 1], x[c, 2] - x[a, 2]
    bb, cc = bx * bx + by * by + bz * bz, cx * cx + cy * cy + cz * cz
    v = 1.0 / np.sqrt(bb * cc)
    u, w, z = by * cz - bz * cy, bz * cx - bx * cz, bx * cy - by * cx
    cos = min(1.0, max(-1.0, (bx * cx + by * cy + bz * cz) * v))
    return cos, np.sqrt(u * u + w * w + z * z) * v, v - cos / bb, v - cos / cc, -v


@njit(cache=True, nogil=True, error_model="numpy")
def _chain(x, q, slopes, near):
    # Pairs 12 13 14 23 24 34 are 0 .. 5.
    for t in range(len(x)):
        for k, e in ((0, 0), (1, 3), (2, 5)):
            d2 = 0.0
            for c in range(3):
                d2 += (x[t, k + 1, c] - x[t, k, c]) ** 2
            q[k, t] = np.sqrt(d2)
            slopes[t, k, e] = 1.0 / q[k, t]
        q[3, t], q[4, t], slopes[t, 3, 0], slopes[t, 3, 3], slopes[t, 3, 1] = _angle(x[t], 0, 1, 2)
        q[5, t], q[6, t], slopes[t, 4, 3], slopes[t, 4, 5], slopes[t, 4, 4] = _angle(x[t], 1, 2, 3)
        cos, q[8, t], near[t] = cosine_and_slopes(x[t], slopes[t, 5])
        q[7, t] = min(1.0, max(-1.0, cos))
