"""`atc bench`: every method on one frame, what is on the front, and the command."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import atc
from atc.analysis.bench import Rung, bench, field_of, mark_front
from atc.cli import app
from atc.plan import Request, prepare
from atc.planning.calibrate import argon, solve
from atc.planning.costs import Costs, cache_file


def rungs_of(result):
    return {r.label: r for r in result.rungs}


@pytest.fixture(scope="module")
def result():
    frame, pot = argon(5)
    request = prepare(
        Request(
            frame,
            pot,
            atc.kernel("gaussian", radius=8.0),
            atc.Grid.regular(shape=10),
            ["stress", "density"],
            1e-4,
            threads=1,
        )
    )
    return bench(request, (1e-6, 1e-2, 1e-4))


def test_every_method_with_its_time_and_error(result):
    by = rungs_of(result)
    assert list(by) == [
        "direct (exact)",
        "spectral 0.01",
        "spectral 0.0001",
        "spectral 1e-06",
        "smoothed per-atom virial",
        "binned per-atom virial",
    ]
    assert by["direct (exact)"].error_max < 1e-12
    errors = [by[f"spectral {t}"].error_max for t in ("0.01", "0.0001", "1e-06")]
    assert errors == sorted(errors, reverse=True) and all(e <= t for e, t in zip(errors, (1e-2, 1e-4, 1e-6)))
    # what no tolerance brings closer
    assert by["binned per-atom virial"].error_max > by["smoothed per-atom virial"].error_max > 1e-3
    assert all(r.cpu > 0 and r.wall > 0 for r in result.rungs)
    assert result.field == "stress_potential" and result.atoms == 500 and result.points == 1000
    assert [r.label for r in result.rungs if r.chosen] == ["spectral 0.0001"]


def test_binning_is_what_binning_gives(result):
    """The same sums by hand: the mean over all bins is the virial stress of the box, as it is of Hardy's field."""
    from atc.analysis.bench import _binned

    frame, pot = argon(5)
    request = prepare(
        Request(frame, pot, atc.kernel("gaussian", radius=8.0), atc.Grid.regular(shape=2), ["stress"], 1e-4, threads=1)
    )
    ds = atc.fields(frame, pot, None, None, ["virial_stress_per_atom_potential", "virial_stress_potential"])
    s = frame.positions @ frame.cell.inverse
    octant = (np.floor(s * 2).astype(int) % 2) @ [4, 2, 1]
    v = ds.virial_stress_per_atom_potential.values[0]
    volume = frame.units.to_user("volume", frame.cell.volume) / 8
    want = np.array([v[octant == k].sum(0) for k in range(8)]).reshape(2, 2, 2, 3, 3) / volume
    rung = _binned(frame, request, request.bound, want)
    assert rung.error_max < 1e-12
    np.testing.assert_allclose(
        want.reshape(8, 3, 3).mean(0), ds.virial_stress_potential.values[0], rtol=0, atol=1e-9 * np.abs(want).max()
    )


def test_the_front_is_what_nothing_else_beats():
    def rung(cpu, error):
        return Rung("", "", None, cpu, cpu, error, error)

    rungs = [rung(1, 1e-2), rung(2, 1e-3), rung(3, 1e-3), rung(4, 1e-4), rung(5, 2e-4), rung(0.5, 1.0)]
    mark_front(rungs)
    assert [r.front for r in rungs] == [True, True, False, True, False, True]


def test_where_the_exact_sum_takes_too_long_errors_come_from_random_points():
    frame, pot = argon(5)
    request = prepare(
        Request(
            frame, pot, atc.kernel("gaussian", radius=8.0), atc.Grid.regular(shape=10), ["stress_potential"], threads=1
        )
    )
    result = bench(request, (1e-2, 1e-5), most=0.0)
    assert [r.method for r in result.rungs] == ["spectral", "spectral", "smoothed virial", "binned virial"]
    assert "predicted to take" in result.left_out[0][1] and all(
        0 < r.error_max <= r.tolerance for r in result.rungs[:2]
    )


def test_kernels_that_jump_leave_the_spectral_method_out():
    frame, pot = argon(4)
    result = bench(
        Request(frame, pot, atc.kernel("step", radius=6.0), atc.Grid.regular(shape=6), ["stress"], threads=1),
        (1e-2, 1e-3),
    )
    assert [r.method for r in result.rungs] == ["direct", "smoothed virial", "binned virial"] and len(
        result.left_out
    ) == 2
    profile = bench(
        Request(frame, pot, atc.kernel("quartic", radius=6.0), atc.Grid.slab("z", 6), ["stress"], threads=1), (1e-2,)
    )
    assert [r.method for r in profile.rungs] == ["slab", "smoothed virial", "binned virial"]
    density = bench(
        Request(frame, None, atc.kernel("gaussian", radius=6.0), atc.Grid.regular(shape=6), ["density"], threads=1),
        (1e-2,),
    )
    assert density.field == "density" and [r.method for r in density.rungs] == ["direct", "spectral"]
    with pytest.raises(atc.AtcError, match="none"):
        bench(Request(frame, pot, None, None, ["virial_stress"]))


SCENE = """
[trajectory]
file = "a.data"
units = "metal"
[potential]
lammps = '''
units metal
pair_style lj/cut 8.5
pair_coeff 1 1 0.0104 3.4
'''
[kernel]
name = "gaussian"
radius = 8.0
[grid]
kind = "regular"
shape = [6, 6, 6]
[fields]
quantities = ["stress_potential"]
"""


def run(*args):
    result = CliRunner().invoke(app, [str(a) for a in args])
    return result.exit_code, result.output


def test_the_command(tmp_path, result):
    frame, _ = argon(4)
    L = frame.cell.vectors[0, 0]
    lines = [f"{k + 1} 1 {x:.10f} {y:.10f} {z:.10f}" for k, (x, y, z) in enumerate(frame.positions)]
    (tmp_path / "a.data").write_text(
        f"argon\n\n{len(frame)} atoms\n1 atom types\n\n0 {L} xlo xhi\n0 {L} ylo yhi\n0 {L} zlo zhi\n\nMasses\n\n1 "
        "39.948\n\nAtoms # atomic\n\n" + "\n".join(lines) + "\n"
    )
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    status, out = run("bench", scene, "--tolerances", "1e-3", "--json")
    assert status == 0, out
    said = json.loads(out)
    assert [r["method"] for r in said["rungs"]] == ["direct", "spectral", "smoothed virial", "binned virial"]
    assert (tmp_path / "scene-bench.png").read_bytes()[:4] == b"\x89PNG"
    status, out = run("bench", scene, "--tolerances", "1e-3", "--picture", tmp_path / "b.svg")
    assert status == 0 and "spectral 0.001" in out and "on the front" in out and (tmp_path / "b.svg").exists()


def test_calibration_is_kept_where_plans_look_for_it(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delenv("ATC_COSTS", raising=False)
    measured = Costs(pair=1e-3, machine="here")
    monkeypatch.setattr("atc.planning.calibrate.calibrate", lambda say: measured)
    status, out = run("bench", "--calibrate")
    assert status == 0 and str(cache_file()) in out and Costs.load() == measured
    frame, pot = argon(4)
    from atc.plan import plan

    p = plan(frame, pot, atc.kernel("quartic", radius=6.0), atc.Grid.regular(shape=4), ["stress"], threads=1)
    assert p.parts["neighbours and forces"] > 8.0 and "--calibrate" not in str(p)
    monkeypatch.setenv("ATC_COSTS", "shipped")
    assert Costs.load() == Costs()


def test_constants_are_solved_for():
    rng = np.random.default_rng(0)
    rows = rng.random((8, 3)) * [1e6, 1e7, 1e4]
    constants = np.array([2e-8, 3e-9, 0.0])
    np.testing.assert_allclose(solve(rows, rows @ constants), constants, rtol=1e-6, atol=1e-12)


def test_any_field_of_a_scene():
    """Fields of gradients and those on a reference configuration too; by name."""
    frame, pot = argon(5)
    moved = frame.replace(
        positions=frame.positions + np.random.default_rng(0).normal(scale=0.05, size=frame.positions.shape)
    )
    request = prepare(
        Request(
            moved,
            pot,
            atc.kernel("gaussian", radius=8.0),
            atc.Grid.regular(shape=8),
            ["heat_flux", "velocity_gradient", "piola_stress"],
            reference=frame,
            threads=1,
        )
    )
    for name in ("velocity_gradient", "piola_stress", "heat_flux_potential"):
        found = bench(request, (1e-2, 1e-4), field=name)
        by = rungs_of(found)
        assert found.field == name and by["direct (exact)"].error_max < 1e-12
        assert (
            by["spectral 0.0001"].error_max < 1e-3 and by["spectral 0.0001"].error_max < by["spectral 0.01"].error_max
        ), name
    assert field_of(request) == "stress_potential"
    with pytest.raises(atc.AtcError, match=r"field 'temper'.*velocity_gradient"):
        bench(request, (1e-2,), field="temper")
    with pytest.raises(atc.AtcError, match="reference"):
        bench(Request(frame, pot, request.request.kern, request.request.grid, ["displacement"], threads=1), (1e-2,))
