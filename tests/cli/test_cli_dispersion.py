"""atc dispersion from end to end: the shipped scenes, one of potential and trajectory only, dataset, picture, JSON, and
bad input."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
import xarray as xr
from crystals import DATA
from typer.testing import CliRunner

from atc.cli import app

POTENTIAL = """
[potential]
units = "metal"
lammps = \"\"\"
pair_style lj/cut 8.5
pair_coeff 1 1 0.0104 3.40
\"\"\"
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def run(*args):
    return CliRunner().invoke(app, ["dispersion", *map(str, args)])


def refused(text, *args) -> str:
    """The one line of an unusable scene; as a program of its own, so that nothing of the test runner is in the way."""
    with open("scene.toml", "w") as f:
        f.write(text)
    done = subprocess.run(
        [sys.executable, "-m", "atc", "dispersion", "scene.toml", *args], capture_output=True, text=True
    )
    assert done.returncode == 2, done
    assert done.stderr.count("\n") == 1 and done.stderr.startswith("error: ")
    return done.stderr


def test_argon_scene(folder):
    shutil.copytree(DATA / "argon_crystal", "argon")
    scene = "argon/scene.toml"
    models = 'dispersion.models=["classical", "isotropic", "mollified", "coarse2", "lattice"]'
    done = run(scene, "-o", "out.nc", "--picture", "out.png", "--set", models)
    assert done.exit_code == 0, done.output
    for words in (
        "C11 4.1424, C12 2.3582, C44 2.3582 GPa",
        "1.36553, 1.36553, 1.99605 THz",
        "phonopy",
        "240 frames",
        "mollified lattice kernel",
        "[111] 0.5",
    ):
        assert words in done.output
    assert (folder / "out.png").stat().st_size > 30000
    with xr.open_dataset("out.nc", engine="h5netcdf") as ds:
        assert ds.attrs["lattice_constant"] == pytest.approx(5.268651641904, rel=1e-9)
        assert ds["frequency"].attrs["units"] == "THz"
        np.testing.assert_allclose(ds["frequency_phonopy"][:, 1:], ds["frequency"][:, 1:], atol=1e-6)
        np.testing.assert_allclose(ds["frequency"].sel(ray="[100]")[-1], [1.36553, 1.36553, 1.99605], atol=1e-5)
        assert ds["measured_ratio"].shape == (9, 3) and (ds["measured_ratio_error"] > 0).all()
        # From a trajectory within 0.5 % of phonopy, in the file.
        x = ds["measured_fraction"].values
        for p in range(9):
            curve = ds["frequency_phonopy"][int(ds["measured_ray"][p])]
            there = [np.interp(x[p], ds["fraction"], curve[:, b]) for b in range(3)]
            np.testing.assert_allclose(ds["measured_ratio"][p], there, rtol=5e-3)
        assert dict(ds["current_spectrum"].sizes)["polarisation"] == 2
        classical = ds["frequency_model"].sel(model="classical", ray="[100]")
        np.testing.assert_allclose(np.diff(classical[:, 2]), float(classical[1, 2]), rtol=1e-6)  # a straight line
        coarse = ds["frequency_model"].sel(model="coarse lattice, 2a")
        assert np.isnan(coarse[:, 31:]).all() and np.isfinite(coarse[:, :31]).all()  # its own zone ends half-way
        assert ds["elastic_constants"].attrs["units"] == "bar"
        assert float(ds["elastic_constants"][0, 0]) == pytest.approx(4.1424e4, rel=1e-4)
        assert ds["rms_error"].sel(model="mollified lattice kernel") < 8e-4
        assert "[dispersion]" in ds.attrs["scene"] and str(folder) not in str(ds.attrs)
    done = run(scene, "-o", "out.nc", "--set", models)
    assert done.exit_code != 0  # it is there already


def test_silicon_scene_as_json_and_zarr(folder):
    done = run(
        DATA / "silicon_crystal" / "scene.toml", "-o", "out.zarr", "--json", "--set", 'dispersion.models=["mollified"]'
    )
    assert done.exit_code == 0, done.output
    out = json.loads(done.stdout)
    assert out["lattice_constant"] == pytest.approx(5.43095, rel=1e-6)
    c = np.array(out["elastic_constants"]) / 1e4  # bar to GPa
    np.testing.assert_allclose([c[0, 0], c[0, 1], c[3, 3]], [151.4, 76.4, 56.4], rtol=2e-3)
    assert out["phonopy_difference"] < 1e-6 and out["models"][0]["stable"]
    ratio = np.array(out["measured"]["spectrum"], float)
    assert ratio.shape == (4, 6) and np.nanmax(ratio) < 17
    with xr.open_dataset("out.zarr", engine="zarr", chunks=None) as ds:
        assert ds["frequency"].shape == (3, 61, 6)
        assert ds["frequency_model"].shape == (1, 3, 61, 6)


def test_without_a_trajectory(folder):
    with open("scene.toml", "w") as f:
        f.write(
            POTENTIAL
            + '[dispersion]\nstructure = "fcc"\nlattice_constant = 5.3\nmasses = [39.948]\ndirections = [[1, 0, 0], '
            "[2, 1, 0]]\nphonopy = false\n"
        )
    done = run("scene.toml")
    assert done.exit_code == 0, done.output
    assert (
        "lattice constant 5.268652" in done.output and "[210] boundary" in done.output and "phonopy" not in done.output
    )
    # Stretched beyond its stability: reported, not hidden.
    done = run(
        "scene.toml",
        "--set",
        "dispersion.lattice_constant=6.6",
        "--set",
        "dispersion.keep_lattice_constant=true",
        "--picture",
        "x.png",
    )
    assert done.exit_code == 0, done.output
    assert (
        "unstable: imaginary frequencies" in done.output
        and "i, " in done.output
        and "not positive definite" in done.output
    )


def test_without_a_potential(folder):
    with open("scene.toml", "w") as f:
        f.write(
            f'[trajectory]\nfile = "{DATA / "argon_crystal" / "argon_crystal.dump.gz"}"\nmasses = [39.948]\n'
            '[dispersion]\nstructure = "fcc"\nlattice_constant = 5.27\n'
        )
    done = run("scene.toml", "-o", "out.nc", "--picture", "out.pdf")
    assert done.exit_code == 0, done.output
    with xr.open_dataset("out.nc", engine="h5netcdf") as ds:
        assert "frequency" not in ds and str(DATA) not in str(ds.attrs)
        boundary = ds["measured_ratio"][3]
        np.testing.assert_allclose(boundary, [1.36553, 1.36553, 1.99605], rtol=5e-3)


def test_units_of_the_scene(folder):
    """The same crystal in reduced units: frequencies in 1/tau, scaled."""
    with open("scene.toml", "w") as f:
        f.write(
            '[potential]\nunits = "lj"\nlammps = "pair_style lj/cut 2.5\\npair_coeff 1 1 1.0 1.0"\n'
            '[dispersion]\nstructure = "fcc"\nlattice_constant = 1.55\nmasses = [1.0]\n'
        )
    done = run("scene.toml", "--json")
    assert done.exit_code == 0, done.output
    out = json.loads(done.stdout)
    assert out["frequency_unit"] == "1/tau" and out["phonopy_difference"] < 1e-6
    assert out["lattice_constant"] == pytest.approx(5.268651641904 / 3.40, rel=1e-9)
    tau = 3.40 * np.sqrt(39.948 / 0.0104) * 0.01018050571  # ps
    assert out["rays"][0]["lattice"][-1][2] == pytest.approx(1.99605 * tau, rel=1e-5)


def test_bad_scenes(folder):
    crystal = '[dispersion]\nstructure = "fcc"\nlattice_constant = 5.3\nmasses = [39.948]\n'
    assert "did you mean 'lattice_constant'" in refused(POTENTIAL + "[dispersion]\nlatice_constant = 5.3\n")
    assert "known: classical" in refused(POTENTIAL + crystal + 'models = ["best"]\n')
    assert "[dispersion] needs structure" in refused(POTENTIAL + "[dispersion]\nlattice_constant = 5.3\n")
    assert "needs masses" in refused(POTENTIAL + '[dispersion]\nstructure = "fcc"\nlattice_constant = 5.3\n')
    assert "a [potential], a [trajectory] or both" in refused(crystal)
    assert "no [dispersion] section" in refused('[trajectory]\nfile = "x.dump"\n')
    assert "fitted to force constants" in refused(
        f'[trajectory]\nfile = "{DATA / "argon_crystal" / "argon_crystal.dump.gz"}"\nmasses = [39.948]\n'
        + crystal
        + 'models = ["cubic"]\n'
    )
    assert "not a whole number of cells" in refused(
        f'[trajectory]\nfile = "{DATA / "argon_crystal" / "argon_crystal.dump.gz"}"\nmasses = [39.948]\n'
        + crystal.replace("5.3", "4.6")
    )
    assert "nearer to equilibrium" in refused(POTENTIAL + crystal.replace("5.3", "15.0"))


def test_help_stays_instant():
    """No heavy import: numba, xarray, phonopy and scipy come with the work."""
    code = (
        "import sys, atc.cli, atc.cli.dispersion; print(sorted(m for m in sys.modules if m.split('.')[0] in ('numpy', "
        "'numba', 'scipy', 'xarray', 'phonopy')))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done
