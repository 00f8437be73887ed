"""The standing benchmark suite runs, says what it measured, and has what it is said to have."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def pytest_run(*args):
    # A process of its own, not one of those that these tests may run in: there nothing would be timed.
    env = {k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")}
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "benchmarks/test_standing.py", *args],
        cwd=ROOT,
        env=env, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_a_case_of_the_suite(tmp_path):
    out = tmp_path / "b.json"
    done = pytest_run("-k", "lj-4000 and gaussian and 0.001", f"--benchmark-json={out}")
    assert done.returncode == 0, done.stdout + done.stderr
    (case,) = json.loads(out.read_text())["benchmarks"]
    info = case["extra_info"]
    assert (info["atoms"], info["kernel"], info["tolerance"]) == (4000, "gaussian", 1e-3)
    assert 0 < info["error_max"] <= 1e-3 and info["method"].startswith("spectral") and case["stats"]["min"] > 0


def test_what_the_suite_covers():
    done = pytest_run("--collect-only", "-m", "slow or not slow")
    names = [line.split("[")[1].rstrip("]") for line in done.stdout.splitlines() if "test_a_frame[" in line]
    sizes = {name.split("-")[1] for name in names}
    assert {"4000", "32000", "256000", "1000188"} <= sizes
    for word in (
        "lj-",
        "sw-",
        "R=5-",
        "R=30-",
        "-20^3",
        "-128^3",
        *(f"-{k}-" for k in ("gaussian", "quartic", "lucy", "cubic", "bspline", "hardy", "linear", "step", "box")),
    ):
        assert any(word in name for name in names), word
