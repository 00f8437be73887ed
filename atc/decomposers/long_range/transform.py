"""Sums over charges and their modes: Σ_j a_j e^{−ik·x_j} from charges, and Σ_k F(k) e^{ik·x} at the charges.

Charges are spread onto a mesh with the window of the spectral deposit, whose transform is then divided out (Dutt &
Rokhlin, SIAM J. Sci. Comput. 14 (1993) 1368).
"""

from __future__ import annotations

from functools import lru_cache
from math import ceil, log, pi

import numpy as np

from ...errors import AtcError

# Mesh nodes to each half wave of the largest mode, for accuracies down to the second number and below; with σ of them a
# window of w nodes errs by e^{−π w √(1 − 1/σ)}.
OVERSAMPLING = (1.5, 1e-8), 2.0
WIDTHS = (6, 8, 10, 12, 14)
# Bytes of the largest set of modes, and of the parts that the mesh is taken in.
LARGEST, PART = 4.0e9, 2.0**27


def box_modes(largest):
    """The numbers of the modes along each axis: negative ones behind the others for the first two, none for the third
    (the fields are real)."""
    m0, m1, m2 = (int(m) for m in largest)
    return [np.r_[0 : m0 + 1, -m0:0], np.r_[0 : m1 + 1, -m1:0], np.arange(m2 + 1)]


def wave_vectors(index, vectors):
    """Three arrays, the Cartesian components of the wave vectors, that broadcast to (k0, k1, k2)."""
    b = 2 * pi * np.linalg.inv(vectors)  # columns are the reciprocal vectors
    n = index[0][:, None, None], index[1][None, :, None], index[2][None, None, :]
    # As small as they can be: along one axis only in orthogonal cells.
    return [sum((n[a] * b[c, a] for a in range(3) if b[c, a]), np.zeros((1, 1, 1))) for c in range(3)]


def twice(index):
    """(k2,) how often each mode stands for itself and its opposite: sums over all modes are sums over those that are
    kept, times this."""
    return np.where(index[2] == 0, 1.0, 2.0)


def largest_of(wave, vectors):
    """(3,) the largest mode number along each axis of any mode k with |k| ≤ wave."""
    return np.floor(wave * np.linalg.norm(vectors, axis=1) / (2 * pi) * (1 + 1e-12)).astype(int)


def good_length(n: int) -> int:
    """The next length that the transform is quick for."""
    from scipy.fft import next_fast_len

    return int(next_fast_len(int(n), real=True))


class Transform:
    """The modes of charges in a periodic box, as far as `largest`, and back.

    Parameters
    ----------
    vectors, origin : of the box; positions may lie anywhere
    largest : (3,) the largest mode numbers
    accuracy : of the window, relative
    """

    def __init__(self, vectors, origin, largest, accuracy: float, threads: int = 1):
        from ...deposit import fourier

        self.vectors, self.origin, self.threads = np.array(vectors, float), np.array(origin, float), threads
        self.index = box_modes(largest)
        (coarse, least), fine = OVERSAMPLING
        over = coarse if accuracy >= least else fine
        want = max(6.0, -log(accuracy) / (pi * (1.0 - 1.0 / over) ** 0.5) + 0.5)
        self.width = next((w for w in WIDTHS if w >= want), WIDTHS[-1])
        self.counts = np.array([good_length(max(ceil(over * (2 * int(m) + 1)), self.width + 2)) for m in largest])
        if 16.0 * float(self.counts[0]) * len(self.index[1]) * len(self.index[2]) > LARGEST:
            raise AtcError(
                f"long-range Coulomb: a mesh of {' x '.join(map(str, self.counts))} nodes would be needed: take a "
                "looser tolerance, or a larger Coulomb cutoff"
            )
        # As flat as the oversampling allows, a little less: the window's transform must not become small where modes
        # are kept.
        self.shape = 0.98 * pi * self.width * (1.0 - 0.5 / over)
        self.coef = _polynomials(self.width, self.shape)
        self.hats = [fourier.window_hat(self.index[a] / self.counts[a], self.width, self.shape) for a in range(3)]
        self.to_mesh = np.ascontiguousarray(np.linalg.inv(self.vectors) * self.counts)

    def _parts(self, u_nc):
        """The mesh by planes of its first axis: [(which planes, atoms whose windows end within them, their mesh
        coordinates there)]. Planes that windows reach are in two parts."""
        n0, halo = int(self.counts[0]), self.width // 2 + 1
        planes = int(PART / (8.0 * self.counts[1] * self.counts[2])) - 2 * halo
        if max(planes, 2 * halo) + 2 * halo >= n0:
            return [(np.arange(n0), slice(None), u_nc)]
        step = max(planes, 2 * halo)
        at_n = np.mod(u_nc[:, 0], n0)
        at_n[at_n == n0] = 0.0  # of the smallest negative numbers
        parts = []
        for first in range(0, n0, step):
            last = min(first + step, n0)
            atoms = np.flatnonzero((at_n >= first) & (at_n < last))
            u = u_nc[atoms]
            u[:, 0] = at_n[atoms] - (first - halo)
            parts.append((np.arange(first - halo, last + halo) % n0, atoms, u))
        return parts

    def modes(self, x_nc, a_nk) -> np.ndarray:
        """(k, k0, k1, k2) Σ_j a_j e^{−ik·(x_j − origin)} for the columns of a."""
        from scipy import fft

        from ...deposit import spread

        n0, n1, n2 = (int(n) for n in self.counts)
        k0, k1, k2 = self.index
        parts = self._parts((x_nc - self.origin) @ self.to_mesh)
        out = np.empty((a_nk.shape[1], len(k0), len(k1), len(k2)), complex)
        for c, a_n in enumerate(np.ascontiguousarray(a_nk.T, float)):
            H = np.zeros((n0, len(k1), len(k2)), complex)
            for planes, atoms, u in parts:
                mesh = np.zeros((len(planes), n1, n2))
                shape = np.array(mesh.shape)
                spread.spread_sites(u, shape, self.coef, self.width, np.ascontiguousarray(a_n[atoms]), mesh)
                F = fft.rfft(mesh, axis=2, workers=self.threads)[:, :, : len(k2)]
                H[planes] += fft.fft(F, axis=1, workers=self.threads)[:, k1]
            for row in _rows(H):
                out[c][:, row] = fft.fft(H[:, row], axis=0, workers=self.threads)[k0]
        for a, hat in enumerate(self.hats):
            out /= hat.reshape([-1 if k == a else 1 for k in range(3)])
        return out

    def at(self, F_k, x_nc) -> np.ndarray:
        """(n, k) Σ_k F(k) e^{ik·(x − origin)} over all modes, those left out included: the fields are real. F_k:
        iterable of (k0, k1, k2)."""
        from scipy import fft

        from ...deposit import spread

        n0, n1, n2 = (int(n) for n in self.counts)
        k0, k1, k2 = self.index
        parts = self._parts((x_nc - self.origin) @ self.to_mesh)
        out = []
        for F in F_k:
            H = np.zeros((n0, len(k1), len(k2)), complex)
            H[k0] = F / (self.hats[0][:, None, None] * self.hats[1][:, None] * self.hats[2])
            for row in _rows(H):
                H[:, row] = fft.ifft(H[:, row], axis=0, norm="forward", workers=self.threads)
            values = np.zeros(len(x_nc))
            for planes, atoms, u in parts:
                G = np.zeros((len(planes), n1, len(k2)), complex)
                G[:, k1] = H[planes]
                G = fft.ifft(G, axis=1, norm="forward", overwrite_x=True, workers=self.threads)
                mesh = fft.irfft(G, n=n2, axis=2, norm="forward", workers=self.threads)
                found = np.zeros((len(u), 1))
                spread.interpolate(u, np.array(mesh.shape), self.coef, self.width, mesh[None], found)
                values[atoms] = found[:, 0]
            out.append(values)
        return np.stack(out, axis=1) if out else np.zeros((len(x_nc), 0))


def _rows(H):
    """Slices of the second axis of modes, each as large as a part of the mesh."""
    step = max(1, int(PART * H.shape[1] / H.nbytes))
    return [slice(k, k + step) for k in range(0, H.shape[1], step)]


@lru_cache(maxsize=16)
def _polynomials(width, shape):
    from ...deposit import fourier

    return fourier.window_polynomials(width, shape, 1e-14)


class Direct:
    """The same, term by term: what `Transform` is measured against."""

    def __init__(self, vectors, origin, largest):
        self.vectors, self.origin = np.array(vectors, float), np.array(origin, float)
        self.index = box_modes(largest)

    def phases(self, x_nc):
        """[(n, k) e^{2πi k s} for each axis]"""
        s_nc = (x_nc - self.origin) @ np.linalg.inv(self.vectors)
        return [np.exp(2j * pi * s_nc[:, a, None] * self.index[a]) for a in range(3)]

    def modes(self, x_nc, a_nk) -> np.ndarray:
        e0, e1, e2 = (e.conj() for e in self.phases(x_nc))
        out = np.zeros((a_nk.shape[1], *[len(i) for i in self.index]), complex)
        for first in range(0, len(x_nc), 256):
            part = slice(first, first + 256)
            ab = e0[part, :, None] * e1[part, None, :]
            for c in range(a_nk.shape[1]):
                out[c] += np.tensordot(ab * a_nk[part, c, None, None], e2[part], axes=(0, 0))
        return out

    def at(self, F_k, x_nc) -> np.ndarray:
        F_k = [F * twice(self.index) for F in F_k]
        out = np.empty((len(x_nc), len(F_k)))
        for first in range(0, len(x_nc), 64):
            e0, e1, e2 = self.phases(x_nc[first : first + 64])
            for c, F in enumerate(F_k):
                G = np.einsum("nk,abk->nab", e2, F, optimize=True)
                G = np.einsum("nb,nab->na", e1, G)
                out[first : first + 64, c] = np.einsum("na,na->n", e0, G).real
        return out
