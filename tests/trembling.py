"""Independent samples of a harmonic crystal at a temperature: frames whose fluctuations are known."""

import numpy as np
from crystals import crystal, model

from atc.frame import Frame
from atc.upscaling.force_constants import force_constants


def trembling(name, repeat, frames, T=10.0, seed=0):
    """Independent samples of the harmonic crystal at T: every mode has u of variance kT/ω², v of variance kT."""
    c, rng = crystal(name), np.random.default_rng(seed)
    block, _ = c.supercell(repeat)
    X, masses, n = block.positions, block.masses, len(block)
    fc = force_constants(c, model(name))
    phi = fc.folded(repeat)  # (basis, atoms, 3, 3) of the home cell
    counts = np.array(repeat)
    s = np.rint((X - c.positions[_basis(c, X)]) @ np.linalg.inv(c.vectors)).astype(int)
    b = _basis(c, X)
    D = np.zeros((n, 3, n, 3))
    home = {tuple(v): k for k, v in enumerate(np.column_stack([s % counts, b]).tolist())}
    for a in range(n):
        for other in range(n):
            shift = (s[other] - s[a]) % counts
            # `folded` numbers the atoms of a supercell cell by cell.
            k = np.ravel_multi_index(shift, repeat) * len(c) + b[other]
            D[a, :, other] = phi[b[a], k] / np.sqrt(masses[a] * masses[other])
    assert len(home) == n
    w2, e = np.linalg.eigh(D.reshape(3 * n, 3 * n))
    use = w2 > 1e-9 * w2.max()
    kT = c.units.boltzmann * T
    root = np.repeat(np.sqrt(masses), 3)
    out = []
    for t in range(frames):
        u = (e[:, use] @ (rng.normal(size=use.sum()) * np.sqrt(kT / w2[use]))) / root
        v = (e[:, use] @ (rng.normal(size=use.sum()) * np.sqrt(kT))) / root
        out.append(
            Frame(X + u.reshape(-1, 3), block.cell, c.units, types=block.types, masses=masses,
                  velocities=v.reshape(-1, 3), time=float(t), source=f"made frame {t}")
        )  # fmt: skip
    return out


def _basis(c, X):
    d = (X[:, None] - c.positions) @ np.linalg.inv(c.vectors)
    return np.abs(d - np.rint(d)).sum(axis=2).argmin(axis=1)
