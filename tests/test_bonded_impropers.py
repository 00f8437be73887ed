"""Impropers of a pyramid: style by style against LAMMPS, in the plane and upright, and what prefers one hand."""

import numpy as np
import pytest
from decomposer_checks import agrees_with_lammps, potential, sources_are_derivatives
from lammps_oracle import Config
from test_decomposers_dihedral import CELLS, lines_of

ZERO = ["pair_style zero 5.0 nocoeff", "pair_coeff * *"]
IMPROPERS = {
    "umbrella": ["1 3 0", "2 2 50", "3 1 80"],
    "fourier": ["1 3 0.2 0.5 -0.7", "2 2 1 -1 0 0", "3 1 0 0 1 1"],
    "inversion/harmonic": ["1 3 0", "2 2 40", "3 1 10"],
    "distance": ["1 3 2", "2 2 0", "3 0 1"],
    "distharm": ["1 3 0", "2 2 0", "3 0 1.5"],
    "sqdistharm": ["1 3 0.2", "2 2 0", "3 0 1"],
    "ring": ["1 3 110", "2 2 90", "3 1 70"],
    "class2": ["1 3 0", "2 2 0", "3 0 20", "1 aa 0.5 0.7 0.9 100 110 120", "2 aa 0 0 0 1 1 1", "3 aa 1 -2 0.3 90 100 130"],
    "cossq": ["1 3 0", "2 2 50", "3 1 90"],
}
faulty = pytest.mark.filterwarnings("ignore:improper_style cossq:atc.errors.AtcWarning")


def pyramids(cell="tilted", n=12, types=3, seed=0, style="real"):
    """An apex (the first atom or the second) with three arms of about 1.2 Å, from flat to steep, across the faces of a small cell."""
    rng = np.random.default_rng(seed)
    x = []
    for _ in range(n):
        a = 2 * np.pi * (np.arange(3) + rng.uniform(-0.15, 0.15, 3)) / 3
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        arms = rng.uniform(1.0, 1.4, (3, 1)) * np.column_stack([np.cos(a), np.sin(a), rng.uniform(-0.9, 0.9) + rng.uniform(-0.2, 0.2, 3)])
        x.append(np.concatenate([np.zeros((1, 3)), arms]) @ q + rng.uniform(0, 10, 3))
    x = np.concatenate(x)
    c = CELLS[cell]
    s = np.floor(x @ np.linalg.inv(c))
    terms = np.arange(4 * n).reshape(n, 4)
    terms[::2] = terms[::2][:, [1, 0, 2, 3]]
    return Config(c, x - s @ c, units=style, impropers=terms, improper_types=rng.integers(1, types + 1, n))


@faulty
@pytest.mark.parametrize("cell", ["orthogonal", "tilted"])
@pytest.mark.parametrize("style", IMPROPERS)
def test_impropers_agree_with_lammps(style, cell):
    config = pyramids(cell)
    lines = lines_of("improper", style, IMPROPERS[style])
    agrees_with_lammps(potential("\n".join(lines), config), [*ZERO, *lines], config)


@pytest.mark.parametrize("style", IMPROPERS)
def test_sources_are_the_derivatives_of_the_shares(style):
    config = pyramids(n=4, seed=3)
    lines = lines_of(
        "improper", style, [c.replace("2 2 50", "2 2 0").replace("3 1 90", "3 1 0") if style == "cossq" else c for c in IMPROPERS[style]]
    )
    sources_are_derivatives(potential("\n".join(lines), config), config.frame())
