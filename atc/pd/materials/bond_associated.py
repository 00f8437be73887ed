"""Bond-associated correspondence (Chen 2018, Int. J. Solids Struct. 135, 267; Breitzman & Dayal 2018, J. Elast. 132,
115), Saint Venant-Kirchhoff: every bond has a deformation gradient of its own, and there are no zero-energy modes.

The family of a bond at its end i are those bonds of i whose other ends lie within the horizon of its other end j as
well: the intersection of both ends' families. F_ij = (Σ_k ω y⊗ξ νV) K_ij⁻¹, K_ij = Σ_k ω ξ⊗ξ νV, k in that family. It
lies to one side of i, so that a sawtooth, which the sum over the whole family misses, changes it. The node's energy is
the mean of its bonds',

U_i = V_i Σ_j w_ij W(F_ij), w_ij ∝ ω νV_j over the intact bonds, Σ_j w_ij = 1,

and its force state the derivative, T_i<ξ_ik> = V_i ω νV_k A_ik ξ_ik, A_ik = Σ_j w_ij P_ij K_ij⁻¹ over all j in whose
family k is; k is in the family of j where j is in that of k. The force on i from k is T_i<ξ> − T_k<−ξ>: momentum is
conserved bond by bond, energy because the forces are its derivative, angular momentum because F turns with the body.
F is exact in every homogeneous deformation, and so are energy and elastic constants.
"""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ..bonds import HORIZON_SLACK, JIT
from ..lanes import INLINE, C, gather
from .base import AT_ONCE, BondForces, ForceModel, Isotropic, deformed

# The share that must be left of the smallest moment of a bond's family, or that end of the bond has no energy any more.
# More than of a node's (`correspondence`): with 0.05 a shattering body gains kinetic energy from what is left.
LEAST = 0.15
# A thread takes as many nodes at least: their pairs of bonds are enough work.
_NODES = 64


class BondAssociated(Isotropic):
    """Classical elasticity in every bond, through the bonds that both its ends share.

    Parameters
    ----------
    bulk, shear, or youngs, poisson : three-dimensional constants
    influence : "one" by default; a name, a function of (|ξ|, δ), or one of ξ (b, 3) alone with ω(ξ) = ω(−ξ), whose
        direction changes what nodes listen to and no elastic constant
    volume_correction : the share ν of volumes near the horizon

    Notes
    -----
    Nothing to stabilise and nothing to choose; a step costs as many products as a node has pairs of bonds.
    """

    name = "bond-associated"
    directed = True

    def __init__(self, bulk=None, shear=None, *, youngs=None, poisson=None, influence="one", volume_correction=True):
        super().__init__(bulk, shear, youngs=youngs, poisson=poisson)
        self.influence, self.volume_correction = influence, bool(volume_correction)

    @staticmethod
    def model(*args, **options):
        return BondAssociatedModel(*args, **options)


class BondAssociatedModel(ForceModel):
    """Every bond b has two ends, 2b at i and 2b + 1 at j, with a family each. An end whose intact family no longer
    spans the dimension, or hardly (`LEAST`), has no energy."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        self.refuse_interfaces(interfaces)
        lame = {id(m): m.lame(body) for m in materials.values()}
        self.lam_n = self.per_node(lambda m: lame[id(m)][0])
        self.mu_n = self.per_node(lambda m: lame[id(m)][1])
        self.W_b = self.weights()
        t = self.table
        self._i_b = t.i_b
        nodes = np.stack([self._i_b, t.j_b], axis=1).ravel()
        self.end_e = np.argsort(nodes, kind="stable")
        self.first_n = np.concatenate([[0], np.cumsum(np.bincount(nodes, minlength=self.n))]).astype(np.int64)
        self.most = int(np.diff(self.first_n).max(initial=0))
        # Of a node's ends, in the order of `end_e`: K⁻¹ (xx yy zz yz xz xy), w, and the smallest moment at rest.
        self.inverse_ev = np.zeros((2 * len(t), 6))
        self.share_e = np.zeros(2 * len(t))
        self.least_e = np.zeros(2 * len(t))
        self.T_ec = np.zeros((2 * len(t), 3))
        self.F_bc = np.zeros((len(t), 3))
        self.U_n = np.zeros(self.n)
        self._known_b = np.zeros(len(t), bool)
        self._at_rest()

    def _at_rest(self):
        """The moments at rest, which later ones are held to."""
        rest = np.zeros((self.n, 8))
        rest[:, 3:6] = self.body.X_nc
        self._rest = rest
        self._shape(rest, np.ones(len(self.table), np.uint8), first=True)
        node = np.repeat(np.arange(self.n), np.diff(self.first_n))
        held = np.bincount(node, self.share_e, self.n) > 0
        if np.count_nonzero(held) < 0.5 * np.count_nonzero(np.diff(self.first_n)):
            raise AtcError(
                f"bond-associated: few nodes share neighbours with theirs that span {self.body.dimension} dimensions: "
                f"the horizon reaches {self.body.horizon / self.body.spacing:.3g} spacings, take 2 or more"
            )

    def _run(self, kernel, nodes, z, intact_b, *more):
        t = self.table
        return self.crew.run(
            kernel,
            len(nodes),
            nodes,
            self.first_n,
            self.end_e,
            self.most,
            self._i_b,
            t.j_b,
            t.image_b,
            self.images,
            z,
            self.W_b,
            intact_b,
            (self.body.horizon * (1 + HORIZON_SLACK)) ** 2,
            *more,
            grain=_NODES,
        )

    def _shape(self, z, intact_b, first=False):
        """K⁻¹ and w at the ends of bonds whose nodes have lost (or got back) bonds since the last time."""
        known = intact_b != 0
        changed = np.flatnonzero(known != self._known_b)
        if not len(changed):
            return
        self._known_b = known
        touched = np.zeros(self.n, bool)
        touched[self._i_b[changed]] = touched[self.table.j_b[changed]] = True
        nodes = np.flatnonzero(touched)
        self._run(_moments, nodes, z, intact_b, self.inverse_ev)
        ends = np.flatnonzero(np.repeat(touched, np.diff(self.first_n)))
        for a in range(0, len(ends), AT_ONCE):
            self._invert(ends[a : a + AT_ONCE], first)
        whole = self.inverse_ev[ends].any(axis=1)
        bonds = self.end_e[ends] >> 1
        share = np.where(whole & known[bonds], self.W_b[bonds], 0.0)
        node = np.repeat(nodes, np.diff(self.first_n)[nodes])
        total = np.bincount(node, share, self.n)[node]
        self.share_e[ends] = np.divide(share, total, out=np.zeros(len(ends)), where=total > 0)

    def _invert(self, ends, first):
        """K to K⁻¹ at these ends; 0 where it cannot be."""
        d = self.body.dimension
        K = self.inverse_ev[ends][:, _FULL].reshape(-1, 3, 3)[:, :d, :d]
        w = np.linalg.eigvalsh(K)
        if first:
            self.least_e[ends] = w[:, 0]
        # A family that has nearly lost a direction would be far stiffer than the time step allows.
        whole = (w[:, 0] > 1e-6 * w[:, -1]) & (w[:, 0] > LEAST * self.least_e[ends])
        inverse = np.zeros((len(ends), 3, 3))
        inverse[np.ix_(whole, range(d), range(d))] = np.linalg.inv(K[whole])
        self.inverse_ev[ends] = inverse.reshape(-1, 9)[:, [0, 4, 8, 5, 2, 1]]

    def _states(self, z, intact_b, pull, nodes=None):
        """U_n of these nodes (default all), and with `pull` the forces of all bonds."""
        self._shape(z, intact_b)
        nodes = np.arange(self.n) if nodes is None else nodes
        self._run(
            _states,
            nodes,
            z,
            intact_b,
            self.inverse_ev,
            self.share_e,
            self.lam_n,
            self.mu_n,
            self.body.V_n,
            pull,
            self.U_n,
            self.T_ec,
        )
        if pull:
            np.subtract(self.T_ec[0::2], self.T_ec[1::2], out=self.F_bc)

    def forces(self, z, intact_b, F_nc, smin_n, damage):
        self._states(z, intact_b, True)
        self._intact = intact_b
        rows = self.standing(intact_b, self.table.r0_b)
        F = self.F_bc if rows.bond_b is None else self.F_bc[rows.bond_b]
        data = (*rows.columns, F)
        return self.account(z, rows.broke(self.pull(rows, gather, _row, z, data, F_nc, smin_n, damage)))

    def lost(self, z, which):
        """The difference of the energies of the bonds' ends before and after."""
        intact_b = self._intact
        nodes = np.unique(np.concatenate([self._i_b[which], self.table.j_b[which]]))
        energy = []
        for whole in (1, 0):
            intact_b[which] = whole
            self._states(z, intact_b, False, nodes)
            energy.append(float(self.U_n[nodes].sum()))
        return energy[0] - energy[1]

    def energy_n(self, z, intact_b):
        self._states(z, intact_b, False)
        return self.U_n.copy()

    def refresh(self, z, intact_b):
        self._states(z, intact_b, True)

    def forces_of_bonds(self, z, intact_b, whole):
        if intact_b is not None:
            self._states(z, intact_b, True)
        i, j, eta, xi, _, _ = deformed(self, z, whole)
        return BondForces(i, j, -(xi + eta), -xi, self.F_bc[whole], None, whole)

    def stiffness_n(self):
        """Row sums of the linearised stiffness: that of an end is at most (λ + 2μ) V w g⊗g, g = ∂F/∂u."""
        self._shape(self._rest, np.ones(len(self.table), np.uint8))
        own_n, across_e = np.zeros(self.n), np.zeros(2 * len(self.table))
        self._run(
            _rows,
            np.arange(self.n),
            self._rest,
            np.ones(len(self.table), np.uint8),
            self.inverse_ev,
            self.share_e,
            own_n,
            across_e,
            (self.lam_n + 2 * self.mu_n) * self.body.V_n,
        )
        # What an end's family does to its other end.
        return 0.5 * (own_n + self.table.sums(across_e[1::2], across_e[0::2]))


# Where the six numbers of a symmetric tensor stand in its nine.
_FULL = [0, 5, 4, 5, 1, 3, 4, 3, 2]


@njit(**INLINE)
def _family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a):
    """ξ, η and weights (0 of broken ones) of node i's bonds, seen from it. Returns how many."""
    m = first[i + 1] - first[i]
    for k in range(m):
        b = end[first[i] + k] >> 1
        sign = 1.0 if end[first[i] + k] & 1 == 0 else -1.0
        p, q = i_b[b], j_b[b]
        for c in range(3):
            x = z[q, 3 + c] - z[p, 3 + c]
            e = z[q, c] - z[p, c]
            if len(image):
                x += images[image[b], c]
                e += images[image[b], 3 + c]
            xi[k, c] = sign * x
            eta[k, c] = sign * e
        a[k] = W[b] if intact[b] != 0 else 0.0
    return m


@njit(**INLINE)
def _near(xi, j, k, reach2):
    """Whether the ends of two bonds of a node are within each other's horizon."""
    x = xi[j, 0] - xi[k, 0]
    y = xi[j, 1] - xi[k, 1]
    z = xi[j, 2] - xi[k, 2]
    return x * x + y * y + z * z <= reach2


@njit(**JIT)
def _moments(lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, reach2, K):
    """K (xx yy zz yz xz xy) at all ends of these nodes' bonds."""
    xi, eta, a = np.empty((most, 3)), np.empty((most, 3)), np.empty(most)
    for n in range(lo, hi):
        i = nodes[n]
        m = _family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for j in range(m):
            out = K[first[i] + j]
            out[:] = 0.0
            for k in range(m):
                if a[k] > 0.0 and _near(xi, j, k, reach2):
                    x, y, s = a[k] * xi[k, 0], a[k] * xi[k, 1], a[k] * xi[k, 2]
                    out[0] += x * xi[k, 0]
                    out[1] += y * xi[k, 1]
                    out[2] += s * xi[k, 2]
                    out[3] += y * xi[k, 2]
                    out[4] += x * xi[k, 2]
                    out[5] += x * xi[k, 1]


@njit(**INLINE)
def _unpack(v, full):
    """(3, 3) of xx yy zz yz xz xy."""
    full[0, 0], full[1, 1], full[2, 2] = v[0], v[1], v[2]
    full[1, 2] = full[2, 1] = v[3]
    full[0, 2] = full[2, 0] = v[4]
    full[0, 1] = full[1, 0] = v[5]


@njit(**INLINE)
def _saint_venant(H, lam, mu, E, P):
    """P = (1 + H) S into P, S = λ tr(E) + 2μE. Returns W."""
    trace = 0.0
    square = 0.0
    for r in range(3):
        for c in range(3):
            E[r, c] = 0.5 * (H[r, c] + H[c, r] + H[0, r] * H[0, c] + H[1, r] * H[1, c] + H[2, r] * H[2, c])
            square += E[r, c] * E[r, c]
        trace += E[r, r]
    for r in range(3):
        for c in range(3):
            E[r, c] *= 2.0 * mu
        E[r, r] += lam * trace
    for r in range(3):
        for c in range(3):
            P[r, c] = E[r, c] + H[r, 0] * E[0, c] + H[r, 1] * E[1, c] + H[r, 2] * E[2, c]
    return 0.5 * lam * trace * trace + mu * square


@njit(**JIT)
def _states(
    lo,
    hi,
    nodes,
    first,
    end,
    most,
    i_b,
    j_b,
    image,
    images,
    z,
    W,
    intact,
    reach2,
    inverse,
    share,
    lam,
    mu,
    V,
    pull,
    U,
    T,
):
    """U of these nodes; with `pull` T = V ω A ξ at their ends of bonds."""
    xi, eta, a = np.empty((most, 3)), np.empty((most, 3)), np.empty(most)
    B = np.empty((most, 9))
    S, H, E, P, Ki = np.empty(9), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    for n in range(lo, hi):
        i = nodes[n]
        m = _family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        energy = 0.0
        for j in range(m):
            w = share[first[i] + j]
            B[j] = 0.0
            if w == 0.0:
                continue
            S[:] = 0.0
            for k in range(m):
                if a[k] > 0.0 and _near(xi, j, k, reach2):
                    x, y, s = a[k] * xi[k, 0], a[k] * xi[k, 1], a[k] * xi[k, 2]
                    for r in range(3):
                        S[3 * r] += eta[k, r] * x
                        S[3 * r + 1] += eta[k, r] * y
                        S[3 * r + 2] += eta[k, r] * s
            _unpack(inverse[first[i] + j], Ki)
            for r in range(3):
                for c in range(3):
                    H[r, c] = S[3 * r] * Ki[0, c] + S[3 * r + 1] * Ki[1, c] + S[3 * r + 2] * Ki[2, c]
            energy += w * _saint_venant(H, lam[i], mu[i], E, P)
            for r in range(3):
                for c in range(3):
                    B[j, 3 * r + c] = w * V[i] * (P[r, 0] * Ki[0, c] + P[r, 1] * Ki[1, c] + P[r, 2] * Ki[2, c])
        U[i] = V[i] * energy
        if pull:
            for k in range(m):
                out = T[end[first[i] + k]]
                S[:] = 0.0
                if a[k] > 0.0:
                    for j in range(m):
                        if _near(xi, j, k, reach2):
                            for c in range(9):
                                S[c] += B[j, c]
                for r in range(3):
                    out[r] = a[k] * (S[3 * r] * xi[k, 0] + S[3 * r + 1] * xi[k, 1] + S[3 * r + 2] * xi[k, 2])


@njit(**JIT)
def _rows(
    lo, hi, nodes, first, end, most, i_b, j_b, image, images, z, W, intact, reach2, inverse, share, own, across, modulus
):
    """Shares of these nodes' energies in the row sums of the stiffness: in their own rows, and by ends in others'."""
    xi, eta, a, g = np.empty((most, 3)), np.empty((most, 3)), np.empty(most), np.empty(most)
    Ki, v, mine = np.empty((3, 3)), np.empty(3), np.empty(3)
    for n in range(lo, hi):
        i = nodes[n]
        m = _family(i, first, end, i_b, j_b, image, images, z, W, intact, xi, eta, a)
        for k in range(m):
            across[end[first[i] + k]] = 0.0
        for j in range(m):
            w = share[first[i] + j] * modulus[i]
            if w == 0.0:
                continue
            _unpack(inverse[first[i] + j], Ki)
            mine[:] = 0.0
            total = 0.0
            for k in range(m):
                g[k] = 0.0
                if _near(xi, j, k, reach2):
                    for c in range(3):
                        v[c] = a[k] * (Ki[c, 0] * xi[k, 0] + Ki[c, 1] * xi[k, 1] + Ki[c, 2] * xi[k, 2])
                        mine[c] += v[c]
                    g[k] = np.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
                    total += g[k]
            size = np.sqrt(mine[0] * mine[0] + mine[1] * mine[1] + mine[2] * mine[2])
            total += size
            own[i] += w * size * total
            for k in range(m):
                across[end[first[i] + k]] += w * g[k] * total


@njit(**INLINE)
def _row(m, b0, i, node, w, v, intact, data):
    """The forces are known; the stretches are not."""
    r0, F = data
    for k in range(m):
        b = np.uint64(b0) + np.uint64(k)
        ex = w[k]
        ey = w[C + k]
        ez = w[2 * C + k]
        t = ex * (2.0 * w[3 * C + k] + ex) + ey * (2.0 * w[4 * C + k] + ey) + ez * (2.0 * w[5 * C + k] + ez)
        L = r0[b]
        r2 = L * L + t
        r = np.sqrt(r2 if r2 > 0.0 else 0.0)
        s = t / ((r + L) * L)
        whole = intact[b] != 0
        w[k] = F[b, 0] if whole else 0.0
        w[C + k] = F[b, 1] if whole else 0.0
        w[2 * C + k] = F[b, 2] if whole else 0.0
        w[6 * C + k] = s if whole else np.inf
        w[7 * C + k] = s if whole else -np.inf
