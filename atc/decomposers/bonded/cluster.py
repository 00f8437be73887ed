"""Terms of K atoms that are listed one by one (torsions, impropers, whatever a user lists): from G of their distances
to bonds and sources."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ..base import Accumulator, Term, Work
from ..images import Images
from ..many_body.neighbor_work import made, room, shares

TERMS_PER_TASK = 4096


def weights_of(partition, k: int, names: dict, what: str) -> tuple[np.ndarray, str]:
    """The fractions of a K-body term's energy given to its atoms, and words for them.

    partition : "equal" (1/K each), one of `names` = {name: (weights, words)}, or K numbers that add up to 1
    """
    if isinstance(partition, str):
        known = {"equal": ((1.0 / k,) * k, f"energy shared 1/{k} to each atom"), **names}
        if partition not in known:
            raise AtcError(
                f"{what}: partition {partition!r}: expected one of {', '.join(map(repr, known))}, or {k} numbers that "
                "add up to 1"
            )
        w, words = known[partition]
        return np.array(w, float), words
    w = np.array(partition, float)
    if w.shape != (k,) or not abs(w.sum() - 1.0) <= 1e-12:
        raise AtcError(f"{what}: a partition is {k} numbers that add up to 1, got {partition!r}")
    return w, "energy shared " + " : ".join(f"{v:.6g}" for v in w) + " among its atoms"


def first_true(bad_t) -> int:
    """The number of the first that is true, −1 if none is."""
    return int(np.argmax(bad_t)) if bad_t.any() else -1


def first_not_finite(U, G) -> int:
    """The first tuple whose energy (m,) or G (m, pairs) is not finite, or −1."""
    if np.isfinite(U).all() and np.isfinite(G).all():
        return -1
    return first_true(~(np.isfinite(U) & np.isfinite(G).all(axis=1)))


class ClusterTerm(Term):
    """A term whose tuples of atoms are known beforehand. Subclasses give the tuples and G of their distances.

    `bodies` is K; `weights` (K,) the fraction of a tuple's energy that each of its atoms has.
    """

    bodies: int
    weights: np.ndarray
    #: the atom of a tuple that the positions of the others are relative to
    origin = 0

    def terms_of(self, frame: Frame) -> tuple[np.ndarray, np.ndarray]:
        """(m, K) int32 indices of atoms and (m,) int32 types."""
        raise NotImplementedError

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        """Fill U (m,) and G (m, K(K−1)/2), pairs ordered 12, 13, .., 1K, 23, ..; return the first tuple without a
        finite answer, or −1.

        x_tkc : (m, K, 3) positions of each tuple's atoms relative to its `origin`
        """
        raise NotImplementedError

    def complaint(self, frame: Frame, atoms_k, kind: int, x_kc) -> str:
        """What to say of a tuple of type `kind` without a finite answer."""
        names = ", ".join(str(i) for i in frame.ids[atoms_k])
        return (
            f"{self.describe().split(',')[0]} of the atoms {names} has no finite energy and forces: are two of them at "
            "the same place?"
        )

    def prepare(self, frame: Frame) -> Work:
        return ClusterWork(self, frame)


class ClusterWork(Work):
    """One frame: its tuples, in chunks."""

    def __init__(self, term: ClusterTerm, frame: Frame):
        self.term, self.frame = term, frame
        self.atoms, self.types = term.terms_of(frame)
        self.images = Images(frame.cell)
        self.weights = term.weights
        self.stages = (-(-len(self.atoms) // TERMS_PER_TASK),)

    def run(self, stage, task, acc: Accumulator):
        part = slice(task * TERMS_PER_TASK, (task + 1) * TERMS_PER_TASK)
        atoms, types = self.atoms[part], self.types[part]
        n, k = atoms.shape
        x = self.positions(atoms)
        U, G = np.empty(n), np.empty((n, k * (k - 1) // 2))
        bad = self.evaluate(atoms, x, types, U, G, acc)
        if bad >= 0:
            why = self.term.complaint(self.frame, atoms[bad], int(types[bad]), x[bad])
            raise AtcError(f"{self.frame.source}: {why}")
        acc.energy += float(U.sum())
        out = room(acc, G.size)
        return made(acc, out, cluster_bonds(atoms, x, U, G, self.weights, *out, shares(acc)))

    def evaluate(self, atoms, x, types, U, G, acc) -> int:
        """As `ClusterTerm.evaluate`, for works that need to know the atoms."""
        return self.term.evaluate(x, types, U, G, acc)

    def positions(self, atoms) -> np.ndarray:
        """(m, K, 3) relative to each tuple's `origin`; every atom at the image closest to the one before it. (LAMMPS
        takes the images closest to the tuple's second atom: others only in a box less than twice as wide as its
        tuples.)"""
        x = np.zeros((*atoms.shape, 3))
        step = np.empty((len(atoms), 3))
        for k in range(1, atoms.shape[1]):
            self.images.vectors_to(
                self.frame.positions, np.ascontiguousarray(atoms[:, k]), np.ascontiguousarray(atoms[:, k - 1]), step
            )
            for c in range(3):  # numpy is slow along axes of three
                if k <= self.term.origin:
                    x.T[c, :k] -= step[:, c]
                else:
                    np.add(x[:, k - 1, c], step[:, c], out=x[:, k, c])
        return x


@njit(cache=True, nogil=True, error_model="numpy")
def cluster_bonds(atoms, x, U, G, weights, out_i, out_j, out_r, out_G, out_D, energies):
    """Bonds of K-body terms with fixed shares w_p: D between p and q is ∂U^(p)/∂x_q = w_p ∂U/∂x_q, and the same with p
    and q exchanged."""
    k = atoms.shape[1]
    sources = len(out_D) > 0
    shared = len(energies) > 0
    grad = np.empty((k, 3))
    m = 0
    for t in range(len(U)):
        if shared:
            for p in range(k):
                energies[atoms[t, p]] += weights[p] * U[t]
        if sources:
            for p in range(k):
                for c in range(3):
                    grad[p, c] = 0.0
            e = 0
            for p in range(k):
                for q in range(p + 1, k):
                    for c in range(3):
                        f = G[t, e] * (x[t, p, c] - x[t, q, c])
                        grad[p, c] += f
                        grad[q, c] -= f
                    e += 1
        e = 0
        for p in range(k):
            for q in range(p + 1, k):
                g = G[t, e]
                out_i[m], out_j[m], out_G[m] = atoms[t, p], atoms[t, q], g
                keep = g != 0.0
                for c in range(3):
                    out_r[m, c] = x[t, p, c] - x[t, q, c]
                    if sources:
                        out_D[m, 0, c] = weights[p] * grad[q, c]
                        out_D[m, 1, c] = weights[q] * grad[p, c]
                        keep = keep or out_D[m, 0, c] != 0.0 or out_D[m, 1, c] != 0.0
                m += 1 if keep else 0
                e += 1
    return m
