"""What coarse springs cost and get, argon and silicon: ω over the nodes' zone, the field of a pair of loads, seconds.

    python benchmarks/coarsening.py [picture.png]

Three kinds of springs on nodes one and two lattice constants apart: fitted to ω (`node_kernel`, the twin's `linear`),
and Silling's coarsening, fitted or with mended second moments (`coarsening.coarsen`). The loads: ±1 along x on two
nodes half a periodic block apart; the fine solution is exact, by its waves. Seconds are the engine's, one thread, for
the equilibrium; on argon also with the atoms as nodes.
"""

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))
from crystals import constants, crystal, elastic

from atc import pd
from atc.frame import Cell
from atc.twins.linear import LatticeSprings
from atc.upscaling.coarsening import coarse_stiffness, coarsen, zone_errors
from atc.upscaling.force_constants import signed_root
from atc.upscaling.node_kernel import node_kernel

LENGTH = 16  # of the block in lattice constants along x, half of it across
PLANS = [("ω fitted", 3.015), ("coarsened, fit", 2.015), ("coarsened, second", 2.015), ("coarsened, fit", 3.015)]
PLANS += [("coarsened, second", 3.015), ("coarsened, fit", 4.015)]


def springs(name, what, step, horizon):
    if what == "ω fitted":
        return node_kernel(constants(name), elastic(name), step, horizon)
    return coarsen(constants(name), elastic(name), step, horizon, cut=what.split(", ")[1], mesh=12)


def loads(n):
    f = np.zeros((*n, 3))
    f[0, 0, 0, 0], f[n[0] // 2, 0, 0, 0] = 1.0, -1.0
    return f


def fine(name, step, n):
    s = np.array(list(np.ndindex(*n))) / n
    K = coarse_stiffness(constants(name), step, s @ (2 * np.pi * np.linalg.inv(step).T))
    w = np.fft.fftn(loads(n), axes=(0, 1, 2)).reshape(-1, 3)
    w[1:] = np.linalg.solve(K[1:], w[1:, :, None])[..., 0]
    return np.fft.ifftn(w.reshape(*n, 3), axes=(0, 1, 2)).real


def solve(X, volume, density, horizon, cell, law, f):
    """(displacements, bonds a node, seconds, the stable step)"""
    body = pd.Body(X, volume, density, horizon, cell=cell, warn=False)
    sim = pd.Simulation(body, pd.Linear(law), conditions=[pd.BodyForce(None, f / volume)], threads=1)
    start = time.process_time()
    pd.solve_static(sim, tolerance=1e-6)
    took = time.process_time() - start
    return sim.state.u_nc - sim.state.u_nc.mean(axis=0), 2 * len(body.bonds) / len(X), took, sim.dt


def main(picture=None):
    curves, lines = {}, {}
    print("| | nodes | springs | horizon | ω: rms, zone | half | u at the load | elsewhere | bonds a node | s |")
    for name in ("argon", "silicon"):
        c = crystal(name)
        for factor in (1, 2):
            step = factor * c.conventional
            d = step[0, 0]
            n = (LENGTH // factor, LENGTH // 2 // factor, LENGTH // 2 // factor)
            X = np.array(list(np.ndindex(*n))) @ step
            f, exact = loads(n), fine(name, step, n)
            loaded = np.abs(f).max(axis=3) > 0
            for what, h in PLANS if factor == 1 else [*PLANS[:1], *PLANS[3:]]:
                kernel = springs(name, what, step, h * d)
                solve(X, d**3, c.density, h * d, Cell(step * np.array(n)[:, None]), kernel, f.reshape(-1, 3))
                u, bonds, took, _ = solve(
                    X, d**3, c.density, h * d, Cell(step * np.array(n)[:, None]), kernel, f.reshape(-1, 3)
                )
                u = u.reshape(*n, 3)
                e = zone_errors(kernel, constants(name))
                rms = [np.sqrt((e[w, 1:] ** 2).mean()) for w in (e[:, 0] < 9, e[:, 0] <= 0.5)]
                off = np.linalg.norm((u - exact)[~loaded]) / np.linalg.norm(exact[~loaded])
                at = u[0, 0, 0, 0] / exact[0, 0, 0, 0] - 1
                print(
                    f"| {name} | {len(X)}, {factor} a | {what} | {h:g} | {100 * rms[0]:.1f} % | {100 * rms[1]:.1f} % | "
                    f"{100 * at:+.1f} % | {100 * off:.1f} % | {bonds:.0f} | {took:.3f} |",
                    flush=True,
                )
                if factor == 1 and h == 3.015 and what != "coarsened, second":
                    q = np.linspace(0.01, 1, 60)[:, None] * np.array([np.pi / d, 0, 0])
                    curves[name, what] = signed_root(np.linalg.eigvalsh(kernel.dynamical_matrix(q)))
                    curves[name, "crystal"] = signed_root(
                        np.linalg.eigvalsh(constants(name).dynamical_matrix(q))[:, :3]
                    )
                    lines[name, what], lines[name, "crystal"] = u[:, 0, 0, 0], exact[:, 0, 0, 0]
    c, n = crystal("argon"), (LENGTH, LENGTH // 2, LENGTH // 2)
    a = c.conventional[0, 0]
    basis = np.array([[0, 0, 0], [0, 0.5, 0.5], [0.5, 0, 0.5], [0.5, 0.5, 0]]) * a
    X = (np.array(list(np.ndindex(*n)))[:, None] * a + basis).reshape(-1, 3)
    f = np.zeros((len(X), 3))
    f[::4] = loads(n).reshape(-1, 3)
    fc = constants("argon")
    reach = 1.02 * np.linalg.norm(fc.r_bc, axis=1).max()
    cell = Cell(np.diag(n) * a)
    u, bonds, took, _ = solve(X, a**3 / 4, c.density, reach, cell, LatticeSprings(fc), f)
    off = np.abs(u[::4].reshape(*n, 3) - fine("argon", c.conventional, n)).max() / np.abs(u).max()
    print(f"argon, its {len(X)} atoms: {bonds:.0f} bonds each, {took:.3f} s, within {off:.1g} of the waves' solution")
    if picture:
        draw(picture, curves, lines)


def draw(path, curves, lines):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(2, 2, figsize=(10, 6.4), constrained_layout=True)
    style = {"crystal": ("k", "-"), "ω fitted": ("C0", "--"), "coarsened, fit": ("C3", "-.")}
    for row, name in enumerate(("argon", "silicon")):
        left, right = axes[row]
        top = curves[name, "crystal"].max()
        for what, (color, line) in style.items():
            left.plot(np.linspace(0.01, 1, 60), curves[name, what][:, [0, 2]] / top, line, color=color)
            u = lines[name, what] / lines[name, "crystal"].max()
            right.plot(np.arange(len(u)), u, line, color=color, label=what, marker="o", markersize=3)
        left.set(
            xlabel="k along [100] / nodes' zone boundary", ylabel="ω (highest = 1)", title=f"{name}, nodes a apart"
        )
        right.set(xlabel="x / a, along the line of the loads", ylabel="u$_x$ (at the load = 1)", title="pair of loads")
        right.legend()
    fig.savefig(path, dpi=80)


if __name__ == "__main__":
    main(*sys.argv[1:])
