"""The forces that keep bodies rigid, by Newton and Euler, and bonds that carry them.

A body of mass M and inertia I about its centre of mass, with the forces F_i of everything else on its atoms, moves as

    a_i = ΣF/M + α × ρ_i + ω × (ω × ρ_i),   I α = τ − ω × I ω,   τ = Σ ρ_i × F_i,

so that the force that holds atom i is F_c,i = m_i a_i − F_i. Of all central forces between its atoms that add up to
these the ones of least Σ f² are taken (on the complete graph, unique for up to four atoms that do not lie in a plane):
f = −B K⁺ F_c with K = Bᵀ B. Bodies in a plane (four atoms and more) or on a line (three and more) carry loads across it
that no central force can: what is left over is handed from each atom to the one nearest to the centre, by forces that
do not act along the bond. Their torques add up to zero over the body, and so does the antisymmetric part of its stress.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ..images import Images

#: Eigenvalues below this part of the largest are zero: of inertia (atoms on a line), and of K (its rigid motions, and
#: loads across a plane or a line).
ON_A_LINE, SINGULAR = 1e-7, 1e-6
#: Bodies whose extent across is below this part of the one along may have such loads.
FLAT = 5e-3
#: Forces that central ones leave of F_c below this part of it are rounding, or atoms that are hardly out of a plane.
ACROSS = 1e-7
#: Atoms of a body, whose complete graph has N (N − 1)/2 bonds.
LARGEST = 400


@dataclass
class Bodies:
    """Bodies of `a` atoms each: atoms_ma indices into the frame, x_mac their places relative to the centre of mass,
    through periodic images."""

    atoms_ma: np.ndarray
    x_mac: np.ndarray
    mass_ma: np.ndarray
    dimension: int = 3

    def __post_init__(self):
        m, x = self.mass_ma, self.x_mac
        I = np.einsum("ma,mac,mac->m", m, x, x)[:, None, None] * np.eye(3) - np.einsum("ma,mac,mad->mcd", m, x, x)
        if self.dimension == 2:  # they turn about z only
            I = I * np.diag([0.0, 0.0, 1.0])
        self.I_mcc, self.inverse_I_mcc = I, np.linalg.pinv(I, rcond=ON_A_LINE, hermitian=True)
        self.total_m = m.sum(1)

    @property
    def thin(self) -> bool:
        """Whether there are bodies that carry loads across the plane (four atoms and more) or the line (three and more)
        they lie in."""
        a = self.atoms_ma.shape[1]
        if a < 3:
            return False
        s = np.linalg.svd(self.x_mac, compute_uv=False)
        flat = (s[:, 2] <= FLAT * s[:, 0]) & (self.dimension == 3)
        return bool((flat & (a > 3)).any() or (s[:, 1] <= FLAT * s[:, 0]).any())

    def motion(self, v_nc):
        """(m, 3) velocities of the centres, (m, 3) angular velocities, and the largest distance of velocities from
        these, relative."""
        v = v_nc[self.atoms_ma]
        V = np.einsum("ma,mac->mc", self.mass_ma, v) / self.total_m[:, None]
        w = v - V[:, None]
        L = np.einsum("ma,mac->mc", self.mass_ma, np.cross(self.x_mac, w))
        omega = np.einsum("mcd,md->mc", self.inverse_I_mcc, L)
        left = w - np.cross(omega[:, None], self.x_mac)
        size = np.sqrt((w**2).sum())
        return V, omega, float(np.sqrt((left**2).sum()) / size) if size > 0 else 0.0

    def holding(self, F_nc, omega_mc=None, kT: float | None = None) -> np.ndarray:
        """(m, a, 3) the forces F_c, for angular velocities or the mean over those of a temperature."""
        F, x = F_nc[self.atoms_ma], self.x_mac
        torque = np.cross(x, F).sum(1)
        if kT is None:
            torque = torque - np.cross(omega_mc, np.einsum("mcd,md->mc", self.I_mcc, omega_mc))
            inward = np.cross(omega_mc[:, None], np.cross(omega_mc[:, None], x))
        else:  # <ω ω> = k_B T I⁻¹
            inward = kT * (
                np.einsum("mcd,mad->mac", self.inverse_I_mcc, x)
                - np.einsum("mcc->m", self.inverse_I_mcc)[:, None, None] * x
            )
        alpha = np.einsum("mcd,md->mc", self.inverse_I_mcc, torque)
        a = F.sum(1)[:, None] / self.total_m[:, None, None] + np.cross(alpha[:, None], x) + inward
        return self.mass_ma[:, :, None] * a - F

    def degrees_ma(self) -> np.ndarray:
        """(m, a) degrees of freedom whose energy the atom has on average: d m_i/M and m_i tr(ρ× I⁻¹ ρ×ᵀ)."""
        tr = np.einsum("mcc->m", self.inverse_I_mcc)[:, None]
        d = self.dimension
        turning = tr * (self.x_mac**2).sum(2) - np.einsum("mac,mcd,mad->ma", self.x_mac, self.inverse_I_mcc, self.x_mac)
        return self.mass_ma * (d / self.total_m[:, None] + turning)

    def carried(self, F_mac):
        """Bonds that carry forces whose sum and torque are zero in each body.

        Returns
        -------
        i, j : (b,) of the complete graph; r_bc; f_b, the force on i along the unit vector of r; and (i, j, r_bc, F_bc)
            of the loads across, or None
        """
        m, a = self.atoms_ma.shape
        p, q = np.triu_indices(a, 1)
        r = self.x_mac[:, p] - self.x_mac[:, q]
        length = np.sqrt((r**2).sum(2))
        e = r / length[:, :, None]
        K = np.zeros((a, a, m, 3, 3))
        ee = (e[:, :, :, None] * e[:, :, None, :]).swapaxes(0, 1)
        K[p, q] = K[q, p] = -ee
        for k in range(a):
            K[k, k] = -K[k].sum(0)
        K = K.transpose(2, 0, 3, 1, 4).reshape(m, 3 * a, 3 * a)
        y = np.einsum("mkl,ml->mk", np.linalg.pinv(K, rcond=SINGULAR, hermitian=True), F_mac.reshape(m, -1))
        left = F_mac - np.einsum("mkl,ml->mk", K, y).reshape(m, a, 3)
        y = y.reshape(m, a, 3)
        f = np.einsum("mbx,mbx->mb", e, y[:, p] - y[:, q])
        i, j = self.atoms_ma[:, p], self.atoms_ma[:, q]
        return (i.ravel(), j.ravel(), r.reshape(-1, 3), (f / length).ravel()), self._across(left, F_mac)

    def _across(self, left, F):
        size = np.sqrt((F**2).sum((1, 2)))
        some = np.flatnonzero(np.sqrt((left**2).sum((1, 2))) > ACROSS * size)
        if not len(some):
            return None
        hub = np.argmin((self.x_mac[some] ** 2).sum(2), axis=1)
        a = self.atoms_ma.shape[1]
        others = np.array([[k for k in range(a) if k != h] for h in hub])
        rows = some[:, None]
        i, j = self.atoms_ma[rows, others], np.repeat(self.atoms_ma[some, hub][:, None], a - 1, axis=1)
        r = self.x_mac[rows, others] - self.x_mac[some, hub][:, None]
        return i.ravel(), j.ravel(), r.reshape(-1, 3), left[rows, others].reshape(-1, 3)


def bodies_of(labels_n, frame: Frame, where: str) -> list[Bodies]:
    """The bodies of a frame, sorted by size. labels_n : the number of each atom's body, -1 for none"""
    inside = np.flatnonzero(labels_n >= 0)
    if not len(inside):
        return []
    order = inside[np.argsort(labels_n[inside], kind="stable")]
    sizes = np.bincount(labels_n[inside])
    sizes = sizes[sizes > 0]
    if sizes.max() > LARGEST:
        raise AtcError(
            f"{where}: a body has {sizes.max()} atoms in {frame.source}, each of which would be joined to every "
            f"other: not supported beyond {LARGEST}"
        )
    first = np.concatenate([[0], np.cumsum(sizes)[:-1]])
    out = []
    for a in np.unique(sizes[sizes > 1]):
        atoms = order[first[sizes == a][:, None] + np.arange(a)]
        mass = frame.masses[atoms]
        x = _together(frame, atoms, where)
        x -= np.einsum("ma,mac->mc", mass, x)[:, None] / mass.sum(1)[:, None, None]
        out.append(Bodies(atoms, x, mass, frame.dimension))
    return out


def _together(frame: Frame, atoms_ma, where) -> np.ndarray:
    """(m, a, 3) places of the atoms of each body through the images that belong together, relative to the first."""
    if frame.images is not None:
        x = (frame.positions + frame.images @ frame.cell.vectors)[atoms_ma]
        return x - x[:, :1]
    m, a = atoms_ma.shape
    i = np.ascontiguousarray(atoms_ma.ravel(), dtype=np.int32)
    j = np.repeat(i.reshape(m, a)[:, 0], a).astype(np.int32)
    r = np.empty((m * a, 3))
    Images(frame.cell).vectors_to(frame.positions, i, j, r)
    periodic = frame.cell.periodic
    half = 0.5 * frame.cell.heights[periodic].min() if periodic.any() else np.inf
    if np.sqrt((r**2).sum(1)).max() > 0.95 * half:
        raise AtcError(
            f"{where}: a body of {frame.source} is as large as half the cell, so that its images are not told apart: "
            "dump ix iy iz too"
        )
    return r.reshape(m, a, 3)
