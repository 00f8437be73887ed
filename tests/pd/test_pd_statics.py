"""Equilibria are steps of a run: they count, they move the clock when asked to, their work is accounted for, and a
restart goes on bitwise."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError

SOLVERS = ["relax", "solve_static"]
INF = np.inf


def bar(load=lambda t: (3e-4 * t, 0, 0), material=None, **options):
    """A plate held at its left edge, pulled at its right one, under a load of its own."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (14.1, 5.1, 0)), 1.0, 3.015, 1.0, dimension=2)
    end = np.array([None, 0.0, 0.0])
    return pd.Simulation(
        body, material or pd.PMB(youngs=1.0),
        conditions=[
            pd.Prescribed(pd.Box((-1, -1, -1), (1.5, 9, 1)), displacement=(0, 0, 0)),
            pd.Prescribed(pd.Box((12.5, -1, -1), (20, 9, 1)), displacement=lambda t: (0.05 * t, *end[1:])),
            pd.BodyForce(pd.Box((5, -1, -1), (9, 9, 1)), lambda t: np.array(load(t), float)),
        ], threads=1, **options,
    )  # fmt: skip


@pytest.mark.parametrize("solver", SOLVERS)
def test_an_equilibrium_is_a_step_and_time_is_what_it_is_told(solver):
    sim = bar()
    solve = getattr(pd, solver)
    solve(sim, time=1.0)
    assert (sim.state.step, sim.state.time) == (1, 1.0)
    edge = sim.body.X_nc[:, 0] > 12.5
    np.testing.assert_array_equal(sim.state.u_nc[edge, 0], 0.05)
    first = sim.state.u_nc.copy()
    # now: the same loads, the same state
    solve(sim)
    assert (sim.state.step, sim.state.time) == (2, 1.0)
    np.testing.assert_allclose(sim.state.u_nc, first, atol=2e-6)
    solve(sim, time=2.5)
    assert (sim.state.step, sim.state.time) == (3, 2.5)
    np.testing.assert_array_equal(sim.state.u_nc[edge, 0], 0.125)
    # back to where it was: elastic bodies have no memory
    solve(sim, time=1.0)
    np.testing.assert_allclose(sim.state.u_nc, first, atol=3e-6)
    # and on in motion from there
    sim.step(3)
    assert sim.state.step == 7 and sim.state.time == pytest.approx(1.0 + 3 * sim.dt)


@pytest.mark.parametrize(
    "material",
    [pd.PMB(youngs=1.0), pd.LPS(youngs=1.0, poisson=0.3), pd.Correspondence(youngs=1.0, poisson=0.3)],
    ids=lambda m: m.name,
)
def test_the_ledger_of_a_quasi_static_history_closes(material):
    """Loads and reactions do what the strain energy gains, to second order in the increments."""
    errors = []
    for increments in (2, 4, 8):
        sim = bar(material=material)
        for k in range(increments):
            pd.solve_static(sim, time=4.0 * (k + 1) / increments, tolerance=1e-9)
        e = sim.energies()
        assert (
            e.work_external > 0.02 * e.strain
            and e.work_constraint > 0.1 * e.strain
            and abs(e.dissipated_damping) < 1e-6 * e.strain
        )
        errors.append(abs(e.total) / e.strain)
    assert errors[0] < 1e-2 and errors[2] < errors[0] / 10, errors


@pytest.mark.parametrize("solver", SOLVERS)
def test_what_a_sudden_load_releases_is_dissipated(solver):
    """A load that is there from the start does twice the work that the (linear) body keeps; a moving body's motion goes
    too."""
    sim = bar(load=lambda t: (1e-5, 0, 0), velocities=np.where(np.arange(90)[:, None] % 15 == 7, [0, 1e-5, 0], 0.0))
    moving = sim.energies().kinetic
    getattr(pd, solver)(sim, tolerance=1e-8)
    e = sim.energies()
    assert moving > 0 and e.kinetic == 0 and e.work_external == pytest.approx(2 * e.strain, rel=1e-4)
    assert e.dissipated_damping == pytest.approx(e.strain + moving, rel=1e-4) and e.total == pytest.approx(
        moving, rel=1e-3
    )


@pytest.mark.parametrize("solver", SOLVERS)
def test_a_restart_between_equilibria_is_bitwise(solver):
    solve = getattr(pd, solver)
    whole, first = bar(), bar()
    for t in (0.5, 1.0, 1.5, 2.0):
        solve(whole, time=t)
    for t in (0.5, 1.0):
        solve(first, time=t)
    again = bar(state=pd.State.from_arrays(first.state.to_arrays()))
    for t in (1.5, 2.0):
        solve(again, time=t)
    for sim in (whole, again):
        sim.step(5)
    a, b = whole.state.to_arrays(), again.state.to_arrays()
    assert a["step"] == 9
    for k in a:
        assert np.array_equal(a[k], b[k]), k
    assert whole.energies() == again.energies()


@pytest.mark.parametrize(
    "solver, few", [("relax", {"max_steps": 3}), ("solve_static", {"max_iterations": 1, "inner": 1})]
)
def test_without_an_equilibrium_everything_is_as_it_was(solver, few):
    sim = bar()
    sim.step(3)
    before, energies = sim.state.to_arrays(), sim.energies()
    with pytest.raises(AtcError, match="after 3 steps|did not converge"):
        getattr(pd, solver)(sim, time=3.0, tolerance=1e-12, **few)
    after = sim.state.to_arrays()
    for k in before:
        assert np.array_equal(before[k], after[k]), k
    assert sim.energies() == energies
    with pytest.raises(AtcError, match="finite number, got nan"):
        getattr(pd, solver)(sim, time=np.nan)


@pytest.mark.parametrize("solver", ["relax", "static"])
def test_cases_of_equilibria(tmp_path, solver):
    """`atc pd`: one state of equilibrium a step, `dt` apart; its ledger closes; the second half of a run from the first
    one's restart is bitwise the whole."""
    case = {
        "body": {
            "region": {"shape": "box", "lo": [0, 0, 0], "hi": [14.0, 5.0, 0]},
            "spacing": 1.0,
            "horizon": 3.015,
            "density": 1.0,
            "dimension": 2,
        },
        "material": {"model": "pmb", "youngs": 1.0},
        "prescribed": [
            {"region": {"shape": "box", "lo": [-1, -1, -1], "hi": [1.5, 9, 1]}, "displacement": [0, 0, 0]},
            {"region": {"shape": "box", "lo": [12.5, -1, -1], "hi": [20, 9, 1]}, "displacement": ["0.02*t", "free", 0]},
        ],
        "indenter": {"radius": 3.0, "stiffness": 1e-2, "center": [7, "8.0 - 0.1*t", 0]},
        "run": {"steps": 6, "solver": solver, "dt": 0.5},
        "output": {"every": 1, "restart": str(tmp_path / "end.npz")},
    }
    whole = Case.load(case).run(tmp_path / "whole.nc", threads=1)
    assert whole.step.values.tolist() == list(range(7)) and whole.time.values.tolist() == [0.5 * k for k in range(7)]
    strain, work = whole.energy_strain.values, (whole.energy_work_external + whole.energy_work_constraint).values
    assert (np.diff(strain) > 0).all() and (np.diff(whole.energy_work_external) > 0).all()
    np.testing.assert_allclose(work[1:], strain[1:], rtol=5e-3)
    Case.load({**case, "run": {**case["run"], "steps": 3}}).run(tmp_path / "half.nc", threads=1)
    rest = {**case, "run": {**case["run"], "steps": 3, "restart": str(tmp_path / "end.npz")}}
    ds = Case.load(rest).run(tmp_path / "rest.nc", threads=1)
    assert ds.step.values.tolist() == [3, 4, 5, 6]
    for name in ("displacement", "force", "time", "energy_strain", "energy_total", "energy_work_external"):
        assert np.array_equal(ds[name].values[-1], whole[name].values[-1]), name


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("strain", [0.01, 1e-7])
def test_a_strained_cell_alone_is_a_load(solver, strain):
    """A periodic body with a slit, loaded by its cell only: equilibrium is found, and its energy is below the uniform
    one's."""
    from atc.frame import Cell

    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (19, 19, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False,
        cell=Cell([20.0, 20, 1], periodic=(True, True, False)), notches=[pd.Notch.line((6.2, 9.5), (13.8, 9.5))],
    )  # fmt: skip
    H = np.diag([0.0, strain, 0.0])
    # one node is held against rigid motion: it carries no load
    hold = pd.Prescribed(pd.Nodes([0]), displacement=(0, 0, 0))
    sim = pd.Simulation(body, pd.PMB(youngs=1.0), strain=H, conditions=[hold], threads=1)
    before, largest = sim.energies().strain, np.abs(sim.bond_forces().F_bc).max()
    found = getattr(pd, solver)(sim, tolerance=1e-6)
    assert found.residual <= 1e-6 and found.iterations > 0
    free = np.delete(sim.forces(), 0, axis=0)
    assert np.abs(free).max() <= 1e-6 * max(largest, np.abs(sim.forces()).max())
    assert 0.3 * before < sim.energies().strain < 0.99 * before


def test_what_has_converged_is_kept():
    """An equilibrium that leaves scipy nothing to improve is a result, not an error."""
    sim = bar()
    first = pd.solve_static(sim, time=1.0, tolerance=1e-9)
    again = pd.solve_static(sim, time=1.0, tolerance=max(2 * first.residual, 1e-12), max_iterations=1)
    assert again.residual <= max(2 * first.residual, 1e-12)
