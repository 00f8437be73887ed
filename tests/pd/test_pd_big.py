"""Large bodies: sums over bonds in parts, and (opt-in) the peak memory of one million nodes through `atc pd`."""

import subprocess
import sys

import numpy as np
import pytest

from atc import pd
from atc.cases.run import nodal_stress

SCRIPT = """
import resource, sys
from atc.cases.case import Case
n = 100
case = Case.load({
    "body": {"region": {"shape": "box", "lo": [0, 0, 0], "hi": [n - 0.9] * 3}, "spacing": 1.0, "horizon": 3.01, "density": 1.0},
    "material": {"model": sys.argv[1], "youngs": 1.0, **({} if sys.argv[1] == "pmb" else {"poisson": 0.3})},
    "damage": {"s00": 0.02}, "contact": {}, "initial": {"velocity": ["1e-3*x", 0, 0]}, "run": {"steps": 2},
    "output": {"every": 1, "quantities": ["displacement", "velocity", "damage", "energy", "force", "stress"]},
})
ds = case.run(sys.argv[2], threads=2)
assert ds.sizes["node"] == n**3 and ds.attrs["bonds"] > 58_000_000
print("GB", resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6)
"""


@pytest.mark.parametrize("compat", [False, True])
@pytest.mark.parametrize("name", sorted(pd.MATERIALS))
def test_sums_in_parts_are_the_sums(monkeypatch, name, compat):
    body = pd.Body.lattice(pd.Box((0, 0, 0), (7, 6, 5)), 1.0, 3.01, 1.0, jitter=0.1, materials=1)
    u = np.random.default_rng(1).normal(size=body.X_nc.shape) * 0.02

    def values():
        sim = pd.Simulation(body, pd.MATERIALS[name](1.3, 0.5), displacements=u, lammps_compat=compat, threads=1)
        sim.state.intact_b[::7] = 0
        return np.array([sim.time_step_stable, *sim.strain_energy_n(), *nodal_stress(sim).ravel()])

    whole = values()
    sim = pd.Simulation(body, pd.MATERIALS[name](1.3, 0.5), displacements=u, lammps_compat=compat, threads=1)
    f, stress = sim.bond_forces(), np.zeros((len(body), 3, 3))
    for end in (f.i, f.j):
        np.add.at(stress, end, -0.5 * f.r_bc[:, :, None] * f.F_bc[:, None, :] / body.V_n[end][:, None, None])
    np.testing.assert_allclose(nodal_stress(sim), stress, rtol=1e-12, atol=1e-14)
    monkeypatch.setattr("atc.pd.materials.force_model.AT_ONCE", 1000)
    assert len(body.bonds) > 5000
    np.testing.assert_allclose(values(), whole, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("name", sorted(pd.MATERIALS))
def test_looking_at_a_run_does_not_change_it(name):
    body = pd.Body.lattice(pd.Box((0, 0, 0), (7, 6, 5)), 1.0, 3.01, 1.0, jitter=0.1)
    v = np.random.default_rng(2).normal(size=body.X_nc.shape) * 0.06
    a, b = (
        pd.Simulation(body, pd.MATERIALS[name](1.3, 0.5), velocities=v, damage=pd.CriticalStretch(0.03), threads=1)
        for _ in range(2)
    )
    for _ in range(4):
        a.step(2)
        b.step(2)
        nodal_stress(b), b.energies(), b.bond_forces()
    assert a.n_broken == b.n_broken > 0
    x, y = a.state.to_arrays(), b.state.to_arrays()
    for k in x:
        assert np.array_equal(x[k], y[k]), k


@pytest.mark.slow
@pytest.mark.parametrize("model", ["pmb", "lps"])
def test_a_million_nodes_take_less_than_six_gigabytes(tmp_path, model):
    out = subprocess.run(
        [sys.executable, "-c", SCRIPT, model, str(tmp_path / "out.zarr")], capture_output=True, text=True, check=True
    ).stdout
    gigabytes = float(out.split("GB")[1])
    print(f"{model}: {gigabytes:.2f} GB")
    assert gigabytes < 6.0
