"""Bonds that break by the work done on them: a straight cut against Gc, restarts, cases."""

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell
from atc.pd.materials.influence import critical_work

K, G, GC = 1.3, 0.8, 0.05
MATERIALS = {
    "lps": pd.LPS(K, G),
    "one": pd.LPS(K, G, influence="one"),
    "viscoelastic": pd.Viscoelastic(K, G, fraction=0.5, time=2.0),
    "plastic": pd.Plastic(K, G, yield_stress=0.05),
}


def torn(material, damage, *, dt=0.05, steps=1300, state=None):
    """Two rigid halves of a body, periodic across, that part along x at 0.01; and their bonds across."""
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (5.1, 2.1, 2.1)), 1.0, 2.515, 1.0, warn=False,
        cell=Cell([30.0, 3, 3], periodic=[False, True, True]),
    )  # fmt: skip
    right = body.X_nc[:, 0] > 2.5
    moves = [pd.Prescribed(right, velocity=(0.01, 0, 0)), pd.Prescribed(~right, velocity=(0, 0, 0))]
    sim = pd.Simulation(body, material, damage=damage, conditions=moves, dt=dt, threads=1, state=state)
    sim.step(steps)
    return sim, right[body.bonds.i_b] != right[body.bonds.j_b]


@pytest.mark.parametrize("name", MATERIALS)
def test_a_straight_cut_costs_its_bonds_critical_energy(name):
    """Whatever the law and however the work is shared between stored and taken: Gc times the area."""
    sim, across = torn(MATERIALS[name], pd.CriticalEnergy(GC))
    assert np.array_equal(sim.state.intact_b == 0, across)
    # A bond is found out at the end of a step, in which its work grows by up to 0.5 %.
    assert 0 < sim.energies().work_constraint / (GC * 9) - 1 < 5e-3


@pytest.mark.parametrize(("dimension", "ratio"), [(1, 2.015), (2, 2.515), (2, 3.015), (3, 2.515), (3, 3.015)])
@pytest.mark.parametrize("correction", [True, False])
def test_planes_of_a_lattice_cost_gc(dimension, ratio, correction):
    """Bonds across a plane, counted: Gc per area between planes of the lattice that fewest bonds cross, more across
    others; without a lattice the integral, which the sum misses by as much as the sum of a clean plane does."""
    n = 12 if dimension < 3 else 9
    hi = np.where(np.arange(3) < dimension, n - 0.9, 0.0)
    more = {} if dimension == 3 else {"thickness": 0.3}
    body = pd.Body.lattice(pd.Box((0, 0, 0), hi), 1.0, ratio, 1.0, dimension=dimension, warn=False, **more)
    material = pd.LPS(K, G, volume_correction=correction)
    worth_b = pd.Simulation(body, material, damage=pd.CriticalEnergy(GC), threads=1).model.worth_b
    t, X = body.bonds, body.X_nc
    xi = t.xi_bc(X)
    # Of one node in the middle: its bonds, with half the share of |ξ·n| each, are what a plane of its area crosses.
    middle = int(np.argmin(np.abs(X[:, :dimension] - n // 2).sum(axis=1)))
    mine = (t.i_b == middle) | (t.j_b == middle)

    def cost(normal):
        n_c = np.array(normal, float)[:3] / np.linalg.norm(normal)
        return 0.5 * (worth_b * np.abs(xi @ n_c))[mine].sum() / body.V_n[middle]

    assert mine.sum() == {1: 4, 2: 20 if ratio < 3 else 28, 3: 80 if ratio < 3 else 122}[dimension]
    turns = np.linspace(0, np.pi, 721)
    circle = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1)
    normals = {1: circle[:1], 2: circle}.get(dimension)
    if normals is None:
        z = np.random.default_rng(0).normal(size=(4000, 3))
        special = [(1, 0, 0), (1, 1, 0), (1, 1, 1), (2, 1, 0), (2, 1, 1), (2, 2, 1)]
        normals = np.concatenate([special, z])
    costs = np.array([cost(v) for v in normals])
    assert costs.min() == pytest.approx(GC, rel=1e-9) and costs.max() < 1.2 * GC


def test_clouds_have_the_integral():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 4.1, 4.1)), 1.0, 2.515, 1.0, warn=False, jitter=0.05)
    worth_b = pd.Simulation(body, pd.LPS(K, G), damage=pd.CriticalEnergy(GC), threads=1).model.worth_b
    assert worth_b == pytest.approx(4 * GC / (np.pi * 2.515**4) * body.nu_b(), rel=1e-9)


def test_the_continuum_and_plates():
    """w_c of clouds, and that the sum of a lattice comes to the integral: within 2 % at twelve nodes to a horizon."""
    for more, wanted in (({}, 12 / np.pi / 2.5**4), ({"dimension": 2, "thickness": 0.1}, 9 / (2 * 0.1 * 2.5**3))):
        X = np.stack(np.meshgrid(*[np.arange(4.0)] * 2, [0.0]), -1).reshape(-1, 3)
        cloud = pd.Body(X, 1.0, 1.0, 2.5, warn=False, **more)
        assert critical_work(3.0, cloud) == pytest.approx(wanted, rel=1e-12)
    fine = pd.Body.lattice(pd.Box((0, 0, 0), (0.1, 0.1, 0.1)), 1 / 12, 1.0, 1.0, warn=False)
    assert critical_work(3.0, fine, volume_correction=False) == pytest.approx(12 / np.pi, rel=0.02)


def test_compressed_bonds_stay_and_halves_of_a_run_are_the_whole():
    squeezed = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 4.1, 4.1)), 1.0, 2.015, 1.0, cell=Cell([5.0] * 3), warn=False)
    for sign, broken in ((-1, 0), (1, len(squeezed.bonds))):
        sim = pd.Simulation(squeezed, pd.LPS(K, G), strain=sign * 0.3 * np.eye(3), threads=1,
                            damage=pd.CriticalEnergy(0.05))  # fmt: skip
        sim.step()
        assert sim.n_broken == broken
    material, damage = MATERIALS["plastic"], pd.CriticalEnergy(GC)
    whole, _ = torn(material, damage, steps=900)
    first, _ = torn(material, damage, steps=600)
    again, _ = torn(material, damage, steps=300, state=pd.State.from_arrays(first.state.to_arrays()))
    assert 0 < first.n_broken < whole.n_broken
    a, b = whole.state.to_arrays(), again.state.to_arrays()
    assert {"history.work_b", "history.pull_b", "history.reach_b"} <= set(a)
    for k in a:
        assert np.array_equal(a[k], b[k]), k


def test_bonds_of_several_materials_and_bodies_that_part_a_broken_table():
    """Bonds drawn together on the way, and each kind with its own energy, an interface the weaker side's."""
    body = pd.Body.lattice(pd.Box((0, 0, 0), (9.1, 4.1, 0)), 1.0, 3.015, 1.0, dimension=2, warn=False)
    body.material_n = np.where(body.X_nc[:, 0] > 4.5, 2, 1).astype(np.int32)
    v = np.where(body.X_nc[:, :1] > 4.5, 0.3, -0.3) * [1.0, 0, 0]
    runs = []
    for rules in (pd.CriticalEnergy(0.02), {1: pd.CriticalEnergy(0.02), 2: pd.CriticalEnergy(50.0)}):
        sim = pd.Simulation(body, {1: pd.LPS(K, G), 2: pd.LPS(K, G)}, velocities=v, damage=rules, threads=1)
        sim.step(80)
        runs.append(sim)
    t = body.bonds
    strong = (body.material_n[t.i_b] == 2) & (body.material_n[t.j_b] == 2)
    assert runs[0].n_broken > 0.15 * len(t) and (runs[0].state.intact_b[strong] == 0).any()
    assert runs[1].n_broken > 0 and (runs[1].state.intact_b[strong] == 1).all()
    H = runs[1].state.history
    assert (H["work_b"][runs[1].state.intact_b == 0] > runs[1].model.worth_b[runs[1].state.intact_b == 0]).all()


def test_what_is_refused_and_cases():
    body = pd.Body.lattice(pd.Box((0, 0, 0), (4.1, 3.1, 3.1)), 1.0, 2.5, 1.0, warn=False)
    body.material_n = np.where(body.X_nc[:, 0] > 2.5, 2, 1).astype(np.int32)
    with pytest.raises(AtcError, match="Gc must be positive, got nan"):
        pd.CriticalEnergy(np.nan)
    with pytest.raises(AtcError, match="damage: pmb breaks by a critical stretch"):
        pd.Simulation(body, pd.PMB(1.0), damage=pd.CriticalEnergy(1.0), threads=1)
    with pytest.raises(AtcError, match="by a critical stretch or by a critical energy, not both"):
        both = {1: pd.CriticalEnergy(1.0), 2: pd.CriticalStretch(0.1)}
        pd.Simulation(body, pd.LPS(K, G), damage=both, threads=1)
    with pytest.raises(AtcError, match="at rest expanded break by a critical stretch"):
        pd.Simulation(body, pd.LPS(K, G, expansion=1e-5), damage=pd.CriticalEnergy(1.0), temperature=1.0, threads=1)
    case = {
        "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [4, 3, 3]}, "spacing": 1.0, "horizon": 2.5,
                 "density": 1.0},
        "material": [{"model": "lps", "youngs": 1.0, "poisson": 0.25}],
        "damage": {"criterion": "energy", "Gc": 0.01},
        "run": {"steps": 1},
    }  # fmt: skip
    assert Case.load(case).simulation(1).model.rule.Gc.tolist() == [0.01]
    for change, words in (
        ({"criterion": "energy", "s00": 0.01}, 's00.*criterion = "energy" takes Gc'),
        ({"criterion": "energy", "Gc": 0.01, "alpha": 0.25}, 'alpha.*criterion = "energy" takes Gc'),
        ({"criterion": "work", "Gc": 0.01}, "criterion"),
    ):
        with pytest.raises(AtcError, match=words):
            Case.load({**case, "damage": change}).simulation(1)
    with pytest.raises(AtcError, match="pmb breaks by a critical stretch"):
        Case.load({**case, "material": [{"model": "pmb", "youngs": 1.0}]}).simulation(1)
