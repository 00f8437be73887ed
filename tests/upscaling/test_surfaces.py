"""Surface energies against sums over the bonds that a plane cuts, and published ones."""

import numpy as np
import pytest
from crystals import EPSILON, SIGMA, constants, crystal, model

from atc.upscaling.surfaces import cleavage, surface_energy


@pytest.mark.parametrize("plane", [(1, 0, 0), (1, 1, 1)])
def test_a_cut_through_pairs(plane):
    """2γ = −Σ φ(R) (R·n)/V over lattice vectors on one side: every bond is cut as often as it crosses the plane."""
    r = constants("argon").r_bc
    d = np.linalg.norm(r, axis=1)
    phi = 4 * EPSILON * ((SIGMA / d) ** 12 - (SIGMA / d) ** 6)
    across = np.abs(r @ np.array(plane)) / np.linalg.norm(plane)
    want = -0.25 * (phi * across).sum() / crystal("argon").volume
    found = surface_energy(crystal("argon"), model("argon"), plane, relaxed=False)
    assert found.unrelaxed == pytest.approx(want, rel=1e-9)


def test_silicon_cleaves_along_111_between_the_double_layers():
    """One bond of 2.1683 eV for every surface atom; relaxing it changes next to nothing (Stillinger and Weber's
    potential: 1.36 J/m2)."""
    found = cleavage(crystal("silicon"), model("silicon"), planes=((1, 1, 1), (1, 0, 0)))
    area = 3**0.5 / 4 * np.linalg.norm(crystal("silicon").conventional[0]) ** 2
    assert found.plane == (1, 1, 1)
    assert found.unrelaxed == pytest.approx(0.5 * 2.1683 / area, rel=1e-3)
    assert found.unrelaxed * 16.0218 == pytest.approx(1.36, abs=0.01)
    assert 0.97 * found.unrelaxed < found.energy <= found.unrelaxed
