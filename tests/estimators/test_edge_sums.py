"""Bonds whose forces do not act along them but that have energy sources: edges of a model with centres."""

import numpy as np
import pytest

from atc.bonds import Bonds
from atc.estimators.bond_pass import AtomSums, BondFactors
from atc.estimators.sums import Sums


class Atoms:
    """As much of a frame as sums of atoms ask for."""

    def __init__(self, n):
        self.velocities = np.zeros((n, 3))

    def __len__(self):
        return len(self.velocities)


def edges(rng, n=7, b=40):
    """Edges centre → neighbour with any gradient g of the centre's energy: F on the centre is g, ∂U^(c)/∂x_n = g."""
    r, g = rng.normal(size=(b, 3)), rng.normal(size=(b, 3))
    i = rng.integers(0, n, b).astype(np.int32)
    D = np.stack([g, np.zeros((b, 3))], axis=1)
    return Bonds(i, (i + 1).astype(np.int32) % np.int32(n), -r, np.zeros(b), D_bdc=D, F_bc=g), r, g


@pytest.fixture(scope="module")
def made():
    bonds, r, g = edges(np.random.default_rng(4))
    beta = np.random.default_rng(5).random((3, len(bonds)))
    total = beta @ BondFactors(["moment", "sources"], Atoms(7), 0.0).of(bonds)
    return Sums(bond={"moment": total[:, :9], "sources": total[:, 9:]}), np.einsum("gb,bm,bn->gmn", beta, r, g), bonds


def test_stress_of_edges_has_nine_components(made):
    sums, expected, _ = made
    assert np.abs(expected - expected.transpose(0, 2, 1)).max() > 0.1 * np.abs(expected).max()
    assert np.abs(sums.potential_stress - expected).max() <= 1e-14 * np.abs(expected).max()


def test_churning_of_edges_is_what_stress_and_sources_leave(made):
    """S = Σ r_e⊗g_e β and M = −S: nothing. With half the sources half of S is left, all nine components of it."""
    sums, expected, _ = made
    size = np.abs(expected).max()
    assert np.abs(sums.churning).max() <= 1e-14 * size
    half = Sums(bond={"moment": sums.bond["moment"], "sources": 0.5 * sums.bond["sources"]})
    assert np.abs(half.churning - 0.5 * expected).max() <= 1e-14 * size


def test_sources_of_edges_leave_nothing_of_the_forces(made):
    """With all of the sources, and the whole force at every atom without any of them."""
    bonds = made[2]
    for share in (1.0, 0.0):
        sums = AtomSums(Atoms(7), 1, residual=True)
        sums.add(Bonds(bonds.i, bonds.j, bonds.r_bc, bonds.G_b, D_bdc=share * bonds.D_bdc, F_bc=bonds.F_bc), 0)
        F = np.zeros((7, 3))
        np.add.at(F, bonds.i, bonds.F_bc)
        np.add.at(F, bonds.j, -bonds.F_bc)
        found, size = sums.residual_n4[:, :3], sums.residual_n4[:, 3:]
        assert (np.abs(found - (1 - share) * F) <= 1e-14 * size).all()
        assert size.min() > 0
