"""The deposit of argon's stress, spectral against direct: seconds and error for kernels and tolerances.

    python benchmarks/spectral.py [--cells 20] [--kernel gaussian] [--radius 10] [--grid 64] [--tolerances 1e-2 ...] [--threads 1] [--no-direct]

20 and 40 cells an edge are 32k and 256k atoms. CPU and wall seconds of one run, kernels compiled before the clock starts, list and forces not included.
Errors are the largest, and the rms, against the exact sum at 300 random points, relative to the field's largest value, and its rms.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from frame import crystal

import atc
from atc.deposit import exact_at, make
from atc.frame import Cell
from atc.neighbors import CellList, Workspace
from atc.units import units

CUTOFF = 8.5


def argon(n):
    """Positions in the cell, and the bonds of the Lennard-Jones potential by pieces: (i, r, G)."""
    x, _, _, edge = crystal("lj", n)
    cell = Cell([edge] * 3)
    x = cell.wrap(x)[0]
    cells, ws, pieces = CellList(x, cell, CUTOFF), Workspace(), []
    for chunk in range(cells.n_chunks):
        m = cells.half(chunk, ws)
        i, r = ws.i[:m].copy(), ws.r[:m].copy()
        s6 = (3.4**2 / np.einsum("bc,bc->b", r, r)) ** 3
        pieces.append((i, r, 24 * 0.0104 * (s6 - 2 * s6**2) / np.einsum("bc,bc->b", r, r)))
    return x, cell, pieces


def run(make_deposit, x, pieces, threads):
    cpu, wall = time.process_time(), time.perf_counter()
    dep = make_deposit()
    ready = time.process_time()

    def part(t):
        for i, r, G in pieces[t::threads]:
            dep.add_bond_stress(x, i, r, G, thread=t)

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(part, range(threads)))
    added = time.process_time()
    sums = dep.bond_sums()
    return dep, sums, np.array([ready - cpu, added - ready, time.process_time() - added]), time.perf_counter() - wall


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--cells", type=int, default=20)
    p.add_argument("--kernel", nargs="+", default=["gaussian"])
    p.add_argument("--radius", type=float, default=10.0)
    p.add_argument("--grid", type=int, default=64)
    p.add_argument("--tolerances", type=float, nargs="+", default=[1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--no-direct", action="store_true")
    a = p.parse_args()
    x, cell, pieces = argon(a.cells)
    n_bond = sum(len(q[2]) for q in pieces)
    bound = atc.Grid.regular(shape=a.grid).bind(units("metal"), cell, x)
    which = np.random.default_rng(0).choice(len(bound), 300, replace=False)
    print(f"{len(x)} atoms, {n_bond} bonds, grid {a.grid}^3, R = {a.radius:g}, {a.threads} thread(s)")
    few = [tuple(part[:50] for part in pieces[0])]
    for name in a.kernel:
        kern = atc.kernel(name, a.radius)
        exact = exact_at(bound.points_gc[which], kern, cell, 0, 6)
        for i, r, G in pieces:
            exact.add_bond_stress(x, i, r, G)
        want = exact.bond_sums()
        cases = [(f"spectral {t:g}", "spectral", t) for t in a.tolerances] + ([] if a.no_direct else [("direct", "direct", 0.0)])
        print(f"{name:17s} CPU s: set up + add + finish = total; wall s; error max, L2")
        for label, method, tolerance in cases:

            def new(method=method, tolerance=tolerance, kern=kern):
                return make(method, bound, kern, cell, 0, 6, a.threads, tolerance)

            run(new, x, few, 1)
            dep, got, cpu, wall = run(new, x, pieces, a.threads)
            d = got[which] - want
            error = np.abs(d).max() / np.abs(got).max(), np.sqrt((d**2).mean() / (want**2).mean())
            how = (
                f"mesh {dep.mesh[0]}, width {dep.parameters.width}, {dep.points / n_bond:.2f} points a bond" if method == "spectral" else ""
            )
            print(
                f"{label:17s} {cpu[0]:.2f} + {cpu[1]:.2f} + {cpu[2]:.2f} = {cpu.sum():.2f}; {wall:.2f}; {error[0]:.1e} {error[1]:.1e} {how}",
                flush=True,
            )


if __name__ == "__main__":
    main()
