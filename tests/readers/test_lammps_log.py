"""LAMMPS log files as LAMMPS writes them, and `atc verify`: model and run side by side."""

import json

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lammps_runs import ARGON, argon, run, water
from test_run_forces import NVE, RIGID
from typer.testing import CliRunner

from atc.cli import app
from atc.errors import AtcError
from atc.readers.lammps.log import LammpsLog

CUSTOM = "thermo_style custom step temp pe ke etotal press pxx pyy pzz pxy pxz pyz vol atoms\n"
RUN = "thermo 5\nfix 1 all nve\ntimestep 1.0\nrun 10"
STYLES = {
    "one": "",
    "custom": CUSTOM,
    "custom, step not first": "thermo_style custom temp step pe press\n",
    "multi": "thermo_style multi\n",
    "norm": CUSTOM + "thermo_modify norm yes\n",
    "norm lost": "thermo_modify norm yes\n" + CUSTOM,
    "yaml": CUSTOM + "thermo_modify line yaml\n",
    "yaml, norm": "thermo_style custom step pe press\nthermo_modify line yaml norm yes\n",
    "renamed": "thermo_style custom step pe press\nthermo_modify colname 2 Press colname 3 PotEng\n",
    "format": "thermo_style custom step pe press pxx\nthermo_modify format float %.15g\n",
    "coarse": "thermo_style custom step pe press\nthermo_modify format float %.4g\n",
    "parts": "thermo_style custom step epair emol press\n",
    "total": "thermo_style custom step etotal ke press\n",
}


def scene(folder, config, model, log="run.log", units=None):
    (folder / "scene.toml").write_text(
        f'[trajectory]\nfile = "run.dump"\ntopology = "run.data"\nunits = "{config.units}"\n'
        + (f'log = "{log}"\n' if log else "")
        + f'[potential]\nunits = "{units or config.units}"\nlammps = """\n{model}\n"""\n'
    )
    return folder / "scene.toml"


def verify(path, *args, status=0):
    result = CliRunner().invoke(app, ["verify", str(path), *args], prog_name="atc")
    assert result.exit_code == status, result.output
    return json.loads(result.stdout) if "--json" in args else result.output


def numbers(found, frame=0):
    return {x["name"]: x for x in found["frames"][frame]["log"]["numbers"]}


@pytest.mark.parametrize("style", STYLES)
def test_every_form_of_the_log(tmp_path, style):
    """Energies and pressures of model and run agree to the digits that the log has, in every form that LAMMPS
    prints."""
    run(tmp_path, argon(), ARGON, STYLES[style] + RUN, columns="id type x y z vx vy vz")
    found = verify(scene(tmp_path, argon(), ARGON), "--json", "--frames", "all")
    assert [f["step"] for f in found["frames"]] == [0, 5, 10] and found["agrees"]
    for k in range(3):
        n = numbers(found, k)
        assert {"energy", "pressure"} <= set(n) and all(x["agrees"] for x in n.values())
        fine = "yaml" in style or style == "format"
        assert abs(n["energy"]["difference"]) < (1e-10 if fine else 0.06 if style == "coarse" else 1e-3) * abs(
            n["energy"]["run"]
        )
        assert abs(n["pressure"]["difference"]) < (1e-10 if fine else 1e-3) * abs(n["pressure"]["run"])
    assert ("per atom" in " ".join(found["frames"][0]["log"]["notes"])) == (style in ("norm", "yaml, norm"))
    wrong = verify(scene(tmp_path, argon(), ARGON.replace("0.238", "0.24")), "--json", status=1)
    assert not wrong["agrees"] and not numbers(wrong)["energy"]["agrees"]


@pytest.mark.parametrize("norm", ["", "thermo_modify norm no\n", "thermo_modify norm yes\n"])
def test_lj_units_are_per_atom_unless_said_otherwise(tmp_path, norm):
    from lammps_oracle import Config, thermal_lattice

    x, t = thermal_lattice((6.8, 6.8, 6.8), (6, 6, 6), jitter=0.05)
    v = np.random.default_rng(0).normal(0, 1, x.shape)
    config, model = (
        Config(np.full(3, 6.8), x, t, "lj", {1: 1.0}, velocities=v),
        "pair_style lj/cut 2.5\npair_coeff 1 1 1.0 1.0",
    )
    run(
        tmp_path,
        config,
        model,
        CUSTOM + norm + "thermo 5\nfix 1 all nve\ntimestep 0.002\nrun 5",
        columns="id type x y z vx vy vz fx fy fz",
    )
    found = verify(scene(tmp_path, config, model), "--json")
    n = numbers(found)
    assert (
        found["agrees"] and abs(n["energy"]["run"]) < 10
        if norm != "thermo_modify norm no\n"
        else abs(n["energy"]["run"]) > 100
    )
    # without the echoed commands, LAMMPS's default is taken; where that is wrong it is seen what it is
    log = tmp_path / "run.log"
    log.write_text(
        "\n".join(
            line
            for line in log.read_text().split("\n")
            if not line.startswith(("units", "thermo", "pair", "run", "fix"))
        )
    )
    blind = verify(scene(tmp_path, config, model), status=1 if "no" in norm.split()[-1:] else 0)
    assert ("are totals (thermo_modify norm no), which the log does not say" in blind) == ("no" in norm.split()[-1:])


def test_several_runs_warnings_and_a_broken_end(tmp_path):
    """Rows of two runs of one step are both known; warnings, printed text that looks like a heading, and a line that
    was cut off are no rows."""
    script = (
        RUN.replace("run 10", "run 5")
        + "\nprint 'Step Temp PotEng'\nprint '1 2 3'\nfix p all print 1 'Step of print 5'\nrun 5"
    )
    run(tmp_path, argon(), ARGON, script)
    log = tmp_path / "run.log"
    text = log.read_text()
    rows = LammpsLog(log).rows
    assert [r.step for r in rows] == [0, 5, 5, 10] and [r.run for r in rows] == [1, 1, 2, 2]
    lines = text.split("\n")
    at = next(k for k, line in enumerate(lines) if line.split()[:1] == ["10"] and len(line.split()) == 6)
    lines.insert(at, "WARNING: something happened (src/file.cpp:12)")
    log.write_text("\n".join(lines))
    assert [r.step for r in LammpsLog(log).rows] == [0, 5, 5, 10]
    log.write_text("\n".join(lines[: at + 1] + [lines[at + 1][:40]]))
    assert [r.step for r in LammpsLog(log).rows] == [0, 5, 5]
    multi = text  # the file that was cut within a block of several lines
    run(tmp_path, argon(), ARGON, "thermo_style multi\n" + RUN)
    multi = log.read_text()
    log.write_text(multi[: multi.rindex("PotEng   =") + 20])
    assert [r.step for r in LammpsLog(log).rows] == [0, 5]


def test_several_files_are_one_log(tmp_path):
    run(tmp_path, argon(), ARGON, RUN)
    text = (tmp_path / "run.log").read_text()
    (tmp_path / "b.log").write_text(text.replace("\n        10 ", "\n        15 "))
    assert LammpsLog([tmp_path / "run.log", tmp_path / "b.log"]).steps == [0, 5, 10, 15]
    (tmp_path / "c.log").write_text(text.replace("units real", "units metal"))
    with pytest.raises(AtcError, match="changes its units from 'real' to 'metal'"):
        LammpsLog([tmp_path / "run.log", tmp_path / "c.log"])


@pytest.mark.parametrize(
    "content, message",
    [
        ("", "no thermodynamic output"),
        ("hello\nworld\n", "no thermodynamic output"),
        ("\0\1binary", "binary"),
        ("Step Temp\n", "no thermodynamic output"),
    ],
)
def test_what_is_no_log(tmp_path, content, message):
    path = tmp_path / "log.lammps"
    path.write_text(content)
    with pytest.raises(AtcError, match=message) as e:
        LammpsLog(path, "real")
    assert "\n" not in str(e.value) and str(path) in str(e.value)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_damaged_logs(tmp_path_factory, data):
    """Whatever is cut, doubled or overwritten in a log: rows, or the package's own error in one line."""
    text = damaged_log(tmp_path_factory)
    for _ in range(data.draw(st.integers(1, 3))):
        a = data.draw(st.integers(0, len(text)))
        b = min(len(text), a + data.draw(st.integers(0, 400)))
        put = data.draw(
            st.sampled_from(
                [
                    "",
                    "\n",
                    "nan ",
                    "1e999",
                    "-1e-99999999",
                    "9" * 400,
                    "\n---\nkeywords: ['Step', ]\n",
                    "\n---------- Step 5 ----- CPU = ",
                    "Step ",
                    "\xff",
                    "  - [1, 2",
                ]
            )
        )
        text = text[:a] + put + text[b:]
    path = tmp_path_factory.mktemp("damaged") / "log"
    path.write_text(text)
    try:
        rows = LammpsLog(path, "real").rows
    except AtcError as e:
        assert "\n" not in str(e)
    else:
        assert all(isinstance(r.step, int) for r in rows)


def damaged_log(factory, made=[]):  # noqa: B006  (made once)
    if not made:
        folder = factory.mktemp("whole")
        for name in ("one", "multi", "yaml"):
            run(folder, argon(), ARGON, STYLES[name] + RUN)
            made.append((folder / "run.log").read_text())
    return "".join(made)


def test_yaml_without_steps_says_so(tmp_path):
    run(tmp_path, argon(), ARGON, "thermo_style multi\nthermo_modify line yaml\n" + RUN)
    with pytest.raises(AtcError, match="has no column Step: add step to thermo_style custom"):
        LammpsLog(tmp_path / "run.log")


def test_tail_corrections_are_named(tmp_path):
    """Energy without E_tail agrees where the log prints it; the pressure differs by one number along x, y and z."""
    model = ARGON + "\npair_modify tail yes"
    run(tmp_path, argon(), model, CUSTOM.replace("pe ", "pe etail ") + RUN)
    found = verify(scene(tmp_path, argon(), ARGON), "--json", "--frames", "0", status=1)
    n, notes = numbers(found), " ".join(found["frames"][0]["log"]["notes"])
    assert (
        n["energy"]["agrees"]
        and not n["pressure xx"]["agrees"]
        and n["pressure xy"]["agrees"]
        and found["frames"][0]["forces"]["agrees"]
    )
    assert (
        "E_tail of the run is taken off" in notes
        and "a tail correction (pair_modify tail yes)" in notes
        and "the forces agree" in notes
    )


def test_rigid_molecules(tmp_path):
    """Forces of rigid bodies agree, their virial does not; shake leaves fewer degrees of freedom, and says so in the
    temperature."""
    w = water()
    run(tmp_path, w, RIGID, CUSTOM + "thermo 5\nfix 1 all rigid/nve/small molecule\ntimestep 0.5\nrun 5")
    found = verify(scene(tmp_path, w, RIGID), "--json", "--frames", "1", status=1)
    notes = " ".join(found["frames"][0]["log"]["notes"])
    assert found["frames"][0]["forces"]["agrees"] and "the forces agree" in notes and "fix rigid/nve/small" in notes
    run(tmp_path, w, RIGID, CUSTOM + "thermo 5\nfix 2 all shake 1e-8 100 0 b 1 a 1\n" + NVE)
    shaken = verify(scene(tmp_path, w, RIGID), "--frames", "1", status=1)
    assert (
        f"the run counts {3 * 192 - 3 - 3 * 64} degrees of freedom, {3 * 64} fewer than {3 * 192 - 3}: constraints "
        "(shake" in shaken
    )
    assert "constraint forces along bonds of fixed length" in shaken and "do NOT agree" in shaken


def test_pressure_without_velocities(tmp_path):
    run(tmp_path, argon(), ARGON, RUN, columns="id type x y z fx fy fz")
    found = verify(scene(tmp_path, argon(), ARGON), "--json")
    assert found["agrees"] and "kinetic part of its pressure is that of the log's temperature" in " ".join(
        found["frames"][0]["log"]["notes"]
    )
    assert set(numbers(found)) == {"energy", "pressure"}


def test_wrong_masses_show_in_the_kinetic_energy(tmp_path):
    run(tmp_path, argon(), ARGON, CUSTOM + RUN)
    path = scene(tmp_path, argon(), ARGON)
    path.write_text(path.read_text().replace("[potential]", "masses = [40.0, 31.0]\n[potential]", 1))
    n = numbers(verify(path, "--json", status=1))
    assert not n["kinetic energy"]["agrees"] and n["energy"]["agrees"]


def test_verify_needs_something_to_compare(tmp_path):
    run(tmp_path, argon(), ARGON, RUN, columns="id type x y z")
    out = verify(scene(tmp_path, argon(), ARGON, log=None), status=2)
    assert (
        "nothing to compare with: the trajectory has no forces" in out
        and "dump fx fy fz too or name its log file" in out
    )
    log = tmp_path / "run.log"
    log.write_text(
        log.read_text()
        .replace("\n         0 ", "\n      1000 ")
        .replace("\n         5 ", "\n      1005 ")
        .replace("\n        10 ", "\n      1010 ")
    )
    out = verify(scene(tmp_path, argon(), ARGON), status=2)
    assert "no step is in both" in out and "log: steps 1000 to 1010" in out
    assert "there is no file" in verify(scene(tmp_path, argon(), ARGON, log="none.log"), status=2)
    assert "--frames x" in verify(scene(tmp_path, argon(), ARGON), "--frames", "x", status=2)
    assert "selects none of 3 frames" in verify(scene(tmp_path, argon(), ARGON), "--frames", "7", status=2)


def test_the_log_alone_can_be_written_less_often(tmp_path):
    """Where neither the first nor the middle frame has its step in the log, another one is found."""
    run(
        tmp_path,
        argon(),
        ARGON,
        "thermo 6\nfix 1 all nve\ntimestep 1.0\nrun 6",
        every=2,
        columns="id type x y z vx vy vz",
    )
    log = tmp_path / "run.log"
    log.write_text(
        "\n".join(line for line in log.read_text().split("\n") if line.split()[:1] != ["0"] or len(line.split()) != 6)
    )
    found = verify(scene(tmp_path, argon(), ARGON), "--json", "--frames", "0")
    assert [f["frame"] for f in found["frames"]] == [3] and found["agrees"]


def test_info_of_a_scene(tmp_path):
    run(tmp_path, argon(), ARGON, RUN)
    path = scene(tmp_path, argon(), ARGON)
    result = CliRunner().invoke(app, ["info", str(path)], prog_name="atc")
    assert (
        result.exit_code == 0
        and "agrees with run  forces of frame 0: yes" in result.output
        and "pair lj/cut" in result.output
    )
    result = CliRunner().invoke(app, ["info", str(path), "--units", "real"], prog_name="atc")
    assert result.exit_code == 2 and "--units goes with a trajectory" in result.output
