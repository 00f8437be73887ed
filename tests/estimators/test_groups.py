"""Frames of a time average that are added up before their sums are finished: the same averages, errors that hold, and
the same result whoever computes it."""

import dataclasses
import warnings

import numpy as np
import pytest
from frames import argon
from naive_fields import BruteLJ
from test_run import Stop, same, stop_after

import atc
from atc.decomposers.outside import Friction, OutsideForces
from atc.errors import AtcError, AtcWarning
from atc.estimators import driver, forming, groups, runs
from atc.estimators.methods import Method
from atc.estimators.registry import QUANTITIES
from atc.estimators.work import Work
from atc.frame import Cell
from atc.plan import Request, plan, prepare
from atc.planning import calibrate, method_choice
from atc.planning.costs import Costs
from atc.running import collecting, run

KERN = atc.kernel("quartic", radius=5.5)
GRID = atc.Grid.regular(shape=(5, 4, 6))
LINEAR = [
    "number_density",
    "density",
    "momentum",
    "velocity",
    "stress_potential",
    "energy",
    "energy_flux",
    "peridynamic_stress",
]


def quiet(*args, **more):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        return atc.fields(*args, **{"threads": 1, "average": True, **more})


def both(monkeypatch, m, *args, **more):
    """The average in groups of m frames, and frame by frame."""
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: m if window >= m else 1)
    together = quiet(*args, **more)
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 1)
    return together, quiet(*args, **more)


def moving(frame, n, by=0.05, seed=0):
    rng = np.random.default_rng(seed)
    v = 0.0 if frame.velocities is None else frame.velocities
    return [
        frame.replace(
            positions=frame.positions + rng.normal(0, by, frame.positions.shape),
            velocities=v + rng.normal(0, 0.01, frame.positions.shape) + 0.01 * np.sin(k),
            step=k,
            source=f"frame {k}",
        )
        for k in range(n)
    ]


def close(a, b, rtol=1e-12):
    """All fields but the standard errors, which are made of other blocks."""
    for name in b.data_vars:
        if name.endswith(("_stderr", "_correlated")):
            continue
        x, y = a[name].values, b[name].values
        assert x.shape == y.shape and np.array_equal(np.isnan(x), np.isnan(y)), name
        np.testing.assert_allclose(x, y, rtol=0, atol=rtol * max(np.nanmax(np.abs(y)), 1e-300), err_msg=name)


@pytest.mark.parametrize("cell", ["orthogonal", "tilted", "slab"])
@pytest.mark.parametrize("what", [LINEAR, ["stress", "density", "velocity", "temperature", "virial_stress"]])
def test_exact_sums_are_those_of_single_frames(cell, what, monkeypatch):
    """11 frames in groups of 4: the last of three."""
    frames = moving(argon(cell), 11)
    together, single = both(monkeypatch, 4, frames, BruteLJ(), KERN, GRID, what, 1e-12)
    close(together, single)
    assert together.frames_averaged.values.tolist() == [11] and together.step.values.tolist() == [0]
    assert all(together[q].attrs["error_max"] < 1e-12 for q in what if "error_max" in together[q].attrs)


def test_every_field_that_is_called_linear_is(monkeypatch):
    """Many-body bonds, with sources that churn; every quantity on the grid that does not need a reference, one by
    one."""
    frame, pot = calibrate.silicon(2)
    frames = moving(frame.replace(velocities=np.zeros_like(frame.positions)), 4)
    pot = pot.partitioned("center")
    pot.acting = OutsideForces((Friction(gamma=0.1),))
    for name, q in QUANTITIES.items():
        work = Work.of([name])
        if not groups.added_up(work):
            assert not q.linear or work.on_reference
            continue
        together, single = both(
            monkeypatch, 4, frames, pot, atc.kernel("quartic", 4.0), atc.Grid.regular(shape=4), [name], 1e-12
        )
        if name != "churning_divergence":  # rounding
            close(together, single, 1e-11)


def test_what_is_added_up():
    def found(*names, central=True):
        return groups.added_up(Work.of(names, central))

    assert found("density", "velocity") == {"site"} and found("stress_potential") == {"bond"}
    assert found("stress_potential", "density", "energy") == {"site", "bond"}
    # σ_K frame by frame, σ_U together
    assert found("stress") == {"bond"} and found("stress", "density", "temperature", "virial_stress") == {"bond"}
    assert found("energy_flux") == {"site", "bond"}
    for names in (
        ("temperature",),
        ("heat_flux",),
        ("stress", "heat_flux"),
        ("energy_flux", "temperature"),
        ("virial_stress",),
    ):
        assert not found(*names)
    for names in (
        ("velocity_gradient",),
        ("piola_stress",),
        ("stress_potential", "virial_stress_per_atom"),
        ("peridynamic_stress_weighted_virial",),
    ):
        assert not found(*names)


def test_windows_keep_enough_blocks():
    assert [groups.size_of(w, 4000) for w in (1, 63, 64, 127, 128, 256, 511, 512, 10**6)] == [
        1,
        1,
        4,
        4,
        8,
        16,
        16,
        16,
        16,
    ]
    assert [groups.size_of(10**4, n) for n in (32_000, 64_000, 256_000, 10**6)] == [16, 8, 2, 1]
    frames = [argon()] * 300
    request = prepare(Request(frames, BruteLJ(), KERN, GRID, ["stress"], average=130))
    # two windows in groups of 8, and one of 40 frames
    sizes = list(request.groups())
    assert (
        sizes[:2] == [(0, 8), (8, 8)]
        and sizes[16:18] == [(128, 2), (130, 8)]
        and sizes[-40:] == [(k, 1) for k in range(260, 300)]
    )
    assert list(request.groups(146)) == [s for s in sizes if s[0] >= 146]
    assert "added up 8 at a time" in str(plan(request))
    for more in (
        {"average": False},
        {"average": 50},
        {"average": True, "grid": atc.Grid.atoms()},
        {"average": True, "tiles": (2, 1, 1)},
    ):
        assert (
            prepare(Request(frames, BruteLJ(), KERN, **{"grid": GRID, "quantities": ["stress"], **more})).group() == 1
        )
    other = argon().replace(cell=Cell([9.1, 10.0, 11.0], [-3.0, 2.0, 50.0]))
    assert prepare(Request([frames[0], other] * 100, BruteLJ(), KERN, GRID, ["stress"], average=True)).group() == 1


def test_a_cell_that_changes_ends_a_sum(monkeypatch):
    """And the parts of a group count as many frames as they have."""
    frames = moving(argon(), 12)
    wide = Cell([9.6, 10.0, 11.3], [-3.0, 2.0, 50.0])
    frames = [f.replace(cell=wide) if k in (2, 6, 7, 8) else f for k, f in enumerate(frames)]
    what = ["stress", "velocity", "temperature"]
    close(*both(monkeypatch, 4, frames, BruteLJ(), KERN, GRID, what, 1e-12))
    close(*both(monkeypatch, 4, frames, BruteLJ(), KERN, GRID, LINEAR, 1e-12))


def test_where_matter_comes_and_goes(monkeypatch):
    """Points without mass in some frames or in all of them: weights and masks are those of single frames."""
    one = argon(Cell([30.0, 9.0, 9.0]), n=(2, 1, 1), jitter=0.1)
    frames = [
        one.replace(positions=one.positions + [0.7 * k, 0, 0], velocities=one.velocities + [0.01 * k, 0, 0])
        for k in range(9)
    ]
    grid = atc.Grid.regular(shape=(20, 3, 3))
    for what in (["velocity", "density"], ["velocity", "temperature", "stress_potential"]):
        together, single = both(monkeypatch, 4, frames, BruteLJ(), atc.kernel("quartic", 3.0), grid, what, 1e-12)
        assert 0 < single.mask.values.mean() < 1
        close(together, single)


@pytest.fixture
def spectral_wins(monkeypatch):
    """Costs at which the exact sum is never chosen, though the frames are small."""
    slow = dataclasses.replace(Costs(), bond=1e-5, row=1e-6)
    monkeypatch.setattr(Costs, "load", classmethod(lambda cls: slow))
    monkeypatch.setattr(Costs, "visit_of", lambda self, compiled: 1e-6)
    monkeypatch.setattr(method_choice, "CHEAP", 0.0)
    monkeypatch.setattr(method_choice, "SEARCH", (0.0, 0.0))
    monkeypatch.setattr(method_choice, "WATCH", (0.0, 0.0, 0.0))


@pytest.mark.parametrize("system", ["hot", "gas", "silicon", "strong pair"])
@pytest.mark.parametrize("kernel, tolerances", [("gaussian", (1e-2, 1e-4, 1e-6)), ("lucy", (1e-2, 1e-3))])
def test_the_promise_at_every_point(system, kernel, tolerances, spectral_wins, monkeypatch):
    frame, pot = calibrate.silicon(3) if system == "silicon" else calibrate.argon(5)
    if system == "gas":
        k = np.random.default_rng(2).permutation(len(frame))[: len(frame) // 8]
        frame = frame.replace(
            positions=frame.positions[k], velocities=frame.velocities[k], masses=frame.masses[k], types=None, ids=None
        )
    frames = moving(frame.replace(velocities=np.zeros_like(frame.positions)), 5, 0.1)
    if system == "strong pair":  # in one frame only
        x = frames[2].positions
        x[5] = x[4] + [2.3, 0.1, 0]
    kern, grid, what = atc.kernel(kernel, 7.0), atc.Grid.regular(shape=10), ["stress", "density"]
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 1)
    exact = quiet(frames, pot, kern, grid, what, 1e-12)
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4)
    for tolerance in tolerances:
        together = quiet(frames, pot, kern, grid, what, tolerance)
        assert (
            "bonds: spectral" in together.attrs["method"] or together.attrs["method"] == "spectral" or tolerance < 1e-4
        )
        for name in ("stress", "stress_potential", "stress_kinetic", "density"):
            a, b = together[name].values, exact[name].values
            true, found = np.nanmax(np.abs(a - b)) / np.nanmax(np.abs(b)), together[name].attrs["error_max"]
            assert true <= tolerance and found <= tolerance, (name, tolerance, true, found)
            # of 1000 points 24 are looked at
            assert found >= 0.1 * true or true < 1e-3 * tolerance, (name, tolerance, true, found)


def test_the_strongest_bonds_of_all_frames_are_exact_and_the_rest_is_watched(spectral_wins, monkeypatch):
    """A bond a thousand times as strong as others in one of the frames leaves nothing; where the others make much, the
    points around them are looked at."""
    frame, pot = calibrate.argon(5)
    frames = moving(frame, 4)
    frames[2].positions[5] = frames[2].positions[4] + [2.0, 0.1, 0]
    kern, looked = atc.kernel("lucy", 7.0), []
    request = prepare(
        Request(frames, pot, kern, atc.Grid.regular(shape=10), ["stress_potential"], 1e-2, threads=1, average=True)
    )
    spectral, settings = {"bond": Method("spectral", 0.1)}, request.settings()
    points_around = forming.PointsAround
    monkeypatch.setattr(forming, "PointsAround", lambda *a: looked.append(1) or points_around(*a))
    done = []
    for goal, methods in ((1e-1, spectral), (1e-4, spectral), (1.0, {})):
        run = runs.Run.of(frames, settings, request.work, 0, goal)
        sums = runs.sum_up(run, methods)
        done.append((sums.bonds.strongest, forming.form(run, sums)))
        assert len(looked) == (goal == 1e-4) + (goal == 1.0)
    loose, close_, exact = (result.arrays["stress_potential"] for _, result in done)
    strongest = done[0][0]
    assert strongest.all.exactly >= 1 and np.array_equal(loose, close_)
    true = np.abs(loose - exact).max() / np.abs(exact).max()
    assert np.linalg.norm(strongest.exactly[1][0]) < 2.1  # the pair is the first of them
    for _, result in done[:2]:
        assert 0.1 * true <= result.errors["stress_potential"]["error_max"] <= max(3 * true, 1e-3)
    # without them the error is the pair's
    monkeypatch.setattr(runs, "summed_exactly", lambda *a: np.zeros((1000, 6)))
    run = runs.Run.of(frames, settings, request.work)
    result = forming.form(run, runs.sum_up(run, spectral))
    assert np.abs(result.arrays["stress_potential"] - exact).max() / np.abs(exact).max() > 5 * true


def test_a_group_with_too_large_an_error_is_computed_again(spectral_wins, monkeypatch):
    frame, pot = calibrate.argon(5)
    frames = moving(frame, 8)
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4)
    kern, grid = atc.kernel("lucy", 7.0), atc.Grid.regular(shape=8)
    request = prepare(Request(frames, pot, kern, grid, ["stress"], 1e-3, threads=1, average=True))
    methods = {"site": Method("spectral", 1e-2, "", (1e-3,)), "bond": Method("spectral", 0.5, "", (1e-2, 1e-3, 1e-4))}
    settings = dataclasses.replace(request.settings(), methods=methods)
    result = driver.fields_of(frames[4:], settings, 4)
    assert result.frames == 4 and "above" in str(result.refined[0]) and result.methods["bond"].tolerance < 0.5
    exact = driver.fields_of(frames[4:], dataclasses.replace(settings, methods={}), 4)
    for name in ("stress", "stress_kinetic", "stress_potential"):
        assert np.abs(result.arrays[name] - exact.arrays[name]).max() <= 1e-3 * np.abs(exact.arrays[name]).max()
    # and its frames are named
    monkeypatch.setattr(
        run, "fix_methods", lambda request, store, start, anchor: request.methods.update(result_of_settling)
    )
    result_of_settling = {"site": Method("spectral", 1e-3), "bond": Method("spectral", 0.5, "", (1e-2, 1e-3, 1e-4))}
    ds = quiet(frames, pot, kern, grid, ["stress"], 1e-3)
    assert ds.attrs["refinements"].startswith("frames 0-7:") and ds.attrs["measured_error"] <= 1e-3


def trajectory(n):
    return moving(argon(), n)


@pytest.mark.parametrize("average, stop", [(True, 4), (True, 8), (6, 4), (6, 6), (6, 14)])
def test_interrupted_averages_continue_bit_for_bit(tmp_path, average, stop, monkeypatch):
    """Stopped between groups of a window: what was done is not computed again."""
    monkeypatch.setattr(collecting, "_SAVE_EVERY", 0.0)
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4 if window >= 4 else 1)
    arguments = (trajectory(15), BruteLJ(), KERN, GRID, ["stress", "velocity"], 1e-6)
    out = tmp_path / "o.zarr"
    with pytest.raises(Stop):
        quiet(*arguments, average=average, out=out, progress=stop_after(stop))
    seen = []
    again = quiet(*arguments, average=average, out=out, progress=lambda done, total, rate: seen.append(done))
    assert seen[0] == stop and seen[-1] == 15
    whole = quiet(*arguments, average=average)
    same(whole, again)
    assert whole.frames_averaged.values.tolist() == ([15] if average is True else [6, 6, 3])


def test_processes_and_threads_give_the_same(monkeypatch):
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4 if window >= 4 else 1)
    frame, pot = calibrate.argon(4)
    arguments = (moving(frame, 14), pot, atc.kernel("gaussian", 6.0), GRID, ["stress", "velocity"], 1e-4)
    serial = quiet(*arguments)
    same(serial, quiet(*arguments, workers=2))
    # sums in another order
    close(quiet(*arguments, threads=2), serial, 2e-6)


def test_a_kept_list_serves_the_frames_of_a_group(monkeypatch):
    frame, pot = calibrate.argon(5)
    frames = moving(frame, 8, 0.02)
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4)
    request = prepare(Request(frames, pot, KERN, GRID, ["stress"], 1e-12, threads=1, average=True))
    anchor = run.anchor_of(request)
    assert anchor is not None
    kept = quiet(*(frames, pot, KERN, GRID, ["stress"], 1e-12))
    assert all(anchor.moved(f) is not None for f in frames)
    monkeypatch.setattr(run, "anchor_of", lambda request: None)
    close(quiet(*(frames, pot, KERN, GRID, ["stress"], 1e-12)), kept)


def test_errors_of_the_mean_are_those_of_single_frames():
    """128 frames, eight at a time: the standard errors of blocks, of many points together."""
    frames = [f.replace(velocities=f.velocities - 0.01 * np.sin(k)) for k, f in enumerate(moving(argon(), 128, 0.15))]
    assert prepare(Request(frames, BruteLJ(), KERN, GRID, ["stress"], average=True)).group() == 8
    ds = quiet(frames, BruteLJ(), KERN, GRID, ["stress", "velocity"], 1e-12)
    each = quiet(frames, BruteLJ(), KERN, GRID, ["stress", "velocity"], 1e-12, average=False)
    for name in ("stress", "velocity"):
        x, w = each[name].values, 1.0
        if name == "velocity":
            w = quiet(frames, None, KERN, GRID, ["density"], 1e-12, average=False).density.values[..., None]
            w = w / w.mean(0)
        mean = (w * x).mean(0)
        np.testing.assert_allclose(ds[name].values[0], mean, rtol=0, atol=1e-12 * np.abs(x).max())
        naive = np.sqrt(np.mean((w * (x - mean)) ** 2) / 128)
        # frames are independent: σ/√n, and no blocks that correlate
        assert abs(np.sqrt(np.mean(ds[name + "_stderr"].values ** 2)) / naive - 1) < 0.1
        assert ds[name + "_correlated"].values.mean() < 0.1


def test_frames_that_lack_something_are_named(monkeypatch):
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 4)
    frames = trajectory(8)
    frames[6] = frames[6].replace(velocities=None)
    with pytest.raises(AtcError, match="frame 6.*velocities"):
        quiet(frames, BruteLJ(), KERN, GRID, ["stress"])
