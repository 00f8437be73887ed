"""The deposit of argon's stress, spectral against direct: seconds and error for kernels and tolerances.

    python benchmarks/spectral.py [--cells 20] [--kernel gaussian] [--radius 10] [--grid 64] [--tolerances 1e-2 ...]
    [--threads 1] [--no-direct] python benchmarks/spectral.py --finufft [--cells 10] [--tolerances ...]        own
    spreading against finufft's, at equal error

20 and 40 cells an edge are 32k and 256k atoms. CPU and wall seconds of one run, kernels compiled before the clock
starts, list and forces not included. Errors are the largest, and the rms, against the exact sum at 300 random points,
relative to the field's largest value, and its rms.
"""

from __future__ import annotations

import argparse
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from frame import crystal

import atc
from atc.deposit import exact_at, make
from atc.deposit.direct import stress_components
from atc.frame import Cell
from atc.neighbors.cell_list import CellList, Workspace
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


def modes_by_finufft(plan_of, x, values):
    """Best of three runs: (modes, CPU seconds). Points are sorted anew every time, as they are new in every frame."""
    best = np.inf
    for _ in range(3):
        start = time.process_time()
        plan = plan_of()
        plan.setpts(*np.ascontiguousarray(x.T))
        modes = plan.execute(values)
        best = min(best, time.process_time() - start)
    return modes, best


def against_finufft(x, cell, pieces, kern, tolerances, grid):
    """Modes of the same points by both, one thread. Six real components are three complex ones to finufft; its
    upsampling is 2 or 1.25, whichever is faster."""
    import finufft

    i, r, G = (np.concatenate([q[k] for q in pieces]) for k in range(3))
    # Two points a bond, as many as there are in earnest.
    t = 0.5 - 0.5 / np.sqrt(3.0)
    points = np.concatenate([np.stack([x[i] - t * r, x[i] - (1 - t) * r], 1).reshape(-1, 3)])
    values = np.repeat(stress_components(r, G), 2, axis=0)
    bound = atc.Grid.regular(shape=grid).bind(units("metal"), cell, x)
    edge = cell.vectors[0, 0]
    print(
        f"{len(points)} points, 6 components, one thread, {kern.name} R = {kern.radius:g}; CPU s; errors: of the "
        "field, rms"
    )
    for tolerance in tolerances:
        own = np.inf
        for _ in range(4):
            dep = make("spectral", bound, kern, cell, 6, 0, 1, tolerance)
            _ = dep.window, dep.bond_points.longest
            start = time.process_time()
            dep.add_sites(points, values)
            spread = time.process_time() - start
            done = dep._transformed("site", dep._groups(6)[0])
            own = min(own, time.process_time() - start)
        modes, F, scale = done
        k = modes.largest
        shape = tuple(int(2 * m + 1) for m in k)
        w0, w1, w2 = np.ix_(*[modes.window_hat(a) for a in range(3)])
        phi = modes.response() * w0 * w1 * w2
        middle = np.ix_(modes.index[0] + k[0], modes.index[1] + k[1], modes.index[2] + k[2])

        def field_modes(Z, middle=middle, phi=phi, k=k):
            """Those of six real components from those of three complex ones."""
            mirror = np.conj(Z[:, ::-1, ::-1, ::-1])
            pair = np.stack([0.5 * (Z + mirror), -0.5j * (Z - mirror)], 1).reshape(6, *Z.shape[1:])
            return pair[(slice(None), *middle)] * phi

        angle = 2 * np.pi * (points / edge % 1.0)
        pairs = np.ascontiguousarray((values[:, 0::2] + 1j * values[:, 1::2]).T)

        def plan(eps, factor, dtype, shape=shape):
            return finufft.Plan(1, shape, n_trans=3, eps=eps, isign=-1, dtype=dtype, nthreads=1, upsampfac=factor)

        want = field_modes(modes_by_finufft(lambda: plan(1e-12, 2.0, "complex128"), angle, pairs)[0])
        norm = np.sqrt((np.abs(want) ** 2).sum())
        error = np.sqrt((np.abs(np.stack(F) * scale - want) ** 2).sum()) / norm
        found = []
        for factor in (2.0, 1.25):
            for eps in 10.0 ** np.arange(-1.0, -12.0, -0.5):
                dtype = "complex64" if eps >= 1e-5 else "complex128"
                real = np.float32 if dtype == "complex64" else np.float64
                Z, seconds = modes_by_finufft(
                    lambda e=eps, f=factor, d=dtype: plan(e, f, d), angle.astype(real), pairs.astype(dtype)
                )
                its = np.sqrt((np.abs(field_modes(Z) - want) ** 2).sum()) / norm
                if its <= error:
                    found.append((seconds, its, eps, factor, dtype))
                    break
        seconds, its, eps, factor, dtype = min(found)
        print(
            f"tolerance {tolerance:g}: own {own:.2f} s (spreading {spread:.2f}, width {dep.parameters.width}, mesh "
            f"{dep.mesh[0]}) error {error:.1e}; "
            f"finufft {seconds:.2f} s (eps {eps:.0e}, upsampling {factor:g}, {dtype}, modes {shape[0]}) error "
            f"{its:.1e}; {seconds / own:.1f} times",
            flush=True,
        )


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--cells", type=int, default=20)
    p.add_argument("--kernel", nargs="+", default=["gaussian"])
    p.add_argument("--radius", type=float, default=10.0)
    p.add_argument("--grid", type=int, default=64)
    p.add_argument("--tolerances", type=float, nargs="+", default=[1e-2, 1e-3, 1e-4, 1e-5, 1e-6])
    p.add_argument("--threads", type=int, default=1)
    p.add_argument("--no-direct", action="store_true")
    p.add_argument("--finufft", action="store_true")
    a = p.parse_args()
    x, cell, pieces = argon(a.cells)
    if a.finufft:
        for name in a.kernel:
            against_finufft(x, cell, pieces, atc.kernel(name, a.radius), a.tolerances, a.grid)
        return
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
        cases = [(f"spectral {t:g}", "spectral", t) for t in a.tolerances] + (
            [] if a.no_direct else [("direct", "direct", 0.0)]
        )
        print(f"{name:17s} CPU s: set up + add + finish = total; wall s; error max, L2")
        for label, method, tolerance in cases:

            def new(method=method, tolerance=tolerance, kern=kern):
                return make(method, bound, kern, cell, 0, 6, a.threads, tolerance)

            run(new, x, few, 1)
            dep, got, cpu, wall = run(new, x, pieces, a.threads)
            d = got[which] - want
            error = np.abs(d).max() / np.abs(got).max(), np.sqrt((d**2).mean() / (want**2).mean())
            how = (
                f"mesh {dep.mesh[0]}, width {dep.parameters.width}, {dep.points / n_bond:.2f} points a bond"
                if method == "spectral"
                else ""
            )
            print(
                f"{label:17s} {cpu[0]:.2f} + {cpu[1]:.2f} + {cpu[2]:.2f} = {cpu.sum():.2f}; {wall:.2f}; "
                f"{error[0]:.1e} {error[1]:.1e} {how}",
                flush=True,
            )


if __name__ == "__main__":
    main()
