"""The spectral deposit: both sums by way of their Fourier modes, at a cost that does not depend on the kernel's radius.

    f(x) = Σ_p c_p φ(x − y_p) = (1/V) Σ_k φ̂(k) S(k) e^{ik·x},   S(k) = Σ_p c_p e^{−ik·y_p}

Bonds become Gauss-Legendre points y_p along them. S(k) is what a mesh of points spread with a window gives, divided by the window's own
transform (Dutt & Rokhlin, SIAM J. Sci. Comput. 14 (1993) 1368; Kaiser-Bessel window). The modes left are folded onto the output grid, which is
exact for any grid over the whole cell however coarse; other points are read off a mesh with the same window the other way round.
How fine the mesh is, how wide the window and how many points a bond gets follows from the tolerance (`fourier`).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from functools import cached_property
from math import ceil, pi

import numpy as np

from ..errors import AtcError
from ..frame import Cell
from . import fourier, spread
from .direct import Deposit

# Points a bond gets at most before it is cut into pieces.
MOST = 10
# Doubles in one mesh, of one group of components: 8 GB.
LARGEST = 1.0e9
# Points to spread in a ball of radius R/4, as in dense argon at R = 10 Å: what the choice between a fine mesh and a wide window goes by.
DENSE = 120.0


class SpectralDeposit(Deposit):
    """Site and bond sums through Fourier modes, for cells periodic along all axes. See `atc.deposit.make`.

    Parameters
    ----------
    tolerance : relative to the largest value of a field of independent sources (a field that is their sum is larger, one that is their
        difference smaller)
    points : how many points will be spread, if known: only the speed depends on it

    Raises
    ------
    AtcError
        For kernels that jump (step, box), slabs, and where the tolerance asks for a mesh that does not fit in memory.
    """

    def __init__(self, grid, kernel, cell, n_site, n_bond, threads=1, tolerance=1e-5, points=None):
        super().__init__(grid, kernel, cell, n_site, n_bond, threads)
        self.tolerance = float(tolerance)
        fourier.spectrum(kernel)
        if not self.cell.periodic.all():
            raise AtcError("method 'spectral' needs a cell that is periodic along all axes: use method 'direct'")
        if not grid.wraps:
            raise AtcError(f"method 'spectral' needs a regular grid over the whole cell, not this {grid.kind} grid: use method 'direct'")
        self.box = Cell(self.cell.vectors)
        volume = self.box.volume
        # Half of the squared error to the bonds' points, half to the mesh; and the largest error among many points over the largest value
        # is up to twice what the same ratio of mean squares is.
        share = self.tolerance * 0.5 * np.sqrt(0.5)
        density = DENSE / (kernel.radius / 2.5) ** 3 / 4 if points is None else points / volume
        # Nearby densities give nearby choices: round, so that they can be remembered.
        self.parameters = p = fourier.choose(kernel, share, float(f"{density:.1e}"))
        edges = np.linalg.norm(self.box.vectors, axis=1)
        self.mesh = np.array([_good_length(max(ceil(edge / p.spacing), p.width + 1, 4)) for edge in edges])
        if 8.0 * self.mesh.astype(float).prod() > LARGEST:
            raise AtcError(
                f"method 'spectral' would need a mesh of {' x '.join(map(str, self.mesh))} for kernel {kernel.name!r} at tolerance {tolerance:g}: "
                "use method 'direct', a smoother kernel or a looser tolerance"
            )
        self.modes = np.minimum((p.k_max * edges / (2 * pi)).astype(int), (self.mesh - 1) // 2)
        self._longest = fourier.bond_points(kernel, share, MOST)
        rules = [np.polynomial.legendre.leggauss(m) for m in range(1, MOST + 1)]
        self._nodes, self._weights = np.zeros((2, MOST, MOST))
        for m, (x, w) in enumerate(rules):
            self._nodes[m, : m + 1], self._weights[m, : m + 1] = 0.5 * (x + 1.0), 0.5 * w
        # Three windows multiply; what a mode is divided by makes their error larger by no more than about ten.
        coef = fourier.window_polynomials(p.width, p.shape, 0.01 * share)
        self._degree, self._coef = len(coef) - 1, coef.ravel()
        self._to_mesh = np.ascontiguousarray(self.box.inverse * self.mesh)
        self._start = np.array(self.cell.origin)
        self._points = [0] * self.threads

    # --- adding
    def _groups(self, n_comp):
        """Components that share a mesh: [(first, last, vectors of four)]."""
        return [(k, min(k + 8, n_comp), 1 if n_comp - k <= 4 else 2) for k in range(0, n_comp, 8)]

    def _padded(self):
        return self.mesh + self.parameters.width + 1

    def _add(self, what, x_nc, i_b, r_bc, b_bk, thread):
        width = self.parameters.width
        for first, last, vectors in self._groups(b_bk.shape[1]):
            mesh = self._buffer((what, first), thread, int(self._padded().prod()) * 4 * vectors)
            part = b_bk if last - first == b_bk.shape[1] else np.ascontiguousarray(b_bk[:, first:last])
            n = spread.core(width, vectors, self._degree)(
                x_nc, i_b, r_bc, part, self._start, self._to_mesh, self.mesh, self._longest, self._nodes, self._weights, self._coef, mesh
            )
            if n < 0:
                raise AtcError(
                    "an atom's position or a bond's vector is not a finite number: check the trajectory and the potential for coincident atoms"
                )
            self._points[thread] += n
            self._visits[thread] += n * width**3

    @property
    def points(self) -> int:
        """How many points have been spread."""
        return int(sum(self._points))

    # --- finishing
    def _sums(self, what, n_comp):
        out = np.zeros((len(self.grid), n_comp))
        jobs = []
        for first, last, vectors in self._groups(n_comp):
            buffers = [self._buffers[(what, first), t] for t in range(self.threads) if ((what, first), t) in self._buffers]
            if buffers:
                jobs += [(first + c, [b.reshape(*self._padded(), 4 * vectors)[..., c] for b in buffers]) for c in range(last - first)]

        def one(job):
            column, meshes = job
            out[:, column] = self._evaluate(self._modes(meshes)).ravel()

        with ThreadPoolExecutor(max(1, self.threads)) as pool:
            list(pool.map(one, jobs))
        return out

    @cached_property
    def _indices(self):
        """Mode numbers along the axes: negative ones too for x and y, none for z (the field is real)."""
        k0, k1, k2 = (int(k) for k in self.modes)
        return [np.r_[0 : k0 + 1, -k0:0], np.r_[0 : k1 + 1, -k1:0], np.arange(k2 + 1)]

    def _window_hat(self, axis):
        p = self.parameters
        return fourier.window_hat(self._indices[axis] / self.mesh[axis], p.width, p.shape)

    @cached_property
    def _response(self):
        """φ̂(k) divided by the window's transform and the volume, for every mode kept."""
        index = self._indices
        b = 2 * pi * self.box.inverse  # columns are the reciprocal vectors
        n0, n1, n2 = index[0][:, None, None], index[1][None, :, None], index[2][None, None, :]
        k_c = [n0 * b[c, 0] + n1 * b[c, 1] + n2 * b[c, 2] for c in range(3)]
        kern = self.kernel
        if isinstance(kern, fourier.BSpline):
            hat = np.ones((len(index[0]), len(index[1]), len(index[2])))
            for k in k_c:
                hat *= np.sinc(k * (0.25 * kern.radius / pi)) ** 4
        else:
            k = np.sqrt(k_c[0] ** 2 + k_c[1] ** 2 + k_c[2] ** 2)
            hat = self._radial(k)
        w = [self._window_hat(a) for a in range(3)]
        hat /= w[0][:, None, None] * self.box.volume
        hat /= w[1][None, :, None] * w[2][None, None, :]
        return hat

    def _radial(self, k):
        if isinstance(self.kernel, fourier.Gaussian):
            return fourier.radial_hat(self.kernel, k)
        # Millions of modes, but one variable: a cubic through points so dense that its error, h⁴/384 times the fourth derivative (< 0.05 R⁴), is 1e-10.
        from scipy.interpolate import CubicSpline

        table = np.arange(0.0, k.max() + 0.1 / self.kernel.radius, 0.03 / self.kernel.radius)
        return CubicSpline(table, fourier.radial_hat(self.kernel, table))(k)

    def _modes(self, meshes):
        """S(k) φ̂(k)/V (x, y, z ≥ 0) of one component, from the threads' padded meshes."""
        from scipy import fft

        total = np.array(meshes[0])
        for mesh in meshes[1:]:
            total += mesh
        # The halo belongs to the other side.
        offset = (self.parameters.width + 1) // 2
        for axis in range(3):
            n = int(self.mesh[axis])
            total = np.moveaxis(total, axis, 0)
            body = total[offset : offset + n]
            body[n - offset :] += total[:offset]
            rest = total[offset + n :]
            body[: len(rest)] += rest
            total = np.moveaxis(body, 0, axis)
        k0, k1, k2 = self.modes
        F = fft.rfft(total, axis=2)[:, :, : k2 + 1]
        F = fft.fft(F, axis=1)[:, self._indices[1]]
        F = fft.fft(F, axis=0, overwrite_x=True)[self._indices[0]]
        F *= self._response
        return F

    def _evaluate(self, F):
        """The modes' sum at the points of a grid over the whole cell, however coarse: modes that agree there add up."""
        from scipy import fft

        counts = self.grid.counts
        start = self.grid.origin @ self.cell.inverse
        for axis in (0, 1):
            n, index = counts[axis], self._indices[axis]
            phase = np.exp(2j * pi * index * start[axis])
            shape = list(F.shape)
            shape[axis] = n
            G = np.moveaxis(np.zeros(shape, complex), axis, 0)
            F = np.moveaxis(F, axis, 0)
            for k, f, at in zip(index, F, phase):
                G[k % n] += f * at
            F = np.moveaxis(fft.ifft(G, axis=0, overwrite_x=True, norm="forward"), 0, axis)
        n = counts[2]
        F = F * np.exp(2j * pi * self._indices[2] * start[2])
        G = np.zeros((*F.shape[:2], n // 2 + 1), complex)
        for k in range(F.shape[2]):
            at, mirror = k % n, -k % n
            if at <= n // 2:
                G[:, :, at] += F[:, :, k]
            if mirror <= n // 2 and k:
                G[:, :, mirror] += F[:, :, k].conj()
        return fft.irfft(G, n=n, axis=2, norm="forward", overwrite_x=True)


def _good_length(n):
    from scipy.fft import next_fast_len

    return next_fast_len(n, real=True)
