"""Write start.data: 392 water molecules, turned at random, on a lattice in the middle of a long box."""

from pathlib import Path

import numpy as np

NX, NY, NZ, SPACING, HEIGHT = 7, 7, 8, 3.105, 70.0
CHARGES, ANGLE = (-0.8476, 0.4238, 0.4238), 109.47


def main():
    rng = np.random.default_rng(1987)
    half = np.deg2rad(ANGLE) / 2
    shape = np.array([[0, 0, 0], [np.sin(half), np.cos(half), 0], [-np.sin(half), np.cos(half), 0]])
    sites = np.stack(np.meshgrid(*map(np.arange, (NX, NY, NZ)), indexing="ij"), -1).reshape(-1, 3) + 0.5
    sites = sites * SPACING + [0, 0, 0.5 * (HEIGHT - NZ * SPACING)]
    turn = np.linalg.qr(rng.normal(size=(len(sites), 3, 3)))[0]
    turn *= np.linalg.det(turn)[:, None, None]
    x = sites[:, None] + shape @ turn
    n = len(sites)
    lines = ["water, not yet in equilibrium", "", f"{3 * n} atoms", f"{2 * n} bonds", f"{n} angles"]
    lines += ["2 atom types", "1 bond types", "1 angle types", ""]
    lines += [f"0 {size:.10g} {a}lo {a}hi" for size, a in zip((NX * SPACING, NY * SPACING, HEIGHT), "xyz")]
    lines += ["", "Masses", "", "1 15.9994", "2 1.008", "", "Atoms # full", ""]
    for m in range(n):
        for k in range(3):
            place = " ".join(f"{c:.8f}" for c in x[m, k])
            lines.append(f"{3 * m + k + 1} {m + 1} {1 + (k > 0)} {CHARGES[k]} {place}")
    lines += ["", "Bonds", ""] + [f"{2 * m + k + 1} 1 {3 * m + 1} {3 * m + 2 + k}" for m in range(n) for k in (0, 1)]
    lines += ["", "Angles", ""] + [f"{m + 1} 1 {3 * m + 2} {3 * m + 1} {3 * m + 3}" for m in range(n)]
    Path(__file__).with_name("start.data").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
