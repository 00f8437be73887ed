"""Predicted against measured CPU seconds of whole frames (`atc.plan` against `atc.fields`), for argon and silicon: the
model promises a factor of two.

    python benchmarks/predict.py [--json FILE] [--calibrate] [--big]

Frames in memory, one thread, compiled before the clock starts. `--calibrate` measures the model's constants first (kept
nowhere).
"""

from __future__ import annotations

import argparse
import json
import time
import warnings

import atc
from atc.plan import Request, plan, prepare
from atc.planning.calibrate import argon, calibrate, silicon
from atc.planning.costs import Costs

CASES = [
    ("lj", 10, "quartic", 10.0, 20, 1e-12, ["stress"]),
    ("lj", 10, "quartic", 5.0, 40, 1e-5, ["stress_potential"]),
    ("lj", 16, "quartic", 10.0, 32, 1e-5, ["stress"]),
    ("lj", 16, "quartic", 10.0, 32, 3e-3, ["stress"]),
    ("lj", 16, "gaussian", 10.0, 32, 1e-5, ["stress"]),
    ("lj", 16, "gaussian", 5.0, 48, 1e-3, ["stress"]),
    ("lj", 16, "lucy", 8.0, 48, 1e-3, ["stress", "density"]),
    ("lj", 16, "cubic", 8.0, 24, 1e-12, ["stress"]),
    ("lj", 16, "hardy", 8.0, 24, 1e-5, ["stress_potential"]),
    ("lj", 16, None, 0.0, 0, 1e-5, ["virial_stress"]),
    ("lj", 16, "quartic", 6.0, 64, 1e-5, ["density", "velocity", "temperature"]),
    ("lj", 16, "quartic", 6.0, 20, 1e-5, ["smoothed_virial_stress"]),
    ("sw", 12, "quartic", 8.0, 24, 1e-5, ["stress"]),
    ("sw", 12, "gaussian", 8.0, 24, 1e-5, ["stress"]),
    ("sw", 12, "quartic", 6.0, 24, 1e-5, ["heat_flux"]),
    ("sw", 12, None, 0.0, 0, 1e-5, ["virial_stress_per_atom"]),
    ("lj", 10, "bspline", 8.0, 12, 1e-12, ["stress_potential"]),
    ("lj", 16, "gaussian", 8.0, 32, 1e-4, ["velocity_gradient"]),
    ("lj", 16, "quartic", 8.0, 32, 1e-4, ["velocity_gradient", "stress_kinetic"]),
    ("lj", 16, "slab", 8.0, 100, 1e-5, ["stress"]),
]
BIG = [
    ("lj", 40, "gaussian", 10.0, 64, 1e-5, ["stress"]),
    ("lj", 40, "quartic", 10.0, 64, 1e-5, ["stress"]),
    ("sw", 30, "gaussian", 10.0, 64, 1e-5, ["stress"]),
]


def main():
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--json", help="write the figures here")
    p.add_argument("--calibrate", action="store_true")
    p.add_argument("--big", action="store_true", help="256k atoms too")
    a = p.parse_args()
    costs = calibrate(print) if a.calibrate else Costs.load()
    rows = []
    made = {}
    for model, n, name, radius, shape, tolerance, what in CASES + (BIG if a.big else []):
        frame, pot = made[model, n] = made.get((model, n)) or {"lj": argon, "sw": silicon}[model](n)
        grid = None if name is None else atc.Grid.slab("z", shape) if name == "slab" else atc.Grid.regular(shape=shape)
        kern = None if name is None else atc.kernel("quartic" if name == "slab" else name, radius=radius)
        arguments = (frame, pot, kern, grid, what, tolerance)
        request = prepare(Request(*arguments, threads=1))
        request.costs = costs
        request.methods = request.methods_for(request.work, request.method)
        predicted = plan(request)
        seconds = predicted.cpu_seconds - predicted.parts["reading"]
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            best = float("inf")
            for _ in range(3 if seconds < 3 else 2):
                began = time.process_time()
                ds = atc.fields(*arguments, threads=1)
                best = min(best, time.process_time() - began)
        row = {
            "model": model,
            "atoms": len(frame),
            "kernel": name,
            "radius": radius,
            "grid": shape,
            "tolerance": tolerance,
            "quantities": what,
            "method": ds.attrs.get("method"),
            "predicted": seconds,
            "measured": best,
            "ratio": seconds / best,
            "error": ds.attrs.get("measured_error"),
        }
        rows.append(row)
        parts = ", ".join(f"{k} {v:.3f}" for k, v in predicted.parts.items() if v > 0.02 * seconds and k != "reading")
        print(
            f"{model} {len(frame):7d} {name!s:9s} R={radius:<4g} {shape:3d} {tolerance:.0e} {','.join(what):28s} "
            f"{row['method']!s:9.9s} "
            f"predicted {seconds:8.3f} measured {best:8.3f} ratio {row['ratio']:.2f} error {row['error'] or 0:.1e}  "
            f"{parts}",
            flush=True,
        )
    print(f"ratios from {min(r['ratio'] for r in rows):.2f} to {max(r['ratio'] for r in rows):.2f}")
    if a.json:
        with open(a.json, "w") as f:
            json.dump(rows, f, indent=1)


if __name__ == "__main__":
    main()
