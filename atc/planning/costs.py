"""What a frame costs: counts of what will be done times seconds for each, measured on this machine or shipped.

The model is linear and small on purpose; every count is of something the program does:

- neighbour list and forces: per atom, per pair within the cutoff, per triplet of many-body terms;
- direct deposit on a lattice: per bond, per row of points that crosses the capsule around it, per point in it and
  vector of four components.
  Points: the capsule's volume, V + A L (V the kernel's sphere, A its cross-section, L the mean bond length), times
  points per volume; rows: the capsule's mean shadow, A + π/2 R L, over the area that belongs to a row. An atom is a
  bond of no length;
- spectral deposit, single and double precision apart: per point on a bond, per register (32 bytes) of its window on the
  mesh, per node of the mesh and
  component; see `atc.deposit.fourier`;
- where atoms carry moments of their bonds: per bond, and per number in it; per atom, and per register of its window;
  per node and number;
- scattered points and the error check: per bond that passes by, per bond that starts near a point, per visit;
- gradients by the exact sum: per atom within reach of a point;
- products of long-range fields: per transform and node of their mesh, and per charge and node of its window.

`atc bench --calibrate` measures the constants (`calibrate`) and keeps them in the user's cache folder; without, those
shipped are used, taken on one core of an ordinary x86-64 with AVX2. They are CPU seconds of one thread; threads share
the work of deposits and forces.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, field, fields
from functools import lru_cache
from math import ceil, exp, pi
from pathlib import Path

import numpy as np

from ..decomposers.base import Term
from ..errors import AtcError


@dataclass
class Costs:
    """CPU seconds of each thing that is counted."""

    read_atom: float = 3e-7
    list_atom: float = 2.2e-7
    pair: float = 2.1e-8
    triplet: float = 2.4e-8
    tuple: float = 1.5e-7
    bond: float = 1.8e-7
    row: float = 5e-9
    #: Of a β, by the name of its compiled functions, where it was measured here.
    visit: dict = field(default_factory=dict)
    accumulate: float = 1.3e-9
    slab_bond: float = 2.7e-7
    point_bond: float = 1.9e-8
    point_visit: float = 3.4e-8
    filter_bond: float = 3.3e-9
    spread_point: float = 1e-8
    spread_register: float = 4.2e-10
    spread_point_single: float = 3e-8
    spread_register_single: float = 4.2e-10
    moment_bond: float = 3.0e-8
    moment: float = 4.5e-10
    moment_atom: float = 7e-7
    moment_register: float = 6.5e-10
    moment_node: float = 6e-9
    mesh_node: float = 1.6e-8
    mesh_node_single: float = 1.3e-8
    gather_visit: float = 4.4e-8
    value: float = 3e-8
    frame: float = 7e-3
    written_byte: float = 1.1e-9
    machine: str = "shipped"

    def visit_of(self, compiled) -> float:
        """Of a kernel's β on a lattice."""
        return self.visit.get(compiled.name, compiled.seconds)

    def save(self, path: Path | None = None) -> Path:
        path = path or cache_file()
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_suffix(".tmp")
        temporary.write_text(json.dumps(asdict(self), indent=1))
        os.replace(temporary, path)
        return path

    @classmethod
    def load(cls, path: Path | None = None) -> Costs:
        """This machine's, if they were ever measured (by this version of the model), else those shipped."""
        if path is None and os.environ.get("ATC_COSTS") == "shipped":
            return cls()
        try:
            known = json.loads((path or cache_file()).read_text())
            return cls(**known) if set(known) == {f.name for f in fields(cls)} else cls()
        except (OSError, ValueError, TypeError, KeyError):
            return cls()


def cache_file() -> Path:
    """Where measured costs are kept: ``atc/costs.json`` in the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or Path.home() / ".cache"
    return Path(base) / "atc" / "costs.json"


# --- what there is to do

#: Atoms whose neighbours are counted at a time; the standard error, of the mean number, that is enough; layers that
#: atoms are sorted into.
AT_ONCE, CERTAIN, LAYERS = 16, 0.02, 65535.0


@dataclass(frozen=True)
class Load:
    """What a potential makes of a frame: numbers of pairs within the cutoffs, of triplets, of listed tuples, of bonds
    handed on; their mean length."""

    pairs: float = 0.0
    triplets: float = 0.0
    tuples: float = 0.0
    bonds: float = 0.0
    length: float = 0.0

    def seconds(self, costs: Costs, atoms: int) -> float:
        """For the neighbour list, the forces and the decomposition."""
        pairs, more = costs.pair * self.pairs, costs.triplet * self.triplets + costs.tuple * self.tuples
        return costs.list_atom * atoms + pairs + more


def neighborhood(frame, cutoff: float, count: int = 0, triplets: bool = True) -> tuple[float, float, float, float]:
    """Around some atoms at random (so that empty space in the box does not mislead): mean number of neighbours within
    `cutoff` and of pairs of them, mean distance of a neighbour, and of two neighbours from each other; without
    `triplets` those of pairs of neighbours are 0.

    As many atoms are looked at as make the mean number certain (`CERTAIN`), 150 at most, 50 in large frames; `count` of
    them if that is given.
    """
    n, cell = len(frame), frame.cell
    if n < 2:
        return 0.0, 0.0, 0.0, 0.0
    if cutoff > 0.5 * cell.heights[cell.periodic].min(initial=np.inf):
        if frame.dimension == 2:
            k = n / cell.volume * pi * cutoff**2
            return k, 0.5 * k * max(k - 1, 0), 2 / 3 * cutoff, 0.905 * cutoff
        k = n / cell.volume * 4 / 3 * pi * cutoff**3
        return k, 0.5 * k * max(k - 1, 0), 0.75 * cutoff, 1.03 * cutoff
    sample = np.random.default_rng(0).choice(n, min(n, count or (150 if n < 100_000 else 50)), replace=False)
    s_nc = frame.positions @ cell.inverse
    # Along the first axis the neighbours of all of them are found at once: atoms in thin layers.
    along = s_nc[:, 0] - np.floor(s_nc[:, 0]) if cell.periodic[0] else s_nc[:, 0] - s_nc[:, 0].min()
    layers = min(LAYERS / max(along.max(), 1e-300), 1e15)
    layer = (along * layers).astype(np.uint16)
    order = np.argsort(layer, kind="stable")  # quick for small integers
    ahead, found, pairs, distance, apart = layer[order], np.zeros(0), 0.0, 0.0, 0.0
    for begin in range(0, len(sample), AT_ONCE):
        some = sample[begin : begin + AT_ONCE]
        which, r_bc = _around(s_nc, cell, cutoff, some, along[some], layers, ahead, order)
        number = np.bincount(which, minlength=len(some))
        distance += np.sqrt((r_bc**2).sum(1)).sum()
        for r in np.split(r_bc, np.cumsum(number)[:-1]) if triplets else ():
            m = len(r)
            if 1 < m < 400:
                i, j = np.triu_indices(m, 1)
                pairs += len(i)
                apart += np.linalg.norm(r[i] - r[j], axis=1).sum()
            elif m > 1:
                pairs += 0.5 * m * (m - 1)
                apart += 0.5 * m * (m - 1) * 1.03 * cutoff
        found = np.concatenate([found, number])
        if not count and found.std() <= CERTAIN * found.mean() * np.sqrt(len(found)):
            break
    return found.mean(), pairs / len(found), distance / max(found.sum(), 1), apart / max(pairs, 1)


def _around(s_nc, cell, cutoff, some, along, layers, ahead, order) -> tuple[np.ndarray, np.ndarray]:
    """Neighbours of some atoms: which of these each belongs to, ascending, and where it is from it.

    along : how far along the first axis each of them is; layers : in a unit of that; ahead, order : those of all atoms,
    ascending, and whose they are"""
    shifts = (-1.0, 0.0, 1.0) if cell.periodic[0] else (0.0,)
    reach = cutoff / cell.heights * (1 + 1e-9)
    ends = np.floor(layers * (np.add.outer(along, shifts)[:, :, None] + reach[0] * np.array([-1.0, 1.0])))
    ends = ends.reshape(-1, 2)
    ends = np.stack([np.searchsorted(ahead, ends[:, 0]), np.searchsorted(ahead, ends[:, 1], side="right")], axis=1)
    number = ends[:, 1] - ends[:, 0]
    near = order[np.arange(number.sum()) + np.repeat(ends[:, 0] - np.cumsum(number) + number, number)]
    which = np.repeat(np.repeat(np.arange(len(some)), len(shifts)), number)
    d_bc = np.empty((len(near), 0))
    for axis in range(3):
        d = s_nc[near, axis] - s_nc[some[which], axis]
        if cell.periodic[axis]:
            d -= np.rint(d)
        keep = np.abs(d) < reach[axis]
        near, which, d_bc = near[keep], which[keep], np.column_stack([d_bc[keep], d[keep]])
    r_bc = d_bc @ cell.vectors
    keep = ((r_bc**2).sum(1) < cutoff**2) & (near != some[which])
    return which[keep], r_bc[keep]


def load_of(pot, frame) -> Load:
    """Pairs, triplets and bonds that a potential will make of a frame, from a sample of it."""
    n = len(frame)
    known: dict[float, tuple] = {}
    total = {"pairs": 0.0, "triplets": 0.0, "tuples": 0.0, "bonds": 0.0}
    length = 0.0
    terms = [leaf for term in pot.terms for leaf in term.leaves(frame) if not leaf.field]
    if not pot.terms and pot.cutoff > 0:  # nothing is known of it: as if it were of pairs
        terms = [Term()]
        terms[0].cutoff = float(pot.cutoff)
    any_triplets = any(term.bodies > 2 and not term.listed for term in terms)
    for term in terms:
        if term.listed:
            m, k = _tuples(term, frame)
            total["tuples"] += m
            total["bonds"] += m * k * (k - 1) / 2
            length += m * k * (k - 1) / 2 * 1.5
            continue
        if term.cutoff not in known:
            known[term.cutoff] = neighborhood(frame, term.cutoff, triplets=any_triplets)
        neighbors, triplets, distance, apart = known[term.cutoff]
        pairs = 0.5 * neighbors * n
        total["pairs"] += pairs * term.sweeps
        total["bonds"] += pairs
        length += pairs * distance
        if term.bodies > 2:
            total["triplets"] += triplets * n
            total["bonds"] += triplets * n
            length += triplets * n * apart
    return Load(**total, length=length / total["bonds"] if total["bonds"] else 0.0)


def _tuples(term: Term, frame) -> tuple[int, int]:
    """How many listed tuples of how many atoms; what is wrong with them is said where bonds are made."""
    try:
        found = term.terms_of(frame)
    except AtcError:
        found = None
    return (0, 0) if found is None else found[0].shape


# --- what the sums cost


def visits(bound, kern, items: float, length: float) -> float:
    """(bond, point) pairs within reach: items of mean length `length` on a bound grid."""
    capsule = capsule_of(kern, length)
    # Points of a plane, a line, or scattered ones: as if the items filled the cell.
    volume = bound.cell_volume * len(bound) if bound.kind == "regular" else bound.cell.volume
    return items * len(bound) * capsule / volume


def capsule_of(kern, length: float) -> float:
    """The volume (in the plane: area) within reach of a bond."""
    R = kern.support
    return pi * R**2 + 2 * R * length if kern.dimension == 2 else 4 / 3 * pi * R**3 + pi * R**2 * length


def shadow(kern, length: float) -> float:
    """Its mean shadow: what meets rows of points."""
    R = kern.support
    return 2 * R + 2 / pi * length if kern.dimension == 2 else pi * R**2 + 0.5 * pi * R * length


def direct(costs: Costs, bound, kern, items: float, length: float, components: int) -> float:
    """Seconds of the exact sum of `items` bonds (or atoms: length 0) with so many components."""
    if not components or not items:
        return 0.0
    if bound.kind == "slab":
        return costs.slab_bond * items
    vectors = ceil(components / 4)
    many = visits(bound, kern, items, length)
    if not bound.is_lattice:
        return costs.point_bond * items + costs.point_visit * many
    R = kern.support
    if bound.kind == "regular":
        # The rows run along the axis with the most points; the shadow of the capsule over the area that belongs to a
        # row.
        row = bound.cell_volume / bound.spacing[int(np.argmax(bound.counts))]
        rows = items * shadow(kern, length) / row
    else:
        rows = many / max(1.0, 1.3 * R / max(bound.spacing.min(), 1e-9))
    visit = costs.visit_of(kern.compiled)
    return costs.bond * items + costs.row * rows + (visit + costs.accumulate * vectors) * many


def spectral(
    costs: Costs, deposit, items: float, length: float, components: int, atoms: float = 0.0, frames: int = 1
) -> float:
    """Seconds a frame of a spectral deposit (of which only the parameters are needed) for `items` bonds of mean length
    `length`, of so many atoms, of `frames` frames that are finished together."""
    if not components or not items:
        return 0.0
    single = itemsize(deposit) == 4
    point = costs.spread_point_single if single else costs.spread_point
    register = costs.spread_register_single if single else costs.spread_register
    node = costs.mesh_node_single if transform_itemsize(deposit) == 4 else costs.mesh_node
    groups = len(lanes(components))
    mesh, points = np.asarray(deposit.mesh, float), len(deposit.grid)
    nodes = float(mesh.prod())
    spread = items * points_each(deposit, length) * (point * groups + register * window_registers(deposit, components))
    transformed = float(components)
    if deposit.order is not None:
        from ..deposit.moments import count

        many = count(deposit.order, deposit.kernel.dimension)
        spread += items * (costs.moment_bond + costs.moment * many)
        spread += atoms * (costs.moment_atom + costs.moment_register * window_registers(deposit, 8 * ceil(many / 8)))
        spread += nodes * costs.moment_node * many
        transformed = many + (components if collapsed(deposit, length) < 1.0 else 0.0)
    if deposit.gradients:
        # Three more fields from the same modes: each is those times a wave number, and its values.
        again = 1.5e-8 * points + 8e-9 * _kept(deposit, mesh)
        if deposit._lattice is None:
            again += 0.5 * node * nodes
        spread += 3.0 * components * again
    return spread + (nodes * node * transformed + 3e-8 * points * components) / frames


def _kept(deposit, mesh) -> float:
    """Modes that are kept."""
    m = np.asarray(deposit.modes, float)
    return float(min(2 * m[0] + 1, mesh[0]) * min(2 * m[1] + 1, mesh[1]) * (m[2] + 1))


#: CPU seconds of a charge at a node of its window; how many of these there are on the mesh of fields at a tolerance
#: of 1e-4 and below.
WINDOW_NODE, WINDOW = 1e-9, 10.0**3


def products(costs: Costs, layout, kinds, atoms: int) -> float:
    """Seconds of the modes that the products of a field have; see `field_pass.Layout`."""
    node = costs.mesh_node_single if layout.single else costs.mesh_node
    charges = 1.5**3 * costs.mesh_node * layout.size + WINDOW_NODE * WINDOW * atoms
    return node * layout.size * layout.transforms + charges * (1 + 3 * any(k != "stress" for k in kinds))


def smooth(costs: Costs, term, frame, transforms: int) -> float:
    """Seconds of a field's energy and of `transforms` values at each atom."""
    from ..decomposers.long_range.transform import largest_of

    split, (vectors, _) = term.split, term.box(frame)
    nodes = float(np.prod(1.5 * (2.0 * largest_of(split.largest_wave(), vectors) + 1.0)))
    return (1 + transforms) * (costs.mesh_node * nodes + WINDOW_NODE * WINDOW * len(frame))


def squares(costs: Costs, bound, kern, cell, items: float, components: int, method, tolerance: float) -> float:
    """Seconds of Σ a φ² of `items` atoms, whose other sums are taken by `method`; see `Deposits.squares`."""
    from ..deposit import make
    from ..estimators.deposits import CLOSER_SQUARES, SQUARES, squared_kernel

    kern = kern.cut(SQUARES * tolerance)
    found = None if bound.kind == "slab" else squared_kernel(kern, cell)
    if found is None:
        return gather(costs, bound, kern, items, 0.0, components)
    if method.exact:
        return direct(costs, bound, found[1], items, 0.0, components)
    deposit = make(method.name, bound, found[1], cell, components, 0, 1, CLOSER_SQUARES * method.tolerance)
    return spectral(costs, deposit, items, 0.0, components)


def gather(costs: Costs, bound, kern, items: float, length: float, components: int) -> float:
    """Seconds of the exact Σ a φ and Σ a ∂φ/∂x of `items` atoms."""
    if bound.kind == "slab":
        return costs.slab_bond * items
    # The bins around a point cost as much as 25 atoms.
    return costs.gather_visit * (visits(bound, kern, items, 0.0) + 25.0 * len(bound)) * (1.0 + components / 32.0)


def lanes(components: int) -> list[int]:
    """Components of each mesh: up to eight go together, padded to four or eight."""
    return [4 if components - k <= 4 else 8 for k in range(0, components, 8)]


def window_registers(deposit, components: int) -> float:
    """Registers of 32 bytes that one point is added to: four lanes in single precision take a whole one too."""
    of_lanes = sum(max(1, n * itemsize(deposit) // 32) for n in lanes(components))
    return float(deposit.parameters.width**2 * deposit.depth * of_lanes)


def itemsize(deposit) -> int:
    """Bytes of a number on the mesh."""
    return np.dtype(deposit.real).itemsize


def transform_itemsize(deposit) -> int:
    """Bytes of a real number in the transforms."""
    return np.dtype(deposit._number).itemsize


# Lengths of bonds over their mean, at tenths of the distribution r² dr up to a cutoff.
_LENGTHS = tuple(4 / 3 * (0.1 + 0.2 * k) ** (1 / 3) for k in range(5))


def points_each(deposit, length: float) -> float:
    """Points that a bond becomes, where they are `length` long on average: one for an atom, none for a bond whose
    moments atoms carry."""
    if length <= 0:
        return 1.0
    on_bonds = [part for part, yes in zip(_LENGTHS, _collapse(deposit, length)) if not yes]
    return sum(deposit.bond_points.points_of(length * part) for part in on_bonds) / len(_LENGTHS)


def collapsed(deposit, length: float) -> float:
    """Which part of the bonds atoms carry as moments."""
    return sum(_collapse(deposit, length)) / len(_LENGTHS)


@lru_cache(maxsize=1)
def _collapse(deposit, length: float) -> tuple[bool, ...]:
    """Whether bonds of each of the lengths do. Forces fall off with the distance: a bond's share of the stress is taken
    to go with its length to the power −4 (argon between 4 and 8 Å: −5)."""
    if deposit.order is None:
        return (False,) * len(_LENGTHS)
    return tuple(deposit.collapses(length * part, part**-4) for part in _LENGTHS)


def spectral_memory(deposit, components: int, threads: int, atoms: float = 0.0) -> float:
    """Bytes of a spectral deposit: each thread's meshes (single precision is summed up in double now and then), the
    modes of one group of components, and planes and transforms in work; moments of so many atoms in each thread, and
    their mesh."""
    nodes = float(np.prod(deposit._layer(np.asarray(deposit.mesh, float) + deposit.parameters.width + 1)))
    each = 8.0 if itemsize(deposit) == 8 else 12.0
    groups = lanes(components)
    # As complex numbers, half of the box: kept modes of y and z, all of x; and once more the kept ones.
    counts, modes = np.asarray(deposit.mesh, float), np.asarray(deposit.modes, float)
    kept = counts[0] * min(2 * modes[1] + 1, counts[1]) * (modes[2] + 1)
    complex_ = 2.0 * transform_itemsize(deposit)
    moments = 0.0
    if deposit.order is not None:
        layout = deposit.layout
        moments = atoms * layout.row * itemsize(deposit) * threads
        moments += nodes * each * deposit.most_components + complex_ * kept * components
    return moments + nodes * each * sum(groups) * threads + complex_ * kept * (2.0 * min(components, 8) + 2.0 * threads)


def check(costs: Costs, bound, kern, items: float, length: float, points: int) -> float:
    """Seconds of the error check: every bond passes by, those that start near a point are looked at, and those near it
    are summed there."""
    if bound.kind == "slab":
        return 7e-8 * items * 5
    # The longest bonds are about 4/3 of the mean (pairs within a cutoff); what is in reach is marked in bins
    # (`deposit.direct`).
    reach = 1.11 * (kern.support + 4 / 3 * length)
    near = 1.0 - exp(-points * (pi * reach**2 if kern.dimension == 2 else 4 / 3 * pi * reach**3) / bound.cell.volume)
    reached = items * points * capsule_of(kern, length) / bound.cell.volume
    return costs.filter_bond * items + costs.point_bond * near * items + costs.point_visit * reached
