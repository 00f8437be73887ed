"""The shipped trajectories against LAMMPS's own numbers for the very same frames (thermo.csv, written by the run that
made them).

The only difference between the two is rounding in the dump: positions are printed with 10 significant digits and
velocities with 8 (``digits``). So each tolerance is computed from that: for the energy the worst case Σ|F|·δ, for the
virial what random changes of that size do to it.
"""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import atc

DATA = Path(__file__).resolve().parent.parent / "data"
SIX = ("xx", "yy", "zz", "xy", "xz", "yz")
ROWS, COLUMNS = (0, 1, 2, 0, 0, 1), (0, 1, 2, 1, 2, 2)

CASES = {
    "silicon_plate": dict(frames=20, atoms=8064, units="metal", masses={1: 28.0855}),
    "argon_slab": dict(frames=30, atoms=2432, units="real", topology="argon_slab.data"),
    "melt": dict(frames=30, atoms=1500, units="lj", topology="melt.data"),
    "heat_flow": dict(frames=40, atoms=2592, units="lj", masses={1: 1.0}, digits=(7, 5)),
}


@pytest.fixture(scope="module", params=list(CASES))
def case(request):
    name, what = request.param, CASES[request.param]
    folder = DATA / name
    topology = what.get("topology")
    traj = atc.read(
        folder / f"{name}.dump.gz", topology=folder / topology if topology else None, masses=what.get("masses")
    )
    return name, what, traj, pd.read_csv(folder / "thermo.csv")


def full(row, prefix):
    p = np.zeros((3, 3))
    for c, i, j in zip(SIX, ROWS, COLUMNS):
        p[i, j] = p[j, i] = row[prefix + c]
    return p


def digits(what):
    """Significant digits of positions and velocities in the dump."""
    return what.get("digits", (10, 8))


def printed(x, digits):
    """Half a unit in the last of `digits` significant digits, for each number."""
    x = np.abs(x)
    return 0.5 * 10.0 ** (np.floor(np.log10(np.where(x > 0, x, 1.0))) + 1 - digits)


def test_what_is_shipped(case):
    _, what, traj, thermo = case
    assert len(traj) == what["frames"] == len(thermo)
    for frame, (_, row) in zip(traj, thermo.iterrows()):
        u = frame.units
        assert u.name == what["units"]
        assert len(frame) == what["atoms"]
        assert frame.step == row["step"]
        # The dump's time is printed with %.16g, the table's with %.15g.
        assert u.to_user("time", frame.time) == pytest.approx(row["time"], rel=1e-14)
        assert u.to_user("volume", frame.cell.volume) == pytest.approx(row["vol"], rel=1e-14)


def test_size():
    """Everything in data/ together stays below 16 MB: it is cloned by everyone."""
    assert sum(f.stat().st_size for f in DATA.rglob("*") if f.is_file()) < 16e6


def test_kinetic(case):
    """Kinetic energy, temperature and kinetic pressure of every frame."""
    _, what, traj, thermo = case
    for frame, (_, row) in zip(traj, thermo.iterrows()):
        u = frame.units
        v, m = frame.velocities, frame.masses
        dv = u.to_internal("velocity", printed(u.to_user("velocity", v), digits(what)[1]))
        kinetic = np.einsum("n,ni,nj->ij", m, v, v)
        # First order in the rounding, worst case; 1e-13 is for the sums themselves and the table's 15 digits.
        bound = np.einsum("n,ni,nj->ij", m, np.abs(v), dv)
        bound = bound + bound.T + 1e-13 * np.trace(kinetic)
        theirs = u.to_internal("pressure", full(row, "p") - full(row, "v")) * frame.cell.volume
        # The table gives the sum: its last digit is of the size of the potential part's.
        bound += u.to_internal("pressure", 1e-14 * np.abs(full(row, "v")).max()) * frame.cell.volume
        assert (np.abs(kinetic - theirs) <= bound).all()
        ke = np.trace(kinetic) / 2
        assert abs(ke - u.to_internal("energy", row["ke"])) <= np.trace(bound)
        # LAMMPS: 3N - 3 degrees of freedom.
        temperature = 2 * ke / ((3 * len(frame) - 3) * u.boltzmann)
        assert temperature == pytest.approx(row["temp"], rel=2 * np.trace(bound) / ke)


def test_potential(case):
    """Potential energy and virial pressure of every frame, six components."""
    name, what, traj, thermo = case
    # The input script that made the run says what the potential is; its lines are read as they stand.
    pot = atc.potential(DATA / name / f"in.{name}", units=what["units"])
    rng = np.random.default_rng(7)
    bound = None
    for frame, (_, row) in zip(traj, thermo.iterrows()):
        u = frame.units
        mine = pot.stream(frame, forces=True)
        virial = mine.virial_cc
        dx = u.to_internal("length", printed(u.to_user("length", frame.positions), digits(what)[0]))
        # 1e-13: sums over 1e5 terms that partly cancel, and the table's 15 digits.
        assert abs(mine.energy - u.to_internal("energy", row["pe"])) <= (
            np.abs(mine.forces_nc) * dx
        ).sum() + 1e-13 * abs(mine.energy)
        if bound is None:
            # What rounding of this size does to the virial: the spread over three random ones, times ten to be safe for
            # every frame.
            moved = [
                pot.stream(frame.replace(positions=frame.positions + rng.uniform(-1, 1, dx.shape) * dx)).virial_cc
                for _ in range(3)
            ]
            bound = 10 * np.max(np.abs(np.array(moved) - virial))
            assert bound < 10.0 ** (3 - digits(what)[0]) * np.abs(virial).max()
        theirs = -u.to_internal("pressure", full(row, "v")) * frame.cell.volume
        np.testing.assert_allclose(virial, theirs, rtol=0, atol=bound)


@pytest.mark.filterwarnings("ignore:the kernel's radius")  # the grid is coarse on purpose
@pytest.mark.parametrize("name", CASES)
def test_scene(name):
    """The shipped scene runs, and its virial stress is minus LAMMPS's pressure, in LAMMPS's units."""
    from atc.config.scene import Scene

    what = CASES[name]
    coarse = {"grid.bins": 5} if name in ("argon_slab", "heat_flow") else {"grid.shape": [4, 4, 2]}
    ds = Scene.load(DATA / name / "scene.toml", {"trajectory.frames": "3:9:5", "fields.average": False, **coarse}).run()
    thermo = pd.read_csv(DATA / name / "thermo.csv").iloc[[3, 8]]
    assert ds["step"].values.tolist() == thermo["step"].tolist()
    for variable, prefix in (("virial_stress", "p"), ("virial_stress_potential", "v")):
        theirs = np.array([-full(row, prefix) for _, row in thermo.iterrows()])
        mine = ds[variable].transpose("frame", "i", "j").values
        # Rounding of the dump, next to the largest of pressures that nearly cancel, with two digits to spare;
        # test_kinetic and test_potential have the sharp bounds, this one is about units, signs and frames.
        np.testing.assert_allclose(
            mine,
            theirs,
            rtol=0,
            atol=10.0 ** (2 - min(digits(what))) * np.abs([full(row, "v") for _, row in thermo.iterrows()]).max(),
        )
    reduced = "epsilon/sigma^3"
    assert (
        ds["virial_stress"].attrs["units"]
        == {"silicon_plate": "bar", "argon_slab": "atm", "melt": reduced, "heat_flow": reduced}[name]
    )
    inside = ds["mask"].values.astype(bool)
    main = "heat_flux" if name == "heat_flow" else "stress"
    assert (
        inside.any()
        and np.isfinite(ds[main].values[inside]).all()
        and np.isfinite(ds[f"{main}_potential"].values[inside]).all()
    )


@pytest.mark.parametrize("name, force, energy, virial", [("salt", 1e-4, 2e-6, 1e-3), ("water_slab", 2e-3, 2e-5, 2e-3)])
def test_long_range_runs(name, force, energy, virial):
    """Ewald, PPPM and SHAKE: forces, energy and virial of the frames are the run's as far as its own sum goes (asked for
    1e-6 and 1e-5 of the force of two unit charges at unit distance), and all constraints were found."""
    folder = DATA / name
    traj, thermo = atc.read(folder / f"{name}.dump.gz"), pd.read_csv(folder / "thermo.csv")
    pot = atc.potential(folder / f"in.{name}")
    pot = pot.settled(traj[0])
    assert len(traj) == len(thermo)
    for k in (0, len(traj) - 1):
        frame, row = pot.complete(traj[k]), thermo.iloc[k]
        mine, u = pot.stream(frame, forces=True), frame.units
        assert np.abs(mine.forces_nc - frame.forces).max() < force * np.abs(frame.forces).max()
        assert u.to_user("energy", mine.energy) == pytest.approx(row["pe"], rel=energy)
        theirs = -u.to_internal("pressure", full(row, "v")) * frame.cell.volume
        assert np.abs(mine.virial_cc - theirs).max() < virial * np.abs(theirs).max()
        assert (mine.held is None) == (name == "salt")


@pytest.mark.filterwarnings("ignore:.*error bars of fewer than")
def test_surface_tension_of_water_two_ways():
    """From the profile of the pressure and from the box; p_N is the same in the liquid, the surfaces and the vapour."""
    folder = DATA / "water_slab"
    traj, pot = atc.read(folder / "water_slab.dump.gz"), atc.potential(folder / "in.water_slab")
    film = atc.profile(traj, pot, atc.kernel("gaussian", radius=3.0), atc.Grid.slab("z", 140), tolerance=1e-5)
    profile, box = film["surface_tension"].value, film["surface_tension_box"].value
    assert abs(film["surface_tension_difference"].value) < 1e-3 * abs(profile) and profile == pytest.approx(
        box, rel=1e-3
    )
    # p_N is constant as far as its error bars tell.
    assert film["normal_deviation"].value < 2.0
    # Molecules are polar, and as many one way as the other in the liquid.
    middle = np.abs(film.z - 35.0) < 6.0
    assert np.abs(film["dipole_cosine"].values[middle].mean()) < 0.1
    assert film["density"].values[middle].mean() == pytest.approx(1.0, abs=0.06)
