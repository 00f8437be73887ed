"""Short runs of LAMMPS with everything a user's script may do, and what they leave: a dump and a log."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from lammps_oracle import Config, lammps_session, thermal_lattice

ARGON = "pair_style lj/cut 8.0\npair_coeff * * 0.238 3.4\npair_coeff 2 2 0.3 3.3"
SALT = "pair_style lj/cut/coul/dsf 0.2 8.0\npair_coeff 1 1 0.3 2.6\npair_coeff 2 2 0.2 3.4\npair_coeff 1 2 0.25 3.0"
WATER = (
    "pair_style lj/cut 7.0\npair_coeff * * 0.0 1.0\npair_coeff 1 1 0.155 3.166\nbond_style harmonic\nbond_coeff 1 "
    "450.0 0.9572\nangle_style harmonic\nangle_coeff 1 55.0 104.52"
)


def run(
    folder,
    config: Config,
    model,
    script,
    *,
    columns="id type q x y z vx vy vz fx fy fz",
    fmt="%.15g",
    every=5,
    name="run",
    log=True,
    before=(),
):
    """Write `name`.dump every so many steps while `script` runs; returns (path of the dump, path of the log). The data
    file is `name`.data."""
    folder = Path(folder)
    data, dump, logfile = (folder / f"{name}.{s}" for s in ("data", "dump", "log"))
    config.write_data(data)
    lines = [
        f"units {config.units}",
        f"atom_style {config.atom_style}",
        "boundary " + " ".join("p" if p else "f" for p in config.periodic),
        *before,
        f"read_data {data}",
        *model.splitlines(),
        "neigh_modify delay 0 every 1",
        f"dump d all custom {every} {dump} {columns}",
        f"dump_modify d sort id format float {fmt} units yes time yes",
        *script.splitlines(),
    ]
    with lammps_session(log=logfile if log else "none") as lmp:
        for line in lines:
            lmp.command(line)
    return dump, logfile


def argon(seed=1, units="real", periodic=(True, True, True), charges=False):
    """216 atoms of two types and masses, warm."""
    L = 21.0
    x, t = thermal_lattice((L, L, L), (6, 6, 6), jitter=0.08, kinds=2, seed=seed)
    if not all(periodic):
        x = 0.05 * L + 0.9 * x
    v = np.random.default_rng(seed).normal(0, {"real": 2e-3, "metal": 2.0}[units], x.shape)
    q = np.where(t == 1, 0.4, -0.3) if charges else np.zeros(len(t))
    return Config(np.full(3, L), x, t, units, {1: 40.0, 2: 30.0}, q, v, periodic=periodic, atom_style="charge")


def salt(seed=2):
    """216 ions on a jittered lattice, neutral."""
    L = 18.0
    x, _ = thermal_lattice((L, L, L), (6, 6, 6), jitter=0.06, seed=seed)
    t = np.indices((6, 6, 6)).sum(0).ravel() % 2 + 1
    v = np.random.default_rng(seed).normal(0, 2e-3, x.shape)
    return Config(np.full(3, L), x, t, "real", {1: 23.0, 2: 35.45}, np.where(t == 1, 1.0, -1.0), v, atom_style="charge")


def water(seed=3, n=4):
    """n³ three-point molecules, a little off their equilibrium, with angles."""
    rng = np.random.default_rng(seed)
    L, d, half = 3.3 * n, 0.9572, np.radians(104.52 / 2)
    o, _ = thermal_lattice((L, L, L), (n, n, n), jitter=0.05, seed=seed)
    shape = d * np.array([[0.0, 0, 0], [np.sin(half), np.cos(half), 0], [-np.sin(half), np.cos(half), 0]])
    x = []
    for centre in o:
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        x.append(centre + shape @ q)
    x = np.concatenate(x)
    m = np.arange(len(o)) * 3
    bonds = np.concatenate([np.stack([m, m + 1], 1), np.stack([m, m + 2], 1)])
    angles = np.stack([m + 1, m, m + 2], 1)
    t = np.tile([1, 2, 2], len(o))
    mass = {1: 15.9994, 2: 1.008}
    v = (
        rng.normal(0, 1, x.shape)
        * np.sqrt(0.0019872067 * 300 / np.array([mass[k] for k in t]) / 48.88821291**2)[:, None]
    )
    return Config(
        np.full(3, L),
        x,
        t,
        "real",
        mass,
        np.where(t == 1, -0.82, 0.41),
        v,
        bonds=bonds,
        angles=angles,
        molecules=np.repeat(np.arange(len(o)), 3) + 1,
        atom_style="full",
    )
