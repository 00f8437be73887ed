"""The potential itself on nodes: molecular dynamics where every atom is a node, exact gradients and homogeneous states on
coarser ones."""

import numpy as np
import pytest
from crystals import constants, crystal, elastic, model
from test_linear import supercell

from atc import pd
from atc.frame import Cell
from atc.twins.body import TwinBody, body_of_atoms
from atc.twins.smoothed import Shape, basis_of, smoothed


def twin_of(name, repeat, spacing=None):
    """On the atoms, or on nodes `spacing` cubes apart."""
    frame, a = supercell(name, repeat), crystal(name).conventional[0, 0]
    if spacing is None:
        made = body_of_atoms(frame, crystal(name).density, 1.5 * a)
    else:
        step = a * spacing
        counts = [round(r / spacing) for r in repeat]
        X = (np.array(np.meshgrid(*map(np.arange, counts), indexing="ij")).reshape(3, -1).T + 0.5) * step
        body = pd.Body(X, step**3, crystal(name).density, 1.8 * step, cell=frame.cell, spacing=step)
        made = TwinBody(body, None, step * np.eye(3), crystal(name).density, crystal(name).density)
    return frame, made.body, smoothed(crystal(name), model(name), np.eye(3), frame, made, spacing is None)


def test_a_node_at_every_atom_is_molecular_dynamics():
    """Forces, and two hundred steps at a tenth of the bonds' length, beside velocity Verlet under the potential."""
    frame, body, twin = twin_of("argon", (3, 3, 3))
    rng = np.random.default_rng(1)
    u = 0.15 * rng.normal(size=(len(frame), 3))
    sim = pd.Simulation(body, twin.material, displacements=u, safety=0.3)
    pot, m = model("argon"), frame.masses[0]
    x, v = frame.positions + u, np.zeros_like(u)
    f = pot.stream(frame.replace(positions=x), forces=True).forces_nc
    assert sim.forces() == pytest.approx(f, abs=1e-10 * np.abs(f).max())
    for _ in range(200):
        v += 0.5 * sim.dt / m * f
        x = x + sim.dt * v
        f = pot.stream(frame.replace(positions=x), forces=True).forces_nc
        v += 0.5 * sim.dt / m * f
    sim.step(200)
    assert np.abs(v).max() > 0
    assert sim.positions_nc == pytest.approx(x, abs=1e-8)
    momentum = (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)
    assert np.abs(momentum).max() < 1e-12 * (sim.mass_n[:, None] * np.abs(sim.state.v_nc)).sum()


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_forces_are_the_gradient_of_the_energy(name):
    frame, body, twin = twin_of(name, (4, 4, 4), spacing=2)
    u = 0.1 * np.random.default_rng(2).normal(size=(len(body), 3))
    sim = pd.Simulation(body, twin.material, displacements=u)
    F, h = sim.forces().copy(), 1e-4
    assert np.abs(F.sum(axis=0)).max() < 1e-11 * np.abs(F).max()
    for node, c in ((0, 0), (3, 1), (5, 2)):
        U = []
        for sign in (1, -1):
            sim._z[node, c] += sign * h
            U.append(sim.energies().strain)
            sim._z[node, c] -= sign * h
        assert -(U[0] - U[1]) / (2 * h) == pytest.approx(F[node, c], abs=2e-6 * np.abs(F).max())
    assert body.rho_n @ body.V_n == pytest.approx(frame.masses.sum(), rel=1e-12)


@pytest.mark.parametrize("name", ["argon", "silicon"])
def test_homogeneous_strain_has_the_crystals_energy(name):
    """½ ε C ε at small strains, the basis relaxed, in a cell that is strained with the nodes."""
    frame, body, twin = twin_of(name, (4, 4, 4), spacing=2)
    H = 1e-4 * np.array([[1.0, 0.6, 0.0], [0.6, 0.0, 0.0], [0.0, 0.0, -0.5]])
    rest, strained = (pd.Simulation(body, twin.material, strain=s).energies().strain for s in (0 * H, H))
    e = np.array([H[0, 0], H[1, 1], H[2, 2], 0, 0, 2 * H[0, 1]])
    want = 0.5 * e @ elastic(name).C_vv @ e * frame.cell.volume
    assert strained - rest == pytest.approx(want, rel=1e-3)


def test_shape_functions_are_linear_complete_at_surfaces():
    """Atoms beyond the outermost nodes too."""
    frame = supercell("argon", (3, 3, 3))
    a = crystal("argon").conventional[0, 0]
    frame = frame.replace(cell=Cell(frame.cell.vectors, periodic=(False, True, True)))
    X = (np.array(np.meshgrid(*[np.arange(3)] * 3, indexing="ij")).reshape(3, -1).T + 0.5) * a
    shape = Shape(frame, X, a * np.eye(3))
    ones = shape.weights_kJ @ np.ones(len(X))
    assert ones == pytest.approx(np.ones(len(frame)), abs=1e-12)
    H = np.random.default_rng(0).normal(size=(3, 3))
    assert shape.weights_kJ @ (X @ H.T) + shape.shift_kc @ H.T == pytest.approx(frame.positions @ H.T, abs=1e-10)


def test_atoms_know_their_place_in_the_basis():
    frame = supercell("silicon", (2, 2, 2))
    basis = basis_of(frame, crystal("silicon"))
    assert np.bincount(basis).tolist() == [len(frame) // 2] * 2
    d = np.linalg.norm(frame.positions[:, None] - frame.positions, axis=2)
    i, j = np.nonzero((d > 0) & (d < 2.4))
    assert (basis[i] != basis[j]).all() and len(constants("silicon").crystal) == 2
