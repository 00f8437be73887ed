"""A pyramid of an apex and three other atoms, by its invariants: what the out-of-plane impropers are functions of.

With arms a, b, c from the apex, every dot product is linear in ξ = d²/2 of the six pairs: a·a = 2ξ_a, a·b = ξ_a + ξ_b −
ξ_ab. The volume V = a·(b×c) has a sign, which a mirror turns; V² = det of the dot products has none and is a function
of distances. So is every even function of V: sin² ω = V²/(|a×b|² c²) of the angle ω between arm c and the plane of a
and b, and h² = V²/|(b−a)×(c−a)|² of the apex's height.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base import Accumulator
from .cluster import first_not_finite
from .dihedral import FourAtoms

_PAIRS = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)]
# The arms of the planes opposite to arm 0, 1, 2, and the same for pairs of arms 01, 02, 12.
_OTHERS = ((1, 2), (0, 2), (0, 1))


@dataclass
class Pyramid:
    """Arrays of m pyramids; ``*_e`` are derivatives by ξ of the pairs 12 13 14 23 24 34 of the atoms as they are
    listed.

    V2 (m,), V2_e (m, 6): the volume squared. sin2 (3, m), sin2_e (3, m, 6): of the angles ω between each arm and the
    plane of the other two. scale (3, m): sin ω/|V|. cos (3, m), cos_e (3, m, 6): of the angles at the apex between arms
    01, 02, 12. height2 (m,), height2_e (m, 6): the square of the apex's distance from the plane of the other three.
    """

    V2: np.ndarray
    V2_e: np.ndarray
    sin2: np.ndarray
    sin2_e: np.ndarray
    scale: np.ndarray
    cos: np.ndarray
    cos_e: np.ndarray
    height2: np.ndarray
    height2_e: np.ndarray

    @classmethod
    def of(cls, x_tkc, apex: int) -> Pyramid:
        """apex : which of the four atoms, from 0; the others are the arms in their order."""
        base = [k for k in range(4) if k != apex]
        arms = [x_tkc[:, k] - x_tkc[:, apex] for k in base]
        # Where ξ of apex–arm 0, 1, 2 and of arms 01, 02, 12 are in the list of pairs.
        at = [_PAIRS.index((min(apex, k), max(apex, k))) for k in base] + [
            _PAIRS.index((base[i], base[j])) for i, j in ((0, 1), (0, 2), (1, 2))
        ]

        def by_distances(A, p):
            """∂/∂ξ from ∂/∂(a·a, b·b, c·c) and ∂/∂(a·b, a·c, b·c)."""
            out = np.empty((len(x_tkc), 6))
            for k, pair in enumerate(((0, 1), (0, 2), (1, 2))):
                out[:, at[k]] = 2.0 * A[k] + p[pair[0]] + p[pair[1]]
                out[:, at[3 + k]] = -p[k]
            return out

        def dot(u, v):
            return np.einsum("tc,tc->t", u, v)

        zero = np.zeros(len(x_tkc))
        square = [dot(a, a) for a in arms]
        p = [dot(arms[i], arms[j]) for i, j in ((0, 1), (0, 2), (1, 2))]
        # From the vectors: as differences of products of dot products they would lose digits near planar.
        cross = [np.cross(arms[i], arms[j]) for i, j in ((1, 2), (2, 0), (0, 1))]
        area = [dot(n, n) for n in cross]
        V2 = dot(arms[0], cross[0]) ** 2
        V2_e = by_distances(area, [2.0 * dot(cross[i], cross[j]) for i, j in ((0, 1), (0, 2), (1, 2))])
        sin2, sin2_e, scale = [], [], []
        for k, (i, j) in enumerate(_OTHERS):
            D = area[k] * square[k]
            by_square, by_dot = [zero] * 3, [zero] * 3
            # area of i, j: square_i square_j − p²; pair (i, j) has the number i + j − 1.
            by_square[i], by_square[j], by_dot[i + j - 1] = (
                square[j] / area[k],
                square[i] / area[k],
                -2.0 * p[i + j - 1] / area[k],
            )
            by_square[k] = 1.0 / square[k]
            s2 = np.minimum(V2 / D, 1.0)
            sin2.append(s2)
            sin2_e.append(V2_e / D[:, None] - s2[:, None] * by_distances(by_square, by_dot))
            scale.append(1.0 / np.sqrt(D))
        cos, cos_e = [], []
        for k, (i, j) in enumerate(((0, 1), (0, 2), (1, 2))):
            v = 1.0 / np.sqrt(square[i] * square[j])
            c = np.clip(p[k] * v, -1.0, 1.0)
            by_square, by_dot = [zero] * 3, [zero] * 3
            by_square[i], by_square[j], by_dot[k] = -0.5 * c / square[i], -0.5 * c / square[j], v
            cos.append(c)
            cos_e.append(by_distances(by_square, by_dot))
        u, w = arms[1] - arms[0], arms[2] - arms[0]
        n = np.cross(u, w)
        M, t = dot(n, n), dot(u, w)
        height2 = V2 / M
        M_e = np.zeros((len(x_tkc), 6))
        M_e[:, at[3]], M_e[:, at[4]], M_e[:, at[5]] = 2.0 * (dot(w, w) - t), 2.0 * (dot(u, u) - t), 2.0 * t
        height2_e = (V2_e - height2[:, None] * M_e) / M[:, None]
        return cls(
            V2,
            V2_e,
            np.array(sin2),
            np.array(sin2_e),
            np.array(scale),
            np.array(cos),
            np.array(cos_e),
            height2,
            height2_e,
        )


class PyramidImproper(FourAtoms):
    """Base of impropers of a pyramid. Subclasses implement `curve`. See `FourAtoms` for the parameters."""

    kind = "improper"
    #: which atom of the list is the apex, from 0
    apex = 0

    def curve(self, p: Pyramid, types, acc: Accumulator):
        """U (m,) and ∂U/∂ξ (m, 6)."""
        raise NotImplementedError

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        with np.errstate(divide="ignore", invalid="ignore"):
            U[:], G[:] = self.curve(Pyramid.of(x_tkc, self.apex), types, acc)
        return first_not_finite(U, G)


def asin_over_sine(sin2):
    """ω/sin ω of sin² ω, 1 at 0."""
    s = np.sqrt(sin2)
    return np.where(s > 1e-8, np.arcsin(s) / np.maximum(s, 1e-8), 1.0)
