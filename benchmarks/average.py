"""Time averages in groups of frames against frame by frame: CPU seconds a frame, alternating in one process, and the
error found.

    python benchmarks/average.py [--cells N ...] [--frames N ...] [--single N] [--quantities ...]

Hot argon (N³ cells of 4 atoms) with Maxwell velocities, every frame displaced at random; 64³ points, R = 10 Å; one
thread, compiled before the clock starts.
"""

from __future__ import annotations

import argparse
import time
import warnings

import numpy as np

import atc
from atc.estimators import groups
from atc.plan import Request, plan
from atc.planning.calibrate import argon

CASES = [(kernel, tolerance, what) for kernel, tolerance in (("gaussian", 3e-3), ("quartic", 1e-3))
         for what in (["stress_potential"], ["density"], ["density", "momentum"], ["stress"])]  # fmt: skip


def trajectory(cells, frames):
    first, pot = argon(cells)
    rng = np.random.default_rng(0)
    shape = first.positions.shape
    return [
        first.replace(
            positions=first.positions + rng.normal(0, 0.08, shape),
            velocities=first.velocities + rng.normal(0, 1e-3, shape),
            step=k,
        )
        for k in range(frames)
    ], pot


def seconds(frames, size, *arguments):
    """CPU seconds a frame, and the result; size: frames added up at a time, of a window and so many atoms."""
    groups.size_of = size
    began = time.process_time()
    ds = atc.fields(frames, *arguments, threads=1, average=True)
    return (time.process_time() - began) / len(frames), ds


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--cells", type=int, nargs="*", default=[10, 20])
    p.add_argument("--frames", type=int, nargs="*", default=[256, 64])
    p.add_argument(
        "--single",
        type=int,
        default=32,
        help="frames of the run frame by frame, whose time a frame does not depend on them",
    )
    p.add_argument("--repeat", type=int, default=1)
    a = p.parse_args()
    together, alone = groups.size_of, lambda window, atoms: 1
    grid = atc.Grid.regular(shape=64)
    warnings.simplefilter("ignore")
    for cells, n in zip(a.cells, a.frames, strict=True):
        frames, pot = trajectory(cells, n)
        for kernel, tolerance, what in CASES:
            arguments = (pot, atc.kernel(kernel, radius=10.0), grid, what, tolerance)
            m = together(n, len(frames[0]))
            seconds(frames[:m], lambda window, atoms: window, *arguments)
            seconds(frames[:2], alone, *arguments)
            best = [np.inf, np.inf]
            for _ in range(a.repeat):
                for k, (some, size) in enumerate(((frames, together), (frames[: a.single], alone))):
                    spent, ds = seconds(some, size, *arguments)
                    best[k] = min(best[k], spent)
                    if k == 0:
                        error = ds.attrs["measured_error"]
            groups.size_of = together
            said = plan(Request(frames, *arguments, threads=1, average=True))
            print(
                f"{len(frames[0]):6d} atoms, {n:4d} frames by {m:2d}  {kernel:8s} {tolerance:.0e} "
                f"{','.join(what):18s} single {1e3 * best[1]:7.1f} ms  "
                f"groups {1e3 * best[0]:7.1f} ms  ratio {best[1] / best[0]:.2f}  predicted "
                f"{1e3 * (said.cpu_seconds - said.parts['reading']):7.1f} ms  error {error:.1e}",
                flush=True,
            )


if __name__ == "__main__":
    main()
