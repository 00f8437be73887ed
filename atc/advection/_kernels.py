"""Numba kernels of nonlocal advection. Arrays and numbers only; rows are wrapped by M nodes on either side."""

from __future__ import annotations

import numpy as np

from ..compiled import njit


@njit(cache=True, error_model="numpy")
def _pairs(left, right, here, weight, own, square, out):
    for i in range(out.shape[0]):
        out[i] += weight * (own * here[i] * (right[i] - left[i]) + square * (right[i] * right[i] - left[i] * left[i]))


@njit(cache=True, error_model="numpy")
def burgers_transport(row, a, own, square):
    """Σ_m a_m [own · u_i (u_{i+m} − u_{i−m}) + square · (u²_{i+m} − u²_{i−m})]: the part of F in u_i² drops out,
    because a is odd."""
    M = a.shape[0]
    n = row.shape[0] - 2 * M
    out = np.zeros(n)
    for m in range(1, M + 1):
        _pairs(row[M - m : M - m + n], row[M + m : M + m + n], row[M : M + n], a[m - 1], own, square, out)
    return out


@njit(cache=True, error_model="numpy")
def _second_difference(left, here, right, weight, out):
    for i in range(out.shape[0]):
        out[i] += weight * ((left[i] - here[i]) + (right[i] - here[i]))


@njit(cache=True, error_model="numpy")
def smoothing(row, s):
    """Σ_m s_m (u_{i+m} − 2u_i + u_{i−m})."""
    M = s.shape[0]
    n = row.shape[0] - 2 * M
    out = np.zeros(n)
    for m in range(1, M + 1):
        _second_difference(row[M - m : M - m + n], row[M : M + n], row[M + m : M + m + n], s[m - 1], out)
    return out


@njit(cache=True, error_model="numpy")
def cole_hopf_sums(x, begin, first, Phi, h, count, t, viscosity):
    """Σ (x−y)/t w / Σ w over `count` points from begin[n], w = exp((min G − G)/2ε), G = (x−y)²/2t + Phi; point i is at
    y = (first + i) h."""
    out = np.empty(x.shape[0])
    G = np.empty(count)
    for n in range(x.shape[0]):
        least = np.inf
        for i in range(count):
            d = x[n] - (first + begin[n] + i) * h
            G[i] = d * d / (2.0 * t) + Phi[begin[n] + i]
            least = min(least, G[i])
        above, below = 0.0, 0.0
        for i in range(count):
            rise = (G[i] - least) / (2.0 * viscosity)
            if rise < 40.0:
                w = np.exp(-rise)
                above += (x[n] - (first + begin[n] + i) * h) * w
                below += w
        out[n] = above / (t * below)
    return out
