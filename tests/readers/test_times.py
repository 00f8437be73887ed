"""Steps that repeat, go back or leave gaps, and a time step that changes: seen by everything that forms time series."""

import re
import warnings

import numpy as np
import pytest

import atc
from atc.errors import AtcError, AtcWarning
from atc.frame import Cell, Frame
from atc.readers.times import Clock
from atc.units import units

LJ = "pair_style lj/smooth/linear 2.5\npair_coeff * * 1.0 1.0"


def frames(steps, dt=0.005, times=True, types=None, seed=0):
    """A crystal that vibrates, in lj units; step and time of frame k are those of `steps`."""
    a = 1.6
    base = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    x0 = a * (base + np.stack(np.meshgrid(*[np.arange(2)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)).reshape(-1, 3)
    out = []
    for step in steps:
        r = np.random.default_rng([seed, step])
        x = x0 + r.normal(0, 0.02, x0.shape)
        time, source = step * dt if times else None, f"run.dump frame {len(out)}"
        v = r.normal(0, 0.3, x0.shape)
        cell = Cell(np.full(3, 2 * a))
        out.append(
            Frame(
                x, cell, units("lj"), types=types, masses=np.ones(32), velocities=v, step=step, time=time, source=source
            )
        )
    return out


POT = atc.potential(LJ, units="lj")
EVEN = [0, 100, 200, 300, 400, 500]


@pytest.mark.parametrize("dt", [None, 0.5])
@pytest.mark.parametrize("times", [True, False])
@pytest.mark.parametrize(
    "steps, message",
    [
        ([0, 100, 200, 100, 200, 300], r"goes back: frame 3 \(step 100\) comes after frame 2 \(step 200\)"),
        (
            [0, 100, 200, 400, 500, 600],
            r"frame 3 \(step 400\) comes (1 tau|200 steps) after frame 2 \(step 200\), those before are (0.5 tau|100) "
            r"apart",
        ),
        ([0, 100, 200, 250, 300, 350], r"frame 3 \(step 250\) comes"),
    ],
)
def test_conductivity_refuses(steps, message, times, dt):
    """With and without dt: a series that is none is refused at the frame where it breaks, before the rest is
    computed."""
    if not times and dt is None:
        message = message + "|do not know their time"
    with pytest.raises(AtcError, match=message) as e:
        atc.heat_currents(frames(steps=steps, times=times), POT, dt=dt)
    assert "\n" not in str(e.value)


def test_a_step_with_other_atoms_repeats():
    run = frames(steps=EVEN)
    run.insert(3, run[2].replace(velocities=-run[2].velocities))
    for given in (run, [f.replace(time=None) for f in run]):
        with pytest.raises(AtcError, match=r"repeats: frame 3 \(step 200\) comes after frame 2 \(step 200\)"):
            atc.heat_currents(given, POT, dt=0.5)


def test_the_frame_that_a_continued_run_writes_again_is_left_out():
    """It is there twice, wrapped otherwise: the series is that without it, and a note says so."""
    run = frames(steps=EVEN)
    again = run[2].replace(positions=run[2].positions + np.array([3.2, 0, -3.2]))
    found = atc.heat_currents([*run[:3], again, *run[3:]], POT)
    plain = atc.heat_currents(run, POT)
    np.testing.assert_array_equal(found.J_tc, plain.J_tc)
    assert (
        found.dt == pytest.approx(0.5)
        and "frame 3 (step 200) is frame 2 (step 200) once more" in found.notes[0]
        and not plain.notes
    )


def test_times_account_for_steps():
    """Steps that were reset, or dumped at equal times with an adaptive time step, are no fault where the times go on
    evenly."""
    run = [f.replace(step=s) for f, s in zip(frames(steps=EVEN), [0, 100, 200, 0, 50, 100], strict=True)]
    assert atc.heat_currents(run, POT).dt == pytest.approx(0.5)


def test_a_change_of_the_time_step_is_seen():
    run = [f.replace(time=t) for f, t in zip(frames(steps=EVEN), [0, 0.5, 1.0, 1.5, 1.75, 2.0], strict=True)]
    for dt in (None, 0.5):
        with pytest.raises(AtcError, match=r"the time step changes from 0.005 to 0.0025 tau at frame 3 \(step 300\)"):
            atc.heat_currents(run, POT, dt=dt)


def test_dt_against_times():
    """dt goes before the file's times, which may be in other units, but not without a word."""
    found = atc.heat_currents(frames(steps=EVEN), POT, dt=2.0)
    assert (
        found.dt == 2.0
        and "dt = 2 tau goes before the times of the frames, by which they are 0.5 tau apart" in found.notes[0]
    )
    bare = [f.replace(step=None, time=None) for f in frames(steps=EVEN)]
    assert "could not be checked" in atc.heat_currents(bare, POT, dt=2.0).notes[0]
    assert not atc.heat_currents([f.replace(time=None) for f in frames(steps=EVEN)], POT, dt=0.5).notes


def test_times_in_single_precision_are_even():
    run = [f.replace(time=float(np.float32(1e5 + 0.5 * k))) for k, f in enumerate(frames(steps=EVEN))]
    clock = Clock("a test")
    assert all(clock.follows(f) for f in run) and clock.spacing() == pytest.approx(0.5, rel=1e-2)


def mixture(drift, **more):
    """Atoms of type 2 that wander off through the cell."""
    types = np.where(np.arange(32) % 4 == 0, 2, 1)
    run = frames(steps=range(0, 1200, 100), types=types, **more)
    w = np.random.default_rng(5).normal(0, 1, (32, 3)) * (types == 2)[:, None]
    return [f.replace(positions=f.positions + drift * k * w) for k, f in enumerate(run)]


def test_a_mixture_that_diffuses_gets_a_note():
    """Of the partial enthalpies: where a species gets far, but not where it only vibrates, or where molecules of one
    kind move as wholes."""
    notes = atc.heat_currents(mixture(0.15), POT).notes
    assert (
        len(notes) == 1
        and "a mixture whose species diffuse (type 2 by " in notes[0]
        and "partial enthalpies" in notes[0]
    )
    assert not atc.heat_currents(mixture(0.001), POT).notes
    one = [f.replace(types=np.ones(32, int)) for f in mixture(0.15)]
    assert not atc.heat_currents(one, POT).notes
    pairs = atc.Topology(bonds=np.arange(32).reshape(16, 2), bond_types=np.ones(16, int))
    types = np.tile([1, 2], 16)
    from atc.analysis.heat_currents import species

    kinds, names = species(mixture(0.1)[0].replace(types=types, topology=pairs))
    assert len(set(kinds.tolist())) == 1 and names == ["molecules of 1 type 1 + 1 type 2"]
    kinds, names = species(mixture(0.1)[0].replace(topology=pairs))
    assert len(names) == 2


def test_the_note_reaches_the_conductivity():
    currents = atc.heat_currents(mixture(0.15), POT)
    currents.J_tc = np.random.default_rng(0).normal(0, 1, (2000, 3))
    with pytest.warns(AtcWarning, match="partial enthalpies"):
        assert any("partial enthalpies" in n for n in atc.conductivity(currents).notes)


# --- fields


def fields(run, **more):
    return atc.fields(
        run, POT, atc.kernel("quartic", radius=1.5), atc.Grid.regular(shape=(3, 3, 3)), ["density"], **more
    )


def test_fields_names_frames_that_are_there_twice():
    run = frames(steps=[0, 100, 200, 200, 300, 100, 200])
    with pytest.warns(
        AtcWarning,
        match=r"frame 3 \(step 200\) after 2 \(step 200\), 5 \(step 100\) after 4 \(step 300\): duplicates of a "
        r"restart",
    ):
        fields(run)
    with pytest.warns(AtcWarning, match="they count twice in the average"):
        fields(run, average=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error", AtcWarning)
        fields(frames(steps=EVEN), average=True)
        fields(frames(steps=[0, 100, 200, 1000]))


def test_averages_over_unequal_distances_say_so():
    with pytest.warns(
        AtcWarning,
        match=r"frame 3 comes 8 times as long after frame 2 as the first two are apart\): the average gives each the "
        r"same weight",
    ):
        fields(frames(steps=[0, 100, 200, 1000]), average=True)


# --- dispersion


def test_dispersion():
    """Spectra need equal distances and say which frame is out of step; steps that go back are refused, a frame written
    twice is left out."""
    from atc.upscaling.amplitudes import amplitudes

    crystal = atc.Crystal.cubic("fcc", 1.6, [1.0], "lj")

    def gamma(sites):
        return np.array([[2 * np.pi / 3.2, 0, 0]])

    even = amplitudes(frames(steps=EVEN), crystal, gamma)
    assert even.dt == pytest.approx(0.5) and not even.notes
    gap = amplitudes(frames(steps=[0, 100, 200, 400, 500]), crystal, gamma)
    assert gap.dt is None and "not equally spaced in time: frame 3 (step 400) comes 1 tau after frame 2" in " ".join(
        gap.notes
    )
    with pytest.raises(AtcError, match="goes back"):
        amplitudes(frames(steps=[0, 100, 200, 100]), crystal, gamma)
    run = frames(steps=EVEN)
    twice = amplitudes([*run[:3], run[2], *run[3:]], crystal, gamma)
    assert twice.dt == pytest.approx(0.5) and len(twice.u_tkx) == 6 and "once more" in twice.notes[0]


# --- check


@pytest.mark.parametrize(
    "steps, message",
    [
        ([0, 100, 200, 200, 300], r"time does not increase from frame 2 \(step 200\) to frame 3 \(step 200\)"),
        (
            [0, 100, 200, 400, 500],
            r"from frame 2 \(step 200\) to frame 3 \(step 400\) 1 tau a frame, from frame \d \(step \d+\) to frame \d "
            r"\(step \d+\) 0.5",
        ),
    ],
)
@pytest.mark.parametrize("timestep", [None, 0.005])
def test_check_names_the_frame(steps, message, timestep):
    from atc.analysis.check import check

    run = frames(steps=steps, times=timestep is None)
    report = check(run, POT, atc.kernel("quartic", radius=1.5), points=3, timestep=timestep)
    note = next(n for n in report.notes if "no differences between frames" in n)
    assert re.search(message, note), note
