"""What `atc dispersion` draws of a twin is what its engine does."""

import numpy as np
import pytest
import xarray as xr
from crystals import ARGON, crystal, elastic, model
from typer.testing import CliRunner

from atc import pd
from atc.cli import app
from atc.twins.material import sampled_constants
from atc.twins.waves import NodeWaves
from atc.upscaling.force_constants import force_constants
from atc.upscaling.node_kernel import node_kernel

A = float(np.linalg.norm(crystal("argon").conventional[0]))


def test_springs_have_their_own_matrix():
    """Everywhere in the zone and beyond it, in a skewed lattice of nodes too; its derivative along k."""
    step = A * np.array([[1.0, 0, 0], [0.1, 1.1, 0], [0, 0.05, 0.95]])
    fc, C = force_constants(crystal("argon"), model("argon")), elastic("argon")
    kernel = node_kernel(fc, C, step, 2.4 * A)
    waves = NodeWaves(pd.Linear(kernel), step, 2.4 * A, crystal("argon").density, "springs")
    k = np.random.default_rng(0).normal(size=(20, 3)) / A
    want = kernel.dynamical_matrix(k)
    assert waves.dynamical_matrix(k) == pytest.approx(want, abs=1e-7 * np.abs(want).max())
    h = 1e-4
    steep = (waves.dynamical_matrix(k * (1 + h)) - waves.dynamical_matrix(k * (1 - h))) / (
        2 * h * np.linalg.norm(k, axis=1)[:, None, None]
    )
    assert waves.radial_gradient(k) == pytest.approx(steep, abs=1e-5 * np.abs(steep).max())
    G = 2 * np.pi * np.linalg.inv(step).T
    assert waves.carried(np.array([[0.0, 0, 0], 0.49 * G[0], 0.51 * G[0], G[0]])).tolist() == [True, True, False, False]


@pytest.mark.parametrize("material", [pd.LPS(bulk=1.0, shear=0.6), pd.PMB(bulk=1.0)])
def test_long_waves_of_isotropic_solids(material):
    """ρω²/k² along an axis is the elastic constant that the nodes' sums have by homogeneous strain."""
    horizon = 3.015
    waves = NodeWaves(material, np.eye(3), horizon, 2.0, "solid")
    C = sampled_constants(material, np.eye(3), horizon, 2.0)
    k = 1e-2
    got = 2.0 * np.linalg.eigvalsh(waves.dynamical_matrix([[k, 0, 0]]))[0] / k**2
    assert got[2] == pytest.approx(C[0, 0], rel=1e-3) and got[:2] == pytest.approx([C[4, 4], C[5, 5]], rel=1e-3)


def test_the_command(tmp_path):
    (tmp_path / "scene.toml").write_text(
        f'[potential]\nlammps = """\n{ARGON}\n"""\nunits = "metal"\n[dispersion]\nstructure = "fcc"\nmasses = [39.948]\n'
        'lattice_constant = 5.27\nmodels = ["classical"]\nphonopy = false\ntwin = true\n[twin]\nmaterial = "linear"\n'
    )
    out, png = tmp_path / "d.nc", tmp_path / "d.png"
    done = CliRunner().invoke(app, ["dispersion", str(tmp_path / "scene.toml"), "-o", str(out), "--picture", str(png)])
    assert done.exit_code == 0, done.output
    assert "twin: linear, nodes 5.269 angstrom apart" in done.output and png.stat().st_size > 10_000
    with xr.open_dataset(out) as ds:
        twin = ds["frequency_model"].sel(model="twin: linear, nodes 5.269 angstrom apart", ray="[100]")
        lattice = ds["frequency"].sel(ray="[100]")
        # The nodes' zone ends half-way to the crystal's.
        assert np.isfinite(twin.values[:31]).all() and np.isnan(twin.values[32:]).all()
        assert twin.values[1:11] == pytest.approx(lattice.values[1:11], rel=0.01)
    # what breaks has no place in waves
    more = ["--set", "twin.fracture_energy=0.1", "--set", "dispersion.directions=[[1, 0, 0]]"]
    done = CliRunner().invoke(app, ["dispersion", str(tmp_path / "scene.toml"), *more])
    assert done.exit_code == 0 and "PD less lattice" in done.output, done.output
    done = CliRunner().invoke(app, ["dispersion", str(tmp_path / "scene.toml"), "--set", "twin.material=smoothed"])
    assert done.exit_code == 2 and "the crystal's own waves" in done.output
