"""Displacements relative to a reference frame, summed over atoms and their periodic images in a cell that may have
deformed.

Where the cell deforms, the displacement of an atom's image differs from that of the atom: u is then not periodic, and a
sum over images needs it for each of them. With x = F(X − O) + O + u' (F the deformation of the periodic edges, O the
reference cell's origin; u' is the same for all images), u of the image at x is (x − O)(I − F⁻¹) + u' F⁻¹ and u of the
image whose reference position is X is (X − O)(F − I) + u' (row vectors). The part that grows with position is carried
by the first moment Σ m (x_j − x) φ_j: nothing is approximated.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .sources import cells_moved, same_atoms


class Displacement:
    """u_j = x_j − X_j of a frame relative to a reference, ready for mass-weighted sums over one of the two
    configurations.

    Parameters
    ----------
    frame, reference : Frame, the same atoms; re-wrapped atoms are followed by image flags, else by the nearest image
    on_reference : whether sums are over reference positions instead of current ones
    """

    def __init__(self, frame, reference, on_reference: bool):
        same_atoms(frame, reference)
        H0, H = (
            reference.cell.vectors,
            np.where(frame.cell.periodic[:, None], frame.cell.vectors, reference.cell.vectors),
        )
        self.origin = reference.cell.origin
        F = np.eye(3) if np.array_equal(H0, H) else reference.cell.inverse @ H
        X = reference.positions
        x = frame.positions - cells_moved(frame, reference) @ frame.cell.vectors
        u_nc = x - X - (X - self.origin) @ (F - np.eye(3))
        if on_reference:
            self.map, self.periodic_nc = F - np.eye(3), u_nc
        else:
            inverse = np.linalg.inv(F)
            self.map, self.periodic_nc = np.eye(3) - inverse, u_nc @ inverse
        self.affine = bool(self.map.any())
        # A displacement of all together has no gradient, however its sums are taken.
        m_n = frame.masses
        self.mean = m_n @ self.periodic_nc / m_n.sum() if m_n.sum() > 0 else np.zeros(3)

    def gather(self, deposits, x_nc, m_n, extra_nk, gradient, key="gather"):
        """Sums at some points.

        Parameters
        ----------
        deposits : `deposits.Deposits`, or bins of a slab
        x_nc : positions of the configuration that is summed over
        m_n : masses
        extra_nk : (n, k) more factors
        gradient : whether the sums with the kernel's gradient are wanted
        key : the deposit they are, see `methods`

        Returns
        -------
        values : (g, 1 + 3 + k) Σ m φ, Σ m u φ, Σ extra φ
        gradients : (g, 1 + 3 + k, 3) the same with ∂φ/∂x, or None
        """
        if self.affine and deposits.bound.kind == "slab":
            raise AtcError(
                "displacement: the cell has deformed since the reference, so that it has no average over a slab: use "
                "a line or a regular grid"
            )
        a_nk = np.concatenate([m_n[:, None], m_n[:, None] * (self.periodic_nc - self.mean), extra_nk], axis=1)
        values, gradients = deposits.gather(x_nc, a_nk, m_n if self.affine else None, gradient, key)
        values[:, 1:4] += values[:, :1] * self.mean
        if gradient:
            gradients[:, 1:4] += gradients[:, :1] * self.mean[:, None]
        if self.affine:
            k = a_nk.shape[1]
            at_gc = deposits.points_gc - self.origin
            values, moment = values[:, :k].copy(), values[:, k:]
            values[:, 1:4] += (values[:, :1] * at_gc + moment) @ self.map
            if gradient:
                gradients, moment = gradients[:, :k].copy(), gradients[:, k:]
                # [g, component of x_j, direction of the derivative]
                of_position = at_gc[:, :, None] * gradients[:, :1] + moment
                gradients[:, 1:4] += np.einsum("gkc,kl->glc", of_position, self.map)
        return values, gradients


def quotient_gradient(weight_g, mean_gk, gradient_g1c, gradient_gkc) -> np.ndarray:
    """(g, c, k) ∂_c of a mean Σ w a φ / Σ w φ, from its value and the sums with ∂φ/∂x; 0 where the weight is."""
    top = np.swapaxes(gradient_gkc, 1, 2) - np.swapaxes(gradient_g1c, 1, 2) * mean_gk[:, None, :]
    w = weight_g[:, None, None]
    return np.divide(top, w, out=np.zeros_like(top), where=w > 0)


def eshelby(energy_g, piola_gcc, displacement_gradient_gcc) -> np.ndarray:
    """W I − P (Grad u)ᵀ with piola[i, k] and gradient[j, k] = ∂u_k/∂X_j: component [i, j], i the direction of the
    divergence."""
    out = -np.einsum("gik,gjk->gij", piola_gcc, displacement_gradient_gcc)
    out[:, range(3), range(3)] += energy_g[:, None]
    return out
