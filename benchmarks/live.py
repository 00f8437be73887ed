"""What `atc.Live` costs beside the run that it looks at: a Lennard-Jones fluid, every 100th step, several grids.

python benchmarks/live.py [frames] [cells]
"""

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent.parent / "tests"))

from lammps_oracle import lammps_session

import atc

RUN = """
units metal
atom_style atomic
lattice fcc 5.7
region box block 0 {n} 0 {n} 0 {n}
create_box 1 box
create_atoms 1 box
mass 1 39.948
velocity all create 240 87287
pair_style lj/cut 8.5
pair_coeff * * 0.0104 3.4
timestep 0.004
fix 1 all nve
run 500
"""
EVERY = 100


def main(frames: int = 60, n: int = 10) -> None:
    pot = atc.potential("pair_style lj/cut 8.5\npair_coeff * * 0.0104 3.4", units="metal")
    kern = atc.kernel("quartic", 7.0)
    cases = {
        "slab of 50 bins: stress, temperature, velocity": (
            atc.Grid.slab("z", 50),
            ["stress", "temperature", "velocity"],
        ),
        "20 x 20 x 20 points: stress_potential": (atc.Grid.regular(shape=20), ["stress_potential"]),
        "20 x 20 x 20 points: stress, velocity": (atc.Grid.regular(shape=20), ["stress", "velocity"]),
    }
    with lammps_session() as lmp:
        lmp.commands_string(RUN.format(n=n))
        print(f"{lmp.get_natoms()} atoms, {frames} frames, one every {EVERY} steps")
        for name, (grid, names) in cases.items():
            warm = atc.Live(pot, kern, grid, names, frames=1000)
            warm.run(lmp, 4 * EVERY, every=EVERY)
            warm.result()
            live = atc.Live(pot, kern, grid, names, frames=1000, threads=1)
            began = time.process_time()  # of this one thread, whatever else the machine does
            live.run(lmp, frames * EVERY, every=EVERY)
            live.result()
            both = time.process_time() - began
            began = time.process_time()
            lmp.command(f"run {frames * EVERY}")
            run = time.process_time() - began
            steps = (both - run) / frames / (run / (frames * EVERY))
            print(f"{name}: run {run:.2f} s, atc {both - run:.2f} s: a frame costs {steps:.0f} steps", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
