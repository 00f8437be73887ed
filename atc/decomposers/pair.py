"""All pair interactions of a model in one sweep over the neighbour list: the styles, their cutoffs by type, special-bond weights.

A pair style is an object that adds its U(d) and G = U'(d)/d to a chunk of pairs. Any number of styles share one list, so that
``hybrid/overlay`` and composite styles (lj/cut/coul/cut) cost one search.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from ..bonds import Bonds
from ..errors import AtcError
from ..frame import Frame
from ..neighbors import CellList
from .base import Accumulator, Term, Work


class PairStyle:
    """One functional form with its coefficients for every pair of types.

    Subclasses fill `table`, (n_types + 1, n_types + 1, m) float64 in internal units, indexed by LAMMPS types from 1, whose column 0 is the
    squared cutoff (0 where the style does not act), and implement `add`.
    """

    name = ""
    table: np.ndarray
    needs_charges = False
    #: which special_bonds weight applies: "lj" or "coul"
    weight = "lj"

    @property
    def cutoff(self) -> float:
        return float(np.sqrt(self.table[..., 0].max()))

    @property
    def n_types(self) -> int:
        return len(self.table) - 1

    def prepare(self, frame: Frame):
        """Per-frame data for `add` (charges, self terms); None by default."""
        return None

    def self_energy(self, frame: Frame):
        """(n,) energies that atoms have by themselves (coul/dsf, coul/wolf), or None."""
        return None

    def add(self, types, i, j, d2, weights, U, G, prepared) -> None:
        """Add this style's energy and G to U and G (all (b,)). `weights` is (b,) special-bond factors or None for all 1."""
        raise NotImplementedError


class Pairs(Term):
    """The pair term of a potential.

    Parameters
    ----------
    styles : list of PairStyle
    n_types : int
    special : object with ``prepare(frame)`` giving per-frame special-bond weights, or None (see special_bonds)
    grow : function n_types → list of PairStyle for a frame with more types than `n_types`, or None if there is no more to know
    """

    pairwise = True

    def __init__(self, styles, n_types: int, special=None, grow=None):
        self.styles = list(styles)
        self.n_types = n_types
        self.special = special
        self.grow = grow
        self.cutoff = max((s.cutoff for s in self.styles), default=0.0)
        if not self.cutoff > 0:
            raise AtcError("the pair styles have no interaction: every cutoff is 0")
        self._grown: dict[int, Pairs] = {}

    def describe(self) -> str:
        return "pair " + " + ".join(s.name for s in self.styles) + ", energy shared half to each atom"

    def prepare(self, frame: Frame) -> Work:
        top = int(frame.types.max()) if len(frame) else 0
        if top > self.n_types:
            if self.grow is None:
                raise AtcError(
                    f"{frame.source}: atoms of type {top} but the pair coefficients cover types 1 to {self.n_types}: add a pair_coeff line for it"
                )
            if top not in self._grown:
                try:
                    self._grown[top] = Pairs(self.grow(top), top, self.special)
                except AtcError as e:
                    raise AtcError(f"{frame.source} has atoms of type {top}; {e}") from None
            return self._grown[top].prepare(frame)
        if len(frame) and frame.types.min() < 1:
            raise AtcError(f"{frame.source}: atom types must be 1 or larger, found {int(frame.types.min())}")
        if any(s.needs_charges for s in self.styles):
            frame.require("charges", why="a coulomb pair style")
        return _PairWork(self, frame)


class _PairWork(Work):
    def __init__(self, term: Pairs, frame: Frame):
        self.term = term
        self.frame = frame
        self.types = frame.types.astype(np.int32)
        self.list = CellList(frame.positions, frame.cell, term.cutoff)
        self.prepared = [s.prepare(frame) for s in term.styles]
        self.special = term.special.prepare(frame) if term.special is not None else None
        self.stages = (self.list.n_chunks,)

    def run(self, stage, task, acc: Accumulator):
        term, ws = self.term, acc.ws
        if task == 0:
            for s in term.styles:
                e = s.self_energy(self.frame)
                if e is not None:
                    acc.energy += float(e.sum())
                    if acc.energies is not None:
                        acc.energies += e
        n = self.list.half(task, ws)
        i, j, r, d2, U, G = ws.i[:n], ws.j[:n], ws.r[:n], ws.d2[:n], ws.U[:n], ws.G[:n]
        U[:] = 0.0
        G[:] = 0.0
        weights = self.special.weights(i, j, r) if self.special is not None else None
        for s, prepared in zip(term.styles, self.prepared, strict=True):
            s.add(self.types, i, j, d2, None if weights is None else weights[s.weight], U, G, prepared)
        energy, zeros, bad = _collect(i, j, d2, U, G, acc.energies if acc.energies is not None else _NOTHING)
        if bad >= 0:
            a, b = self.frame.ids[i[bad]], self.frame.ids[j[bad]]
            if d2[bad] == 0.0:
                raise AtcError(
                    f"{self.frame.source}: atoms {a} and {b} are at the same place, where the pair force is undefined; remove one of them"
                )
            raise AtcError(
                f"{self.frame.source}: the pair force between atoms {a} and {b} at distance {d2[bad] ** 0.5:.3g} is not a finite number"
            )
        acc.energy += energy
        # Only worth a copy where different cutoffs by type leave many idle pairs.
        if zeros > 0.05 * n:
            n = _compact(i, j, r, G)
            return Bonds(i[:n], j[:n], r[:n], G[:n])
        return Bonds(i, j, r, G)


_NOTHING = np.zeros(0)


@njit(cache=True, nogil=True, error_model="numpy")
def _collect(i, j, d2, U, G, energies):
    """Sum the energies (half to each atom), count pairs without force, find the first pair that is not finite (−1: none)."""
    total = 0.0
    zeros = 0
    bad = -1
    shared = len(energies) > 0
    for b in range(len(U)):
        u = U[b]
        total += u
        if G[b] == 0.0:
            zeros += 1
        if not np.isfinite(G[b] + u):
            if bad < 0:
                bad = b
        if shared:
            energies[i[b]] += 0.5 * u
            energies[j[b]] += 0.5 * u
    return total, zeros, bad


@njit(cache=True, nogil=True, error_model="numpy")
def _compact(i, j, r, G):
    n = 0
    for b in range(len(G)):
        if G[b] != 0.0:
            i[n] = i[b]
            j[n] = j[b]
            r[n, 0] = r[b, 0]
            r[n, 1] = r[b, 1]
            r[n, 2] = r[b, 2]
            G[n] = G[b]
            n += 1
    return n
