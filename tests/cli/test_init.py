"""`atc init` and `atc report`: scenes that run as they are written, and a page about the result."""

import warnings

import pytest
from test_cli import run, write_dump

from atc.config.scene import Scene
from atc.errors import AtcError

LJ = "units metal\nboundary p p p\nmass 1 39.948\npair_style lj/cut 7.0\npair_coeff 1 1 0.0104 3.4\nrun 0\n"


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_dump("run.dump", frames=3)
    (tmp_path / "in.run").write_text(LJ)
    return tmp_path


def test_a_scene_from_dump_and_script_runs(folder):
    done = run("init", "run.dump", "in.run")
    assert done.exit_code == 0, done.output
    assert "atc plan scene.toml" in done.output
    text = (folder / "scene.toml").read_text()
    assert "# " in text and 'units = "metal"' in text
    scene = Scene.load("scene.toml")
    assert {"stress", "virial_stress", "density", "temperature"} <= set(scene.get("fields", "quantities"))
    assert run("plan", "scene.toml").exit_code == 0
    done = run("fields", "scene.toml")
    assert done.exit_code == 0, done.output
    assert (folder / "run-fields.nc").exists()
    done = run("init", "run.dump", "in.run")
    assert done.exit_code == 2 and "give --overwrite" in done.output
    # the plan says what fields would: the output is there
    assert "exists: give --overwrite" in run("plan", "scene.toml").output


def test_without_a_script_and_elsewhere(folder):
    (folder / "scenes").mkdir()
    done = run("init", "run.dump", "-o", "scenes/a.toml", "--units", "metal")
    assert done.exit_code == 0, done.output
    scene = Scene.load("scenes/a.toml")
    assert scene.get("trajectory", "file") == "../run.dump" and "potential" not in scene.data
    assert scene.get("fields", "quantities") == ["number_density"]
    assert "no masses" in (folder / "scenes/a.toml").read_text()
    assert run("plan", "scenes/a.toml").exit_code == 0


def test_the_kernel_suits_long_range_coulomb(folder):
    """Modes of kernels with kinks go several times as far."""
    lines = LJ.replace("lj/cut 7.0", "lj/cut/coul/long 7.0").replace("run 0", "kspace_style pppm 1e-4")
    (folder / "in.salt").write_text(lines)
    assert run("init", "run.dump", "in.salt", "-o", "salt.toml").exit_code == 0
    assert run("init", "run.dump", "in.run", "-o", "gas.toml").exit_code == 0
    assert [Scene.load(f).get("kernel", "name") for f in ("salt.toml", "gas.toml")] == ["gaussian", "quartic"]


def test_what_cannot_be_is_one_line(folder):
    for args in (["init", "nothing.dump", "in.run"], ["init", "run.dump", "-o", "a.txt"], ["init", "run.dump", "none"]):
        done = run(*args)
        assert done.exit_code == 2 and done.output.strip().count("\n") == 0, done.output


@pytest.mark.parametrize(
    "change",
    [{"fields.quantities": ["displacement"]}, {"kernel.radius": 0.4}, {"output.units": "V"}, {"select.types": [7]},
     {"trajectory.masses": {"1": 4e5}}, {"trajectory.units": "real"}],
)  # fmt: skip
def test_plans_check_what_fields_check(folder, change):
    """What is missing in the first frame, and what looks odd, is told by both in the same words."""
    run("init", "run.dump", "in.run")
    told = []
    for what in ("plan", "run"):
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always")
            try:
                getattr(Scene.load("scene.toml", change), what)()
                told.append([str(w.message) for w in found if "tolerance" not in str(w.message)])
            except AtcError as e:
                told.append(str(e))
    assert told[0] and told[0] == told[1]


def test_a_report_beside_the_fields(folder):
    run("init", "run.dump", "in.run")
    done = run("fields", "scene.toml", "--report", "--set", "grid.shape=[3,3,3]", "--set", "kernel.radius=5")
    assert done.exit_code == 0, done.output
    assert "report: run-fields.html" in done.output.replace(str(folder) + "/", "")
    text = (folder / "run-fields.html").read_text()
    assert "Hardy against virial" in text
    done = run("report", "run-fields.nc", "-o", "x.html", "--units", "GPa")
    assert done.exit_code == 0 and "GPa" in (folder / "x.html").read_text()
    assert run("report", "run.dump").exit_code == 2
