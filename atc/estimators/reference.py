"""A frame and its reference: displacements, summed over atoms and their periodic images in a cell that may have
deformed, and bonds carried to the reference.

Where the cell deforms, the displacement of an atom's image differs from that of the atom: u is then not periodic, and a
sum over images needs it for each of them. With x = F(X − O) + O + u' (F the deformation of the periodic edges, O the
reference cell's origin; u' is the same for all images), u of the image at x is (x − O)(I − F⁻¹) + u' F⁻¹ and u of the
image whose reference position is X is (X − O)(F − I) + u' (row vectors). The part that grows with position is carried
by the first moment Σ m (x_j − x) φ_j: nothing is approximated.
"""

from __future__ import annotations

import numpy as np

from ..errors import AtcError


def same_atoms(frame, reference) -> None:
    """Raise unless both frames hold the same atoms and repeat along the same axes."""
    if not np.array_equal(frame.ids, reference.ids):
        raise AtcError(
            f"{frame.source}: its atom ids are not those of the reference frame ({reference.source}): what refers to "
            "a reference needs the same atoms in both"
        )
    if not np.array_equal(frame.cell.periodic, reference.cell.periodic):
        raise AtcError(f"{frame.source}: its periodic axes are not those of the reference frame ({reference.source})")


def cells_moved(frame, reference) -> np.ndarray:
    """(n, 3) whole cells by which each atom must be moved back to continue its reference position: x − moved @ vectors.

    By image flags where both frames have them, else by the rounded difference of fractional coordinates, which is right
    while no atom has moved more than half a cell relative to the deforming cell.
    """
    if frame.images is not None and reference.images is not None:
        moved = reference.images - frame.images
    else:
        moved = np.rint(frame.cell.fractional(frame.positions) - reference.cell.fractional(reference.positions))
    return np.where(frame.cell.periodic, moved, 0.0)


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


class ReferenceBonds:
    """Current bonds carried to the reference configuration, through the same periodic image.

    The image of a bond is n = round((x_i − x_j − r) H⁻¹) in the current cell H. Atoms that were re-wrapped since the
    reference differ from it by whole cells: by their image flags where both frames have them, else by the rounded
    difference of fractional coordinates (right while no atom has moved more than half a cell relative to the deforming
    cell).

    Source: first Piola-Kirchhoff as in formulas.md §4-5: the same bond sum with reference positions in β and in the
    first index.
    """

    def __init__(self, frame, reference):
        same_atoms(frame, reference)
        self.x_nc, self.X_nc = frame.positions, reference.positions
        self.inverse, self.H = frame.cell.inverse, reference.cell.vectors
        self.periodic = frame.cell.periodic
        # x_n − moved @ H is the atom unwrapped so that it continues its reference position.
        self.moved_nc = cells_moved(frame, reference)

    def of(self, index):
        """The same for particles that are (copies of) these atoms."""
        from copy import copy

        new = copy(self)
        new.x_nc, new.X_nc, new.moved_nc = self.x_nc[index], self.X_nc[index], self.moved_nc[index]
        return new

    def bonds(self, bonds):
        """(b, 3) reference positions of the ends i and (b, 3) reference bond vectors X_i − X_j through the bond's
        image."""
        i, j = bonds.i, bonds.j
        shift = np.rint((self.x_nc[i] - self.x_nc[j] - bonds.r_bc) @ self.inverse)
        shift -= self.moved_nc[i] - self.moved_nc[j]
        shift[:, ~self.periodic] = 0.0
        X_bc = self.X_nc[i]
        return X_bc, X_bc - self.X_nc[j] - shift @ self.H


def piola_factor(bonds, R_bc) -> np.ndarray:
    """(b, 9) −R⊗F, row-major: the first index belongs to the reference bond R, the second to the force −G r."""
    if bonds.F_bc is not None:
        return -(R_bc[:, :, None] * bonds.F_bc[:, None, :]).reshape(-1, 9)
    return (bonds.G_b[:, None, None] * R_bc[:, :, None] * bonds.r_bc[:, None, :]).reshape(-1, 9)
