"""Files named in scenes, cases and on the command line that are no files: refused at once, never waited for or read
without end."""

import os
import signal

import pytest
from test_cli import SCENE, refused, write_dump

SCENES = {
    "nep": SCENE[: SCENE.index("lammps")] + 'nep = "THERE"\n' + SCENE[SCENE.index("[kernel]") :],
    "input": SCENE[: SCENE.index("lammps")] + 'input = "THERE"\n' + SCENE[SCENE.index("[kernel]") :],
    "points": SCENE.replace('kind = "regular"\nshape = [4, 5, 6]', 'kind = "points"\npoints = "THERE"'),
    "table": SCENE.replace('"quartic"\nradius = 5.0', '"piecewise-linear"\ntable = "THERE"'),
    "dump": SCENE.replace('"run.dump"', '"THERE"'),
}


@pytest.fixture(params=["/dev/zero", "fifo"])
def there(request, tmp_path, monkeypatch):
    """A device without an end, and a pipe into which nobody writes; a hang is an error."""
    monkeypatch.chdir(tmp_path)
    write_dump(tmp_path / "run.dump", frames=1)
    os.mkfifo("fifo")
    signal.alarm(60)
    yield request.param
    signal.alarm(0)


@pytest.mark.parametrize("key", SCENES)
def test_of_a_scene(there, key, tmp_path):
    assert "THERE" in SCENES[key]
    (tmp_path / "scene.toml").write_text(SCENES[key].replace("THERE", there))
    assert there in refused("plan", "scene.toml")


def test_of_a_case(there, tmp_path):
    body = f'[body]\nfile = "{there}"\nhorizon = 0.003\ndensity = 2440\nvolume = 1e-9\n\n'
    (tmp_path / "case.toml").write_text(body + '[material]\nmodel = "pmb"\nyoungs = 72e9\n\n[run]\nsteps = 1\n')
    assert there in refused("pd", "case.toml", "--check")


def test_of_a_command(there):
    assert "more than" in refused("plan", "/dev/zero") and "more than" in refused("pd", "/dev/zero", "--check")
    assert "--kernel" in refused("advect", "-o", "o.nc", "--kernel", there)
