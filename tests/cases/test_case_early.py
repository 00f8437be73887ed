"""What would be found late, or never, is found before a run begins."""

import numpy as np
import pytest
from test_case import PLATE, write

from atc.cases.case import Case
from atc.errors import AtcError


@pytest.mark.parametrize(
    "before, after, words",
    [
        ("end = [0.012, 0.0061]", "end = [-0.012, 0.0061]", r"plate.toml:18: \[notch\] crosses no bond"),
        ("end = [0.012, 0.0061]", "end = [-0.001, 0.0061]", r"plate.toml:18: \[notch\] a notch needs a length"),
        ("dimension = 2", "plane = 'strain'", r"plate.toml:6: \[body\] plane: belongs to a body of dimension 2"),
        ("dimension = 2", "thickness = 1", r"plate.toml:6: \[body\] thickness: belongs to a body of dimension 2"),
        (
            "dimension = 2",
            "dimension = 1\nplane = 'strain'",
            r"plate.toml:7: \[body\] plane: belongs to a body of dimension 2",
        ),
        ('model = "pmb"', 'model = "PMB"', "did you mean 'pmb'"),
        (
            "youngs = 72e9",
            "youngs = 72e9\npoisson = 0.3",
            r"plate.toml:12: unknown key 'poisson' in \[material\]: bonds of pmb fix Poisson's ratio at 1/4",
        ),
        (
            "every = 25",
            'extxyz = "end.pvd"',
            r"plate.toml:56: \[output\] extxyz: expected a name that ends in .extxyz or .xyz",
        ),
        (
            "every = 25",
            'restart = "nowhere/end.npz"',
            r"plate.toml:56: \[output\] restart: there is no directory .*nowhere",
        ),
        ("damping = 10.0", "iterations = 3", r"plate.toml:53: \[run\] iterations: belongs to solver"),
    ],
)
def test_what_would_be_found_late_is_found_early(tmp_path, before, after, words):
    with pytest.raises(AtcError, match=words):
        case = Case.load(write(tmp_path, PLATE.replace(before, after, 1)))
        case.simulation(1)
        case.run(tmp_path / "out.nc")
    assert not list(tmp_path.glob("out*"))


def test_a_body_that_nothing_holds_together():
    case = {
        "body": {
            "region": {"shape": "box", "lo": [0, 0, 0], "hi": [4.0, 4.0, 4.0]},
            "spacing": 1.0,
            "horizon": 0.5,
            "density": 1.0,
        },
        "material": {"model": "lps", "youngs": 1.0, "poisson": 0.25},
        "run": {"steps": 3, "dt": 0.1},
    }
    with pytest.raises(
        AtcError, match=r"\[body\] horizon: no node has another one within 0.5.*three spacings \(of 1\)"
    ):
        Case.load(case).simulation(1)
    # grains: contact is all there is
    with pytest.warns(UserWarning, match="nothing holds it together"):
        sim = Case.load({**case, "contact": {}}).simulation(1)
    sim.step(3)
    assert np.isfinite(sim.positions_nc).all() and not len(sim.body.bonds)
