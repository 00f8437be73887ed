"""From the modes of a field to its values: the finishing half of the spectral deposit.

Along an axis of the box the points of a grid are reached in one of three ways: where the grid closes on itself by
folding modes that agree there and a fast transform, exact however coarse the grid; where its points merely lie on lines
along the box's edges by a sum over the modes of that axis; and for points anywhere by a mesh that is read off with the
spreading window. In two dimensions the mesh has one layer and the only mode along z is the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from ..compiled import njit
from ..simd import ENTRY
from . import fourier, spread


@dataclass(frozen=True)
class Axis:
    """Where a lattice's points are along an edge of the box, in mesh spacings: start + step i, i < count."""

    start: float
    step: float
    count: int

    @property
    def points(self):
        return self.start + self.step * np.arange(self.count)


def separable(grid, to_mesh):
    """The axes of a lattice along the cell's edges, and which axis of the grid belongs to each edge (−1: none); None if
    it is tilted against them."""
    if not grid.is_lattice:
        return None
    start = grid.origin @ to_mesh
    steps = grid.steps @ to_mesh
    axes, owner = [None] * 3, [-1] * 3
    for g, (step, count) in enumerate(zip(steps, grid.counts)):
        a = int(np.abs(step).argmax())
        # 1e-12 of a step: what rounding leaves.
        if (count > 1 and np.abs(np.delete(step, a)).max() > 1e-12 * abs(step[a])) or owner[a] >= 0:
            return None
        axes[a], owner[a] = Axis(float(start[a]), float(step[a]), count), g
    for a in range(3):
        axes[a] = axes[a] or Axis(float(start[a]), 0.0, 1)
    return axes, owner


@njit(**ENTRY)
def _fill(table, step, b, n0, n1, n2, w0, w1, w2, out):
    """out = w0 w1 w2 table(|k|), by the cubic through the four nearest of table[1 + i] at i step: 0.01⁴ is enough for
    kernels with a kink."""
    for i in range(len(n0)):
        for j in range(len(n1)):
            x, y, z = (
                n0[i] * b[0, 0] + n1[j] * b[0, 1],
                n0[i] * b[1, 0] + n1[j] * b[1, 1],
                n0[i] * b[2, 0] + n1[j] * b[2, 1],
            )
            w = w0[i] * w1[j]
            for k in range(len(n2)):
                kx, ky, kz = x + n2[k] * b[0, 2], y + n2[k] * b[1, 2], z + n2[k] * b[2, 2]
                u = sqrt(kx * kx + ky * ky + kz * kz) / step
                m = int(u)
                t = u - m
                f0, f1, f2, f3 = table[m], table[m + 1], table[m + 2], table[m + 3]
                value = (
                    f1
                    + t * (f2 - f1)
                    + t
                    * (t - 1.0)
                    * (0.25 * (f0 - f1 - f2 + f3) + (t - 0.5) * (f3 - f0 + 3.0 * (f1 - f2)) * (1.0 / 6.0))
                )
                out[i, j, k] = value * w * w2[k]


class Modes:
    """The modes k of a periodic box that are kept, and what belongs to each.

    Parameters
    ----------
    kernel, parameters : see `fourier`
    vectors : (3, 3) edges of the box
    counts : (3,) mesh nodes along them
    low : (3,) node that the box begins at
    reach : (3,) how far the kernel reaches along open axes, in mesh spacings; ∞ on periodic ones
    extent : (2, 3) first and last node with something on it
    """

    def __init__(self, kernel, parameters, vectors, counts, low, reach, extent):
        self.kernel, self.parameters, self.counts, self.low, self.reach, self.extent = (
            kernel,
            parameters,
            counts,
            low,
            reach,
            extent,
        )
        edges = np.linalg.norm(vectors, axis=1)
        self.inverse = np.linalg.inv(vectors)
        self.volume = abs(np.linalg.det(vectors))
        self.largest = largest_modes(parameters, edges, counts)
        k0, k1, k2 = (int(k) for k in self.largest)
        # Negative ones too for x and y, none for z: the field is real.
        self.index = [np.r_[0 : k0 + 1, -k0:0], np.r_[0 : k1 + 1, -k1:0], np.arange(k2 + 1)]

    def window_hat(self, axis):
        p = self.parameters
        if axis == 2 and self.kernel.dimension == 2:
            return np.ones(1)
        return fourier.window_hat(self.index[axis] / self.counts[axis], p.width, p.shape)

    def wave_vector(self, c):
        """Component c of the wave vectors."""
        b = 2 * pi * self.inverse  # columns are the reciprocal vectors
        n0, n1, n2 = self.index[0][:, None, None], self.index[1][None, :, None], self.index[2][None, None, :]
        return n0 * b[c, 0] + n1 * b[c, 1] + n2 * b[c, 2]

    def response(self):
        """φ̂(k) divided by the window's transform and the volume."""
        index = self.index
        w0, w1, w2 = (1.0 / self.window_hat(a) for a in range(3))
        w0 /= self.volume
        out = np.empty([len(i) for i in index])
        b = np.ascontiguousarray(2 * pi * self.inverse)  # columns are the reciprocal vectors
        if self.kernel.hat_step is not None:
            # φ̂ from a table: there are millions of modes where a kernel's transform decays slowly.
            step = self.kernel.hat_step / self.kernel.radius
            corners = np.array(np.meshgrid(*[(-1, 1)] * 3)).reshape(3, -1).T * self.largest
            last = np.linalg.norm(corners @ b.T, axis=1).max()
            k = np.abs(np.arange(-1, int(last / step) + 4) * step)
            table = self.kernel.hat(np.stack([k, 0 * k, 0 * k], -1))
            _fill(table, step, b, *index, w0, w1, w2, out)
            return out
        n1, n2 = index[1][:, None], index[2][None, :]
        for i, n0 in enumerate(index[0]):
            k_c = np.stack([n0 * b[c, 0] + n1 * b[c, 1] + n2 * b[c, 2] for c in range(3)], -1)
            out[i] = self.kernel.hat(k_c) * w0[i] * w1[:, None] * w2
        return out

    def transform_plane(self, plane_cyz):
        """The modes along y and z of the mesh's plane at one x: (component, k1, k2)."""
        from scipy import fft

        F = fft.rfft(plane_cyz, axis=2)[:, :, : len(self.index[2])]
        return fft.fft(F, axis=1)[:, self.index[1]]

    def transform_x(self, S):
        """All modes, from those of the planes (x, k1, k2)."""
        from scipy import fft

        return fft.fft(S, axis=0)[self.index[0]]

    # --- values
    def _seen(self, a, points):
        """Whether points are within the kernel's reach of anything."""
        return (points >= self.extent[0, a] - self.reach[a]) & (points <= self.extent[1, a] + self.reach[a])

    def on_lattice(self, F, axes):
        """The modes' sum at a lattice along the box's edges: real, (n0, n1, n2)."""

        def along(a):
            """exp(i k x) for the modes and points of an axis, (k, n); 0 where nothing reaches."""
            t = axes[a].points
            e = np.exp((2j * pi / self.counts[a]) * np.outer(self.index[a], t - self.low[a]))
            if a == 2:
                # The other half of the modes.
                e[1:] *= 2.0
            return np.where(self._seen(a, t), e, 0.0).astype(F.dtype)

        closed = [
            abs(x.count * x.step - n) <= 1e-9 * n and not np.isfinite(r)
            for x, n, r in zip(axes, self.counts, self.reach)
        ]
        # z first where that makes less of it.
        first = not closed[2] and axes[2].count < len(self.index[2])
        if first:
            F = F @ along(2)
        for a in sorted((0, 1), key=lambda a: axes[a].count / len(self.index[a])):
            if closed[a]:
                F = self._folded(F, axes[a], a)
            else:
                F = np.moveaxis(np.tensordot(along(a), F, axes=(0, a)), 0, a)
        if closed[2]:
            return self._folded_last(F, axes[2])
        return (F if first else F @ along(2)).real

    def _phases(self, axis, a):
        return np.exp((2j * pi / self.counts[a]) * self.index[a] * (axis.start - self.low[a]))

    def _folded(self, F, axis, a):
        from scipy import fft

        n, index = axis.count, self.index[a]
        shape = list(F.shape)
        shape[a] = n
        G = np.moveaxis(np.zeros(shape, F.dtype), a, 0)
        for k, f, at in zip(index, np.moveaxis(F, a, 0), self._phases(axis, a).astype(F.dtype)):
            G[k % n] += f * at
        return np.moveaxis(fft.ifft(G, axis=0, overwrite_x=True, norm="forward"), 0, a)

    def _folded_last(self, F, axis):
        from scipy import fft

        n = axis.count
        F = F * self._phases(axis, 2).astype(F.dtype)
        G = np.zeros((*F.shape[:2], n // 2 + 1), F.dtype)
        for k in range(F.shape[2]):
            at, mirror = k % n, -k % n
            if at <= n // 2:
                G[:, :, at] += F[:, :, k]
            if mirror <= n // 2 and k:
                G[:, :, mirror] += F[:, :, k].conj()
        return fft.irfft(G, n=n, axis=2, norm="forward", overwrite_x=True)

    def on_mesh(self, F):
        """The field divided by the window, on the mesh: what `spread.interpolate` reads."""
        from scipy import fft

        n0, n1, n2 = (int(n) for n in self.counts)
        w0, w1, w2 = (1.0 / self.window_hat(a) for a in range(3))
        G = np.zeros((len(self.index[0]), len(self.index[1]), n2 // 2 + 1), F.dtype)
        G[:, :, : F.shape[2]] = F * (w0[:, None, None] * w1[:, None] * w2).astype(w0.dtype)
        H = np.zeros((n0, len(self.index[1]), G.shape[2]), F.dtype)
        H[self.index[0]] = G
        H = fft.ifft(H, axis=0, norm="forward", overwrite_x=True)
        G = np.zeros((n0, n1, H.shape[2]), F.dtype)
        G[:, self.index[1]] = H
        G = fft.ifft(G, axis=1, norm="forward", overwrite_x=True)
        return fft.irfft(G, n=n2, axis=2, norm="forward", overwrite_x=True)

    def at_points(self, mesh_cxyz, t_gc, coef):
        """The mesh's values at points (mesh spacings): (g, component)."""
        seen = np.ones(len(t_gc), bool)
        for a in range(3):
            seen &= self._seen(a, t_gc[:, a])
        out = np.zeros((len(t_gc), len(mesh_cxyz)))
        part = np.zeros((int(seen.sum()), len(mesh_cxyz)))
        if self.kernel.dimension == 2:
            spread.interpolate_plane(
                t_gc[seen] - self.low, self.counts, coef, self.parameters.width, mesh_cxyz[:, :, :, 0].copy(), part
            )
        else:
            spread.interpolate(t_gc[seen] - self.low, self.counts, coef, self.parameters.width, mesh_cxyz, part)
        out[seen] = part
        return out


def largest_modes(parameters, edges, counts):
    """(3,) the largest mode number kept along each edge."""
    return np.minimum((parameters.k_max * edges / (2 * pi)).astype(int), (np.asarray(counts) - 1) // 2)
