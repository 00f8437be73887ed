"""Torsions that tell a chain from its mirror image, and pairs of torsions with a map (CMAP): forces across bonds.

Such an energy is no smooth function of distances: as forces along the distances of its atoms it would need ones without
limit where four of them lie in a plane. As learned energies of atoms it has bonds whose forces do not act along them.
With shares w_p of the energy and g_p = ∂U/∂x_p, the bond of atoms p and q of the term has

    D_0 = w_p g_q,   D_1 = w_q g_p,   F_pq = D_0 − D_1,   Σ_q F_pq = −g_p.

Momentum and energy are balanced at every point; the virial is the term's own and symmetric, since its torques cancel;
the stress at a point inside the molecule is not symmetric.
"""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...errors import AtcError
from ..base import Accumulator, Work
from .cluster import TERMS_PER_TASK, ClusterTerm, ClusterWork


def torsion_angle(x_mkc, k=(0, 1, 2, 3)):
    """φ (m,), −π < φ ≤ π, trans = π, of four of a term's atoms, and ∂φ/∂x of these, (m, 4, 3) (Blondel & Karplus,
    J. Comput. Chem. 17 (1996) 1132)."""
    F, G, H = x_mkc[:, k[0]] - x_mkc[:, k[1]], x_mkc[:, k[1]] - x_mkc[:, k[2]], x_mkc[:, k[3]] - x_mkc[:, k[2]]
    A, B = np.cross(F, G), np.cross(H, G)
    g = np.sqrt((G * G).sum(1))
    a2, b2 = (A * A).sum(1), (B * B).sum(1)
    phi = np.arctan2((np.cross(B, A) * G).sum(1) / g, (A * B).sum(1))
    dF, dH = -(g / a2)[:, None] * A, (g / b2)[:, None] * B
    dG = ((F * G).sum(1) / (a2 * g))[:, None] * A - ((H * G).sum(1) / (b2 * g))[:, None] * B
    return phi, np.stack([dF, dG - dF, -dG - dH, dH], axis=1)


class AcrossTerm(ClusterTerm):
    """Listed terms of K atoms, a fraction 1/K of the energy each atom's; subclasses give energy and gradients.

    `terms_of(frame)` : (m, K) atoms, (m,) types
    """

    central, edges = False, True
    name = ""

    @property
    def weights(self):
        return np.full(self.bodies, 1.0 / self.bodies)

    def describe(self) -> str:
        return (
            f"{self.name}, energy shared 1/{self.bodies} to each atom, by forces across bonds: the stress is symmetric "
            "over a molecule, not within it"
        )

    def gradients(self, x_mkc, types):
        """U (m,) and ∂U/∂x (m, K, 3)."""
        raise NotImplementedError

    def prepare(self, frame) -> Work:
        return _AcrossWork(self, frame)


class _AcrossWork(ClusterWork):
    def run(self, stage, task, acc: Accumulator):
        part = slice(task * TERMS_PER_TASK, (task + 1) * TERMS_PER_TASK)
        atoms, types = self.atoms[part], self.types[part]
        x = self.positions(atoms)
        with np.errstate(all="ignore"):
            U, g = self.term.gradients(x, types)
        bad = ~(np.isfinite(U) & np.isfinite(g).all(axis=(1, 2)))
        if bad.any():
            names = ", ".join(str(i) for i in self.frame.ids[atoms[int(np.argmax(bad))]])
            raise AtcError(
                f"{self.frame.source}: {self.term.name} of the atoms {names} has no finite energy and forces: three of "
                "them are in a line"
            )
        k = self.term.bodies
        acc.energy += float(U.sum())
        if acc.energies is not None:
            np.add.at(acc.energies, atoms.ravel(), np.repeat(U / k, k))
        p, q = np.triu_indices(k, 1)
        D = np.stack([g[:, q], g[:, p]], axis=2).reshape(-1, 2, 3) / k
        i, j = (np.ascontiguousarray(atoms[:, side].ravel(), dtype=np.int32) for side in (p, q))
        r = (x[:, p] - x[:, q]).reshape(-1, 3)
        return Bonds(i, j, r, np.zeros(len(i)), D if acc.sources else None, F_bc=D[:, 0] - D[:, 1])


class AcrossTorsion(AcrossTerm):
    """U(φ) of four atoms in a chain, −π < φ ≤ π.

    law : function (φ, types) → U, dU/dφ, internal
    """

    bodies = 4

    def __init__(self, law, name: str):
        self.law, self.name = law, name

    def gradients(self, x_mkc, types):
        phi, slope = torsion_angle(x_mkc)
        U, dU = self.law(phi, types)
        return U, dU[:, None, None] * slope


class CosineLaw:
    """k [1 + cos(nφ − φ0)]; rows (types + 1, 3) of k, n, φ0."""

    def __init__(self, rows):
        self.rows = np.asarray(rows, float)

    def __call__(self, phi, types):
        k, n, phase = self.rows[types].T
        return k * (1.0 + np.cos(n * phi - phase)), -k * n * np.sin(n * phi - phase)


class CorrectionMaps(AcrossTerm):
    """U(φ, ψ) of two successive torsions of five atoms, by periodic bicubic splines of maps.

    maps : [(n, n) energies], φ along the first axis, both from `start` in steps of 2π/n
    """

    bodies = 5
    name = "correction map (CMAP)"

    def __init__(self, maps, start: float = 0.0):
        from scipy.interpolate import CubicSpline

        self.start, self.tables = start, []
        for E in maps:
            E = np.asarray(E, float)
            n = len(E)
            closed = np.arange(n + 1) * (2.0 * np.pi / n)

            def slope(a, axis, closed=closed):
                a = np.concatenate([a, np.take(a, [0], axis)], axis)
                return np.take(CubicSpline(closed, a, axis=axis, bc_type="periodic")(closed, 1), range(n), axis)  # noqa: B023

            d1 = slope(E, 0)
            self.tables.append(np.stack([E, d1, slope(E, 1), slope(d1, 1)]))

    def gradients(self, x_mkc, types):
        phi, d_phi = torsion_angle(x_mkc)
        psi, d_psi = torsion_angle(x_mkc, (1, 2, 3, 4))
        U, U_phi, U_psi = self.energies(phi, psi, types)
        g = np.zeros_like(x_mkc)
        g[:, :4] += U_phi[:, None, None] * d_phi
        g[:, 1:] += U_psi[:, None, None] * d_psi
        return U, g

    def energies(self, phi, psi, types):
        """U, ∂U/∂φ, ∂U/∂ψ."""
        out = np.empty((3, len(phi)))
        for t in np.unique(types):
            mine, table = np.flatnonzero(types == t), self.tables[t - 1]
            n = table.shape[1]
            h = 2.0 * np.pi / n
            s, u = ((a[mine] - self.start) / h for a in (phi, psi))
            i, j = np.floor(s).astype(int), np.floor(u).astype(int)
            (a, da), (b, db) = _hermite(s - i, h), _hermite(u - j, h)
            total = np.zeros((3, len(mine)))
            for ei in (0, 1):
                for ej in (0, 1):
                    corner = table[:, (i + ei) % n, (j + ej) % n]
                    for x in (0, 1):  # value or slope along φ
                        for y in (0, 1):
                            c = corner[x + 2 * y]
                            total[0] += c * a[ei][x] * b[ej][y]
                            total[1] += c * da[ei][x] * b[ej][y]
                            total[2] += c * a[ei][x] * db[ej][y]
            out[:, mine] = total
        return out


def _hermite(t, h):
    """Basis [[value, slope] at 0, the same at 1] on a step h, and its derivative."""
    basis = (
        ((1 + 2 * t) * (1 - t) ** 2, h * t * (1 - t) ** 2),
        (t * t * (3 - 2 * t), h * t * t * (t - 1)),
    )
    slope = (
        (6 * t * (t - 1) / h, (1 - t) * (1 - 3 * t)),
        (6 * t * (1 - t) / h, t * (3 * t - 2)),
    )
    return basis, slope
