"""Write start.data: 50 chains of 30 beads as random walks in a triclinic box, overlapping as yet (in.prepare pushes
them apart)."""

from pathlib import Path

import numpy as np

CHAINS, BEADS, BOND, DENSITY = 50, 30, 0.97, 0.85


def main():
    rng = np.random.default_rng(1990)
    n = CHAINS * BEADS
    lx, ly = 13.0, 12.0
    lz = n / DENSITY / (lx * ly)
    xy, xz, yz = 3.0, -2.0, 2.5
    origin = np.array([-4.0, 2.0, 1.0])
    cell = np.array([[lx, 0, 0], [xy, ly, 0], [xz, yz, lz]])

    atoms, bonds, angles = [], [], []
    for chain in range(CHAINS):
        walk = [origin + rng.random(3) @ cell]
        while len(walk) < BEADS:
            e = rng.normal(size=3)
            new = walk[-1] + BOND * e / np.linalg.norm(e)
            # A chain must not fold back onto its last bead but one.
            if len(walk) < 2 or np.linalg.norm(new - walk[-2]) > 1.02:
                walk.append(new)
        first = chain * BEADS + 1
        for b, x in enumerate(walk):
            s = np.floor((x - origin) @ np.linalg.inv(cell)).astype(int)
            x = x - s @ cell
            atoms.append(f"{first + b} {chain + 1} 1 {x[0]:.10f} {x[1]:.10f} {x[2]:.10f} {s[0]} {s[1]} {s[2]}")
        bonds += [(first + b, first + b + 1) for b in range(BEADS - 1)]
        angles += [(first + b, first + b + 1, first + b + 2) for b in range(BEADS - 2)]

    lines = ["50 chains of 30 beads, random walks", "", f"{n} atoms", f"{len(bonds)} bonds", f"{len(angles)} angles"]
    lines += ["1 atom types", "1 bond types", "1 angle types", ""]
    lines += [f"{o:.10f} {o + length:.10f} {a}lo {a}hi" for o, length, a in zip(origin, (lx, ly, lz), "xyz")]
    lines += [f"{xy} {xz} {yz} xy xz yz", "", "Masses", "", "1 1.0", "", "Atoms # molecular", "", *atoms]
    lines += ["", "Bonds", ""] + [f"{k + 1} 1 {i} {j}" for k, (i, j) in enumerate(bonds)]
    lines += ["", "Angles", ""] + [f"{k + 1} 1 {i} {j} {l}" for k, (i, j, l) in enumerate(angles)]
    Path(__file__).with_name("start.data").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
