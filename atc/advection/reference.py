"""The local Burgers equation exactly, to compare with: Cole–Hopf for ε > 0, Hopf–Lax for ε = 0. Periodic initial
values.

u(x, t) = ∫ ((x−y)/t) e^{−G/2ε} dy / ∫ e^{−G/2ε} dy,  G = (x−y)²/2t + ∫₀^y u₀. In log space (the least G subtracted
first) it works for any ε; the Fourier series of the same solution loses all digits for ε below about 0.02.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..errors import AtcError

_CHUNK = 2_000_000  # numbers in one block


def _potential(u0: Callable, period: float, cells: int):
    """∫₀^y u₀ at the cells + 1 points of one period (4 Gauss points a cell), its mean value, and bounds of |u₀| and
    |u₀'|."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    h = period / cells
    y = (np.arange(cells)[:, None] + 0.5 * (nodes + 1)) * h
    values = np.asarray(u0(y.ravel()), dtype=float).reshape(y.shape)
    if not np.isfinite(values).all():
        raise AtcError("the initial u is not finite everywhere on the period")
    Phi = np.concatenate([[0.0], np.cumsum(0.5 * h * (values @ weights))])
    flat = values.ravel()
    steep = np.abs(np.diff(flat)) / np.maximum(np.diff(y.ravel()), 1e-300)
    return Phi, float(np.abs(flat).max()), float(steep.max())


def _check(t, viscosity, period):
    for name, value, least in (("t", t, 0.0), ("viscosity", viscosity, 0.0)):
        if not (math.isfinite(value) and value >= least):
            raise AtcError(f"{name} = {value!r}: expected 0 or greater")
    if not (math.isfinite(period) and period > 0):
        raise AtcError(f"period = {period!r}: expected a length greater than 0")


def cole_hopf(
    u0: Callable, x_n, t: float, viscosity: float, period: float = 1.0, points: float = 4.0
) -> tuple[np.ndarray, float]:
    """The exact solution of u_t + u u_x = ε u_xx with u(x, 0) = u0(x), and an estimate of its own error.

    Parameters
    ----------
    u0 : function of an array, with that period
    x_n : where
    t, viscosity : ε > 0; for ε = 0 `hopf_lax` is called
    points : float
        Quadrature points per width of the narrowest peak of the integrand. The trapezoidal rule converges faster than
        any power: 4 is rounding-level for smooth u0.

    Returns
    -------
    u_n, error
        error: the largest change of u when the spacing is halved.
    """
    _check(t, viscosity, period)
    x = np.asarray(x_n, dtype=float)
    if t == 0:
        return np.asarray(u0(x), dtype=float), 0.0
    if viscosity == 0:
        return hopf_lax(u0, x, t, period), math.nan
    coarse = _quadrature(u0, x, t, viscosity, period, points)
    fine = _quadrature(u0, x, t, viscosity, period, 2 * points)
    return fine, float(np.abs(fine - coarse).max(initial=0.0))


def _quadrature(u0, x, t, viscosity, period, points):
    _, size, steep = _potential(u0, period, 4096)
    # A jump of u0 makes `steep` infinite-like; its kink of G is integrated by cells no wider than 1/16384 of the
    # period.
    width = math.sqrt(2 * viscosity / (1 / t + min(steep, 1e3 * size / period)))
    cells = int(max(512 * points / 4, math.ceil(period / (width / points))))
    cells += -cells % 64
    h = period / cells
    # Beyond this the integrand is below e^−40 of its peak: |y − x| > t max|u0| only adds (|y − x| − t max|u0|)²/2t to
    # G.
    reach = t * size + math.sqrt(160 * viscosity * t)
    count = 2 * math.ceil(reach / h) + 1
    if count * len(x) > 2e11 or cells > 50_000_000:
        raise AtcError(
            f"viscosity = {viscosity:g}, t = {t:g}: the reference needs {count} quadrature points for each x; take a "
            "larger viscosity, or 0 (Hopf-Lax)"
        )
    from ._kernels import cole_hopf_sums

    nearest = np.rint(x / h).astype(np.int64)
    first, last = int(nearest.min()) - count // 2, int(nearest.max()) + count // 2
    turns, inside = np.divmod(np.arange(first, last + 1), cells)
    Phi = _potential(u0, period, cells)[0]
    return cole_hopf_sums(x, nearest - count // 2 - first, first, Phi[inside] + Phi[-1] * turns, h, count, t, viscosity)


def hopf_lax(u0: Callable, x_n, t: float, period: float = 1.0, cells: int = 8192) -> np.ndarray:
    """The entropy solution of u_t + u u_x = 0: u = (x − y*)/t, y* the least of (x−y)²/2t + ∫₀^y u₀. The least of
    `cells` points a period, then Newton's steps inside its cell."""
    _check(t, 0.0, period)
    x = np.asarray(x_n, dtype=float)
    if t == 0:
        return np.asarray(u0(x), dtype=float)
    Phi, size, _ = _potential(u0, period, cells)
    h = period / cells
    count = 2 * (math.ceil(t * size / h) + 1) + 1
    offsets = np.arange(count) - count // 2
    best = np.empty(len(x), dtype=np.int64)
    block = max(1, _CHUNK // count)
    for begin in range(0, len(x), block):
        xs = x[begin : begin + block, None]
        index = np.rint(xs / h).astype(np.int64) + offsets
        turns, inside = np.divmod(index, cells)
        G = (xs - index * h) ** 2 / (2 * t) + Phi[inside] + Phi[-1] * turns
        best[begin : begin + block] = index[np.arange(len(xs)), G.argmin(axis=1)]
    lo, hi = (best - 1) * h, (best + 1) * h

    def stationary(y):
        return (y - x) / t + np.asarray(u0(np.mod(y, period)), dtype=float)

    # G' changes sign from − to + across its least point: bisection, which jumps of u0 do not disturb.
    for _ in range(60):
        mid = 0.5 * (lo + hi)
        up = stationary(mid) > 0
        lo, hi = np.where(up, lo, mid), np.where(up, mid, hi)
    return (x - 0.5 * (lo + hi)) / t
