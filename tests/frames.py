"""Small frames for the tests of estimators."""

import numpy as np

from atc.frame import Cell, Frame
from atc.units import units

CELLS = {
    "orthogonal": Cell([9.0, 10.0, 11.0], [-3.0, 2.0, 50.0]),
    "tilted": Cell([[9.0, 0, 0], [3.5, 10.0, 0], [-2.0, 4.0, 11.0]], [1.0, 0.0, -7.0]),
    "slab": Cell([9.0, 10.0, 24.0], periodic=(True, True, False)),
    "open": Cell([9.0, 10.0, 11.0], periodic=(False, False, False)),
}


def argon(cell="orthogonal", seed=0, n=(2, 3, 3), style="metal", jitter=0.35, temperature=80.0, **more):
    """A disordered frame: jittered lattice, Maxwell velocities with a drift, two masses."""
    rng = np.random.default_rng(seed)
    cell = CELLS[cell] if isinstance(cell, str) else cell
    s = np.stack(np.meshgrid(*[(np.arange(k) + 0.5) / k for k in n], indexing="ij"), -1).reshape(-1, 3)
    x = cell.cartesian(s) + rng.uniform(-jitter, jitter, s.shape)
    masses = rng.choice([39.948, 83.8], len(x))
    u = units(style)
    v = rng.normal(size=x.shape) * np.sqrt(u.boltzmann * temperature / masses)[:, None] + [0.02, -0.01, 0.005]
    return Frame(x, cell, u, types=np.where(masses < 50, 1, 2), masses=masses, velocities=v, **more)
