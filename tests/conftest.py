"""Shared by all tests: the helpers beside this file (``lammps_oracle``, ``naive``) are importable from every test folder."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:
    sys.path.insert(0, str(HERE))

# Pictures are drawn off-screen wherever tests run.
os.environ.setdefault("MPLBACKEND", "Agg")


def pytest_report_header(config):
    """Say what is left out, and how to get it: pytest itself only prints a count."""
    if config.option.markexpr == "not slow":
        return "tests of several minutes each are left out: pytest -m slow runs them, pytest -m '' runs everything"
    return None
