"""The strongest bonds of a frame: summed exactly, watched, and what a pilot pass expects of the others."""

import dataclasses
import warnings

import numpy as np
import pytest

import atc
from atc.deposit import make
from atc.errors import AtcWarning
from atc.estimators import driver, forming, runs
from atc.estimators.accuracy import strongest_bonds as hot
from atc.estimators.methods import Method
from atc.frame import Cell
from atc.plan import Request, prepare
from atc.planning import method_choice
from atc.planning.calibrate import argon, silicon
from atc.planning.costs import Costs
from atc.planning.error_forecast import ErrorForecast

GRID = atc.Grid.regular(shape=14)


@pytest.fixture(autouse=True)
def as_of_a_long_run(monkeypatch):
    """One frame begins as the first of many does, looser where the forecast says so."""
    monkeypatch.setattr(method_choice, "LOOK", np.inf)


@pytest.fixture(scope="module", autouse=True)
def spectral_wins():
    """Costs at which the exact sum is never chosen, though the frames are small."""
    slow = dataclasses.replace(Costs(), bond=1e-5, row=1e-6)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Costs, "load", classmethod(lambda cls: slow))
        patch.setattr(Costs, "visit_of", lambda self, compiled: 1e-6)
        patch.setattr(method_choice, "CHEAP", 0.0)
        yield


def sums_of(frame, pot, kern, method, what="stress_potential", threads=1, grid=GRID):
    request = prepare(Request(frame, pot, kern, grid, [what], max(method.tolerance, 1e-9), threads=threads))
    run = runs.Run.of([frame], request.settings(), request.work)
    return run, runs.sum_up(run, {"bond": method})


def around(n, a, shake, more=(), cell=None):
    """Argon, n³ cells of fcc, shaken, with more atoms."""
    frame, pot = argon(2)
    rng = np.random.default_rng(n)
    basis = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    x = (np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 1, 3) + basis).reshape(-1, 3) * a
    x = x + rng.normal(0, shake, x.shape)
    x = np.concatenate([x, np.array(more).reshape(-1, 3) + x[0]])
    v = rng.normal(0, 0.02, x.shape)
    return frame.replace(
        positions=x, velocities=v, cell=cell or Cell([n * a] * 3), masses=np.full(len(x), 39.948), types=None, ids=None
    ), pot


@pytest.mark.parametrize("what", ["pairs", "triplets", "tilted", "heat"])
def test_few_atoms_around_the_points_give_the_sums_of_all(what, monkeypatch):
    if what == "triplets":
        frame, pot = silicon(13)
    else:
        frame, pot = argon(14)
    if what == "tilted":
        tilt = np.array([[1, 0, 0], [0.4, 1, 0], [-0.3, 0.2, 1.0]])
        frame = frame.replace(
            positions=frame.positions @ tilt + [1e4, 0, -3], cell=Cell(frame.cell.vectors @ tilt, [1e4, 0, -3])
        )
    run, sums = sums_of(
        frame,
        pot,
        atc.kernel("quartic", 5.0),
        Method("spectral", 1e-2),
        "heat_flux" if what == "heat" else "stress_potential",
    )
    points, _ = forming.look_around(run, sums.here, sums.bonds)
    assert (
        len(points) > 10
        and points._cluster(frame, pot, 5.0) is not None
        and len(points._cluster(frame, pot, 5.0)) < 0.5 * len(frame)
    )
    few = points.bond_sums(frame, pot, run.work, run.drifts[0])
    monkeypatch.setattr(hot.PointsAround, "_cluster", lambda *_: None)
    np.testing.assert_allclose(
        few, points.bond_sums(frame, pot, run.work, run.drifts[0]), rtol=0, atol=1e-12 * np.abs(few).max()
    )


def test_the_strongest_bonds_do_not_depend_on_threads():
    frame, pot = argon(8)
    found = []
    for threads in (1, 2, 3):
        strongest = hot.StrongestBonds(frame.positions, threads)
        pot.stream(frame, strongest.add, threads=threads)
        found.append(strongest)
    bonds = pot.decompose(frame).bonds
    size = np.abs(bonds.G_b) * (bonds.r_bc**2).sum(1)
    ranked = found[0].ranked()
    assert len(ranked) == found[0].most
    # keys of nearly equal bonds differ by a percent at most
    np.testing.assert_allclose(
        np.abs(ranked.G_b) * (ranked.r_bc**2).sum(1), np.sort(size)[::-1][: len(ranked)], rtol=0.011
    )
    for other in found[1:]:
        for name in ("i", "j", "r_bc", "G_b"):
            np.testing.assert_array_equal(getattr(ranked, name), getattr(other.ranked(), name))


def test_a_crystal_has_strongest_bonds_too():
    """All its bonds are equal."""
    frame, pot = around(5, 5.3, 0.0)
    strongest = hot.StrongestBonds(frame.positions, 2)
    pot.stream(frame, strongest.add, threads=2)
    again = hot.StrongestBonds(frame.positions, 1)
    pot.stream(frame, again.add, threads=1)
    assert len(strongest.ranked()) == strongest.most and not len(strongest.sort_out())
    np.testing.assert_array_equal(strongest.ranked().r_bc, again.ranked().r_bc)


def true_error(ds, exact, name):
    return float(np.nanmax(np.abs(ds[name].values - exact[name].values)) / np.nanmax(np.abs(exact[name].values)))


@pytest.mark.parametrize(
    ("system", "kernel"),
    [
        *[(s, k) for s in ("hot", "one pair", "wire", "silicon") for k in ("gaussian", "lucy")],
        ("hot", "quartic"),
        ("silicon", "quartic"),
    ],
)
def test_the_promise_at_every_point(system, kernel):
    """Hot argon, whose stress a few bonds make; one strong pair in a crystal; a wire in a box; silicon, whose errors
    are the largest for what is asked."""
    if system == "hot":
        frame, pot = argon(9)
    elif system == "one pair":
        frame, pot = around(8, 5.4, 0.05, [[2.3, 0.1, 0]])
    elif system == "wire":
        frame, pot = around(9, 5.3, 0.1)
        keep = ((frame.positions[:, :2] - 24.0) ** 2).sum(1) < 9**2
        frame = frame.replace(
            positions=frame.positions[keep],
            velocities=frame.velocities[keep],
            masses=frame.masses[keep],
            types=None,
            ids=None,
        )
    else:
        frame, pot = silicon(5)
    kern = atc.kernel(kernel, 8.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        exact = atc.fields(frame, pot, kern, GRID, ["stress"], 1e-12, threads=1)
        for tolerance in (1e-2, 1e-3, 1e-4)[: 2 if kernel != "gaussian" else 3]:
            ds = atc.fields(frame, pot, kern, GRID, ["stress"], tolerance, threads=1)
            assert "bonds: spectral" in ds.attrs["method"] or ds.attrs["method"] == "spectral"
            for name in ("stress", "stress_potential"):
                true, found = true_error(ds, exact, name), ds[name].attrs["error_max"]
                assert true <= tolerance and found <= tolerance
                assert found >= 0.3 * true


def test_one_strong_bond_does_not_spoil_the_sum():
    """What a bond 10⁴ times as strong as others makes is exact: the error is that of the others."""
    frame, pot = around(8, 5.4, 0.05, [[2.3, 0.1, 0]])
    kern = atc.kernel("quartic", 8.0)
    bonds = pot.decompose(frame).bonds
    exact = make("direct", bound := GRID.bind(frame.units, frame.cell), kern, frame.cell, 0, 6)
    plain = make("spectral", bound, kern, frame.cell, 0, 6, tolerance=1e-2)
    for d in (exact, plain):
        d.add_bond_stress(frame.positions, bonds.i, bonds.r_bc, bonds.G_b)
    want = exact.bond_sums()
    mended = sums_of(frame, pot, kern, Method("spectral", 1e-2))[1].grid.bond["stress"]
    before, after = (np.abs(s - want).max() / np.abs(want).max() for s in (plain.bond_sums(), mended))
    assert after < 0.1 * before


def test_a_pilot_expects_what_comes():
    """The error it expects at several tolerances, against the one at all points."""
    for frame, pot in (argon(9), silicon(5)):
        for kern in (atc.kernel("gaussian", 8.0), atc.kernel("lucy", 8.0)):
            bound = GRID.bind(frame.units, frame.cell)
            pilot = ErrorForecast(pot, frame, bound, kern, 1e-3)
            exact = sums_of(frame, pot, kern, Method())[1].grid.bond["stress"]
            for t in (1e-2, 1e-3):
                expected = pilot.error(method_choice.spectral_deposit(bound, kern, frame.cell, 1, t))
                true = (
                    np.abs(sums_of(frame, pot, kern, Method("spectral", t))[1].grid.bond["stress"] - exact).max()
                    / np.abs(exact).max()
                )
                assert 0.4 * true < expected < 8 * true


def test_a_coherent_stress_begins_looser_and_one_that_cancels_does_not():
    kern, what = atc.kernel("gaussian", 8.0), ["stress_potential"]
    frame, pot = argon(9)
    coherent = prepare(Request(frame, pot, kern, GRID, what, 1e-4, threads=1)).methods["bond"]
    assert (
        coherent.name == "spectral"
        and coherent.tolerance >= 4e-4
        and 1e-4 in [pytest.approx(r) for r in coherent.rungs]
    )
    frame, pot = silicon(5)
    assert prepare(Request(frame, pot, kern, GRID, what, 1e-4, threads=1)).methods["bond"].tolerance == 1e-4
    # Not beyond what single precision holds.
    frame, pot = argon(9)
    assert prepare(Request(frame, pot, kern, GRID, what, 1e-7, threads=1)).methods["bond"].tolerance < 1e-5


def test_a_start_too_loose_is_mended(monkeypatch):
    """Whatever the pilot thought: the check sees it, the next try is the one that the error found asks for."""
    monkeypatch.setattr(ErrorForecast, "error", lambda self, deposit: 0.0)
    monkeypatch.setattr(ErrorForecast, "at_random", lambda self, tolerance: 0.0)
    frame, pot = silicon(5)
    kern = atc.kernel("lucy", 8.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        exact = atc.fields(frame, pot, kern, GRID, ["stress_potential"], 1e-12, threads=1)
        ds = atc.fields(frame, pot, kern, GRID, ["stress_potential"], 1e-3, threads=1)
    request = prepare(Request(frame, pot, kern, GRID, ["stress_potential"], 1e-3, threads=1))
    assert request.methods["bond"].tolerance > 1e-2
    assert true_error(ds, exact, "stress_potential") <= 1e-3
    assert len(driver.fields_of([frame], request.settings()).refined) <= 2
