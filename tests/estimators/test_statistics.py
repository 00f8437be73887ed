"""Block averages: against closed forms for white and AR(1) noise, and against plain numpy."""

import numpy as np

from atc.estimators.groups import size_of
from atc.estimators.statistics import BlockAverage


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


def in_groups(x, m, w=None, sizes=None):
    """What `average` gives, from means of m frames."""
    b = BlockAverage(block=m)
    at = 0
    for size in sizes or [min(m, len(x) - k) for k in range(0, len(x), m)]:
        part, v = x[at : at + size], None if w is None else w[at : at + size]
        mean = part.mean(0) if w is None else (v[..., None] * part).sum(0) / v.sum(0)[..., None]
        deviation = part - mean if w is None else v[..., None] * (part - mean) / v.mean(0)[..., None]
        b.add(mean, None if w is None else v.mean(0), frames=size, within=float(np.mean(deviation**2)))
        at += size
    return b


def test_groups_of_frames_have_the_mean_of_all_and_the_errors_of_their_blocks():
    """Also when a group comes in parts, and when some frames are left over at the end: they count as what they are."""
    rng = np.random.default_rng(8)
    x, w = rng.normal(size=(8 * 40 + 5, 6, 3)) + 2.0, rng.gamma(4.0, size=(8 * 40 + 5, 6))
    parts = [8] * 10 + [3, 5] + [8] * 20 + [1, 6, 1] + [8] * 8 + [5]
    for weights in (None, w):
        every = average(x, weights)
        for sizes in (None, parts):
            b = in_groups(x, 8, weights, sizes)
            assert b.n == every.n == 325
            np.testing.assert_allclose(b.mean(), every.mean(), rtol=1e-13)
            errors, blocks = b.errors_by_level()
            want, n = every.errors_by_level()
            assert blocks.tolist() == n[3:].tolist() == [40, 20, 10, 5, 2]
            np.testing.assert_allclose(errors, want[3:], rtol=1e-10)
            again = BlockAverage.from_state(b.state())
            assert all(np.array_equal(p, q) for p, q in zip(again.result(), b.result()))


def test_errors_of_groups_are_those_of_frames():
    """White noise, noise that correlates within a group and over groups: the same errors, and the same word on whether
    blocks still correlate."""
    for phi, n, m in ((0.0, 512, 16), (0.8, 4096, 32), (0.98, 8192, 64)):
        x = ar1(np.random.default_rng(9), n, phi, 300)
        _, want, _ = average(x).result()
        _, stderr, correlated = in_groups(x, m).result()
        true = np.sqrt(1 / (1 - phi**2) / n * (1 + phi) / (1 - phi))
        # 32 to 128 blocks scatter by 6 to 13 % each, 300 of them by 1 %; a bias of τ/B stays (see above)
        assert abs(np.sqrt(np.mean(stderr**2)) / true - 1) < 0.1 and abs(np.sqrt(np.mean(want**2)) / true - 1) < 0.1
        assert correlated.mean() < 0.1
    x = ar1(np.random.default_rng(10), 512, 0.995, 200)
    assert average(x).result()[2].mean() > 0.9 and in_groups(x, 16).result()[2].mean() > 0.9


def test_groups_as_long_as_they_are_made_cost_nothing_of_the_error():
    """Of most elements the same blocks count as without groups, so that the errors are the same numbers; those of all
    are as large and as certain, and as many flagged."""
    for n in (64, 128, 256, 512, 2048):
        m = size_of(n, 1000)
        assert m >= 4
        for phi in (0.0, 0.6, 0.9):
            x = ar1(np.random.default_rng(n), n, phi, 400)
            (_, want, flags), (_, stderr, flags_too) = average(x).result(), in_groups(x, m).result()
            # blocks that grow by chance or do not: found 0.8 to 1.0
            assert np.mean(np.isclose(stderr, want, rtol=1e-9)) > 0.75
            a, b = np.sqrt(np.mean(want**2)), np.sqrt(np.mean(stderr**2))
            # found 0.99 to 1.01, and 0.89 to 1.02
            assert abs(b / a - 1) < 0.02 and stderr.std() / b < 1.1 * want.std() / a
            assert abs(flags.mean() - flags_too.mean()) < 0.05


def test_threads_do_not_change_an_average():
    rng = np.random.default_rng(11)
    for w in (None, rng.random((6, 700, 300))):
        x, many = rng.normal(size=(6, 700, 300, 3)), BlockAverage(threads=3)
        for k in range(6):
            many.add(x[k], None if w is None else w[k])
        assert all(np.array_equal(p, q, equal_nan=True) for p, q in zip(many.result(), average(x, w).result()))
