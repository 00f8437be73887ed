"""Any energy of two to six atoms that is a function of their distances, with exact derivatives."""

from __future__ import annotations

import inspect
from itertools import combinations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...frame import Frame
from ...units import Units
from ...units import units as system
from ..autodiff import compiled
from ..base import Accumulator, Work
from ..bonded.cluster import ClusterTerm, cluster_bonds, first_not_finite, weights_of
from ..numbering import atoms_of_ids
from ..recording import batch_source
from .neighbor_work import NeighborWork, made, room, shares

_MOST_BODIES = 6
_TERMS_PER_TASK = 16384


class ManyBody(ClusterTerm):
    """Σ U(d12, d13, .., d1K, d23, ..) over tuples of K atoms, 2 ≤ K ≤ 6, U given by the user as a function of the
    K(K−1)/2 distances.

    G of a distance is (1/d) ∂U/∂d, by automatic differentiation of what the function does (see
    `atc.decomposers.recording`), or by `gradient`. Whatever can be written this way is invariant under translation,
    rotation and reflection, and what is invariant can be written this way.

    For K ≤ 4 the distances are independent, and the stress that follows is the only one. For K ≥ 5 they are not: 10
    distances describe 9 degrees of freedom. Functions that agree wherever five points can be, and differ elsewhere (say
    by a multiple of the Cayley-Menger determinant, which vanishes for points in space), are the same potential with the
    same forces, the same divergence of stress and the same stress summed over the box, but other G and other stress
    fields. The function given here *is* the choice.

    Parameters
    ----------
    energy : function of the distances in the order 12, 13, .., 1K, 23, .. (plain Python with numpy's or math's
        functions, or numba-compiled); or a text
        such as ``"k*(d12 - r0)^2*d23"`` (``**`` is the same power); or a sympy expression in symbols of those names
    atoms : (m, K) indices of atoms, from 0; atoms that follow one another in a tuple are taken at their closest images.
        Or ids : (m, K) atom ids.
    cutoff : instead of atoms: all pairs closer than this (K = 2), or all triples of a centre, atom 1, with two
        neighbours closer to it than this
        (K = 3; each once, so U must not change when d12 and d13 are exchanged unless `types` tells them apart). U
        should vanish there: nothing is done about it if not.
    types : with cutoff: for each of the K atoms a type, several, or None for any
    bodies : K, where neither the atoms nor the function's arguments say it
    variables : "distance", or "xi": the arguments are ξ = d²/2, called xi12, xi13, .. in texts
    parameters : {name: value} for names in the text or expression, or further keyword arguments of the function
    gradient : function of the same arguments that returns the K(K−1)/2 derivatives, for functions that cannot be
        differentiated automatically; both
        must then be what numba compiles
    units : unit style of the function's arguments and value; the default has eV and Å
    partition : "equal" (1/K of a tuple's energy to each of its atoms), "first" (all to atom 1), or K numbers that add
        up to 1
    name : what to call it in the output

    Raises
    ------
    AtcError for functions that cannot be differentiated, do not fit the atoms or the gradient, or are not symmetric
    where they must be.
    """

    _kernel = None

    def __init__(
        self,
        energy,
        *,
        atoms=None,
        ids=None,
        cutoff: float | None = None,
        types=None,
        bodies: int | None = None,
        variables: str = "distance",
        parameters=None,
        gradient=None,
        units: str | Units = "metal",
        partition="equal",
        name: str = "many-body",
    ):
        self.name = name
        self.units = u = system(units)
        if (atoms is not None) + (ids is not None) + (cutoff is not None) != 1:
            raise AtcError(f"{name}: give exactly one of atoms=, ids= and cutoff=")
        if variables not in ("distance", "xi"):
            raise AtcError(f"{name}: variables {variables!r}: expected 'distance' or 'xi'")
        self.xi = variables == "xi"
        self.tuples, self.by_id = None, ids is not None
        if cutoff is None:
            self.tuples = np.asarray(atoms if ids is None else ids)
            if self.tuples.ndim != 2 or not np.issubdtype(self.tuples.dtype, np.integer):
                raise AtcError(
                    f"{name}: atoms= and ids= take an (m, K) array of whole numbers, got shape {self.tuples.shape} of "
                    f"{self.tuples.dtype}"
                )
            repeated = [t for t in self.tuples.tolist() if len(set(t)) < len(t)]
            if repeated:
                raise AtcError(f"{name}: the tuple {repeated[0]} names an atom twice")
        self.bodies = k = self._bodies(energy, bodies)
        prefix = "xi" if self.xi else "d"
        self.names = [f"{prefix}{p}{q}" for p, q in combinations(range(1, k + 1), 2)]
        self.share(partition)
        self.factor_q = 1.0 / u.length ** (2 if self.xi else 1)
        self.factor_U = u.energy
        self.functions = None
        if gradient is None:
            self.source = batch_source(energy, self.names, parameters, name)
        else:
            if parameters:
                raise AtcError(f"{name}: parameters= does not go with gradient=: put the numbers into the functions")
            self.source, self.functions = None, (energy, gradient)
        if cutoff is not None:
            if k not in (2, 3):
                raise AtcError(
                    f"{name}: a cutoff makes tuples of 2 or 3 atoms, got a function of {k}: list the tuples with atoms="
                )
            if not (np.isfinite(cutoff) and cutoff > 0):
                raise AtcError(f"{name}: the cutoff must be a positive number, got {cutoff}")
            self.cutoff = float(u.to_internal("length", cutoff))
        self.types = self._types(types)
        ends = self.types[1:]
        exchangeable = not self.listed and k == 3 and (None in ends or bool(ends[0] & ends[1]))
        if gradient is not None or exchangeable:
            self._check(gradient is not None, exchangeable, cutoff)

    def _bodies(self, energy, bodies) -> int:
        counts = {k * (k - 1) // 2: k for k in range(2, _MOST_BODIES + 1)}
        k = bodies if self.tuples is None else self.tuples.shape[1]
        if k is None and callable(energy) and not isinstance(energy, str):
            try:
                ps = inspect.signature(getattr(energy, "py_func", energy)).parameters.values()
            except (TypeError, ValueError):
                ps = ()
            k = counts.get(
                sum(p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD) and p.default is p.empty for p in ps)
            )
        if k is None:
            raise AtcError(f"{self.name}: say of how many atoms the energy is: bodies=")
        if bodies is not None and k != bodies:
            raise AtcError(f"{self.name}: bodies={bodies} but the tuples have {k} atoms")
        if not 2 <= k <= _MOST_BODIES:
            raise AtcError(f"{self.name}: energies of 2 to {_MOST_BODIES} atoms are supported, got {k}")
        return int(k)

    def _types(self, types):
        if types is None:
            return [None] * self.bodies
        if self.listed:
            raise AtcError(f"{self.name}: types= goes with cutoff=; listed tuples are taken as they are")
        out = [None if t is None else frozenset(np.atleast_1d(t).astype(int).tolist()) for t in types]
        if len(out) != self.bodies:
            raise AtcError(f"{self.name}: types= needs one entry for each of the {self.bodies} atoms, got {len(out)}")
        return out

    def _check(self, given: bool, exchangeable: bool, cutoff):
        """Try the compiled functions on some distances: of the gradient that was given, and of the symmetry that a
        cutoff needs."""
        rng = np.random.default_rng(1)
        scale = 2.0 if cutoff is None else 0.8 * cutoff
        k, pairs = self.bodies, len(self.names)
        x = rng.normal(size=(8, k, 3)) * scale / 2.5
        d = np.stack([np.linalg.norm(x[:, p] - x[:, q], axis=1) for p, q in combinations(range(k), 2)], axis=1)
        Q = np.ascontiguousarray(d * d / 2 if self.xi else d)
        U, G = np.zeros(len(Q)), np.zeros(Q.shape)
        try:
            self.kernel(Q, U, G)
        except Exception as e:
            if not given:
                raise
            first = str(e).strip().splitlines()[0] if str(e).strip() else type(e).__name__
            raise AtcError(
                f"{self.name}: energy and gradient cannot be compiled for {pairs} arguments: {first}"
            ) from None
        fine = np.isfinite(U) & np.isfinite(G).all(axis=1)
        if given and fine.any():
            h = 1e-6 * scale
            for e in range(pairs):
                ends = []
                for s in (1, -1):
                    R = Q.copy()
                    R[:, e] += s * h
                    V = np.zeros(len(Q))
                    self.kernel(R, V, np.zeros(Q.shape))
                    ends.append(V)
                slope = (ends[0] - ends[1]) / (2 * h)
                # Differences are good to 1e-9 of U/h here; 1e-4 finds wrong formulas and nothing else.
                size = np.abs(slope) + np.abs(G[:, e]) + np.abs(U) / scale
                wrong = fine & np.isfinite(slope) & (np.abs(slope - G[:, e]) > 1e-4 * size)
                if wrong.sum() > len(Q) // 2:
                    t = int(np.flatnonzero(wrong)[0])
                    raise AtcError(
                        f"{self.name}: the gradient is not that of the energy: its entry {e + 1} "
                        f"(∂U/∂{self.names[e]}) is {G[t, e]:.6g} where differences say {slope[t]:.6g}"
                    )
        if exchangeable:
            R, V = np.ascontiguousarray(Q[:, [1, 0, 2]]), np.zeros(len(Q))
            self.kernel(R, V, np.zeros(Q.shape))
            if (np.abs(U - V)[fine] > 1e-9 * np.abs(U)[fine] + 1e-300).any():
                raise AtcError(
                    f"{self.name}: the energy changes when the two neighbours of the centre are exchanged "
                    f"({self.names[0]} and {self.names[1]}), so which is which must be told: "
                    "make it symmetric, or give types= that tell the atoms 2 and 3 apart"
                )

    @property
    def kernel(self):
        """f(Q, U, G), compiled when first used."""
        if self._kernel is None:
            self._kernel = (
                compiled(self.source) if self.functions is None else _batch_of(*self.functions, len(self.names))
            )
        return self._kernel

    def __getstate__(self):
        return {k: v for k, v in self.__dict__.items() if k != "_kernel"}

    @property
    def part_name(self) -> str:
        return self.name

    @property
    def partitions(self) -> dict:
        # Listed tuples may have their centre anywhere.
        return {"equal": "equal", "center": "first"} if self.bodies == 3 and not self.listed else {"equal": "equal"}

    def share(self, partition) -> None:
        """From now on share the energy of a tuple like this; see the parameter."""
        k = self.bodies
        first = ((1.0,) + (0.0,) * (k - 1), "energy to the first atom")
        self.weights, self.shared = weights_of(partition, k, {"first": first}, self.name)

    def describe(self) -> str:
        tail = "" if self.bodies < 5 else ", extended off the distance constraint as given"
        return f"{self.name} of {self.bodies} atoms, {self.shared}{tail}"

    def terms_of(self, frame: Frame):
        t = self.tuples
        if self.by_id:
            place, found = atoms_of_ids(frame, t)
            if not found.all():
                raise AtcError(
                    f"{frame.source}: {self.name} names atom {int(t[~found][0])}, which is not in this frame"
                )
            t = place
        elif t.size and (t.min() < 0 or t.max() >= len(frame)):
            raise AtcError(
                f"{frame.source}: {self.name} names atom index {int(t.min() if t.min() < 0 else t.max())} but the "
                f"frame has atoms 0 to {len(frame) - 1}"
            )
        return np.ascontiguousarray(t, dtype=np.int32), np.zeros(len(t), np.int32)

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        Q = np.empty(G.shape)
        _arguments(x_tkc, self.xi, self.factor_q, Q)
        self.kernel(Q, U, G)
        # G of ξ: per ξ as given, or per distance over the distance.
        G *= self.factor_U * self.factor_q
        if not self.xi:
            with np.errstate(divide="ignore", invalid="ignore"):
                G *= self.factor_q / Q
        U *= self.factor_U
        return first_not_finite(U, G)

    def prepare(self, frame: Frame) -> Work:
        return super().prepare(frame) if self.listed else _TupleWork(self, frame)

    @property
    def word(self) -> str:
        return self.name

    def kinds(self, frame: Frame):
        """Which place of a tuple each atom may have, and those that may have any."""
        allowed = np.ones((len(frame), self.bodies), bool)
        for slot, t in enumerate(self.types):
            if t is not None:
                allowed[:, slot] = np.isin(frame.types, list(t))
        who = np.flatnonzero(allowed.any(axis=1)).astype(np.int32)
        return allowed, None if len(who) == len(frame) else who


def _batch_of(energy, gradient, n: int):
    """The loop over terms around the user's own two functions."""
    e, g = (f if hasattr(f, "py_func") else njit(nogil=True, error_model="numpy")(f) for f in (energy, gradient))
    args = ", ".join(f"Q[t, {k}]" for k in range(n))
    lines = [
        "def f(Q, U, G):",
        "    for t in range(Q.shape[0]):",
        f"        U[t] = energy({args})",
        f"        slopes = gradient({args})",
    ]
    lines += [f"        G[t, {k}] = slopes[{k}]" for k in range(n)]
    space = {"energy": e, "gradient": g}
    exec(compile("\n".join(lines), "<energy and gradient>", "exec"), space)
    return njit(nogil=True, error_model="numpy")(space["f"])


@njit(cache=True, nogil=True, error_model="numpy")
def _arguments(x, xi, factor, Q):
    """Distances, or ξ, of K atoms in the order 12, 13, .., 1K, 23, .."""
    k = x.shape[1]
    for t in range(x.shape[0]):
        e = 0
        for p in range(k):
            for q in range(p + 1, k):
                d2 = (x[t, p, 0] - x[t, q, 0]) ** 2 + (x[t, p, 1] - x[t, q, 1]) ** 2 + (x[t, p, 2] - x[t, q, 2]) ** 2
                Q[t, e] = (0.5 * d2 if xi else np.sqrt(d2)) * factor
                e += 1


class _TupleWork(NeighborWork):
    """Tuples from a neighbour list: pairs, or a centre with two of its neighbours."""

    own = ("_tuples",)

    def joined(self, acc):
        # How many tuples there are, and so how many tasks, is known once the pairs are.
        k = np.diff(self.near.start)
        counts = k if self.term.bodies == 2 else k * (k - 1) // 2
        total = np.concatenate([[0], np.cumsum(counts)])
        # Whole atoms to a task; at least one.
        marks = np.arange(0, total[-1] + _TERMS_PER_TASK, _TERMS_PER_TASK)
        self.cut = np.unique(np.concatenate([[0], np.searchsorted(total, marks), [len(k)]]).clip(0, len(k)))
        self.room = np.diff(total[self.cut])
        self.stages = (*self.stages[:2], len(self.cut) - 1)

    def _tuples(self, task, acc):
        term = self.term
        k, most = term.bodies, int(self.room[task])
        atoms, x = np.empty((most, k), np.int32), np.empty((most, k, 3))
        enumerate_ = _pairs if k == 2 else _triples
        m = enumerate_(self.cut[task], self.cut[task + 1], self.lists, atoms, x)
        atoms, x = atoms[:m], x[:m]
        U, G = np.empty(m), np.empty((m, k * (k - 1) // 2))
        bad = term.evaluate(x, None, U, G, acc)
        if bad >= 0:
            raise AtcError(f"{self.frame.source}: {term.complaint(self.frame, atoms[bad], 0, x[bad])}")
        acc.energy += float(U.sum())
        out = room(acc, G.size)
        n = cluster_bonds(atoms, x, U, G, term.weights, *out, shares(acc))
        return made(acc, out, n)


@njit(cache=True, nogil=True, error_model="numpy")
def _pairs(s0, s1, near, atoms, x):
    start, pair, end, a, b, r, _, allowed, atom = near
    m = 0
    for s in range(s0, s1):
        for q in range(start[s], start[s + 1]):
            p = pair[q]
            if end[q] != 0:
                continue
            i, j, sign = s, b[p], 1.0
            if not (allowed[i, 0] and allowed[j, 1]):
                i, j, sign = j, i, -1.0
                if not (allowed[i, 0] and allowed[j, 1]):
                    continue
            atoms[m, 0], atoms[m, 1] = atom[i], atom[j]
            for c in range(3):
                x[m, 0, c] = 0.0
                x[m, 1, c] = -sign * r[p, c]
            m += 1
    return m


@njit(cache=True, nogil=True, error_model="numpy")
def _triples(s0, s1, near, atoms, x):
    start, pair, end, a, b, r, _, allowed, atom = near
    m = 0
    for s in range(s0, s1):
        if not allowed[s, 0]:
            continue
        for q in range(start[s], start[s + 1]):
            for w in range(q + 1, start[s + 1]):
                e, f = q, w
                i = b[pair[e]] if end[e] == 0 else a[pair[e]]
                j = b[pair[f]] if end[f] == 0 else a[pair[f]]
                if not (allowed[i, 1] and allowed[j, 2]):
                    e, f, i, j = f, e, j, i
                    if not (allowed[i, 1] and allowed[j, 2]):
                        continue
                atoms[m, 0], atoms[m, 1], atoms[m, 2] = atom[s], atom[i], atom[j]
                # x_k − x_s is −r where s is the pair's first atom.
                u = -1.0 if end[e] == 0 else 1.0
                v = -1.0 if end[f] == 0 else 1.0
                for c in range(3):
                    x[m, 0, c] = 0.0
                    x[m, 1, c] = u * r[pair[e], c]
                    x[m, 2, c] = v * r[pair[f], c]
                m += 1
    return m
