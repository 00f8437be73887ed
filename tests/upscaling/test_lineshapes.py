"""Lines of damped oscillators whose frequency and damping are known: the true values lie within the stated error bars
as often as they should, whether the line is wide or hardly wider than the run resolves."""

import numpy as np
import pytest

from atc.errors import AtcError
from atc.upscaling.lineshapes import (
    autocorrelation,
    expected_periodogram,
    fit_line,
    periodogram,
    spectral_energy_density,
)


def oscillators(omega, gamma, dt, n, series, rng, temperature=1.0):
    """Complex velocities of oscillators in a bath, ẍ = −ω²x − γẋ + noise, by the exact propagator of their linear
    equation: stationary from the start."""
    from scipy.linalg import expm

    A = np.array([[0.0, 1.0], [-(omega**2), -gamma]])
    E = expm(A * dt)
    still = temperature * np.diag([1 / omega**2, 1.0])
    noise = np.linalg.cholesky(still - E @ still @ E.T + 1e-15 * np.eye(2))
    normal = lambda: (rng.normal(size=(2, series)) + 1j * rng.normal(size=(2, series))) / np.sqrt(2)  # noqa: E731
    y = np.sqrt(still) @ normal()
    out = np.empty((series, n), complex)
    for k in range(n):
        out[:, k] = y[1]
        y = E @ y + noise @ normal()
    return out


def lorentzians(omega, gamma, dt, n, series, rng):
    """Complex series with c = exp(−γ|t|/2) cos ωt: two rotating Ornstein–Uhlenbeck processes."""
    out = np.zeros((series, n), complex)
    for sign in (1, -1):
        step = np.exp((sign * 1j * omega - 0.5 * gamma) * dt)
        normal = lambda: (rng.normal(size=series) + 1j * rng.normal(size=series)) / 2  # noqa: E731
        z = normal()
        for k in range(n):
            out[:, k] += z
            z = step * z + np.sqrt(1 - abs(step) ** 2) * normal()
    return out


def test_expected_periodogram_is_that_of_the_sum():
    """Against Σ_jk c(j − k) e^{−iω(j−k)} dt/N written out, overdamped too."""
    for omega, gamma in ((2.0, 0.3), (0.7, 2.5), (1.0, 2.0)):
        t = 0.21 * np.arange(40)
        c = autocorrelation("oscillator", t, omega, gamma)
        lag = np.arange(40)[:, None] - np.arange(40)
        w = 2 * np.pi * np.arange(21) / (40 * 0.21)
        direct = [(c[np.abs(lag)] * np.exp(-1j * x * lag * 0.21)).sum().real * 0.21 / 40 for x in w]
        np.testing.assert_allclose(expected_periodogram(c, 0.21), direct, atol=1e-12)


def test_autocorrelation_solves_the_oscillators_equation():
    """By the propagator exp(At), under-, over- and critically damped."""
    from scipy.linalg import expm

    t = np.linspace(0, 5, 7)
    for omega, gamma in ((2.0, 0.3), (0.7, 2.5), (1.0, 2.0)):
        exact = [expm(np.array([[0.0, 1.0], [-(omega**2), -gamma]]) * x)[1, 1] for x in t]
        np.testing.assert_allclose(autocorrelation("oscillator", t, omega, gamma), exact, atol=1e-7)


# Width times the length of the run: 12 is hardly resolved, 300 wide. With 48 series of runs the share within one
# standard error, 68 %, is known to 7 %.
@pytest.mark.parametrize(
    "shape, omega, gamma, n, series",
    [
        ("oscillator", 3.0, 0.05, 1200, 4),
        ("oscillator", 3.0, 0.6, 2500, 3),
        ("oscillator", 1.5, 1.2, 1200, 3),
        ("lorentzian", 3.0, 0.15, 1200, 6),
    ],
)
def test_true_values_lie_within_the_error_bars(shape, omega, gamma, n, series):
    rng = np.random.default_rng(11)
    made = oscillators if shape == "oscillator" else lorentzians
    runs, dt = 48, 0.2
    v = made(omega, gamma, dt, n, runs * series, rng).reshape(runs, series, n)
    lines = [fit_line(x, dt, shape) for x in v]
    # Where a width is hardly resolved, a few of the runs have one that is not, and say so.
    assert all("narrower than the run resolves" in x.why for x in lines if x.why)
    assert sum(bool(x.why) for x in lines) <= (3 if gamma * n * dt < 20 else 0)
    lines = [x for x in lines if not x.why]
    w = np.array([(x.omega - omega) / x.omega_error for x in lines])
    g = np.array([(x.gamma - gamma) / x.gamma_error for x in lines])
    for score in (w, g):
        assert 0.50 < (np.abs(score) < 1).mean() < 0.86, np.sort(score)
        assert (np.abs(score) < 2).mean() > 0.85
        assert abs(score.mean()) < 0.6  # no bias: the mean of 48 is good to 0.14, and γ is skewed where it is narrow
    assert 0.85 < np.mean([x.misfit for x in lines]) < 1.15
    assert np.mean([x.power for x in lines]) == pytest.approx(1.0, rel=0.1)
    assert np.mean([x.gamma_error / gamma for x in lines]) < 0.35


def test_a_real_series_is_half_as_many():
    rng = np.random.default_rng(2)
    v = np.sqrt(2) * oscillators(2.0, 0.3, 0.2, 1500, 40, rng).real
    lines = [fit_line(x, 0.2, "oscillator") for x in v]
    score = np.array([(x.gamma - 0.3) / x.gamma_error for x in lines])
    assert 0.5 < (np.abs(score) < 1).mean() < 0.86
    said = fit_line(v[0].astype(complex), 0.2, "oscillator", real=True)
    assert said.gamma_error == pytest.approx(lines[0].gamma_error, rel=1e-9)


def test_another_shape_is_seen():
    """Half of two lines: the misfit tells."""
    rng = np.random.default_rng(5)
    v = oscillators(2.0, 0.1, 0.2, 3000, 8, rng) + oscillators(2.4, 0.1, 0.2, 3000, 8, rng)
    assert fit_line(v, 0.2).misfit > 2
    alone = fit_line(v, 0.2, band=(1.7, 2.2))
    assert abs(alone.omega - 2.0) < 0.05 and alone.misfit < 3


def test_the_band_follows_the_line():
    """Where the line has a satellite, the band that is fitted is that of the line found in it, and the error bar says
    that the shape is another."""
    v = oscillators(11.6, 0.6, 0.2, 5000, 3, np.random.default_rng(3))
    plain = fit_line(v, 0.2, "oscillator")
    line = fit_line(v + 0.35 * np.exp(11.3j * 0.2 * np.arange(5000)), 0.2, "oscillator")
    again = fit_line(
        v + 0.35 * np.exp(11.3j * 0.2 * np.arange(5000)), 0.2, "oscillator",
        band=(line.omega - 8 * line.gamma, line.omega + 8 * line.gamma),
    )  # fmt: skip
    assert again.gamma == pytest.approx(line.gamma, rel=0.02)
    assert abs(plain.gamma - 0.6) < 3 * plain.gamma_error
    assert line.misfit > 1.5 and line.gamma_error > 1.2 * plain.gamma_error


def test_what_has_no_width():
    t = np.arange(400) * 0.1
    line = fit_line(np.exp(2j * np.pi * 12.3 / 40 * t)[None], 0.1)
    assert np.isnan(line.gamma) and "longer than the run" in line.why
    assert "too few" in fit_line(np.ones((2, 20), complex), 0.1).why
    assert "does not move" in fit_line(np.zeros((2, 50), complex), 0.1).why
    with pytest.raises(AtcError, match="line shape 'gauss': expected 'lorentzian' or 'oscillator'"):
        fit_line(np.ones((1, 64)), 0.1, "gauss")


@pytest.mark.parametrize("blocks, taper", [(1, False), (4, True)])
def test_spectral_energy_density_integrates_to_half_kt(blocks, taper):
    rng = np.random.default_rng(7)
    v = np.stack([oscillators(w, 0.4, 0.2, 4000, 12, rng, temperature=0.7) for w in (1.0, 2.0, 5.0)], axis=-1)
    omega, density = spectral_energy_density(v, 0.2, blocks, taper)
    assert density.sum() * omega[1] == pytest.approx(3 * 0.5 * 0.7, rel=0.05)
    if blocks == 1:  # Parseval, exact but for the two frequencies that are their own mirror images
        mean = (np.abs(v) ** 2).sum(axis=2).mean()
        ends = 0.5 * (density[0] + density[-1])
        assert (density.sum() - ends) * omega[1] == pytest.approx(0.5 * mean, rel=1e-12)
    assert np.allclose(periodogram(v[..., 0], 0.2).shape, (2001,))


def test_a_line_whose_width_depends_on_the_frequency():
    """As decay into two waves makes it: v̇ = −ω₀²∫v − ∫M v, Re M falling off beside ω₀. A band of one width to either
    side finds the full width at half maximum; sixteen widths weigh the wings, where M is less, and the misfit says so.
    Error bars are the scatter between runs, and more than it where the shape is another."""
    rng = np.random.default_rng(8)
    dt, n, w0, a, b = 0.2, 6000, 3.0, 0.08, 0.4
    w = 2 * np.pi * np.fft.fftfreq(3 * n, dt)
    w[0] = 1e-9
    M = 0.5 * a * (1 / (b - 1j * (w - w0)) + 1 / (b - 1j * (w + w0)))
    S = (1 / (-1j * w + w0**2 / (-1j * w) + M)).real
    peak = (S > 0.5 * S.max()) & (w > 0)
    width = np.ptp(w[peak])
    assert w0 - width < w[peak].min() and w[peak].max() < w0 + width
    runs = 32
    noise = rng.normal(size=(runs, 3, 3 * n)) + 1j * rng.normal(size=(runs, 3, 3 * n))
    v = np.fft.ifft(noise * np.sqrt(S), axis=2)[..., :n]
    found = {}
    for name, band in (("core", (w0 - width, w0 + width)), ("whole", None)):
        lines = [fit_line(x, dt, band=band) for x in v]
        gamma = np.array([x.gamma for x in lines])
        scatter = gamma.std() / np.mean([x.gamma_error for x in lines])
        found[name] = gamma.mean() / width, np.mean([x.misfit for x in lines]), scatter
    core, whole = found["core"], found["whole"]
    assert core[0] == pytest.approx(1.0, abs=0.06) and core[1] < 1.15, found
    assert 0.65 < core[2] < 1.35, found  # of 32 runs a standard deviation is good to 13 %
    assert whole[0] < 0.75 and whole[1] > 1.5 and 0.1 < whole[2] < 1.0, found
