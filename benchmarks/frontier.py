"""The standing suite: time against error for argon and silicon of 4k to 256k atoms (1M with --big), R = 5 to 30 Å, grids of 20³ to 128³, every kernel.

    python benchmarks/frontier.py [--json benchmarks/frontier.json] [--picture docs/frontier.png] [--only WORDS ...] [--draw] [--big]

Each case is `atc.bench` on one frame: CPU seconds of a whole frame (list, forces, deposit, error check), one thread, errors against the exact sum. Cases that
are in the JSON already are kept, unless --again. --draw only draws what is there.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

import atc
from atc.bench import bench
from atc.calibrate import argon, silicon
from atc.plan import Request

HERE = Path(__file__).parent
MACHINE = "2-core x86-64 with AVX2, shared; CPU seconds of one thread"

# (model, cells an edge, kernel, R, points an edge, tolerances): argon 4 n³ atoms, silicon 8 n³.
LADDER = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
CASES = [
    *[("lj", 10, k, 10.0, 20, LADDER) for k in ("gaussian", "quartic", "lucy", "cubic", "hardy", "linear", "step")],
    *[("lj", 20, k, R, 40, LADDER) for k in ("gaussian", "quartic", "lucy") for R in (5.0, 10.0, 20.0)],
    ("lj", 20, "quartic", 30.0, 20, LADDER[:4]),
    ("lj", 20, "quartic", 10.0, 128, (1e-2, 3e-3, 1e-3)),
    ("lj", 20, "gaussian", 10.0, 128, LADDER[:5]),
    *[("sw", 10, k, 8.0, 20, LADDER) for k in ("gaussian", "quartic", "lucy")],
    *[("sw", 20, k, 10.0, 40, LADDER) for k in ("gaussian", "quartic")],
    ("lj", 40, "gaussian", 10.0, 64, LADDER[:5]),
    ("lj", 40, "gaussian", 20.0, 64, LADDER[:4]),
    ("lj", 40, "quartic", 10.0, 64, (1e-2, 3e-3, 1e-3)),
    ("lj", 40, "quartic", 20.0, 64, (1e-2, 1e-3)),
    ("lj", 40, "lucy", 10.0, 64, (1e-2, 1e-3, 1e-4)),
]
BIG = [("lj", 63, "gaussian", 10.0, 128, (1e-3, 1e-5)), ("lj", 63, "quartic", 10.0, 128, (3e-3,))]


def name_of(case):
    model, n, kernel, radius, points, _ = case
    return f"{model} {(4 if model == 'lj' else 8) * n**3} atoms, {kernel} R={radius:g}, {points}^3"


def draw(results, path):
    """Four panels: fronts by kernel, by radius, by size, and silicon."""
    from matplotlib.figure import Figure

    panels = [
        ("argon, 4k atoms, 20³, R = 10 Å", [r for r in results if r["model"] == "lj" and r["atoms"] == 4000]),
        ("argon, 32k atoms, 40³", [r for r in results if r["model"] == "lj" and r["atoms"] == 32000 and r["grid"] == 40]),
        ("argon, 256k atoms, 64³", [r for r in results if r["model"] == "lj" and r["atoms"] == 256000]),
        ("silicon, 8k atoms, 20³, R = 8 Å; 64k, 40³, R = 10 Å", [r for r in results if r["model"] == "sw"]),
    ]
    figure = Figure(figsize=(11, 8), layout="constrained")
    for k, (title, some) in enumerate(panels):
        ax = figure.add_subplot(2, 2, k + 1)
        for c, r in enumerate(some):
            color = f"C{c % 10}"
            front = sorted((q["cpu"], q["error_max"]) for q in r["rungs"] if q["front"] and q["method"] in ("spectral", "direct"))
            ax.plot(*zip(*front), color=color, lw=1, alpha=0.6)
            for q in r["rungs"]:
                marker = {"spectral": "o", "direct": "s", "smoothed virial": "^", "binned virial": "v"}[q["method"]]
                ax.plot(q["cpu"], q["error_max"], marker=marker, color=color, ms=5, mfc=color if q["front"] else "none")
            label = r["name"].split(", ")[1] + (f", {r['atoms'] // 1000}k" if r["model"] == "sw" else "")
            ax.plot([], [], color=color, marker="o", label=label)
        ax.set(xscale="log", yscale="log", title=title, xlabel="CPU seconds a frame", ylabel="largest error / largest value")
        ax.grid(True, alpha=0.25)
        ax.legend(fontsize=7, loc="center left")
    figure.suptitle(
        "circles spectral, squares direct (exact), hollow: beaten in time and error; triangles: smoothed (up) and binned (down) per-atom virials against Hardy's stress",
        fontsize=10,
    )
    figure.savefig(path, dpi=110)


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--json", type=Path, default=HERE / "frontier.json")
    p.add_argument("--picture", type=Path, default=HERE.parent / "docs" / "frontier.png")
    p.add_argument("--only", nargs="*", default=[], help="words that a case must have in its name")
    p.add_argument("--draw", action="store_true")
    p.add_argument("--big", action="store_true")
    p.add_argument("--again", action="store_true")
    a = p.parse_args()
    known = json.loads(a.json.read_text()) if a.json.exists() else {"machine": MACHINE, "cases": []}
    made = {}
    for case in [] if a.draw else CASES + (BIG if a.big else []):
        name = name_of(case)
        if not all(w in name for w in a.only) or (not a.again and any(c["name"] == name for c in known["cases"])):
            continue
        model, n, kernel, radius, points, ladder = case
        if (model, n) not in made:
            made = {(model, n): {"lj": argon, "sw": silicon}[model](n)}
        frame, pot = made[model, n]
        request = Request(frame, pot, atc.kernel(kernel, radius=radius), atc.Grid.regular(shape=points), ["stress_potential"], threads=1)
        result = bench(request, ladder, most=60.0)
        row = {"name": name, "model": model, "kernel": kernel, "radius": radius, "grid": points, **asdict(result)}
        del row["title"]
        for r in row["rungs"]:
            for key in ("cpu", "wall", "error_max", "error_l2"):
                r[key] = float(f"{r[key]:.3g}")
        known["cases"] = [c for c in known["cases"] if c["name"] != name] + [row]
        a.json.write_text(json.dumps(known, indent=1) + "\n")
        print(name, "; ".join(f"{r.label} {r.cpu:.2f} s {r.error_max:.1e}" for r in result.rungs), flush=True)
    draw(known["cases"], a.picture)


if __name__ == "__main__":
    main()
