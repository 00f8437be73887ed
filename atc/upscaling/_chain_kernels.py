"""Numba kernels of the chains: forces, energies, velocity Verlet. Arrays and numbers only.

Displacements sit in an array padded by M nodes on either side, so that the loops over nodes have no ends: the pads hold
the images (periodic) or zero.
"""

from __future__ import annotations

import numpy as np

from ..compiled import njit

_BLOCK = 1024  # nodes per pass over the neighbours: three such rows stay in the first-level cache


@njit(cache=True, error_model="numpy")
def pad(u, M, periodic):
    """Fill the M nodes on either side of the chain."""
    n = u.shape[0] - 2 * M
    if periodic:
        for i in range(M):
            u[i] = u[i + n]
            u[M + n + i] = u[M + i]
    else:
        for i in range(M):
            u[i] = 0.0
            u[M + n + i] = 0.0


@njit(cache=True, error_model="numpy")
def _add_neighbors(left, here, right, w, out):
    for i in range(out.shape[0]):
        out[i] += w * ((left[i] - here[i]) + (right[i] - here[i]))


@njit(cache=True, error_model="numpy")
def springs_force(u, w, out):
    """out_i = Σ_q w_q (u_{i+q} − 2 u_i + u_{i−q}); u padded."""
    M, n = w.shape[0], out.shape[0]
    for begin in range(0, n, _BLOCK):
        end = min(begin + _BLOCK, n)
        row = out[begin:end]
        row[:] = 0.0
        for q in range(1, M + 1):
            _add_neighbors(
                u[M + begin - q : M + end - q], u[M + begin : M + end], u[M + begin + q : M + end + q], w[q - 1], row
            )


@njit(cache=True, error_model="numpy")
def springs_energy(u, w, periodic):
    """½ Σ w_q (u_{i+q} − u_i)² over all bonds; clamped: also those to the nodes outside, which are at zero."""
    n, total = u.shape[0], 0.0
    for q in range(1, w.shape[0] + 1):
        s = 0.0
        for i in range(n):
            j = i + q
            if j < n:
                s += (u[j] - u[i]) ** 2
            elif periodic:
                s += (u[j % n] - u[i]) ** 2
            else:
                s += u[i] ** 2
        if not periodic:
            for i in range(min(q, n)):
                s += u[i] ** 2
        total += 0.5 * w[q - 1] * s
    return total


@njit(cache=True, error_model="numpy")
def _lj_bonds(left, right, length, A12, B6, f):
    """dU/dr of the bonds between two rows of nodes."""
    for i in range(f.shape[0]):
        inv = 1.0 / (length + (right[i] - left[i]))
        i2 = inv * inv
        i6 = i2 * i2 * i2
        f[i] = (B6 - A12 * i6) * (i6 * inv)


@njit(cache=True, error_model="numpy")
def _add(out, f, scale):
    for i in range(out.shape[0]):
        out[i] += scale * f[i]


@njit(cache=True, error_model="numpy")
def lj_force(u, dx, M, A, B, scale, out, work):
    """out_i = scale Σ_bonds dU/dr; every bond once: its force goes to both ends. work holds at least n + M numbers."""
    n = out.shape[0]
    out[:] = 0.0
    for q in range(1, M + 1):
        f = work[: n + q]  # the bonds that begin at nodes −q … n−1
        _lj_bonds(u[M - q : M + n], u[M : M + n + q], q * dx, 12.0 * A, 6.0 * B, f)
        _add(out, f[q:], scale)
        _add(out, f[:n], -scale)


@njit(cache=True, error_model="numpy")
def lj_energy(u, dx, M, A, B, periodic):
    """Σ_bonds [A/r¹² − B/r⁶] minus the same at rest."""
    n, total = u.shape[0], 0.0
    for q in range(1, M + 1):
        s = 0.0
        r0 = q * dx
        rest = A * r0**-12 - B * r0**-6
        for i in range(n):
            j = i + q
            uj = u[j] if j < n else (u[j % n] if periodic else 0.0)
            i6 = (r0 + (uj - u[i])) ** -6
            s += (A * i6 - B) * i6 - rest
        if not periodic:
            for i in range(min(q, n)):
                i6 = (r0 + u[i]) ** -6
                s += (A * i6 - B) * i6 - rest
        total += s
    return total


@njit(cache=True, error_model="numpy")
def springs_verlet(u, v, a, w, dt, steps, periodic):
    """`steps` steps of velocity Verlet; u padded, all arrays updated in place; a is the acceleration of u at entry and
    at exit."""
    M, n = w.shape[0], v.shape[0]
    for _ in range(steps):
        for i in range(n):
            v[i] += 0.5 * dt * a[i]
            u[M + i] += dt * v[i]
        pad(u, M, periodic)
        springs_force(u, w, a)
        for i in range(n):
            v[i] += 0.5 * dt * a[i]


@njit(cache=True, error_model="numpy")
def stretch_range(u, M, dx):
    """Smallest and largest stretch of the bonds between neighbours, and which bonds: u padded; a NaN counts as the
    smallest."""
    lo, hi, ilo, ihi = np.inf, -np.inf, 0, 0
    for i in range(M - 1, u.shape[0] - M):
        F = 1.0 + (u[i + 1] - u[i]) / dx
        if not F >= lo:
            lo, ilo = F, i - M
        if F > hi:
            hi, ihi = F, i - M
    return lo, ilo, hi, ihi


@njit(cache=True, error_model="numpy")
def lj_verlet(u, v, a, work, dx, M, A, B, inverse_density, dt, steps, periodic, lowest, highest):
    """As `springs_verlet`; stops after the first step with a bond between neighbours outside (lowest, highest). Returns
    the steps done."""
    n = v.shape[0]
    for step in range(steps):
        for i in range(n):
            v[i] += 0.5 * dt * a[i]
            u[M + i] += dt * v[i]
        pad(u, M, periodic)
        lo, _, hi, _ = stretch_range(u, M, dx)
        if not (lo > lowest and hi < highest):
            return step + 1
        lj_force(u, dx, M, A, B, inverse_density, a, work)
        for i in range(n):
            v[i] += 0.5 * dt * a[i]
    return steps
