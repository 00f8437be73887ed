"""Torsions and maps that tell a molecule from its mirror image: forces are the derivatives of the energy, the balance
laws hold, and where the energy is even in the angle all is as with forces along distances."""

import numpy as np
import pytest

import atc
from atc.analysis.check import check
from atc.decomposers import Constraints, HarmonicTorsion, HeldPairs, Potential
from atc.decomposers.bonded.chiral import AcrossTorsion, CorrectionMaps, CosineLaw, torsion_angle
from atc.decomposers.openmm.atoms import listed
from atc.errors import AtcError
from atc.frame import Cell, Frame
from atc.units import units

U = units("mdanalysis")
RNG = np.random.default_rng(7)
ATOMS = (
    np.cumsum(RNG.normal(0.0, 0.35, (12, 3)) + [1.2, 0.0, 0.0], axis=0) + RNG.normal(0, 0.5, (12, 3)) + [2.0, 6.0, 6.0]
)
ROWS = np.array([[0, 0, 0], [0.02, 1, 0.7], [0.03, 3, -1.1]])
MAP = RNG.normal(0.0, 0.02, (24, 24))


def frame(x=ATOMS, **more):
    return Frame(x, Cell([18.0, 14.0, 14.0]), U, masses=np.linspace(1.0, 16.0, len(x)), **more)


def torsions(rows=ROWS):
    atoms = [[k, k + 1, k + 2, k + 3] for k in range(9)]
    return listed(AcrossTorsion(CosineLaw(rows), "chiral torsion"), atoms, [1 + k % (len(rows) - 1) for k in range(9)])


def maps():
    atoms = [[k, k + 1, k + 2, k + 3, k + 4] for k in range(0, 8, 2)]
    return listed(CorrectionMaps([MAP, MAP.T + 0.01]), atoms, [1, 2, 1, 2])


@pytest.mark.parametrize("term", [torsions(), maps()], ids=["torsions", "maps"])
def test_forces_are_derivatives(term):
    pot = Potential([term], U)
    d = pot.decompose(frame())
    h, F = 1e-4, np.zeros_like(ATOMS)
    for n, c in np.ndindex(*ATOMS.shape):
        values = []
        for s in (-2, -1, 1, 2):
            x = ATOMS.copy()
            x[n, c] += s * h
            values.append(pot.stream(frame(x)).energy)
        F[n, c] = -(values[0] - 8 * values[1] + 8 * values[2] - values[3]) / (12 * h)
    size = np.abs(F).max()
    np.testing.assert_allclose(d.forces_nc, F, atol=1e-8 * size)
    # what adds up to nothing, and turns nothing
    assert np.abs(d.forces_nc.sum(0)).max() <= 1e-13 * size
    assert np.abs(d.virial_cc - d.virial_cc.T).max() <= 1e-12 * np.abs(d.virial_cc).max()
    np.testing.assert_allclose(d.virial_cc, -ATOMS.T @ d.forces_nc, atol=1e-12 * np.abs(d.virial_cc).max())
    assert d.energies_n.sum() == pytest.approx(d.energy, rel=1e-13)
    assert not pot.central and pot.churnless


def test_the_angle_is_that_of_a_chain():
    x = np.array([[[1.0, 0, 0], [0, 0, 0], [0, 0, 1.0], [np.cos(a), np.sin(a), 1.0]] for a in (0.3, -2.0, 3.0)])
    np.testing.assert_allclose(torsion_angle(x)[0], [0.3, -2.0, 3.0], atol=1e-15)


def test_maps_at_their_points_and_between():
    """A map of a few waves, which 24 points say well; at the points the map itself."""
    term, at = CorrectionMaps([MAP]), 2 * np.pi / 24 * np.arange(24)
    phi, psi = (a.ravel() for a in np.meshgrid(at, at, indexing="ij"))
    np.testing.assert_allclose(term.energies(phi - 2 * np.pi, psi, np.ones(576, int))[0], MAP.ravel(), atol=1e-15)
    wave = lambda p, s: np.cos(p - 0.4) * (1 + np.sin(s)) + np.sin(p + 2 * s)  # noqa: E731
    term = CorrectionMaps([wave(*np.meshgrid(at, at, indexing="ij"))])
    p, s = RNG.uniform(-np.pi, np.pi, (2, 200))
    E, E_p, E_s = term.energies(p, s, np.ones(200, int))
    np.testing.assert_allclose(E, wave(p, s), atol=2e-3)
    np.testing.assert_allclose(E_p, -np.sin(p - 0.4) * (1 + np.sin(s)) + np.cos(p + 2 * s), atol=1e-2)
    np.testing.assert_allclose(E_s, np.cos(p - 0.4) * np.cos(s) + 2 * np.cos(p + 2 * s), atol=2e-2)


def test_an_even_torsion_is_the_same_either_way():
    """Energy, forces, virial and shares of those with phases 0 and 180° are those of forces along distances."""
    across = torsions(np.array([[0, 0, 0], [0.02, 2, np.pi], [0.03, 3, 0.0]]))
    atoms, types = across.terms_of(frame())
    along = listed(HarmonicTorsion({1: (0.02 / U.energy, -1, 2), 2: (0.03 / U.energy, 1, 3)}, units=U), atoms, types)
    a, b = (Potential([t], U).decompose(frame()) for t in (across, along))
    for name in ("forces_nc", "virial_cc", "energies_n"):
        x, y = getattr(a, name), getattr(b, name)
        np.testing.assert_allclose(x, y, atol=1e-12 * np.abs(y).max())


@pytest.mark.parametrize("held", [False, True])
def test_balance_laws(held):
    """Momentum and energy at every point, with the heat flux, beside pairs with forces along them and constraints."""
    more = atc.decomposers.LennardJones(0.2, 1.5, 4.0, units="mdanalysis")
    pairs = atc.potential(more, special_bonds="lj/coul 1 1 1").terms
    pot = Potential([torsions(), maps(), *pairs], U)
    pot = pot.constrained(Constraints([HeldPairs(((1, 2), (6, 7)))])) if held else pot
    report = check(frame(velocities=RNG.normal(0, 0.01, ATOMS.shape)), pot, atc.kernel("gaussian", width=1.5), points=4)
    laws = report.data["laws"]
    assert report.ok, report
    assert max(laws[k]["fields"]["residual"] for k in ("momentum", "energy")) < 1e-9, laws


def test_three_atoms_in_a_line_are_refused():
    x = np.array([[2.0, 2, 2], [3, 2, 2], [4, 2, 2], [5, 3, 2]])
    pot = Potential([listed(AcrossTorsion(CosineLaw(ROWS), "chiral torsion"), [[0, 1, 2, 3]], [1])], U)
    with pytest.raises(AtcError, match="chiral torsion of the atoms 1, 2, 3, 4 has no finite energy and forces"):
        pot.stream(frame(x))
