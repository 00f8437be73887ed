"""Plastic bodies: elastic below yield, the yield stress in closed form, unloading, the ledger, restarts, fracture."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell

K, G, YIELD = 1.3, 0.8, 1e-6


def sheared(material, strains, cell=5, dimension=3):
    """A periodic body in homogeneous shear, held to it: σ_xy, the work done on it, and the simulation."""
    side = cell - 0.9
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (side, side, side if dimension == 3 else 0)), 1.0, 2.015, 1.0, warn=False,
        cell=Cell([float(cell), cell, cell], periodic=[True, True, dimension == 3]), dimension=dimension,
        plane="strain",
    )  # fmt: skip
    sim = pd.Simulation(body, material, threads=1)
    out, taken, volume = [], 0.0, body.V_n.sum()
    for g in strains:
        h = np.array([[0, g / 2, 0], [g / 2, 0, 0], [0, 0, 0]])
        sim.model.images[:, 3:] = sim.model.images[:, :3] @ h.T
        sim._z[:, :3] = body.X_nc @ h.T
        sim.model.advance(sim.dt)
        sim._all_forces(False)
        taken += sim.model.taken
        f = sim.bond_forces()
        out.append(-np.einsum("ba,bc->ac", f.R_bc, f.F_bc)[0, 1] / volume)
    out = np.array(out)
    work = volume * float((0.5 * (out[1:] + out[:-1]) * np.diff(strains)).sum())
    return out, work, taken, sim


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("influence", ["one", "inverse"])
def test_shear_there_and_back_in_closed_form(influence, dimension):
    """|τ| ends at σ_Y/√3 (times √(G of this lattice / G): yield is an elastic energy); unloading is elastic; every bit
    of work is stored or taken, and what is taken is σ_Y times the plastic strain."""
    strains = np.r_[np.arange(0.0, 4.0, 0.1), np.arange(4.0, -4.05, -0.1)] * 1e-6
    elastic, *_, plain = sheared(pd.LPS(K, G, influence=influence), strains, dimension=dimension)
    stress, work, taken, sim = sheared(pd.Plastic(K, G, yield_stress=YIELD, influence=influence), strains,
                                       dimension=dimension)  # fmt: skip
    modulus = elastic[10] / strains[10]
    top = YIELD * np.sqrt(modulus / G / 3)
    expected, flowed = [], 0.0
    for g in strains:
        tau = modulus * (g - flowed)
        flowed += max(0.0, abs(tau) - top) / modulus * np.sign(tau)
        expected.append(np.clip(tau, -top, top))
    np.testing.assert_allclose(stress, expected, atol=1e-8 * top)  # bonds lengthen to second order in 4e-6
    assert np.array_equal(stress[:6], elastic[:6]) and stress.min() < -0.999 * top
    stored = sim.energies().strain
    assert abs(work - stored - taken) < 1e-12 * work
    volume, strain_n = sim.body.V_n.sum(), sim.state.history["strain_n"]
    assert np.ptp(strain_n) < 1e-9 * strain_n[0]
    # In steps the mean stress of the one that begins to flow is below yield.
    assert abs(taken / (YIELD * strain_n[0] * volume) - 1) < 2e-3
    # γ^p = √3 of the equivalent plastic strain, summed there and back.
    way = (4e-6 - top / modulus) + (8e-6 - 2 * top / modulus)
    np.testing.assert_allclose(strain_n[0], way / np.sqrt(3) * np.sqrt(modulus / G), rtol=1e-6)


def block(jitter=0.0):
    return pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 3.1, 3.1)), 1.0, 2.015, 1.0, jitter=jitter, warn=False)


def shaken(material, *, dt=0.05, speed=1e-3, jitter=0.2, **more):
    body = block(jitter)
    v = speed * np.random.default_rng(1).normal(size=(len(body), 3))
    return pd.Simulation(body, material, velocities=v - v.mean(axis=0), dt=dt, threads=1, **more)


def test_below_yield_it_is_the_linear_solid_bit_for_bit_and_pressure_does_not_make_it_yield():
    a, b = shaken(pd.LPS(K, G)), shaken(pd.Plastic(K, G, yield_stress=1.0))
    a.step(40)
    b.step(40)
    assert np.array_equal(a.state.u_nc, b.state.u_nc) and a.energies() == b.energies()
    assert not b.state.history["strain_n"].any()
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 4.1, 4.1)), 1.0, 2.015, 1.0, cell=Cell([5.0] * 3), warn=False)
    sim = pd.Simulation(body, pd.Plastic(K, G, yield_stress=1e-6), strain=0.01 * np.eye(3), threads=1)
    sim.step(3)
    assert not sim.state.history["strain_n"].any() and sim.energies().strain > 0


def naive_step(body, u, before, p, limit_n, B_n, W):
    """Return mapping of directed bonds, one node after the other."""
    t = body.bonds
    i, j = np.r_[t.i_b, t.j_b], np.r_[t.j_b, t.i_b]
    xi = body.X_nc[j] - body.X_nc[i]
    r0 = np.linalg.norm(xi, axis=1)
    e = np.linalg.norm(xi + u[j] - u[i], axis=1) - r0
    taken = 0.0
    for n in range(len(body)):
        own = i == n
        w, y = W[own], e[own] - p[own]
        x = y - r0[own] * (w * r0[own] * y).sum() / (w * r0[own] ** 2).sum()
        stored = 0.5 * B_n[n] * (w * x**2).sum()
        if stored > limit_n[n]:
            dp = (1 - np.sqrt(limit_n[n] / stored)) * x
            taken += B_n[n] * (w * (0.5 * (e + before)[own] - p[own] - 0.5 * dp) * dp).sum()
            p[own] += dp
    return e, taken


def test_a_naive_twin_the_ledger_and_bitwise_restarts():
    material = pd.Plastic(K, G, yield_stress=1e-3)
    sim = shaken(material)
    m, half = sim.model, len(sim.body.bonds)
    W, p = np.r_[m.W_b, m.W_b], np.zeros(2 * half)
    limit_n = material.yield_stress**2 / (6 * G) * sim.body.V_n
    before, taken = np.zeros(2 * half), 0.0
    for _ in range(60):
        sim.step()
        before, more = naive_step(sim.body, sim.state.u_nc, before, p, limit_n, m.B_n, W)
        taken += more
    own = np.r_[sim.state.history["plastic_i_b"], sim.state.history["plastic_j_b"]]
    np.testing.assert_allclose(own, p, atol=1e-10 * np.abs(p).max())
    e = sim.energies()
    np.testing.assert_allclose(e.dissipated_material, taken, rtol=1e-10)
    opens = []
    for dt in (0.1, 0.05):
        sim = shaken(material, dt=dt)
        start = sim.energies().total
        sim.step(round(20 / dt))
        e = sim.energies()
        opens.append(abs(e.total - start) / start)
        assert 0.2 * start < e.dissipated_material < start
        assert np.abs((sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)).max() < 1e-15
    assert opens[1] < 0.4 * opens[0] < 0.4 * 0.01, opens
    whole, first = shaken(material), shaken(material)
    whole.step(40)
    first.step(20)
    again = pd.Simulation(first.body, material, dt=0.05, threads=1, state=pd.State.from_arrays(first.state.to_arrays()))
    again.step(20)
    a, b = whole.state.to_arrays(), again.state.to_arrays()
    assert {"history.plastic_i_b", "history.plastic_j_b", "history.strain_n"} <= set(a) and a["history.strain_n"].any()
    for k in a:
        assert np.array_equal(a[k], b[k]), k


def test_bonds_that_break_after_flow_and_forces_by_bonds():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (9.1, 3.1, 2.1)), 1.0, 2.015, 1.0, warn=False)
    v = np.where(body.X_nc[:, :1] > 4.5, 0.3, -0.3) * [1.0, 0, 0]
    runs = []
    for threads in (1, 2):
        sim = pd.Simulation(body, pd.Plastic(K, G, yield_stress=0.05), velocities=v, dt=0.02,
                            damage=pd.CriticalStretch(0.3), threads=threads)  # fmt: skip
        start = sim.energies().total
        sim.step(150)
        runs.append(sim)
    sim = runs[0]
    assert 20 < sim.n_broken < len(body.bonds) and np.array_equal(sim.state.u_nc, runs[1].state.u_nc)
    e, total = sim.energies(), np.zeros((len(body), 3))
    assert e.dissipated_material > 0 and e.dissipated_fracture > 0 and abs(e.total - start) < 0.02 * start
    f = sim.bond_forces()
    np.add.at(total, f.i, f.F_bc)
    np.add.at(total, f.j, -f.F_bc)
    q = sim.state.pending
    np.add.at(total, q["i"], q["F_bc"])
    np.add.at(total, q["j"], -q["F_bc"])
    np.testing.assert_allclose(total, sim.forces(), atol=1e-11 * np.abs(total).max())


def test_what_is_refused_and_cases():
    with pytest.raises(AtcError, match="yield_stress must be a stress greater than 0, got nan"):
        pd.Plastic(K, G, yield_stress=np.nan)
    plate = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 3.1, 0)), 1.0, 2.5, 1.0, dimension=2, warn=False)
    with pytest.raises(AtcError, match="plates in plane stress get thinner as they flow"):
        pd.Simulation(plate, pd.Plastic(K, G, yield_stress=1.0), threads=1)
    sim = shaken(pd.Plastic(K, G, yield_stress=1.0))
    with pytest.raises(AtcError, match="plastic: what is at rest depends on its history"):
        pd.relax(sim)
    with pytest.raises(AtcError, match="plastic has no thermal expansion"):
        sim.heat(1.0)
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [4, 3, 3]}, "spacing": 1.0, "horizon": 2.5,
                 "density": 1.0},
        "material": [{"model": "plastic", "youngs": 1.0, "poisson": 0.25, "yield_stress": 0.01}],
        "run": {"steps": 1},
    }  # fmt: skip
    assert Case.load(case).simulation(1).materials[1].yield_stress == 0.01
    del case["material"][0]["yield_stress"]
    with pytest.raises(AtcError, match="plastic: it needs yield_stress"):
        Case.load(case).simulation(1)
