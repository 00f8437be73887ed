"""The standing suite under pytest-benchmark: what a frame takes now against what it took before, and with which error.

    pytest benchmarks/test_standing.py --benchmark-autosave -k "lj and 32000 and gaussian"
    pytest benchmarks/test_standing.py --benchmark-compare --benchmark-compare-fail=min:20% -k "lj and 32000 and
    gaussian"

The cases of `frontier.py` (4k to 256k atoms, R = 5 to 30 Å, 20³ to 128³ points, every kernel, argon and silicon) at
each of their tolerances: one frame by the method that `atc.fields` would choose (list, forces, deposit, error check),
CPU seconds of one thread, at least three times. What the check finds, the method and the sizes are kept with the times
("extra_info"); an error above the tolerance fails. Large frames, with any kernel but the Gaussian, and what is always
summed exactly are marked slow: -m "slow or not slow" runs them too.
"""

from __future__ import annotations

import time
import warnings
from functools import lru_cache

import pytest
from frontier import BIG, CASES, name_of

import atc
from atc.errors import AtcWarning
from atc.estimators.driver import fields_of
from atc.plan import Request, prepare
from atc.planning.calibrate import argon, silicon

#: From so many cells an edge on a frame is large.
LARGE = {"lj": 40, "sw": 32}


def cases():
    for case in CASES + BIG:
        model, n, kernel, *_, ladder = case
        slow = case in BIG or (n >= LARGE[model] and kernel != "gaussian") or kernel in ("step", "box")
        for tolerance in ladder:
            name = name_of(case).replace(", ", " ").replace(" ", "-")
            yield pytest.param(case, tolerance, id=f"{name}-{tolerance:g}", marks=[pytest.mark.slow] * slow)


@lru_cache(maxsize=1)
def system(model, n):
    return {"lj": argon, "sw": silicon}[model](n)


@pytest.mark.parametrize("case, tolerance", cases())
@pytest.mark.benchmark(timer=time.process_time, warmup=False)
def test_a_frame(benchmark, case, tolerance):
    model, n, kernel, radius, points, _ = case
    frame, pot = system(model, n)
    kern = atc.kernel("box", size=radius) if kernel == "box" else atc.kernel(kernel, radius=radius)
    request = prepare(
        Request(frame, pot, kern, atc.Grid.regular(shape=points), ["stress_potential"], tolerance, threads=1)
    )
    benchmark.group = name_of(case)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", AtcWarning)
        result = benchmark.pedantic(fields_of, ([request.first], request.settings()), rounds=3, warmup_rounds=1)
    found, method = result.errors["stress_potential"], result.methods["bond"]
    benchmark.extra_info.update(
        model=model,
        atoms=len(frame),
        kernel=kernel,
        radius=radius,
        grid=points,
        tolerance=tolerance,
        method=str(method),
        error_max=found["error_max"],
        error_l2=found["error_l2"],
        computed_again=[str(r) for r in result.refined],
    )
    assert found["error_max"] <= tolerance
