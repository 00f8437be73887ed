"""What fields (long-range Coulomb) add to the sums of a frame: by their modes, beside the sums over atoms and bonds.

A field's sums are given by unsmoothed modes, which add up over frames, and are finished with φ̂ like every spectral
sum: f(x) = V⁻¹ Σ_Q φ̂(Q) f(Q) e^{iQ·x}. The error check computes them a second time with more modes, more nodes and
another mesh, in the first frame and every `EVERY` after it, and sums the modes up one by one at its points.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..decomposers.constraints.virtual_sites import seen_by
from ..decomposers.long_range.stress import SINGLE
from ..errors import AtcError
from .bond_pass import BondFactors
from .summed import BOND
from .tensors import full

# What of the tolerance goes to a field's modes left out, and to the charges' modes and the nodes, which cost little:
# the smooth part is larger than the stress of which it is a part. The tolerance of sums that are exact otherwise.
SHARE, NODES, FINEST = 0.1, 0.02, 1e-12
# The check: tolerance and modes against those of the main sums, one node of the integrals more (a digit), another mesh.
TIGHTER, WIDER, FINER = 0.1, 1.2, 1.1
# Every how many frames it is made: how far off the modes are does not depend on the frame.
EVERY = 16
# Up to so many points the modes are summed up one by one.
FEW = 2000
#: Sums over bonds that fields know their share of.
KNOWN = ("stress", "moment", "power", "power_lab", "sources")


def is_checked(index: int) -> bool:
    """Whether the modes and the split are checked in the frame of this number."""
    return index % EVERY == 0


def require_fields(fields, kern, units, tolerance: float, work) -> None:
    """Raise AtcError for what fields are not made for, one line each. kern : in `units`"""
    if not fields:
        return
    what = "long-range Coulomb (kspace_style)"
    if work.reference_bond or work.reference_point or "reference_atom_moment" in work.whole:
        names = ", ".join(
            q.name for q in work.quantities if q.on_reference or any(s.reference and s.bonds for s in q.sources())
        )
        raise AtcError(
            f"{names}: not supported with {what}: a field has no bonds that could be drawn between reference positions"
        )
    pd = [q.name for q in work.quantities if q.name.startswith("peridynamic")]
    if pd or set(work.bond) - set(KNOWN):
        raise AtcError(
            f"{', '.join(pd) or 'this quantity'}: not supported with {what}: a field has no bonds that could be "
            "weighted or shared between nodes"
        )
    for term in fields if work.kernel_users and work.bond else ():
        _wave(term, kern.in_dimension(3).scaled(units.length), _tolerance(tolerance))


def _tolerance(tolerance: float) -> float:
    return max(SHARE * tolerance, FINEST)


def _wave(term, kern, tolerance) -> float:
    from ..decomposers.long_range.stress import largest_wave_of

    return largest_wave_of(kern, tolerance, term.split.alpha)


@dataclass(frozen=True)
class Layout:
    """What the products of a field are taken on.

    vectors, origin : of the box. largest : (3,) modes of the sums. tolerance : of the charges' modes. nodes : of the
        integrals. wide : how much finer the mesh is than it has to be. counts : nodes of the mesh. transforms : their
        number
    """

    vectors: np.ndarray
    origin: np.ndarray
    largest: np.ndarray
    tolerance: float
    nodes: int
    wide: float
    single: bool
    counts: tuple[int, int, int]
    transforms: int

    @property
    def size(self) -> float:
        return float(np.prod(self.counts, dtype=float))

    @property
    def memory(self) -> float:
        """Bytes."""
        from ..decomposers.long_range.stress import ARRAYS

        return (4.0 if self.single else 8.0) * ARRAYS * self.size

    def describe(self) -> str:
        return (
            f"mesh {' x '.join(map(str, self.counts))}, {self.nodes} nodes, "
            f"{'single' if self.single else 'double'} precision"
        )


class FieldSums:
    """The modes of the fields' share of sums over bonds, added up over frames with one cell.

    Parameters
    ----------
    terms : terms with `field`
    names : sums over bonds, of `KNOWN`
    bound : BoundGrid
    kern : kernel, internal units
    tolerance : of the result
    tight : for the error check
    """

    def __init__(self, terms, names, bound, kern, tolerance: float, threads: int, tight: bool = False):
        self.terms, self.names, self.bound, self.kern, self.threads = terms, list(names), bound, kern, threads
        self.tolerance, self.fine, self.tight = _tolerance(tolerance), max(NODES * tolerance, FINEST), tight
        self.single = tolerance >= SINGLE
        self.modes: list[dict | None] = [None] * len(terms)
        self.boxes: list = [None] * len(terms)
        self.kinds = [
            k
            for k in ("stress", "power", "power_lab")
            if k in names or (k == "stress" and {"sources", "moment"} & {*names})
        ]

    def add(self, frame, drift) -> None:
        """One frame more."""
        self.take(frame, drift)
        for n, (old, found) in enumerate(zip(self.modes, self.last)):
            self.modes[n] = found if old is None else {k: old[k] + found[k] for k in found}

    def take(self, frame, drift) -> None:
        """`last`: the modes of a frame alone."""
        self.last = [self._modes_of(n, frame, drift) for n in range(len(self.terms))]

    def layout(self, n: int, frame) -> Layout:
        """What a term's products are taken on."""
        from ..decomposers.long_range import stress
        from ..decomposers.long_range.transform import largest_of

        term = self.terms[n]
        vectors, origin = term.box(frame)
        wave = _wave(term, self.kern, max(term.share * self.tolerance, FINEST)) * (WIDER if self.tight else 1.0)
        # One more: how much the modes have is known on average, and in a small cell they are few.
        largest = largest_of(wave, vectors) + 1
        if self.bound.kind == "slab":
            largest[[a for a in range(3) if a != self.bound.axis]] = 0
        fine = max(term.share * self.fine, FINEST)
        tolerance = fine * (TIGHTER if self.tight else 1.0)
        nodes = term.nodes(fine, wave, lambda q: _hat(self.kern, q)) + self.tight
        wide = FINER if self.tight else 1.0
        counts, _ = stress.mesh_of(vectors, term.split, largest, tolerance, wide, 4 if self.single else 8)
        counts = tuple(int(c) for c in counts)
        transforms = term.transforms(self.kinds, nodes)
        return Layout(vectors, origin, largest, tolerance, nodes, wide, self.single, counts, transforms)

    def _modes_of(self, n: int, frame, drift) -> dict:
        term = self.terms[n]
        frame = seen_by(term, frame)
        term.check(frame)
        on = self.layout(n, frame)
        products = term.products(frame, on, self.threads)
        found = {}
        if "stress" in self.kinds:
            found["stress"] = products.stress()
        if "power" in self.kinds:
            found["power"] = products.current(frame.velocities - drift)
        if "power_lab" in self.kinds:
            found["power_lab"] = products.current(frame.velocities)
        self.boxes[n] = on.vectors, on.origin, products.q_index
        return found

    def on_grid(self) -> dict[str, np.ndarray]:
        """{name: (g, width)} on the whole grid."""
        if self.bound.kind == "slab":
            return self.at(np.arange(len(self.bound)))
        if not self.bound.is_lattice and len(self.bound) <= FEW:
            return self.at(np.arange(len(self.bound)))
        return self._named([self._finished(n, self._whole_grid) for n in range(len(self.terms))])

    def at(self, which, last: bool = False) -> dict[str, np.ndarray]:
        """The same at some points of the grid, mode by mode. last : of the last frame alone"""
        if self.bound.kind == "slab":
            values = lambda F, box: self._bins(F, box, which)  # noqa: E731
        else:
            x_gc = self.bound.relative_points_of(which)
            values = lambda F, box: self._directly(F, box, x_gc)  # noqa: E731
        modes = self.last if last else self.modes
        return self._named([self._finished(n, values, modes) for n in range(len(self.terms))])

    def _named(self, parts) -> dict[str, np.ndarray]:
        total = {k: sum(p[k] for p in parts) for k in self.kinds}
        if "sources" in self.names:
            # A field churns nothing: z = S + M = 0.
            total["sources"] = -full(total["stress"]).reshape(-1, BOND["sources"].width)
        if "moment" in self.names:  # a symmetric one, see `tensors.general`
            total["moment"] = np.concatenate([total["stress"], np.zeros((len(total["stress"]), 3))], axis=1)
        return {name: total[name] for name in self.names}

    def _finished(self, n, values, modes=None):
        vectors, _, index = box = self.boxes[n]
        from ..decomposers.long_range.transform import wave_vectors

        k_c = wave_vectors(index, vectors)
        hat = _hat(self.kern, np.stack(np.broadcast_arrays(*k_c), -1), vector=True) / abs(np.linalg.det(vectors))
        found = (self.modes if modes is None else modes)[n]
        return {k: values([F * hat for F in modes_k], box) for k, modes_k in found.items()}

    def _bins(self, F_k, box, which):
        """Means over the cell's cross-section: the modes along its normal alone."""
        vectors, origin, index = box
        a, cell = self.bound.axis, self.bound.cell
        height = abs(np.linalg.det(vectors)) / np.linalg.norm(np.cross(*np.delete(vectors, a, axis=0)))
        z = (np.asarray(which) + 0.5) / self.bound.shape[0] * cell.heights[a]
        if not cell.periodic[a]:  # padding
            z += (cell.origin - origin) @ cell.inverse[:, a] * cell.heights[a]
        # A slab's box of modes may be higher than the cell: the mean is over the cell's own cross-section.
        area = abs(np.linalg.det(vectors)) / height / (cell.volume / cell.heights[a])
        n = index[a]
        phase = np.exp(2j * np.pi / height * np.outer(z, n))
        if self.bound.means:
            phase *= np.sinc(n / height * cell.heights[a] / self.bound.shape[0])
        out = []
        for F in F_k:
            line = np.moveaxis(F, a, 0)[:, 0, 0]
            out.append((phase @ line if a < 2 else (phase * np.where(n == 0, 1.0, 2.0)) @ line).real * area)
        return np.stack(out, axis=1)

    def _directly(self, F_k, box, x_gc):
        from ..decomposers.long_range.transform import Direct

        vectors, _, index = box
        direct = Direct(vectors, np.zeros(3), [i.max() for i in index])
        return direct.at(F_k, x_gc)

    def _whole_grid(self, F_k, box):
        from ..decomposers.long_range.transform import Transform
        from ..deposit.modes import Modes, separable

        vectors, _, index = box
        counts = np.array([2 * int(i.max()) + 2 for i in index])
        lattice = separable(self.bound, np.linalg.inv(vectors) * counts)
        if lattice is None:
            x_gc = self.bound.relative_points_gc
            transform = Transform(vectors, np.zeros(3), [i.max() for i in index], 0.05 * self.tolerance, self.threads)
            return transform.at(F_k, x_gc)
        axes, owner = lattice
        modes = Modes.__new__(Modes)
        modes.counts, modes.index, modes.low = counts, index, np.zeros(3)
        modes.reach, modes.extent = np.full(3, np.inf), np.zeros((2, 3))
        order = [owner.index(g) for g in range(len(self.bound.counts))]
        order = [a for a in range(3) if a not in order] + order
        return np.stack([modes.on_lattice(F, axes).transpose(order).ravel() for F in F_k], axis=1)


def _hat(kern, k, vector=False):
    """φ̂ for wave numbers along x, or for wave vectors (..., 3)."""
    if not vector:
        return kern.hat(np.stack([k, 0 * k, 0 * k], -1))
    if kern.hat_step is not None:
        # By a table: there are many modes.
        size = np.sqrt((k**2).sum(-1))
        from scipy.interpolate import CubicSpline

        step = kern.hat_step / kern.radius
        table = np.arange(int(size.max() / step) + 3) * step
        return CubicSpline(table, _hat(kern, table))(size)
    return kern.hat(k)


class FieldPass:
    """What fields add to the sums over bonds of frames with one cell, side by side in the order of `work.bond`; it does
    not depend on how the other sums are taken.

    Parameters
    ----------
    pot : with fields
    frames, drifts : Frames, and the mean velocity of each
    names : sums over bonds, of `KNOWN`
    place : `place.Place`, the grid and the points of the error check
    tolerance : of the result

    Attributes
    ----------
    grid_gk : (g, k) of all frames together, on the grid
    check : of each frame, (c, k) at the points of the check
    """

    def __init__(self, pot, frames, drifts, names, place, tolerance: float):
        self.pot, self.frames, self.drifts, self.index = pot, frames, drifts, place.index
        self.main, self.tight = (
            FieldSums(pot.fields, names, place.bound, place.kern, tolerance, place.threads, tight=tight)
            for tight in (False, True)
        )
        self._has = None  # the frame that `tight` has the modes of
        self._last = None  # the one that `main` has those of alone
        self.check = []
        for k, (frame, drift) in enumerate(zip(frames, drifts)):
            self.main.add(self.pot.complete(frame), drift)
            self._last = k
            self.check.append(self.at(k, place.check.which))
        self.grid_gk = self._columns(self.main.on_grid())

    def at(self, k: int, which) -> np.ndarray:
        """(h, k) of frame `k`, at some points of the grid."""
        if not len(which):
            return np.zeros((0, sum(BOND[name].width for name in self.tight.names)))
        if not is_checked(self.index + k):
            if self._last != k:
                self.main.take(self.pot.complete(self.frames[k]), self.drifts[k])
                self._last = k
            return self._columns(self.main.at(which, last=True))
        if self._has != k:
            self.tight.modes = [None] * len(self.tight.terms)
            self.tight.add(self.pot.complete(self.frames[k]), self.drifts[k])
            self._has = k
        return self._columns(self.tight.at(which))

    def added(self, k: int, bonds):
        """`bonds`, the `bond_pass.BondPass` of frame `k`, with the fields' share at the points of the check."""
        grid_gk, check_gk = bonds.totals.bond
        check_gk = check_gk.copy()  # its last column may be the size of the bonds' terms
        check_gk[:, : self.grid_gk.shape[1]] += self.check[k]
        return replace(bonds, totals=replace(bonds.totals, bond=(grid_gk, check_gk)))

    @staticmethod
    def _columns(found: dict) -> np.ndarray:
        return np.concatenate(list(found.values()), axis=1)


def attributes(sums: FieldSums, frame) -> dict:
    """What an output says of the split and of what the modes are taken on, in the user's units."""
    out, u = {}, frame.units
    for n, term in enumerate(sums.terms):
        on = sums.layout(n, frame)
        out |= {
            f"{term.prefix}_alpha": 1.0 / u.to_user("length", 1.0 / term.split.alpha),
            f"{term.prefix}_cutoff": u.to_user("length", term.split.cutoff),
            f"{term.prefix}_mesh": list(on.counts),
            f"{term.prefix}_nodes": on.nodes,
            f"{term.prefix}_modes": [int(m) for m in on.largest],
            f"{term.prefix}_precision": "single" if on.single else "double",
        }
    return out


def finer_check(pot, frame, work, place, drift) -> np.ndarray | None:
    """(c, k) the bonds of a finer split at the points of the check, with the size of their terms; None for a potential
    without fields."""
    from ..decomposers.long_range.kspace import finer

    pot = finer(pot)
    if pot is None:
        return None
    factors, more = BondFactors(work.bond, frame, drift), {"sources": bool(work.source_users)}
    return factors.sums_near(place.check.deposits, pot, frame, place.threads, size=work.sized, **more)


def atom_fields(pot, frame, work, bonds, tiled: bool = False):
    """`bonds`, the `bond_pass.BondPass` of a frame, with the fields' share of the sums per atom and of the box. tiled :
    they are those of the bonds alone."""
    power = "box_power" in work.whole
    for term in pot.fields:
        completed = seen_by(term, pot.complete(frame))
        term.check(completed)
        n = len(completed)
        if not (tiled or work.atom_virial or work.atom_moment or power):
            continue
        smooth, totals, per_atom = term.modes(completed, term.threads), {}, {}
        if tiled:
            totals["virial_cc"] = bonds.totals.virial_cc + smooth.virial_cc
            if work.energy_users:
                per_atom["energies_n"] = bonds.per_atom.energies_n + smooth.energies_n()
        if work.atom_virial or work.atom_moment or power:
            w_n6 = smooth.virials_n6()
            if work.atom_virial:
                per_atom["virial_n6"] = bonds.per_atom.virial_n6 + w_n6
            if work.atom_moment:
                moment_n9 = bonds.per_atom.moment_n9.copy()
                moment_n9[:n] += full(w_n6).reshape(-1, 9)
                per_atom["moment_n9"] = moment_n9
            if power:
                totals["power_c"] = bonds.totals.power_c - np.einsum("nij,nj->i", full(w_n6), completed.velocities)
        bonds = replace(bonds, totals=replace(bonds.totals, **totals), per_atom=replace(bonds.per_atom, **per_atom))
    return bonds
