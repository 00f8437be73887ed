"""Coarse models at equal cost, the two reports, and ``atc upscale``."""

import json
import math

import numpy as np
import pytest
import xarray as xr
from typer.testing import CliRunner

from atc.cli import app
from atc.errors import AtcError
from atc.upscaling.chain import Springs, bump
from atc.upscaling.coarse import METHODS, accuracy_table, coarsen
from atc.upscaling.evolve import modal, relative_error, verlet

FINE = Springs.paper(0.25, 20)


def table(*models, **kwargs):
    return accuracy_table(FINE, bump, length=1000.0, t=150.05, duration=300.0, models=models, **kwargs)


def test_accuracy_at_equal_cost():
    """Exact-in-time errors of formulas for M = 10, Δx = 2a: 25 %, 20 %, 4.2 %, 0.7 %, 1e-5."""
    rows = {r.method: r for r in table(*((m, 0.5, 10) for m in METHODS))}
    for method, error, within in (
        ("paper", 0.2505, 5e-4),
        ("trapezoid", 0.2018, 5e-4),
        ("moments-2", 0.0420, 5e-4),
        ("moments-4", 0.0070, 1e-4),
    ):
        assert rows[method].error == pytest.approx(error, abs=within)
    assert rows["band"].error < 2e-5
    assert rows["band"].cost < rows["paper"].cost == pytest.approx(0.22016, abs=5e-6)
    assert all(r.stable and r.least_weight >= 0 for r in rows.values())
    # With Verlet's error at the paper's own step, the fit that counts it in is twice as close as any other.
    assert rows["band-in-time"].error_verlet < 0.55 * min(
        r.error_verlet for m, r in rows.items() if m != "band-in-time"
    )
    # Four times the spacing and a twentieth of the cost: still better than the paper's weights at a fifth.
    (quarter,) = table(("band", 1.0, 5))
    assert quarter.error < 0.01 and quarter.cost < 0.05


@pytest.mark.parametrize("M, safety, band, least, cost", [(8, 0.6, 0.5, 0.015, 0.08), (12, 0.3, 0.7, 1e-4, 0.17)])
def test_band_in_time_is_what_verlet_does(M, safety, band, least, cost):
    """The error in the table is the error of a real run: at Δx = 4a 1.3 % for 7.5 % of the chain's cost, 5e-5 for 16 %,
    time step included (the paper's weights: 44 % for 22 %)."""
    (row,) = table(("band-in-time", 1.0, M), safety=safety, band=band)
    assert row.cost < cost
    model = coarsen(FINE, 1.0, M, "band-in-time", band, row.time_step)
    assert model.weights.min() >= 0
    steps = round(150.05 / row.time_step)
    t = steps * row.time_step
    exact, _ = modal(FINE, bump(np.arange(4000) * 0.25), t)
    run = verlet(model, bump(np.arange(1000.0)), dt=row.time_step, steps=steps, every=steps)
    error = relative_error(run.u_tn[-1], exact[::4])
    assert error < least
    (at,) = accuracy_table(
        FINE, bump, length=1000.0, t=t, duration=300.0, models=[("band-in-time", 1.0, M)], safety=safety, band=band
    )
    assert error == pytest.approx(at.error_verlet, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("spacing, M", [(0.5, 10), (1.0, 5), (0.25, 20)])
def test_sound_speed_is_kept(method, spacing, M):
    fine = Springs.paper(0.25, 20, modulus=2.3, density=1.7)
    coarse = coarsen(fine, spacing, M, method)
    assert coarse.modulus == pytest.approx(fine.modulus, rel=1e-12) and coarse.density == 1.7 and coarse.neighbors == M


def test_moments_and_band():
    four = coarsen(FINE, 0.5, 10, "moments-4")
    for p in (2, 4, 6, 8):
        assert four.moment(p) == pytest.approx(FINE.moment(p), rel=1e-9)
    assert four.moment(10) != pytest.approx(FINE.moment(10), rel=1e-3)
    band = coarsen(FINE, 0.5, 10, "band", band=0.5)
    k = np.linspace(0, math.pi, 1001)[1:]
    assert band.weights.min() >= 0
    assert np.abs(band.frequency(k) / FINE.frequency(k) - 1).max() < 2e-6
    # the chain itself is found when nothing has to be coarsened
    np.testing.assert_allclose(coarsen(FINE, 0.25, 20, "moments-3").weights, FINE.weights, rtol=1e-9)
    np.testing.assert_allclose(coarsen(FINE, 0.25, 20, "band", band=1.0).frequency(k), FINE.frequency(k), rtol=1e-7)


def test_unstable_models_are_said_to_be():
    """Two moments with 3 neighbours need negative weights: ω² < 0 somewhere, no error is claimed."""
    (row,) = table(("moments-2", 0.5, 3))
    assert not row.stable and math.isnan(row.error) and row.least_weight < 0


@pytest.mark.parametrize(
    "args, message",
    [
        ((1.0, 5, "spline"), "expected paper, trapezoid"),
        ((1.0, 3, "moments-5"), "no more than 3 weights"),
        ((1.0, 1, "trapezoid"), "2 neighbours"),
        ((1.0, 5, "band", 1.5), "part of the coarse chain's zone"),
        ((0.5, 10, "band-in-time", 0.9, 5.0), "half a period"),
    ],
)
def test_refused(args, message):
    with pytest.raises(AtcError, match=message):
        coarsen(FINE, *args)


# --------------------------------------------------------------------------------------------------------------------
# Reports and the command line.


def run(*args):
    return CliRunner().invoke(app, ["upscale", *map(str, args)], prog_name="atc")


def test_lennard_jones_report(tmp_path):
    result = run("lj", "-o", tmp_path / "lj")
    assert result.exit_code == 0, result.output
    folder = tmp_path / "lj"
    numbers = json.loads((folder / "numbers.json").read_text())
    claims = {c["where"]: c for c in numbers["claims"]}
    assert claims["(5.2), (5.4)"]["verdict"] == "reproduces"
    assert claims["§5.3"]["verdict"] == "does not reproduce" and "beyond the spinodal" in claims["§5.3"]["measured"]
    drift = [e["largest_relative_change"] for e in numbers["energy"].values()]
    assert len(drift) == 3 and max(drift) < 2e-3
    assert numbers["energy_drift_half_step"] < 0.3 * drift[0]
    page = (folder / "report.html").read_text()
    for name in ("fig_5_1_density", "fig_5_2_energies"):
        assert (folder / f"{name}.png").stat().st_size > 10_000 and name in page
    with xr.open_dataset(folder / "md.nc") as ds:
        assert ds.sizes["x"] == 1001 and np.isfinite(ds.displacement).all()
    assert "(5.2), (5.4)" in result.output


@pytest.mark.slow
def test_springs_report(tmp_path):
    """The whole of section 4, at the paper's sizes: about half a minute."""
    result = run("springs", "-o", tmp_path / "springs")
    assert result.exit_code == 0, result.output
    folder = tmp_path / "springs"
    numbers = json.loads((folder / "numbers.json").read_text())
    cost = numbers["table_4_1"]
    assert (cost["MD"]["steps"], cost["PD coarse"]["steps"]) == (184, 162)
    assert cost["PD coarse"]["relative_cost"] == pytest.approx(0.22016, abs=5e-6)
    errors = numbers["profile_errors"]
    assert errors["peridynamics, δ = Na"] == pytest.approx(0.236, abs=1e-3)
    assert errors["peridynamics, δ = a√(N(N+1))"] == pytest.approx(0.0055, abs=1e-4)
    assert numbers["ccm_against_dalembert"] < 0.03 and numbers["clamped_against_periodic"] < 1e-12
    pulse = numbers["square_pulse"]["runs"]
    assert pulse["CCM 6.04"]["total_variation"] > 2 * pulse["PD fine 6.04"]["total_variation"]
    assert len(list(folder.glob("*.png"))) == 6
    assert {c["verdict"] for c in numbers["claims"]} == {
        "reproduces",
        "reproduces with an assumption",
        "does not reproduce",
    }


def test_springs_report_without_the_large_runs(tmp_path):
    """The parts of the report that need no chain of 100,001 nodes."""
    from atc.upscaling.reports.report import Report
    from atc.upscaling.reports.springs_coarse import coarse
    from atc.upscaling.reports.springs_series import series, stability
    from atc.upscaling.reports.springs_waves import local_nonlocal

    report = Report("parts", tmp_path / "r")
    for part in (series, stability, local_nonlocal, coarse):
        part(report)
    report.write()
    numbers = json.loads((tmp_path / "r" / "numbers.json").read_text())
    stability = numbers["stability"]
    ratio = [
        e / s for m, e, s in zip(stability["neighbors"], stability["exact"], stability["sufficient"]) if 4 <= m <= 25
    ]
    assert 1.2 < min(ratio) and max(ratio) < 1.3
    observed = [(o, e) for o, e in zip(stability["observed"], stability["exact"]) if o]
    assert len(observed) > 10 and all(abs(o / e - 1) < 0.02 for o, e in observed)
    away = numbers["local_nonlocal"]
    assert away["5"] > 2 * away["1"]
    assert numbers["series"]["dispersion_peridynamics"][:3] == ["1", "-1/48", "17/69120"]
    assert {c["where"]: c["verdict"] for c in numbers["claims"]}["(4.6)"] == "reproduces"


def test_chain_command(tmp_path):
    out = tmp_path / "run.nc"
    result = run("chain", "-o", out, "--coarse", "band,2", "--length", 400, "--duration", 50)
    assert result.exit_code == 0, result.output
    with xr.open_dataset(out) as ds:
        assert ds.attrs["neighbors"] == 10 and ds.attrs["spacing"] == 0.5 and ds.sizes["x"] == 801
        total = ds.kinetic_energy + ds.potential_energy
        assert float(abs(total / total[0] - 1).max()) < 0.15  # Verlet's energy swings at a large step
    assert (tmp_path / "run.png").stat().st_size > 10_000
    result = run(
        "chain",
        "-o",
        tmp_path / "lj.zarr",
        "--model",
        "lj",
        "--spacing",
        1,
        "--neighbors",
        4,
        "--half-width",
        100,
        "--duration",
        20,
    )
    assert result.exit_code == 0, result.output
    with xr.open_zarr(tmp_path / "lj.zarr", consolidated=False) as ds:
        assert ds.sizes["x"] == 1001


@pytest.mark.parametrize(
    "args, message",
    [
        (("chain", "-o", "a.txt"), "must end in .zarr or .nc"),
        (("chain", "-o", "{tmp}/a.nc", "--model", "foam"), "expected springs, lj or pd"),
        (("chain", "-o", "{tmp}/a.nc", "--model", "pd"), "needs it"),
        (("chain", "-o", "{tmp}/a.nc", "--dt", "9"), "unstable at and above"),
        (("chain", "-o", "{tmp}/a.nc", "--coarse", "band,3"), "divides the 20 neighbours"),
        (("chain", "-o", "{tmp}/a.nc", "--amplitude", "0"), "zero everywhere"),
        (("chain", "-o", "{tmp}/a.nc", "--model", "lj", "--neighbors", "2"), "beyond the spinodal"),
        (("series", "--neighbors", "many"), "whole number, exact or leading"),
        (("series", "--inner", "4"), "odd"),
        (("springs", "-o", "{tmp}/file"), "is a file"),
    ],
)
def test_bad_input_is_one_line(tmp_path, args, message):
    (tmp_path / "file").write_text("")
    result = run(*(a.format(tmp=tmp_path) for a in args))
    assert result.exit_code == 2 and message in result.stderr
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1


def test_series_command():
    out = json.loads(run("series", "--neighbors", 1, "--order", 3, "--json").stdout)
    assert out["gradient"] == ["1", "1/12", "1/360"] and out["well_posedness"][1].startswith("ill-posed")
    assert "17/69120 N^4" in run("series").stdout
    assert "Z(10)/Z(12)" in run("series", "--lj").stdout
    assert len(json.loads(run("series", "--lj", "--order", 3, "--json").stdout)) == 22
