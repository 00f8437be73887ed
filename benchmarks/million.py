"""One million argon atoms on 128³ points: CPU seconds and peak memory of one frame, against what the plan says.

python benchmarks/million.py [--kernel gaussian] [--radius 10] [--tolerance 1e-5] [--cells 63] [--grid 128] [--threads
2] [--quantities stress]
"""

from __future__ import annotations

import argparse
import resource
import time

import atc
from atc.plan import plan
from atc.planning.calibrate import argon


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--kernel", default="gaussian")
    p.add_argument("--radius", type=float, default=10.0)
    p.add_argument("--tolerance", type=float, default=1e-5)
    p.add_argument("--cells", type=int, default=63)
    p.add_argument("--grid", type=int, default=128)
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--quantities", nargs="+", default=["stress"])
    a = p.parse_args()
    frame, pot = argon(a.cells)
    arguments = (
        frame,
        pot,
        atc.kernel(a.kernel, radius=a.radius),
        atc.Grid.regular(shape=a.grid),
        a.quantities,
        a.tolerance,
    )
    planned = plan(*arguments, threads=a.threads)
    print(planned)
    cpu, wall = time.process_time(), time.perf_counter()
    ds = atc.fields(*arguments, threads=a.threads)
    cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(
        f"\n{len(frame)} atoms, {a.grid}^3: CPU {cpu:.1f} s, wall {wall:.1f} s (compilation included), peak memory "
        f"{peak / 1e9:.2f} GB; "
        f"planned {planned.cpu_seconds:.1f} s, {planned.memory / 1e9:.2f} GB; {ds.attrs['method_details']}; error "
        f"{ds.attrs['measured_error']:.1e}"
    )


if __name__ == "__main__":
    main()
