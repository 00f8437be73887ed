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
# Bytes of the largest mesh.
LARGEST = 4.0e9


def box_modes(largest):
    """The numbers of the modes along each axis: negative ones behind the others for the first two, none for the third
    (the fields are real)."""
    m0, m1, m2 = (int(m) for m in largest)
    return [np.r_[0 : m0 + 1, -m0:0], np.r_[0 : m1 + 1, -m1:0], np.arange(m2 + 1)]


def wave_vectors(index, vectors):
    """Three arrays, the Cartesian components of the wave vectors, that broadcast to (k0, k1, k2)."""
    b = 2 * pi * np.linalg.inv(vectors)  # columns are the reciprocal vectors
    n0, n1, n2 = index[0][:, None, None], index[1][None, :, None], index[2][None, None, :]
    return [n0 * b[c, 0] + n1 * b[c, 1] + n2 * b[c, 2] for c in range(3)]


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
        if 8.0 * 3 * np.prod(self.counts, dtype=float) > LARGEST:
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

    def modes(self, x_nc, a_nk) -> np.ndarray:
        """(k, k0, k1, k2) Σ_j a_j e^{−ik·(x_j − origin)} for the columns of a."""
        from scipy import fft

        from ...deposit import spread

        u_nc = (x_nc - self.origin) @ self.to_mesh
        out = np.empty((a_nk.shape[1], *[len(i) for i in self.index]), complex)
        mesh = np.empty(self.counts)
        for c, a_n in enumerate(np.ascontiguousarray(a_nk.T, float)):
            mesh[:] = 0.0
            spread.spread_sites(u_nc, self.counts, self.coef, self.width, a_n, mesh)
            F = fft.rfft(mesh, axis=2, workers=self.threads)[:, :, : len(self.index[2])]
            F = fft.fft(F, axis=1, workers=self.threads)[:, self.index[1]]
            out[c] = fft.fft(F, axis=0, workers=self.threads)[self.index[0]]
        for a, hat in enumerate(self.hats):
            out /= hat.reshape([-1 if k == a else 1 for k in range(3)])
        return out

    def at(self, F_k, x_nc) -> np.ndarray:
        """(n, k) Σ_k F(k) e^{ik·(x − origin)} over all modes, those left out included: the fields are real. F_k:
        iterable of (k0, k1, k2)."""
        from scipy import fft

        from ...deposit import spread

        n0, n1, n2 = (int(n) for n in self.counts)
        u_nc = (x_nc - self.origin) @ self.to_mesh
        out = []
        for F in F_k:
            G = np.zeros((len(self.index[0]), len(self.index[1]), n2 // 2 + 1), complex)
            G[:, :, : F.shape[2]] = F / (self.hats[0][:, None, None] * self.hats[1][:, None] * self.hats[2])
            H = np.zeros((n0, len(self.index[1]), G.shape[2]), complex)
            H[self.index[0]] = G
            H = fft.ifft(H, axis=0, norm="forward", overwrite_x=True, workers=self.threads)
            G = np.zeros((n0, n1, H.shape[2]), complex)
            G[:, self.index[1]] = H
            G = fft.ifft(G, axis=1, norm="forward", overwrite_x=True, workers=self.threads)
            mesh = fft.irfft(G, n=n2, axis=2, norm="forward", overwrite_x=True, workers=self.threads)
            values = np.zeros((len(x_nc), 1))
            spread.interpolate(u_nc, self.counts, self.coef, self.width, mesh[None], values)
            out.append(values[:, 0])
        return np.stack(out, axis=1) if out else np.zeros((len(x_nc), 0))


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
