"""A run that goes on is the same run: whatever changes a number is noticed and named; a trajectory that has grown goes
on."""

import subprocess
import sys

import numpy as np
import pytest
from test_cli import SCENE, atc, ok, write_dump
from test_run import Stop, fields, same, stop_after, trajectory

from atc.config.scene import Scene
from atc.errors import AtcError

LINES = "pair_style lj/cut 7.0\npair_coeff 1 1 0.0104 3.4\n"


@pytest.fixture
def case(tmp_path):
    """A scene with a script, a data file and six frames, its run stopped after three."""
    write_dump(tmp_path / "run.dump", frames=6)
    (tmp_path / "in.run").write_text("units metal\n" + LINES)
    text = SCENE.replace('lammps = """\n' + LINES + '"""', 'input = "in.run"').replace("out.nc", "out.zarr")
    assert "in.run" in text
    (tmp_path / "scene.toml").write_text(text)
    return tmp_path


def begun(case, *settings, stop=3):
    scene = Scene.load(case / "scene.toml", list(settings))
    with pytest.raises(Stop):
        scene.write(case / "out.zarr", progress=stop_after(stop))
    return scene


def resumed(case, *settings):
    return Scene.load(case / "scene.toml", list(settings)).write(case / "out.zarr")


def edit(path, old, new, count=1):
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, count))


@pytest.mark.parametrize(
    "setting, word",
    [
        ("fields.horizon=6.0", "horizon: none then, 6.0 now"),
        ("fields.tolerance=1e-6", "tolerance: 1e-05 then, 1e-06 now"),
        ("kernel.radius=5.5", "kernel: quartic, radius 5.0 then, quartic, radius 5.5 now"),
        ("kernel.name=lucy", "kernel"),
        ("grid.shape=[4,5,7]", "grid"),
        ("fields.quantities=density", "quantities"),
        ("fields.average=2", "average"),
        ("fields.method=direct", "method: auto then, direct now"),
        ("fields.tiles=[2,1,1]", "tiles"),
        ("trajectory.masses={1=40.0}", "masses of the first frame"),
        ("trajectory.frames=1:", "positions, velocities, step or time of the first frame"),
        ("trajectory.frames=0:5", "had 6 and has 5"),
    ],
)
def test_another_request_is_named(case, setting, word):
    begun(case)
    before = (case / "out.zarr.partial" / "journal.jsonl").read_bytes()
    with pytest.raises(AtcError) as e:
        resumed(case, setting)
    assert word in str(e.value) and "\n" not in str(e.value)
    assert (case / "out.zarr.partial" / "journal.jsonl").read_bytes() == before
    resumed(case)


def test_a_horizon_that_changes(case):
    what = "fields.quantities=peridynamic_stress_weighted_virial"
    begun(case, what, "fields.horizon=5.0")
    with pytest.raises(AtcError, match=r"horizon: 5.0 then, 6.0 now"):
        resumed(case, what, "fields.horizon=6.0")


def test_a_coefficient_that_the_first_frame_does_not_feel(case):
    """A cutoff that no atom pair of the first frame is near, a type that is not there yet."""
    begun(case)
    edit(case / "in.run", "pair_coeff 1 1 0.0104 3.4\n", "pair_coeff 1 1 0.0104 3.4\npair_coeff 2 2 0.02 3.0\n")
    with pytest.raises(AtcError, match="potential"):
        resumed(case)


def test_a_script_elsewhere_with_the_same_model_goes_on(case):
    begun(case)
    (case / "in.run").rename(case / "in.copy")
    resumed(case, "potential.input=in.copy")


@pytest.mark.parametrize("average", [False, 2])
def test_an_edited_frame(case, average):
    """One digit of a frame that is done, everything else as it was."""
    settings = [] if not average else ["fields.average=2"]
    begun(case, *settings, stop=4)
    lines = (case / "run.dump").read_text().splitlines(keepends=True)
    starts = [k for k, line in enumerate(lines) if line.startswith("ITEM: TIMESTEP")]
    at = starts[2] + 9 + 5
    words = lines[at].split()
    words[2] = repr(float(words[2]) + 1e-9)
    lines[at] = " ".join(words) + "\n"
    (case / "run.dump").write_text("".join(lines))
    with pytest.raises(AtcError, match=r"run.dump frame 2: is not what it was .*\(different: positions\)"):
        resumed(case, *settings)


def test_a_rerun_from_the_same_start(case):
    begun(case)
    first = (case / "run.dump").read_text().split("ITEM: TIMESTEP\n100\n")[0]
    write_dump(case / "run.dump", frames=6, seed=2)
    other = (case / "run.dump").read_text().split("ITEM: TIMESTEP\n100\n")[1]
    (case / "run.dump").write_text(first + "ITEM: TIMESTEP\n100\n" + other)
    with pytest.raises(AtcError, match=r"frame 1: is not what it was"):
        resumed(case)


def test_another_selection_of_as_many_frames(case):
    write_dump(case / "run.dump", frames=12)
    begun(case, "trajectory.frames=0:6:1")
    with pytest.raises(AtcError, match="is not what it was"):
        resumed(case, "trajectory.frames=0:12:2")


@pytest.mark.parametrize("average, stop", [(False, 3), (3, 3), (3, 6)])
def test_a_grown_trajectory_goes_on(tmp_path, average, stop):
    """Also when its last window was a short one, and finished."""
    out = tmp_path / "o.zarr"
    with pytest.raises(Stop):
        fields(trajectory(7), out, average=average, progress=stop_after(stop))
    grown = fields(trajectory(10), out, average=average)
    whole = fields(trajectory(10), tmp_path / "w.zarr", average=average)
    for name in whole.variables:
        np.testing.assert_array_equal(whole[name].values, grown[name].values)


def test_a_finished_short_window_is_computed_again_when_there_is_more(tmp_path, monkeypatch):
    from atc.running import store

    def killed(self, attrs):
        raise KeyboardInterrupt

    out = tmp_path / "o.zarr"
    with monkeypatch.context() as m:
        m.setattr(store.Store, "finish", killed)
        with pytest.raises(KeyboardInterrupt):
            fields(trajectory(7), out, average=3)
    same(fields(trajectory(8), tmp_path / "w.zarr", average=3), fields(trajectory(8), out, average=3))


def test_outputs_of_another_version_with_other_numbers(case, monkeypatch):
    from atc.planning import identity

    begun(case)
    monkeypatch.setattr(identity, "RESULTS", identity.RESULTS + 1)
    with pytest.raises(AtcError, match="version: this version of atc gives other numbers"):
        resumed(case)


def test_the_command_says_how_to_begin_again(case):
    begun(case)
    process = atc("fields", "scene.toml", "--set", "kernel.radius=4.5", cwd=case)
    _, err = process.communicate(timeout=100)
    assert process.returncode == 2 and "kernel" in err and "--restart" in err and len(err.splitlines()) == 1
    ok(
        "fields",
        str(case / "scene.toml"),
        "--set",
        "kernel.radius=4.5",
        "--restart",
        "-q",
        "-o",
        str(case / "out.zarr"),
    )


def test_python_still_quits_by_itself(tmp_path):
    """Ctrl-C in somebody's own program is a KeyboardInterrupt there too."""
    code = (
        "import os, signal\nfrom atc.running.interruption import whole\ntry:\n  with whole():\n    "
        "os.kill(os.getpid(), "
        "signal.SIGINT); print('done')\nexcept KeyboardInterrupt: print('heard')"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout.split() == ["done", "heard"]
