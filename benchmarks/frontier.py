"""The standing suite: time against error for argon and silicon of 4k to 256k atoms (1M with --big), R = 5 to 30 Å,
grids of 20³ to 128³, every kernel.

    python benchmarks/frontier.py [--json benchmarks/frontier.json] [--picture docs/frontier.png] [--only WORDS ...]
    [--draw] [--big] [--list] [--most 120]

Each case is `atc.bench` on one frame: CPU seconds of a whole frame (list, forces, deposit, error check), one thread,
errors against the exact sum. Cases that are in the JSON already are kept, unless --again. --draw only draws what is
there; --list says which cases would run and what they are predicted to take. In pieces: --again --only lj 32000 R=30,
and so on; the file is written after each case. What is predicted to take more than --most seconds of CPU is left out,
and the file says so ("left_out"): without the exact sum errors are those found at random points.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import asdict
from pathlib import Path

import atc
from atc.analysis.bench import bench
from atc.errors import AtcError
from atc.plan import Request, prepare
from atc.planning.calibrate import argon, silicon
from atc.planning.costs import direct

HERE = Path(__file__).parent
MACHINE = "2-core x86-64 with AVX2, shared; CPU seconds of one thread"

# (model, cells an edge, kernel, R, points an edge, tolerances): argon 4 n³ atoms, silicon 8 n³.
LADDER = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
KINKED = (1e-2, 3e-3, 1e-3)
EVERY = ("gaussian", "quartic", "lucy", "cubic", "bspline", "hardy", "linear", "step", "box")
CASES = [
    # every kernel, small
    *[("lj", 10, k, 10.0, 20, LADDER) for k in EVERY],
    *[("sw", 10, k, 8.0, 20, LADDER) for k in EVERY],
    # every radius
    *[("lj", 20, k, R, 40, LADDER) for k in ("gaussian", "quartic", "lucy") for R in (5.0, 10.0, 20.0, 30.0)],
    *[("sw", 20, k, R, 40, LADDER) for k in ("gaussian", "quartic") for R in (5.0, 10.0, 20.0, 30.0)],
    # every grid
    *[("lj", 20, "gaussian", 10.0, points, LADDER[:5]) for points in (20, 64, 128)],
    *[("lj", 20, "quartic", 10.0, points, KINKED) for points in (20, 64, 128)],
    ("lj", 20, "quartic", 30.0, 20, LADDER[:4]),
    *[("sw", 20, k, 10.0, 128, KINKED) for k in ("gaussian", "quartic")],
    # every size
    *[("lj", 40, "gaussian", R, 64, LADDER[:5]) for R in (5.0, 10.0, 20.0, 30.0)],
    *[("lj", 40, "quartic", R, 64, KINKED) for R in (5.0, 10.0, 20.0, 30.0)],
    ("lj", 40, "lucy", 10.0, 64, (1e-2, 1e-3, 1e-4)),
    *[("sw", 32, k, 10.0, 64, KINKED) for k in ("gaussian", "quartic")],
]
# 1M atoms: up to 6 GB.
BIG = [
    *[("lj", 63, "gaussian", R, 64, (1e-2, 1e-3, 1e-5)) for R in (5.0, 10.0, 30.0)],
    ("lj", 63, "gaussian", 10.0, 128, (1e-3, 1e-5)),
    *[("lj", 63, "quartic", R, points, KINKED) for R, points in ((10.0, 64), (10.0, 128), (30.0, 64))],
    ("lj", 63, "lucy", 30.0, 64, (1e-2, 1e-3)),
    *[("sw", 50, k, 10.0, 64, (1e-2, 1e-3)) for k in ("gaussian", "quartic")],
]


def name_of(case):
    model, n, kernel, radius, points, _ = case
    return f"{model} {(4 if model == 'lj' else 8) * n**3} atoms, {kernel} R={radius:g}, {points}^3"


def exact_seconds(request) -> float:
    """What the exact sum of a case is predicted to take, in CPU seconds."""
    load = request.load
    return load.seconds(request.costs, len(request.first)) + direct(
        request.costs, request.bound, request.kernel_internal, load.bonds, load.length, request.work.n_bond
    )


def draw(results, path):
    """Fronts by kernel, by radius, by size, and silicon's."""
    from matplotlib.figure import Figure

    def some(model, atoms, grid):
        return [r for r in results if (r["model"], r["atoms"]) == (model, atoms) and r["grid"] in grid and r["rungs"]]

    panels = [
        ("argon, 4k atoms, 20³, R = 10 Å", some("lj", 4000, (20,))),
        ("argon, 32k atoms, 40³", some("lj", 32000, (40,))),
        ("argon, 256k atoms, 64³", some("lj", 256000, (64,))),
        ("argon, 1M atoms, 64³ and 128³", some("lj", 1000188, (64, 128))),
        ("silicon, 8k atoms, 20³, R = 8 Å", some("sw", 8000, (20,))),
        ("silicon, 64k atoms, 40³", some("sw", 64000, (40,))),
    ]
    panels = [p for p in panels if p[1]]
    rows = -(-len(panels) // 2)
    figure = Figure(figsize=(11, 4 * rows), layout="constrained")
    for k, (title, cases) in enumerate(panels):
        ax = figure.add_subplot(rows, 2, k + 1)
        for c, r in enumerate(cases):
            color = f"C{c % 10}"
            front = sorted(
                (q["cpu"], q["error_max"]) for q in r["rungs"] if q["front"] and q["method"] in ("spectral", "direct")
            )
            ax.plot(*zip(*front), color=color, lw=1, alpha=0.6)
            for q in r["rungs"]:
                marker = {"spectral": "o", "direct": "s", "smoothed virial": "^", "binned virial": "v"}[q["method"]]
                ax.plot(q["cpu"], q["error_max"], marker=marker, color=color, ms=5, mfc=color if q["front"] else "none")
            ax.plot([], [], color=color, marker="o", label=r["name"].split(", ", 1)[1].replace("^3", "³"))
        ax.set(
            xscale="log",
            yscale="log",
            title=title,
            xlabel="CPU seconds a frame",
            ylabel="largest error / largest value",
        )
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize=7, loc="center left")
    figure.suptitle(
        "circles spectral, squares direct (exact), hollow: beaten in time and error; triangles: smoothed (up) and "
        "binned (down) per-atom virials against Hardy's stress",
        fontsize=10,
    )
    figure.savefig(path, dpi=110)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--json", type=Path, default=HERE / "frontier.json")
    p.add_argument("--picture", type=Path, default=HERE.parent / "docs" / "frontier.png")
    p.add_argument(
        "--only", nargs="*", default=[], help="words that a case must have in its name: lj, 32000, gaussian, R=10, 40^3"
    )
    p.add_argument("--draw", action="store_true")
    p.add_argument("--big", action="store_true")
    p.add_argument("--again", action="store_true")
    p.add_argument("--list", action="store_true", help="say what would run, and run nothing")
    p.add_argument(
        "--most", type=float, default=120.0, help="CPU seconds that one way to compute a frame may be predicted to take"
    )
    a = p.parse_args()
    known = json.loads(a.json.read_text()) if a.json.exists() else {"machine": MACHINE, "cases": []}
    there = set() if a.again else {c["name"] for c in known["cases"]}
    cases = [
        c
        for c in CASES + (BIG if a.big else [])
        if all(w in name_of(c).replace(",", "").split() for w in a.only) and name_of(c) not in there
    ]
    made = {}
    for number, case in enumerate([] if a.draw else cases, 1):
        name = name_of(case)
        model, n, kernel, radius, points, ladder = case
        if (model, n) not in made:
            made = {(model, n): {"lj": argon, "sw": silicon}[model](n)}
        frame, pot = made[model, n]
        kern = atc.kernel("box", size=radius) if kernel == "box" else atc.kernel(kernel, radius=radius)
        request = prepare(Request(frame, pot, kern, atc.Grid.regular(shape=points), ["stress_potential"], threads=1))
        print(
            f"[{number}/{len(cases)}] {time.strftime('%H:%M:%S')} {name}: exact sum predicted to take "
            f"{exact_seconds(request):.0f} s",
            flush=True,
        )
        if a.list:
            continue
        row = {"name": name, "model": model, "kernel": kernel, "radius": radius, "grid": points, "atoms": len(frame)}
        try:
            result = bench(
                request,
                ladder,
                progress=lambda what: print(f"    {time.strftime('%H:%M:%S')} {what}", flush=True),
                most=a.most,
                most_each=a.most,
            )
        except AtcError as e:
            # Nothing is quick enough, which belongs in the file too.
            row |= {"rungs": [], "left_out": [("all", str(e))]}
        else:
            row = asdict(result) | row
            del row["title"]
        for r in row["rungs"]:
            for key in ("cpu", "wall", "error_max", "error_l2"):
                r[key] = float(f"{r[key]:.3g}")
        known["cases"] = [c for c in known["cases"] if c["name"] != name] + [row]
        a.json.write_text(json.dumps(known, indent=1) + "\n")
        print(
            "    " + "; ".join(f"{r['label']} {r['cpu']:.2f} s {r['error_max']:.1e}" for r in row["rungs"]), flush=True
        )
        for what, why in row["left_out"]:
            print(f"    left out: {what}: {why}", flush=True)
    if not a.list:
        draw(known["cases"], a.picture)


if __name__ == "__main__":
    main()
