"""Runs that are told to stop, killed, left without a parent or without room: what is finished is kept, and the result
is the same bit for bit.

Random kills: a few here, as many as ATC_KILLS says with ``pytest -m slow tests/running/test_stopped.py``.
"""

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
from test_case import PLATE
from test_cli import SCENE, atc, finished_frames, ok, tree, write_dump

FRAMES = 40
BIG = SCENE.replace("[4, 5, 6]", "[12, 12, 12]").replace('file = "out.nc"', "")
KINDS = {
    "zarr": ("out.zarr", []),
    "nc": ("out.nc", []),
    "workers": ("out.zarr", ["-j", "2"]),
    "average": ("out.zarr", ["--set", "fields.average=7"]),
    "mean": ("out.nc", ["--set", "fields.average=true"]),
    "tiles": ("out.zarr", ["--set", "fields.tiles=[2,1,1]", "--set", "fields.method=direct"]),
    "pd": ("out.zarr", []),
}


@pytest.fixture(scope="module")
def wholes(tmp_path_factory):
    """Uninterrupted results, made once each."""
    made = {}

    def get(kind):
        if kind not in made:
            folder = tmp_path_factory.mktemp(kind)
            out, _ = prepare(folder, kind)
            process = command(folder, kind)
            assert process.wait(timeout=200) == 0, process.stderr.read()
            made[kind] = tree(out)
        return made[kind]

    return get


def prepare(folder: Path, kind: str):
    name, more = KINDS[kind]
    if kind == "pd":
        (folder / "case.toml").write_text(
            PLATE.replace("steps = 120", "steps = 3000").replace("every = 25", "every = 100")
        )
    else:
        write_dump(folder / "run.dump", frames=FRAMES)
        (folder / "scene.toml").write_text(BIG)
    return folder / name, more


def command(folder, kind):
    name, more = KINDS[kind]
    first = ["pd", "case.toml", "-j", "1"] if kind == "pd" else ["fields", "scene.toml"]
    return atc(*first, "-o", name, "-q", *more, cwd=folder)


def kill_at_random(folder, kind, rng, wholes) -> int:
    """Kill a run at random moments until it gets through; the number of kills."""
    out, _ = prepare(folder, kind)
    kills = 0
    while True:
        process = command(folder, kind)
        time.sleep(rng.uniform(0.0, 1.0) ** 2 * 1.5 + (0.0 if rng.random() < 0.2 else 0.6))
        if process.poll() is None:
            process.kill()
            process.communicate()
            kills += 1
            if out.exists():  # it had just got through
                break
            if kills < 6:
                continue
            process = command(folder, kind)
        _, err = process.communicate(timeout=200)
        assert process.returncode == 0, err
        break
    assert tree(out) == wholes(kind), f"{kind}: differs after {kills} kills"
    return kills


@pytest.mark.parametrize("kind", ["average", "pd"])
def test_killed_at_random_moments(tmp_path, wholes, kind):
    kill_at_random(tmp_path, kind, random.Random(3), wholes)


@pytest.mark.slow
def test_many_kills(tmp_path, wholes):
    """ATC_KILLS (default 100) kills over all kinds of runs."""
    wanted, done, round_, rng = (
        int(os.environ.get("ATC_KILLS", "100")),
        {},
        0,
        random.Random(os.environ.get("ATC_SEED", "1")),
    )
    while sum(done.values()) < wanted:
        kind = list(KINDS)[round_ % len(KINDS)]
        folder = tmp_path / str(round_)
        folder.mkdir()
        done[kind] = done.get(kind, 0) + kill_at_random(folder, kind, rng, wholes)
        shutil.rmtree(folder)
        round_ += 1
    print(f"{sum(done.values())} kills in {round_} runs, no difference: {done}")


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
    got, err = stopped(command(tmp_path, kind), out, number)
    assert (
        got == status
        and err
        == f"error: {word}; {'what is done is' if kind == 'pd' else 'the finished frames are'} kept: the same command "
        "continues\n"
    )
    assert not out.exists()
    assert command(tmp_path, kind).wait(timeout=200) == 0
    assert tree(out) == wholes(kind)


def test_a_window_loses_no_frame(tmp_path, wholes):
    """One window over all frames, told to stop: its frames so far are kept without waiting for the next save."""
    from test_run import Stop, fields, same, trajectory

    from atc.running import run
    from atc.running.interruption import Stopped, watched

    seen = []

    def progress(done, total, rate):
        seen.append(done)
        if done == 3 and len(seen) < 6:
            os.kill(os.getpid(), signal.SIGTERM)

    with pytest.raises(Stopped), watched():
        fields(trajectory(), tmp_path / "o.zarr", average=True, progress=progress)
    assert run._SAVE_EVERY > 1 and seen == [0, 1, 2, 3]
    seen[:] = [9] * 6
    again = fields(trajectory(), tmp_path / "o.zarr", average=True, progress=progress)
    assert seen[6] == 3
    same(fields(trajectory(), tmp_path / "w.zarr", average=True), again)
    assert Stop


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
    process = command(tmp_path, "workers")
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


def test_a_signal_to_the_whole_group(tmp_path, wholes):
    """As schedulers and terminals send it: workers get it too, and leave it to the parent."""
    out, _ = prepare(tmp_path, "workers")
    process = subprocess.Popen(
        [sys.executable, "-m", "atc", "fields", "scene.toml", "-o", "out.zarr", "-q", "-j", "2"],
        cwd=tmp_path,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 100
    while finished_frames(out) < 2:
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGTERM)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 143 and len(err.splitlines()) == 1
    assert command(tmp_path, "workers").wait(timeout=200) == 0
    assert tree(out) == wholes("workers")


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
        assert tree(disk / out.name) == wholes(kind)
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
