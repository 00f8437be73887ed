"""Cepstral analysis against processes whose power spectrum is known: value, error bar, and that it takes few
coefficients."""

import numpy as np
import pytest
from scipy.signal import lfilter

from atc.estimators.cepstrum import zero_frequency


def autoregressive(coefficients, n, seed, components=3):
    """(n, components) of x_t = Σ a_k x_{t-k} + noise, after its beginning, and ∫_0^∞ ⟨x(0)x(t)⟩ dt for dt = 1 (two-sided
    sum over lags, half of it): 1/2 / |1 − Σ a_k|²."""
    noise = np.random.default_rng(seed).normal(size=(n + 2000, components))
    x = lfilter([1.0], [1.0, *(-a for a in coefficients)], noise, axis=0)[2000:]
    return x, 0.5 / (1 - sum(coefficients)) ** 2


@pytest.mark.parametrize(
    "coefficients",
    [
        (0.8,),  # a simple decay
        (1.5, -0.9),  # a strong oscillation: S(0) is far below the peak of the spectrum
        (0.0,),  # white
    ],
)
@pytest.mark.parametrize("components", [1, 3])
def test_value_and_error_bar(coefficients, components):
    """Deviations in standard errors over 200 series: mean near 0 and of width 1."""
    pulls, kept = [], []
    for seed in range(200):
        x, want = autoregressive(coefficients, 4096, seed, components)
        found = zero_frequency(0.3 * x, 0.5)
        want *= 0.3**2 * 0.5
        pulls.append((found.integral - want) / found.stderr)
        kept.append(found.coefficients)
    # The mean of 200 has an error of 0.07, their width one of 0.05; what is cut off is a third of an error at the most.
    assert abs(np.mean(pulls)) < 0.35 and 0.8 < np.std(pulls) < 1.25
    assert np.median(kept) < 80


def test_it_gets_better_with_the_length():
    x, want = autoregressive((0.8,), 2**17, 1)
    short, long = zero_frequency(x[: 2**11], 1.0), zero_frequency(x, 1.0)
    assert long.stderr / long.integral < 0.25 * short.stderr / short.integral
    assert abs(long.integral - want) < 3 * long.stderr and long.stderr < 0.03 * want


def test_an_odd_number_of_samples_and_a_silent_component():
    x, want = autoregressive((0.5,), 4097, 3)
    assert abs(zero_frequency(x, 1.0).integral - want) < 4 * zero_frequency(x, 1.0).stderr
    assert np.isfinite(zero_frequency(np.zeros((128, 3)), 1.0).integral)
