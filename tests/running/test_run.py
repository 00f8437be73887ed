"""Frames to a file: resumable, atomic, in parallel; time averages."""

import json
import os
import signal
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from frames import argon
from naive_fields import BruteLJ

import atc
from atc.errors import AtcError, AtcWarning
from atc.plan import Request, prepare
from atc.running import collecting
from atc.running.opening import open_dataset

KERN = atc.kernel("quartic", radius=5.5)
GRID = atc.Grid.regular(shape=(3, 4, 3))
WHAT = ["stress", "density", "velocity"]


def trajectory(n=5):
    return [argon(seed=k, step=10 * k, time=0.5 * k, source=f"argon frame {k}") for k in range(n)]


def fields(frames, out=None, what=WHAT, pot=None, **more):
    return atc.fields(frames, pot or BruteLJ(), KERN, GRID, what, threads=2, out=out, **more)


def same(a, b):
    """Bitwise, attributes too."""
    a, b = a.load(), b.load()
    xr.testing.assert_identical(a, b)
    assert a.attrs == b.attrs
    for v in a.variables:
        assert a[v].dtype == b[v].dtype and a[v].attrs == b[v].attrs, v
        if a[v].dtype.kind == "f":
            assert a[v].values.tobytes() == b[v].values.tobytes()


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_file_and_memory_are_the_same(tmp_path, suffix):
    memory = fields(trajectory())
    out = tmp_path / f"o{suffix}"
    file = fields(trajectory(), out)
    same(memory, file)
    assert [p.name for p in tmp_path.iterdir()] == [out.name]
    assert memory.sizes["frame"] == 5 and memory.step.values.tolist() == [0, 10, 20, 30, 40]
    np.testing.assert_allclose(memory.time, memory.frame * argon().units.to_user("time", 0.5))
    # readable by xarray alone, the usual ways
    plain = xr.open_zarr(out, chunks=None) if suffix == ".zarr" else xr.open_dataset(out)
    np.testing.assert_array_equal(plain.stress, memory.stress)
    assert plain.mask.dtype == bool and "cell" in plain.coords and plain.stress.attrs["units"] == "bar"
    plain.close()
    file.close()


class Stop(Exception):
    pass


def stop_after(n):
    def progress(done, total, rate):
        if done == n:
            raise Stop

    return progress


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    """Whole runs to compare with, made once."""
    made = {}

    def get(suffix, average):
        if (suffix, average) not in made:
            made[suffix, average] = fields(
                trajectory(), tmp_path_factory.mktemp("whole") / f"o{suffix}", average=average
            )
        return made[suffix, average]

    return get


@pytest.mark.parametrize(
    "suffix, average, stop",
    [(".zarr", a, s) for a in (False, 2) for s in (0, 1, 3, 5)]
    + [(".nc", False, 3), (".nc", 2, 3), (".nc", 2, 5), (".zarr", True, 3), (".zarr", True, 5)],
)
def test_interrupted_run_continues_bit_for_bit(tmp_path, suffix, average, stop, monkeypatch, uninterrupted):
    monkeypatch.setattr(collecting, "_SAVE_EVERY", 0.0)
    out = tmp_path / f"o{suffix}"
    with pytest.raises(Stop):
        fields(trajectory(), out, average=average, progress=stop_after(stop))
    # without a complete frame there is nothing to keep
    assert not out.exists() and (tmp_path / f"o{suffix}.partial").exists() == (stop > 0)
    pot, seen = BruteLJ(), []
    again = fields(trajectory(), out, pot=pot, average=average, progress=lambda done, total, rate: seen.append(done))
    # done frames are not computed again (but for one to learn the layout when none is left); one more pass to know the
    # potential
    assert seen[0] == stop and len(pot.calls) == 1 + max(5 - stop, 1)
    same(uninterrupted(suffix, average), again)
    assert not (tmp_path / f"o{suffix}.partial").exists()


def test_killed_process_continues_bit_for_bit(tmp_path):
    """A real SIGKILL in the middle of a run."""
    script = tmp_path / "job.py"
    script.write_text(
        textwrap.dedent(f"""
        import sys, time
        sys.path[:0] = {sys.path!r}
        from test_run import fields, trajectory
        def progress(done, total, rate):
            print(done, flush=True)
            if len(sys.argv) > 1: time.sleep(0.3)
        fields(trajectory(8), {str(tmp_path / "o.zarr")!r}, progress=progress)
        """)
    )
    job = subprocess.Popen([sys.executable, str(script), "slow"], stdout=subprocess.PIPE, text=True)
    for line in job.stdout:
        if int(line) >= 3:
            job.send_signal(signal.SIGKILL)
            break
    job.wait()
    job.stdout.close()
    assert not (tmp_path / "o.zarr").exists()
    done = len((tmp_path / "o.zarr.partial" / "journal.jsonl").read_text().splitlines())
    assert 3 <= done < 8
    second = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, check=True)
    assert int(second.stdout.split()[0]) == done
    same(fields(trajectory(8), tmp_path / "whole.zarr"), open_dataset(tmp_path / "o.zarr"))


def test_half_written_journal_line_is_forgotten(tmp_path):
    out = tmp_path / "o.zarr"
    with pytest.raises(Stop):
        fields(trajectory(), out, progress=stop_after(3))
    journal = tmp_path / "o.zarr.partial" / "journal.jsonl"
    journal.write_text(journal.read_text()[:-9])
    pot = BruteLJ()
    again = fields(trajectory(), out, pot=pot)
    assert len(pot.calls) == 1 + 2 + 1  # to know the potential, frames 2..4, with the third note lost
    same(fields(trajectory(), tmp_path / "whole.zarr"), again)


def test_unfinished_output_of_another_request_is_refused(tmp_path):
    out = tmp_path / "o.zarr"
    with pytest.raises(Stop):
        fields(trajectory(), out, progress=stop_after(2))
    before = (tmp_path / "o.zarr.partial" / "journal.jsonl").read_text()
    for more, word in [
        ({"tolerance": 1e-6}, "tolerance"),
        ({"average": 2}, "average"),
        ({"pot": BruteLJ(cutoff=4.0)}, "potential"),
    ]:
        with pytest.raises(AtcError, match=word):
            fields(trajectory(), out, **more)
    with pytest.raises(AtcError, match="trajectory"):
        fields([*trajectory()[1:], argon(seed=9)], out)
    assert (tmp_path / "o.zarr.partial" / "journal.jsonl").read_text() == before
    # but can be thrown away on purpose
    ds = fields(trajectory(), out, tolerance=1e-6, resume=False)
    assert ds.attrs["tolerance"] == 1e-6


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
def test_finished_output_is_replaced_only_by_a_finished_one(tmp_path, suffix):
    out = tmp_path / f"o{suffix}"
    first = fields(trajectory(3), out).load()
    first.close()
    with pytest.raises(Stop):
        fields(trajectory(), out, progress=stop_after(2))
    with open_dataset(out) as kept:
        same(first, kept)
    fields(trajectory(), out).close()
    with open_dataset(out) as new:
        assert new.sizes["frame"] == 5
    assert [p.name for p in tmp_path.iterdir()] == [out.name]


def test_a_kill_between_the_two_renames_loses_nothing(tmp_path, monkeypatch):
    out = tmp_path / "o.zarr"
    first = fields(trajectory(3), out).load()
    real = os.rename

    def rename(a, b):
        if Path(a).name == "data.zarr":
            raise Stop
        real(a, b)

    monkeypatch.setattr(os, "rename", rename)
    with pytest.raises(Stop):
        fields(trajectory(), out)
    monkeypatch.setattr(os, "rename", real)
    with pytest.raises(Stop):
        fields(trajectory(), out, progress=stop_after(5))
    same(first, open_dataset(out))
    assert fields(trajectory(), out).sizes["frame"] == 5


def test_two_runs_do_not_share_an_output(tmp_path):
    out = tmp_path / "o.zarr"
    with pytest.raises(AtcError, match="another run"):
        fields(trajectory(), out, progress=lambda *_: fields(trajectory(), out))


def test_names_and_places_that_cannot_be(tmp_path):
    for out, word in [("o.txt", ".zarr or .nc"), (tmp_path / "missing" / "o.nc", "does not exist")]:
        with pytest.raises(AtcError, match=word):
            fields(trajectory(1), out)
    (tmp_path / "d.nc").mkdir()
    with pytest.raises(AtcError, match="directory"):
        fields(trajectory(1), tmp_path / "d.nc")


@pytest.mark.skipif(not Path("/proc").is_dir() or not os.path.isdir("/sys"), reason="needs a read-only place")
def test_unwritable_place():
    with pytest.raises(AtcError, match="cannot be written"):
        fields(trajectory(1), "/proc/o.zarr")


def test_full_disk(tmp_path):
    """A limit on file sizes stands in for a full disk (EFBIG for ENOSPC): while frames are written, and when the NetCDF
    file is."""
    script = textwrap.dedent(f"""
        import sys, resource, signal
        sys.path[:0] = {sys.path!r}
        from test_run import *
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        fields(trajectory(1), {str(tmp_path / "warm.nc")!r})
        for name, limit in (("o.zarr", 1500), ("o.nc", 20000)):
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
            try:
                fields(trajectory(), {str(tmp_path)!r} + "/" + name)
            except atc.AtcError as e:
                print("AtcError", e)
        """)
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    lines = done.stdout.strip().splitlines()
    assert len(lines) == 2 and all(line.startswith("AtcError") and "o." in line for line in lines), (
        done.stdout + done.stderr
    )
    assert not (tmp_path / "o.zarr").exists() and not (tmp_path / "o.nc").exists()
    # what is complete is kept, and once there is room it is used
    again = fields(trajectory(), tmp_path / "o.nc")
    assert again.sizes["frame"] == 5


def test_bad_input_leaves_nothing_behind(tmp_path):
    with pytest.raises(AtcError, match="velocities"):
        fields([trajectory()[0].replace(velocities=None)], tmp_path / "o.zarr")
    with pytest.raises(AtcError, match="velocities"):  # found out in the second frame: the first one is kept
        fields([trajectory()[0], trajectory()[1].replace(velocities=None)], tmp_path / "p.zarr")
    assert [p.name for p in tmp_path.iterdir()] == ["p.zarr.partial"]


def test_no_space_says_so(tmp_path, monkeypatch):
    import errno

    from atc.running.store import Store

    def write(store, *_):
        from atc.running.output import explained

        with explained(store.out, store.partial):
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Store, "write", write)
    with pytest.raises(AtcError, match=r"disk is full.*partial"):
        fields(trajectory(), tmp_path / "o.zarr")


@pytest.mark.parametrize("suffix", [".zarr", ".nc"])
@pytest.mark.parametrize("average", [False, 2])
def test_a_changing_cell_survives_interruption(tmp_path, suffix, average):
    """Coordinates are those of the trajectory's first frame, not of the first one after the interruption."""
    frames = [argon(atc.Cell([9.0 + k, 10.0, 11.0 - 0.5 * k]), seed=k, step=k, time=float(k)) for k in range(6)]
    grid = atc.Grid.regular(spacing=2.5)

    def run(out, progress=None):
        return atc.fields(
            frames, BruteLJ(), KERN, grid, ["density", "stress"], average=average, threads=2, out=out, progress=progress
        )

    class Stop(Exception):
        pass

    def stop(done, *_):
        if done == 4:
            raise Stop

    whole = run(tmp_path / f"whole{suffix}")
    with pytest.raises(Stop):
        run(tmp_path / f"o{suffix}", stop)
    assert (tmp_path / f"o{suffix}.partial").exists()
    same(whole, run(tmp_path / f"o{suffix}"))
    np.testing.assert_allclose(whole.x, (np.arange(4) + 0.5) * 9.0 / 4)


def test_processes_give_the_same(tmp_path):
    one = fields(trajectory(), tmp_path / "one.zarr", what=["density", "stress"])
    many = fields(trajectory(), tmp_path / "many.zarr", what=["density", "stress"], workers=2)
    same(one, many)


def test_few_frames_use_threads_instead_of_processes():
    job = prepare(Request(trajectory(2), BruteLJ(), KERN, GRID, WHAT, workers=3))
    assert (job.request.workers, job.request.threads) == (1, 3)
    job = prepare(Request(trajectory(3), BruteLJ(), KERN, GRID, WHAT, workers=3, threads=1))
    assert (job.request.workers, job.request.threads) == (3, 1)


def test_progress():
    seen = []
    fields(trajectory(), what=["density"], progress=lambda *a: seen.append(a))
    assert [d for d, _, _ in seen] == [0, 1, 2, 3, 4, 5] and all(t == 5 for _, t, _ in seen) and seen[-1][2] > 0


def test_average_is_the_mean_of_the_frames():
    frames = trajectory(6)
    every = fields(frames, what=["stress", "density", "velocity", "temperature", "virial_stress", "energy"])
    mean = fields(
        frames, what=["stress", "density", "velocity", "temperature", "virial_stress", "energy"], average=True
    )
    assert mean.sizes["frame"] == 1 and mean.frames_averaged.values.tolist() == [6] and mean.step.values.tolist() == [0]
    for q in ("stress", "stress_kinetic", "stress_potential", "density", "virial_stress", "energy"):
        np.testing.assert_allclose(
            mean[q][0], every[q].mean("frame"), rtol=0, atol=1e-12 * float(abs(every[q]).max()), err_msg=q
        )
    np.testing.assert_allclose(
        mean.velocity[0], (every.density * every.velocity).mean("frame") / every.density.mean("frame"), atol=1e-12
    )
    np.testing.assert_allclose(mean.density_stderr[0], every.density.std("frame", ddof=1) / np.sqrt(6), rtol=1e-9)
    assert mean.density_correlated.values.all()  # six frames cannot tell
    assert mean.stress_stderr.attrs["units"] == "bar" and "bound" in mean.stress_stderr.attrs["comment"]
    # as it is, its weight is n; unbiased, what n has left (tests/physics/test_thin.py)
    n = fields(frames, what=["number_density"]).number_density
    every, local = (fields(frames, what=["temperature"], velocity="local", average=a) for a in (False, True))
    np.testing.assert_allclose(
        local.temperature[0], (n * every.temperature).mean("frame") / n.mean("frame"), rtol=1e-12
    )


def test_windows():
    frames = trajectory(5)
    every = fields(frames, what=["density"])
    windows = fields(frames, what=["density"], average=2)
    assert windows.frame.values.tolist() == [0, 2, 4] and windows.frames_averaged.values.tolist() == [2, 2, 1]
    np.testing.assert_allclose(windows.density[1], every.density[2:4].mean("frame"), rtol=1e-14)
    np.testing.assert_array_equal(windows.density[2], every.density[4])
    assert np.isnan(windows.density_stderr[2]).all() and np.isfinite(windows.density_stderr[:2]).all()


def test_average_where_matter_comes_and_goes():
    """A point with mass in some frames only: its velocity is that of the mass seen; where there never was any it is
    NaN."""
    base = argon("slab", n=(2, 2, 1), jitter=0.1)
    frames = [base.replace(positions=base.positions + np.array([0, 0, s])) for s in (0.0, 8.0)]
    z = base.positions[:, 2].mean()
    grid = atc.Grid.points([[1.0, 1.0, z], [1.0, 1.0, z - 6.5]])
    kern = atc.kernel("quartic", radius=4.0)
    mean = atc.fields(frames, None, kern, grid, ["velocity", "stress_kinetic", "density"], average=True).isel(frame=0)
    first = atc.fields(frames[0], None, kern, grid, ["velocity", "stress_kinetic", "density"]).isel(frame=0)
    assert mean.mask.values.tolist() == [True, False]
    np.testing.assert_allclose(mean.velocity[0], first.velocity[0], rtol=1e-13)
    np.testing.assert_allclose(mean.stress_kinetic[0], first.stress_kinetic[0] / 2, rtol=1e-13)
    for q in ("velocity", "stress_kinetic", "velocity_stderr"):
        assert np.isnan(mean[q][1]).all()
    assert (mean.density[1] == 0).all()


def test_frames_that_do_not_fit_together():
    a, b = argon(), argon(n=(2, 2, 2))
    with pytest.raises(AtcError, match=r"ids|shape"):
        fields([a, b], what=["virial_stress_per_atom"])
    assert fields([a, b], what=["density"]).sizes["frame"] == 2


def test_a_spacing_is_settled_by_the_first_frame():
    """As the cell grows its grid grows with it, with as many points, and density still adds up to the mass."""
    frames = [argon(atc.Cell([9.0 + 2 * k, 10.0, 11.0 - k]), seed=k) for k in range(4)]
    ds = atc.fields(
        frames, None, atc.kernel("gaussian", width=3.0), atc.Grid.regular(spacing=1.0), ["density", "momentum"], 1e-12
    )
    assert ds.density.shape == (4, 9, 10, 11) and "9 x 10 x 11 points" in ds.attrs["grid"]
    for k, frame in enumerate(frames):
        one = ds.density[k]
        expected = frame.units.to_user("density", frame.masses.sum() / frame.cell.volume)
        np.testing.assert_allclose(one.mean(), expected, rtol=1e-6)
        np.testing.assert_allclose(ds.position_x[k] / frame.cell.vectors[0, 0], ((np.arange(9) + 0.5) / 9), rtol=1e-12)
        alone = atc.fields(
            frame, None, atc.kernel("gaussian", width=3.0), atc.Grid.regular(shape=(9, 10, 11)), ["density"], 1e-12
        )
        np.testing.assert_array_equal(one, alone.density[0])


def test_what_goes_in(tmp_path):
    """A Frame, a list of them, a Trajectory and what atc.read takes are all trajectories."""
    frames = trajectory(3)
    a = fields(frames, what=["density"])
    for traj in (frames[0], [frames[0]], atc.read(frames[0])):
        np.testing.assert_array_equal(fields(traj, what=["density"]).density, a.density[:1])
    part = fields(atc.read(frames)[1:], what=["density"])
    np.testing.assert_array_equal(part.density, a.density[1:])
    assert fields(frames, what=["piola_stress"], reference=-1).sizes["frame"] == 3
    with pytest.raises(AtcError, match="reference"):
        fields(frames, what=["piola_stress"], reference=7)


def test_frames_that_are_done_are_read_to_be_compared_and_not_computed(tmp_path, monkeypatch):
    from atc.readers.trajectory import Trajectory

    class Lazy(Trajectory):
        def __init__(self):
            super().__init__()
            self.units, self.read = atc.units.units("metal"), []

        def __len__(self):
            return 5

        def _frame(self, k):
            self.read.append(k)
            return trajectory()[k]

    with pytest.raises(Stop):
        fields(Lazy(), tmp_path / "o.zarr", progress=stop_after(3))
    from atc.running import parallel

    computed = []
    inner = parallel.fields_of
    monkeypatch.setattr(
        parallel,
        "fields_of",
        lambda frames, settings, k, **more: computed.append(k) or inner(frames, settings, k, **more),
    )
    traj = Lazy()
    fields(traj, tmp_path / "o.zarr")
    assert sorted(set(traj.read)) == [0, 1, 2, 3, 4]
    assert computed == [3, 4]


def test_journal_holds_no_paths(tmp_path):
    frames = [f.replace(source=f"/home/somebody/x.dump frame {k}") for k, f in enumerate(trajectory())]
    with pytest.raises(Stop):
        fields(frames, tmp_path / "o.zarr", progress=stop_after(3))
    text = "".join(p.read_text() for p in (tmp_path / "o.zarr.partial").glob("*.json*"))
    assert "somebody" not in text and json.loads(text.splitlines()[-1].split("\t")[0])
    assert fields(frames, tmp_path / "o.zarr").attrs["sources"] == "x.dump"


def test_warnings_are_given_once():
    with pytest.warns(AtcWarning) as seen:
        atc.fields(trajectory(3), None, atc.kernel("quartic", radius=1.0), GRID, ["density"])
    assert len([w for w in seen if w.category is AtcWarning]) == 1


def test_big_output_needs_memory_of_one_frame(tmp_path):
    """Chunks: one frame each, so that a frame can be read alone."""
    import zarr

    fields(trajectory(3), tmp_path / "o.zarr")
    assert zarr.open_group(tmp_path / "o.zarr", mode="r")["stress"].chunks[0] == 1


@pytest.mark.parametrize(
    "grid",
    [
        atc.Grid.regular(shape=(2, 3, 2), at="corners"),
        atc.Grid.regular([4.0, 5.0, 6.0], spacing=2.0, origin=[1.0, 0.0, 0.5]),
        atc.Grid.plane(axis="y", shape=(2, 3), position=2.0),
        atc.Grid.plane([1, 2, 3], [4, 0, 0], [0, 3, 4], shape=(2, 2)),
        atc.Grid.line([0, 0, 0], [4, 4, 4], 3),
        atc.Grid.slab("z", 4),
        atc.Grid.points([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]),
        atc.Grid.atoms(),
    ],
    ids=lambda g: g.kind,
)
def test_a_call_in_python_keeps_a_scene_that_says_the_same(grid):
    from atc.config.scene import Scene

    lines = "pair_style lj/cut 6\npair_coeff * * 0.0104 3.405\n"
    frame = argon(source="/home/somebody/run.dump frame 3")
    kern = atc.kernel("gaussian", width=1.7)
    ds = atc.fields(frame, atc.potential(lines, units="metal"), kern, grid, ["stress", "density"], 1e-7)
    scene = Scene.loads(ds.attrs["scene"])
    assert (
        scene.kernel() == kern
        and scene.get("fields", "tolerance") == 1e-7
        and scene.get("trajectory", "file") == "run.dump"
    )
    assert scene.get("potential", "lammps") == lines and "somebody" not in ds.attrs["scene"]
    again = atc.fields(frame, scene.potential(), scene.kernel(), scene.grid(), scene.get("fields", "quantities"), 1e-7)
    for name in ("stress", "density"):
        np.testing.assert_array_equal(ds[name], again[name])
