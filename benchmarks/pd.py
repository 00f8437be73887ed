"""Peridynamics, seconds a step beside LAMMPS's PERI package on the same disk (R's, 103,110 particles, 10,009,800
directed bonds), in turn.

    python benchmarks/pd.py [--steps 50] [--rounds 3] [--warm 0] [--threads 2] [--radius 0.037] [--models pmb lps]
    [--no-lammps] [--full]

`--warm` steps run first in both (600 is amid the fracture). LAMMPS runs on as many MPI ranks as there are threads
(mpirun of the mpich wheel). Wall seconds and CPU seconds (user + system, of all ranks or threads) a step; the ratio of
CPU seconds is what survives a busy machine. `--full` also runs the whole 2000 steps of PMB, without LAMMPS.
`--accuracy` is benchmarks/pd_accuracy.py: error against δ/Δx, Δt, precision and CPU time.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import sysconfig
import tempfile
import time
from pathlib import Path

import numpy as np

from atc import pd

C, BULK, SHEAR = 1.6863e22, 14.9e9, 8.94e9
LAMMPS = """
units si
boundary s s s
atom_style peri
atom_modify map array
neighbor 0.0010 bin
lattice sc 0.0005
region target cylinder y 0.0 0.0 {radius} -0.0025 0.0 units box
create_box 1 target
create_atoms 1 region target
pair_style peri/{model}
pair_coeff * * {coeff} 0.0015001 0.0005 0.25
set group all density 2200
set group all volume 1.25e-10
velocity all set 0.0 0.0 0.0 sum no units box
fix F1 all nve
variable y equal "0.0051 - step*dt*100"
fix F2 all indent 1e17 sphere 0.0 v_y 0.0 0.005 units box
timestep 1.0e-7
thermo 1000000
run {warm} post no
"""
CHILD = """
import sys, time
sys.path.insert(0, sys.argv[2])
from lammps_oracle import lammps_session
with lammps_session() as lmp:
    lmp.commands_string(open(sys.argv[1]).read())
    cpu, wall = time.process_time(), time.perf_counter()
    lmp.command(f"run {sys.argv[3]} pre no post no")
    # One write a rank, or two ranks may mix theirs.
    sys.stdout.write(f"TIMES {time.perf_counter() - wall:.6f} {time.process_time() - cpu:.6f}\\n")
    sys.stdout.flush()
"""


def lammps(model, args):
    """(wall, cpu) seconds a step."""
    text = LAMMPS.format(
        radius=args.radius, model=model, coeff=C if model == "pmb" else f"{BULK} {SHEAR}", warm=max(1, args.warm)
    )
    tests = Path(__file__).resolve().parent.parent / "tests"
    with tempfile.TemporaryDirectory() as tmp:
        Path(tmp, "in.disk").write_text(text)
        command = [sys.executable, "-c", CHILD, str(Path(tmp, "in.disk")), str(tests), str(args.steps)]
        if args.threads > 1:
            command = [str(Path(sysconfig.get_path("scripts"), "mpirun")), "-n", str(args.threads), *command]
        out = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    rows = np.array(re.findall(r"TIMES (\d+\.\d{6}) (\d+\.\d{6})", out), float)
    if len(rows) != args.threads:
        raise SystemExit(f"expected times of {args.threads} LAMMPS ranks, got {len(rows)}: {out!r}")
    return rows[:, 0].max() / args.steps, rows[:, 1].sum() / args.steps


def disk(model, args):
    body = pd.Body.lattice(pd.Cylinder("y", (0, 0), args.radius, -0.0025, 0.0), 0.0005, 0.0015001, 2200.0)
    return pd.Simulation(
        body,
        pd.PMB(c=C) if model == "pmb" else pd.LPS(BULK, SHEAR),
        damage=pd.CriticalStretch(0.0005, 0.25),
        contact=True,
        dt=1e-7,
        indenter=pd.Indenter(0.005, 1e17, (0, 0.0051, 0), (0, -100.0, 0)),
        threads=args.threads,
    )


def mine(sim, steps):
    cpu, wall = time.process_time(), time.perf_counter()
    sim.step(steps)
    return (time.perf_counter() - wall) / steps, (time.process_time() - cpu) / steps


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--steps", type=int, default=50)
    p.add_argument("--rounds", type=int, default=3)
    p.add_argument("--warm", type=int, default=0)
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--radius", type=float, default=0.037)
    p.add_argument("--models", nargs="+", default=["pmb", "lps"], choices=["pmb", "lps"])
    p.add_argument("--no-lammps", action="store_true")
    p.add_argument("--full", action="store_true")
    p.add_argument("--accuracy", action="store_true")
    a = p.parse_args()
    if a.accuracy:
        from pd_accuracy import main as accuracy

        accuracy()
        return
    for model in a.models:
        t = time.perf_counter()
        sim = disk(model, a)
        print(
            f"{model}: {len(sim.body)} nodes, {2 * len(sim.body.bonds)} directed bonds, set up in "
            f"{time.perf_counter() - t:.1f} s, {a.threads} thread(s)"
        )
        sim.step(max(2, a.warm))
        ours, theirs = [], []
        for _ in range(a.rounds):
            ours.append(mine(sim, a.steps))
            print("  atc    wall {:7.1f} ms  CPU {:7.1f} ms a step".format(*(1e3 * x for x in ours[-1])), flush=True)
            if not a.no_lammps:
                theirs.append(lammps(model, a))
                print(
                    "  LAMMPS wall {:7.1f} ms  CPU {:7.1f} ms a step".format(*(1e3 * x for x in theirs[-1])), flush=True
                )
        if theirs:
            wall, cpu = np.median(theirs, axis=0) / np.median(ours, axis=0)
            print(f"  LAMMPS/atc, medians: wall {wall:.1f}, CPU {cpu:.1f}")
    if a.full:
        t, cpu = time.perf_counter(), time.process_time()
        sim = disk("pmb", a)
        sim.step(2000)
        print(
            f"the full PMB run of 2000 steps: wall {time.perf_counter() - t:.1f} s, CPU "
            f"{time.process_time() - cpu:.1f} s, {sim.n_broken} bonds broken,",
            end=" ",
        )
        print(
            f"contact list made {sim.contact.rebuilt} times, largest memory "
            f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB"
        )


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
