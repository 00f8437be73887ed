"""Bonds whose forces do not act along them but that have energy sources: edges of a model with centres."""

import numpy as np
import pytest

from atc.bonds import Bonds
from atc.estimators.sources import bond_factors
from atc.estimators.sums import Sums


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
    v = np.zeros((7, 3))
    names = {"moment": 9, "sources": 9}
    total = beta @ bond_factors(list(names), list(names.values()), bonds, v, v)
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
