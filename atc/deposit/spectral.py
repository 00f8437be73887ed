"""The spectral deposit: both sums by way of their Fourier modes, at a cost that does not depend on the kernel's radius.

    f(x) = Σ_p c_p φ(x − y_p) = (1/V) Σ_k φ̂(k) S(k) e^{ik·x},   S(k) = Σ_p c_p e^{−ik·y_p}

Bonds become Gauss-Legendre points y_p along them. S(k) is what a mesh of points spread with a window gives, divided by
the window's own transform (Dutt & Rokhlin, SIAM J. Sci. Comput. 14 (1993) 1368; Kaiser-Bessel window). Derivatives are
the modes times ik. How the modes become values on a grid is in `modes`; how fine the mesh is, how wide the window and
how many points a bond gets follows from the tolerance (`fourier`).

In two dimensions (a planar kernel) the mesh is a single layer that repeats along z: the mean over z of a cell of unit
thickness is the field.

Along open axes the box of the modes is as long as the atoms and the part of the grid that they reach, and a kernel's
reach more, so that no image is seen.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from math import ceil, frexp
from threading import Lock

import numpy as np

from ..errors import AtcError
from . import fourier, spread
from .bond_points import SAMPLE, BondPoints
from .direct import _NOT_FINITE, Deposit
from .mesh import Mesh
from .modes import Modes, largest_modes, separable

# Bytes of one mesh, of one group of components.
LARGEST = 8.0e9
# Points to spread in a ball of radius R/4, as in dense argon at R = 10 Å: what the choice between a fine mesh and a
# wide window goes by.
DENSE = 200.0
# What of the tolerance goes to the modes left out, to those that the mesh confuses, and to the bonds' points. The
# squares of the errors add up; the largest error among many points over the largest value is up to twice what the same
# ratio of mean squares is: where modes decay slowly, what is left out gathers at the kernel's centre and edge. Leaving
# out little is dear for those kernels, and cheap for the Gaussian. By whether all derivatives of φ are continuous.
SHARES = {True: (0.35, 0.25, 0.9), False: (0.4, 0.25, 0.4)}
# What of its share the modes left out get in the plane, where gradients are wanted: measured, the largest errors of 1.5
# times the tolerance become 0.8.
PLANE_RIM = 0.35
# From this tolerance on meshes are in single precision, and from the second on transforms too. Rounding errors are
# relative to all modes, kept or not: the wider the kernel, the smaller a part of them is the field. Measured on argon
# with R = 10 and 20 Å: 1e-6 and 2e-6 of its largest value.
SINGLE, SINGLE_TRANSFORM = 1e-5, 1e-4
# Points that a mesh in single precision gets before it is moved into one of double precision: sums have to stay short.
# From SINGLE_TRANSFORM on that many a node, if those are more.
SHORT = 8000, 16.0
# Atoms are never many near one node, other than the points of the bonds of one: as many as make so many sums a node on
# average.
SPARSE = 100.0


class SpectralDeposit(Deposit):
    """Site and bond sums through Fourier modes, for any cell and any grid but slabs. See `atc.deposit.make`.

    Sums are linear in what has been added: frames of one averaging window, all with the same cell, may be added one
    after the other and finished once.

    Parameters
    ----------
    tolerance : relative to the largest value, anywhere in the cell, of a field of independent sources (a field that is
        their sum is larger, one that
        is their difference smaller)
    points : how many points will be spread, if known: only the speed depends on it
    gradients : whether the tolerance is meant for gradients as well

    Attributes
    ----------
    parameters : fourier.Parameters
    mesh, modes : (3,) nodes of the mesh along the cell's edges, and largest mode number kept; on open axes of the part
        of the grid that anything has
        been added to, before that of all of it

    Raises
    ------
    AtcError
        For kernels that jump (step, box), slabs, and where the tolerance asks for a mesh that does not fit in memory.
    """

    dense = DENSE
    # Components of the meshes that there are at the same time; the order of the moments of bonds that atoms carry
    # (`collapse`).
    most_components, order = 8, None

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads=1, tolerance=1e-5, points=None, gradients=False):
        super().__init__(grid, kernel, cell, n_site, n_bond, threads)
        self.tolerance, self.gradients = float(tolerance), bool(gradients)
        self._flat = kernel.dimension == 2
        fourier.spectrum(kernel)
        if grid.kind == "slab":
            raise AtcError("method 'spectral' does not average over slabs: use method 'direct'")
        self.real = np.float32 if self.tolerance >= SINGLE else np.float64
        self._number = np.float32 if self.tolerance >= SINGLE_TRANSFORM else np.float64
        modes, mesh, share = (self.tolerance * share for share in SHARES[kernel.analytic])
        self.bond_points = BondPoints(kernel, share, self.gradients)
        if self._flat and self.gradients and not kernel.analytic:
            # The rim of a disc is more of it than that of a ball: where slopes have kinks, errors gather there.
            modes *= PLANE_RIM
        # All points at the kernels' centres, where most of what is left out is.
        centre = self.tolerance if grid.kind == "atoms" else None
        if not grid.is_lattice or separable(grid, self._inverse) is None:
            # The mesh is used twice.
            mesh *= np.sqrt(0.5)
        density = (
            self.dense / (kernel.radius / 2.5) ** kernel.dimension / 4 if points is None else points / self.cell.volume
        )
        # Nearby densities give nearby choices: round, so that they can be remembered.
        costs = fourier.COSTS[np.dtype(self.real).itemsize]
        self.parameters = p = fourier.cheapest_mesh(
            kernel, modes, mesh, float(f"{density:.1e}"), costs, self.gradients, centre
        )
        periodic = self._periodic = np.array([*self.cell.periodic[:2], self._flat or self.cell.periodic[2]], bool)
        edges = np.linalg.norm(self._vectors, axis=1)
        nodes = np.array([_good_length(max(ceil(edge / p.spacing), p.width + 1, 4)) for edge in edges])
        if self._flat:
            nodes[2] = 1
        # Mesh spacings along each edge: a whole number on periodic axes.
        per_edge = np.where(periodic, nodes, edges / p.spacing)
        self._spacings = self._vectors / per_edge[:, None]
        self._to_mesh = np.ascontiguousarray(self._inverse * per_edge)
        self._period = np.where(periodic, nodes, 0)
        self._halo = (p.width + 1) // 2
        self._lattice = separable(grid, self._to_mesh)
        self._reach = np.where(periodic, np.inf, kernel.support * np.linalg.norm(self._to_mesh, axis=0))
        self._view = self._targets()
        self._meshes = {}
        self._check(
            self._layer(
                np.where(periodic, nodes, np.minimum(self._view[1] - self._view[0], 2 * self._reach)) + p.width + 1
            )
        )
        self._points = [0] * self.threads
        self._mesh_share = mesh
        self._counting = Lock()

    def _targets(self):
        """(2, 3) first and last node that the grid can see on open axes."""
        lo, hi = np.zeros((2, 3))
        if not self._periodic.all():
            if self._lattice:
                ends = np.array([[x.points[0], x.points[-1]] for x in self._lattice[0]])
                lo, hi = ends.min(1), ends.max(1)
            else:
                t = self.grid.relative_points_gc @ self._to_mesh
                lo, hi = t.min(0), t.max(0)
        spare = self.parameters.width
        reach = np.where(self._periodic, 0.0, self._reach)
        return np.stack([np.floor(lo - reach) - spare, np.ceil(hi + reach) + spare])

    @property
    def depth(self) -> int:
        """Nodes of the window along z."""
        return 1 if self._flat else self.parameters.width

    def _layer(self, nodes):
        """How many there are along each edge, but one along z if there is only one layer."""
        return np.array([*nodes[:2], 1], np.asarray(nodes).dtype) if self._flat else nodes

    def _check(self, nodes):
        if self.most_components * self.real().itemsize * np.prod(nodes, dtype=float) > LARGEST:
            raise AtcError(
                f"method 'spectral' would need a mesh of {' x '.join(str(int(n)) for n in nodes)} for kernel "
                f"{self.kernel.name!r} "
                f"at tolerance {self.tolerance:g}: use method 'direct', a smoother kernel or a looser tolerance"
            )

    @cached_property
    def window(self) -> np.ndarray:
        """The window's polynomials. Three windows multiply; what a mode is divided by makes their error larger by no
        more than about ten."""
        p = self.parameters
        return fourier.window_polynomials(p.width, p.shape, 0.005 * self.tolerance)

    def add_strong(self, x_bc, r_bc, b_bk):
        """Like `add_bonds`, for bonds more than 2^`spread.STRONG` times as strong as others of the frame: the same
        points as when they come among those."""
        x_bc, r_bc, b_bk = (np.ascontiguousarray(a, np.float64) for a in (x_bc, r_bc, b_bk))
        if len(b_bk):
            self._add(
                "bond",
                x_bc,
                np.arange(len(b_bk), dtype=np.int32),
                r_bc,
                b_bk,
                0,
                typical=np.ones(b_bk.shape[1]),
                strong=True,
            )

    def add_among(self, x_bc, r_bc, b_bk, typical):
        """Like `add_bonds`, for a few bonds of a frame whose mean size is `typical` (k,): as closely integrated as
        among all."""
        x_bc, r_bc, b_bk = (np.ascontiguousarray(a, np.float64) for a in (x_bc, r_bc, b_bk))
        if len(b_bk):
            self._add("bond", x_bc, np.arange(len(b_bk), dtype=np.int32), r_bc, b_bk, 0, typical=typical)

    # --- adding
    def _groups(self, n_comp):
        """Components that share a mesh: [(first, last, components of the mesh)]."""
        # A symmetric tensor apart: what may come behind it, its antisymmetric part, is 0 of most bonds.
        most = 6 if 8 < n_comp <= 12 else 8
        return [(k, min(k + most, n_comp), 4 if n_comp - k <= 4 else 8) for k in range(0, n_comp, most)]

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread, typical=None, strong=False, slack=None):
        if not 0 <= thread < self.threads:
            raise ValueError(f"thread {thread} of a deposit made for {self.threads}")
        bonds, coef, width = self.bond_points, self.window, self.parameters.width
        open_axes = not self._periodic.all()
        bounds, mean, most, finite = spread.survey(x_nc, i_b, r_bc, b_bk, self._origin, self._to_mesh, open_axes)
        if not finite:
            raise AtcError(_NOT_FINITE)
        if most == 0.0:
            return
        lo, hi = self._seen(*bounds) if open_axes else np.zeros((2, 3))
        if (lo >= hi)[~self._periodic].any():
            return
        mean = mean if typical is None else typical
        weight = np.divide(1.0, mean, out=np.zeros_like(mean), where=mean > 0)
        if slack is None:
            slack = bonds.slack(i_b, r_bc, b_bk, weight) if what == "bond" and len(i_b) > SAMPLE else 0
        for first, last, lanes in self._groups(b_bk.shape[1]):
            part = b_bk if last - first == b_bk.shape[1] else np.ascontiguousarray(b_bk[:, first:last])
            mesh = self._mesh_for((what, first, thread), lo, hi, lanes, most)
            spread_bonds = spread.core(width, lanes, len(coef) - 1, self.real, self.depth)
            rest = (
                self._origin,
                self._to_mesh,
                self._period,
                mesh.low,
                np.array(mesh.shape),
                mesh.row,
                weight[first:last] * 0.5**slack,
                slack + 4 * spread.LEVELS * strong,
                bonds.longest,
                *bonds.rules,
                coef.ravel().astype(self.real),
                1.0 / mesh.scale,
                mesh.flat,
                mesh.rows,
            )
            short = self._short(mesh, SPARSE / (width**2 * self.depth) if what == "site" else 0.0)
            # About four points a bond.
            piece = len(i_b) if self.real is np.float64 else max(1, short // 4)
            for s in range(0, len(i_b), piece):
                if mesh.points >= short and self.real is np.float32:
                    mesh.flush(width)
                n = spread_bonds(x_nc, i_b[s : s + piece], r_bc[s : s + piece], part[s : s + piece], *rest)
                mesh.points += n
                with self._counting:
                    self._points[thread] += n
                    self._visits[thread] += n * width**2 * self.depth

    def _seen(self, low, high):
        """First and last node in reach of points between two corners (mesh spacings), as far as the grid can see them
        on open axes."""
        half = 0.5 * self.parameters.width
        return np.maximum(np.floor(low - half) - 1, self._view[0]), np.minimum(np.ceil(high + half) + 1, self._view[1])

    def _short(self, mesh, points_a_node):
        """How many points a mesh in single precision gets before it is moved on."""
        nodes = len(mesh.flat) // mesh.lanes
        return int(max(SHORT[0], nodes * max(points_a_node, SHORT[1] if self.tolerance >= SINGLE_TRANSFORM else 0.0)))

    def _mesh_for(self, key, lo, hi, lanes, most):
        """The mesh of a thread, large enough for nodes lo..hi on open axes and sources up to `most`."""
        mesh = self._meshes.get(key)
        low = np.where(self._periodic, -self._halo, lo).astype(np.int64)
        high = np.where(self._periodic, self._period - self._halo + self.parameters.width + 1, hi + 1).astype(np.int64)
        if self._flat:
            low[2], high[2] = 0, 1
        if mesh is None:
            self._check(high - low)
            mesh = self._meshes[key] = Mesh(low, high - low, lanes, self.real)
        elif (low < mesh.low).any() or (high > mesh.low + mesh.shape).any():
            # Half as much again on the side that grows: not every piece shall copy the mesh.
            size = np.array(mesh.shape)
            low = np.where(low < mesh.low, np.maximum(low - size // 2, self._view[0]), mesh.low).astype(np.int64)
            end = mesh.low + size
            high = np.where(high > end, np.minimum(high + size // 2, self._view[1] + 1), end).astype(np.int64)
            low, high = (np.where(self._periodic, a, b) for a, b in ((mesh.low, low), (end, high)))
            self._check(high - low)
            mesh = self._meshes[key] = mesh.grown(low, high - low)
        if self.real is np.float64:  # never flushed
            mesh.scale = 1.0
        else:
            # Sources near 1; what single precision can hold is no matter then.
            if mesh.scale and not 1e-9 < most / mesh.scale < 1e9:
                mesh.flush(self.parameters.width)
                mesh.scale = 0.0
            mesh.scale = mesh.scale or 2.0 ** max(frexp(most)[1], -1000)
        return mesh

    @property
    def points(self) -> int:
        """How many points have been spread."""
        return int(sum(self._points))

    # --- finishing
    def _extents(self, meshes):
        """(2, 3) first and last node of some meshes; of the whole view without any."""
        if not meshes:
            return self._view
        low = np.min([m.low for m in meshes], 0)
        return np.stack([low, np.max([m.low + m.shape for m in meshes], 0) - 1])

    def _box(self, extent):
        """(counts, low, extent) of the periodic box in which the modes are taken."""
        counts, low = self._period.copy(), np.zeros(3, np.int64)
        for a in np.flatnonzero(~self._periodic):
            first, last = extent[0, a], extent[1, a]
            # Points of the grid within reach; their images must be out of reach.
            seen = (
                max(self._view[0, a] + self._reach[a], first - self._reach[a]),
                min(self._view[1, a] - self._reach[a], last + self._reach[a]),
            )
            need = self._reach[a] + max(seen[1] - first, last - seen[0], 0.0)
            counts[a] = _good_length(max(ceil(need), int(last - first) + 1, self.parameters.width + 1, 4))
            low[a] = first
        return counts, low

    @property
    def mesh(self):
        return self._box(self._extents(list(self._meshes.values())))[0]

    @property
    def modes(self):
        counts = self.mesh
        return largest_modes(self.parameters, np.linalg.norm(self._spacings * counts[:, None], axis=1), counts)

    def _of(self, what, first=None):
        """The meshes of a kind, in the order of the threads."""
        return [
            m
            for (kind, k, _), m in sorted(self._meshes.items(), key=lambda item: item[0])
            if kind == what and first in (None, k)
        ]

    def _transformed(self, what, group, extent=None):
        """Modes, and what was added in them: (component, k0, k1, k2), times the kernel's own; None if nothing was.

        extent : of the box, if it is to be larger than these components need; then they are not multiplied with the
            kernel
        """
        first, last, _ = group
        meshes = self._of(what, first)
        if not meshes:
            return None
        finished = extent is None
        extent = self._extents(meshes) if finished else extent
        counts, low = self._box(extent)
        modes = Modes(self.kernel, self.parameters, self._spacings * counts[:, None], counts, low, self._reach, extent)
        n_comp = last - first
        dtype = np.complex64 if self._number is np.float32 else np.complex128
        S_cx = np.empty((n_comp, counts[0], len(modes.index[1]), len(modes.index[2])), dtype)
        # Relative to the strongest: single precision holds neither very strong nor very weak sources.
        largest = max(max(m.scale, m.largest) for m in meshes)
        parts = [(m, array, scale / largest) for m in meshes for array, scale in m.planes()]

        def plane(x):
            P_cyz = np.zeros((n_comp, counts[1], counts[2]), self._number)
            for mesh, array, scale in parts:
                shift = mesh.low - low
                # The halo belongs to the other side.
                at = np.arange(mesh.shape[0])
                at = at[(at + shift[0]) % counts[0] == x] if self._periodic[0] else at[at + shift[0] == x]
                for k in at:
                    spread.collect(array[k], scale, shift[1:], self._period[1:], P_cyz)
            S_cx[:, x] = modes.transform_plane(P_cyz)

        self._each(plane, range(counts[0]))
        response = modes.response().astype(self._number) if finished else 1.0
        F = [None] * n_comp

        def component(c):
            F[c] = modes.transform_x(S_cx[c])
            F[c] *= response

        self._each(component, range(n_comp))
        return modes, F, largest

    def _done(self, what, group):
        """`_transformed`, of all that has been added."""
        return self._transformed(what, group)

    def _each(self, do, items, workers=None):
        if (workers or self.threads) == 1:
            for item in items:
                do(item)
        else:
            with ThreadPoolExecutor(workers or self.threads) as pool:
                list(pool.map(do, items))

    def _sums(self, what, n_comp, derivatives=(None,)):
        out = np.zeros((len(self.grid), n_comp, len(derivatives)))
        for group in self._groups(n_comp):
            done = self._done(what, group)
            if done is None:
                continue
            modes, F, largest = done
            for d, direction in enumerate(derivatives):
                factor = None if direction is None else (1j * modes.wave_vector(direction)).astype(F[0].dtype)
                self._evaluate(modes, [f if factor is None else f * factor for f in F], out[:, group[0] : group[1], d])
            out[:, group[0] : group[1]] *= largest
        return out[:, :, 0] if derivatives == (None,) else out

    def _evaluate(self, modes, F, out):
        if self._lattice:
            axes, owner = self._lattice
            order = [owner.index(g) for g in range(len(self.grid.counts))]
            order = [a for a in range(3) if a not in order] + order

            def component(c):
                out[:, c] = modes.on_lattice(F[c], axes).transpose(order).ravel()

            self._each(component, range(len(F)))
            return
        mesh = [None] * len(F)

        def component(c):
            mesh[c] = modes.on_mesh(F[c])

        self._each(component, range(len(F)))
        mesh = np.stack(mesh)
        t = self.grid.relative_points_gc @ self._to_mesh
        coef = self.window
        cuts = np.linspace(0, len(t), self.threads + 1).astype(int)

        def part(k):
            out[cuts[k] : cuts[k + 1]] = modes.at_points(mesh, t[cuts[k] : cuts[k + 1]], coef)

        self._each(part, range(self.threads))

    def site_gradients(self) -> np.ndarray:
        """(g, n_site, 3) the gradients of `site_sums`, direction last; keep the tolerance if the deposit was made with
        ``gradients=True``."""
        return self._sums("site", self.n_site, (0, 1, 2))

    def site_sums_and_gradients(self) -> tuple[np.ndarray, np.ndarray]:
        """`site_sums` and `site_gradients` from one transform."""
        out = self._sums("site", self.n_site, (None, 0, 1, 2))
        return np.ascontiguousarray(out[:, :, 0]), out[:, :, 1:]

    def bond_gradients(self) -> np.ndarray:
        """(g, n_bond, 3) the gradients of `bond_sums`, direction last."""
        return self._sums("bond", self.n_bond, (0, 1, 2))


def _good_length(n):
    from scipy.fft import next_fast_len

    return int(next_fast_len(int(n), real=True))
