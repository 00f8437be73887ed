"""What the README says is so: its table is the program's own list, its scene is a scene, its Python runs, its commands
exist, its links lead somewhere."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import atc

ROOT = Path(__file__).resolve().parent.parent
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def row(name):
    return re.findall(r"`([^`]+)`", re.search(rf"^\| {name} \|(.*)\|$", TEXT, re.M)[1])


def block(language):
    return re.search(rf"^```{language}\n(.*?)^```$", TEXT, re.M | re.S)[1]


@pytest.mark.parametrize("kind", ["pair", "bond", "angle", "dihedral", "improper"])
def test_styles(kind):
    from atc.decomposers.registry import STYLES

    # Reading any LAMMPS line registers all styles.
    atc.potential("pair_style lj/cut 1.0\npair_coeff 1 1 1.0 1.0", units="lj")

    known = set(STYLES[kind]) | ({"hybrid", "hybrid/overlay", "hybrid/scaled"} if kind == "pair" else set())
    assert sorted(row(f"{kind} styles")) == sorted(known)


def test_kernels_grids_quantities():
    from atc.config.schema import GRIDS
    from atc.estimators.registry import QUANTITIES
    from atc.kernels import NAMES

    assert row("kernels") == list(NAMES)
    assert row("grids") == list(GRIDS)
    parts = {p for q in QUANTITIES.values() for p in q.parts}
    assert row("quantities") == [q for q in QUANTITIES if q not in parts]


def test_links():
    for target in re.findall(r"\]\(([^)#]+)\)", TEXT):
        assert (ROOT / target).exists(), target


def test_scene_and_python_say_the_same():
    """The scene and the Python of the README, run on two frames with points further apart, give the same stress."""
    from atc.config.scene import Scene

    few = {"trajectory.frames": "0:2", "grid.spacing": 6.0}
    scene = Scene.loads(block("toml"), folder=ROOT / "data" / "silicon_plate", overrides=few)
    ds = scene.run()

    code = block("python").replace('"silicon_plate.dump.gz"', f'"{ROOT}/data/silicon_plate/silicon_plate.dump.gz"')
    code = (
        code.replace("Si.sw", f"{ROOT}/data/silicon_plate/Si.sw")
        .replace("spacing=2.0", "spacing=6.0")
        .replace("fields(traj,", "fields(traj[:2],")
    )
    names = {}
    exec(code, names)
    # Bitwise the same calls, apart from the number of threads, in which the order of the sums may differ.
    np.testing.assert_allclose(
        names["ds"]["stress"].values, ds["stress"].values, rtol=0, atol=1e-12 * np.nanmax(np.abs(ds["stress"].values))
    )


def test_commands():
    import typer.main

    from atc.cli import app

    group = typer.main.get_command(app)
    lines = [line for line in TEXT.splitlines() if line.startswith("atc ")]
    assert len(lines) >= 5
    for line in lines:
        words = shlex.split(line.split("#")[0])[1:]
        command = group.commands[words[0]]
        if hasattr(command, "commands"):  # atc upscale springs ...
            command = command.commands[words[1]]
        options = {o for p in command.params for o in p.opts}
        assert all(w in options for w in words[1:] if w.startswith("-")), line
    targets = set(re.findall(r"^make (\w+)", TEXT, re.M))
    assert {"demo", "test"} <= targets
    assert all(re.search(rf"^{t}:", (ROOT / "Makefile").read_text(), re.M) for t in targets)


def test_version():
    assert (ROOT / "CHANGELOG.md").read_text().split("## ")[1].startswith(atc.__version__)
