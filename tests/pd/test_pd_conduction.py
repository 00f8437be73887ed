"""Heat conduction in the bonds: spots of heat, walls of layers, steady states, cracks; and what expands by it."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell
from atc.pd.conduction import HeatFlow, _chebyshev

K, C = 2.0, 5.0
METAL = pd.Conduction(K, C)


def lattice(hi, dimension, **more):
    return pd.Body.lattice(pd.Box((0, 0, 0), hi), 1.0, 3.015, 1.5, dimension=dimension, warn=False, **more)


def lps(**more):
    return pd.LPS(youngs=1.0, poisson=0.25, **more)


@pytest.mark.parametrize("dimension, influence", [(1, "one"), (2, "inverse"), (3, "one")])
def test_conductivity_is_what_was_asked(dimension, influence):
    """In a uniform gradient a node inside gets no heat, and its share of Σ C (ΔT)²/2 is ½ k V |g|²."""
    body = lattice(np.where(np.arange(3) < dimension, 12.1, 0.0), dimension)
    flow = HeatFlow(body, {1: METAL}, influence=influence)
    g = np.array([1.0, -0.4, 0.7]) * (np.arange(3) < dimension)
    T = body.X_nc @ g
    t = body.bonds
    whole = np.ones(len(t), np.uint8)
    per_node = t.sums(0.25 * flow.C_b * (T[t.j_b] - T[t.i_b]) ** 2) / (0.5 * K * body.V_n)
    middle = int(np.argmin(((body.X_nc - body.X_nc.mean(axis=0)) ** 2).sum(axis=1)))
    assert per_node[middle] == pytest.approx(g @ g, rel=1e-12)
    assert abs(flow.flow_n(T, whole)[middle]) < 1e-12
    assert abs(flow.flow_n(np.random.default_rng(0).normal(size=len(body)), whole).sum()) < 1e-10


def test_a_spot_of_heat_spreads():
    """A Gaussian in a plate: variance σ² + 2kt/ρc along both axes, and the profile but for the fourth
    moment of the horizon."""
    m, sigma = 71, 7.0
    body = lattice((m - 0.9, m - 0.9, 0), 2, cell=Cell([float(m), m, 1], periodic=[True, True, False]))
    r = body.X_nc[:, :2] - 35.0
    T = np.exp(-(r**2).sum(axis=1) / (2 * sigma**2))
    sim = pd.Simulation(body, pd.PMB(1.0), conduction=METAL, temperature=T, dt=0.5, threads=1)
    heat = sim.heat_flow.capacity_n @ T
    sim.step(20)
    now, D = sim.temperature_n, K / (C * 1.5)
    grown = sigma**2 + 2 * D * sim.state.time
    for c in range(2):
        # what lies beyond 5 σ comes in from the neighbour cells
        assert (now * r[:, c] ** 2).sum() / now.sum() == pytest.approx(grown, rel=1e-4)
    np.testing.assert_allclose(now, sigma**2 / grown * np.exp(-(r**2).sum(axis=1) / (2 * grown)), atol=3e-3)
    assert sim.heat_flow.capacity_n @ now == pytest.approx(heat, rel=1e-13)
    assert not sim.forces().any()


def test_time_is_second_order_and_any_step_is_stable():
    """Against the matrix exponential; a step of a thousand times Euler's limit decays as it should."""
    body = lattice((11.1, 0, 0), 1)
    flow = HeatFlow(body, {1: METAL})
    whole = np.ones(len(body.bonds), np.uint8)
    A = np.array([flow.flow_n(e, whole) for e in np.eye(len(body))]).T / flow.capacity_n[:, None]
    w, V = np.linalg.eigh(A)
    assert -w.min() <= flow.fastest
    T = np.cos(np.pi * body.X_nc[:, 0] / 12) + body.X_nc[:, 0] ** 2
    exact = V @ (np.exp(w * 16.0) * (V.T @ T))
    errors = []
    for steps in (4, 8, 16):
        now = T.copy()
        for _ in range(steps):
            flow.advance(now, 0.0, 16.0 / steps, whole)
        errors.append(np.abs(now - exact).max())
    assert errors[0] < 0.02 * np.ptp(exact) and errors[0] > 3 * errors[1] > 9 * errors[2]
    far = _chebyshev(lambda y: A @ y, T, 2000 / flow.fastest, flow.fastest)
    assert np.abs(far - T.mean()).max() < 0.5 * np.ptp(T) and far.mean() == pytest.approx(T.mean(), rel=1e-12)


def test_a_wall_of_two_layers():
    """Hot on one side, cold on the other: the flow is that of conductors in series, in statics of large steps."""
    body = lattice((39.1, 4.1, 0), 2)
    x, right = body.X_nc[:, 0], dict(surface_correction="energy")
    body.material_n = np.where(x < 19.5, 1, 2).astype(np.int32)
    ends = [pd.FixedTemperature(x < 2.5, 100.0), pd.FixedTemperature(x > 36.5, lambda t: 0.0)]
    two = {1: pd.Conduction(8.0, C), 2: pd.Conduction(1.0, C)}
    sim = pd.Simulation(
        body, {1: lps(**right), 2: lps(**right)}, conduction=two, threads=1,
        conditions=[*ends, pd.Prescribed(None, displacement=(0, 0, 0))],
    )  # fmt: skip
    for k in range(150):
        pd.solve_static(sim, time=100.0 * (k + 1))
    T = sim.temperature_n
    slopes = [np.polyfit(x[part], T[part], 1)[0] for part in ((x > 5) & (x < 16), (x > 23) & (x < 34))]
    assert slopes[0] * 8.0 == pytest.approx(slopes[1], rel=2e-3)
    # From the edges of what is held (2.5 and 36.5), give or take half a spacing each.
    flow = 100.0 / (17 / 8.0 + 17 / 1.0) * 5
    assert -slopes[1] * 5 == pytest.approx(flow, rel=0.05)
    assert sim.heat_power(x > 36.5) == pytest.approx(-slopes[1] * 5, rel=0.01)
    with pytest.raises(AtcError, match="heat does not go back"):
        pd.solve_static(sim, time=1.0)


def test_sources_expansion_and_restarts():
    """A bar with a source grows by α ∫T dx, whatever its temperatures; heat is what was brought; halves of a run are the
    whole."""
    alpha = 1e-4
    body = lattice((19.1, 0, 0), 1)
    pin = pd.Prescribed(pd.Nodes([0]), displacement=(0, 0, 0))
    source = pd.HeatSource(body.X_nc[:, 0] > 14.5, total=lambda t: 3.0)
    make = lambda **m: pd.Simulation(  # noqa: E731
        body, lps(expansion=alpha), conduction=METAL, conditions=[pin, source], threads=1, **m
    )
    sim = make()
    pd.solve_static(sim, time=10.0)
    T = sim.temperature_n
    assert sim.heat_flow.capacity_n @ T == pytest.approx(30.0, rel=1e-12)
    assert sim.state.history["heat_brought"][0] == pytest.approx(30.0, rel=1e-12)
    assert T[-1] > 3 * T[0]
    # between the middles of the end nodes, which count half
    grown = alpha * (T.sum() - 0.5 * (T[0] + T[-1]))
    assert sim.state.u_nc[-1, 0] == pytest.approx(grown, rel=0.02)
    runs = [make(dt=0.2), make(dt=0.2)]
    runs[0].step(40)
    runs[1].step(25)
    again = make(dt=0.2, state=pd.State.from_arrays(runs[1].state.to_arrays()))
    again.step(15)
    a, b = runs[0].state.to_arrays(), again.state.to_arrays()
    for k in a:
        assert np.array_equal(a[k], b[k]), k
    assert np.abs(runs[0].state.u_nc).max() > 0


def test_a_crack_keeps_heat_back():
    notch = pd.Notch.line((5.5, -9), (5.5, 20), as_damage=True)
    body = lattice((11.1, 4.1, 0), 2, notches=[notch])
    left = body.X_nc[:, 0] < 5.5
    sim = pd.Simulation(body, lps(), conduction=METAL, temperature=np.where(left, 7.0, 0.0), threads=1, dt=0.3)
    sim.step(5)
    np.testing.assert_allclose(sim.temperature_n, np.where(left, 7.0, 0.0), atol=1e-12)


def test_cases_and_what_is_refused(tmp_path):
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [9, 3, 0]}, "spacing": 1.0, "horizon": 3.015,
                 "density": 1.5, "dimension": 2, "temperature": "2*x"},
        "material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25, "conductivity": K, "specific_heat": C,
                      "expansion": 1e-5}],
        "temperature": [{"region": {"shape": "box", "lo": [-1, -1, -1], "hi": [1.5, 9, 1]}, "value": "10*t + y"}],
        "heat_source": [{"total": {"times": [0.0, 1.0], "values": [0.0, 4.0]}}],
        "run": {"steps": 4, "dt": 0.1},
    }  # fmt: skip
    ds = Case.load(case).run(tmp_path / "warm.nc", threads=1)
    assert ds.temperature.attrs["units"] == "K"
    first, last = ds.temperature.values[0], ds.temperature.values[-1]
    x, y = ds.position_x.values, ds.position_y.values
    np.testing.assert_allclose(first, np.where(x < 1.5, y, 2 * x))
    np.testing.assert_allclose(last[x < 1.5], 10 * 0.4 + y[x < 1.5])
    assert np.abs(ds.displacement.values[-1]).max() > 0
    for change, words in (
        ({"material": [{**case["material"][0], "name": "a"},
                       {"model": "lps", "youngs": 1.0, "poisson": 0.25, "region": {"shape": "box", "lo": [5, -1, -1],
                        "hi": [9, 9, 1]}}]}, "needs conductivity"),
        ({"material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25}]}, "needs a body that conducts"),
        ({"heat_source": [{"density": 1.0, "total": 1.0}]}, "exactly one of density and total"),
        ({"temperature": [{}]}, "needs value"),
        ({"temperature": [{"value": "1/t"}]}, "1/t"),
    ):  # fmt: skip
        with pytest.raises(AtcError, match=words):
            Case.load({**case, **change}).simulation(1)
    body = lattice((5.1, 3.1, 0), 2)
    with pytest.raises(AtcError, match="FixedTemperature: this body conducts no heat"):
        pd.Simulation(body, lps(), conditions=[pd.FixedTemperature(None, 1.0)], threads=1)
    with pytest.raises(AtcError, match="specific_heat must be a number greater than 0"):
        pd.Conduction(1.0, np.nan)
    with pytest.raises(AtcError, match="material 1 of the body has no conductivity"):
        pd.Simulation(body, lps(), conduction={2: METAL}, threads=1)


def test_restarts_with_and_without_heat(tmp_path):
    """A run without heat goes on with it from [body] temperature; one with heat never without; temperatures of a state go
    before the body's."""
    metal = {"conductivity": K, "specific_heat": C}
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [5, 3, 0]}, "spacing": 1.0, "horizon": 3.015,
                 "density": 1.5, "dimension": 2},
        "material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25, "expansion": 1e-3}],
        "initial": [{"velocity": ["1e-3*x", 0, 0]}],
        "run": {"steps": 3, "dt": 0.1},
    }  # fmt: skip
    warm = {**case, "material": [{**case["material"][0], **metal}], "body": {**case["body"], "temperature": "2*x"}}
    files = {}
    for name, c in (("cold", case), ("warm", warm)):
        files[name] = str(tmp_path / f"{name}.npz")
        Case.load({**c, "output": {"restart": files[name]}}).run(tmp_path / f"{name}.nc", threads=1)
    go_on = lambda c, name: {**c, "run": {**c["run"], "restart": files[name]}}  # noqa: E731
    ds = Case.load(go_on(warm, "cold")).run(tmp_path / "heated.nc", threads=1)
    np.testing.assert_array_equal(ds.temperature.values[0], 2 * ds.position_x.values)
    assert ds.step.values[0] == 3 and np.abs(ds.displacement.values[0]).max() > 0
    with pytest.raises(AtcError, match="case: the state has temperatures, of a run that conducted heat") as e:
        Case.load(go_on(case, "warm")).run(tmp_path / "lost.nc", threads=1)
    assert "\n" not in str(e.value)
    other = {**warm, "body": {**case["body"], "temperature": 77.0}}
    again = Case.load(go_on(other, "warm")).run(tmp_path / "again.nc", threads=1)
    ended = Case.load({**warm, "run": {"steps": 3, "dt": 0.1}}).run(tmp_path / "whole.nc", threads=1)
    np.testing.assert_array_equal(again.temperature.values[0], ended.temperature.values[-1])
