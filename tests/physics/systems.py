"""Small hot systems with real potentials, for the laws of physics."""

from functools import cache
from pathlib import Path

import numpy as np
from frames import argon

import atc
from atc.units import units

SW = Path(__file__).resolve().parents[2] / "data" / "silicon_plate" / "Si.sw"


def silicon(seed=0, cells=2, tilt=(0.0, 0.0, 0.0), shake=0.25, temperature=600.0):
    """Diamond, shaken hard enough that every angle term acts, in a box that may be tilted."""
    rng = np.random.default_rng(seed)
    a = 5.431
    basis = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4
    corners = np.stack(np.meshgrid(*[np.arange(cells)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    s = ((corners + basis) / cells).reshape(-1, 3)
    L = a * cells
    cell = atc.Cell([[L, 0, 0], [tilt[0], L, 0], [tilt[1], tilt[2], L]], [3.0, -2.0, 11.0])
    x = cell.cartesian(s) + rng.uniform(-shake, shake, s.shape)
    u = units("metal")
    v = rng.normal(size=x.shape) * np.sqrt(u.boltzmann * temperature / 28.0855) + [0.01, 0.02, -0.005]
    return atc.Frame(x, cell, u, masses=np.full(len(x), 28.0855), velocities=v)


@cache
def potential(name):
    lines = {
        "lj": "pair_style lj/cut 6.0\npair_coeff * * 0.0104 3.4\npair_coeff 1 2 0.014 3.3",
        "sw": f"pair_style sw\npair_coeff * * {SW} Si",
    }
    return atc.potential(lines[name], units="metal")


def system(name, seed=0):
    """(frame, potential): periodic, tilted, hot."""
    if name == "lj":
        return argon("tilted", seed=seed, n=(3, 3, 3)), potential("lj")
    frame = silicon(seed, tilt=(1.5, -2.0, 3.0))
    if name == "nep":
        import energy_systems

        return frame.replace(types=np.arange(len(frame)) % 2 + 1), energy_systems.potential("nep")
    return frame, potential("sw")
