"""Thermal strain of state-based bodies: free expansion without stress, held bodies, a strip of two metals, damage."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell

E, NU, ALPHA, RISE = 1.0, 0.25, 1e-3, 0.8


def steel(**more):
    return pd.LPS(youngs=E, poisson=NU, expansion=ALPHA, **more)


@pytest.mark.parametrize("dimension", [3, 2])
def test_expanded_it_is_at_rest_and_held_it_pushes(dimension):
    """Free: no force, no energy, in any body. Held in a periodic cell: −3KαΔT (−EαΔT/(1 − ν) in a plate)."""
    hi = (5.1, 4.1, 4.1 if dimension == 3 else 0)
    body = pd.Body.lattice(pd.Box((0, 0, 0), hi), 1.0, 3.015, 1.0, dimension=dimension, warn=False)
    u = ALPHA * RISE * body.X_nc
    sim = pd.Simulation(body, steel(), temperature=RISE, displacements=u, threads=1)
    cold = pd.Simulation(body, steel(), displacements=u, threads=1)
    assert np.abs(sim.forces()).max() < 1e-12 * np.abs(cold.forces()).max()
    assert sim.energies().strain < 1e-20 * cold.energies().strain
    assert np.abs(sim.bond_forces().F_bc).max() < 1e-12 * np.abs(cold.bond_forces().F_bc).max()
    edge = np.array([6.0, 6.0, 6.0 if dimension == 3 else 1.0])
    periodic = (True, True, dimension == 3)
    whole = pd.Body.lattice(
        pd.Box((0, 0, 0), (5.1, 5.1, 5.1 if dimension == 3 else 0)), 1.0, 2.015, 1.0, dimension=dimension,
        cell=Cell(edge, periodic=periodic), warn=False,
    )  # fmt: skip
    held = pd.Simulation(whole, steel(), temperature=RISE, threads=1)
    f = held.bond_forces()
    stress = -np.einsum("ba,bc->ac", f.R_bc, f.F_bc) / whole.V_n.sum()
    K = held.materials[1].bulk
    want = -3 * K * ALPHA * RISE if dimension == 3 else -E * ALPHA * RISE / (1 - NU)
    np.testing.assert_allclose(np.diag(stress)[:dimension], want, rtol=1e-9)
    assert held.energies().strain == pytest.approx(-0.5 * dimension * want * ALPHA * RISE * whole.V_n.sum(), rel=1e-9)


def test_a_plate_held_to_its_plane():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (5.1, 4.1, 0)), 1.0, 3.015, 1.0, dimension=2, plane="strain", warn=False)
    sim = pd.Simulation(body, steel(), temperature=RISE, displacements=(1 + NU) * ALPHA * RISE * body.X_nc * [1, 1, 0],
                        threads=1)  # fmt: skip
    assert sim.energies().strain < 1e-20


def test_forces_are_the_energys_gradient_with_broken_bonds_too():
    rng = np.random.default_rng(0)
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 3.1, 2.1)), 1.0, 2.5, 1.0, warn=False)
    rise = rng.uniform(0, 20, len(body))
    sim = pd.Simulation(
        body, steel(), temperature=rise, displacements=0.02 * rng.normal(size=(len(body), 3)), threads=1
    )
    sim.state.intact_b[rng.integers(0, len(body.bonds), 30)] = 0
    sim.heat(rise)
    F, z = sim.forces().copy(), sim._z
    for n, c in ((0, 0), (17, 1), (31, 2)):
        value = []
        for sign in (1, -1):
            moved = z.copy()
            moved[n, c] += sign * 1e-6
            value.append(sim.model.energy_n(moved, sim.state.intact_b).sum())
        assert F[n, c] == pytest.approx(-(value[0] - value[1]) / 2e-6, rel=1e-6, abs=1e-9)
    total = np.zeros_like(F)
    f = sim.bond_forces()
    np.add.at(total, f.i, f.F_bc)
    np.add.at(total, f.j, -f.F_bc)
    np.testing.assert_allclose(total, F, atol=1e-13)


def test_a_strip_of_two_layers_bends():
    """Timoshenko (1925): two layers of one stiffness and height h each, κ = 3 (α₁ − α₂) ΔT/(4h)... = 1.5 Δ/(2h) of the
    whole height 2h."""
    h, length = 6, 60
    body = pd.Body.lattice(pd.Box((0, 0, 0), (length - 0.9, 2 * h - 0.9, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False)
    body.material_n = np.where(body.X_nc[:, 1] < h - 0.5, 1, 2).astype(np.int32)
    layers = {1: pd.LPS(youngs=E, poisson=NU, expansion=2e-6, surface_correction="energy"),
              2: pd.LPS(youngs=E, poisson=NU, expansion=0.0, surface_correction="energy")}  # fmt: skip
    middle = np.flatnonzero((np.abs(body.X_nc[:, 0] - 29) < 0.6) & (body.X_nc[:, 1] < 0.1))
    pin = pd.Prescribed(pd.Nodes(middle), displacement=(0, 0, 0))
    sim = pd.Simulation(body, layers, temperature=1.0, conditions=[pin], threads=1)
    pd.solve_static(sim, tolerance=1e-7)
    axis = np.abs(body.X_nc[:, 1] - (h - 0.5)) < 0.6
    inner = axis & (np.abs(body.X_nc[:, 0] - 29.5) < 15)
    kappa = 2 * np.polyfit(body.X_nc[inner, 0], sim.state.u_nc[inner, 1], 2)[0]
    # The hot layer below is the longer one: the ends go up.
    assert kappa == pytest.approx(1.5 * 2e-6 / (2 * h), rel=0.06)


def test_cases_and_what_is_refused(tmp_path):
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [5, 3, 0]}, "spacing": 1.0, "horizon": 3.015,
                 "density": 1.0, "dimension": 2, "temperature": "10*x"},
        "material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25, "expansion": 1e-3}],
        "run": {"steps": 1},
    }  # fmt: skip
    sim = Case.load(case).simulation(1)
    want = 1e-3 * 10 * 0.5 * (sim.body.X_nc[sim.body.bonds.i_b, 0] + sim.body.X_nc[sim.body.bonds.j_b, 0])
    np.testing.assert_allclose(sim.model.rest_b, want * sim.body.bonds.r0_b, rtol=1e-12)
    case["body"]["temperature"] = "1/x"
    with pytest.raises(AtcError, match='1/x" is inf at x = 0'):
        Case.load(case).simulation(1)
    case["body"]["temperature"] = 5.0
    case["material"] = [{"model": "pmb", "youngs": 1.0}]
    with pytest.raises(AtcError, match="pmb has no thermal expansion: take lps or elastic"):
        Case.load(case).simulation(1)
    with pytest.raises(AtcError, match="expansion must be a finite number"):
        pd.LPS(youngs=1.0, poisson=0.2, expansion=np.nan)
    with pytest.raises(AtcError, match="one for each of the"):
        pd.Simulation(sim.body, steel(), temperature=[1.0, 2.0])
