"""Random small scenes by approximate methods: every field keeps its tolerance or says that it does not, and no error is
reported much too small."""

import os

import numpy as np
import pytest
from random_scenes import Found, Scene, Summary, compared, spectral_preferred, tried


def test_some_scenes():
    summary = tried(range(40, 64))
    assert len(summary.approximate) > 20
    assert not summary.broken, "\n".join(map(str, summary.broken))


@pytest.mark.slow
def test_many_scenes():
    """As many as ATC_SCENES says, from ATC_SCENES_FROM on; prints the summary that stands in docs/reliability.md."""
    first, count = int(os.environ.get("ATC_SCENES_FROM", 0)), int(os.environ.get("ATC_SCENES", 1000))
    summary = tried(range(first, first + count), print)
    print(summary)
    assert not summary.broken


def test_a_scene_is_its_seed():
    a, b = Scene.of(7), Scene.of(7)
    np.testing.assert_array_equal(a.frames[0].positions, b.frames[0].positions)
    assert a.about == b.about and a.tolerance == b.tolerance


def test_what_is_broken_is_found(monkeypatch):
    """Spoiled sums and spoiled reports are seen."""
    good = Found(0, "stress", "spectral", 1e-4, 1e-4, 1e-3, False, {})
    summary = Summary(found=[good])
    assert not summary.broken
    for bad in ({"true": 2e-3, "reported": 2e-3}, {"reported": 1e-6}, {"mask": False}):
        summary.found = [good.__class__(**{**good.__dict__, **bad})]
        assert len(summary.broken) == 1
    from atc.deposit.spectral import SpectralDeposit

    sums = SpectralDeposit._sums
    monkeypatch.setattr(SpectralDeposit, "_sums", lambda self, *a: 1.01 * sums(self, *a))
    with spectral_preferred():
        found = next(
            f
            for f in map(compared, map(Scene.of, range(40, 64)))
            if isinstance(f, list) and any(x.spectral and x.true > 0 for x in f)
        )
    # It is measured and told.
    assert all(x.kept or (x.told and x.honest) for x in found) and any(x.told or not x.spectral for x in found)
