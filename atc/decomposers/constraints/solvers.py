"""The forces that hold distances, molecule by molecule: small linear systems, many at a time.

A constraint b between atoms i and j is a bond with the force −λ_b e_b on i and +λ_b e_b on j, e_b the unit vector of
r_b = x_i − x_j, so that G_b = λ_b/|r_b|. With B the rows of the constraints, B_b = (e_b on i, −e_b on j), the forces
are F_c = −Bᵀ λ, and everything turns on A = B M⁻¹ Bᵀ:

forces        D = F_run − F_model is −Bᵀ λ up to rounding: least squares with weights 1/m, A λ = −B M⁻¹ D. What is
perpendicular to the constraints, a common
              acceleration among it, does not enter.
velocities    d²|r_b|²/dt² = 0: A λ = B M⁻¹ F_model + |v_b|²/|r_b|
step          what velocity Verlet with SHAKE does from step to step. From |r(t + Δt)| = |r(t − Δt)| = |r(t)| and v =
(x(t + Δt) − x(t − Δt))/2Δt follows
              r·a = −|v|² − ¼ Δt² |a|² with the accelerations a that contain those of λ, exactly: |v_b|² + ¼ Δt² |a_b|²
              instead of |v_b|². With velocities half a step behind (leap-frog) v is v(t − Δt/2) + ½ Δt a.
temperature   the mean of |v_b|² over the velocities that the constraints allow: k_B T tr(C M⁻¹ − C A⁻¹ Cᵀ) of each
constraint
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Eigenvalues of A below this part of the largest are those of constraints that follow from others.
SINGULAR = 1e-9
#: Rounds of the equations of a step, whose change falls by (ω Δt)² a round; enough where it falls by a third.
ROUNDS, SETTLED = 40, 1e-14


@dataclass
class Molecules:
    """Molecules of `a` atoms and `c` constraints each.

    atoms_ma : indices into the frame. ends_mc2 : of the constraints among these. which_mc : the constraints' own
        numbers
    """

    atoms_ma: np.ndarray
    ends_mc2: np.ndarray
    which_mc: np.ndarray

    def of(self, values_n) -> np.ndarray:
        """Values of atoms (n, ...) as (m, a, ...)."""
        return values_n[self.atoms_ma]

    def ends(self, values_ma, end: int) -> np.ndarray:
        """(m, c, ...) values at one end of each constraint."""
        k = self.ends_mc2[:, :, end]
        return np.take_along_axis(values_ma, k.reshape(k.shape + (1,) * (values_ma.ndim - 2)), axis=1)

    def difference(self, values_ma) -> np.ndarray:
        """(m, c, ...) value at i minus value at j."""
        return self.ends(values_ma, 0) - self.ends(values_ma, 1)


def molecules_of(pairs_c2, n: int) -> list[Molecules]:
    """Atoms that constraints join, sorted by how many atoms and constraints there are."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    pairs = np.asarray(pairs_c2, np.int64).reshape(-1, 2)
    if not len(pairs):
        return []
    atoms, local = np.unique(pairs, return_inverse=True)
    local = local.reshape(-1, 2)
    graph = coo_array((np.ones(len(pairs)), (local[:, 0], local[:, 1])), shape=(len(atoms), len(atoms)))
    count, label = connected_components(graph, directed=False)
    of_pair = label[local[:, 0]]
    sizes, numbers = np.bincount(label, minlength=count), np.bincount(of_pair, minlength=count)
    # Place of every atom in its molecule.
    order = np.argsort(label, kind="stable")
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    place = np.empty(len(atoms), np.int64)
    place[order] = np.arange(len(atoms)) - np.repeat(first, sizes)
    by_pair = np.argsort(of_pair, kind="stable")
    first_pair = np.concatenate([[0], np.cumsum(numbers)[:-1]])
    out = []
    for a, c in np.unique(np.stack([sizes, numbers], 1), axis=0):
        mine = np.flatnonzero((sizes == a) & (numbers == c))
        which = by_pair[first_pair[mine][:, None] + np.arange(c)]
        out.append(Molecules(atoms[order[first[mine][:, None] + np.arange(a)]], place[local[which]], which))
    return out


class System:
    """The matrices of some molecules of one frame.

    r_c3 : (c, 3) vectors of all constraints of the frame. mass_n : (n,)
    """

    def __init__(self, molecules: Molecules, r_c3, mass_n):
        self.molecules = mol = molecules
        r = r_c3[mol.which_mc]
        self.length_mc = np.sqrt(np.einsum("mbx,mbx->mb", r, r))
        self.e_mcx = r / self.length_mc[:, :, None]
        self.inverse_mass_ma = 1.0 / mol.of(mass_n)
        i, j = mol.ends_mc2[:, :, 0], mol.ends_mc2[:, :, 1]
        wi, wj = (mol.ends(self.inverse_mass_ma, end)[:, :, None] for end in (0, 1))
        # S_bd = ± 1/m of the atom that b and d share: how λ_d accelerates the ends of b, −S_bd λ_d e_d.
        self.S_mcc = (
            (i[:, :, None] == i[:, None]) * wi
            - (i[:, :, None] == j[:, None]) * wi
            - (j[:, :, None] == i[:, None]) * wj
            + (j[:, :, None] == j[:, None]) * wj
        )
        A = self.S_mcc * np.einsum("mbx,mdx->mbd", self.e_mcx, self.e_mcx)
        self.inverse_mcc = np.linalg.pinv(A, rcond=SINGULAR, hermitian=True)
        #: How many of the constraints are independent, and how many degrees of freedom they take.
        self.rank_m = np.rint(np.einsum("mbd,mdb->m", self.inverse_mcc, A)).astype(int)

    def solve(self, right_mc) -> np.ndarray:
        return np.einsum("mbd,md->mb", self.inverse_mcc, right_mc)

    def accelerations(self, lam_mc) -> np.ndarray:
        """(m, c, 3) of i relative to j by the forces of constraints."""
        return -np.einsum("mbd,md,mdx->mbx", self.S_mcc, lam_mc, self.e_mcx)

    def by_forces(self, d_mcx) -> np.ndarray:
        """λ from the differences D_i/m_i − D_j/m_j of what the run's forces have beyond the model's."""
        return -self.solve(np.einsum("mbx,mbx->mb", self.e_mcx, d_mcx))

    def by_motion(self, a_mcx, v2_mc) -> np.ndarray:
        """λ from the differences of the other accelerations and |v_i − v_j|²."""
        return self.solve(np.einsum("mbx,mbx->mb", self.e_mcx, a_mcx) + v2_mc / self.length_mc)

    def by_step(self, a_mcx, v_mcx, dt: float, behind: float = 0.0) -> np.ndarray:
        """λ of a step of velocity Verlet with SHAKE; velocities `behind` steps behind the positions."""
        lam = self.by_motion(a_mcx, np.einsum("mbx,mbx->mb", v_mcx, v_mcx))
        for _ in range(ROUNDS):
            a = a_mcx + self.accelerations(lam)
            v = v_mcx + behind * dt * a
            v2 = np.einsum("mbx,mbx->mb", v, v) + 0.25 * dt * dt * np.einsum("mbx,mbx->mb", a, a)
            new = self.by_motion(a_mcx, v2)
            moved = np.abs(new - lam).max(initial=0.0)
            lam = new
            if not moved > SETTLED * np.abs(lam).max(initial=0.0):
                break
        return lam

    def mean_squares(self, kT: float, dimension: int = 3) -> np.ndarray:
        """(m, c) mean |v_i − v_j|² at a temperature."""
        # C_bd = S_bd e_d: what a unit momentum along constraint d does to the velocity difference of b.
        taken = np.einsum(
            "mbd,mbf,mdx,mfx,mdf->mb", self.S_mcc, self.S_mcc, self.e_mcx, self.e_mcx, self.inverse_mcc, optimize=True
        )
        return kT * (dimension * np.einsum("mbb->mb", self.S_mcc) - taken)

    def taken_ma(self) -> np.ndarray:
        """(m, a) degrees of freedom that the constraints take of each atom: m⁻¹ tr(Bᵀ A⁻¹ B) of its own, in all the
        rank of A."""
        mol, out = self.molecules, np.zeros(self.inverse_mass_ma.shape)
        m = np.arange(len(out))[:, None, None]
        ee = np.einsum("mbx,mdx->mbd", self.e_mcx, self.e_mcx) * self.inverse_mcc
        for s in (0, 1):
            for t in (0, 1):
                p, q = mol.ends_mc2[:, :, s][:, :, None], mol.ends_mc2[:, :, t][:, None, :]
                sign = 1.0 if s == t else -1.0
                np.add.at(out, (np.broadcast_to(m, ee.shape), np.broadcast_to(p, ee.shape)), sign * ee * (p == q))
        return out * self.inverse_mass_ma
