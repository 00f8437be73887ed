"""Small things around outputs: what `atc info` says of them, pictures of standard errors, names of pictures."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import atc
from atc.cli import app
from atc.errors import AtcError
from atc.pictures.plotting import pick
from atc.planning.calibrate import argon


def run(*args):
    result = CliRunner().invoke(app, [str(a) for a in args])
    return result.exit_code, result.output


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    frame, pot = argon(4)
    out = tmp_path_factory.mktemp("o") / "a.nc"
    frames = [frame.replace(positions=frame.positions + 0.01 * k) for k in range(4)]
    atc.fields(
        frames,
        pot,
        atc.kernel("gaussian", radius=6.0),
        atc.Grid.regular(shape=4),
        ["stress", "density"],
        average=2,
        out=out,
    )
    return out


def test_info_knows_outputs(output, tmp_path):
    status, out = run("info", output)
    assert status == 0 and "an output of atc" in out
    assert "Hardy's stress [bar]" in out and "with standard error" in out and f"atc {atc.__version__}" in out
    status, out = run("info", output, "--json")
    said = json.loads(out)
    assert (
        said["sizes"]["frame"] == 2
        and said["fields"]["density"]["units"] == "g/cm^3"
        and "stress_stderr" not in said["fields"]
    )
    (tmp_path / "b.nc").write_bytes(b"not one of ours")
    status, out = run("info", tmp_path / "b.nc")
    assert status != 0 and "output of atc" not in out


def test_standard_errors_can_be_drawn(output, tmp_path):
    ds = atc.running.opening.load(output)
    assert pick(ds, "stress_stderr") == "stress_stderr"
    with pytest.raises(AtcError, match="stress_correlated is not in"):
        pick(ds, "stress_correlated")
    status, out = run("plot", output, "-q", "stress_stderr", "-c", "xx", "-o", tmp_path / "s.png")
    assert status == 0 and (tmp_path / "s.png").read_bytes()[:4] == b"\x89PNG", out
    assert np.isfinite(ds.stress_stderr.values).all()


def test_a_picture_that_cannot_be_written_is_told_before_anything_runs(tmp_path):
    scene = tmp_path / "s.toml"
    scene.write_text("[trajectory]\nfile = 'a'\n")
    for name in ("x.xyz", "nowhere/x.png"):
        status, out = run("bench", scene, "--picture", tmp_path / name)
        assert status != 0 and ("must end in .png" in out or "there is no directory" in out), out
