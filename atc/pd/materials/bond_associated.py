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
from ..bonds import HORIZON_SLACK
from ..lanes import INLINE, C, gather
from .base import Isotropic
from .force_model import AT_ONCE, BondForces, ForceModel, deformed
from .rows import lengthened, note
from .shared_families import find_runs, moments, order, states, stiff_rows

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
    Nothing to stabilise and nothing to choose. A step costs 4 times correspondence's at two spacings, 8 times at three:
    the sums over the families of a node's bonds are differences of running sums (`shared_families`).
    """

    name = "bond-associated"
    directed = True

    def __init__(self, bulk=None, shear=None, *, youngs=None, poisson=None, influence="one", volume_correction=True):
        super().__init__(bulk, shear, youngs=youngs, poisson=poisson)
        self.influence, self.volume_correction = influence, bool(volume_correction)


class BondAssociatedModel(ForceModel):
    """Every bond b has two ends, 2b at i and 2b + 1 at j, with a family each. An end whose intact family no longer
    spans the dimension, or hardly (`LEAST`), has no energy."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        self.refuse_interfaces(interfaces)
        self.lam_n, self.mu_n = self.lame_n()
        self.W_b = self.weights()
        t = self.table
        self._i_b = t.i_b
        nodes = np.stack([self._i_b, t.j_b], axis=1).ravel()
        xi = t.xi_bc(body.X_nc)
        self.end_e = order(nodes, np.stack([xi, -xi], axis=1).reshape(-1, 3), body.spacing)
        self.first_n = np.concatenate([[0], np.cumsum(np.bincount(nodes, minlength=self.n))]).astype(np.int64)
        self.most = int(np.diff(self.first_n).max(initial=0))
        # Of a node's ends, in the order of `end_e`: K⁻¹ (xx yy zz yz xz xy), w, and the smallest moment at rest.
        self.inverse_ve = np.zeros((6, 2 * len(t)))
        self.share_e = np.zeros(2 * len(t))
        self.least_e = np.zeros(2 * len(t))
        self.T_ec = np.zeros((2 * len(t), 3))
        self.F_bc = np.zeros((len(t), 3))
        self.U_n = np.zeros(self.n)
        self._known_b = np.zeros(len(t), bool)
        self._at_rest()

    def _at_rest(self):
        """The moments at rest, which later ones are held to."""
        self._rest = rest = self.at_rest()
        self._find_runs(rest)
        self._shape(rest, np.ones(len(self.table), np.uint8), first=True)
        node = np.repeat(np.arange(self.n), np.diff(self.first_n))
        held = np.bincount(node, self.share_e, self.n) > 0
        if np.count_nonzero(held) < 0.5 * np.count_nonzero(np.diff(self.first_n)):
            raise AtcError(
                f"bond-associated: few nodes share neighbours with theirs that span {self.body.dimension} dimensions: "
                f"the horizon reaches {self.body.horizon / self.body.spacing:.3g} spacings, take 2 or more"
            )

    def _find_runs(self, rest):
        """The runs of each end's family among its node's bonds."""
        whole, every = np.ones(len(self.table), np.uint8), np.arange(self.n)
        reach2 = (self.body.horizon * (1 + HORIZON_SLACK)) ** 2
        counts = np.zeros(2 * len(self.table), np.int64)
        self.runs_of_e = counts, np.zeros((0, 2), np.uint8 if self.most < 256 else np.uint16)
        self._run(find_runs, every, rest, whole, reach2, True)
        where = np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)
        self.runs_of_e = where, np.empty((int(where[-1]), 2), self.runs_of_e[1].dtype)
        self._run(find_runs, every, rest, whole, reach2, False)

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
            *self.runs_of_e,
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
        self._run(moments, nodes, z, intact_b, self.inverse_ve)
        ends = np.flatnonzero(np.repeat(touched, np.diff(self.first_n)))
        for a in range(0, len(ends), AT_ONCE):
            self._invert(ends[a : a + AT_ONCE], first)
        whole = self.inverse_ve[:, ends].any(axis=0)
        bonds = self.end_e[ends] >> 1
        share = np.where(whole & known[bonds], self.W_b[bonds], 0.0)
        node = np.repeat(nodes, np.diff(self.first_n)[nodes])
        total = np.bincount(node, share, self.n)[node]
        self.share_e[ends] = np.divide(share, total, out=np.zeros(len(ends)), where=total > 0)

    def _invert(self, ends, first):
        """K to K⁻¹ at these ends; 0 where it cannot be."""
        d = self.body.dimension
        K = self.inverse_ve[:, ends].T[:, _FULL].reshape(-1, 3, 3)[:, :d, :d]
        w = np.linalg.eigvalsh(K)
        if first:
            self.least_e[ends] = w[:, 0]
        # A family that has nearly lost a direction would be far stiffer than the time step allows.
        whole = (w[:, 0] > 1e-6 * w[:, -1]) & (w[:, 0] > LEAST * self.least_e[ends])
        inverse = np.zeros((len(ends), 3, 3))
        inverse[np.ix_(whole, range(d), range(d))] = np.linalg.inv(K[whole])
        self.inverse_ve[:, ends] = inverse.reshape(-1, 9)[:, [0, 4, 8, 5, 2, 1]].T

    def _states(self, z, intact_b, pull, nodes=None):
        """U_n of these nodes (default all), and with `pull` the forces of all bonds."""
        self._shape(z, intact_b)
        nodes = np.arange(self.n) if nodes is None else nodes
        self._run(
            states,
            nodes,
            z,
            intact_b,
            self.inverse_ve,
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
        data = (*rows.columns, self.F_bc[rows.walked])
        return self.walk(z, rows, gather, _row, data, F_nc, smin_n, damage)

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
            stiff_rows,
            np.arange(self.n),
            self._rest,
            np.ones(len(self.table), np.uint8),
            self.inverse_ve,
            self.share_e,
            own_n,
            across_e,
            (self.lam_n + 2 * self.mu_n) * self.body.V_n,
        )
        # What an end's family does to its other end.
        return 0.5 * (own_n + self.table.sums(across_e[1::2], across_e[0::2]))


BondAssociated.model = BondAssociatedModel


# Where the six numbers of a symmetric tensor stand in its nine.
_FULL = [0, 5, 4, 5, 1, 3, 4, 3, 2]


@njit(**INLINE)
def _row(m, b0, i, node, w, v, intact, data):
    """The forces are known; the stretches are not."""
    r0, F = data
    for k in range(m):
        b = np.uint64(b0) + np.uint64(k)
        L = r0[b]
        t, r = lengthened(k, w, L)
        s = t / ((r + L) * L)
        whole = intact[b] != 0
        w[k] = F[b, 0] if whole else 0.0
        w[C + k] = F[b, 1] if whole else 0.0
        w[2 * C + k] = F[b, 2] if whole else 0.0
        note(k, w, s, whole)
