"""Runs without velocities, pictures along a line, what a twin costs, and steps of one's own."""

import warnings

import numpy as np
import pytest
import xarray as xr
from crystals import crystal, elastic
from PIL import Image
from test_twin import block, scene
from typer.testing import CliRunner

import atc
from atc.cli.root import app
from atc.errors import AtcError
from atc.twins.comparison import norms
from atc.twins.same_crystal import share_along


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
    given["grid"] = {"kind": "points", "points": [[0.5, 3.0, 3.0], [9.0, 3.0, 3.0]]}
    (tmp_path / "scene.toml").write_text(atc.Scene(given).to_toml())
    result = CliRunner().invoke(app, ["twin", str(tmp_path / "scene.toml"), "--movie", str(tmp_path / "m.gif")])
    assert result.exit_code and "body:" not in result.output
    assert "--movie needs a regular, plane or line grid, not points" in f"{result.output} {result.exception}"


def test_a_wave_is_compared_frame_by_frame(tmp_path):
    """A standing wave of the springs: norms are those of each frame with its own, half a period later as well, where
    the means over the frames vanish on both sides; no spread of frames is called an error. Drawn along the line, at the
    nodes beside the classical wave, and as a movie."""
    L = 5 * np.linalg.norm(crystal("argon").conventional[0])
    wave = lambda s: lambda X: s * 1e-3 * np.sin(2 * np.pi / L * X[:, :1]) * np.array([[0, 1.0, 0]])  # noqa: E731
    frames = [block(), block(u=wave(1)), block(u=wave(-1), time=crystal("argon").units.to_internal("time", 1.2))]
    given = scene(tmp_path / "run.dump", frames, material="linear")
    given["grid"] = {"kind": "line", "start": [0.2, 3.0, 3.0], "end": [26.0, 3.0, 3.0], "n": 12}
    found = atc.twin(given)
    ds = found.dataset
    row = next(r for r in found.rows if r["field"] == "displacement" and r["where"] == "matter")
    md, pd = (ds[f"{s}_displacement"].values for s in ("md", "pd"))
    assert row["md_rms"] == pytest.approx(np.sqrt(np.mean(md**2)), rel=1e-12) and row["md_rms"] > 2e-4
    assert np.abs(md.mean(axis=0)).max() < 1e-3 * np.abs(md).max()
    assert row["difference_rms"] == pytest.approx(np.sqrt(np.mean((pd - md) ** 2)), rel=1e-12)
    assert all(np.isnan(r["md_standard_error"]) for r in found.rows)
    said = next(line for line in found.lines if line.startswith("at the nodes"))
    nodes = {s: ds[f"{s}_node_displacement"].values[1:] for s in ("md", "pd", "classical")}
    for side in ("pd", "classical"):
        off = np.sqrt(np.mean((nodes[side] - nodes["md"]) ** 2) / np.mean(nodes["md"] ** 2))
        assert f"{100 * off:.3g} %" in said
    page = atc.report(ds, tmp_path / "wave.html").read_text()
    assert page.count("data:image/png") == 3 and "standard errors" not in page  # line, nodes, histories
    with Image.open(found.movie(tmp_path / "wave.gif")) as gif:
        assert gif.n_frames == 2


def test_where_a_side_has_nothing_in_some_frame():
    """Norms leave such frames out there, on both sides, and say numbers."""
    md = np.array([[1.0, 2.0], [3.0, np.nan], [5.0, 4.0]])
    full = np.full((3, 2), 2.0)
    data = xr.Dataset({name: (("frame", "x"), v) for name, v in (
        ("md_density", full), ("pd_density", full), ("md_damage", md), ("pd_damage", np.ones((3, 2))))})  # fmt: skip
    (row, *_) = norms(data, ["damage"], 2.0)
    assert row["md_rms"] == pytest.approx(3.0) and row["difference_rms"] == pytest.approx(2.0)
    want = np.sqrt((4.0 / 3 + 2.0 / 2) / 2)  # variances 4 of three frames, 2 of two
    assert row["md_standard_error"] == pytest.approx(want)
    (row, *_) = norms(data, ["damage"], 2.0, each_frame=True)
    assert row["difference_rms"] == pytest.approx(np.sqrt((0 + 4 + 16 + 1 + 9) / 5)) and np.isnan(
        row["md_standard_error"]
    )


def test_another_crystal_than_the_references(tmp_path):
    """Turned by 45 degrees no bond of fcc lies along its own: refused for materials that know directions, said of the
    isotropic one; a quarter turn is the same crystal."""
    frames = [block(), block(time=1.0)]
    turned = [[1, 1, 0], [-1, 1, 0], [0, 0, 1]]
    for material in ("linear", "cauchy-born", "smoothed"):
        with pytest.raises(AtcError, match="orient: 0 % of the nearest-neighbour bonds"):
            atc.twin(scene(tmp_path / "run.dump", frames, material=material, orient=turned))
    with pytest.warns(atc.AtcWarning, match="orient: 0 % of the nearest-neighbour bonds"):
        atc.twin(scene(tmp_path / "run.dump", frames, orient=turned, motion="static"))
    argon, quarter = crystal("argon"), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert share_along(block(), argon, quarter)[0] == 1.0
    rng = np.random.default_rng(3)
    gas = block().replace(positions=rng.uniform(0, 26.0, block().positions.shape))
    share, chance = share_along(gas, argon, np.eye(3))
    assert share == pytest.approx(chance, abs=0.02)


def test_atoms_that_no_fix_moves(tmp_path):
    """They stand still while others move, and no command says so: it is said unless their nodes are held."""
    a = np.linalg.norm(crystal("argon").conventional[0])
    push = lambda X: np.where(X[:, :1] > 2 * a - 1, 1e-3, 0.0) * np.array([[0, 1.0, 0]])  # noqa: E731
    frames = [block(), block(), block(u=push, time=1.0)]
    with pytest.warns(atc.AtcWarning, match="atoms stand still in all frames while others move"):
        atc.twin(scene(tmp_path / "run.dump", frames, material="linear"))
    with warnings.catch_warnings():
        warnings.simplefilter("error", atc.AtcWarning)
        atc.twin(scene(tmp_path / "run.dump", frames, material="linear", grips=[[[-1, -1, -1], [2 * a, 30, 30]]]))


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
