"""The slab correction of Ewald sums: energy and forces of the dipole moment of the cell (Yeh and Berkowitz 1999)."""

from __future__ import annotations

from math import pi

import numpy as np


class Sheet:
    """The slab correction of one frame: every pair of charges has an energy −(2πC/V) q_i q_j z_ij², half of it each
    one's; together 2πC M²/V.

    q_n, z_n : charges, and their z, here relative to the mean of theirs
    """

    def __init__(self, q_n, z_n, constant: float, volume: float):
        self.q_n, charged = q_n, q_n != 0.0
        self.z_n = z_n - (z_n[charged].mean() if charged.any() else 0.0)
        #: 4πC/V
        self.k = 4 * pi * constant / volume
        self.M, self.square = float(q_n @ self.z_n), float(q_n @ self.z_n**2)

    @property
    def energy(self) -> float:
        return 0.5 * self.k * self.M**2

    def energies_n(self) -> np.ndarray:
        return 0.5 * self.k * self.q_n * (self.z_n * self.M - 0.5 * self.square)

    def virials_n6(self) -> np.ndarray:
        """xx, yy, zz, yz, xz, xy: the energy goes with z²/V."""
        return self.energies_n()[:, None] * np.array([-1.0, -1.0, 1.0, 0.0, 0.0, 0.0])

    def potential_rate_n(self, v_nc) -> np.ndarray:
        """∂Φ/∂t at the charges, Φ = (4πC/V)(M z − ½ Σ q z²)."""
        J, P = float(self.q_n @ v_nc[:, 2]), float(self.q_n @ (self.z_n * v_nc[:, 2]))
        return self.k * (J * self.z_n - P)
