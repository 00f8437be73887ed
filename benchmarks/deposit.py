"""Speed of the direct deposit: nanoseconds per (bond, point) visit for each kernel, compilation, and the error check at
random points.

    python benchmarks/deposit.py [--atoms 4000] [--grid 20] [--radius 10] [--json out.json]

Jittered fcc argon at liquid density, half list within 8.5 Å, sorted by first atom; 6 stress components; one thread; the
best of a few runs.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

import atc
from atc.deposit import exact_at, make
from atc.frame import Cell
from atc.units import units

DENSITY = 0.0213  # atoms/Å³, liquid argon near its triple point
CUTOFF = 8.5


def argon(n_atoms, seed=0):
    """Positions, cell, and a half list (i, r) of jittered fcc argon."""
    from scipy.spatial import cKDTree

    m = max(2, round((n_atoms / 4) ** (1 / 3)))
    a = (4 / DENSITY) ** (1 / 3)
    base = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]])
    corners = np.stack(np.meshgrid(*[np.arange(m)] * 3, indexing="ij"), -1).reshape(-1, 1, 3)
    x = (corners + base).reshape(-1, 3) * a
    x = (x + np.random.default_rng(seed).normal(size=x.shape) * 0.4) % (m * a)
    cell = Cell([m * a] * 3)
    pairs = cKDTree(x, boxsize=m * a).query_pairs(CUTOFF, output_type="ndarray")
    pairs = pairs[np.lexsort(pairs.T[::-1])]
    r = x[pairs[:, 0]] - x[pairs[:, 1]]
    r -= np.round(r / (m * a)) * m * a
    return x, cell, pairs[:, 0].astype(np.int32), r


def best(f, repeat):
    times = []
    for _ in range(repeat):
        t = time.process_time()
        f()
        times.append(time.process_time() - t)
    return min(times)


def main(argv=None):
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--atoms", type=int, default=4000)
    p.add_argument("--grid", type=int, default=20, help="points along each edge")
    p.add_argument("--radius", type=float, default=10.0)
    p.add_argument("--repeat", type=int, default=3)
    p.add_argument("--json", help="write the figures here")
    p.add_argument("--kernels", nargs="*", default=["quartic", "lucy", "hardy", "linear", "cubic", "step", "gaussian"])
    o = p.parse_args(argv)
    x, cell, i, r = argon(o.atoms)
    G = np.random.default_rng(1).normal(size=len(i))
    metal = units("metal")
    bound = atc.Grid.regular(shape=o.grid).bind(metal, cell)
    print(
        f"{len(x)} atoms, {len(i)} bonds ({len(i) / len(x):.1f} an atom), {o.grid}^3 points, R = {o.radius} Å, 6 "
        "components, one thread"
    )
    print(
        f"{'kernel':>10} {'first call s':>13} {'visits/bond':>12} {'ns/visit':>9} {'seconds':>9} {'100 points s':>13} "
        f"{'error':>9}"
    )
    rows = []
    for name in o.kernels:
        kern = atc.kernel(name, o.radius)
        t = time.perf_counter()
        dep = make("direct", bound, kern, cell, 1, 6)
        dep.add_bond_stress(x, i[:10], r[:10], G[:10])
        first = time.perf_counter() - t
        # The Gaussian reaches 2.9 R: a tenth of the bonds tell as much.
        take = slice(None) if name != "gaussian" else slice(None, None, 10)
        result = {}

        def run(kern=kern, take=take, result=result):
            result["dep"] = d = make("direct", bound, kern, cell, 1, 6)
            d.add_bond_stress(x, i[take], r[take], G[take])

        seconds = best(run, o.repeat)
        dep = result["dep"]
        some = np.random.default_rng(2).choice(len(bound), min(100, len(bound)), replace=False)
        at = exact_at(bound.points_gc[some], kern, cell, 1, 6)
        at.add_bond_stress(x, i[:10], r[:10], G[:10])  # compile

        def check(kern=kern, take=take, some=some, result=result):
            result["at"] = d = exact_at(bound.points_gc[some], kern, cell, 1, 6)
            d.add_bond_stress(x, i[take], r[take], G[take])

        points = best(check, o.repeat)
        sums = dep.bond_sums()
        error = np.abs(result["at"].bond_sums() - sums[some]).max() / np.abs(sums).max()
        n = len(i[take])
        row = {
            "kernel": name,
            "first_call_s": first,
            "visits_per_bond": dep.visits / n,
            "ns_per_visit": seconds / dep.visits * 1e9,
            "seconds": seconds * len(i) / n,
            "points_seconds": points * len(i) / n,
            "error": error,
        }
        rows.append(row)
        print(
            "{kernel:>10} {first_call_s:13.2f} {visits_per_bond:12.1f} {ns_per_visit:9.2f} {seconds:9.3f} "
            "{points_seconds:13.3f} {error:9.1e}".format(**row),
            flush=True,
        )
    slab = atc.Grid.slab("z", 100).bind(metal, cell)
    kern = atc.kernel("quartic", o.radius)
    make("direct", slab, kern, cell, 1, 6).add_bond_stress(x, i[:10], r[:10], G[:10])
    seconds = best(lambda: make("direct", slab, kern, cell, 1, 6).add_bond_stress(x, i, r, G), o.repeat)
    print(f"slab of 100 bins, quartic: {seconds / len(i) * 1e9:.0f} ns/bond")
    rows.append({"kernel": "quartic", "grid": "slab 100", "ns_per_bond": seconds / len(i) * 1e9})
    if o.json:
        with open(o.json, "w") as f:
            json.dump({"atoms": len(x), "bonds": len(i), "grid": o.grid, "radius": o.radius, "rows": rows}, f, indent=1)
    return rows


if __name__ == "__main__":
    main()
