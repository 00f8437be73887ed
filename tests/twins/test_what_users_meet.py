"""Runs without velocities, pictures along a line, what a twin costs, and steps of one's own."""

import numpy as np
import pytest
from crystals import crystal, elastic
from test_twin import block, scene
from typer.testing import CliRunner

import atc
from atc.cli.root import app
from atc.errors import AtcError


def bare(path):
    """A dump without its velocities."""
    text = path.read_text().replace(" vx vy vz", "").splitlines()
    words = [line.split() for line in text]
    path.write_text("\n".join(" ".join(w[:5] if len(w) == 8 and w[0] != "ITEM:" else w) for w in words) + "\n")


def test_a_run_without_velocities(tmp_path):
    """A stretched crystal at rest: the MD's stress is that of the potential, and it is said so; a picture along a line."""
    e = 1e-3
    frames = [block(), block(strain=np.diag([e, 0, 0]))]
    given = scene(tmp_path / "run.dump", frames, material="linear", motion="static")
    given["grid"] = {"kind": "line", "start": [0.5, 3.0, 3.0], "end": [26.0, 3.0, 3.0], "n": 9}
    bare(tmp_path / "run.dump")
    found = atc.twin(given)
    assert "the frames have no velocities" in "\n".join(found.lines)
    c11 = crystal("argon").units.to_user("pressure", elastic("argon").cubic[0])
    for side in ("md", "pd"):
        stress = found.dataset[f"{side}_stress"].values[0, :, 0, 0].mean()
        assert stress == pytest.approx(c11 * e, rel=0.03)
    assert found.dataset["md_box_stress"].values[0, 0, 0] == pytest.approx(c11 * e, rel=0.02)
    assert found.picture(tmp_path / "line.png").stat().st_size > 10_000
    cost = found.cost
    assert cost["nodes"] == 125 and cost["steps"] >= 1 and cost["material"] > 0 <= cost["seconds"]


def test_steps_of_ones_own(tmp_path):
    """Half the share of the stable step, twice the steps."""
    wave = lambda X: 1e-3 * np.sin(2 * np.pi / 26.34 * X[:, :1]) * np.array([[0, 1.0, 0]])  # noqa: E731
    frames = [block(), block(u=wave), block(u=wave, time=1.0)]
    steps = []
    for safety in (0.7, 0.35):
        found = atc.twin(scene(tmp_path / "run.dump", frames, material="linear", safety=safety))
        steps.append(found.cost["steps"])
        assert found.simulation.dt <= safety * found.simulation.time_step_stable * (1 + 1e-12)
    assert steps[1] == pytest.approx(2 * steps[0], abs=1)
    with pytest.raises(AtcError, match="safety"):
        atc.twin(scene(tmp_path / "run.dump", frames, material="linear", safety=1.5))


def test_pictures_that_cannot_be_are_refused_before_the_run(tmp_path):
    given = scene(tmp_path / "run.dump", [block(), block(time=1.0)], material="linear")
    given["grid"] = {"kind": "line", "start": [0.5, 3.0, 3.0], "end": [26.0, 3.0, 3.0], "n": 9}
    (tmp_path / "scene.toml").write_text(atc.Scene(given).to_toml())
    result = CliRunner().invoke(app, ["twin", str(tmp_path / "scene.toml"), "--movie", str(tmp_path / "m.gif")])
    assert result.exit_code and "body:" not in result.output
    assert "--movie needs a regular or plane grid, not line" in f"{result.output} {result.exception}"


def test_a_static_twin_follows_its_indenter(tmp_path):
    """A moving indenter is at every frame where the frame's time says, and the nodes are in equilibrium there."""
    frames = [block(), block(), block(time=crystal("argon").units.to_internal("time", 2.0))]
    own = {"motion": "static", "grips": [[[-1, -1, -1], [3, 30, 30]]]}
    own |= {"indenter_radius": 6.0, "indenter_stiffness": 0.001}
    push = []
    for x, velocity in ((11.0, [0.5, 0, 0]), (12.0, [0, 0, 0])):
        given = scene(tmp_path / "run.dump", frames, **own, indenter_centre=[x, 13.2, 13.2], indenter_velocity=velocity)
        push.append(atc.twin(given).dataset["pd_indenter_force"].values)
    assert push[0][1] == pytest.approx(push[1][1], rel=1e-4, abs=1e-6)
    assert abs(push[0][1] - push[0][0]).max() > 0.01 * abs(push[0]).max() > 0
    with pytest.raises(AtcError, match="safety"):
        atc.twin(scene(tmp_path / "run.dump", frames, motion="static", safety=0.2))
