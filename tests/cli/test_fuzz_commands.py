"""Damaged outputs, cases, unfinished runs and command lines through the commands themselves: exit status 0, or 2 with
one printable line, in bounded time and memory.

Each try is a process of its own, so that what a library does at its worst (a crash of HDF5) is seen as well. A few
here; ``ATC_FUZZ=5000 pytest -m slow tests/cli/test_fuzz_commands.py`` tries so many of each kind.
"""

import os
import random
import shutil
from pathlib import Path

import numpy as np
import pytest
import test_twin
from forking import Warm
from test_case import PLATE
from test_cli import SCENE, tree, write_dump

SEED = os.environ.get("ATC_SEED", "1")
WORDS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "-1",
    "--1",
    "0",
    "1_0",
    "1e-400",
    "9" * 30,
    "9223372036854775808",
    "2147483648",
    "1e12",
    "0x10",
    "1.5.2",
    "",
    "true",
    "[]",
    "{}",
    "''",
    '"x"',
    "[1, 2]",
    "[[1,2,3]]",
    "[" * 3000,
    "x" * 300,
    "\x1b[2J",
    "\u202e",
    "a=b",
    "*",
    "..",
    "/",
    "/dev/zero",
    "nowhere",
    "\n",
    "#",
    '"""',
    "é",
    "{ a = 1 }",
    "1:2:3",
    "::0",
]
CASE = PLATE.replace("steps = 120", "steps = 4").replace("every = 25", "every = 2")
#: Scenes with the keys that small ones lack: what is padded has open faces.
PADDED = (
    SCENE.replace("[4, 5, 6]", "[3, 3, 3]\npadding = 2.0")
    .replace('"run.dump"', '"open.dump"\nframes = "0:2"\nreference = 0\nforces = "warn"')
    .replace('["stress", ', '["column:vx", "column:vx:mean", "column:vy:mass_mean", "displacement", "stress", ')
    .replace(
        "[output]", 'column_units = { vx = "furlong" }\ntolerance = 1e-4\naverage = 2\ntiles = [1, 1, 1]\n\n[output]'
    )
)
SLAB = PADDED[: PADDED.index("[grid]")] + '[grid]\nkind = "slab"\naxis = "z"\nbins = 4\n'
TWIN = """[trajectory]
file = "twin.dump"
reference = 0
frames = "1:"
masses = [39.948]

[potential]
lammps = \"\"\"
pair_style lj/cut 8.5
pair_coeff 1 1 0.0104 3.4
\"\"\"

[kernel]
name = "quartic"
radius = 12.0

[grid]
kind = "regular"
shape = [2, 2, 2]

[twin]
structure = "fcc"
lattice_constant = 5.3
model = "lps"
motion = "static"
spacing = 5.3
horizon = 16.0
grips = [[[-1, -1, -1], [4, 30, 30]]]
timestep = 0.001
"""
#: {scene: (its text, the commands that read it)}
SCENES = {
    "padded.toml": (PADDED, [["plan"], ["fields", "-o", "x.nc", "-q"], ["fields", "-o", "x.zarr", "-q"], ["info"]]),
    "slab.toml": (SLAB, [["profile", "-q", "-o", "x.zarr"], ["profile", "--csv"], ["profile", "--json", "--flow"]]),
    "twin.toml": (TWIN, [["twin", "-q", "-o", "x.nc"], ["twin", "-o", "x.zarr"]]),
}


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A warm process, a scene and a case, their outputs, and an unfinished run."""
    folder, warm = tmp_path_factory.mktemp("place"), Warm()
    write_dump(folder / "run.dump", frames=2)
    (folder / "scene.toml").write_text(SCENE.replace("[4, 5, 6]", "[3, 3, 3]"))
    (folder / "case.toml").write_text(CASE)
    (folder / "open.dump").write_text((folder / "run.dump").read_text().replace("pp pp pp", "pp ff ff"))
    test_twin.write(folder / "twin.dump", [test_twin.block(np.diag([s, 0, 0]), time=s) for s in (0, 0.001, 0.002)])
    for name, (text, commands) in SCENES.items():
        (folder / name).write_text(text)
        for words in commands:
            warm.heat(folder, [words[0], name, *words[1:], *(["--overwrite"] if "-o" in words else [])])
    for words in (
        ["fields", "scene.toml", "-o", "o.nc", "-q"],
        ["fields", "scene.toml", "-o", "o.zarr", "-q"],
        ["pd", "case.toml", "-o", "p.nc", "-q", "-j", "1"],
        *(["info", "o.nc"], ["compare", "o.nc"], ["plot", "o.zarr"], ["export", "p.nc"]),
    ):
        warm.heat(folder, words)
    # killed before its last change of the file system but some: the second frame is there, the output is not
    kept = tmp_path_factory.mktemp("kept")
    changes = warm.run(folder, ["fields", "scene.toml", "-o", "whole.zarr", "-q"])["changes"]
    assert warm.run(folder, ["fields", "scene.toml", "-o", "u.zarr", "-q"], at=changes - 60)["status"] == -9
    assert (folder / "u.zarr.partial" / "journal.jsonl").read_text()
    shutil.move(folder / "u.zarr.partial", kept / "u.zarr.partial")
    yield folder, warm, kept
    warm.close()


def acceptable(done, what, others=()):
    """0, or 2 (and `others`) with one line of the package's own."""
    assert done["status"] in (0, 2, *others), (what, done)
    lines = [line for line in done["err"].splitlines() if not line.startswith("warning: ")]
    if done["status"] > 0:
        assert (
            len(lines) == 1
            and lines[0].startswith("error: ")
            and "did not foresee" not in lines[0]
            and len(lines[0]) < 2000
        ), (
            what,
            done,
        )
    assert (
        "Traceback" not in done["err"] and (done["err"] + done["out"]).replace("\n", "").replace("\t", "").isprintable()
    ), (what, done)


def altered(rng, content: bytes, times=None) -> bytes:
    """A few accidents: bits flipped, pieces cut out, doubled, zeroed, replaced by words, the end cut off."""
    out = bytearray(content)
    for _ in range(times or rng.choice([1, 1, 2, 4])):
        a = rng.randrange(len(out) + 1)
        b = min(len(out), a + rng.choice([1, 2, 8, 60, 600]))
        how = rng.choice(["flip", "flip", "cut out", "double", "zero", "word", "cut off"])
        if how == "flip" and a < len(out):
            out[a] ^= 1 << rng.randrange(8)
        elif how == "cut out":
            del out[a:b]
        elif how == "double":
            out[a:a] = out[a:b]
        elif how == "zero":
            out[a:b] = bytes(b - a)
        elif how == "word":
            out[a:b] = rng.choice(WORDS).encode()
        elif how == "cut off" and rng.random() < 0.3:
            del out[a:]
    return bytes(out)


def text_altered(rng, text: str) -> str:
    """Lines and values of a TOML file replaced, doubled, dropped."""
    for _ in range(rng.choice([1, 1, 2, 3])):
        lines = text.split("\n")
        k = rng.randrange(len(lines))
        how = rng.choice(["value", "value", "value", "number", "drop", "double", "move", "key"])
        name, equals, value = lines[k].partition("=")
        if how == "value" and equals:
            lines[k] = f"{name}= {rng.choice(WORDS)}"
        elif how == "number" and equals:
            words = value.split()
            at = rng.randrange(len(words)) if words else 0
            words[at : at + 1] = [
                rng.choice(
                    [
                        *WORDS[:15],
                        repr(rng.uniform(-1, 1) * 10 ** rng.randint(-9, 9))
                        + ("," if words and words[at].endswith(",") else ""),
                    ]
                )
            ]
            lines[k] = f"{name}= {' '.join(words)}"
        elif how == "key" and equals:
            lines[k] = f"{rng.choice(WORDS)} = {value}"
        elif how == "drop":
            del lines[k]
        elif how == "double":
            lines.insert(k, lines[k])
        elif how == "move":
            lines.insert(rng.randrange(len(lines)), lines.pop(k))
        text = "\n".join(lines)
    return text


READERS = [["info"], ["compare"], ["plot"], ["plot", "-q", "stress", "-c", "vonmises"], ["export"]]


def an_output(rng, folder, warm, kept):
    """A damaged output before each command that reads one."""
    name = rng.choice(["o.nc", "o.zarr", "p.nc"])
    path = folder / "work" / f"damaged{Path(name).suffix}"
    if path.suffix == ".zarr":
        shutil.copytree(folder / name, path)
        victim = rng.choice(sorted(p for p in path.rglob("*") if p.is_file()))
        if rng.random() < 0.2:
            victim.unlink()
        else:
            victim.write_bytes(altered(rng, victim.read_bytes()))
    else:
        path.write_bytes(altered(rng, (folder / name).read_bytes()))
    words = rng.choice(READERS)
    yield [words[0], path.name, *words[1:]]


def a_case(rng, folder, warm, kept):
    (folder / "work" / "case.toml").write_bytes(text_altered(rng, CASE).encode("utf-8", "replace"))
    yield (
        ["pd", "case.toml", "--check"]
        if rng.random() < 0.7
        else ["pd", "case.toml", "-o", "x.nc", "-q", "-j", "1", "--set", "run.steps=2"]
    )


def a_scene(rng, folder, warm, kept):
    """A damaged scene before each command that reads it."""
    name = rng.choice(list(SCENES))
    text, commands = SCENES[name]
    for dump in ("open.dump", "twin.dump"):
        os.link(folder / dump, folder / "work" / dump)
    (folder / "work" / name).write_bytes(text_altered(rng, text).encode("utf-8", "replace"))
    words = rng.choice(commands)
    yield [words[0], name, *words[1:]]


def an_unfinished_run(rng, folder, warm, kept):
    """The files beside its data are damaged: it goes on, begins again or says what is wrong; and may be begun again in
    any case."""
    work = folder / "work"
    for name in ("run.dump", "scene.toml"):
        shutil.copy(folder / name, work)
    shutil.copytree(kept / "u.zarr.partial", work / "u.zarr.partial")
    files = sorted(p for p in (work / "u.zarr.partial").rglob("*") if p.is_file() and p.name != "lock")
    victim = rng.choice([p for p in files if p.parent.name == "u.zarr.partial"] if rng.random() < 0.7 else files)
    if rng.random() < 0.2:
        victim.unlink()
    else:
        victim.write_bytes(altered(rng, victim.read_bytes()))
    yield ["fields", "scene.toml", "-o", "u.zarr", "-q"]
    if not (work / "u.zarr").exists():
        yield ["fields", "scene.toml", "-o", "u.zarr", "-q", "--restart"]
        assert tree(work / "u.zarr") == tree(folder / "whole.zarr"), victim


FLAGS = [
    "-o",
    "-q",
    "--set",
    "-b",
    "-e",
    "--step",
    "-j",
    "--restart",
    "--overwrite",
    "--json",
    "--csv",
    "--units",
    "--masses",
    "--topology",
    "--dimension",
    "-c",
    "--slice",
    "--axis",
    "--index",
    "--frame",
    "--limits",
    "--robust",
    "--points",
    "--segments",
    "--plateau",
    "--dt",
    "--picture",
    "--check",
    "--help",
    "--quiet",
    "--overlay",
    "--atom-style",
    "--bins",
    "--interfaces",
    "--boundary",
    "--flow",
]
VALUES = [
    "scene.toml",
    "case.toml",
    "run.dump",
    "o.nc",
    "o.zarr",
    "p.nc",
    "new.nc",
    "new.zarr",
    "a.png",
    "a.pvd",
    "stress",
    "density",
    "xx",
    "vonmises",
    "z=0.5",
    "z",
    "1",
    "2",
    "-1",
    "metal",
    "39.948",
    "1=39.948",
    "mean",
    "kernel.radius=4",
    "fields.quantities=density",
    "grid.shape=[2,2,2]",
    "run.steps=2",
    "3,6",
    *WORDS,
]
COMMANDS = {
    "info": "run.dump",
    "plan": "scene.toml",
    "fields": "scene.toml",
    "compare": "o.nc",
    "plot": "o.zarr",
    "export": "p.nc",
    "pd": "case.toml",
    "conductivity": "scene.toml",
    "check": "scene.toml",
    "profile": "slab.toml",
    "twin": "twin.toml",
    "verify": "scene.toml",
}


def a_command_line(rng, folder, warm, kept):
    work = folder / "work"
    for name in (
        "run.dump",
        "open.dump",
        "twin.dump",
        "scene.toml",
        "slab.toml",
        "twin.toml",
        "case.toml",
        "o.nc",
        "p.nc",
    ):
        shutil.copy(folder / name, work)
    shutil.copytree(folder / "o.zarr", work / "o.zarr")
    command = rng.choice(list(COMMANDS))
    words = [
        rng.choice([command, command, command, command, "x", ""]),
        COMMANDS[command] if rng.random() < 0.8 else rng.choice(VALUES),
    ]
    for _ in range(rng.choice([1, 2, 2, 3, 4])):
        words.append(rng.choice(FLAGS))
        if rng.random() < 0.7:
            words.append(rng.choice(VALUES))
    # a case of 4 steps, a scene of 27 points: nothing here takes long, but asking for more processes or a huge grid may
    yield [w for w in words if w not in ("-j",)]


KINDS = {f.__name__.replace("_", " "): f for f in (an_output, a_case, a_scene, an_unfinished_run, a_command_line)}


def fuzz(place, kind, count):
    folder, warm, kept = place
    statuses = {}
    for k in range(count):
        rng = random.Random(f"{SEED} {kind} {k}")
        work = folder / "work"
        shutil.rmtree(work, ignore_errors=True)
        work.mkdir()
        for words in KINDS[kind](rng, *place):
            done = warm.run(work, words, limit=60.0, memory=6 << 30)
            # `atc check` says 1 where a law is broken, `atc verify` where something differs
            others = (1,) if words[0] in ("check", "verify") and "error" not in done["err"] else ()
            acceptable(done, (kind, k, words), others)
            statuses[done["status"]] = statuses.get(done["status"], 0) + 1
    return statuses


@pytest.mark.parametrize("kind", KINDS)
def test_damage(place, kind):
    statuses = fuzz(place, kind, 25)
    # an unfinished run heals: what is damaged of it is computed again
    assert statuses.get(0 if kind == "an unfinished run" else 2, 0) > 2, "damage that does not reach what it is for"


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_damage_for_long(place, kind):
    count = int(os.environ.get("ATC_FUZZ", "1000"))
    print(f"{kind}: {count} tried, exit statuses {fuzz(place, kind, count)}", flush=True)


# --- names and attributes that would steer a terminal

ESCAPE = "a\x1b[2J\x1b]0;x\x07\u202eb"


def test_escapes_reach_no_terminal(place):
    """In the name of a trajectory and of an output, in an attribute of an output, in a title, in the report."""
    folder, warm, _ = place
    work = folder / "escapes"
    work.mkdir()
    shutil.copy(folder / "run.dump", work / f"{ESCAPE}.dump")
    shutil.copy(folder / "o.nc", work / f"{ESCAPE}.nc")
    import h5py

    with h5py.File(work / f"{ESCAPE}.nc", "r+") as f:
        for holder in (f, f["stress"]):
            for key in ("units", "long_name", "method", "sources", "kernel"):
                if key in holder.attrs:
                    holder.attrs[key] = ESCAPE
    for words in (
        ["info", f"{ESCAPE}.dump", "--units", "metal"],
        ["info", f"{ESCAPE}.nc"],
        ["compare", f"{ESCAPE}.nc"],
        ["plot", f"{ESCAPE}.nc"],
        ["export", f"{ESCAPE}.nc"],
        ["info", f"none{ESCAPE}"],
    ):
        acceptable(warm.run(work, words), words)


def test_markup_stays_text_in_reports(tmp_path):
    from atc.upscaling.reports.report import Report

    report = Report("<script>alert(1)</script>\x1b[2J", tmp_path)
    report.text("<img src=x onerror=alert(1)>")
    report.write()
    page = (tmp_path / "report.html").read_text()
    assert "<script>alert" not in page and "<img src=x" not in page
