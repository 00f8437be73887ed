"""What the first run ever of a plain Lennard-Jones stress scene compiles, and how long it takes: with an empty folder
for compiled code, the command `atc fields` on 4000 atoms.

    python benchmarks/first_run.py [N]      the N kernels that take longest (30), then the sums
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

SCENE = """
[trajectory]
file = "lj.dump"
units = "lj"
masses = [1.0]
[potential]
lammps = "pair_style lj/cut 2.5\\npair_coeff * * 1.0 1.0"
[kernel]
name = "lucy"
radius = 2.0
[grid]
kind = "regular"
shape = [12, 12, 12]
[fields]
quantities = ["stress"]
"""


def crystal(path: Path, n: int = 10, edge: float = 1.7) -> None:
    """A disturbed fcc crystal of n³ cells as a dump."""
    rng = np.random.default_rng(1)
    basis = np.array([[0, 0, 0], [0.5, 0.5, 0], [0.5, 0, 0.5], [0, 0.5, 0.5]])
    cells = np.stack(np.meshgrid(*3 * [np.arange(n)], indexing="ij"), -1).reshape(-1, 1, 3)
    x = edge * (cells + basis).reshape(-1, 3)
    x += rng.uniform(-0.05, 0.05, x.shape)
    v = rng.normal(0, 1, x.shape)
    rows = (f"{k} 1 " + " ".join(f"{c:.6f}" for c in (*a, *b)) for k, (a, b) in enumerate(zip(x, v, strict=True), 1))
    head = f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS pp pp pp\n" + f"0 {n * edge}\n" * 3
    path.write_text(head + "ITEM: ATOMS id type x y z vx vy vz\n" + "\n".join(rows) + "\n")


def watched(arguments: list[str], shown: int) -> None:
    """Run `atc` in this process, and say what numba compiled for it."""
    from numba.core import event

    done, open_ = [], []

    class Listener(event.Listener):
        def on_start(self, e):
            f = e.data["dispatcher"].py_func
            open_.append([f"{f.__module__}.{f.__qualname__}", time.process_time(), 0.0])

        def on_end(self, e):
            name, start, inner = open_.pop()
            took = time.process_time() - start
            if open_:
                open_[-1][2] += took
            done.append((took - inner, name))

    event.register("numba:compile", Listener())
    sys.argv = ["atc", *arguments]
    from atc.cli import main

    try:
        main()
    except SystemExit as e:
        if e.code:
            raise
    for seconds, name in sorted(done, reverse=True)[:shown]:
        print(f"{seconds:6.2f} s  {name}")
    total = sum(seconds for seconds, _ in done)
    print(
        f"{len({name for _, name in done})} functions, {len(done)} compilations, {total:.1f} s of "
        f"{time.process_time():.1f} s of the processor"
    )


if __name__ == "__main__":
    if sys.argv[1:2] == ["--watched"]:
        watched(sys.argv[3:], int(sys.argv[2]))
    else:
        with tempfile.TemporaryDirectory() as folder:
            crystal(Path(folder, "lj.dump"))
            Path(folder, "scene.toml").write_text(SCENE)
            (Path(folder) / "cache").mkdir()
            start = time.perf_counter()
            subprocess.run(
                [sys.executable, __file__, "--watched", sys.argv[1] if sys.argv[1:] else "30"]
                + ["fields", "scene.toml", "-o", "out.nc", "-q"],
                cwd=folder,
                env={**os.environ, "NUMBA_CACHE_DIR": str(Path(folder, "cache"))},
                check=True,
            )
            print(f"{time.perf_counter() - start:.1f} s by the clock")
