"""Where the error of an approximate sum over bonds is likely to be largest: around the strongest bonds of a frame.

A few strong bonds can make most of an error, all of it within the kernel's reach of them, and a hundred random points
of a large grid need not have one that is near. So the strongest bonds are remembered as they stream by. Most of them
are summed exactly, a thousandth of a percent of all: sums are linear, so that they can be taken out of an approximate
one. The strongest of those left are watched: the error that they make alone is known at every grid point, and where it
is largest the fields are computed exactly. That needs few atoms: those around the points, as an open cluster.

Which bonds and points these are depends on the frame alone, not on threads or on who computes it.
"""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np

from ...bonds import Bonds
from ...compiled import njit
from ...deposit import make
from ...errors import AtcError
from ...frame import Cell
from ...grids import BoundGrid
from ..bond_pass import BondFactors
from ..deposits import Deposits
from ..tensors import outer6

#: Of the strongest bonds as many are summed exactly, one for so many atoms.
EXACTLY, ATOMS_EACH = 1024, 32
#: How much stronger than the mean those are: more than what the spectral deposit takes for strong
#: (`deposit.spread.STRONG`).
STRONG = 24.0
#: The strongest of those left, whose error is looked at; points (some of them come
#: before all others) and places, with several points around them, where all fields are computed exactly.
WATCHED, POINTS, FIRST, PLACES = 64, 32, 12, 6
#: Points where the bonds that are summed exactly are felt, and how much of their largest sum counts as that: nothing
#: may be left of their approximation.
FELT, FEEL = 12, 3e-3


class StrongestBonds:
    """The strongest bonds of a frame, by |F| |r|; `add` may be called from several threads.

    Attributes
    ----------
    exactly : how many of them are to be summed exactly, at most before `sort_out`
    """

    def __init__(self, x_nc, threads):
        self.x_nc = x_nc
        self.exactly = self.most_exactly = int(np.clip(len(x_nc) // ATOMS_EACH, 16, EXACTLY))
        self.most = self.exactly + WATCHED
        self._found: list[tuple | None] = [None] * threads  # keys, Bonds
        self._floor = [0.0] * threads
        self._sizes = np.zeros((threads, 2))  # sum, and number
        self._ranked: Bonds | None = None

    def add(self, bonds, thread):
        if bonds.F_bc is None:
            size_b = np.abs(bonds.G_b) * np.einsum("bc,bc->b", bonds.r_bc, bonds.r_bc)
        else:
            size_b = np.linalg.norm(bonds.F_bc, axis=1) * np.linalg.norm(bonds.r_bc, axis=1)
        floor = self._floor[thread]
        if floor == 0.0 and len(size_b) > 2 * self.most:
            # As many have at least this size, and a key that is no smaller.
            floor = float(np.partition(size_b, -self.most)[-self.most]) * (1.0 - 1e-12)
        k, keys, total = _above(self.x_nc, bonds.i, bonds.r_bc, size_b, floor)
        self._sizes[thread] += total, len(bonds)
        if not len(k):
            return
        some = bonds.taken(k)
        if self._found[thread] is not None:
            keys = np.concatenate([self._found[thread][0], keys])
            some = Bonds.concatenate([self._found[thread][1], some])
        if len(keys) > 1.5 * self.most:
            best = np.argpartition(keys, -self.most)[-self.most :]
            keys, some = keys[best], some.taken(best)
            self._floor[thread] = float(keys.min())
        self._found[thread] = keys, some

    def ranked(self) -> Bonds:
        """All that count, strongest first."""
        if self._ranked is None:
            found = [f for f in self._found if f is not None]
            if not found:
                return Bonds.empty()
            keys = np.concatenate([f[0] for f in found])
            order = np.argsort(-keys, kind="stable")[: self.most]
            self._ranked = Bonds.concatenate([f[1] for f in found]).taken(order)
        return self._ranked

    @property
    def mean(self) -> float:
        """Mean |F| |r| of all bonds."""
        total, count = self._sizes.sum(0)
        return float(total / max(count, 1.0))

    @classmethod
    def among(cls, x_bc, bonds, exactly, totals):
        """Known ones in their order: bond k begins at x_bc[k]."""
        self = cls(x_bc, 1)
        self._ranked, self.exactly, self._sizes = bonds, exactly, np.array([totals])
        return self

    @property
    def totals(self) -> np.ndarray:
        """Sum of |F| |r| of all bonds, and their number."""
        return self._sizes.sum(0)

    def sort_out(self) -> Bonds:
        """Those that are to be summed exactly: the ones that are really strong against the mean of all bonds."""
        known = self.ranked()
        size_b = np.linalg.norm(known.forces(), axis=1) * np.linalg.norm(known.r_bc, axis=1)
        weak = size_b <= STRONG * self.mean
        self.exactly = min(self.exactly, int(np.argmax(weak)) if weak.any() else len(known))
        return known.taken(slice(self.exactly))

    def centres(self, cell):
        """(s, 3) the middles of all that count, relative to the cell's origin."""
        known = self.ranked()
        return cell.wrap(self.x_nc[known.i])[0] - 0.5 * known.r_bc - cell.origin

    def watched(self, cell):
        """Those left, strongest first: where they begin (s, 3), in the cell; their vectors (s, 3); one component of
        their stress factors (s, 1), the largest of the first."""
        few = self.ranked().taken(slice(self.exactly, None))
        if few.F_bc is None:
            b = outer6(few.r_bc) * few.G_b[:, None]
        else:
            b = -(few.r_bc[:, :, None] * few.F_bc[:, None, :]).reshape(-1, 9)
        k = int(np.abs(b[0]).argmax()) if len(few) else 0
        return cell.wrap(self.x_nc[few.i])[0], few.r_bc, np.ascontiguousarray(b[:, k : k + 1])


class StrongestOfFrames:
    """The strongest bonds of the frames whose sums are added up: as many are summed exactly as of one frame, and the
    rest watched.

    Attributes
    ----------
    all : StrongestBonds, as of one frame: those that are to be summed exactly, and those to be watched
    exactly : where the former begin (s, 3), their vectors (s, 3) and the factors of the named sums (s, k)
    """

    def __init__(self, frames, found: list[StrongestBonds], names, drifts):
        factors = [BondFactors(names, f, v).of(s.ranked()) for f, s, v in zip(frames, found, drifts)]
        strong = [len(strongest.sort_out()) for strongest in found]
        x_bc = [frame.positions[strongest.ranked().i] for frame, strongest in zip(frames, found)]
        if len(found) == 1:
            self.all, n = found[0], strong[0]
            self.exactly = x_bc[0][:n], self.all.ranked().r_bc[:n], factors[0][:n]
            return
        x_bc, b_bk = np.concatenate(x_bc), np.concatenate(factors)
        strong_b = np.concatenate([np.arange(len(s.ranked())) < n for s, n in zip(found, strong)])
        bonds = Bonds.concatenate([s.ranked() for s in found])
        order = np.argsort(-np.linalg.norm(bonds.forces(), axis=1) * np.linalg.norm(bonds.r_bc, axis=1), kind="stable")
        exact = order[strong_b[order]][: max(s.most_exactly for s in found)]
        k = np.r_[exact, order[~np.isin(order, exact)][:WATCHED]]
        bonds = bonds.taken(k)
        bonds.i = np.arange(len(k), dtype=np.int32)
        self.all = StrongestBonds.among(x_bc[k], bonds, len(exact), sum(s.totals for s in found))
        self.exactly = x_bc[exact], bonds.r_bc[: len(exact)], b_bk[exact]


def summed_exactly(deposit, place, x_bc, r_bc, b_bk) -> np.ndarray:
    """Take bonds out of an approximate deposit that has them; returns their exact sums (g, k), as exact as those that
    errors are measured with."""
    deposit.add_strong(x_bc, r_bc, -b_bk)
    exact = make("direct", place.bound, place.check_kern, place.cell, 0, b_bk.shape[1])
    exact.add_bonds(x_bc, r_bc, b_bk)
    return exact.bond_sums()


def nearest_image(d, cell):
    """(..., 3) vectors by way of the nearest image."""
    return d - np.where(cell.periodic, np.rint(d @ cell.inverse), 0.0) @ cell.vectors


@njit(cache=True, nogil=True, error_model="numpy")
def _above(x_nc, i, r_bc, size_b, floor):
    """Indices and keys of the bonds whose key is above `floor`; the sum of all sizes. Equal bonds, as in a crystal, get
    keys that differ a little, by where they are."""
    n, total = 0, 0.0
    which, keys = np.empty(len(i), np.int64), np.empty(len(i))
    for b in range(len(i)):
        size = size_b[b]
        total += size
        if size * 1.01 <= floor or size == 0.0:
            continue
        a = i[b]
        u = np.sin(
            12.9898 * x_nc[a, 0]
            + 78.233 * x_nc[a, 1]
            + 37.719 * x_nc[a, 2]
            + 3.7 * r_bc[b, 0]
            + 5.1 * r_bc[b, 1]
            + 7.3 * r_bc[b, 2]
        )
        key = size * (1.0 + 0.01 * abs(u))
        if key > floor:
            which[n], keys[n] = b, key
            n += 1
    return which[:n], keys[:n], total


def error_map(approximate, exact, bonds, typical) -> np.ndarray:
    """(g,) the error that a few bonds alone make at every grid point.

    approximate, exact : empty deposits for one component
    typical : (1,) how large they are on average, which says how closely they are integrated
    """
    approximate.add_among(*bonds, typical)
    exact.add_bonds(*bonds)
    return np.abs(approximate.bond_sums()[:, 0] - exact.bond_sums()[:, 0])


def error_of(place, bonds, strongest) -> np.ndarray:
    """(g,) the error that bonds alone (see `StrongestBonds.watched`) make in the place's own sums at every grid
    point."""
    exact = make("direct", place.bound, place.check_kern, place.cell, 0, 1)
    return error_map(place.grid.make("bond", 0, 1), exact, bonds, np.array([strongest.mean / 3.0]))


def felt_points(strong_g, index) -> np.ndarray:
    """A few points, at random but always the same ones, where the strongest bonds' sum is not small against its largest
    value."""
    where = np.flatnonzero(strong_g > FEEL * strong_g.max(initial=0.0))
    return np.random.default_rng([20261124, index]).permutation(where)[:FELT]


def worst_points(error_g) -> np.ndarray:
    """The points with the largest errors, largest first: more than are needed."""
    many = min(len(error_g), 8 * POINTS)
    best = np.argpartition(-error_g, many - 1)[:many]
    return best[np.lexsort((best, -error_g[best]))][: int(np.count_nonzero(error_g))]


def placed(bound, candidates, most, centres, apart):
    """The first of some grid points that lie around a few places.

    Parameters
    ----------
    candidates, most : indices of points, in order; how many of them are taken at most
    centres : (s, 3) of bonds, relative to the cell's origin: possible places
    apart : how far apart two places are, and a point at most from its own

    Returns
    -------
    which : (h,) indices of the points, ascending
    xyz : (h, 3) where they are, or the periodic images of them that are near their place, relative to the cell's origin
    places : (p, 3)
    """
    places, chosen = [], {}
    for g, point in zip(candidates, bound.relative_points_of(candidates)):
        if len(chosen) == most:
            break
        near = [nearest_image(point - p, bound.cell) for p in places]
        k = int(np.argmin([np.linalg.norm(d) for d in near])) if near else -1
        if k < 0 or np.linalg.norm(near[k]) > apart:
            if len(places) == PLACES:
                continue
            d = nearest_image(point - centres, bound.cell)
            c = int(np.argmin(np.linalg.norm(d, axis=1)))
            places.append(centres[c])
            k, near = len(places) - 1, [*near, d[c]]
        chosen[int(g)] = places[k] + near[k]
    which = np.array(sorted(chosen), np.int64)
    return which, np.array([chosen[g] for g in which]).reshape(-1, 3), np.array(places).reshape(-1, 3)


def cluster_around(frame, centres, radius):
    """Atoms and their images within a radius of any of some points: an open frame, which atoms, None if they are too
    many.

    Parameters
    ----------
    centres : (p, 3) relative to the cell's origin
    radius : (p,) or one for all
    """
    from ..tile_cuts import cluster

    cell = frame.cell
    most = len(frame) // 2
    radius_p = np.broadcast_to(np.asarray(radius, dtype=float), len(centres)).copy()
    n, index, image = _around(
        frame.positions,
        cell.origin,
        cell.inverse,
        centres @ cell.inverse,
        radius_p,
        radius_p[:, None] / cell.heights,
        cell.vectors,
        np.array(cell.periodic),
        most,
    )
    if n > most:
        return None
    return cluster(frame, frame.positions[index[:n]], index[:n], image[:n]), index[:n]


@njit(cache=True, nogil=True, error_model="numpy")
def _around(x_nc, origin, inverse, p_pc, radius_p, wide_pc, vectors, periodic, most):
    index, image = np.empty(most, np.int64), np.empty((most, 3), np.int64)
    n = 0
    lo, hi = np.zeros(3, np.int64), np.zeros(3, np.int64)
    s_c, cell_c = np.zeros(3), np.zeros(3, np.int64)
    for a in range(len(x_nc)):
        first = n
        x, y, z = x_nc[a, 0] - origin[0], x_nc[a, 1] - origin[1], x_nc[a, 2] - origin[2]
        for c in range(3):
            s = x * inverse[0, c] + y * inverse[1, c] + z * inverse[2, c]
            # Images of the atom are counted from where it is, those looked for from the cell.
            cell_c[c] = np.int64(np.floor(s)) if periodic[c] else 0
            s_c[c] = s - cell_c[c]
        for p in range(len(p_pc)):
            none = False
            for c in range(3):
                d = p_pc[p, c] - s_c[c]
                if periodic[c]:
                    lo[c], hi[c] = np.int64(np.ceil(d - wide_pc[p, c])), np.int64(np.floor(d + wide_pc[p, c]))
                    none = lo[c] > hi[c]
                else:
                    none = abs(d) > wide_pc[p, c]
                if none:
                    break
            if none:
                continue
            limit2 = radius_p[p] * radius_p[p]
            for k0 in range(lo[0], hi[0] + 1):
                for k1 in range(lo[1], hi[1] + 1):
                    for k2 in range(lo[2], hi[2] + 1):
                        d0, d1, d2 = s_c[0] + k0 - p_pc[p, 0], s_c[1] + k1 - p_pc[p, 1], s_c[2] + k2 - p_pc[p, 2]
                        far = 0.0
                        for c in range(3):
                            x = d0 * vectors[0, c] + d1 * vectors[1, c] + d2 * vectors[2, c]
                            far += x * x
                        if far > limit2:
                            continue
                        known = False
                        for m in range(first, n):
                            known |= (
                                image[m, 0] == k0 - cell_c[0]
                                and image[m, 1] == k1 - cell_c[1]
                                and image[m, 2] == k2 - cell_c[2]
                            )
                        if known:
                            continue
                        if n == most:
                            return n + 1, index, image
                        index[n], image[n, 0], image[n, 1], image[n, 2] = (
                            a,
                            k0 - cell_c[0],
                            k1 - cell_c[1],
                            k2 - cell_c[2],
                        )
                        n += 1
    return n, index, image


class PointsAround:
    """The points around the strongest bonds of a frame, or of several with one cell, and the exact sums over bonds
    there.

    Parameters
    ----------
    frame : Frame, the first of them
    place : `place.Place`
    strongest : StrongestBonds
    strong_g : (g,) largest component of the exact sums of those bonds that are summed exactly

    Attributes
    ----------
    check : Check with these points
    """

    def __init__(self, frame, place, strongest, strong_g):
        self.place = place
        bonds = strongest.watched(frame.cell)
        candidates = felt_points(strong_g, place.index)
        if len(bonds[0]):
            worst = worst_points(error_of(place, bonds, strongest))
            candidates = np.r_[worst[:FIRST], candidates, worst[FIRST:]]
        self.which, self.xyz, self.places = placed(
            place.bound, candidates, FELT + POINTS, strongest.centres(frame.cell), 1.5 * place.kern.radius
        )
        self.check = place.checked_at(self.which)
        self.check.deposits.place(frame.positions)

    def __len__(self):
        return len(self.which)

    def bond_sums(self, frame, pot, work, drift, chosen=None, anchor=None, kept=None) -> np.ndarray:
        """(h, k) the sums over the bonds of a frame that count, exactly. kept : what gives them again, or None."""
        # Fields have no bonds: `field_pass` adds them. But the forces of constraints depend on theirs.
        threads = self.place.threads
        if pot.constraints is None:
            pot = pot.local
        few = None if kept else self._cluster(frame, pot, self.place.check_kern.support)
        context, deposits = nullcontext(), self.check.deposits
        if few is not None:
            frame, index = few
            chosen = None if chosen is None else chosen.of(index)
            home = Cell(frame.cell.vectors, (0.0, 0.0, 0.0), (False, False, False))
            points = BoundGrid("points", home, ("point",), xyz=np.ascontiguousarray(self.xyz))
            deposits = Deposits(
                {}, points, deposits.kern, home, threads, origin=frame.cell.origin, summed=self.place.check_kern
            )
        elif anchor is not None:
            context = anchor.at(frame)
        factors = BondFactors(work.bond, frame, drift)
        more = ({"sources": True} if factors.sources else {}) | ({"kept": kept} if kept else {})
        with context:
            return factors.sums_near(deposits, pot, frame, threads, chosen, energies=False, forces=False, **more)

    def _cluster(self, frame, pot, reach):
        """The atoms that matter as an open frame, and which they are; None where all of them must be asked."""
        from ..tile_cuts import depth

        across = not all(t.central or t.edges for t in pot.terms)
        if frame.topology or pot.constraints is not None or not pot.terms or across:
            return None
        try:
            deep = depth(pot)
        except AtcError:
            return None
        # A ball around the points of each place.
        own = np.linalg.norm(self.xyz[:, None] - self.places, axis=2).argmin(1)
        groups = [self.xyz[own == p] for p in np.unique(own)]
        centres = np.array([0.5 * (x.min(0) + x.max(0)) for x in groups])
        radius = [np.linalg.norm(x - c, axis=1).max() + reach + deep for x, c in zip(groups, centres)]
        found = cluster_around(frame, centres, radius)
        return found
