"""The spectral deposit where atoms carry the moments of their bonds (`moments`): bonds too long or too strong for that
become points."""

from __future__ import annotations

from math import ceil, frexp

import numpy as np

from ..errors import AtcError
from . import moments, spread
from .bond_points import SAMPLE
from .direct import _NOT_FINITE, _array, stress_components
from .spectral import SPARSE, SpectralDeposit

# `spectral.DENSE` of atoms: at R = 20 Å, points of as many components as the mesh has.
DENSE_ATOMS = 36.0
# Sums on a node, in single precision, over what they are for atoms with few components: their moments are sums already.
LONGER = 8.0


def spectral_deposit(
    grid, kernel, cell, n_site, n_bond, threads=1, tolerance=1e-5, gradients=False, order=None
) -> SpectralDeposit:
    """One way or the other. order : of the moments, for stresses (six components); None: all bonds become points."""
    if order is None or n_bond != 6:
        return SpectralDeposit(grid, kernel, cell, n_site, n_bond, threads, tolerance, gradients=gradients)
    return CollapsingDeposit(grid, kernel, cell, n_site, threads, tolerance, gradients, order)


class CollapsingDeposit(SpectralDeposit):
    """Bonds of `add_bond_stress` whose other ends are given are gathered at their atoms, as far as the tolerance
    allows.

    The rows of moments are each thread's own; they are brought onto meshes when an atom turns up somewhere else
    (another frame), and in the end. Whether a bond is collapsed depends on its length and its strength, as the number
    of its points would: the order decides only how many are.
    """

    dense = DENSE_ATOMS

    def __init__(self, grid, kernel, cell, n_site, threads=1, tolerance=1e-5, gradients=False, order=3):
        self.order, self.most_components = order, 8 * ceil(moments.count(order, kernel.dimension) / 8)
        super().__init__(grid, kernel, cell, n_site, 6, threads, tolerance, gradients=gradients)
        self.layout = moments.Layout(order, self.real, kernel.dimension)
        self._rows = [None] * self.threads
        self._longest = None

    def collapses(self, length: float, strength: float = 1.0) -> bool:
        """Whether atoms carry a bond of this length, and so many times as strong as the mean: an estimate like
        `points_of`."""
        return bool(self._errors.longest([2.0 * self.bond_points.share / strength])[0] >= length)

    @property
    def _errors(self):
        """The errors of collapsing bonds."""
        return moments.errors(self.kernel, self.order, self.gradients, self.parameters, self._mesh_share)

    def add_bond_stress(self, x_nc, i_b, r_bc, G_b, thread=0, j_b=None):
        if j_b is None:
            super().add_bond_stress(x_nc, i_b, r_bc, G_b, thread)
            return
        x_nc, r_bc, G_b = (_array(a) for a in (x_nc, r_bc, G_b))
        i_b, j_b = (_array(a, np.int32) for a in (i_b, j_b))
        n = len(G_b)
        if r_bc.shape != (n, 3) or i_b.shape != (n,) or j_b.shape != (n,):
            raise ValueError(
                f"i_b, j_b and r_bc must have shapes {(n,)} and {(n, 3)}, got {i_b.shape}, {j_b.shape} and {r_bc.shape}"
            )
        if not 0 <= thread < self.threads:
            raise ValueError(f"thread {thread} of a deposit made for {self.threads}")
        mean, most, finite, low, high = moments.survey(i_b, j_b, r_bc, G_b)
        if low < 0 or high >= len(x_nc):
            raise ValueError("i_b or j_b holds indices outside x_nc")
        if not finite:
            raise AtcError(_NOT_FINITE)
        if most == 0.0:
            return
        if self._longest is None:
            self._longest = self._errors.longest(self.bond_points.levels)
        weight = np.divide(1.0, mean, out=np.zeros_like(mean), where=mean > 0)
        slack = 0
        if n > SAMPLE:
            some = slice(None, None, n // SAMPLE)
            slack = self.bond_points.slack(
                i_b[some],
                r_bc[some],
                stress_components(r_bc[some], G_b[some]),
                weight,
                (self._longest, self._errors.of),
            )
        add, rest, first = moments.core(self.order, self.real), np.empty(n, np.int64), 0
        points = []
        while first < n:
            rows = self._rows_for(thread, len(x_nc), most)
            first, k = add(
                x_nc,
                i_b,
                j_b,
                r_bc,
                G_b,
                first,
                weight,
                slack,
                self._longest,
                1.0 / self.kernel.radius,
                1.0 / rows.scale,
                rows.rows,
                rows.places,
                rest,
            )
            if first < 0:
                raise AtcError(_NOT_FINITE)
            points.append(rest[:k].copy())
            if first < n:  # an atom has moved: another frame
                self._spread_rows(thread)
        rest = np.concatenate(points)
        if len(rest):
            self._add(
                "bond",
                x_nc,
                i_b[rest],
                r_bc[rest],
                stress_components(r_bc[rest], G_b[rest]),
                thread,
                typical=mean,
                slack=slack,
            )

    def _rows_for(self, thread, n, most):
        """The rows of a thread, for n atoms and bonds up to `most`."""
        rows = self._rows[thread]
        single = self.real is np.float32
        if rows is not None and (len(rows.rows) != n or (single and not 1e-9 < most / rows.scale < 1e9)):
            self._spread_rows(thread)
            rows = None
        if rows is None:
            rows = self._rows[thread] = moments.Rows(self.layout, n)
            rows.scale = 2.0 ** max(frexp(most)[1], -1000) if single else 1.0
        return rows

    def _spread_rows(self, thread, workers=1):
        """Onto meshes, what the atoms carry in one thread."""
        rows, self._rows[thread] = self._rows[thread], None
        which = rows.touched()
        if not len(which):
            return
        x_nc = rows.positions(which)
        if not np.isfinite(x_nc).all():
            raise AtcError(_NOT_FINITE)
        t = (x_nc - self._origin) @ self._to_mesh
        lo, hi = self._seen(t.min(0), t.max(0))
        if (lo >= hi)[~self._periodic].any():
            return
        # Neighbours one after the other: the mesh is larger than the processor's cache.
        order = self._by_place(t)
        which, x_nc = which[order], x_nc[order]
        width, coef = self.parameters.width, self.window
        spread_rows, coef_flat = (
            spread.row_core(width, len(coef) - 1, self.real, self.depth),
            coef.ravel().astype(self.real),
        )
        columns = np.full(8 * ceil(len(self.layout.columns) / 8), -1)
        columns[: len(self.layout.columns)] = self.layout.columns
        columns = columns.reshape(-1, 8)
        meshes = [self._mesh_for(("moment", 8 * g, thread), lo, hi, 8, rows.scale) for g in range(len(columns))]
        short = (
            self._short(meshes[0], LONGER * SPARSE / (width**2 * self.depth)) if self.real is np.float32 else len(which)
        )

        def groups(some):
            mine = meshes[some]
            where = np.array([m.flat.ctypes.data for m in mine])
            first = mine[0]
            for s in range(0, len(which), short):
                for m in mine:
                    if m.points + min(short, len(which) - s) > short:
                        m.flush(width)
                n = spread_rows(
                    x_nc[s : s + short],
                    which[s : s + short],
                    rows.rows,
                    columns[some],
                    rows.scale / first.scale,
                    self._origin,
                    self._to_mesh,
                    self._period,
                    first.low,
                    np.array(first.shape),
                    first.row,
                    coef_flat,
                    where,
                    first.rows,
                )
                for m in mine:
                    m.points += n
                    if m is not first:
                        np.maximum(m.rows, first.rows, out=m.rows)
                with self._counting:
                    self._visits[thread] += n * width**2 * self.depth * len(mine)
                    self._points[thread] += n * (some.start == 0)

        workers = min(workers, len(columns))
        self._each(groups, [slice(w, None, workers) for w in range(workers)], workers)

    def _by_place(self, t):
        """An order of points (mesh spacings) in which what follows is near: in columns along z, a few nodes wide."""
        t = t - np.where(
            self._periodic, np.floor(t / np.maximum(self._period, 1)) * self._period, t.min(0, initial=np.inf)
        )
        c = np.clip(t, 0, 2**20 - 1).astype(np.int64)
        return np.argsort((c[:, 0] >> 3) << 40 | (c[:, 1] >> 3) << 20 | c[:, 2])

    def _gather_rows(self):
        """Everything onto meshes: together where the threads have the same frame."""
        first = None
        for t, rows in enumerate(self._rows):
            if rows is None:
                continue
            if first is None:
                first = t
            elif self._rows[first].join(rows):
                self._rows[t] = None
        for t, rows in enumerate(self._rows):
            if rows is not None:
                self._spread_rows(t, self.threads)

    def _done(self, what, group):
        """Of bonds, from points and moments."""
        if what != "bond":
            return super()._done(what, group)
        self._gather_rows()
        meshes = self._of("bond") + self._of("moment")
        if not meshes:
            return None
        extent = self._extents(meshes)
        scale = max(max(m.scale, m.largest) for m in meshes)
        F, modes = None, None
        columns = range(len(self.layout.columns))
        for what, groups in (
            ("bond", self._groups(6)),
            ("moment", [(k, min(k + 8, len(columns)), 8) for k in columns[::8]]),
        ):
            for group in groups:
                done = self._transformed(what, group, extent)
                if done is None:
                    continue
                modes, S, largest = done
                F = np.zeros((6, *S[0].shape), S[0].dtype) if F is None else F
                self._combine(F, modes, S, largest / scale, None if what == "bond" else columns[group[0] : group[1]])
        response = modes.response().astype(self._number)
        for f in F:
            f *= response
        return modes, list(F), scale

    def _combine(self, F, modes, S, factor, columns):
        """F += factor S, or what moments S of some columns are of the stress."""
        b = np.ascontiguousarray(2 * np.pi * modes.inverse * self.kernel.radius)
        S = np.stack(S)

        def component(c):
            if columns is None:
                F[c] += S[c] * S.dtype.type(factor)
                return
            which, alphas, factors = self.layout.parts(columns, c)
            if len(which):
                moments.contract(
                    S.view(self._number), which, alphas, factor * factors, *modes.index, b, F[c].view(self._number)
                )

        self._each(component, range(6))
