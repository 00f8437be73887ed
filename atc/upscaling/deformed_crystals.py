"""Many copies of one crystal, each under a homogeneous deformation and inner displacements of its own, evaluated by its
potential at once: one frame whose every atom sees the atoms of its own copy alone. Internal units."""

from __future__ import annotations

from itertools import product

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from ..neighbors.verlet import using
from .crystal import Crystal, evaluate, of_atc

#: Copies that are evaluated together.
_AT_ONCE = 2048


class DeformedCrystals:
    """Energies, forces and virials of copies of a crystal.

    Parameters
    ----------
    crystal : Crystal
    model : potential of `atc.potential`; or an ASE calculator, which is called copy by copy
    """

    def __init__(self, crystal: Crystal, model):
        self.crystal, self.model = crystal, model
        self.together = of_atc(model)
        if self.together and model.fields:
            raise AtcError(
                f"{crystal.name}: a crystal at many strains at once needs interactions with a cutoff, not long-range "
                "Coulomb"
            )
        self._lattice: dict = {}

    def __call__(self, F_ncc, u_nac=None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """(n,) energies, (n, atoms, 3) forces and (n, 3, 3) virials Σ G r⊗r of copies x = F X + u.

        F_ncc : (n, 3, 3). u_nac : (n, atoms, 3)
        """
        F = np.ascontiguousarray(F_ncc, float)
        u = np.zeros((len(F), len(self.crystal), 3)) if u_nac is None else np.asarray(u_nac, float)
        run = self._copies if self.together else self._one_by_one
        parts = [run(F[k : k + _AT_ONCE], u[k : k + _AT_ONCE]) for k in range(0, len(F), _AT_ONCE)]
        if not parts:
            return np.zeros(0), u, np.zeros((0, 3, 3))
        return tuple(np.concatenate(p) for p in zip(*parts))

    def _one_by_one(self, F_ncc, u_nac):
        made = [self.crystal.strained(F - np.eye(3), u).frame() for F, u in zip(F_ncc, u_nac)]
        return tuple(np.array(a) for a in zip(*(evaluate(self.model, frame) for frame in made)))

    def _copies(self, F_ncc, u_nac):
        n, m = len(F_ncc), len(self.crystal)
        x_nc = (self.crystal.positions @ F_ncc.swapaxes(1, 2) + u_nac).reshape(-1, 3)
        frame = self.crystal.copies(x_nc, Cell(np.zeros((3, 3)), periodic=False).completed(x_nc, margin=1.0))
        virial = np.zeros((n, 9))

        def add(bonds, _):
            copy = bonds.i // m
            pulls = bonds.forces()
            for c, (a, b) in enumerate(product(range(3), repeat=2)):
                virial[:, c] -= np.bincount(copy, bonds.r_bc[:, a] * pulls[:, b], n)

        with using((_Pairs(self, F_ncc, x_nc, frame.cell), np.zeros_like(x_nc))):
            d = self.model.stream(frame, add, energies=True, forces=True)
        return d.energies_n.reshape(n, m).sum(axis=1), d.forces_nc.reshape(n, m, 3), virial.reshape(n, 3, 3)

    def lattice(self, reach: float) -> np.ndarray:
        """(l, 3) lattice vectors up to a length, rounded up to whole shortest vectors."""
        size = np.linalg.norm(self.crystal.vectors, axis=1).min()
        key = int(np.ceil(reach / size))
        if key not in self._lattice:
            heights = 1 / np.linalg.norm(np.linalg.inv(self.crystal.vectors), axis=0)
            top = np.ceil(key * size / heights).astype(int)
            R = np.array(list(product(*(range(-t, t + 1) for t in top)))) @ self.crystal.vectors
            self._lattice[key] = R[np.linalg.norm(R, axis=1) <= key * size]
        return self._lattice[key]


class _Pairs:
    """The pairs of all copies within a cutoff, as `neighbors.verlet` keeps them."""

    def __init__(self, owner, F_ncc, x_nc, cell):
        self.owner, self.F_ncc, self.x_nc, self.cell = owner, F_ncc, x_nc, cell

    def kept(self, cutoff, who):
        if who is not None:
            raise AtcError(f"{self.owner.crystal.name}: every atom of a crystal must have interactions")
        n, m = len(self.F_ncc), len(self.owner.crystal)
        x_nac = self.x_nc.reshape(n, m, 3)
        within = np.linalg.norm(x_nac[:, :, None] - x_nac[:, None], axis=3).max()
        # |F R| is at least the smallest stretch times |R|.
        least = np.linalg.svd(self.F_ncc, compute_uv=False)[:, -1].min()
        if not least > 0.1:
            raise AtcError(f"{self.owner.crystal.name}: a crystal strained by {1 - least:.3g} is none any more")
        R = self.owner.lattice((cutoff + within) / least)
        return _Kept(x_nac, R @ self.F_ncc.swapaxes(1, 2), cutoff, self.cell)


class _Kept:
    def __init__(self, x_nac, R_nlc, cutoff, cell):
        n, m, _ = x_nac.shape
        # Half of all pairs: of two atoms through any image, of an atom and its own images through one of each ±R.
        forward = np.array([tuple(r) > (0.0, 0.0, 0.0) for r in R_nlc[0]])
        i, j, code, at = [], [], [], []
        for a in range(m):
            for b in range(a, m):
                d = x_nac[:, a, None] - x_nac[:, b, None] - R_nlc
                near = np.einsum("nlc,nlc->nl", d, d) < cutoff**2
                if a == b:
                    near &= forward
                k, l = np.nonzero(near)
                at.append(k)
                i.append(k * m + a)
                j.append(k * m + b)
                code.append(k * R_nlc.shape[1] + l)
        order = np.argsort(np.concatenate(at), kind="stable")
        i, j, code = (np.concatenate(v)[order].astype(np.int32) for v in (i, j, code))
        self.chunks = [(i, j, code, R_nlc.reshape(-1, 3))]
        self.order = np.arange(n * m, dtype=np.int32)
        self.list = self
        self.n, self.n_chunks, self.cell = n * m, 1, cell
        self.start, self.chunk_edges = np.array([0, n * m]), np.array([0, 1])
        self.x_sorted = x_nac.reshape(-1, 3)
