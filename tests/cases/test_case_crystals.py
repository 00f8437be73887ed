"""Materials of a case that a crystal and its potential define, and how well nodes sample materials."""

import tomllib

import numpy as np
import pytest
from crystals import ARGON, MASS, crystal, elastic

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError, AtcWarning
from atc.pd.sampling import lattice_error, sampled_constants
from atc.units import units
from atc.upscaling.cauchy_born import turned

A = units("si").to_user("length", crystal("argon").lattice_constant)
C_VV = units("si").to_user("pressure", elastic("argon").C_vv)
H = [[1e-4, 3e-4, 0.0], [0.0, -2e-4, 1e-4], [0.0, 0.0, 3e-4]]
ATOMS = {"potential": ARGON, "units": "metal", "structure": "fcc", "lattice_constant": 5.3, "mass": MASS}
ORIENT = [[1, 1, 0], [-1, 1, 0], [0, 0, 1]]


def case(material, horizon=3.015, spacing=A, **body):
    L = 4 * spacing
    return {
        "body": {
            "region": {"shape": "box", "lo": [0, 0, 0], "hi": [L, L, L]}, "spacing": spacing,
            "horizon": horizon * spacing, "cell": [L, L, L], "periodic": [True] * 3, "strain": H, **body,
        },
        "material": [material],
        "run": {"steps": 1},
        "output": {"every": 1},
    }  # fmt: skip


@pytest.mark.parametrize(
    "model, horizon, more",
    [("cauchy-born", 1.8, {}), ("cauchy-born", 1.8, {"influence": "1 + x^2/r^2"}), ("linear", 3.015, {})],
)
def test_a_crystal_strained(model, horizon, more):
    """Its stress is C ε, in pascals, along turned axes too; mass as the crystal's, per cubic metre. So it is whatever
    directions its nodes listen to."""
    made = Case.load(case({"model": model, "orient": ORIENT, **ATOMS, **more}, horizon))
    sim = made.simulation(1)
    assert sim.body.rho_n == pytest.approx(4 * MASS * 1.66053906660e-27 / A**3, rel=1e-6)
    f = sim.bond_forces()
    stress = -np.einsum("bi,bj->ij", f.r_bc, f.F_bc) / sim.body.V_n.sum()
    e = 0.5 * (np.array(H) + np.transpose(H))
    e_v = np.array([e[0, 0], e[1, 1], e[2, 2], 2 * e[1, 2], 2 * e[0, 2], 2 * e[0, 1]])
    axes = np.array(ORIENT, float) / np.linalg.norm(ORIENT, axis=1)[:, None]
    s = turned(C_VV, axes.T) @ e_v
    expected = np.array([[s[0], s[5], s[4]], [s[5], s[1], s[3]], [s[4], s[3], s[2]]])
    # Beyond the linear law by the size of the strain; springs do not know of rotations.
    assert np.abs(0.5 * (stress + stress.T) - expected).max() < 6e-3 * np.abs(expected).max()
    assert Case.load(tomllib.loads(made.to_toml())).data["material"] == made.data["material"]


def test_linear_waves():
    """ω of a long longitudinal wave on the case's nodes: sqrt(C11/ρ) k within what nodes make of it."""
    body = Case.load(case({"model": "linear", **ATOMS}, strain=[[0.0] * 3] * 3)).simulation(1)
    x = body.body.X_nc
    k = 2 * np.pi / (4 * A)
    u = np.zeros_like(x)
    u[:, 0] = 1e-4 * A * np.cos(k * x[:, 0])
    sim = pd.Simulation(body.body, body.materials, displacements=u, threads=1)
    w2 = -(sim.state.F_nc[:, 0] @ u[:, 0]) / (sim.mass_n * u[:, 0] @ u[:, 0])
    assert np.sqrt(w2) / (np.sqrt(C_VV[0, 0] / body.body.rho_n[0]) * k) == pytest.approx(0.95, abs=0.05)


def test_springs_by_formulas():
    """A central spring is c ξξ/r²; as a tensor by nine formulas it is the same."""
    c = "1e3*(1 - r/delta)**2"
    rows = [[f"{c}*{a}*{b}/r^2" for b in "xyz"] for a in "xyz"]
    one, nine = (
        Case.load(case({"model": "linear", "micromodulus": m, "density": 1.0}, 4.5, 1.0))
        .simulation(1)
        .energies()
        .strain
        for m in (c, rows)
    )
    assert one == pytest.approx(nine, rel=1e-12) and one > 0
    # λ = μ = ∫ c r² dV/30 of the sphere: W = ½ λ tr² + μ e:e.
    mu = 1e3 * 4 * np.pi * 4.5**5 * (1 / 5 - 2 / 6 + 1 / 7) / 30
    e = 0.5 * (np.array(H) + np.transpose(H))
    assert one == pytest.approx(64 * (0.5 * mu * np.trace(e) ** 2 + mu * (e * e).sum()), rel=0.02)


@pytest.mark.parametrize(
    "material, body, said",
    [
        ({"model": "linear"}, {}, "linear needs potential (or micromodulus"),
        ({"model": "cauchy-born", **ATOMS, "structure": "hcp"}, {}, "structure"),
        ({"model": "linear", "micromodulus": "1", "mass": 1.0, "density": 1.0}, {}, "mass: micromodulus is given"),
        ({"model": "linear", "micromodulus": "q", "density": 1.0}, {}, "micromodulus"),
        ({"model": "linear", **ATOMS}, {"jitter": 0.1}, "for the nodes of a lattice"),
        ({"model": "linear", **ATOMS, "s00": 0.1}, {}, "do not break"),
        ({"model": "linear", "micromodulus": "1", "density": 1.0}, {"horizon": 1.1}, "% off its own"),
        ({"model": "linear", "micromodulus": [["1", "x", "0"], ["0", "1", "0"], ["0", "0", "1"]], "density": 1.0}, {},
         "must be symmetric"),
        ({"model": "linear", **ATOMS}, {"horizon": 1.1}, "horizon"),
        ({"model": "cauchy-born", **ATOMS, "orient": [[1, 1, 0], [1, 0, 0], [0, 0, 1]]}, {}, "right-handed"),
        ({"model": "cauchy-born", **{k: v for k, v in ATOMS.items() if k != "units"}}, {}, "give units"),
        ({"model": "cauchy-born", **ATOMS, "stabilisation": -1.0}, {}, "stabilisation"),
        ({"model": "lps", "bulk": 1.0, "shear": 0.6, "density": 1.0}, {"horizon": 1.5}, "15 % off"),
    ],
)  # fmt: skip
def test_refused(material, body, said):
    with pytest.raises(AtcError, match=".") as e:
        Case.load(case(material, **body)).simulation(1)
    assert said in str(e.value) and "\n" not in str(e.value)


def test_how_well_lattices_sample():
    """The usual horizon: bond-based 14 %, which the energy correction mends; correspondence exact. One node among its
    images is what a whole periodic body is."""
    body = pd.Body.lattice(pd.Box([0, 0, 0], [5, 5, 5]), 1.0, 3.015, 1.0)
    assert lattice_error(pd.PMB(bulk=1.0), body) == pytest.approx(0.146, abs=1e-3)
    assert lattice_error(pd.Correspondence(1.0, 0.6), body) < 1e-6
    with pytest.warns(AtcWarning, match="14 % off|15 % off"):
        Case.load(case({"model": "pmb", "bulk": 1.0, "density": 1.0}, spacing=1.0)).simulation(1)
    L = 8.0
    many = pd.Body.lattice(
        pd.Box([0] * 3, [7] * 3), 1.0, 3.015, 1.0, cell=pd_cell(L)
    )  # fmt: skip
    e = np.diag([1e-6, 0, 0])
    virial = [
        -np.einsum("bi,bj->ij", f.r_bc, f.F_bc) / L**3
        for s in (1, -1)
        for f in [pd.Simulation(many, pd.LPS(1.0, 0.6), strain=s * e, threads=1).bond_forces()]
    ]
    C = sampled_constants(pd.LPS(1.0, 0.6), np.eye(3), 3.015, 1.0, components=[0])
    assert (virial[0] - virial[1])[0, 0] / 2e-6 == pytest.approx(C[0, 0], rel=1e-8)


def pd_cell(L):
    from atc.frame import Cell

    return Cell([L, L, L])
