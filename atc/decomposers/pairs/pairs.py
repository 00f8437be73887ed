"""All pair interactions of a model in one sweep over the neighbour list: the styles, their cutoffs by type,
special-bond weights.

A pair style is an object that adds its U(d) and G = U'(d)/d to a chunk of pairs. Any number of styles share one list,
so that
``hybrid/overlay`` and composite styles (lj/cut/coul/cut) cost one search.
"""

from __future__ import annotations

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ...neighbors.verlet import cell_list
from ...units import units as get_units
from ..atom_columns import atom_columns
from ..base import Accumulator, Term, Work
from ..many_body.neighborhood import impossible
from ..registry import factor

#: Tables hold every pair of types.
MAX_TYPES = 1000
#: Stands for "all weights are 1" in kernels.
ONES = np.zeros(0)


class PairStyle:
    """One functional form with its coefficients for every pair of types.

    Subclasses fill `table`, (n_types + 1, n_types + 1, m) float64 in internal units, indexed by LAMMPS types from 1,
    whose column 0 is the squared cutoff (0 where the style does not act), and implement `add`.

    Those that are a formula of a few numbers for each pair of types also say which (`numbers`: name and dimension, the
    cutoff last), and turn arrays of them into the table (`fill`); they get a constructor from numbers in the user's
    units (`_take`) and from internal arrays (`internal`).
    """

    name = ""
    table: np.ndarray
    units = None
    needs_charges = False
    #: which special_bonds weight applies: "lj", "coul", or None: not weighted (but left out where all weights are 0)
    weight: str | None = "lj"
    #: whether a pair of weight 0 still has a term (damped Coulomb: the part that damping took away)
    keeps_excluded = False
    #: weights of its own (pair_modify special), beside those of special_bonds
    own_special: tuple = ()
    #: what a CHARMM torsion needs for the pairs at its ends (`one_four.OneFour`)
    one_four = None
    #: how a long-range style is split into bonds and modes (`long_range.split`); it has `at` then, for another split
    split = None
    #: of charges that sit on virtual sites: which (`tip4p.TIP4PLine`)
    water = None
    #: whether it acts on spins
    magnetic = False
    #: what its energies are multiplied by
    factor: float = 1.0
    numbers: tuple[tuple[str, object], ...] = ()

    @classmethod
    def internal(cls, *arrays, shift: bool = False):
        """From (n_types + 1, n_types + 1) arrays of `numbers`, internal units; cutoff 0 = no interaction."""
        style = cls.__new__(cls)
        style.fill(*(np.asarray(a, float) for a in arrays), shift=shift)
        return style

    def fill(self, *arrays, shift: bool) -> None:
        """Set `table`."""
        raise NotImplementedError

    def _take(self, values, units, n_types, shift) -> None:
        """From numbers, or (n, n) arrays for types 1..n, in the user's units."""
        from .input import as_matrix

        self.units = get_units(units)
        n = max([n_types or 1] + [len(a) for a in map(np.asarray, values) if a.ndim])
        cutoff = np.asarray(values[-1], float)
        if not ((cutoff >= 0).all() and (cutoff > 0).any() and np.isfinite(cutoff).all()):
            raise AtcError(f"{type(self).__name__}: the cutoff must be positive, got {values[-1]}")
        self.fill(
            *(as_matrix(v, n, factor(self.units, d)) for v, (_, d) in zip(values, self.numbers, strict=True)),
            shift=shift,
        )

    def _set(self, cutoff, *columns) -> None:
        """`table` from the cutoff and the kernel's columns; columns of pairs without interaction are 0."""
        on = cutoff > 0
        self.table = np.ascontiguousarray(np.stack([cutoff**2, *(np.where(on, c, 0.0) for c in columns)], axis=-1))

    @property
    def cutoff(self) -> float:
        return float(np.sqrt(self.table[..., 0].max()))

    @property
    def n_types(self) -> int:
        return len(self.table) - 1

    def active(self) -> np.ndarray:
        """(n_types + 1,) which types take part at all."""
        return (self.table[..., 0] > 0).any(axis=1)

    def prepare(self, frame: Frame):
        """Per-frame data for `add` (charges); None by default."""
        return None

    def self_energy(self, frame: Frame):
        """(n,) energies that atoms have by themselves (coul/dsf, coul/wolf), or None."""
        return None

    def add(self, types, i, j, d2, weights, U, G, prepared) -> None:
        """Add this style's energy and G to U and G (all (b,)). `weights` is (b,), or empty for all 1."""
        raise NotImplementedError

    def trouble(self, ti: int, tj: int, d: float) -> str | None:
        """Why this style has no finite force at distance d (internal), if it knows."""
        return None


def kinds_of(frame: Frame, column: str) -> np.ndarray:
    """(n,) which row of tables of pairs each atom has: its type, or what a column says where types are the user's."""
    if not column:
        return frame.types
    return atom_columns(frame, (column,), "the potential")[:, 0].astype(np.int64)


class Pairs(Term):
    """The pair term of a potential.

    Parameters
    ----------
    styles : list of PairStyle
    n_types : int
    special : object with ``prepare(frame)`` giving per-frame special-bond weights, or None (see special_bonds)
    grow : function n_types → list of PairStyle for a frame with more types than `n_types`, or None if there is no more
        to know
    exclusions : Exclusions or None, pairs that no style acts on
    kinds : the column of `Frame.extra` that the tables' types are in; "": the atoms' own types, see `kinds_of`
    """

    pairwise = True

    def __init__(self, styles, n_types: int, special=None, grow=None, exclusions=None, kinds: str = ""):
        self.styles = list(styles)
        self.n_types = n_types
        self.special = special
        self.grow = grow
        self.exclusions = exclusions
        self.kinds = kinds
        self.cutoff = max((s.cutoff for s in self.styles), default=0.0)
        if not self.cutoff > 0:
            names = ", ".join(s.name for s in self.styles)
            raise AtcError(
                f"pair style {names or 'none'} has no interaction, every cutoff is 0: give a positive cutoff"
            )
        self._grown: dict[int, Pairs] = {}

    def describe(self) -> str:
        return "pair " + " + ".join(s.name for s in self.styles) + ", energy shared half to each atom"

    def covering(self, top):
        return self._grown.get(top, self)

    def prepare(self, frame: Frame) -> Work:
        types = kinds_of(frame, self.kinds)
        top = int(types.max()) if len(frame) else 0
        if top > self.n_types:
            if self.grow is None or top > MAX_TYPES:
                raise AtcError(
                    f"{frame.source}: atoms of type {top} but the pair coefficients cover types 1 to {self.n_types}: "
                    "add a pair_coeff line for it"
                )
            if top not in self._grown:
                try:
                    self._grown[top] = Pairs(self.grow(top), top, self.special, exclusions=self.exclusions)
                except AtcError as e:
                    raise AtcError(f"{frame.source} has atoms of type {top}; {e}") from None
            return self._grown[top].prepare(frame)
        if len(frame) and types.min() < 1:
            raise AtcError(f"{frame.source}: atom types must be 1 or larger, found {int(types.min())}")
        if any(s.needs_charges for s in self.styles):
            frame.require("charges", why="a coulomb pair style")
        return _PairWork(self, frame)


class _PairWork(Work):
    def __init__(self, term: Pairs, frame: Frame):
        self.term = term
        self.frame = frame
        self.types = kinds_of(frame, term.kinds).astype(np.int32)
        self.list = cell_list(frame.positions, frame.cell, term.cutoff)
        self.prepared = [s.prepare(frame) for s in term.styles]
        keep = any(s.keeps_excluded for s in term.styles)
        self.special = term.special.prepare(frame, keep) if term.special is not None else None
        self.excluded = term.exclusions.prepare(frame) if term.exclusions is not None else None
        self.stages = (self.list.n_chunks,)

    def run(self, stage, task, acc: Accumulator):
        term, ws = self.term, acc.ws
        if task == 0:
            self._self_energies(acc)
        n = self.list.half(task, ws)
        if self.excluded is not None:
            n = self.excluded.leave_out(ws, n)
        weights = {"lj": ONES, "coul": ONES, None: ONES}
        if self.special is not None:
            n, weights["lj"], weights["coul"] = self.special.weigh(ws, n)
        i, j, r, d2, U, G = ws.i[:n], ws.j[:n], ws.r[:n], ws.d2[:n], ws.U[:n], ws.G[:n]
        U[:] = 0.0
        G[:] = 0.0
        for s, prepared in zip(term.styles, self.prepared, strict=True):
            s.add(self.types, i, j, d2, weights[s.weight], U, G, prepared)
        with np.errstate(all="ignore"):  # said below, with the atoms
            energy = float(U.sum())
            bad = np.flatnonzero(~np.isfinite(U + G)) if not np.isfinite(energy + float(G.sum())) else ()
        if len(bad):
            raise self._bad(int(i[bad[0]]), int(j[bad[0]]), float(np.sqrt(d2[bad[0]])))
        acc.energy += energy
        if acc.energies is not None:
            _share(i, j, U, acc.energies)
        # Only worth a copy where different cutoffs by type leave many idle pairs.
        if n - np.count_nonzero(G) > 0.05 * n:
            n = _compact(i, j, r, G)
            return Bonds(i[:n], j[:n], r[:n], G[:n])
        return Bonds(i, j, r, G)

    def _self_energies(self, acc):
        for s in self.term.styles:
            e = s.self_energy(self.frame)
            if e is not None:
                acc.energy += float(e.sum())
                if acc.energies is not None:
                    acc.energies[: len(e)] += e

    def _bad(self, i, j, d) -> AtcError:
        frame = self.frame
        for s in self.term.styles if d > 0.0 else ():
            why = s.trouble(int(self.types[i]), int(self.types[j]), d)
            if why:
                a, b = sorted((frame.ids[i], frame.ids[j]))
                return AtcError(f"{frame.source}: atoms {a} and {b}: {why}")
        return impossible(frame, i, j, d, "pair")


@njit(cache=True, nogil=True, error_model="numpy")
def _share(i, j, U, energies):
    """Half of each pair's energy to each of its atoms."""
    for b in range(len(U)):
        u = 0.5 * U[b]
        energies[i[b]] += u
        energies[j[b]] += u


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
