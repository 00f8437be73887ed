"""Non-ordinary correspondence material (Silling et al. 2007), Saint Venant-Kirchhoff, with its zero-energy modes
stabilised (Silling 2017).

From the bonds a node sees a deformation gradient F = (Σ ω y⊗ξ νV) K⁻¹, K = Σ ω ξ⊗ξ νV, and hence a classical stress: P
= F S, S = λ tr(E) + 2μE, E = (FᵀF − 1)/2. Modes that F does not see cost the energy ½ g Σ ω |y − Fξ|² νV with g =
stabilisation · d(d+2)μ/m, the stiffness of an LPS bond; it vanishes in every uniform deformation, and so does its
force. Everything is computed from H = F − 1, so that rest is exactly at rest.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ..blocks import collect
from ..bonds import JIT
from ..lanes import INLINE, C, gather
from .base import Isotropic
from .force_model import BondForces, ForceModel, deformed
from .rows import lengthened, note

# The share that must be left of a family's smallest moment (the smallest eigenvalue of K), or its node exerts no force
# any more.
LEAST = 0.05


class Correspondence(Isotropic):
    """Classical elasticity at every node, through the bonds of its family.

    Parameters
    ----------
    bulk, shear, or youngs, poisson : three-dimensional constants
    stabilisation : how stiff zero-energy modes are, relative to an LPS bond (0 switches it off)
    influence : "one" by default; a name, a function of (|ξ|, δ), or one of ξ (b, 3) alone with ω(ξ) = ω(−ξ), whose
        direction changes what nodes listen to and no elastic constant
    volume_correction : the share ν of volumes near the horizon
    """

    name = "correspondence"
    elastic = True
    directed = True

    def __init__(
        self,
        bulk=None,
        shear=None,
        *,
        youngs=None,
        poisson=None,
        stabilisation=0.1,
        influence="one",
        volume_correction=True,
    ):
        super().__init__(bulk, shear, youngs=youngs, poisson=poisson)
        self.stabilisation = float(stabilisation)
        self.influence, self.volume_correction = influence, bool(volume_correction)


class CorrespondenceModel(ForceModel):
    """Forces of correspondence materials. A node whose intact bonds no longer span the dimension, or hardly (`LEAST`),
    exerts no force."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        self.refuse_interfaces(interfaces)
        self.lam_n, self.mu_n = self.lame_n()
        self.W_b = self.weights()
        d = body.dimension
        stiff = self.per_node(lambda m: m.stabilisation * d * (d + 2)) * self.mu_n
        M = self.table.sums(self.W_b * self.table.r0_b**2)
        self.g_n = np.divide(stiff * body.V_n, M, out=np.zeros(self.n), where=M > 0)
        self.tensor_buf = self.blocks.buffer(9)
        self.K_ncc = np.zeros((self.n, 9))
        self.inverse_ncc = np.zeros((self.n, 9))
        self.H_ncc = np.zeros((self.n, 9))
        self.Q_ncc = np.zeros((self.n, 9))
        self.counts = None
        self.least_n = np.zeros(self.n)

    def _shape(self, z, intact_b):
        """K⁻¹ of the intact families, when bonds have broken since the last time."""
        count = int(np.count_nonzero(intact_b))
        if count == self.counts:
            return
        self.counts = count
        self._tensors(z, intact_b, True, self.K_ncc)
        d = self.body.dimension
        K = self.K_ncc.reshape(-1, 3, 3)[:, :d, :d]
        inverse = np.zeros((self.n, 3, 3))
        trace = np.einsum("ncc->n", K)
        some = trace > 0
        condition = np.zeros(self.n)
        w = np.linalg.eigvalsh(K[some])
        condition[some] = w[:, 0] / w[:, -1]
        least = np.zeros(self.n)
        least[some] = w[:, 0]
        # A family that has nearly lost a direction would make an enormous F of small displacements, far stiffer than
        # the time step allows.
        whole = (condition > 1e-6) & (least > LEAST * self.least_n)
        inverse[np.ix_(whole, range(d), range(d))] = np.linalg.inv(K[whole])
        self.inverse_ncc[:] = inverse.reshape(-1, 9)
        self.g_active_n = np.where(whole, self.g_n, 0.0)

    def _tensors(self, z, intact_b, reference, out):
        bl, buf = self.blocks, self.tensor_buf
        self.over_blocks(_tensors, self.table, z, self.W_b, intact_b, reference, buf)
        self.crew.nodes(collect, self.n, bl.lo, bl.hi, bl.offset, buf, out, np.zeros(0), False)

    def _states(self, z, intact_b):
        self._shape(z, intact_b)
        self._tensors(z, intact_b, False, self.H_ncc)
        self._stresses()

    def _stresses(self):
        """H_ncc from its sum over bonds, and Q_ncc of it (see `_stress`)."""
        self.crew.nodes(
            _stress,
            self.n,
            self.H_ncc,
            self.inverse_ncc,
            self.lam_n,
            self.mu_n,
            self.g_active_n,
            self.body.V_n,
            self.Q_ncc,
        )

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        self._states(z, intact_b)
        self._intact = intact_b
        rows = self.standing(intact_b, self.table.r0_b, self.W_b)
        data = (*rows.columns, self.Q_ncc, self.g_active_n)
        return self.walk(z, rows, gather, _row, data, F_nc, smin_n, damage)

    def lost(self, z, which):
        """A bond has no energy of its own: the difference is that of the body before and after."""
        intact_b = self._intact
        intact_b[which] = 1
        self.counts = None
        before = float(self.energy_n(z, intact_b).sum())
        intact_b[which] = 0
        return before - float(self.energy_n(z, intact_b).sum())

    def _density(self, H):
        """(n,) W of displacement gradients."""
        E = 0.5 * (H + H.transpose(0, 2, 1) + H.transpose(0, 2, 1) @ H)
        return 0.5 * self.lam_n * np.einsum("ncc->n", E) ** 2 + self.mu_n * np.einsum("nab,nab->n", E, E)

    def energy_n(self, z, intact_b):
        self._states(z, intact_b)
        H = self.H_ncc.reshape(-1, 3, 3)
        energy = self.body.V_n * self._density(H)
        for b in self.parts():
            i, j, eta, xi, _, _ = deformed(self, z, b)
            weight = self.W_b[b] * (intact_b[b] != 0)
            for ends in (i, j):
                rest = eta - np.einsum("bac,bc->ba", H[ends], xi)
                energy += 0.5 * self.g_active_n * np.bincount(ends, weight * np.einsum("bc,bc->b", rest, rest), self.n)
        return energy

    def refresh(self, z, intact_b):
        self._states(z, intact_b)

    def forces_of_bonds(self, z, intact_b, whole):
        if intact_b is not None:
            self._states(z, intact_b)
        i, j, eta, xi, _, _ = deformed(self, z, whole)
        Q = self.Q_ncc.reshape(-1, 3, 3)
        g = self.g_active_n
        F = self.W_b[whole, None] * (np.einsum("bac,bc->ba", Q[i] + Q[j], xi) + (g[i] + g[j])[:, None] * eta)
        return BondForces(i, j, -(xi + eta), -xi, F, None, whole)

    def _stiffest_n(self):
        """(n,) the largest modulus of a plane wave."""
        return self.lam_n + 2 * self.mu_n

    def stiffness_n(self):
        """Row sums of the linearised stiffness: node k's stress couples its whole family, |Q| ≤ (λ + 2μ) V K⁻¹ Σ W|ξ|
        |K⁻¹|."""
        rest, t = self.at_rest(), self.table
        self._shape(rest, np.ones(len(t), np.uint8))
        self.counts = None
        K = self.K_ncc.reshape(-1, 3, 3)[:, : self.body.dimension, : self.body.dimension]
        self.least_n = np.linalg.eigvalsh(K)[:, 0]
        n, K = self.n, self.inverse_ncc.reshape(-1, 3, 3)
        modulus = self._stiffest_n() * self.body.V_n
        # ∂(node's share)/∂u_j = W K⁻¹ξ: a vector for every bond end, and minus their sum for the node itself.
        total, vector, across, hold = np.zeros(n), np.zeros((n, 3)), np.zeros(n), np.zeros(n)

        def pulls(b):
            i, j, _, xi, _, _ = deformed(self, rest, b)
            return i, j, *(self.W_b[b, None] * np.einsum("bac,bc->ba", K[end], xi) for end in (i, j))

        for b in self.parts():
            i, j, pi, pj = pulls(b)
            total += self.at_ends(i, j, np.linalg.norm(pi, axis=1), np.linalg.norm(pj, axis=1))
            for c in range(3):
                vector[:, c] += self.at_ends(i, j, pi[:, c], -pj[:, c])
            # Stabilisation: W (g_i + g_j)|η|² at most, since removing Fξ only lowers it.
            hold += self.at_ends(i, j, self.W_b[b] * (self.g_n[i] + self.g_n[j]))
        own = np.linalg.norm(vector, axis=1)
        every = modulus * (total + own)
        for b in self.parts():
            i, j, pi, pj = pulls(b)
            across += self.at_ends(j, i, np.linalg.norm(pi, axis=1) * every[i], np.linalg.norm(pj, axis=1) * every[j])
        return 0.5 * (own * every + across) + hold


Correspondence.model = CorrespondenceModel


@njit(**JIT)
def _tensors(first, last, edges, lo, hi, offset, start, j, image, images, z, W, intact, reference, buf):
    """Σ W η⊗ξ, or with `reference` Σ W ξ⊗ξ, of intact bonds: the same tensor for both ends."""
    w = np.empty(8 * C)
    node = np.empty(C + 8, np.int32)
    v = np.empty(9 * C)
    for block in range(first, last):
        f = buf[offset[block] : offset[block + 1]]
        f[:] = 0.0
        base = lo[block]
        for i in range(edges[block], edges[block + 1]):
            for b0 in range(start[i], start[i + 1], C):
                m = min(C, start[i + 1] - b0)
                gather(b0, m, i, j, image, images, z, node, w)
                if reference:
                    for k in range(3 * C):
                        w[k] = w[3 * C + k]
                _products(m, w, W[b0 : b0 + m], intact[b0 : b0 + m], v)
                for k in range(m):
                    n = j[b0 + k] - base
                    for c in range(9):
                        f[n, c] += v[c * C + k]
                for c in range(9):
                    s = 0.0
                    for k in range(m):
                        s += v[c * C + k]
                    f[i - base, c] += s


@njit(**INLINE)
def _products(m, w, W, intact, v):
    for k in range(m):
        a = W[k] if intact[k] != 0 else 0.0
        ex = a * w[k]
        ey = a * w[C + k]
        ez = a * w[2 * C + k]
        x = w[3 * C + k]
        y = w[4 * C + k]
        z = w[5 * C + k]
        v[k] = ex * x
        v[C + k] = ex * y
        v[2 * C + k] = ex * z
        v[3 * C + k] = ey * x
        v[4 * C + k] = ey * y
        v[5 * C + k] = ey * z
        v[6 * C + k] = ez * x
        v[7 * C + k] = ez * y
        v[8 * C + k] = ez * z


@njit(**JIT)
def _stress(a, b, H, inverse, lam, mu, g, V, Q):
    """H := (Σ W η⊗ξ) K⁻¹ and Q = V P K⁻¹ − g H of each node: the force on i from j is W [(Q_i + Q_j) ξ + (g_i + g_j)
    η]."""
    N = np.empty((3, 3))
    E = np.empty((3, 3))
    P = np.empty((3, 3))
    for n in range(a, b):
        Ki = inverse[n].reshape(3, 3)
        h = H[n].reshape(3, 3)
        q = Q[n].reshape(3, 3)
        for r in range(3):
            for c in range(3):
                N[r, c] = h[r, 0] * Ki[0, c] + h[r, 1] * Ki[1, c] + h[r, 2] * Ki[2, c]
        trace = 0.0
        for r in range(3):
            for c in range(3):
                h[r, c] = N[r, c]
                E[r, c] = 0.5 * (N[r, c] + N[c, r] + N[0, r] * N[0, c] + N[1, r] * N[1, c] + N[2, r] * N[2, c])
            trace += E[r, r]
        for r in range(3):
            for c in range(3):
                E[r, c] *= 2.0 * mu[n]
            E[r, r] += lam[n] * trace
        for r in range(3):
            for c in range(3):
                P[r, c] = E[r, c] + h[r, 0] * E[0, c] + h[r, 1] * E[1, c] + h[r, 2] * E[2, c]
        for r in range(3):
            for c in range(3):
                q[r, c] = V[n] * (P[r, 0] * Ki[0, c] + P[r, 1] * Ki[1, c] + P[r, 2] * Ki[2, c]) - g[n] * h[r, c]


@njit(**INLINE)
def _row(m, b0, i, node, w, q, intact, data):
    """Columns of q: Q_i + Q_j and g_i + g_j."""
    r0, W, Q, g_n = data
    for k in range(m):
        n = node[k]
        for c in range(9):
            q[c * C + k] = Q[n, c] + Q[i, c]
        q[9 * C + k] = g_n[n] + g_n[i]
    for k in range(m):
        b = np.uint64(b0) + np.uint64(k)
        L = r0[b]
        t, r = lengthened(k, w, L)
        s = t / ((r + L) * L)
        whole = intact[b] != 0
        a = W[b] if whole else 0.0
        g = q[9 * C + k]
        x = w[3 * C + k]
        y = w[4 * C + k]
        z = w[5 * C + k]
        w[k] = a * (q[k] * x + q[C + k] * y + q[2 * C + k] * z + g * w[k])
        w[C + k] = a * (q[3 * C + k] * x + q[4 * C + k] * y + q[5 * C + k] * z + g * w[C + k])
        w[2 * C + k] = a * (q[6 * C + k] * x + q[7 * C + k] * y + q[8 * C + k] * z + g * w[2 * C + k])
        note(k, w, s, whole)
