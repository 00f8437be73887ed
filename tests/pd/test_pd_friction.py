"""Coulomb friction: blocks that slide on walls and on each other, against Newton's law for a block."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError

G = 1e-3


def block(mu, angle=0.0, speed=0.0, steps=0, state=None, **wall):
    """A block of 8 by 4 nodes on a plane that is inclined by `angle` (falling along +x), in its own weight."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (7.1, 3.1, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False)
    down = G * np.array([np.sin(angle), -np.cos(angle), 0.0])
    stiffness = 1.0
    depth = np.sqrt(4 * G * np.cos(angle) / stiffness)
    sim = pd.Simulation(
        body, pd.LPS(youngs=10.0, poisson=0.25), walls=pd.Wall((0, depth, 0), (0, 1, 0), stiffness, friction=mu, **wall),
        conditions=[pd.BodyForce(None, down)], velocities=None if state else (speed, 0, 0), dt=0.15, threads=1, state=state,
    )  # fmt: skip
    sim.step(steps)
    return sim


def drift(sim):
    return float(sim.state.v_nc[:, 0].mean())


def test_a_block_slows_down_and_stays():
    """v = v0 − μgt until it stands, after v0²/2μg; its kinetic energy has gone into friction."""
    mu, v0 = 0.3, 0.03
    stop = v0 / (mu * G) / 0.15
    sim = block(mu, speed=v0, steps=round(0.5 * stop))
    assert drift(sim) == pytest.approx(0.5 * v0, rel=0.01)
    sim.step(round(0.7 * stop))
    # It sways on its soles, which stand.
    soles = sim.body.X_nc[:, 1] < 0.5
    assert abs(drift(sim)) < 0.05 * v0 and np.abs(sim.state.v_nc[soles, 0]).max() < 0.01 * v0
    assert sim.state.u_nc[:, 0].mean() == pytest.approx(0.5 * v0**2 / (mu * G), rel=0.02)
    e = sim.energies()
    assert e.dissipated_friction == pytest.approx(0.5 * sim.mass_n.sum() * v0**2, rel=0.01)
    at = sim.state.u_nc[soles, 0].copy()
    sim.step(200)
    assert np.abs(sim.state.u_nc[soles, 0] - at).max() < 1e-3
    start = block(mu, speed=v0).energies().total
    assert abs(sim.energies().total - start) < 1e-3 * e.dissipated_friction


@pytest.mark.parametrize("mu", [0.2, 0.6])
def test_an_inclined_plane(mu):
    """tan 25° = 0.47: with μ = 0.2 it slides down with g (sin α − μ cos α), with 0.6 it stays."""
    a = np.radians(25)
    sim = block(mu, a, steps=1500)
    t = sim.state.time
    if mu < np.tan(a):
        assert drift(sim) == pytest.approx(G * (np.sin(a) - mu * np.cos(a)) * t, rel=0.01)
    else:
        assert abs(drift(sim)) < 0.01 * G * t


def test_a_wall_that_moves_takes_it_along():
    """A belt at 0.02 brings it to its speed: half of the work that comes in is kinetic in the end, half is friction's."""
    v, steps = 0.02, 1500
    sims = [block(0.3, steps=steps, velocity=(v, 0, 0))]
    e = sims[0].energies()
    assert drift(sims[0]) == pytest.approx(v, rel=0.01)
    half = 0.5 * sims[0].mass_n.sum() * v**2
    assert e.dissipated_friction == pytest.approx(half, rel=0.02)
    assert e.work_external == pytest.approx(2 * half, rel=0.02)
    # a half, then the other, is the whole, to the last bit
    first = block(0.3, steps=steps // 2, velocity=(v, 0, 0))
    again = block(0.3, steps=steps // 2, velocity=(v, 0, 0), state=pd.State.from_arrays(first.state.to_arrays()))
    a, b = sims[0].state.to_arrays(), again.state.to_arrays()
    for k in a:
        assert np.array_equal(a[k], b[k]), k


def pressed(mu, held):
    """A block pressed softly onto a row of nodes 0.04 apart, which is smooth: brought to rest, then
    pushed at 0.05. It comes from above, since nodes that are neighbours at the start touch later. The floor is held, or has the opposite force."""
    x = 0.04 * np.arange(200)
    floor = np.stack([x, 0 * x, 0 * x], 1)
    top = np.stack(np.meshgrid(2.0 + 0.5 * np.arange(8), 3.0 + 0.5 * np.arange(3), [0.0], indexing="ij"), -1)
    X = np.concatenate([floor, top.reshape(-1, 3)])
    upper = np.arange(len(X)) >= len(floor)
    body = pd.Body(X, np.where(upper, 0.25, 0.02), 1.0, 1.2, dimension=2, spacing=1.0, materials=np.where(upper, 2, 1), warn=False,
                   unbonded=[(1, 2)])  # fmt: skip
    total = 0.05
    sims = []
    for friction, damping in ((0.0, 0.5), (mu, 0.0)):
        state = sims[0].state.copy() if sims else None
        if sims:
            state.v_nc[:] = np.where(upper, 0.05, 0.0)[:, None] * [1.0, 0, 0]
        conditions = [pd.BodyForce(upper, total=(0, -total, 0))]
        if held or not sims:
            conditions.append(pd.Prescribed(~upper, velocity=(0, 0, 0)))
        else:
            conditions.append(pd.BodyForce(~upper, total=(0, total, 0)))
        sims.append(pd.Simulation(
            body, {k: pd.LPS(youngs=20.0, poisson=0.25) for k in (1, 2)}, contact=pd.Contact(friction=friction),
            dt=0.02, threads=1, state=state, damping=damping, conditions=conditions,
            displacements=None if sims else np.where(upper, -1.7, 0.0)[:, None] * [0, 1.0, 0],
        ))  # fmt: skip
        if len(sims) == 1:
            sims[0].step(2000)
    return sims[1], upper, total


def test_a_block_on_nodes_slows_down():
    mu = 0.3
    sim, upper, N = pressed(mu, held=True)
    m, total = sim.mass_n[upper].sum(), sim.energies().total
    v = []
    for _ in range(10):
        sim.step(40)
        v.append(sim.state.v_nc[upper, 0].mean())
    t = sim.dt * 40 * np.arange(1, 11)
    assert np.polyfit(t, v, 1)[0] == pytest.approx(-mu * N / m, rel=0.03)
    e = sim.energies()
    assert e.dissipated_friction == pytest.approx(mu * N * (0.05 * t[-1] - 0.5 * mu * N / m * t[-1] ** 2), rel=0.03)
    assert abs(e.total - total) < 5e-3 * e.dissipated_friction


def test_friction_of_nodes_changes_no_momentum():
    sim, upper, _ = pressed(0.3, held=False)
    momentum = lambda: (sim.mass_n[:, None] * sim.state.v_nc).sum(axis=0)  # noqa: E731
    # The first half kick is still that of the floor that was held.
    sim.step()
    start = momentum()
    sim.step(100)
    assert np.abs(momentum() - start).max() < 1e-13 * sim.mass_n.sum()
    assert sim.energies().dissipated_friction > 0.01 * 0.5 * sim.mass_n[upper].sum() * 0.05**2


def test_cases_and_what_is_refused():
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [4, 3, 0]}, "spacing": 1.0, "horizon": 3.015,
                 "density": 1.0, "dimension": 2},
        "material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25}],
        "contact": {"friction": 0.2},
        "wall": [{"point": ["0.1*t", 0, 0], "normal": [0, 1, 0], "stiffness": 1.0, "friction": 0.3}],
        "indenter": [{"radius": 1.0, "stiffness": 1.0, "center": [2, 9, 0], "friction": 0.4}],
        "run": {"steps": 1},
    }  # fmt: skip
    sim = Case.load(case).simulation(1)
    assert [r.friction for r in sim.rigid] == [0.4, 0.3] and sim.contact.contact.friction == 0.2
    np.testing.assert_allclose(sim.rigid[1].velocity(0.0, 0.1), [0.1, 0, 0])
    np.testing.assert_allclose(sim.rigid[1].velocity(5.0, 0.1), [0.1, 0, 0])
    with pytest.raises(AtcError, match="friction: what is at rest depends on how it came there"):
        pd.relax(sim)
    with pytest.raises(AtcError, match="friction is a coefficient"):
        pd.Contact(friction=np.nan)
    with pytest.raises(AtcError, match="the wall's point: friction is a coefficient"):
        pd.Wall((0, 0, 0), (0, 1, 0), 1.0, friction=-0.1)
    case["run"] = {"steps": 1, "solver": "static"}
    for what in (("contact", "friction"), ("indenter", 0, "friction"), ("wall", 0, "friction")):
        with pytest.raises(AtcError, match=rf"case: \[{what[0]}\] friction: what is at rest"):
            Case.load(case)
        table = case[what[0]] if len(what) == 2 else case[what[0]][what[1]]
        table["friction"] = 0.0
    assert not Case.load(case).simulation(1).frictional
    case["contact"] = {"friction": "rough"}
    with pytest.raises(AtcError, match="Coulomb's coefficient"):
        Case.load(case)


def test_the_push_is_computed_once(monkeypatch):
    sim = block(0.3, speed=0.02, steps=3)
    calls, add = [], pd.Wall.add
    monkeypatch.setattr(pd.Wall, "add", lambda self, *a: (calls.append(1), add(self, *a))[1])
    sim.step(5)
    assert len(calls) == 5
    # the wall's force is what its nodes feel without friction, and the energy that of their depths
    depth = np.maximum(sim.rigid[0].place(0.0)[1] - sim.positions_nc[:, 1], 0.0)
    assert sim.rigid[0].force[1] == pytest.approx((sim.body.V_n * depth**2).sum(), rel=1e-12)
    assert sim.energies().indenter == pytest.approx((sim.body.V_n * depth**3).sum() / 3, rel=1e-12)


def test_friction_of_nodes_is_a_couple():
    """Opposite forces at the distance of the nodes: their torque is friction times that distance, and no more."""
    sim, upper, N = pressed(0.3, held=True)
    sim.step(40)
    x, f = sim.positions_nc, sim.state.history["friction_nc"]
    pulled = f[upper].sum(axis=0)
    torque = float(np.cross(x, f).sum(axis=0)[2])
    soles = upper & (np.abs(f[:, 0]) > 0)
    height = np.average(x[soles, 1], weights=np.abs(f[soles, 0])) - np.average(
        x[~upper, 1], weights=np.abs(f[~upper, 0])
    )
    assert torque == pytest.approx(-height * pulled[0], rel=0.02) and 0.5 < height < 1.35
    assert abs(pulled[0]) == pytest.approx(0.3 * N, rel=0.1)
