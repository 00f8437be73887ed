"""Shared by all tests: the helpers beside this file (``lammps_oracle``, ``naive``) are importable from every test folder."""

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:
    sys.path.insert(0, str(HERE))

# Pictures are drawn off-screen wherever tests run.
os.environ.setdefault("MPLBACKEND", "Agg")
