"""The shipped steady heat flow: the heat flux between the thermostats is the power they give and take, within its
statistical error."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import atc
from atc.config.scene import Scene
from atc.estimators.statistics import BlockAverage

FOLDER = Path(__file__).resolve().parents[2] / "data" / "heat_flow"
POWER, LENGTH = 60.0, 28.8
EXPECTED = POWER / (2 * 9.6**2)  # both ways round, through the cross-section
HOT, COLD = (
    (6.0, 8.4),
    (20.4, 22.8),
)  # the slabs of in.heat_flow: 3.75 to 5.25 and 12.75 to 14.25 lattice constants of 1.6
RADIUS = 1.5


@pytest.fixture(scope="module")
def profiles():
    """Fields of every frame along z."""
    scene = Scene.load(
        FOLDER / "scene.toml",
        {"fields.quantities": ["heat_flux", "energy_flux", "temperature"], "fields.average": False},
    )
    return scene.run()


def free(z):
    """Bins above the hot slab, where heat flows up, and bins where it flows down, at least a kernel radius away from
    the thermostats."""
    up = (z > HOT[1] + RADIUS) & (z < COLD[0] - RADIUS)
    down = (z > COLD[1] + RADIUS) | (z < HOT[0] - RADIUS)
    return up, down


def mean_and_error(series):
    """Mean and standard error by blocks, but not below that of independent frames.

    Sound waves, met in opposite phases by frame after frame, would make it smaller (rightly), but then by five blocks
    only, which is no measure.
    """
    average = BlockAverage()
    for x in series:
        average.add(x)
    mean, error, _ = average.result()
    return mean, np.maximum(error, np.std(series, axis=0, ddof=1) / np.sqrt(len(series)))


def test_the_thermostats_give_what_they_take():
    table = pd.read_csv(FOLDER / "thermostats.csv")
    assert len(table) == 40 and (table["power_hot"] == POWER).all() and (table["power_cold"] == -POWER).all()
    # The table's 15 digits, and time summed step by step.
    np.testing.assert_allclose(table["energy_hot"], POWER * (table["time"] - table["time"][0]), rtol=1e-10)
    # Total energy: the integrator's error, against what has passed through.
    assert np.abs(table["etotal"] - table["etotal"][0]).max() < 1e-4 * table["energy_hot"].iloc[-1]
    # Steady: what the middle could still store is what its temperature could still change by.
    half = len(table) // 2
    for name in ("temp_hot", "temp_cold"):
        first, second = table[name][:half], table[name][half:]
        scatter = np.hypot(first.std(), second.std()) / np.sqrt(half)
        assert abs(first.mean() - second.mean()) < 4 * scatter


@pytest.mark.parametrize("quantity, precise", [("heat_flux", 0.05), ("energy_flux", 0.08)])
def test_flux_is_power_by_area(profiles, quantity, precise):
    """Both fluxes: energy_flux is bound to the power by the balance of energy alone, heat_flux as far as nothing flows
    on the whole."""
    q_fz = profiles[quantity].sel(i="z").values
    up, down = free(profiles["z"].values)
    series = 0.5 * (q_fz[:, up].mean(axis=1) - q_fz[:, down].mean(axis=1))
    mean, error = mean_and_error(series)
    assert error < precise * EXPECTED
    # One sample of a distribution of width `error`: two of them hold it 95 times of 100, and this trajectory is what it
    # is.
    assert abs(mean - EXPECTED) < 2.0 * error
    # Both halves on their own, more loosely.
    for half in (q_fz[:, up].mean(axis=1), -q_fz[:, down].mean(axis=1)):
        mean, error = mean_and_error(half)
        assert abs(mean - EXPECTED) < 2.5 * error
    # No flux on the whole: along x and y, and around the box. sigma is the error of the mean; 3.5 of them for three
    # numbers.
    for c in "xyz":
        mean, error = mean_and_error(profiles[quantity].sel(i=c).values.mean(axis=1))
        assert abs(mean) < 3.5 * error


def test_profile_bin_by_bin(profiles):
    """The profile between the thermostats lies within its error bars of a constant, and jumps by the power across each
    slab."""
    z = profiles["z"].values
    up, down = free(z)
    mean, error = mean_and_error(profiles["heat_flux"].sel(i="z").values)
    sign = np.where(up, 1.0, -1.0)
    deviation = (mean - sign * EXPECTED) / error
    # 22 correlated bins: largest of as many Gaussians below 3.5.
    assert np.abs(deviation[up | down]).max() < 3.5
    # Half of the way through a slab half of its power has been given: the flux is 0 in the middle, by symmetry.
    for lo, hi in (HOT, COLD):
        middle = np.abs(z - 0.5 * (lo + hi)) < 0.9 * RADIUS / 2
        assert np.abs(mean[middle].mean()) < 0.15 * EXPECTED + 3 * error[middle].mean()
    # The slope in the hot slab has the sign of a source, in the cold one of a sink.
    gradient = np.gradient(mean, z)
    assert gradient[(z > HOT[0]) & (z < HOT[1])].mean() > 0 > gradient[(z > COLD[0]) & (z < COLD[1])].mean()


def test_heat_flows_down_the_temperature(profiles):
    z = profiles["z"].values
    up, down = free(z)
    T = profiles["temperature"].mean("frame").values
    table = pd.read_csv(FOLDER / "thermostats.csv")
    # fix ehex scales the slabs relative to their own mean velocity: LAMMPS's temperatures of the slabs, the kernel
    # taking in some of the slope beside them.
    for name, (lo, hi) in (("temp_hot", HOT), ("temp_cold", COLD)):
        here = T[np.abs(z - 0.5 * (lo + hi)) < 0.5].mean()
        assert here == pytest.approx(table[name].mean(), rel=0.05)
    slope_up = np.polyfit(z[up], T[up], 1)[0]
    around = np.where(z < HOT[1], z + LENGTH, z)[down]
    slope_down = np.polyfit(around, T[down], 1)[0]
    assert slope_up < 0 < slope_down
    assert slope_up == pytest.approx(
        -slope_down, rel=0.1
    )  # the same power through the same crystal: a few per cent of noise in 40 frames


def test_pair_potentials_do_not_churn(profiles):
    scale = np.abs(profiles["heat_flux_potential"].values).max()
    assert np.abs(profiles["heat_flux_churning"].values).max() < 1e-14 * scale


def test_the_scene_as_it_stands():
    """Its averages carry errors; three frames are enough to see that it runs."""
    ds = Scene.load(FOLDER / "scene.toml", {"trajectory.frames": "0:9:4"}).run()
    assert ds["heat_flux"].attrs["units"] == "epsilon/(sigma^2*tau)"
    assert {"heat_flux_stderr", "temperature", "density"} <= set(ds.data_vars) and ds.sizes["z"] == 36


def test_not_an_equilibrium_for_green_kubo():
    """40 frames are no Green-Kubo run: one line says so."""
    frames = atc.read(FOLDER / "heat_flow.dump.gz", masses={1: 1.0})
    pot = atc.potential(FOLDER / "in.heat_flow", units="lj")
    with pytest.raises(atc.AtcError, match="40 heat currents in 10 segments leave 4 in each"):
        atc.conductivity(frames, pot)
