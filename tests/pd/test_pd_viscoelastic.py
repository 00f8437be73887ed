"""Viscoelastic bodies: relaxation and creep in closed form, the ledger, restarts; LAMMPS's `peri/ves`, step by step, by a
naive twin that has its fault (both ends' deviatoric extensions with the one end's dilatation, which makes momentum)."""

import numpy as np
import pytest
from pd_lammps import run_peri

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell

K, G, SHARE, TIME = 14.9e9, 9.0e9, 0.4, 3e-8


class Twin:
    """Directed bonds in plain numpy: e^db_ij of every bond from each end. `fault`: LAMMPS's."""

    def __init__(self, body, fault, share=SHARE):
        t = body.bonds
        self.body, self.fault, self.share, self.n = body, fault, share, len(body)
        self.i, self.j = np.r_[t.i_b, t.j_b], np.r_[t.j_b, t.i_b]
        xi = body.X_nc[self.j] - body.X_nc[self.i]
        self.r0 = np.linalg.norm(xi, axis=1)
        self.w = np.r_[body.nu_b(), body.nu_b()] * body.V_n[self.j] / self.r0  # ω ν V of the other end
        self.m = np.bincount(self.i, self.w * self.r0**2, self.n)
        self.back = np.zeros((2, len(self.i)))  # of the own end's deviatoric extension, and of the other's
        self.dev = np.zeros((2, len(self.i)))

    def forces(self, x, dt=None):
        i, j, r0 = self.i, self.j, self.r0
        y = x[j] - x[i]
        r = np.linalg.norm(y, axis=1)
        e = r - r0
        theta = 3 / self.m * np.bincount(i, self.w * r0 * e, self.n)
        dev = np.stack([e - theta[i] * r0 / 3, e - theta[i if self.fault else j] * r0 / 3])
        if dt is not None:
            decay = np.exp(-dt / TIME)
            even = 1 - TIME / dt * (1 - decay)
            self.back = decay * self.back + (1 - decay) * self.dev + even * (dev - self.dev)
        self.dev = dev
        pull = 3 * K * (theta[i] / self.m[i] + theta[j] / self.m[j]) * r0
        pull += 15 * G * ((dev - self.share * self.back) / np.stack([self.m[i], self.m[j]])).sum(axis=0)
        f = pull * self.w
        return np.stack([np.bincount(i, f * y[:, c] / r, self.n) for c in range(3)], axis=1)  # force density

    def step(self, x, v, f, dt):
        v = v + 0.5 * dt * f / self.body.rho_n[:, None]
        x = x + dt * v
        f = self.forces(x, dt)
        return x, v + 0.5 * dt * f / self.body.rho_n[:, None], f


def block(n=4):
    side = 0.0005 * (n - 1) + 0.0001
    return pd.Body.lattice(pd.Box((0, 0, 0), (side, side, side)), 0.0005, 0.0015001, 2200.0, warn=False)


def test_lammps_and_the_engine_against_the_twin():
    body = block()
    v = 50 * np.random.default_rng(0).normal(size=(len(body), 3))
    dt, steps = 1e-8, [1, 2, 5, 30]
    lammps = run_peri(body, ("peri/ves", f"* * {K} {G} 0.0015001 10.0 0.0 {SHARE} {TIME}"), steps, dt=dt, velocities=v)
    sim = pd.Simulation(body, pd.Viscoelastic(K, G, fraction=SHARE, time=TIME), velocities=v, dt=dt, threads=1)
    momentum = (sim.mass_n[:, None] * v).sum(axis=0)
    for fault in (True, False):
        twin, x, w = Twin(body, fault), body.X_nc.copy(), v.copy()
        f = twin.forces(x)
        done = 0
        for k, s in enumerate(steps):
            for _ in range(s - done):
                x, w, f = twin.step(x, w, f, dt)
            if not fault:
                sim.step(s - done)
                np.testing.assert_allclose(sim.forces() / body.V_n[:, None], f, atol=1e-9 * np.abs(f).max())
            else:
                np.testing.assert_allclose(lammps[k]["f"], f, atol=1e-9 * np.abs(f).max())
            done = s
    # What that fault is: LAMMPS's forces have a sum.
    assert np.abs(lammps[0]["f"].sum(axis=0)).max() > np.abs(lammps[0]["f"]).max()
    now = (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)
    np.testing.assert_allclose(now, momentum, atol=1e-12 * (sim.mass_n[:, None] * np.abs(v)).sum())


def test_lammps_plastic_has_the_same_fault():
    """`peri/eps` far below yield: not LPS, but the twin with both ends' deviatoric extensions of one end's dilatation."""
    body = block()
    v = 50 * np.random.default_rng(0).normal(size=(len(body), 3))
    lammps = run_peri(body, ("peri/eps", f"* * {K} {G} 0.0015001 10.0 0.0 1e30"), [1, 5], dt=1e-8, velocities=v)
    sim = pd.Simulation(body, pd.Plastic(K, G, yield_stress=1e30), velocities=v, dt=1e-8, threads=1)
    for fault in (True, False):
        twin, x, w = Twin(body, fault, share=0.0), body.X_nc.copy(), v.copy()
        f = twin.forces(x)
        for k in range(5):
            x, w, f = twin.step(x, w, f, 1e-8)
            if fault and k in (0, 4):
                np.testing.assert_allclose(lammps[k // 4]["f"], f, atol=1e-9 * np.abs(f).max())
            elif not fault:
                sim.step()
                np.testing.assert_allclose(sim.forces() / body.V_n[:, None], f, atol=1e-9 * np.abs(f).max())
    assert np.abs(lammps[1]["f"] - f).max() > 0.2 * np.abs(f).max()


def sheared(material, dt, H):
    """A periodic body in homogeneous strain H(t), held to it; σ of its bonds at each step."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 4.1, 4.1)), 1.0, 2.015, 1.0, cell=Cell([5.0, 5, 5]), warn=False)
    sim = pd.Simulation(body, material, dt=dt, threads=1)
    out = []
    for k in range(60):
        h = H(k * dt)
        sim.model.images[:, 3:] = sim.model.images[:, :3] @ h.T
        sim._z[:, :3] = body.X_nc @ h.T
        if k:
            sim.model.advance(dt)
        sim._all_forces(False)
        f = sim.bond_forces()
        out.append(-np.einsum("ba,bc->ac", f.R_bc, f.F_bc) / body.V_n.sum())
    return np.array(out)


def test_relaxation_in_closed_form():
    """A sudden shear: σ = 2με [(1 − λ) + λ exp(−t/τ)], at any step; pressure does not relax."""
    mu, bulk, share, tau, dt = 0.8, 1.3, 0.6, 1.0, 0.11
    material = pd.Viscoelastic(bulk, mu, fraction=share, time=tau)
    shear = 1e-6 * np.array([[0, 1, 0], [1, 0, 0], [0, 0, 0.0]])
    stress = sheared(material, dt, lambda t: shear)[:, 0, 1]
    t = dt * np.arange(60)
    # The lattice's shear modulus differs from the input by its fourth moments, at all times alike.
    np.testing.assert_allclose(stress / stress[0], 1 - share + share * np.exp(-t / tau), rtol=1e-9)
    pressure = sheared(material, dt, lambda t: 1e-6 * np.eye(3))
    np.testing.assert_allclose(pressure[:, 0, 0], 3 * bulk * 1e-6, rtol=1e-5)
    # A ramp: what is linear in time is exact too.
    ramp = sheared(material, dt, lambda t: t * shear)[:, 0, 1]
    np.testing.assert_allclose(
        ramp[1:], stress[0] * ((1 - share) * t + share * tau * (1 - np.exp(-t / tau)))[1:], rtol=1e-9
    )


def test_the_ledger_closes_and_a_restart_is_bitwise():
    """A ringing block comes to rest; what it loses stands in the ledger. The second half of a run is the whole's."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (5.1, 4.1, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False)
    material = pd.Viscoelastic(youngs=1.0, poisson=0.25, fraction=0.5, time=3.0)
    v = 1e-3 * np.random.default_rng(1).normal(size=(len(body), 3)) * [1, 1, 0]
    v -= v.mean(axis=0)
    opens = []
    for dt in (0.2, 0.1):
        sim = pd.Simulation(body, material, velocities=v, dt=dt, threads=1)
        start = sim.energies().total
        sim.step(round(20 / dt))
        e = sim.energies()
        opens.append(abs(e.total - start) / start)
        assert 0.2 * start < e.dissipated_material < start
    assert opens[1] < 0.4 * opens[0] < 0.4 * 0.01, opens
    whole, half = (pd.Simulation(body, material, velocities=v, dt=0.1, threads=1) for _ in range(2))
    whole.step(40)
    half.step(20)
    again = pd.Simulation(body, material, dt=0.1, threads=1, state=pd.State.from_arrays(half.state.to_arrays()))
    again.step(20)
    a, b = whole.state.to_arrays(), again.state.to_arrays()
    assert {"history.back_b", "ledger.dissipated_material"} <= set(a)
    for k in a:
        assert np.array_equal(a[k], b[k]), k


def test_bonds_that_break_and_forces_by_bonds():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (9.1, 5.1, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False)
    v = np.where(body.X_nc[:, :1] > 4.5, 0.3, -0.3) * [1.0, 0, 0]
    runs = []
    for threads in (1, 2):
        sim = pd.Simulation(body, pd.Viscoelastic(youngs=1.0, poisson=0.25, fraction=0.7, time=2.0), velocities=v,
                            damage=pd.CriticalStretch(0.1), threads=threads)  # fmt: skip
        sim.step(60)
        runs.append(sim)
    assert 20 < runs[0].n_broken < len(body.bonds) and np.array_equal(runs[0].state.u_nc, runs[1].state.u_nc)
    sim, total = runs[0], np.zeros((len(body), 3))
    f = sim.bond_forces()
    np.add.at(total, f.i, f.F_bc)
    np.add.at(total, f.j, -f.F_bc)
    # Bonds that broke in the last step have still pulled.
    p = sim.state.pending
    if len(p["i"]):
        np.add.at(total, p["i"], p["F_bc"])
        np.add.at(total, p["j"], -p["F_bc"])
    np.testing.assert_allclose(total, sim.forces(), atol=1e-11 * np.abs(total).max())


def test_what_is_refused_and_cases():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 3.1, 0)), 1.0, 2.5, 1.0, dimension=2, warn=False)
    for bad, words in (({"fraction": 1.2}, "between 0 and 1, got 1.2"), ({"time": 0.0}, "greater than 0, got 0.0")):
        with pytest.raises(AtcError, match=words):
            pd.Viscoelastic(1.0, 0.6, **bad)
    sim = pd.Simulation(body, pd.Viscoelastic(1.0, 0.6), threads=1)
    for solve in (pd.relax, pd.solve_static):
        with pytest.raises(AtcError, match="viscoelastic: what is at rest depends on its history"):
            solve(sim)
    with pytest.raises(AtcError, match="viscoelastic has no thermal expansion"):
        pd.Simulation(body, pd.Viscoelastic(1.0, 0.6), temperature=1.0)
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [4, 3, 0]}, "spacing": 1.0, "horizon": 2.5,
                 "density": 1.0, "dimension": 2},
        "material": [{"model": "viscoelastic", "youngs": 1.0, "poisson": 0.25, "fraction": 0.3, "time": 2.0}],
        "run": {"steps": 1},
    }  # fmt: skip
    material = Case.load(case).simulation(1).materials[1]
    assert (material.fraction, material.time) == (0.3, 2.0)
