"""Block averages: against closed forms for white and AR(1) noise, and against plain numpy."""

import numpy as np

from atc.statistics import BlockAverage


def average(x, w=None):
    b = BlockAverage()
    for k in range(len(x)):
        b.add(x[k], None if w is None else w[k])
    return b


def ar1(rng, n, phi, columns):
    e = rng.normal(size=(n, columns))
    x = np.empty_like(e)
    x[0] = e[0] / np.sqrt(1 - phi**2)
    for k in range(1, n):
        x[k] = phi * x[k - 1] + e[k]
    return x


def test_mean_and_first_level_are_numpys():
    rng = np.random.default_rng(1)
    x = rng.normal(size=(37, 4, 3)) + 1e6
    b = average(x)
    errors, blocks = b.errors_by_level()
    np.testing.assert_allclose(b.mean(), x.mean(0), rtol=1e-14)
    # 1e6 carries 1e-10 of rounding into deviations of size 1
    np.testing.assert_allclose(errors[0], x.std(0, ddof=1) / np.sqrt(37), rtol=1e-8)
    pairs = x[:36].reshape(18, 2, 4, 3).mean(1)
    np.testing.assert_allclose(errors[1], pairs.std(0, ddof=1) / np.sqrt(18), rtol=1e-8)
    assert blocks.tolist() == [37, 18, 9, 4, 2]


def test_white_noise_has_sigma_over_root_n():
    x = np.random.default_rng(2).normal(size=(4096, 300))
    _, stderr, correlated = average(x).result()
    # the estimate from ~100 blocks scatters by 7 %; its rms over 300 series by 0.5 %
    assert abs(np.sqrt(np.mean(stderr**2)) * 64 - 1) < 0.03
    assert correlated.mean() < 0.01


def test_correlated_noise_finds_the_true_error():
    """AR(1): variance of the mean -> sigma²/n (1+phi)/(1-phi), sigma² = 1/(1-phi²), to O(τ/n)."""
    phi, n = 0.8, 8192
    x = ar1(np.random.default_rng(3), n, phi, 200)
    mean, stderr, correlated = average(x).result()
    true = np.sqrt(1 / (1 - phi**2) / n * (1 + phi) / (1 - phi))
    naive = np.sqrt(1 / (1 - phi**2) / n)
    found = np.sqrt(np.mean(stderr**2))
    # finite blocks leave a bias of order τ/B, τ = 4.5, B = 128..256
    assert abs(found / true - 1) < 0.06
    assert found > 2.5 * naive
    assert correlated.mean() < 0.02
    # the scatter of the means themselves says the same; 200 of them are good to 5 %
    assert abs(mean.std() / true - 1) < 0.2


def test_blocks_that_still_correlate_are_flagged():
    x = ar1(np.random.default_rng(4), 256, 0.995, 200)
    _, _, correlated = average(x).result()
    # 200 frames of correlation time in 256 frames: now and then a path happens to look settled
    assert correlated.mean() > 0.9


def test_too_few_frames_are_flagged_and_one_has_no_error():
    x = np.random.default_rng(5).normal(size=(4, 3))
    _, stderr, correlated = average(x).result()
    assert correlated.all() and np.isfinite(stderr).all()
    _, stderr, correlated = average(x[:1]).result()
    assert correlated.all() and np.isnan(stderr).all()


def test_constant_series_has_no_error():
    mean, stderr, correlated = average(np.full((64, 2), 3.0)).result()
    assert (mean == 3).all() and (stderr == 0).all() and not correlated.any()


def test_weighted_mean_is_the_ratio_of_means_and_its_error_the_jackknifes():
    rng = np.random.default_rng(6)
    n = 512
    w = rng.gamma(4.0, size=(n, 5))
    w[::7, 2] = 0.0
    w[:, 4] = 0.0
    x = rng.normal(size=(n, 5, 3)) + 2.0
    x[::7, 2] = 1e30  # has no weight there: must not count
    b = average(x, w)
    ratio = (w[..., None] * x).sum(0)[:4] / w.sum(0)[:4, None]
    np.testing.assert_allclose(b.mean()[:4], ratio, rtol=1e-12)
    assert (b.mean()[4] == 0).all()
    # leave-one-out jackknife: an independent estimate of the same error, equal to O(1/n)
    num, den = (w[..., None] * x)[:, :4], w[:, :4, None]
    loo = (num.sum(0) - num) / (den.sum(0) - den)
    jack = np.sqrt((n - 1) / n * ((loo - loo.mean(0)) ** 2).sum(0))
    np.testing.assert_allclose(b.errors_by_level()[0][0][:4], jack, rtol=0.02)


def test_state_continues_bit_for_bit():
    rng = np.random.default_rng(7)
    x, w = rng.normal(size=(53, 4)), rng.random((53, 4))
    for weights in (None, w):
        whole = average(x, weights)
        part = average(x[:29], None if weights is None else weights[:29])
        again = BlockAverage.from_state(part.state())
        for k in range(29, 53):
            again.add(x[k], None if weights is None else weights[k])
        for a, b in zip(whole.result(), again.result()):
            assert np.array_equal(a, b)


def test_memory_is_logarithmic():
    b = average(np.zeros((1000, 2)))
    assert len(b.levels) == 10
