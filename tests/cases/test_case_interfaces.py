"""Several materials in one case, and what holds them together: against springs in series, the impedance formula and
fracture energies."""

import copy
from pathlib import Path

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError

INF = float("inf")
RIGHT = {"shape": "box", "lo": [20.0, -INF, -INF], "hi": [INF, INF, INF]}


def bar(dimension=1, model="pmb", horizon=3.015, length=39.0, width=0.0, **sections):
    """Two materials that meet in the middle of a bar: steel is three times as stiff as glass."""
    stiff = {"poisson": 0.25} if model != "pmb" else {}
    case = {
        "body": {
            "region": {"shape": "box", "lo": [0.0, 0, 0], "hi": [length, width, 0]},
            "spacing": 1.0,
            "horizon": horizon,
            "density": 1.0,
            "dimension": dimension,
            "thickness": 1.0,
        },
        "material": [
            {"name": "glass", "model": model, "youngs": 1.0, **stiff},
            {"name": "steel", "model": model, "youngs": 3.0, "region": RIGHT, **stiff},
        ],
        "run": {"steps": 1},
    }
    return copy.deepcopy({**case, **sections})


def crossing(sim):
    body, t = sim.body, sim.body.bonds
    return body.material_n[t.i_b] != body.material_n[t.j_b]


# --- stiffness


@pytest.mark.parametrize("factor", [None, 0.1, 4.0])
@pytest.mark.parametrize("model", ["pmb", "lps"])
def test_nearest_neighbours_are_springs_in_series(tmp_path, model, factor):
    """19 springs of one, one across, 19 of three times that: the pull at the end, to the solver's tolerance.

    λ = μ in one dimension, so that LPS's dilatation has no force, and each end adds half of a bond's spring.
    """
    pulled = {
        "region": {"shape": "box", "lo": [38.5, -1, -1], "hi": [40, 1, 1]},
        "displacement": [0.01, "free", "free"],
    }
    held = {"region": {"shape": "box", "lo": [-1, -1, -1], "hi": [0.5, 1, 1]}, "displacement": [0.0, "free", "free"]}
    more = {} if factor is None else {"interface": {"between": ["steel", "glass"], "stiffness": factor}}
    case = bar(
        model=model,
        horizon=1.2,
        prescribed=[held, pulled],
        run={"steps": 1, "solver": "relax", "tolerance": 1e-9},
        **more,
    )
    case["material"] = [{**m, "volume_correction": False} for m in case["material"]]
    ds = Case.load(case).run(tmp_path / "out.nc", threads=1)
    sim = Case.load(case).simulation(1)
    # one material's spring: from a bond within the softer side
    u = np.zeros((40, 3))
    u[5:, 0] = 1e-6
    soft = pd.Simulation(sim.body, sim.materials, displacements=u, threads=1).forces()[4, 0] / 1e-6
    across = (1.5 if model == "pmb" else 2.0) * (factor or 1.0)  # 2·1·3/(1 + 3); half of each side
    series = soft / (19 + 1 / across + 19 / 3)
    # a node at the end of an LPS bar has half the neighbours, and its bond the other half of its own weight
    if model == "lps":
        series = soft / (18 + 1 / 1.5 + 1 / across + 18 / 3 + 1 / 4.5)
    assert float(ds.force[-1, 0, 0]) == pytest.approx(series * 0.01, rel=2e-6)


def test_long_bar_has_the_series_modulus(tmp_path):
    """Effective modulus 2 E1 E2/(E1 + E2): 1.5, from the pull of the ends and the strains of the halves, with a horizon
    of three spacings."""
    ends = [
        {"region": {"shape": "box", "lo": [-1, -1, -1], "hi": [2.5, 1, 1]}, "displacement": [0.0, "free", "free"]},
        {"region": {"shape": "box", "lo": [196.5, -1, -1], "hi": [200, 1, 1]}, "displacement": [1e-3, "free", "free"]},
    ]
    case = bar(length=199.0, prescribed=ends, run={"steps": 1, "solver": "static"})
    case["material"][1]["region"]["lo"][0] = 99.5
    ds = Case.load(case).run(tmp_path / "out.nc", threads=1)
    x, u = ds.position_x.values, ds.displacement[-1, :, 0].values
    left, right = (np.polyfit(x[p], u[p], 1)[0] for p in ((x > 20) & (x < 80), (x > 120) & (x < 180)))
    pull = abs(float(ds.force[-1].values[x < 2.6, 0].sum()))
    # each half by itself (in one dimension ν makes the lattice exact), and both together over the 194 that are free
    assert pull / left == pytest.approx(1.0, rel=1e-3) and pull / right == pytest.approx(3.0, rel=1e-3)
    assert left / right == pytest.approx(3.0, rel=1e-6)
    assert pull * 194.0 / 1e-3 == pytest.approx(1.5, rel=0.01)


@pytest.mark.parametrize("density", [1.0, 12.0])
def test_a_wave_is_reflected_by_the_change_of_impedance(density):
    """A pulse of stress that meets the interface: (Z2 − Z1)/(Z2 + Z1) of its stress comes back, 2 Z2/(Z2 + Z1) goes on,
    Z = √(E ρ)."""
    case = bar(length=1199.0, run={"steps": 1, "safety": 0.5}, output={"every": 1})
    case["material"][1].update(density=density, region={**RIGHT, "lo": [600.0, -INF, -INF]})
    width, start = 40.0, 350.0
    # (1 − s²)³ has three continuous derivatives: wide against the horizon of three spacings
    s = f"min(abs((x - {start})/{width}), 1)"
    case["initial"] = [{"displacement": [f"-1e-4*(1 - {s}**2)**3", 0, 0]}]
    sim = Case.load(case).simulation(1)
    x = sim.body.X_nc[:, 0]
    # At the speed that the lattice gives to this material, so that nothing runs to the left.
    u = sim.state.u_nc[:, 0].copy()
    stiff = -(sim.forces()[:, 0] @ u) / (np.gradient(u) @ np.gradient(u))
    c = np.sqrt(stiff)
    sim.state.v_nc[:, 0] = -c * np.gradient(u)
    before = x < 600
    sim.step(round((600 - start + 130) / c / sim.dt))
    velocity, back, on = sim.state.v_nc[:, 0], before & (x > 300), ~before
    Z1, Z2 = 1.0, np.sqrt(3.0 * density)
    peak = 1e-4 * np.abs(np.gradient((1 - np.minimum(np.abs((x - start) / width), 1) ** 2) ** 3)).max() * c
    # particle velocity v = ∓σ/Z: reflected stress R gives −R of the velocity
    R, T = (Z2 - Z1) / (Z2 + Z1), 2 * Z2 / (Z2 + Z1)
    assert np.abs(velocity[back]).max() / peak == pytest.approx(abs(R), rel=0.03)
    assert np.abs(velocity[on]).max() / peak == pytest.approx(T * Z1 / Z2, rel=0.03)
    # a displacement pulse comes back upside down from a higher impedance: here as −R of what it was
    moved = sim.state.u_nc[back, 0].sum() / u.sum()
    assert moved == pytest.approx(-R, abs=0.03)


@pytest.mark.parametrize("stiffness", [0.25, 3.0])
def test_two_materials_and_their_interface(stiffness):
    """LAMMPS is told the micromodulus of the bonds across; here it follows from an [[interface]]. Fracture with one
    critical stretch: LAMMPS keeps s0 by node, the largest of its bonds' kinds, so that a weak interface beside strong
    bonds would not be weak there."""
    from pd_lammps import run_peri

    DX, C, RHO, DT = 0.0005, 1.6863e22, 2200.0, 1e-7
    stiff = 3 * C
    case = {
        "body": {
            "region": {"shape": "box", "lo": [0, 0, 0], "hi": [0.00755, 0.00305, 0.00305]},
            "spacing": DX,
            "horizon": 0.0015001,
            "density": RHO,
        },
        "material": [
            {"name": "soft", "model": "pmb", "c": C},
            {
                "name": "stiff",
                "model": "pmb",
                "c": stiff,
                "region": {"shape": "box", "lo": [0.004, -1, -1], "hi": [1, 1, 1]},
            },
        ],
        "interface": {"between": ["soft", "stiff"], "stiffness": stiffness},
        "damage": {"s00": 0.0005, "alpha": 0.25},
        "contact": {"strength": 15},
        "initial": {"velocity": ["30*sin(x/0.004)", "30*sin(y/0.004)", 0]},
        "run": {"steps": 200, "dt": 0.5 * DT},
    }
    sim = Case.load(case).simulation(1)
    # contact is that of the materials in series, whatever the interface: LAMMPS takes 15 times the bonds' own
    sim.contact.c_k = sim.contact.c_k * np.array([1.0, stiffness, 1.0, 1.0])
    across = stiffness * 2 * C * stiff / (C + stiff)
    lines = [f"{k} {c} 0.0015001 0.0005 0.25" for k, c in (("1 1", C), ("1 2", across), ("2 2", stiff))]
    steps = [20, 100, 200]
    ref = run_peri(sim.body, ("peri/pmb", "\n".join(lines)), steps, dt=0.5 * DT, velocities=sim.state.v_nc.copy())
    for r, k in zip(ref, steps, strict=True):
        sim.step(k - sim.state.step)
        assert np.abs(sim.positions_nc - r["x"]).max() / DX < 1e-12, k
        assert np.abs(sim.damage() - r["damage"]).max() < 1e-12, k
    assert sim.n_broken > 50


# --- strength


def pulled_apart(**sections):
    """A plate whose ends run apart."""
    ends = [
        {"region": {"shape": "box", "lo": [-INF] * 3, "hi": [2.5, INF, INF]}, "velocity": [-0.002, 0, 0]},
        {"region": {"shape": "box", "lo": [36.5, -INF, -INF], "hi": [INF] * 3}, "velocity": [0.002, 0, 0]},
    ]
    case = bar(dimension=2, width=9.0, **{"prescribed": ends, "run": {"steps": 300}, **sections})
    # from rest a uniform stretching, so that no wave decides where it breaks
    case["initial"] = [{"velocity": ["0.002*(2*x/39 - 1)", 0, 0]}]
    return case


@pytest.mark.parametrize("model", ["pmb", "lps", "correspondence", "bond-associated"])
def test_a_weak_interface_breaks_first_and_only_there(model):
    case = pulled_apart(damage={"s00": 0.1}, interface={"between": ["glass", "steel"], "s00": 0.01}, model=model)
    sim = Case.load(case).simulation(1)
    sim.step(300)
    broken, across = sim.state.intact_b == 0, crossing(sim)
    assert broken.any() and not (broken & ~across).any()
    assert (broken & across).sum() > 0.9 * across.sum()
    # without the weak interface the softer half stretches more, and nothing breaks so early
    del case["interface"]
    other = Case.load(case).simulation(1)
    other.step(sim.state.step)
    assert other.n_broken == 0


def test_an_interface_without_bonds_parts_and_still_pushes():
    case = pulled_apart(interface={"between": ["glass", "steel"], "bonded": False}, contact={}, run={"steps": 100})
    sim = Case.load(case).simulation(1)
    assert not crossing(sim).any() and sim.n_broken == 0
    whole = Case.load({k: v for k, v in case.items() if k != "interface"}).simulation(1)
    assert len(whole.body.bonds) - len(sim.body.bonds) == crossing(whole).sum() > 0
    # pulled: nothing holds; pressed: contact, with the strength of the materials
    right = sim.body.material_n == 2
    u = np.where(right[:, None], [0.3, 0, 0], 0.0)
    free = {k: v for k, v in case.items() if k not in ("prescribed", "initial")}
    for push, sign in ((0.3, 0), (-0.3, -1)):
        u = np.where(right[:, None], [push, 0, 0], 0.0)
        again = Case.load(free).simulation(1, state=None)
        again._z[:, :3] = u
        again._all_forces(False)
        assert np.sign(again.forces()[~right, 0].sum()) == sign


def test_fracture_energy_of_an_interface():
    """Gc across is the energy of all bonds across at their critical stretch, per area: half of what each side would
    take, times the stiffness."""
    for model in ("pmb", "lps"):
        case = bar(dimension=2, width=60.0, model=model, horizon=6.015, length=39.0, damage={"Gc": 2.0},
                   interface={"between": [1, 2], "Gc": 0.5, "stiffness": 0.25})  # fmt: skip
        case["material"] = [{**m, "volume_correction": False} for m in case["material"]]
        sim = Case.load(case).simulation(1)
        rule, kinds = sim.model.rule, sim.model.kinds
        s0 = rule.s00[kinds[1, 2]]
        one = pd.CriticalStretch.from_energy(2.0, sim.materials[1], sim.body).s00
        three = pd.CriticalStretch.from_energy(2.0, sim.materials[2], sim.body).s00
        assert rule.s00[kinds[1, 1]] == one and rule.s00[kinds[2, 2]] == pytest.approx(three)
        # bonds across, away from the ends of the interface: each costs ½ w s0² |ξ| (PMB) or ½ w s0² |ξ|² (LPS)
        t = sim.body.bonds
        y = 0.5 * (sim.body.X_nc[t.i_b, 1] + sim.body.X_nc[t.j_b, 1])
        inner = crossing(sim) & (y > 10) & (y < 50)
        per_bond = 0.5 * sim.model.W_b * t.r0_b if model == "pmb" else 0.5 * sim.model.WB_b * t.r0_b**2
        energy = per_bond[inner].sum() * s0**2 / 40.0
        # the lattice as a quadrature of a horizon of six spacings
        assert energy == pytest.approx(0.5, rel=0.03), model


def test_strength_of_each_material():
    case = bar(damage={"s00": 0.01, "alpha": 0.25, "no_fail": {"shape": "box", "lo": [-1, -1, -1], "hi": [3.5, 1, 1]}})
    case["material"][1].update(s00=0.02)
    sim = Case.load(case).simulation(1)
    rule, kinds = sim.model.rule, sim.model.kinds
    # own strength, the general alpha; across, the weaker one
    assert [rule.s00[kinds[p]] for p in ((1, 1), (2, 2), (1, 2))] == [0.01, 0.02, 0.01] and set(
        rule.alpha[list(kinds.values())]
    ) == {0.25}
    safe = sim.state.intact_b == 2
    assert (safe == (sim.body.bonds.i_b <= 3)).all()
    case["material"][1] = {**case["material"][1], "breaks": False}
    del case["material"][1]["s00"]
    sim = Case.load(case).simulation(1)
    assert [sim.model.rule.s00[sim.model.kinds[p]] for p in ((1, 1), (2, 2), (1, 2))] == [0.01, INF, 0.01]
    case["interface"] = {"between": ["glass", "steel"], "breaks": False}
    sim = Case.load(case).simulation(1)
    assert sim.model.rule.s00[sim.model.kinds[1, 2]] == INF
    # only materials say when they break
    case = bar()
    case["material"][0].update(Gc=1.0, alpha=0.5)
    sim = Case.load(case).simulation(1)
    want = pd.CriticalStretch.from_energy(1.0, sim.materials[1], sim.body).s00
    assert sim.model.rule.s00[sim.model.kinds[1, 1]] == want and sim.model.rule.s00[sim.model.kinds[2, 2]] == INF


def test_more_than_sixteen_materials():
    """Kinds of bonds are pairs of materials: 20 × 20 of them are more than a byte holds."""
    n = 20
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), (n - 0.9, 0, 0)), 1.0, 1.2, 1.0, dimension=1, thickness=1.0, materials=np.arange(n)
    )
    sim = pd.Simulation(
        body,
        {k: pd.PMB(youngs=1.0 + k, volume_correction=False) for k in range(n)},
        damage={k: pd.CriticalStretch(1e-3 * (k + 1)) for k in range(n)},
    )
    c = np.array([pd.PMB(youngs=1.0 + k).micromodulus(body) for k in range(n)])
    np.testing.assert_allclose(sim.model.W_b, 2 * c[1:] * c[:-1] / (c[1:] + c[:-1]), rtol=1e-14)
    assert sim.model.rule.s00[sim.model.kind_b].tolist() == [1e-3 * (k + 1) for k in range(n - 1)]


def test_the_example_of_the_documentation_peels(tmp_path):
    """The strip comes off from its pulled end on; nothing else breaks, and the ledger closes."""
    text = (Path(__file__).resolve().parents[2] / "docs" / "case.md").read_text().split("```toml\n")[1].split("```")[0]
    (tmp_path / "laminate.toml").write_text(text)
    sim = Case.load(tmp_path / "laminate.toml").simulation(1)
    t, across, start = sim.body.bonds, crossing(sim), sim.energies().total
    x = sim.body.X_nc[t.i_b, 0]
    fronts = []
    for _ in range(3):
        sim.step(80)
        broken = sim.state.intact_b == 0
        assert not (broken & ~across).any()
        fronts.append(x[broken].max(initial=0.0))
        assert x[broken].max() < x[across & ~broken].mean()
    assert 0 < fronts[0] < fronts[1] < fronts[2] < 0.03
    e = sim.energies()
    assert abs(e.total - start) < 0.01 * e.work_constraint and e.dissipated_fracture > 0


def test_check_says_what_holds_what_together():
    from atc.cli.pd import describe

    case = bar(damage={"s00": 0.01, "alpha": 0.25}, interface={"between": [2, "glass"], "s00": 1e-3, "stiffness": 0.5})
    case["material"][1]["breaks"] = False
    lines = describe(Case.load(case)).splitlines()
    assert lines[1:4] == [
        "material 1 glass: pmb, 20 nodes, 54 bonds that break at a stretch of 0.01, alpha 0.25",
        "material 2 steel: pmb, 20 nodes, 54 bonds that never break",
        "between 1 and 2: 6 bonds, 0.5 times as stiff as by default, that break at a stretch of 0.001, alpha 0.25",
    ]
    case["interface"] = {"between": [2, "glass"], "bonded": False}
    assert describe(Case.load(case)).splitlines()[3] == "between 1 and 2: no bonds"


# --- mistakes


@pytest.mark.parametrize(
    "interface, words",
    [
        (
            {"between": ["glas", "steel"], "s00": 1.0},
            "there is no material 'glas': did you mean 'glass'.*known: 'glass', 'steel', 1, 2",
        ),
        ({"between": ["glass", 1], "s00": 1.0}, "names of one material"),
        ({"between": ["glass"], "s00": 1.0}, "expected two materials by name or id"),
        ({"between": ["glass", "glass"], "s00": 1.0}, "two different materials"),
        ({"between": ["glass", "steel"]}, "says nothing"),
        ({"s00": 1.0}, "needs between"),
        ({"between": ["glass", "steel"], "bonded": False, "s00": 1.0}, "s00: bonded = false"),
        ({"between": ["glass", "steel"], "s00": 1.0, "Gc": 1.0}, "exactly one of s00 and Gc"),
        ({"between": ["glass", "steel"], "breaks": False}, "nothing in this case breaks"),
        ({"between": ["glass", "steel"], "stiffness": 0.0}, "greater than 0"),
        ({"between": ["glass", "steel"], "stiffnes": 1.0}, "did you mean 'stiffness'"),
        (
            [{"between": ["glass", "steel"], "s00": 1.0}, {"between": [2, 1], "s00": 1.0}],
            "have an interface already, number 1",
        ),
    ],
)
def test_mistakes(interface, words):
    with pytest.raises(AtcError, match=words):
        Case.load(bar(interface=interface))


def test_mistakes_that_only_the_body_shows():
    for model in ("correspondence", "bond-associated"):
        with pytest.raises(AtcError, match="stiffness: bonds of correspondence materials"):
            Case.load(bar(model=model, interface={"between": [1, 2], "stiffness": 0.5})).simulation(1)
    case = bar()
    case["material"][1].update(model="lps", poisson=0.25)
    with pytest.raises(AtcError, match=r"\[material\] lps beside pmb: .*one model"):
        Case.load(case).simulation(1)
    case = bar()
    case["material"][1].update(influence="linear")
    with pytest.raises(AtcError, match="influence is not that of the first"):
        Case.load(case).simulation(1)
    case = bar(damage={"s00": 1.0}, run={"steps": 1, "solver": "static"})
    with pytest.raises(AtcError, match="breaks no bonds"):
        Case.load(case)
    case = bar(run={"steps": 1, "solver": "static"})
    case["material"][0]["s00"] = 1.0
    with pytest.raises(AtcError, match="breaks no bonds"):
        Case.load(case)
    with pytest.raises(AtcError, match="no material 9"):
        pd.Simulation(pd.Body(np.eye(3), 1.0, 1.0, 2.0), pd.PMB(1.0), interfaces={(1, 9): 2.0})
    with pytest.raises(AtcError, match="factor greater than 0"):
        pd.Simulation(
            pd.Body(np.eye(3), 1.0, 1.0, 2.0, materials=[1, 1, 2]),
            {1: pd.PMB(1.0), 2: pd.PMB(2.0)},
            interfaces={(1, 2): 0.0},
        )
