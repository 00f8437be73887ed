"""What choosing costs, and whether asking for less costs less: CPU seconds of the choice and of a frame at each
tolerance, beside the exact sum's.

    python benchmarks/choice.py [--cells N ...] [--points N] [--kernel NAME ...]

Hot argon (N³ cells of 4 atoms), stress on N³ points, R = 10 Å, one frame, so that nothing is spread over many; one
thread, compiled before the clock starts, the least of `--repeat` tries.
"""

from __future__ import annotations

import argparse
import time
import warnings

import atc
from atc.errors import AtcWarning
from atc.plan import Request
from atc.planning.calibrate import argon
from atc.planning.job import prepare

TOLERANCES = [1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8]


def seconds(call, repeat) -> float:
    """CPU seconds of a call, the least of so many."""
    call()
    took = []
    for _ in range(repeat):
        began = time.process_time()
        call()
        took.append(time.process_time() - began)
    return min(took)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--cells", type=int, nargs="*", default=[10])
    p.add_argument("--points", type=int, default=16)
    p.add_argument("--kernel", nargs="*", default=["quartic"])
    p.add_argument("--repeat", type=int, default=3)
    a = p.parse_args()
    warnings.simplefilter("ignore", AtcWarning)
    print(f"{'kernel':>10} {'atoms':>7} {'tolerance':>9} {'choice s':>9} {'frame s':>8} {'exact s':>8}  choice  method")
    for name in a.kernel:
        kern = atc.kernel(name, width=10.0 / 3) if name == "gaussian" else atc.kernel(name, radius=10.0)
        for cells in a.cells:
            frame, pot = argon(cells)
            about = (frame, pot, kern, atc.Grid.regular(shape=a.points), ["stress"])
            request = lambda t: Request(*about, tolerance=t, threads=1)  # noqa: E731
            exact = seconds(lambda: atc.fields(*about, tolerance=1e-12, method="direct", threads=1), a.repeat)
            for t in TOLERANCES:
                choice = seconds(lambda: prepare(request(t)), a.repeat)
                whole = seconds(lambda: atc.fields(*about, tolerance=t, threads=1), a.repeat)
                print(
                    f"{name:>10} {len(frame):>7} {t:>9.0e} {choice:>9.4f} {whole:>8.3f} {exact:>8.3f}  "
                    f"{100 * choice / whole:5.1f} %  {prepare(request(t)).method_used}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
