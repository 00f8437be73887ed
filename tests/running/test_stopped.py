"""Runs that are told to stop, killed, left without a parent or without room: what is finished is kept, and the result
is the same bit for bit.

Random kills: a few here, as many as ATC_KILLS says with ``pytest -m slow tests/running/test_stopped.py``.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from forking import Warm
from test_case import PLATE
from test_cli import SCENE, atc, finished_frames, ok, tree, write_dump

from atc.config.scene import Scene
from atc.running.store import published

ROOT = Path(__file__).parents[2]
FRAMES, FEW = 40, 10
BIG = SCENE.replace("[4, 5, 6]", "[12, 12, 12]").replace('file = "out.nc"', "")
SMALL = BIG.replace("[12, 12, 12]", "[4, 5, 6]").replace('"smoothed_virial_stress", "density", "velocity", ', "")
KINDS = {
    "zarr": ("out.zarr", []),
    "nc": ("out.nc", []),
    "workers": ("out.zarr", ["-j", "2"]),
    "average": ("out.zarr", ["--set", "fields.average=4"]),
    "mean": ("out.nc", ["--set", "fields.average=true"]),
    "tiles": ("out.zarr", ["--set", "fields.tiles=[2,1,1]", "--set", "fields.method=direct"]),
    "pd": ("out.zarr", []),
    "pd with fields": ("out.nc", []),
    "conductivity": ("out.png", ["--segments", "2", "--dt", "1", "--json"]),
    "advection": ("out.zarr", ["--nodes", "64", "--frames", "11"]),
    "profile": ("out.nc", ["--axis", "z", "--bins", "6", "--overwrite"]),
    "twin": ("out.zarr", ["--overwrite"]),
}
#: How often a thousand kills go to each kind of run: worker processes are started anew each time, which takes seconds.
SHARES = {kind: 1 if kind in ("workers", "conductivity", "advection", "twin") else 4 for kind in KINDS}
#: Without an unfinished output to go on from: the same command begins again.
AT_ONCE = ("conductivity", "advection", "profile", "twin")
WITH_FIELDS = """
[kernel]
name = "quartic"
radius = 0.004

[grid]
kind = "regular"
shape = [12, 6, 1]
vectors = [[0.03, 0, 0], [0, 0.012, 0], [0, 0, 0.001]]

[fields]
quantities = ["density", "velocity"]
tolerance = 1e-12
"""


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """Uninterrupted results, made once each, in processes of their own."""
    made = {}

    def get(kind, frames=FRAMES):
        if (kind, frames) not in made:
            folder = tmp_path_factory.mktemp(kind.replace(" ", "-"))
            prepare(folder, kind, frames)
            process = command(folder, kind)
            said, err = process.communicate(timeout=200)
            assert process.returncode == 0, err
            made[kind, frames] = results(folder, kind, said)
        return made[kind, frames]

    return get


@pytest.fixture(scope="module")
def warm(tmp_path_factory):
    """A process to fork runs from, that has run each kind before: run(kind, folder, **when to kill it)."""
    process, hot = Warm(), {}

    def run(kind, folder, **when):
        if kind not in hot:
            before = tmp_path_factory.mktemp("hot")
            prepare(before, kind, FEW)
            process.heat(before, words(kind))
            shutil.rmtree(before)
            prepare(before, kind, FEW)
            hot[kind] = process.run(before, words(kind))
            assert hot[kind]["status"] == 0, hot[kind]
            shutil.rmtree(before)
        return process.run(folder, words(kind), **when)

    def about(kind):
        """What a run of this kind over a few frames took that was not killed."""
        run(kind, ROOT, at=1)
        return hot[kind]

    run.about = about
    yield run
    process.close()


def prepare(folder: Path, kind: str, frames: int = FRAMES):
    name, more = KINDS[kind]
    folder.mkdir(exist_ok=True)
    if kind.startswith("pd"):
        text = PLATE.replace("steps = 120", f"steps = {75 * frames}").replace("every = 25", "every = 75")
        if kind == "pd with fields":
            text += (
                'vtk = "vtk"\nextxyz = "out.extxyz"\nrestart = "end.npz"\nquantities = ["displacement", "damage", '
                '"stress"]\n' + WITH_FIELDS
            )
        (folder / "case.toml").write_text(text)
    elif kind == "twin":
        import test_twin

        strains = [np.diag([0.002 * k, 0, 0]) for k in range(4)]
        data = test_twin.scene(folder / "run.dump", [test_twin.block(e, time=0.1 * k) for k, e in enumerate(strains)])
        data["trajectory"]["file"] = "run.dump"
        (folder / "scene.toml").write_text(Scene.load(data).to_toml())
    elif kind != "advection":
        write_dump(folder / "run.dump", frames=45 if kind == "conductivity" else frames)
        (folder / "scene.toml").write_text(BIG if frames == FRAMES else SMALL)
    return folder / name, more


def words(kind) -> list[str]:
    name, more = KINDS[kind]
    first = {
        "pd": ["pd", "case.toml", "-j", "1"],
        "conductivity": ["conductivity", "scene.toml"],
        "advection": ["advect"],
        "profile": ["profile", "scene.toml"],
        "twin": ["twin", "scene.toml"],
    }
    return [
        *first.get(kind.split()[0], ["fields", "scene.toml"]),
        "--picture" if kind == "conductivity" else "-o",
        name,
        "-q",
        *more,
    ]


def command(folder, kind, hold=None):
    return atc(*words(kind), cwd=folder, hold=hold)


def results(folder, kind, said):
    """All that a run leaves, and what it says where that is the result."""
    inputs = {"run.dump", "scene.toml", "case.toml"}
    return {k: v for k, v in tree(folder).items() if k not in inputs}, said if kind == "conductivity" else None


#: Half of the kills leave a run no time for anything, the others tell it to stop.
SIGNALS = [signal.SIGKILL] * 3 + [signal.SIGTERM, signal.SIGINT, signal.SIGHUP]


def kill_at_random(folder, kind, rng, wholes, warm, most=12) -> tuple[int, int]:
    """Kill a run at random moments until it gets through, and now and then change what it reads in between, which it
    must notice; (kills, changes)."""
    out, _ = prepare(folder, kind, FEW)
    about, kills, changes = warm.about(kind), 0, 0
    while True:
        number = rng.choice(SIGNALS)
        done = warm(kind, folder, after=rng.uniform(0.0, about["seconds"]) if kills < most else None, number=number)
        if done["status"] == 0:
            if not kills:
                about["seconds"] = done["seconds"]  # as busy as the machine is now
            break
        if was_finished(done, out, kind):
            break
        # Before a command hears signals, and when it is over, it just ends.
        assert done["status"] in (-number, 128 + number), done
        errors = [line for line in done["err"].splitlines() if not line.startswith("warning: ")]
        assert len(errors) == (done["status"] > 0), done
        kills += 1
        if kind not in AT_ONCE and not published(out) and rng.random() < 0.3:
            changes += changed_in_between(folder, out, kind, rng, warm)
    same_as_whole(folder, kind, wholes, f"after {kills} kills", done)
    return kills, changes


#: Words of a scene or a case that change numbers, and what they become.
OTHERWISE = {
    "scene.toml": [
        ("39.948", "39.95"),
        ("0.0104 3.4", "0.0104 3.41"),
        ("lj/cut 7.0", "lj/cut 7.5"),
        ('"quartic"', '"lucy"'),
        ("radius = 5.0", "radius = 5.000001"),
        ("[4, 5, 6]", "[4, 5, 7]"),
        ('"temperature"', '"momentum"'),
    ],
    "case.toml": [
        ("0.003015", "0.003016"),
        ("youngs = 72e9", "youngs = 72.1e9"),
        ("s00 = 0.002", "s00 = 0.0021"),
        ("[0, 8, 0]", "[0, 8.1, 0]"),
        ("jitter = 0.05", "jitter = 0.051"),
        ("density = 2440", "density = 2441"),
    ],
}


def changed_in_between(folder, out, kind, rng, warm) -> int:
    """Change one input of an unfinished run; whether there was a run to compare with."""
    partial = out.with_name(f"{out.name}.partial")
    if not (partial / "request.json").exists():
        return 0
    path = folder / ("case.toml" if kind.startswith("pd") else "scene.toml")
    if path.name == "scene.toml" and rng.random() < 0.5:  # one number of a frame that is done
        path = folder / "run.dump"
        journal = partial / "journal.jsonl"
        notes = [line.split(b"\t") for line in journal.read_bytes().splitlines()] if journal.exists() else []
        frames = sum(json.loads(note[0])["frames"] for note in notes if len(note) == 2)
        parts = path.read_text().split("ITEM: TIMESTEP")
        lines = parts[k := rng.randrange(max(1, frames)) + 1].split("\n")
        words = lines[row := rng.randrange(9, len(lines) - 1)].split()
        column = rng.randrange(2, len(words))
        words[column] = repr(float(words[column]) * (1 + 1e-9))
        lines[row] = " ".join(words)
        text = "ITEM: TIMESTEP".join([*parts[:k], "\n".join(lines), *parts[k + 1 :]])
    else:
        old, new = rng.choice(OTHERWISE[path.name])
        text = path.read_text().replace(old, new)
    before = path.read_text()
    assert text != before
    path.write_text(text)
    done = warm(kind, folder)
    assert done["status"] == 2 and ("different: " in done["err"] or "is not what it was" in done["err"]), done
    path.write_text(before)
    return 1


def was_finished(done, out, kind) -> bool:
    """The kill before has come in the moment between the last mark of an unfinished run and the last of its files: it
    is a finished output, which is not replaced."""
    return (
        done["status"] == 2
        and f"{out.name} exists" in done["err"]
        and kind not in AT_ONCE
        and not (out.parent / f"{out.name}.partial" / "made.json").exists()
    )


def same_as_whole(folder, kind, wholes, when, done):
    """Every file is there and is what it is without a kill, and no other; the last kill of a run that was finished may
    leave what is no longer needed."""
    expected, told = wholes(kind, FEW)
    got, _ = results(folder, kind, None)
    for name in got.keys() | expected.keys():
        if done["status"] and ".partial/" in name:
            continue
        assert name in got and name in expected, f"{kind}: {name} {when}"
        assert got[name] == expected[name], f"{kind}: {name} differs {when}"
    assert done["status"] or told is None or done["out"] == told, f"{kind}: says something else {when}"


@pytest.mark.parametrize("kind", ["average", "pd with fields"])
def test_killed_at_random_moments(tmp_path, wholes, warm, kind):
    rng, kills, changes = random.Random(3), 0, 0
    for again in range(20):  # on a busy machine a run may be over before it is killed
        more = kill_at_random(tmp_path / str(again), kind, rng, wholes, warm)
        kills, changes = kills + more[0], changes + more[1]
        if kills and changes:
            return
    raise AssertionError(f"{kills} kills, {changes} changes")


@pytest.mark.slow
def test_many_kills(tmp_path, wholes, warm):
    """ATC_KILLS (default 100) kills over all kinds of runs."""
    wanted, rng = int(os.environ.get("ATC_KILLS", "100")), random.Random(os.environ.get("ATC_SEED", "1"))
    done, noticed, rounds = dict.fromkeys(KINDS, 0), 0, 0
    while sum(done.values()) < wanted:
        kind = min(KINDS, key=lambda k: done[k] / SHARES[k])
        folder = tmp_path / str(rounds)
        kills, changes = kill_at_random(folder, kind, rng, wholes, warm)
        done[kind], noticed = done[kind] + kills, noticed + changes
        shutil.rmtree(folder)
        rounds += 1
        if rounds % 10 == 0 or sum(done.values()) >= wanted:
            print(
                f"{sum(done.values())} kills in {rounds} runs, no difference, {noticed} changed inputs noticed: {done}",
                flush=True,
            )


def kill_before_each_change(tmp_path, kind, warm, which):
    """A run of three frames, killed before its k-th change of the file system, for every k of `which(how many there
    are)`; killed once more; and finished."""
    rng = random.Random(kind)
    prepare(tmp_path / "whole", kind, frames=3)
    whole = warm(kind, tmp_path / "whole")
    assert whole["status"] == 0, whole
    small = lambda kind, frames: results(tmp_path / "whole", kind, whole["out"])  # noqa: E731
    killed = 0
    for k in which(whole["changes"]):
        folder = tmp_path / "killed"
        out, _ = prepare(folder, kind, frames=3)
        for at in (k, rng.randint(1, whole["changes"]), None):
            done = warm(kind, folder, at=at)
            if done["status"] == 0 or was_finished(done, out, kind):
                break
            assert done["status"] == -9, (k, done)
            killed += 1
        same_as_whole(folder, kind, small, f"after a kill before change {k}", done)
        shutil.rmtree(folder)
    return killed


@pytest.mark.parametrize("kind", ["nc", "pd with fields", "profile"])
def test_killed_before_changes_of_the_disk(tmp_path, warm, kind):
    killed = kill_before_each_change(tmp_path, kind, warm, lambda n: range(1, n, max(1, n // 8)))
    assert killed >= (6 if kind in AT_ONCE else 8)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [k for k in KINDS if k != "workers"])
def test_killed_before_every_change_of_the_disk(tmp_path, warm, kind):
    killed = kill_before_each_change(tmp_path, kind, warm, lambda n: range(1, n + 1))
    print(f"{kind}: {killed} kills before changes of the file system")


def stopped(process, out, number, least=2):
    """Send a signal once something is finished; (status, stderr)."""
    deadline = time.monotonic() + 100
    while finished_frames(out) < least:
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    return process.returncode, err


@pytest.mark.parametrize(
    "number, status, word", [(signal.SIGTERM, 143, "terminated"), (signal.SIGHUP, 129, "the terminal has gone")]
)
@pytest.mark.parametrize("kind", ["zarr", "workers", "pd"])
def test_told_to_stop(tmp_path, wholes, kind, number, status, word):
    out, _ = prepare(tmp_path, kind)
    got, err = stopped(command(tmp_path, kind, hold=2), out, number)
    *before, last = err.splitlines()
    assert got == status and last == (
        f"error: {word}; {'what is done is' if kind == 'pd' else 'the finished frames are'} kept: the same command "
        "continues"
    )
    # The case's horizon is short, which is said first.
    assert [line[:40] for line in before] == ["warning: case.toml:4: [body] horizon: 3."] * (kind == "pd")
    assert not out.exists()
    assert command(tmp_path, kind).wait(timeout=200) == 0
    assert results(tmp_path, kind, None)[0] == wholes(kind)[0]


def test_a_window_loses_no_frame(tmp_path, wholes):
    """One window over all frames, told to stop: its frames so far are kept without waiting for the next save."""
    from test_run import Stop, fields, same, trajectory

    from atc.running import collecting
    from atc.running.interruption import Stopped, watched

    seen = []

    def progress(done, total, rate):
        seen.append(done)
        if done == 3 and len(seen) < 6:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Stopped), watched():
        fields(trajectory(), tmp_path / "o.zarr", average=True, progress=progress)
    assert collecting._SAVE_EVERY > 1 and seen == [0, 1, 2, 3]
    seen[:] = [9] * 6
    again = fields(trajectory(), tmp_path / "o.zarr", average=True, progress=progress)
    assert seen[6] == 3
    same(fields(trajectory(), tmp_path / "w.zarr", average=True), again)
    assert Stop


@pytest.mark.parametrize("where", ["hdf5", "finaliser"])
def test_a_signal_where_nothing_can_be_raised(tmp_path, where):
    """In the middle of the HDF5 library, which loses exceptions, and in a destructor, where Python drops them: it is
    raised afterwards, and keeps nothing alive of what it interrupted."""
    import h5py

    from atc.running.interruption import Stopped, last, watched

    went_on = []

    def stop(*_):
        os.kill(os.getpid(), signal.SIGTERM)
        went_on.append(where)

    class Dying:
        __del__ = stop

    with pytest.raises(Stopped) as raised, watched():
        if where == "hdf5":
            with h5py.File(tmp_path / "f.h5", "w") as f:
                f["a"] = 1.0
                f.visititems(stop)
        else:
            Dying()
        time.sleep(10)
    assert raised.value.number == last().number == signal.SIGTERM and last().__traceback__ is None
    assert went_on == (["hdf5"] if where == "hdf5" else [])


def test_a_signal_that_another_thread_gets_while_processes_start():
    """The first thread is masked then; what another one got is heard when all of them stand."""
    import threading

    from atc.running.interruption import Stopped, unheard, watched

    done, went_on = threading.Event(), []
    threading.Thread(target=done.wait, daemon=True).start()
    try:
        with pytest.raises(Stopped), watched(), unheard():
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(0.2)
            went_on.append(True)
    finally:
        done.set()
    assert went_on


def children(pid) -> set[int]:
    """All processes below `pid`, by /proc."""
    below, found = {}, set()
    for entry in Path("/proc").iterdir():
        if entry.name.isdigit():
            try:
                below.setdefault(int((entry / "stat").read_text().rsplit(")", 1)[1].split()[1]), []).append(
                    int(entry.name)
                )
            except (OSError, IndexError):
                continue
    todo = [pid]
    while todo:
        for p in below.get(todo.pop(), []):
            found.add(p)
            todo.append(p)
    return found


def alive(pid) -> bool:
    try:
        return (Path("/proc") / str(pid) / "stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes by /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT, signal.SIGHUP])
def test_workers_end_with_their_parent(tmp_path, number):
    out, _ = prepare(tmp_path, "workers")
    process = command(tmp_path, "workers", hold=2)
    deadline = time.monotonic() + 100
    while finished_frames(out) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    workers = children(process.pid)
    assert len(workers) >= 2
    process.send_signal(number)
    process.communicate(timeout=60)
    deadline = time.monotonic() + 10
    while any(alive(p) for p in workers):
        assert time.monotonic() < deadline, "orphans"
        time.sleep(0.05)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="finds processes by /proc")
def test_a_worker_that_dies_ends_the_run(tmp_path):
    """Out of memory, it is the kernel that kills it: the others, which hear no signal, must not be waited for."""
    prepare(tmp_path, "workers")
    (tmp_path / "scene.toml").write_text(BIG.replace("[12, 12, 12]", "[20, 20, 20]"))
    process = command(tmp_path, "workers")
    deadline = time.monotonic() + 100
    while finished_frames(tmp_path / "out.zarr") < 1:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    workers = [p for p in children(process.pid) if b"spawn_main" in Path(f"/proc/{p}/cmdline").read_bytes()]
    os.kill(workers[0], signal.SIGKILL)
    _, err = process.communicate(timeout=30)
    assert process.returncode == 2 and err.startswith("error: a worker process died") and len(err.splitlines()) == 1
    assert not any(alive(p) for p in workers)


@pytest.mark.skipif(not hasattr(signal, "pthread_sigmask"), reason="signals cannot be put off here")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGHUP])
def test_a_signal_to_the_whole_group_while_workers_start(tmp_path, number):
    """They say nothing, and neither does what the library keeps beside them."""
    prepare(tmp_path, "workers")
    process = atc(*words("workers"), cwd=tmp_path, start_new_session=True)
    deadline = time.monotonic() + 100
    while len(children(process.pid)) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    time.sleep(0.3)
    os.killpg(process.pid, number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number and len(err.splitlines()) == 1, err


def test_interrupted_while_it_starts():
    """No traceback of an import."""
    code = """if True:
        import os, signal, sys

        class Interrupts:
            def find_spec(self, name, *more):
                if name == "typer":
                    os.kill(os.getpid(), signal.SIGINT)

        sys.meta_path.insert(0, Interrupts())
        from atc.cli import main
        main()"""
    env = dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path)))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=env)
    assert done.returncode == -signal.SIGINT and not done.stderr


def test_a_signal_to_the_whole_group(tmp_path, wholes):
    """As schedulers and terminals send it: workers get it too, and leave it to the parent."""
    out, _ = prepare(tmp_path, "workers")
    process = atc(*words("workers"), cwd=tmp_path, hold=2, start_new_session=True)
    deadline = time.monotonic() + 100
    while finished_frames(out) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 143 and len(err.splitlines()) == 1
    assert command(tmp_path, "workers").wait(timeout=200) == 0
    assert results(tmp_path, "workers", None)[0] == wholes("workers")[0]


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="a small file system needs root to mount it")
@pytest.mark.parametrize("kind", ["zarr", "nc"])
def test_no_room(tmp_path, wholes, kind):
    """A real full disk: exit 2, one line, finished frames kept; with room again the run goes on."""
    out, _ = prepare(tmp_path, kind)
    disk = tmp_path / "disk"
    disk.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=1536k", "tmpfs", str(disk)], capture_output=True).returncode:
        pytest.skip("mounting is not allowed here")
    try:
        arguments = ["fields", "../scene.toml", "-o", out.name, "-q"]
        process = atc(*arguments, cwd=disk)
        _, err = process.communicate(timeout=100)
        assert process.returncode == 2 and len(err.splitlines()) == 1 and "the disk is full" in err
        done = finished_frames(disk / out.name)
        assert 0 < done < FRAMES and not (disk / out.name).exists()
        subprocess.run(["mount", "-o", "remount,size=256m", str(disk)], check=True)
        again = atc("fields", "../scene.toml", "-o", out.name, cwd=disk)
        said, err = again.communicate(timeout=100)
        assert again.returncode == 0, err
        assert f"{done} of {FRAMES} " in said
        assert {k: v for k, v in tree(disk).items()} == wholes(kind)[0]
    finally:
        subprocess.run(["umount", "-l", str(disk)], check=True)


# --- outputs that are not what was written


@pytest.fixture(scope="module")
def outputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("outputs")
    write_dump(folder / "run.dump", frames=2)
    (folder / "scene.toml").write_text(SCENE)
    for name in ("o.nc", "o.zarr"):
        ok("fields", str(folder / "scene.toml"), "-o", str(folder / name), "-q")
    return folder


def flip(path: Path, at: int) -> None:
    data = bytearray(path.read_bytes())
    data[at] ^= 16
    path.write_bytes(data)


def damaged(outputs, tmp_path, name):
    """A copy in which one bit of the data of stress, second frame, differs."""
    out = tmp_path / name
    if name == "o.zarr":
        shutil.copytree(outputs / name, out)
        chunk = sorted((out / "stress").glob("1.*"))[0]
        flip(chunk, chunk.stat().st_size // 2)
        return out
    import h5py

    shutil.copy(outputs / name, out)
    with h5py.File(out) as f:
        chunk = f["stress"].id.get_chunk_info(f["stress"].id.get_num_chunks() - 1)
    flip(out, chunk.byte_offset + chunk.size // 2)
    return out


@pytest.mark.parametrize("name", ["o.nc", "o.zarr"])
@pytest.mark.parametrize(
    "words", [["info"], ["compare"], ["plot", "-q", "stress", "-c", "xx", "--frame", "1"], ["export"]]
)
def test_a_flipped_bit_is_named(outputs, tmp_path, name, words):
    from test_cli import run

    out = damaged(outputs, tmp_path, name)
    result = run(words[0], str(out), *words[1:])
    assert result.exit_code == 2, result.output
    assert (
        "stress" in result.stderr and "not what was written" in result.stderr and len(result.stderr.splitlines()) == 1
    )


def test_a_missing_chunk_is_named(outputs, tmp_path):
    from test_cli import refused

    out = tmp_path / "o.zarr"
    shutil.copytree(outputs / "o.zarr", out)
    next(iter(sorted((out / "density").glob("1.*")))).unlink()
    assert "density: 1 of 2 chunks are missing" in refused("plot", str(out), "-q", "density")
    assert "density: 1 of 2 chunks are missing" in refused("info", str(out))


def test_fields_without_numbers_have_their_chunks_too(tmp_path):
    """A chunk of nothing but NaN is written as well."""
    import zarr
    from test_run import GRID, KERN, trajectory

    import atc as package

    grid = package.Grid.points(np.array([[500.0, 0, 0]]))
    frame = trajectory(1)[0]
    frame.cell = type(frame.cell)(frame.cell.vectors, frame.cell.origin, (False,) * 3)
    package.fields(frame, None, KERN, grid, ["velocity"], out=tmp_path / "o.zarr")
    arrays = dict(zarr.open_group(str(tmp_path / "o.zarr"), mode="r").arrays())
    assert all(a.nchunks_initialized == a.nchunks for a in arrays.values()) and np.isnan(arrays["velocity"][...]).all()
    assert GRID
