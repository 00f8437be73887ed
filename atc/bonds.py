"""Bonds: pairs of atoms with their generalised force, the one thing decomposers hand to estimators."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_OPTIONAL = ("D_bdc", "F_bc", "P_b")


@dataclass
class Bonds:
    """Unordered pairs of atoms through a definite periodic image, each with G = ∂U/∂ξ, ξ = |r|²/2 (formulas: R
    4.0.34-4.0.47).

    A pair may occur more than once (several interactions share it, or several images): sums over bonds are what has
    meaning.

    Attributes
    ----------
    i, j : (b,) int32, atom indices
    r_bc : (b, 3) x_i − x_j through the bond: the bond runs from positions[i] to positions[i] − r. Never re-wrapped.
    G_b : (b,) energy/length². The force on i is −G r, on j +G r. G > 0 attracts.
    F_bc : (b, 3) or None. The force on i due to j where it does not act along the bond (non-ordinary peridynamics; −F
        on j). None: −G r.
    D_bdc : (b, 2, 3) or None. The directed energy sources of the bond, only made when asked for: D[:, 0] = ∂U^(i)/∂x_j
        and D[:, 1] = ∂U^(j)/∂x_i,
        where U^(i) is the share of the potential energy given to atom i (R 4.0.114-4.0.125). What heat flux and
        churning are made of.
    P_b : (b,) or None. Power from j to i along the bond beyond v_j·D[:, 0] − v_i·D[:, 1]: what messages carry in models
        where the energy of an atom depends on more than its own neighbours. 0 in uniform motion. None: there is none.
    """

    i: np.ndarray
    j: np.ndarray
    r_bc: np.ndarray
    G_b: np.ndarray
    D_bdc: np.ndarray | None = None
    F_bc: np.ndarray | None = None
    P_b: np.ndarray | None = None

    def __len__(self):
        return len(self.G_b)

    def taken(self, k) -> Bonds:
        """Some of the bonds: `k` is what numpy takes for one axis, copies of it unless a slice."""
        more = {name: a[k] for name in _OPTIONAL if (a := getattr(self, name)) is not None}
        return Bonds(self.i[k], self.j[k], self.r_bc[k], self.G_b[k], **more)

    def copy(self) -> Bonds:
        more = {name: a.copy() for name in _OPTIONAL if (a := getattr(self, name)) is not None}
        return Bonds(self.i.copy(), self.j.copy(), self.r_bc.copy(), self.G_b.copy(), **more)

    def forces(self) -> np.ndarray:
        """(b, 3) the force on i due to j."""
        return -self.G_b[:, None] * self.r_bc if self.F_bc is None else self.F_bc

    def powers(self) -> np.ndarray:
        """P_b, or no numbers at all if there is none: what compiled functions take."""
        return np.zeros(0) if self.P_b is None else self.P_b

    def virial(self) -> np.ndarray:
        """Σ G r⊗r = −Σ r⊗F, (3, 3): the integral of Hardy's potential stress over the box (energy; tension
        positive)."""
        if self.F_bc is not None:
            return -self.r_bc.T @ self.F_bc
        return np.einsum("b,bi,bj->ij", self.G_b, self.r_bc, self.r_bc)

    @classmethod
    def empty(cls) -> Bonds:
        return cls(np.zeros(0, np.int32), np.zeros(0, np.int32), np.zeros((0, 3)), np.zeros(0))

    @classmethod
    def concatenate(cls, parts) -> Bonds:
        parts = list(parts)
        if not parts:
            return cls.empty()
        joined = cls(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("i", "j", "r_bc", "G_b")))
        if all(p.D_bdc is not None for p in parts):
            joined.D_bdc = np.concatenate([p.D_bdc for p in parts])
        if any(p.F_bc is not None for p in parts):
            joined.F_bc = np.concatenate([p.forces() for p in parts])
        if any(p.P_b is not None for p in parts):
            joined.P_b = np.concatenate([np.zeros(len(p)) if p.P_b is None else p.P_b for p in parts])
        return joined
