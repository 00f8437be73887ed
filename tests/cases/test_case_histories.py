"""What acts on a body of a case as a function of time and place: against closed forms, the engine's own functions, and
the energy ledger."""

import copy

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError

INF = float("inf")
LEFT = {"shape": "box", "lo": [-INF] * 3, "hi": [2.5, INF, INF]}


def plate(**sections):
    case = {
        "body": {
            "region": {"shape": "box", "lo": [0, 0, 0], "hi": [19.0, 9.0, 0]},
            "spacing": 1.0,
            "horizon": 3.015,
            "density": 2.0,
            "dimension": 2,
        },
        "material": {"model": "pmb", "youngs": 1.0},
        "run": {"steps": 200, "safety": 0.3},
    }
    return copy.deepcopy({**case, **sections})


def same(case, other, steps=30):
    a = Case.load(case).simulation(1)
    b = other if isinstance(other, pd.Simulation) else Case.load(other).simulation(1)
    a.step(steps)
    b.step(steps)
    x, y = a.state.to_arrays(), b.state.to_arrays()
    for k in x:
        # formulas may associate otherwise than the numbers they are compared with
        np.testing.assert_allclose(
            x[k],
            y[k],
            rtol=1e-12,
            atol=1e-15 * max(1e-300, np.abs(y[k]).max(initial=0)) if y[k].dtype.kind == "f" else 0,
            err_msg=k,
        )
    return a


def test_a_formula_is_the_function_it_writes():
    case = plate(
        prescribed={"region": LEFT, "velocity": ["1e-3*sin(t)*(1 + y/9)", "free", 0]},
        body_force={"density": ["1e-4*where(x > 10, 1, 0)*exp(-t/5)", 0, 0]},
        initial={"velocity": [0, "1e-3*sin(pi*x/19)", 0]},
    )
    body = Case.load(case).simulation(1).body
    nodes = body.nodes(pd.Box(LEFT["lo"], LEFT["hi"]))
    y, x = body.X_nc[nodes, 1], body.X_nc[:, 0]
    free, zero = np.full(len(nodes), np.nan), np.zeros(len(body))
    other = pd.Simulation(
        body,
        pd.PMB(youngs=1.0),
        safety=0.3,
        threads=1,
        velocities=np.stack([zero, 1e-3 * np.sin(np.pi * x / 19), zero], axis=1),
        conditions=[
            pd.Prescribed(nodes, velocity=lambda t: np.stack([1e-3 * np.sin(t) * (1 + y / 9), free, 0 * y], axis=1)),
            pd.BodyForce(None, lambda t: np.stack([1e-4 * (x > 10) * np.exp(-t / 5), zero, zero], axis=1)),
        ],
    )
    sim = same(case, other)
    assert np.abs(sim.state.u_nc).max() > 1e-3


def test_tables_and_formulas_agree_where_both_are_straight_lines():
    ramp = {"times": [0, 4.0, 5.0], "values": [0, 1e-2, 1e-2]}
    rows = {"times": [0, 4.0, 5.0], "values": [["free", 0, 0], ["free", 1e-2, 0], ["free", 1e-2, 0]]}
    formula = plate(prescribed={"region": LEFT, "displacement": ["free", "1e-2*min(t/4, 1)", 0]})
    same(formula, plate(prescribed={"region": LEFT, "displacement": ["free", ramp, 0]}))
    same(formula, plate(prescribed={"region": LEFT, "displacement": rows}))


@pytest.mark.parametrize("what", ["wall", "indenter"])
def test_paths_of_walls_and_indenters(what):
    thing = {"wall": {"normal": [1, 0, 0], "stiffness": 0.1}, "indenter": {"radius": 3.0, "stiffness": 0.1}}[what]
    place = "point" if what == "wall" else "center"
    steady = same(
        plate(**{what: {**thing, place: ["-0.5 + 0.2*t", 4.5, 0]}}),
        plate(**{what: {**thing, place: [-0.5, 4.5, 0.0], "velocity": [0.2, 0, 0]}}),
    )
    assert abs(steady.state.ledger["work_external"]) > 1e-6
    with pytest.raises(AtcError, match="velocity: .* is a function of time already"):
        Case.load(plate(**{what: {**thing, place: ["t", 0, 0], "velocity": [1, 0, 0]}}))
    with pytest.raises(AtcError, match="unknown 'x'.*known: t, pi"):
        Case.load(plate(**{what: {**thing, place: ["x", 0, 0]}}))


def test_a_node_under_a_force_of_time_moves_as_newton_says():
    """A rigid shift of the whole body: ρ ü = b0 sin(ωt), so u = b0/(ρω²) (ωt − sin ωt)."""
    w = 0.05
    case = plate(body_force={"density": [f"1e-6*sin({w}*t)", 0, 0]})
    sim = Case.load(case).simulation(1)
    sim.step(400)
    t = sim.state.time
    want = 1e-6 / 2.0 / w**2 * (w * t - np.sin(w * t))
    # Verlet's error is (ω Δt)²/12 of it
    np.testing.assert_allclose(sim.state.u_nc[:, 0], want, rtol=(w * sim.dt) ** 2)
    force = {"total": [f"1e-6*200*sin({w}*t)", 0, 0]}
    same(case, plate(body_force=force), 50)


DRIVES = {
    "velocity": {"prescribed": {"region": LEFT, "velocity": ["2e-3*sin(0.3*t)*(1 + y/9)", "1e-3*min(t/20, 1)", 0]}},
    "displacement": {"prescribed": {"region": LEFT, "displacement": ["2e-2*(1 - cos(0.2*t))*(1 + y/9)", "free", 0]}},
    "force": {"body_force": {"density": ["1e-4*sin(0.3*t)*where(x > 10, 1, -y/5)", "1e-5*t", 0]}},
    "indenter": {"indenter": {"radius": 4.0, "stiffness": 0.02, "center": [10, "13.5 - 1.5*sin(0.1*t)", 0]}},
    "both": {
        "prescribed": {"region": LEFT, "velocity": ["2e-3*sin(0.3*t)", "free", 0]},
        "body_force": {"density": [0, {"times": [0, 10, 20], "values": [0, 1e-4, -1e-4]}, 0]},
        "initial": {"velocity": ["1e-3*cos(pi*x/19)", "1e-3*sin(pi*y/9)", 0]},
    },
}


@pytest.mark.parametrize("drive", DRIVES)
def test_the_ledger_closes_under_forces_and_motions_of_time(drive):
    """Kinetic + strain + contact − work is constant, to second order in the time step."""
    errors = []
    for safety in (0.4, 0.1):
        sim = Case.load(plate(**DRIVES[drive], run={"steps": 1, "safety": safety})).simulation(1)
        start, worst, most = sim.energies().total, 0.0, 0.0
        for _ in range(round(120 * 0.4 / safety)):
            sim.step()
            e = sim.energies()
            worst, most = max(worst, abs(e.total - start)), max(most, e.kinetic + e.strain)
        errors.append(worst / most)
    assert most > 1e-9
    # sixteen times less at a quarter of the step; fluctuates by a factor of two with the phase of the fastest waves
    assert errors[0] < 0.02 and errors[1] < errors[0] / 8, errors


def test_influence_functions_by_formula():
    named = plate(
        material={"model": "lps", "youngs": 1.0, "poisson": 0.3, "influence": "linear"},
        initial={"velocity": ["1e-2*x", "1e-2*y*y", 0]},
    )
    written = {**named, "material": {**named["material"], "influence": "max(1 - r/delta, 0)"}}
    same(written, named)
    text = Case.load(written).to_toml()
    assert 'influence = "max(1 - r/delta, 0)"' in text
    for bad, words in (
        ("lineer", "did you mean 'linear'"),
        ("1 - r/d", "unknown 'd'"),
        ("r - delta", "negative at r"),
        ("exp", "known: one"),
    ):
        with pytest.raises(AtcError, match=words):
            Case.load({**named, "material": {**named["material"], "influence": bad}}).simulation(1)


@pytest.mark.parametrize("model", ["correspondence", "bond-associated"])
def test_influence_functions_of_the_bonds_direction(model):
    """A formula with x, y, z is the function of the vector that Python takes; lengths are the case's, delta its horizon;
    two materials with the same one may share bonds. Materials that it would make anisotropic refuse it."""
    table = {"model": model, "youngs": 1.0, "poisson": 0.3, "influence": "(1 + 4*x^2/r^2)*exp(-r/delta)"}
    stretched = {"initial": {"displacement": ["1e-3*x*y", "2e-3*sin(x)", 0]}}
    case = plate(material=table, **stretched)
    sim = Case.load(case).simulation(1)
    length = lambda xi: np.linalg.norm(xi, axis=1)  # noqa: E731
    omega = lambda xi: (1 + 4 * xi[:, 0] ** 2 / length(xi) ** 2) * np.exp(-length(xi) / sim.body.horizon)  # noqa: E731
    kind = {"correspondence": pd.Correspondence, "bond-associated": pd.BondAssociated}[model]
    by_hand, plain = (
        pd.Simulation(
            sim.body, kind(youngs=1.0, poisson=0.3, influence=w), displacements=np.array(sim.state.u_nc), threads=1
        ).forces()
        for w in (omega, "one")
    )
    scale = np.abs(by_hand).max()
    assert np.abs(sim.forces() - by_hand).max() < 1e-12 * scale < np.abs(by_hand - plain).max()
    two = [table, {**table, "youngs": 2.0, "region": {"shape": "box", "lo": [3, -9, -9], "hi": [99, 99, 99]}}]
    Case.load(plate(material=two)).simulation(1)
    for changed, words in (
        ({"model": "lps"}, r"\[material\] influence: .* would make lps anisotropic"),
        ({"influence": "1 + x/r"}, "influence: it must be even"),
        ({"influence": "x^2 - 1"}, "0 or more"),
        ({"influence": "1/y"}, "influence: .*inf at y = 0"),
        ({"influence": "x"}, "even|0 or more"),
        ({"influence": "q*x"}, "unknown 'q'"),
        ({"Gc": 1.0}, "give a critical stretch, s00"),
    ):
        with pytest.raises(AtcError, match=words) as e:
            Case.load(plate(material={**table, **changed})).simulation(1)
        assert "\n" not in str(e.value)


def test_corrections_can_be_chosen():
    for key, value in (("surface_correction", False), ("volume_correction", True)):
        case = plate(material={"model": "pmb", "youngs": 1.0, key: value})
        assert np.array_equal(Case.load(case).simulation(1).model.W_b, Case.load(plate()).simulation(1).model.W_b)
    body = Case.load(plate()).simulation(1).body
    for key, value in (("surface_correction", "energy"), ("volume_correction", False)):
        sim = Case.load(plate(material={"model": "pmb", "youngs": 1.0, key: value})).simulation(1)
        want = pd.Simulation(body, pd.PMB(youngs=1.0, **{key: value})).model.W_b
        assert np.array_equal(sim.model.W_b, want) and not np.allclose(want, Case.load(plate()).simulation(1).model.W_b)
    with pytest.raises(AtcError, match='expected "energy", or false'):
        Case.load(plate(material={"model": "pmb", "youngs": 1.0, "surface_correction": "volume"}))


def test_mistakes_name_the_key_and_the_place(tmp_path):
    text = """[body]
region = { shape = "box", lo = [0, 0, 0], hi = [9, 9, 0] }
spacing = 1
horizon = 3.01
density = 1
dimension = 2
[[material]]
model = "pmb"
youngs = 1
[[prescribed]]
velocity = ["0", "16.5*min(t/1e-6,1)", "free"]
[run]
steps = 5
"""
    path = tmp_path / "case.toml"
    for old, new, words in (
        (
            "min(",
            "mni(",
            r"case.toml:11: \[prescribed\] velocity: .*character 6: unknown function 'mni': did you mean 'min'",
        ),
        ('"free"', '"fre"', r"case.toml:11: .*unknown 'fre': did you mean 'free'"),
        ('"0"', '"1/t"', r'case.toml:11: \[prescribed\] velocity: "1/t" is inf at t = 0'),
        ('"0"', '"sqrt(x - 5)"', r'case.toml:11: \[prescribed\] velocity: "sqrt\(x - 5\)" is nan at x = 0'),
        ('"0"', '"sqrt(1 - t)"', r'case.toml:11: \[prescribed\] velocity: "sqrt\(1 - t\)" is nan at t = '),
        ('"0"', "{ times = [0, 1], values = [1] }", "one value for each"),
        ('"0"', "true", "expected three of numbers, formulas"),
        ("[[prescribed]]", "[[initial]]", r"case.toml:11: \[initial\] velocity: .*unknown 't'"),
        ("[[prescribed]]\nvelocity", "[[body_force]]\ntotal", r"case.toml:11: .*unknown 'free'|case.toml:11: .*free"),
        ("[[prescribed]]\nvelocity", "[[body_force]]\ndensity", r"case.toml:11: .*free"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(AtcError, match=words):
            Case.load(path).simulation(1).step(5)
    path.write_text(text)
    assert Case.load(path).to_toml().count('"16.5*min(t/1e-6,1)"') == 1


def test_a_restart_goes_on_with_the_same_history(tmp_path):
    """Bitwise, with formulas of time and place, and a table."""
    case = plate(**DRIVES["both"], run={"steps": 60}, output={"every": 20, "restart": str(tmp_path / "end.npz")})
    half = {**case, "run": {"steps": 20}}
    whole = Case.load(case).run(tmp_path / "whole.nc", threads=1)
    Case.load(half).run(tmp_path / "half.nc", threads=1)
    rest = {**case, "run": {"steps": 40, "restart": str(tmp_path / "end.npz")}}
    ds = Case.load(rest).run(tmp_path / "rest.nc", threads=1)
    for name in ("displacement", "velocity", "force", "energy_total", "energy_work_external", "energy_work_constraint"):
        assert np.array_equal(ds[name][-1], whole[name][-1]), name
