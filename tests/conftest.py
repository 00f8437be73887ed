"""Shared by all tests: the helpers beside this file (``lammps_oracle``, ``naive``) and the tests themselves are
importable from every test folder."""

import os
import signal
import sys
import threading
from importlib.util import find_spec
from pathlib import Path

# A shell starts what it runs in the background with SIGINT ignored, and so would every process that tests start and
# interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN and threading.current_thread() is threading.main_thread():
    signal.signal(signal.SIGINT, signal.default_int_handler)

HERE = Path(__file__).resolve().parent
for folder in (HERE, *sorted(f for f in HERE.iterdir() if f.is_dir() and f.name != "__pycache__")):
    if str(folder) not in sys.path:
        sys.path.insert(0, str(folder))

# Pictures are drawn off-screen wherever tests run.
os.environ.setdefault("MPLBACKEND", "Agg")

# The same examples in every run, so that a change is to blame for what fails; ATC_FUZZ_AT_RANDOM=1 looks further.
try:
    from hypothesis import settings

    settings.register_profile("steady", derandomize=True)
    if not os.environ.get("ATC_FUZZ_AT_RANDOM"):
        settings.load_profile("steady")
except ImportError:
    pass


#: Tests that need packages of an environment of their own: file, the package, how to run it.
APART = {
    "torch_models/test_edge_model.py": ("torch", "make test-torch"),
    "torch_models/test_mace.py": ("mace", "make test-mace"),
    "torch_models/test_nequip.py": ("nequip", "make test-nequip"),
    "torch_models/test_metatomic.py": ("metatomic", "make test-torch"),
}
collect_ignore = [file for file, (package, _) in APART.items() if find_spec(package) is None]


def pytest_report_header(config):
    """Say what is left out, and how to get it: pytest itself only prints a count."""
    said = [f"{file} is left out, without {APART[file][0]}: {APART[file][1]}" for file in collect_ignore]
    if "not slow" in config.option.markexpr:
        said.append(
            "tests of several minutes each are left out: pytest -m slow runs them, pytest -m '' runs everything"
        )
    if "not tools" in config.option.markexpr:
        said.append("tests that need vtk, pyvista, ovito, imdclient or openmm are left out: make test-tools runs them")
    return said
