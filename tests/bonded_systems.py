"""Melts of short chains with bonds and angles, and their comparison with LAMMPS: shared by the tests of bonded
styles."""

import numpy as np
from lammps_oracle import Config, run_lammps

import atc

# Cells, in units of a bond length of about 1: roomy, tilted, and one so thin that bonds reach almost across half of it.
CELLS = {
    "orthogonal": np.diag([9.0, 8.0, 10.0]),
    "triclinic": np.array([[9.0, 0, 0], [4.1, 8.0, 0], [-3.7, 2.9, 10.0]]),
    "thin": np.array([[2.3, 0, 0], [1.1, 2.6, 0], [-0.9, 1.2, 2.5]]),
}


def chains(cell, n_chains=8, length=11, spread=0.12, seed=0):
    """Random walks with bond lengths around 1 and angles everywhere between 40 and 180°, not wrapped; bonds and
    angles."""
    rng = np.random.default_rng(seed)
    x = np.empty((n_chains, length, 3))
    for chain in x:
        p, d = rng.uniform(0, 1, 3) @ cell, rng.normal(size=3)
        for k in range(length):
            chain[k] = p
            d = d / np.linalg.norm(d) + 1.1 * rng.normal(size=3) / np.sqrt(3)
            p = p + d / np.linalg.norm(d) * rng.uniform(1 - spread, 1 + spread)
    n = np.arange(n_chains * length).reshape(n_chains, length)
    bonds = np.stack([n[:, :-1], n[:, 1:]], -1).reshape(-1, 2)
    angles = np.stack([n[:, :-2], n[:, 1:-1], n[:, 2:]], -1).reshape(-1, 3)
    return x.reshape(-1, 3), bonds, angles, rng


def melt(cell="orthogonal", unit_style="lj", scale=1.0, kinds=2, **kw):
    """A Config of chains; `scale` is the bond length in the unit style's length unit."""
    cell = CELLS[cell]
    x, bonds, angles, rng = chains(cell, **kw)
    return Config(
        cell * scale,
        x * scale,
        units=unit_style,
        bonds=bonds,
        bond_types=rng.integers(1, kinds + 1, len(bonds)),
        angles=angles,
        angle_types=rng.integers(1, kinds + 1, len(angles)),
        origin=(1.3 * scale, -0.4 * scale, 2.2 * scale),
    )


def agrees(config, lines, *, folder=None, reach=3.0, rtol=1e-10, pair=""):
    """Energy, shares, forces and virial equal LAMMPS's. 1e-10 is the project's promise; rounding is ~1e-14.

    LAMMPS needs a pair style and ghosts as far as bonds reach: `reach`, in its length unit."""
    # Beside a zero pair style (no forces, only ghosts) unless the test brings its own.
    around = pair or f"pair_style zero {reach}\npair_coeff * *\n"
    res = run_lammps(around + lines.replace("@", f"{folder}/" if folder else ""), config)
    frame = config.frame()
    d = atc.potential(pair + lines.replace("@", ""), config.units, folder=folder).decompose(frame)
    u = frame.units
    np.testing.assert_allclose(u.to_user("energy", d.energy), res.energy, rtol=rtol)
    for mine, theirs in (
        (u.to_user("energy", d.energies_n), res.energies_n),
        (u.to_user("force", d.forces_nc), res.forces_nc),
        (u.to_user("pressure_volume", d.virial_cc), res.virial),
    ):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=rtol * abs(theirs).max())
    np.testing.assert_allclose(d.bonds.virial(), d.virial_cc, rtol=0, atol=1e-12 * abs(d.virial_cc).max())
    return d


NO_BOND = "bond_style zero\nbond_coeff *\n"
