"""Seconds a frame, split into read, list, list + forces, deposit and write, for argon and silicon of 4k to 256k atoms.

    python benchmarks/frame.py [--sizes 10 20 40] [--model lj sw] [--grids 20 64] [--threads 1] [--radius 10]

CPU and wall seconds of one process (kernels compiled before the clock starts). Sizes are cubic cells along an edge: 10,
20, 40 give 4k, 32k and 256k atoms of argon. Peak memory is that of the whole process, so give one size to know it for
that size. Machines differ and drift: quote ratios.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

import numpy as np

import atc
from atc.deposit import make
from atc.neighbors.cell_list import CellList, Workspace

SW = "Si Si Si 2.1683 2.0951 1.80 21.0 1.20 -0.333333333333 7.049556277 0.6022245584 4.0 0.0 0.0\n"


def crystal(model, n):
    """Hot argon (fcc) or silicon (diamond), atoms in random order as after a long run."""
    rng = np.random.default_rng(0)
    fcc = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    a, basis, mass, shake = (
        (5.376, fcc, 39.948, 0.25) if model == "lj" else (5.431, np.concatenate([fcc, fcc + 0.25]), 28.0855, 0.15)
    )
    cells = np.stack(np.meshgrid(*[np.arange(n)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = (cells + basis).reshape(-1, 3) * a
    x = (x + rng.normal(0, shake, x.shape))[rng.permutation(len(x))]
    return x, rng.normal(0, 1, x.shape), mass, n * a


def write_dump(path, x, v, box):
    n = len(x)
    with open(path, "w") as f:
        f.write(
            f"ITEM: UNITS\nmetal\nITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{n}\nITEM: BOX BOUNDS pp pp pp\n"
            + f"0 {box!r}\n" * 3
        )
        f.write("ITEM: ATOMS id type x y z vx vy vz\n")
        np.savetxt(f, np.c_[np.arange(1, n + 1), np.ones(n), x, v], fmt="%d %d %.10g %.10g %.10g %.10g %.10g %.10g")
    return path.stat().st_size


def clock(f, repeat=3):
    """(result, least CPU seconds, least wall seconds) of `repeat` runs."""
    cpu, wall = [], []
    for _ in range(repeat):
        c, w = time.process_time(), time.perf_counter()
        out = f()
        cpu.append(time.process_time() - c)
        wall.append(time.perf_counter() - w)
    return out, min(cpu), min(wall)


def search(frame, cutoff):
    cells, ws = CellList(frame.positions, frame.cell, cutoff), Workspace()
    return sum(cells.half(k, ws) for k in range(cells.n_chunks))


def write_again(ds, path):
    ds.load().drop_encoding().to_zarr(path, mode="w", zarr_format=2)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--sizes", type=int, nargs="+", default=[10, 20, 40])
    p.add_argument("--grids", type=int, nargs="*", default=[20, 64])
    p.add_argument("--model", nargs="+", default=["lj", "sw"], choices=["lj", "sw"])
    p.add_argument("--kernel", default="quartic")
    p.add_argument("--radius", type=float, default=10.0)
    p.add_argument("--threads", type=int, default=1)
    a = p.parse_args()
    kern = atc.kernel(a.kernel, radius=a.radius)
    print(f"{a.kernel}, R = {a.radius:g} A, {a.threads} thread(s); seconds CPU/wall; least of 3")
    with tempfile.TemporaryDirectory() as tmp:
        tmp = Path(tmp)
        (tmp / "Si.sw").write_text(SW)
        models = {
            "lj": "units metal\npair_style lj/cut 8.5\npair_coeff 1 1 0.0104 3.4",
            "sw": f"units metal\npair_style sw\npair_coeff * * {tmp}/Si.sw Si",
        }
        for model in a.model:
            pot = atc.potential(models[model])
            for n in a.sizes:
                x, v, mass, box = crystal(model, n)
                size = write_dump(tmp / "a.dump", x, v, box)
                frame, *read = clock(lambda: atc.read(tmp / "a.dump", masses=[mass])[0])
                pairs, *found = clock(lambda: search(frame, pot.cutoff))
                d, *forces = clock(lambda: pot.stream(frame, forces=True, energies=True, threads=a.threads))
                atoms = len(frame)
                print(
                    f"\n{model}, {atoms} atoms, {pairs / atoms:.1f} pairs and {d.n_bonds / atoms:.1f} bonds an atom\n"
                    f"  read           {read[0]:8.3f} {read[1]:8.3f}   {size / read[1] / 1e6:.0f} MB/s\n"
                    f"  list           {found[0]:8.3f} {found[1]:8.3f}   {found[0] / atoms * 1e6:.2f} us CPU an atom\n"
                    f"  list + forces  {forces[0]:8.3f} {forces[1]:8.3f}   {forces[0] / atoms * 1e6:.2f} us CPU an atom"
                )
                for g in a.grids:
                    grid = atc.Grid.regular(shape=(g, g, g))
                    bound = grid.bind(frame.units, frame.cell, frame.positions)

                    def stress(bound=bound):
                        dep = make(
                            "direct", bound, kern.scaled(frame.units.length), frame.cell, 0, 6, threads=a.threads
                        )
                        pot.stream(
                            frame,
                            lambda b, t: dep.add_bond_stress(frame.positions, b.i, b.r_bc, b.G_b, thread=t),
                            threads=a.threads,
                        )
                        dep.bond_sums()
                        return dep.visits

                    def whole(grid=grid, g=g):
                        return atc.fields(
                            frame,
                            pot,
                            kern,
                            grid,
                            ["stress", "density"],
                            threads=a.threads,
                            tolerance=1e-12,
                            out=tmp / f"{g}.zarr",
                        )

                    stress()
                    visits, *dep = clock(stress, repeat=1 if atoms * g**3 > 1e10 else 3)
                    whole()  # imports and kernels
                    ds, *everything = clock(whole, repeat=1)
                    _, *write = clock(lambda: write_again(ds, tmp / "w.zarr"), repeat=1)
                    deposit = dep[0] - forces[0]
                    print(
                        f"  {g}^3: stress      {dep[0]:8.3f} {dep[1]:8.3f}   list, forces and deposit; deposit "
                        f"{deposit / visits * 1e9:.1f} ns CPU a visit, {visits:.3g} visits\n"
                        f"  {g}^3: all         {everything[0]:8.3f} {everything[1]:8.3f}   atc.fields: stress with "
                        "both parts, density, error check, file\n"
                        f"  {g}^3: write       {write[0]:8.3f} {write[1]:8.3f}"
                    )
    print(f"\npeak memory {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
