"""Linear bond-based material: every bond is a spring with a micromodulus tensor, f = C(ξ) η (Silling 2000, the
linearised theory)."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...contracts import BondSprings, Micromodulus
from ...errors import AtcError
from ..bonds import JIT
from ..sampling import check_moduli, dynamical_matrix
from .base import Material
from .force_model import BondForces, ForceModel, deformed

# Bonds whose springs are asked of the kernel at once.
_AT_ONCE = 200_000


class Linear(Material):
    """Force density f = C(ξ) (u' − u) between two nodes of the reference configuration, ξ from one to the other.

    What a kernel fitted to a crystal's dispersion is (`atc.upscaling`): it carries waves of small amplitude with the
    crystal's ω(k). The law is linear: not objective under finite rotations, without damage and contact.

    Parameters
    ----------
    micromodulus : function of ξ (b, 3) → (b, 3, 3) symmetric, C(ξ) = C(−ξ), force per length and volume²; or
        `contracts.BondSprings`, which has ``springs(body)``; or a `contracts.Micromodulus`, as the kernels of
        `atc.upscaling` (``kernel``, ``dynamical_matrix``), whose stiffness for long waves the nodes are held to: a
        warning beyond 2 %, an error beyond 10 %
    cutoff : C counts as 0 beyond it; None: as far as the body's horizon
    volume_correction : False: a kernel that goes to 0 at its end needs none
    """

    name = "linear"
    by_numbers = False
    volume_correction = False

    def __init__(self, micromodulus, cutoff: float | None = None, volume_correction: bool = False):
        if not (callable(micromodulus) or isinstance(micromodulus, BondSprings | Micromodulus)):
            raise AtcError(
                f"linear: micromodulus must be a function of the bond vectors (b, 3), got {type(micromodulus).__name__}"
            )
        self.micromodulus, self.cutoff, self.volume_correction = micromodulus, cutoff, bool(volume_correction)

    def lame(self, body):
        raise AtcError("linear: a micromodulus tensor is no isotropic elastic law")

    def contact_micromodulus(self, body):
        raise AtcError("linear: this material knows no contact")


class LinearModel(ForceModel):
    """Springs S_b = C(ξ) ν V_i V_j, one a bond."""

    def __init__(self, body, materials, crew, rules=None, lammps_compat=False, interfaces=None):
        super().__init__(body, materials, crew, rules, lammps_compat)
        if self.rule.active:
            raise AtcError("linear: bonds of this material do not break: leave damage out")
        if len(materials) > 1 or interfaces:
            raise AtcError("linear: a body of this material has one material and no interfaces")
        t, first = self.table, self.first
        law = first.micromodulus
        if isinstance(law, BondSprings):
            self.S_bcc = np.array(law.springs(body), float)
        else:
            self.S_bcc = self._sampled(law.kernel if isinstance(law, Micromodulus) else law)
        if self.S_bcc.shape != (len(t), 3, 3):
            raise AtcError(
                f"linear: micromodulus gave shape {self.S_bcc.shape} for {len(t)} bonds, expected ({len(t)}, 3, 3)"
            )
        if first.cutoff is not None:
            self.S_bcc[t.r0_b > first.cutoff] = 0.0
        if np.abs(self.S_bcc - self.S_bcc.swapaxes(1, 2)).max(initial=0.0) > 1e-10 * np.abs(self.S_bcc).max(
            initial=0.0
        ):
            raise AtcError(
                "linear: the micromodulus must be a symmetric tensor, or the body would gain energy in cycles"
            )
        if isinstance(law, Micromodulus):
            _require_moduli(body, self.S_bcc, law)
        self._i_b = t.i_b
        self._image_b = t.image_b.astype(np.int64) if len(t.image_b) else np.zeros(len(t), np.int64)

    def _sampled(self, micromodulus):
        """(b, 3, 3) C(ξ) ν V_i V_j."""
        W = self.weights()
        xi_bc = self.table.xi_bc(self.body.X_nc)
        out = [np.zeros((0, 3, 3))]
        for a in range(0, len(W), _AT_ONCE):
            part = slice(a, a + _AT_ONCE)
            C = np.asarray(micromodulus(xi_bc[part]), float)
            if C.shape != (len(xi_bc[part]), 3, 3):
                raise AtcError(
                    f"linear: micromodulus gave shape {C.shape} for {len(xi_bc[part])} bonds, expected "
                    f"({len(xi_bc[part])}, 3, 3)"
                )
            out.append(C * W[part, None, None])
        return np.concatenate(out)

    def forces(self, z, intact_b, F_nc, smin_n, damage: bool):
        # One thread, bonds in their order: the same to the last bit for any number of threads.
        _pull(self._i_b, self.table.j_b, self._image_b, self.images, self.S_bcc, z, F_nc)
        return 0, 0.0, None

    def energy_n(self, z, intact_b):
        i, j, eta_bc, *_ = deformed(self, z)
        half = 0.25 * np.einsum("bi,bij,bj->b", eta_bc, self.S_bcc, eta_bc)
        return self.at_ends(i, j, half)

    def forces_of_bonds(self, z, intact_b, bonds) -> BondForces:
        i, j, eta_bc, xi_bc, *_ = deformed(self, z, bonds)
        F_bc = np.einsum("bij,bj->bi", self.S_bcc[bonds], eta_bc)
        return BondForces(i, j, -(xi_bc + eta_bc), -xi_bc, F_bc, None, np.asarray(bonds))

    def stiffness_n(self):
        # Gershgorin, block by block: ω² m ≤ 2 Σ_j |S_ij|.
        size = np.concatenate(
            [
                np.abs(np.linalg.eigvalsh(s)).max(axis=1)
                for s in np.array_split(self.S_bcc, max(1, len(self.S_bcc) // _AT_ONCE))
            ]
        )
        return self.table.sums(size)


Linear.model = LinearModel


def _require_moduli(body, S_bcc, kernel):
    """Hold the stiffness of long waves, as the node with the largest family has it, to the kernel's own."""
    t = body.bonds
    count = t.sums(np.ones(len(t)))
    node = int(np.argmax(count))
    # A bond of a node with its own image belongs to it twice.
    ends = (t.i_b == node).astype(int) + (t.j_b == node)
    mine = ends > 0
    xi, S = t.xi_bc(body.X_nc)[mine], S_bcc[mine] * ends[mine, None, None]
    mass = body.rho_n[node] * body.V_n[node]

    check_moduli(lambda k_kc: dynamical_matrix(k_kc, xi, S, mass), kernel, body.spacing)


@njit(**JIT)
def _pull(i_b, j_b, image_b, images, S_bcc, z, F_nc):
    F_nc[:] = 0.0
    for b in range(len(i_b)):
        i, j, t = i_b[b], j_b[b], image_b[b]
        e0 = z[j, 0] - z[i, 0] + images[t, 3]
        e1 = z[j, 1] - z[i, 1] + images[t, 4]
        e2 = z[j, 2] - z[i, 2] + images[t, 5]
        for c in range(3):
            f = S_bcc[b, c, 0] * e0 + S_bcc[b, c, 1] * e1 + S_bcc[b, c, 2] * e2
            F_nc[i, c] += f
            F_nc[j, c] -= f
