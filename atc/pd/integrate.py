"""Velocity Verlet in kernels: half kick, drift, and the sums of the energy ledger, in chunks of nodes that do not
depend on threads."""

from __future__ import annotations

import numpy as np

from ..compiled import njit
from .bonds import JIT

CHUNK = 4096


@njit(**JIT)
def kick(a, b, half_dt, damping, F, mass, v):
    """v += ½Δt F/m with linear damping treated implicitly: the half kick before the drift takes the friction of the old
    velocity."""
    factor = 1.0 - half_dt * damping
    for chunk in range(a, b):
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            w = half_dt / mass[n]
            for c in range(3):
                v[n, c] = v[n, c] * factor + w * F[n, c]


@njit(**JIT)
def kick_end(a, b, half_dt, damping, F, mass, v):
    """The half kick after the forces: friction of the new velocity."""
    factor = 1.0 / (1.0 + half_dt * damping)
    for chunk in range(a, b):
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            w = half_dt / mass[n]
            for c in range(3):
                v[n, c] = (v[n, c] + w * F[n, c]) * factor


@njit(**JIT)
def drift(a, b, dt, v, z):
    for chunk in range(a, b):
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            for c in range(3):
                z[n, c] += dt * v[n, c]


@njit(**JIT)
def kick_drift(a, b, half_dt, dt, F, mass, v, z):
    """`kick` without damping and `drift` in one pass."""
    for chunk in range(a, b):
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            w = half_dt / mass[n]
            for c in range(3):
                v[n, c] += w * F[n, c]
                z[n, c] += dt * v[n, c]


@njit(**JIT)
def power(a, b, F, v, out):
    """F·v by chunk: half of what forces F do in a unit of time."""
    for chunk in range(a, b):
        s = 0.0
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            s += F[n, 0] * v[n, 0] + F[n, 1] * v[n, 1] + F[n, 2] * v[n, 2]
        out[chunk] = s


@njit(**JIT)
def kinetic(a, b, mass, v, out):
    """½ m v² by chunk."""
    for chunk in range(a, b):
        s = 0.0
        for n in range(chunk * CHUNK, min(len(v), chunk * CHUNK + CHUNK)):
            s += 0.5 * mass[n] * (v[n, 0] ** 2 + v[n, 1] ** 2 + v[n, 2] ** 2)
        out[chunk] = s


def chunks(n):
    """How many chunks n nodes make."""
    return -(-n // CHUNK)


def total(kernel, crew, n, *args):
    """The sum over chunks of a kernel that writes one number a chunk."""
    out = np.zeros(chunks(n))
    crew.run(kernel, chunks(n), *args, out, grain=4)
    return float(out.sum())
