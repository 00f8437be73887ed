"""Nonlocal advection: sums against naive loops, ledgers, Cole–Hopf and Hopf–Lax, order in the horizon, shocks, ``atc
advect``."""

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from atc.advection.equation import FLUXES, _by_fft, _by_stencil, advect
from atc.advection.kernel import KERNELS, Kernel
from atc.advection.reference import cole_hopf, hopf_lax
from atc.advection.solution import burgers_flux, find_shocks
from atc.cli import app
from atc.config.formula import formula
from atc.errors import AtcError

WAVE = lambda x: np.sin(2 * np.pi * x)  # noqa: E731


def naive(u, kernel, psi, two_point):
    """Σ_m F(u_i, u_{i+m}) φ_a Δx and Σ_m (u_{i+m} − u_i) φ_s Δx, pair by pair; the conserving flux by Simpson (exact
    for cubics)."""
    n, M = len(u), kernel.neighbors
    transport, smooth = np.zeros(n), np.zeros(n)
    for i in range(n):
        for m in (*range(-M, 0), *range(1, M + 1)):
            a, b = u[i], u[(i + m) % n]
            middle = psi(0.5 * (a + b))
            F = middle if two_point == "midpoint" else (psi(a) + 4 * middle + psi(b)) / 6
            transport[i] += F * np.sign(m) * kernel.odd_m[abs(m) - 1]
            smooth[i] += (b - a) * kernel.even_m[abs(m) - 1]
    return transport, smooth


@pytest.mark.parametrize("two_point", FLUXES)
@pytest.mark.parametrize("shape", [*KERNELS, lambda s: (1 - s * s) ** 2])
def test_sums(shape, two_point):
    kernel = Kernel(shape, 0.11, 1 / 64)
    u = np.random.default_rng(5).normal(size=64)
    transport, smooth = naive(u, kernel, burgers_flux, two_point)
    for make in (_by_fft, _by_stencil):
        flux, laplace = make(kernel, 64, burgers_flux, two_point, True)
        np.testing.assert_allclose(flux(u), transport, rtol=1e-12, atol=1e-12 * np.abs(transport).max())
        np.testing.assert_allclose(laplace(u), smooth, rtol=1e-12, atol=1e-12 * np.abs(smooth).max())
    cubic = lambda v: v**3 / 3 + v  # noqa: E731
    flux, _ = _by_stencil(kernel, 64, cubic, two_point, False)
    expected = naive(u, kernel, cubic, two_point)[0]
    np.testing.assert_allclose(flux(u), expected, rtol=1e-12, atol=1e-12 * np.abs(expected).max())


@given(
    shape=st.sampled_from(KERNELS),
    horizon=st.floats(0.7, 40),
    two_point=st.sampled_from(FLUXES),
    seed=st.integers(0, 99),
)
@settings(max_examples=40, deadline=None)
def test_moments_mass_and_energy_of_the_sums(shape, horizon, two_point, seed):
    """∫ z φ_a = ∫ z² φ_s = 2; the transport has no sum, and with the conserving flux no power; the regularisation only
    takes energy."""
    dx = 0.01
    kernel = Kernel(shape, horizon * dx, dx)
    m = np.arange(1, kernel.neighbors + 1) * dx
    assert 2 * (m * kernel.odd_m).sum() == pytest.approx(2, rel=1e-13)
    assert 2 * (m * m * kernel.even_m).sum() == pytest.approx(2, rel=1e-13)
    k = 1e-3
    assert float(kernel.advection_symbol(k)) == pytest.approx(2 * k, rel=1e-6) and float(
        kernel.diffusion_symbol(k)
    ) == pytest.approx(k * k, rel=1e-6)
    u = np.random.default_rng(seed).normal(size=300)
    transport, smooth = _by_stencil(kernel, 300, burgers_flux, two_point, True)
    f, s = transport(u), smooth(u)
    assert abs(f.sum()) < 1e-13 * np.abs(f).sum() and abs(s.sum()) < 1e-13 * np.abs(s).sum()
    assert u @ s < 0
    if two_point == "conserving":
        assert abs(u @ f) < 1e-13 * np.abs(u * f).sum()


def test_constants_stay():
    """A uniform u is a solution, and a uniform u₀ added travels with it (midpoint flux: F(a + c, b + c) is Galilean
    only for Burgers)."""
    kernel = Kernel("triangle", 0.05, 1 / 128)
    run = advect(np.full(128, 1.3), kernel, duration=1.0, viscosity=0.01, times=3)
    np.testing.assert_allclose(run.u_tn, 1.3, rtol=1e-13)


@pytest.mark.parametrize("two_point", FLUXES)
@pytest.mark.parametrize("method", ["fft", "stencil"])
def test_mass_and_ledger(method, two_point):
    """Mass to 1e-14 and the entropy ledger to 1e-12 through a shock."""
    x = np.arange(512) / 512
    run = advect(
        0.3 + WAVE(x),
        Kernel("box", 0.02, 1 / 512),
        duration=1.0,
        viscosity=0.005,
        two_point=two_point,
        method=method,
        times=11,
    )
    assert run.mass_error < 1e-14
    assert np.abs(run.closure_t).max() < 1e-12
    assert run.energy_t[-1] < 0.5 * run.energy_t[0] and (np.diff(run.dissipation_t) > 0).all()
    if two_point == "conserving":
        assert np.abs(run.production_t).max() < 1e-13 * run.energy_t[0]


def test_conserving_flux_keeps_energy_and_the_midpoint_flux_does_not():
    """ε = 0: energy to 1e-11 over twelve shock times, without relaxation as the step falls; the midpoint flux
    multiplies it."""
    x = np.arange(512) / 512
    kernel = Kernel("box", 0.05, 1 / 512)
    kept = advect(WAVE(x), kernel, duration=2.0, two_point="conserving")
    assert np.abs(kept.energy_t / kept.energy_t[0] - 1).max() < 1e-11 and kept.mass_error < 1e-14
    plain = [
        advect(WAVE(x), kernel, duration=0.4, two_point="conserving", relaxation=False, safety=c, times=2)
        for c in (0.3, 0.15)
    ]
    error = [abs(r.energy_t[-1] / r.energy_t[0] - 1) for r in plain]
    assert np.log2(error[0] / error[1]) == pytest.approx(3, abs=0.3)
    grown = advect(WAVE(x), kernel, duration=2.0, two_point="midpoint")
    assert grown.energy_t[-1] > 2 * grown.energy_t[0] and grown.production_t[-1] > 0
    # What it does to energy is the flux's doing, not the time step's: as the shock forms it first takes, in the same
    # measure for any step.
    again, same = (
        advect(WAVE(x), kernel, duration=0.6, two_point="midpoint", safety=c, times=2).energy_t for c in (0.1, 0.3)
    )
    assert again[-1] == pytest.approx(same[-1], rel=2e-3) and abs(again[-1] / again[0] - 1) > 0.1
    dies = advect(WAVE(x), Kernel("gaussian", 0.03, 1 / 512), duration=20.0, two_point="midpoint")
    assert "grew beyond" in dies.stopped and dies.t_t[-1] < 20 and len(dies.t_t) == len(dies.u_tn)


@pytest.mark.parametrize("shape", KERNELS)
@pytest.mark.parametrize("two_point", FLUXES)
def test_second_order_in_the_horizon(shape, two_point):
    """Smooth solution, t = 0.3 with ε = 0.05, against Cole–Hopf: order 2.0 ± 0.1."""
    x = np.arange(1024) / 1024
    local, stated = cole_hopf(WAVE, x, 0.3, 0.05)
    errors = [
        np.sqrt(
            np.mean(
                (
                    advect(
                        WAVE(x), Kernel(shape, h, 1 / 1024), duration=0.3, viscosity=0.05, two_point=two_point, times=2
                    ).u_tn[-1]
                    - local
                )
                ** 2
            )
        )
        for h in (0.06, 0.03)
    ]
    assert stated < 1e-12
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.1)
    assert errors[1] < 3e-3


def test_third_order_in_time():
    x = np.arange(256) / 256
    kernel = Kernel("triangle", 0.06, 1 / 256)
    for relaxation in (True, False):
        u = [
            advect(0.2 + WAVE(x), kernel, duration=0.3, viscosity=0.02, times=2, safety=c, relaxation=relaxation).u_tn[
                -1
            ]
            for c in (0.6, 0.3, 0.02)
        ]
        assert np.log2(np.abs(u[0] - u[2]).max() / np.abs(u[1] - u[2]).max()) == pytest.approx(3, abs=0.35)


def test_stable_step():
    """The diffusive step: twice the limit blows up, the step taken does not; it is set by the kernel, not by the
    spacing."""
    steps = {}
    for n in (128, 512):
        kernel = Kernel("triangle", 0.1, 1 / n)
        u0 = 1e-3 * np.random.default_rng(0).normal(size=n)
        run = advect(u0, kernel, duration=20.0, viscosity=1.0, times=2, safety=0.99)
        assert np.abs(run.u_tn[-1]).max() < np.abs(u0).max() and not run.stopped
        steps[n] = run.dt_range[1]
        over = advect(u0, kernel, duration=20.0, viscosity=1.0, times=2, safety=1.5, relaxation=False)
        assert over.stopped
    assert steps[512] == pytest.approx(steps[128], rel=0.05)


# --------------------------------------------------------------------------------------------------------------------
# References.


def test_cole_hopf_travelling_wave():
    """The viscous shock u = c − (J/2) tanh(J (x − ct)/4ε), as one period of a sawtooth wide enough that its ends do not
    matter."""
    eps, c, J = 0.01, 0.3, 1.0
    shock = lambda x: c - 0.5 * J * np.tanh(J * (x - 2.0) / (4 * eps))  # noqa: E731
    x = np.linspace(1.8, 2.6, 81)
    u, error = cole_hopf(shock, x, 0.5, eps, period=4.0)
    np.testing.assert_allclose(
        u, shock(x - c * 0.5), atol=2e-8
    )  # the jump at the period's end is 4e-22 away from here; the rest is quadrature
    assert error < 1e-7


@pytest.mark.parametrize("eps", [0.5, 0.05, 0.005])
def test_cole_hopf_is_a_solution(eps):
    """u_t + u u_x = ε u_xx by differences of high order around a point."""
    t, h, x0 = 0.3, 1e-3, 0.37
    d1 = np.array([1, -8, 0, 8, -1]) / (12 * h)
    d2 = np.array([-1, 16, -30, 16, -1]) / (12 * h * h)
    offsets = np.arange(-2, 3) * h
    u, error = cole_hopf(WAVE, x0 + offsets, t, eps)
    u_t = d1 @ [cole_hopf(WAVE, [x0], t + o, eps)[0][0] for o in offsets]
    assert error < 1e-12
    assert u_t + u[2] * (d1 @ u) == pytest.approx(eps * (d2 @ u), abs=2e-5)


def test_vanishing_viscosity():
    """ε → 0: Cole–Hopf goes to Hopf–Lax at first order away from the shock, and is finite down to 1e-6, where a Fourier
    series is not."""
    x = np.concatenate([np.linspace(0.02, 0.45, 20), np.linspace(0.55, 0.98, 20)])
    limit = hopf_lax(WAVE, x, 0.5)
    errors = [np.abs(cole_hopf(WAVE, x, 0.5, eps)[0] - limit).max() for eps in (1e-3, 5e-4, 1e-6)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(1, abs=0.15) and errors[2] < 1e-5
    # characteristics before the shock forms (t < 1/2π): u = u0(x − ut)
    x = np.linspace(0, 1, 101)
    u = hopf_lax(WAVE, x, 0.12)
    np.testing.assert_allclose(u, WAVE(x - u * 0.12), atol=1e-10)
    # and a mean flow only moves it (Galilei)
    np.testing.assert_allclose(
        hopf_lax(lambda y: 0.7 + WAVE(y), x + 0.07, 0.1), 0.7 + hopf_lax(WAVE, x, 0.1), atol=1e-9
    )
    u, _ = cole_hopf(lambda y: 0.7 + WAVE(y), x + 0.35, 0.5, 0.01)
    np.testing.assert_allclose(u, 0.7 + cole_hopf(WAVE, x, 0.5, 0.01)[0], atol=1e-10)
    np.testing.assert_array_equal(cole_hopf(WAVE, x, 0.0, 0.01)[0], WAVE(x))


def test_shocks():
    """Position, states, width 4ε·2/J of the tanh profile and Rankine–Hugoniot speed of a viscous shock; a regularised
    nonlocal one moves with that speed."""
    x = np.arange(2000) / 2000 * 4
    J, eps = 1.4, 0.01
    profile = 0.3 - 0.5 * J * np.tanh(J * (x - 1.7) / (4 * eps)) + 0.35 * (x - 2)
    (shock,) = [s for s in find_shocks(x, profile) if abs(s["position"] - 1.7) < 0.5]
    assert shock["position"] == pytest.approx(1.7, abs=1e-3) and shock["jump"] == pytest.approx(J, rel=0.1)
    assert shock["speed"] == pytest.approx(0.5 * (shock["left"] + shock["right"]), rel=1e-12)
    x = np.arange(1024) / 1024
    run = advect(0.5 + WAVE(x), Kernel("gaussian", 0.01, 1 / 1024), duration=0.8, viscosity=0.005, times=81)
    ds = run.dataset()
    late = ds.sel(time=slice(0.4, 0.8))
    speed = np.polyfit(late.time, np.unwrap(late.shock_position.values, period=1.0), 1)[0]
    assert speed == pytest.approx(0.5, abs=5e-3)  # the mean flow, by symmetry
    assert float(late.shock_speed.mean()) == pytest.approx(speed, abs=0.02)
    assert find_shocks(x, WAVE(x)) == []


# --------------------------------------------------------------------------------------------------------------------
# Formulas, the command line.


def test_formula():
    f = formula("2*x^2 - sin(pi*x)/3 + L", "x", "--initial", L=4.0)
    x = np.linspace(0, 1, 5)
    np.testing.assert_allclose(f(x), 2 * x**2 - np.sin(np.pi * x) / 3 + 4)
    np.testing.assert_array_equal(formula("3", "x", "f")(x), np.full(5, 3.0))
    for bad in (
        "__import__('os')",
        "x.real",
        "(lambda: 1)()",
        "x if x",
        "sin(x, 2)",
        "y",
        "[x]",
        "x +",
        "True",
        "",
    ):
        with pytest.raises(AtcError):
            formula(bad, "x", "--initial")


def run_cli(*args):
    return CliRunner().invoke(app, ["advect", *map(str, args)], prog_name="atc")


def test_command(tmp_path):
    out = tmp_path / "a.nc"
    result = run_cli(
        "-o", out, "--nodes", 256, "--viscosity", 0.02, "--duration", 0.4, "--kernel", "box", "--horizon", 0.03
    )
    assert result.exit_code == 0, result.output
    with xr.open_dataset(out) as ds:
        assert ds.sizes == {"time": 101, "x": 256}
        assert float(abs(ds.u.isel(time=-1) - ds.local).max()) < 0.05
        assert ds.attrs["kernel"] == "box" and float(abs(ds.closure).max()) < 1e-12
    assert (tmp_path / "a.png").stat().st_size > 10_000
    assert "Cole-Hopf, itself within" in result.output and "mass" in result.output
    (tmp_path / "k.txt").write_text("0 1\n0.5 1\n1 0\n")
    result = run_cli(
        "-o",
        tmp_path / "b.zarr",
        "--nodes",
        128,
        "--flux",
        "u^3/3",
        "--kernel",
        tmp_path / "k.txt",
        "--horizon",
        0.05,
        "--two-point",
        "conserving",
        "--duration",
        0.2,
    )
    assert result.exit_code == 0, result.output
    with xr.open_zarr(tmp_path / "b.zarr", consolidated=False) as ds:
        assert ds.attrs["flux"] == "u^3/3" and "local" not in ds
    result = run_cli(
        "-o", tmp_path / "c.nc", "--nodes", 512, "--horizons", "0.06,0.03", "--viscosity", 0.05, "--duration", 0.2
    )
    assert result.exit_code == 0, result.output
    with xr.open_dataset(tmp_path / "c.nc") as ds:
        assert float(ds.order[-1]) == pytest.approx(2, abs=0.1)


@pytest.mark.parametrize(
    "args, message",
    [
        (("--kernel", "boxy"), "unknown 'boxy': did you mean 'box'? known: s, pi, e, box, triangle, gaussian"),
        (("--kernel", "none.txt"), "no such file"),
        (("--kernel", "s-0.5"), "negative somewhere"),
        (("--horizon", "1"), "shorter than half the period"),
        (("--horizon", "1e-5"), "does not reach the next node"),
        (("--horizon", "nan"), "greater than 0"),
        (("--viscosity", "-1"), "ill-posed"),
        (("--initial", "sin(y)"), "character 5: unknown 'y': known: x, L, pi, e"),
        (("--initial", "1/x"), "not a finite number at x = 0"),
        (("--flux", "log(u)"), "not a finite number for every u"),
        (("--two-point", "up"), "midpoint or conserving"),
        (("--method", "fft", "--flux", "u^3"), "need the stencil"),
        (("--nodes", "3"), "--nodes 3"),
        (("--nodes", "10000000", "--frames", "1000"), "numbers to keep"),
        (("--safety", "5"), "at most 1"),
        (("--length", "1e-300"), "--length"),
        (("--viscosity", "1e9"), "steps would be needed"),
        (("--frames", "1"), "--frames 1"),
        (("--horizons", "0.1"), "two or more"),
        (("--horizons", "0.1,0.05", "--viscosity", "0"), "greater than 0"),
        (("--duration", "0"), "duration"),
    ],
)
def test_bad_input_is_one_line(tmp_path, args, message):
    result = run_cli("-o", tmp_path / "a.nc", *args)
    assert result.exit_code == 2 and message in result.stderr, result.output
    assert result.stderr.startswith("error: ") and result.stderr.count("\n") == 1
    assert not (tmp_path / "a.nc").exists()


# ---- a smoothing kernel of its own, and the explicit fluxes


@pytest.mark.parametrize("two_point", FLUXES)
@pytest.mark.parametrize("own", [("triangle", 0.05), ("gaussian", 0.12), (lambda s: 1 - s**3, None)])
def test_two_kernels(own, two_point):
    """φ_a and φ_s apart: each has its moment, sums are the naive ones by either method, mass is kept."""
    kernel = Kernel("box", 0.11, 1 / 64, *own)
    m = np.arange(1, kernel.neighbors + 1) / 64
    assert 2 * (m * kernel.odd_m).sum() == pytest.approx(2, rel=1e-12)
    assert 2 * (m**2 * kernel.even_m).sum() == pytest.approx(2, rel=1e-12)
    alone = Kernel("box", 0.11, 1 / 64)
    np.testing.assert_array_equal(kernel.odd_m[: alone.neighbors], alone.odd_m)
    theirs = Kernel("box" if own[0] is None else own[0], own[1] or 0.11, 1 / 64)
    np.testing.assert_array_equal(kernel.even_m[: theirs.neighbors], theirs.even_m)
    u = np.random.default_rng(5).normal(size=64)
    transport, smooth = naive(u, kernel, burgers_flux, two_point)
    for make in (_by_fft, _by_stencil):
        flux, laplace = make(kernel, 64, burgers_flux, two_point, True)
        np.testing.assert_allclose(flux(u), transport, atol=1e-12 * np.abs(transport).max())
        np.testing.assert_allclose(laplace(u), smooth, atol=1e-12 * np.abs(smooth).max())
    run = advect(WAVE(np.arange(64) / 64), kernel, duration=0.3, viscosity=0.02, two_point=two_point, times=4)
    assert run.mass_error < 1e-13 and np.abs(run.closure_t).max() < 1e-12


@pytest.mark.parametrize("two_point", FLUXES)
def test_explicit_fluxes(two_point):
    """Their differences are the transport and the regularisation, for any flux; for a smooth u they are the report's
    double integral (2.0.9a), ∫dz ∫dλ F(u(x − (1−λ)z), u(x + λz)) z φ_a(z) over z > 0, and tend to ψ(u) and −ε u_x."""
    kernel = Kernel("triangle", 0.07, 1 / 128, "box", 0.03)
    psi = lambda v: v**3 / 3 + v  # noqa: E731
    x = np.arange(128) / 128
    run = advect(0.4 * WAVE(x) + 0.2, kernel, duration=0.1, viscosity=0.01, psi=psi, two_point=two_point, times=2)
    transport, smooth = naive(run.u_tn[-1], kernel, psi, two_point)
    f, g = run.fluxes()
    np.testing.assert_allclose((f - np.roll(f, 1)) * 128, transport, atol=1e-11)
    np.testing.assert_allclose((g - np.roll(g, 1)) * 128, -0.01 * smooth, atol=1e-11)
    f, g = run.fluxes(0)
    u = lambda y: 0.4 * np.sin(2 * np.pi * y) + 0.2  # noqa: E731
    q, w = np.polynomial.legendre.leggauss(40)
    q, w = 0.5 * (q + 1), 0.5 * w
    face = x[10] + 0.5 / 128
    z, lam = 0.07 * q[:, None], q[None]
    a, b = u(face - (1 - lam) * z), u(face + lam * z)
    F = psi(0.5 * (a + b)) if two_point == "midpoint" else (psi(a) + 4 * psi(0.5 * (a + b)) + psi(b)) / 6
    profile = (1 - q) * 12 / 0.07**3  # C z b, ∫_{-δ}^{δ} z² C b = 2
    exact = (0.07 * w[:, None] * w[None] * F * z**2 * profile[:, None]).sum() / 1.0
    assert f[10] == pytest.approx(exact / (0.07 * w * (0.07 * q) ** 2 * profile).sum(), rel=2e-3)
    np.testing.assert_allclose(f, psi(u(x + 0.5 / 128)), atol=0.01)
    np.testing.assert_allclose(g, -0.01 * 0.4 * 2 * np.pi * np.cos(2 * np.pi * (x + 0.5 / 128)), atol=2e-4)


def test_two_kernels_from_the_command_line(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with open("phi_s.txt", "w") as f:
        f.write("0 1\n0.5 0.6\n1 0\n")
    base = [
        "advect",
        "-q",
        "--nodes",
        "256",
        "--horizon",
        "0.05",
        "--duration",
        "0.2",
        "--frames",
        "5",
        "--no-reference",
    ]
    done = CliRunner().invoke(
        app, [*base, "-o", "o.nc", "--smoothing-kernel", "phi_s.txt", "--smoothing-horizon", "0.03", "--fluxes"]
    )
    assert done.exit_code == 0, done.output
    with xr.open_dataset("o.nc", engine="h5netcdf") as ds:
        assert ds["advective_flux"].shape == (5, 256) and float(ds["x_face"][0]) == pytest.approx(0.5 / 256)
        assert ds.attrs["smoothing_horizon"] == 0.03 and ds.attrs["smoothing_kernel"] == "tabulated"
        assert ds["regularising_flux"].attrs["long_name"]
    done = CliRunner().invoke(app, [*base, "-o", "p.nc", "--fluxes", "--horizons", "0.1,0.05"])
    assert done.exit_code != 0
    with pytest.raises(AtcError, match="smoothing_horizon = -1: expected a length"):
        Kernel("box", 0.1, 0.01, None, -1)
