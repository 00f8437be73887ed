"""Golden results: the outputs of some seventy scenes, cases and commands over all features, to hold a reworked package
against.

    python benchmarks/golden.py record DIR        run everything with the package that Python imports, outputs to DIR
    python benchmarks/golden.py compare OLD NEW   every variable of every output: bit for bit, or by how much it differs
    python benchmarks/golden.py record DIR -k pd  only what has "pd" in its name

Small pieces of the inputs in data/; about fifteen minutes on two cores. A difference of 1e-13 of a variable's largest
value is allowed, where a sum's order had to change, and printed. Timings in texts are not compared.
"""

from __future__ import annotations

import argparse
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np

DATA = Path(__file__).resolve().parents[1] / "data"
SI, MELT, FLOW, FILM = (DATA / d / "scene.toml" for d in ("silicon_plate", "melt", "heat_flow", "argon_slab"))
STRESS = 'fields.quantities=["stress","virial_stress","density"]'
ALL = (
    'fields.quantities=["number_density","density","momentum","velocity","temperature","energy","stress","virial_stress",'
    '"smoothed_virial_stress","heat_flux","churning"]'
)


def fields(scene, *sets, more=(), frames=(0, 1)):
    """Arguments of `atc fields` for a few frames of a scene."""
    window = ["-b", str(frames[0]), "-e", str(frames[1])]
    return ["fields", str(scene), "-o", "OUT.nc", *window, "-q", *(a for s in sets for a in ("--set", s)), *more]


def pd(folder, case, *sets):
    """Arguments of `atc pd` for one of the cases in data/."""
    return ["pd", str(DATA / folder / f"{case}.toml"), "-o", "OUT.nc", "-q", *(a for s in sets for a in ("--set", s))]


def jobs() -> dict[str, list[str]]:
    """Every run by its name: arguments of `atc`, OUT the path of its output without suffix."""
    out: dict[str, list[str]] = {}
    small = "grid.shape=[10,10,4]"
    one = "fields.average=false"
    for name in ("step", "linear", "cubic", "quartic", "lucy", "hardy", "gaussian", "bspline"):
        out[f"kernel_{name}"] = fields(SI, f'kernel.name="{name}"', "kernel.radius=6.0", small, one, STRESS)
    for method in ("direct", "spectral"):
        out[f"method_{method}"] = fields(SI, f'fields.method="{method}"', small, one, STRESS, "fields.tolerance=1e-4")
        out[f"melt_{method}"] = fields(MELT, f'fields.method="{method}"', "grid.shape=[6,6,6]", ALL)
    for tolerance in ("1e-2", "1e-3", "1e-4", "1e-6", "1e-8", "1e-12"):
        out[f"tolerance_{tolerance}"] = fields(MELT, f"fields.tolerance={tolerance}", STRESS, 'kernel.name="gaussian"')
        out[f"si_{tolerance}"] = fields(SI, f"fields.tolerance={tolerance}", STRESS, "grid.shape=[40,40,6]", one)
    out["all_si"] = fields(SI, small, one, ALL)
    out["all_melt"] = fields(MELT, "grid.shape=[6,6,6]", ALL)
    out["all_flow"] = fields(FLOW, ALL, one)
    out["all_film"] = fields(FILM, ALL, one)
    out["moments"] = fields(MELT, "kernel.radius=6.0", "grid.shape=[32,32,32]", "fields.tolerance=1e-4", STRESS)
    out["long_kernel"] = fields(SI, "kernel.radius=16.0", "grid.shape=[60,60,8]", "fields.tolerance=1e-3", one, STRESS)
    out["average"] = fields(SI, small, STRESS, frames=(0, 6))
    out["windows"] = fields(SI, small, STRESS, "fields.average=2", frames=(0, 6))
    out["frames"] = fields(SI, small, STRESS, one, frames=(0, 3))
    out["group"] = fields(MELT, "fields.average=true", STRESS, "grid.shape=[16,16,16]", frames=(0, 64))
    out["slab_average"] = fields(FLOW, frames=(0, 8))
    out["workers"] = fields(SI, small, STRESS, frames=(0, 6), more=["-j", "2"])
    out["tiles"] = fields(SI, small, one, STRESS, "fields.tiles=[2,2,1]")
    out["tiles_workers"] = fields(SI, small, one, STRESS, "fields.tiles=[2,2,1]", more=["-j", "2"])
    out["tiles_spectral"] = fields(
        SI, "grid.shape=[30,30,6]", one, STRESS, "fields.tiles=[2,1,1]", "fields.tolerance=1e-3"
    )
    gradients = 'fields.quantities=["displacement_gradient","velocity_gradient","density"]'
    out["gradients"] = fields(MELT, "grid.shape=[6,6,6]", gradients, "trajectory.reference=0", frames=(1, 2))
    out["displacement"] = fields(
        SI,
        small,
        one,
        'fields.quantities=["displacement","density","velocity"]',
        "trajectory.reference=0",
        frames=(3, 4),
    )
    out["piola"] = fields(
        SI, small, one, 'fields.quantities=["piola_stress","stress"]', "trajectory.reference=0", frames=(3, 4)
    )
    out["peridynamic"] = fields(SI, one, 'fields.quantities=["peridynamic_stress"]', "grid.shape=[6,6,4]")
    out["weighted"] = fields(SI, one, 'fields.quantities=["peridynamic_stress_weighted_virial"]', "fields.horizon=6.0")
    grids = {
        "plane": 'grid={kind="plane",axis="z",shape=[20,20]}',
        "line": 'grid={kind="line",start=[1,1,1],end=[60,60,10],n=40}',
        "points": 'grid={kind="points",points=[[1,2,3],[10,20,5],[55,2,7]]}',
        "atoms": 'grid={kind="atoms"}',
        "slab": 'grid={kind="slab",axis="x",bins=50}',
        "region": 'grid={kind="regular",shape=[9,9,3],origin=[5,5,1],vectors=[[30,0,0],[0,30,0],[0,0,8]]}',
    }
    for name, grid in grids.items():
        out[f"grid_{name}"] = ["scene", str(SI), name, grid]
    out["plane_2d"] = ["scene", "2d", "2d", ""]
    out["killed"] = ["killed", str(SI), small, STRESS]
    out["plan"] = ["stdout", "plan", str(SI)]
    out["info"] = ["stdout", "info", str(DATA / "melt" / "melt.dump.gz")]
    out["check"] = ["stdout", "check", str(MELT), "-e", "1"]
    out["verify"] = ["stdout", "verify", "forces.toml"]
    out["conductivity"] = ["stdout", "conductivity", str(FLOW), "--segments", "2", "--dt", "0.05"]
    for name, kernel in (("gaussian", "gaussian"), ("box", "box"), ("formula", "(1-s)^2")):
        out[f"advect_{name}"] = [
            "advect",
            "--nodes",
            "128",
            "--kernel",
            kernel,
            "--horizon",
            "0.05",
            "--duration",
            "0.1",
            "-q",
            "-o",
            "OUT.nc",
        ]
    out["advect_flux"] = [
        "advect",
        "--nodes",
        "64",
        "--flux",
        "u^3/3",
        "--horizon",
        "0.05",
        "--duration",
        "0.1",
        "-q",
        "--no-reference",
        "-o",
        "OUT.nc",
    ]
    for case, steps in (("pmb", 200), ("lps", 100)):
        coarse = ["body.spacing=0.001", "body.horizon=0.0030001"]
        out[f"pd_{case}"] = pd("pd_disk", case, f"run.steps={steps}", "output.every=50", *coarse)
    out["pd_notch"] = pd("pd_notch", "notch", "run.steps=60", "output.every=30")
    out["pd_kalthoff"] = pd("pd_kalthoff", "kalthoff", "run.steps=40", "output.every=20")
    for crystal in ("argon_crystal", "silicon_crystal"):
        out[f"dispersion_{crystal}"] = ["dispersion", str(DATA / crystal / "scene.toml"), "-o", "OUT.nc", "-q"]
    out["upscale_chain"] = ["upscale", "chain", "-o", "OUT.nc", "-q"]
    return out


FORCES = """
[trajectory]
file = "forces.dump"
units = "lj"
masses = [1.0]
[potential]
lammps = "pair_style lj/cut 2.5\\npair_coeff 1 1 1.0 1.0 2.5"
"""
PLANAR = """
[trajectory]
file = "{folder}/planar.dump"
units = "lj"
masses = [1.0]
dimension = 2
[potential]
lammps = "pair_style lj/cut 2.5\\npair_coeff 1 1 1.0 1.0 2.5"
[kernel]
name = "quartic"
radius = 3.0
[grid]
kind = "regular"
shape = [8, 8]
[fields]
quantities = ["stress", "virial_stress", "density", "temperature", "heat_flux"]
"""


def planar_dump(path: Path) -> None:
    """A disturbed square lattice in the plane."""
    rng = np.random.default_rng(4)
    x = (np.stack(np.meshgrid(*2 * [np.arange(12)], indexing="ij"), -1).reshape(-1, 2) + 0.5) * 1.1
    x += rng.normal(0, 0.05, x.shape)
    v = rng.normal(0, 1, x.shape)
    L = 12 * 1.1
    lines = [
        f"{i + 1} 1 {a!r} {b!r} 0.0 {c!r} {d!r} 0.0"
        for i, ((a, b), (c, d)) in enumerate(zip(x.tolist(), v.tolist(), strict=True))
    ]
    head = f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS pp pp pp\n0 {L}\n0 {L}\n-0.5 0.5\n"
    path.write_text(head + "ITEM: ATOMS id type x y z vx vy vz\n" + "\n".join(lines) + "\n")


def dump_with_forces(path: Path) -> None:
    """A disturbed crystal of Lennard-Jones atoms with their forces, from the closed form."""
    rng = np.random.default_rng(5)
    L = 6 * 1.2
    x = (np.stack(np.meshgrid(*3 * [np.arange(6)], indexing="ij"), -1).reshape(-1, 3) + 0.5) * 1.2
    x += rng.normal(0, 0.05, x.shape)
    r = x[:, None] - x[None]
    r -= L * np.round(r / L)
    d2 = (r**2).sum(-1)
    d2[(d2 == 0) | (d2 >= 2.5**2)] = np.inf
    f = ((48 / d2**7 - 24 / d2**4)[..., None] * r).sum(1)
    rows = [f"{i + 1} 1 " + " ".join(map(repr, row)) for i, row in enumerate(np.hstack([x, f]).tolist())]
    box = f"0 {L}\n" * 3
    head = f"ITEM: TIMESTEP\n0\nITEM: NUMBER OF ATOMS\n{len(x)}\nITEM: BOX BOUNDS pp pp pp\n{box}"
    path.write_text(head + "ITEM: ATOMS id type x y z fx fy fz\n" + "\n".join(rows) + "\n")


def atc(arguments, folder, **kw):
    return subprocess.run([sys.executable, "-m", "atc", *arguments], cwd=folder, capture_output=True, text=True, **kw)


def scene_with(scene: Path, grid: str, folder: Path, name: str) -> Path:
    """The scene with another grid: keys of one kind do not go with another, so the section is replaced."""
    import tomllib

    text = scene.read_text()
    before, rest = text.split("[grid]")
    after = "[fields]" + rest.split("[fields]")[1]
    table = tomllib.loads(grid)["grid"]
    section = "[grid]\n" + "".join(f"{k} = {v!r}\n".replace("'", '"') for k, v in table.items())
    path = folder / f"{name}.toml"
    path.write_text(
        (before + section + after)
        .replace('file = "', f'file = "{scene.parent}/')
        .replace("Si.sw", f"{scene.parent}/Si.sw")
    )
    return path


def run_one(name, job, folder: Path):
    out = folder / name
    kind = job[0]
    if kind == "stdout":
        if job[-1] == "forces.toml":
            dump_with_forces(folder / "forces.dump")
            (folder / "forces.toml").write_text(FORCES)
        done = atc(job[1:], folder)
        # Where the data is, and how long it takes, is no result.
        text = done.stdout.replace(f"{DATA}/", "data/")
        text = re.sub(r"^(time|memory) .*\n( .*\n)*", "", text, flags=re.MULTILINE)
        out.with_suffix(".txt").write_text(text)
        return done
    if kind == "scene":
        if job[1] == "2d":
            planar_dump(folder / "planar.dump")
            path = folder / "planar.toml"
            path.write_text(PLANAR.format(folder=folder))
            return atc(["fields", str(path), "-o", f"{out}.nc", "-q"], folder)
        path = scene_with(Path(job[1]), job[3], folder, name)
        return atc(
            ["fields", str(path), "-o", f"{out}.nc", "-b", "0", "-e", "1", "-q", "--set", "fields.average=false"],
            folder,
        )
    if kind == "killed":
        arguments = [
            "fields",
            job[1],
            "-o",
            f"{out}.nc",
            "-q",
            "-e",
            "8",
            *(a for s in (*job[2:], "fields.average=false") for a in ("--set", s)),
        ]
        process = subprocess.Popen(
            [sys.executable, "-m", "atc", *arguments], cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        journal = Path(f"{out}.nc.partial")
        start = time.monotonic()
        while process.poll() is None and not (journal.exists() and time.monotonic() - start > 2.0):
            time.sleep(0.05)
        process.send_signal(signal.SIGKILL)
        process.wait()
        return atc(arguments, folder)
    return atc([a.replace("OUT", str(out)) for a in job], folder)


def record(folder: Path, only: str | None) -> int:
    folder = folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    bad = 0
    for name, job in jobs().items():
        if only and only not in name:
            continue
        for old in folder.glob(f"{name}.*"):
            old.unlink()
        start = time.perf_counter()
        done = run_one(name, job, folder)
        (folder / f"{name}.status").write_text(f"{done.returncode}\n")
        bad += done.returncode != 0
        why = done.stderr.strip()[-200:] if done.returncode else ""
        print(f"{name:26s} {done.returncode} {time.perf_counter() - start:6.1f} s  {why}", flush=True)
    return bad


def difference(a, b) -> float:
    """Largest difference relative to the largest value; 0 only where every bit agrees (NaN with NaN)."""
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape or a.dtype != b.dtype:
        return np.inf
    if a.dtype.kind not in "fc":
        return 0.0 if np.array_equal(a, b) else np.inf
    if not np.array_equal(np.isnan(a), np.isnan(b)):
        return np.inf
    if a.tobytes() == b.tobytes() or np.array_equal(a, b, equal_nan=True):
        return 0.0
    return float(np.nanmax(np.abs(a - b)) / max(np.nanmax(np.abs(a)), 1e-300))


NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")


def text_difference(a: str, b: str) -> float:
    """0 where the words are the same and every number, too, or both are rounding, below 1e-9."""
    if NUMBER.sub("#", a) != NUMBER.sub("#", b):
        return np.inf
    pairs = [(float(x), float(y)) for x, y in zip(NUMBER.findall(a), NUMBER.findall(b), strict=True)]
    return max((0.0 if x == y or max(abs(x), abs(y)) < 1e-9 else abs(x - y) for x, y in pairs), default=0.0)


def compare(old: Path, new: Path, only: str | None) -> int:
    import xarray as xr

    bad = 0
    for status in sorted(old.glob("*.status")):
        name = status.stem
        if only and only not in name:
            continue
        worst: dict[str, float] = {}
        if status.read_text() != (new / status.name).read_text():
            worst["exit status"] = np.inf
        file = old / f"{name}.nc"
        if file.exists() and not (new / file.name).exists():
            worst["no output"] = np.inf
        elif file.exists():
            with xr.open_dataset(file) as a, xr.open_dataset(new / file.name) as b:
                for v in set(a.variables) ^ set(b.variables):
                    worst[v] = np.inf
                for v in set(a.variables) & set(b.variables):
                    d = difference(a[v].values, b[v].values)
                    if not d <= 0:
                        worst[v] = d
        text = old / f"{name}.txt"
        if text.exists() and (d := text_difference(text.read_text(), (new / text.name).read_text())) > 0:
            worst["text"] = d
        wrong = not all(d <= 1e-13 for d in worst.values())
        bad += wrong
        if worst:
            print(
                f"{name:26s} {'DIFFERS ' if wrong else 'rounding'} "
                + ", ".join(f"{v} {d:.1e}" for v, d in sorted(worst.items(), key=lambda t: -t[1])[:4])
            )
    print(f"{bad} differ")
    return bad


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["record", "compare"])
    parser.add_argument("dirs", nargs="+", type=Path)
    parser.add_argument("-k", dest="only")
    arguments = parser.parse_args()
    os.environ.setdefault("NUMBA_NUM_THREADS", "2")
    if arguments.what == "record":
        sys.exit(bool(record(arguments.dirs[0], arguments.only)))
    sys.exit(bool(compare(*arguments.dirs, arguments.only)))
