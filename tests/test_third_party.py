"""Input that others made: the argon TNG of MDAnalysisTests (GROMACS, 1000 atoms, with velocities and forces)."""

import numpy as np
import pytest

import atc

# Least squares on frame 0's own forces: V = C12/r^12 - C6/r^6, in kJ/mol and nm, cutoff 1.0 nm.
C6, C12 = 0.00585607, 8.20320e-6
SIGMA = 10 * (C12 / C6) ** (1 / 6)  # Å
EPSILON = C6**2 / (4 * C12)  # kJ/mol
MODEL = f"pair_style lj/cut 10.0\npair_coeff 1 1 {EPSILON!r} {SIGMA!r}"


@pytest.fixture(scope="module")
def argon():
    import MDAnalysis as mda
    from MDAnalysisTests import datafiles

    universe = mda.Universe(datafiles.TNG_traj_gro, datafiles.TNG_traj_vels_forces)
    return atc.read(universe, masses={1: 39.948})


def rms(a):
    return float(np.sqrt((np.asarray(a) ** 2).mean()))


def test_forces_of_frame_0_agree_with_the_file(argon):
    frame = argon[0]
    forces = atc.potential(MODEL, units="mdanalysis").decompose(frame).forces_nc
    # C6 and C12 are given to six digits; the file stores forces with 1e-4 kJ/mol/nm or better and this frame's
    # positions exactly.
    assert rms(forces - frame.forces) < 2e-5 * rms(frame.forces)


@pytest.mark.parametrize("k", [1, 25, -1])
def test_forces_of_later_frames_agree_to_the_rounding_of_their_positions(argon, k):
    """Later frames were rounded to 0.01 Å when written; the forces in the file were not. The difference must be what
    such rounding does."""
    frame = argon[k]
    assert np.abs(frame.positions / 0.01 - np.rint(frame.positions / 0.01)).max() < 0.01
    potential = atc.potential(MODEL, units="mdanalysis")
    forces = potential.decompose(frame).forces_nc
    rng = np.random.default_rng(0)
    noise = rng.uniform(-0.005, 0.005, frame.positions.shape)
    expected = rms(potential.decompose(frame.replace(positions=frame.positions + noise)).forces_nc - forces)
    # Both are rms over 3000 numbers of a heavy-tailed error: 25 % covers their scatter, a wrong image or unit would be
    # far outside.
    assert rms(forces - frame.forces) == pytest.approx(expected, rel=0.25)


def test_temperature_and_density_are_those_of_the_run(argon):
    pot = atc.potential(MODEL, units="mdanalysis")
    ds = atc.fields(
        argon[0],
        pot,
        atc.kernel("quartic", radius=10.0),
        atc.Grid.regular(shape=(4, 4, 4)),
        ["density", "temperature", "stress"],
    )
    frame = argon[0]
    v = frame.velocities - frame.velocities.mean(axis=0)
    kelvin = (frame.masses[:, None] * v**2).sum() / (3 * len(frame) * frame.units.boltzmann)
    # The mean of a local temperature over points differs from the global one by the velocity fluctuations removed
    # locally (about 1/atoms per kernel).
    assert float(ds.temperature.mean()) == pytest.approx(kelvin, rel=0.05)
    assert 80 < kelvin < 100  # liquid argon; a wrong velocity unit would be off by 100 or more
    # 1000 atoms of 39.948 amu in (36.014 Å)³; φ on 4³ points is not resolved to better than some percent.
    assert float(ds.density.mean()) == pytest.approx(1000 * 39.948 / 36.014**3, rel=0.03)
