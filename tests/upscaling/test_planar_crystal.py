"""Crystals in the plane: the triangular lattice against closed forms of its springs, rows' energies and strength against
sums over bonds."""

from functools import cache

import numpy as np
import pytest
from crystals import crystal, elastic, model
from scipy.optimize import minimize_scalar

import atc
from atc.errors import AtcError
from atc.twins.material import hill_in_plane
from atc.upscaling.crystal import Crystal, evaluate, relax
from atc.upscaling.elasticity import elastic_constants
from atc.upscaling.surfaces import LOW_INDEX_ROWS, cleavage, strength, surface_energy

#: Nearest neighbours only, so that closed forms hold: U = eps (1 - exp(-alpha (r - 1)))^2 - eps, k = 2 eps alpha^2.
ALPHA = 7.0
MORSE = f"units lj\ndimension 2\npair_style morse 1.5\npair_coeff * * 1.0 {ALPHA} 1.0"


@cache
def triangular():
    pot = atc.potential(MORSE)
    return relax(Crystal.planar("hexagonal", 1.05, 2.0, "lj"), pot), pot


def test_springs_of_nearest_neighbours():
    """C11 = 3 sqrt(3)/4 k, C12 = C66 = C11/3, nothing out of the plane."""
    c, pot = triangular()
    assert c.dimension == 2 and c.lattice_constant == pytest.approx(1.0, abs=1e-9)
    assert c.density == pytest.approx(2.0 / (3**0.5 / 2), rel=1e-9)
    found = elastic_constants(c, pot)
    C = np.zeros((6, 6))
    c11 = 3 * 3**0.5 / 4 * 2 * ALPHA**2
    C[0, 0] = C[1, 1] = c11
    C[0, 1] = C[1, 0] = C[5, 5] = c11 / 3
    assert found.C_vv == pytest.approx(C, abs=1e-6 * c11) and found.stable
    assert hill_in_plane(found.C_vv) == pytest.approx((2 * c11 / 3, c11 / 3), rel=1e-6)


def test_averages_in_the_plane():
    """Of an isotropic plane its own constants; of an anisotropic one between Reuss's and Voigt's."""
    C = np.zeros((6, 6))
    C[0, 0] = C[1, 1] = 10.0
    C[0, 1] = C[1, 0] = 4.0
    C[5, 5] = 5.0
    area, mu = hill_in_plane(C)
    assert area == pytest.approx(7.0)
    assert 2 / (1 / 3 + 1 / 5) < mu < 4.0  # Reuss, Voigt
    assert mu == pytest.approx(0.5 * (4.0 + 2 / (1 / 3 + 1 / 5)))


def bonds_of(c):
    n = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3) if (i, j) != (0, 0)])
    r = n @ c.vectors[:2]
    return r[np.linalg.norm(r, axis=1) < 1.5]


def test_rows():
    """A cut along a close-packed row: two bonds a row's atom; between: every bond as often as it crosses."""
    c, pot = triangular()
    R = bonds_of(c)
    u = (1 - np.exp(-ALPHA * (np.linalg.norm(R, axis=1) - 1))) ** 2 - 1
    least = cleavage(c, pot)
    assert least.plane == (0, 1) and 2 * least.unrelaxed == pytest.approx(2.0, rel=1e-3)
    for row in LOW_INDEX_ROWS:
        normal = np.linalg.inv(c.conventional)[:, :2] @ row
        normal = normal[:2] / np.linalg.norm(normal[:2])
        want = -0.25 * (u * np.abs(R[:, :2] @ normal)).sum() / c.volume
        found = surface_energy(c, pot, row)
        assert found.unrelaxed == pytest.approx(want, rel=1e-9) and 0.9 * want < found.energy <= want


def test_strength_in_the_plane():
    """The maximum of dW/de, W the sum over bonds, on a fine grid of strains."""
    c, pot = triangular()
    R = bonds_of(c)[:, :2]
    e = np.linspace(0.0, 0.4, 4001)
    r = np.linalg.norm(np.stack([np.broadcast_to(R[:, 0], (len(e), len(R))), np.outer(1 + e, R[:, 1])], -1), axis=-1)
    W = 0.5 * np.where(r < 1.5, (1 - np.exp(-ALPHA * (r - 1))) ** 2 - 1, 0.0).sum(axis=1) / c.volume
    P = np.gradient(W, e)
    found = strength(c, pot, (0, 1))
    assert found.stress == pytest.approx(P[e < 0.3].max(), rel=1e-3)
    assert found.strain == pytest.approx(e[P[e < 0.3].argmax()], abs=2e-3)


def test_strength_of_silicon():
    """(111) of Stillinger and Weber's silicon: at the strain of the strength the least energy over the basis, which by
    symmetry moves along the normal, has the slope that is given, and its curvature is zero."""
    c, pot = crystal("silicon"), model("silicon")
    found = strength(c, pot, (1, 1, 1))
    n = np.ones(3) / 3**0.5

    def W(e):
        def energy(s):
            moved = c.strained(e * np.outer(n, n), np.array([np.zeros(3), s * n]))
            return evaluate(pot, moved.frame())[0] / c.volume

        return minimize_scalar(energy, bounds=(-0.6, 0.6), method="bounded", options={"xatol": 1e-9}).fun

    h = 0.01
    below, at, above = (W(found.strain + k * h) for k in (-1, 0, 1))
    # The slope's own curvature at its maximum makes h^2 (d2P/de2)/6 of it: 1e-3 here.
    assert (above - below) / (2 * h) == pytest.approx(found.stress, rel=3e-3)
    M = np.einsum("ijkl,i,j,k,l->", elastic("silicon").tensor, n, n, n, n)
    assert abs(above - 2 * at + below) / h**2 < 0.02 * M


def test_only_planes_have_planar_structures():
    with pytest.raises(AtcError, match="a run in the plane has one of hexagonal"):
        Crystal.planar("fcc", 1.0, 1.0, "lj")
    with pytest.raises(AtcError, match="greater than 0"):
        Crystal.planar("hexagonal", -1.0, 1.0, "lj")
