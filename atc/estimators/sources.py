"""The per-atom factors a_j of the site sums and the bond factors b that need more than r and G."""

from __future__ import annotations

import numpy as np

from ..errors import AtcError
from .sums import outer6


def drift_velocity(frame) -> np.ndarray:
    """(3,) mass-mean velocity of the frame.

    Taken relative to one atom's velocity first, so that a drift large against the thermal velocity costs no digits of the mean.
    """
    if not len(frame):
        return np.zeros(3)
    v0 = frame.velocities[0]
    m = frame.masses
    total = m.sum()
    return v0 + (m @ (frame.velocities - v0)) / total if total > 0 else v0.copy()


class AtomFactors:
    """The columns of the site sums, (n, width) each, made when asked for and kept."""

    def __init__(self, frame, drift, energies_n=None, atom_virial_n6=None):
        self.frame, self.drift = frame, drift
        self.energies_n, self.atom_virial_n6 = energies_n, atom_virial_n6
        self._kept: dict[str, np.ndarray] = {}

    @property
    def peculiar_nc(self) -> np.ndarray:
        """Velocities relative to the frame's drift."""
        if "peculiar" not in self._kept:
            self._kept["peculiar"] = self.frame.velocities - self.drift
        return self._kept["peculiar"]

    def __getitem__(self, name: str) -> np.ndarray:
        if name not in self._kept:
            self._kept[name] = getattr(self, f"_{name}")()
        return self._kept[name]

    def columns(self, names) -> np.ndarray:
        """(n, k) the named factors side by side."""
        return np.ascontiguousarray(np.concatenate([self[name] for name in names], axis=1))

    def _one(self):
        return np.ones((len(self.frame), 1))

    def _mass(self):
        return self.frame.masses[:, None].copy()

    def _momentum(self):
        return self["mass"] * self.peculiar_nc

    def _kinetic(self):
        return self["mass"] * outer6(self.peculiar_nc)

    def _kinetic_energy(self):
        return 0.5 * self["mass"] * np.einsum("nc,nc->n", self.frame.velocities, self.frame.velocities)[:, None]

    def _potential_energy(self):
        return self.energies_n[:, None]

    def _atom_virial(self):
        return self.atom_virial_n6


class AtomVirial:
    """Per-atom virial ½ Σ G r⊗r, half of each bond to each end, gathered while bonds stream by; one buffer a thread."""

    def __init__(self, n: int, threads: int):
        from ._numba import scatter_virial

        self._scatter = scatter_virial
        self._buffers = [np.zeros((n, 6)) for _ in range(threads)]

    def add(self, bonds, thread: int) -> None:
        self._scatter(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, self._buffers[thread])

    def total(self) -> np.ndarray:
        """(n, 6), energy, tension positive."""
        out = self._buffers[0]
        for other in self._buffers[1:]:
            out += other
        return out


class ReferenceBonds:
    """Current bonds carried to the reference configuration, through the same periodic image.

    The image of a bond is n = round((x_i − x_j − r) H⁻¹) in the current cell H. Atoms that were re-wrapped since the reference
    differ from it by whole cells: by their image flags where both frames have them, else by the rounded difference of fractional
    coordinates (right while no atom has moved more than half a cell relative to the deforming cell).

    Source: first Piola-Kirchhoff as in formulas.md §4-5: the same bond sum with reference positions in β and in the first index.
    """

    def __init__(self, frame, reference):
        if not np.array_equal(frame.ids, reference.ids):
            raise AtcError(
                f"{frame.source}: its atom ids are not those of the reference frame ({reference.source}): piola_stress needs the same atoms in both"
            )
        if not np.array_equal(frame.cell.periodic, reference.cell.periodic):
            raise AtcError(f"{frame.source}: its periodic axes are not those of the reference frame ({reference.source})")
        self.x_nc, self.X_nc = frame.positions, reference.positions
        self.inverse, self.H = frame.cell.inverse, reference.cell.vectors
        self.periodic = frame.cell.periodic
        if frame.images is not None and reference.images is not None:
            moved = reference.images - frame.images
        else:
            moved = np.rint(frame.cell.fractional(frame.positions) - reference.cell.fractional(reference.positions))
        # x_n − moved @ H is the atom unwrapped so that it continues its reference position.
        self.moved_nc = np.where(self.periodic, moved, 0.0)

    def bonds(self, bonds):
        """(b, 3) reference positions of the ends i and (b, 3) reference bond vectors X_i − X_j through the bond's image."""
        i, j = bonds.i, bonds.j
        shift = np.rint((self.x_nc[i] - self.x_nc[j] - bonds.r_bc) @ self.inverse)
        shift -= self.moved_nc[i] - self.moved_nc[j]
        shift[:, ~self.periodic] = 0.0
        X_bc = self.X_nc[i]
        return X_bc, X_bc - self.X_nc[j] - shift @ self.H


def piola_factor(bonds, R_bc) -> np.ndarray:
    """(b, 9) G R⊗r, row-major: the first index belongs to the reference bond R, the second to the force −G r."""
    return (bonds.G_b[:, None, None] * R_bc[:, :, None] * bonds.r_bc[:, None, :]).reshape(-1, 9)
