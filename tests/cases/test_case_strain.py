"""A periodic body whose cell is strained, from a case file: the same as through the engine."""

import tomllib

import numpy as np
import pytest

from atc import pd
from atc.cases.case import Case
from atc.errors import AtcError
from atc.frame import Cell

H = [[0.02, 0.01, 0.0], [0.0, -0.01, 0.0], [0.0, 0.0, 0.03]]
CASE = {
    "body": {
        "region": {"shape": "box", "lo": [0, 0, 0], "hi": [6, 6, 6]}, "spacing": 1.0, "horizon": 2.015, "density": 1.0,
        "cell": [6, 6, 6], "origin": [0, 0, 0], "periodic": [True, True, True], "strain": H,
    },
    "material": [{"model": "lps", "bulk": 1.0, "shear": 0.6}],
    "run": {"steps": 1, "solver": "static"},
    "output": {"quantities": ["displacement", "stress"], "every": 1},
}  # fmt: skip


def changed(**body):
    return {**CASE, "body": {k: v for k, v in {**CASE["body"], **body}.items() if v is not None}}


def test_the_case_is_the_engines_strained_body():
    case = Case.load(CASE)
    sim = case.simulation(1)
    body = sim.body
    twin = pd.Simulation(body, pd.LPS(1.0, 0.6), strain=H, threads=1)
    np.testing.assert_array_equal(sim.state.u_nc, twin.state.u_nc)
    np.testing.assert_array_equal(sim.cell.vectors, Cell([6.0, 6, 6]).vectors @ (np.eye(3) + H).T)
    assert sim.energies().strain == twin.energies().strain > 0
    # written out and read again it is the same case
    assert Case.load(tomllib.loads(case.to_toml())).data["body"]["strain"] == H


def test_it_runs_and_the_uniform_state_is_in_equilibrium(tmp_path):
    ds = Case.load(CASE).run(tmp_path / "out.nc")
    np.testing.assert_allclose(ds.energy_strain[-1], ds.energy_strain[0], rtol=1e-12)
    assert float(ds.energy_strain[0]) > 0


@pytest.mark.parametrize(
    "body, words",
    [
        ({"periodic": [False, False, False]}, "strain: belongs to a periodic body"),
        ({"strain": [[1, 2], [3, 4]]}, "strain: expected the displacement gradient"),
        ({"strain": [[-2.0, 0, 0], [0, 0, 0], [0, 0, 0]]}, r"inside out: det\(1 \+ strain\) = -1"),
    ],
)
def test_what_makes_no_sense_is_refused(body, words):
    with pytest.raises(AtcError, match=words):
        Case.load(changed(**body))
