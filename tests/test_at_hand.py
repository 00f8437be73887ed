"""What a person sees and a program needs around the numbers: representations in notebooks, logging, progress, how much
is imported, the conda recipe."""

import logging
import re
import subprocess
import sys
import tomllib
import warnings
from pathlib import Path

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.errors import AtcWarning

ROOT = Path(__file__).parent.parent
LJ = "pair_style lj/cut 8.5\npair_coeff * * 0.0104 3.4\npair_coeff 2 2 0.02 3.6"


def test_html_representations():
    frame = argon(step=5, extra={"c_pe<b>": np.zeros(18)})
    pot, kern, grid = atc.potential(LJ, units="metal"), atc.kernel("quartic", 6.0), atc.Grid.slab("z", 4)
    for thing, words in (
        (frame, ("<td", "18", "metal", "velocities", "step", "c_pe&lt;b&gt;")),
        (atc.read([frame, frame]), ("frames", "2", "8 type 1", "9 x 10 x 11 angstrom")),
        (pot, ("lj/cut", "8.5", "cutoff")),
        (kern, ("quartic", "radius", "6")),
        (grid, ("slab profile along z, 4 bins",)),
        (__import__("atc.planning.report").planning.report.plan([frame], pot, kern, grid, ["stress"]), ("what runs",)),
    ):
        html = thing._repr_html_()
        assert all(w in html for w in words), html
        assert "<b>" not in html.replace("<div><b>", "")


def test_warnings_go_to_logging_too(caplog):
    with caplog.at_level(logging.INFO, logger="atc"), pytest.warns(AtcWarning, match="a doubt"):
        warnings.warn("a doubt", AtcWarning, stacklevel=1)
        atc.fields([argon()], None, atc.kernel("quartic", 9.0), atc.Grid.slab("z", 4), ["density"])
    said = [(r.levelname, r.getMessage()) for r in caplog.records if r.name == "atc"]
    assert ("WARNING", "a doubt") in said
    assert any(level == "INFO" and "1 frames of 18 atoms: density" in text for level, text in said)


def test_logging_is_silent_until_it_is_set_up():
    """Not even the last resort of Python's logging, which would print warnings a second time."""
    code = "import warnings; from atc.errors import AtcWarning; warnings.simplefilter('ignore'); warnings.warn('x', AtcWarning)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert done.stdout == "" and done.stderr == ""


def test_progress_bar(capsys):
    ds = atc.fields([argon(seed=k) for k in range(3)], BruteLJ(), atc.kernel("quartic", 6.0), atc.Grid.slab("z", 4),
                    ["density"], progress=True)  # fmt: skip
    assert ds.sizes["frame"] == 3 and "3/3" in capsys.readouterr().out


def test_what_is_imported():
    """Plots and stores come with what draws and stores; pandas comes with xarray, and that with a result."""
    code = (
        "import sys, atc\n"
        "def loaded(*names): return [n for n in names if n in sys.modules]\n"
        "assert not loaded('numpy', 'numba', 'xarray', 'pandas'), 'import'\n"
        "from atc.units import units\n"
        "from atc.frame import Cell, Frame\n"
        "f = Frame([[1.0, 1, 1], [2, 2, 2]], Cell([9.0, 9, 9]), units('metal'), masses=[1.0, 1.0])\n"
        f"p = atc.potential({LJ!r}, units='metal'); k = atc.kernel('quartic', 4.0); g = atc.Grid.slab('x', 5)\n"
        "assert not loaded('pandas', 'xarray', 'zarr', 'matplotlib'), 'before a result'\n"
        "ds = atc.fields([f], None, k, g, ['density'])\n"
        "assert not loaded('zarr', 'matplotlib', 'ase', 'MDAnalysis', 'distributed'), loaded('zarr', 'matplotlib')\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0, done.stderr


def test_conda_recipe_is_current():
    recipe = (ROOT / "conda" / "meta.yaml").read_text()
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert f'version = "{project["version"]}"' in recipe
    run = recipe.partition("  run:\n")[2].partition("\n\n")[0]
    listed = dict(re.findall(r"- ([\w-]+) (>=[\d.]+)", run))
    assert listed.pop("python") == project["requires-python"]
    wanted = dict(re.fullmatch(r"([\w-]+)(>=[\d.]+)", d).groups() for d in project["dependencies"])
    wanted["matplotlib-base"] = wanted.pop("matplotlib")  # conda-forge's matplotlib brings Qt
    assert listed == wanted


def test_conventions():
    ds = atc.fields([argon()], None, atc.kernel("quartic", 9.0), atc.Grid.slab("z", 4), ["density"])
    assert ds.attrs["Conventions"].startswith("CF-")
    assert all(v.attrs.get("units") and v.attrs.get("long_name") for v in ds.data_vars.values())
