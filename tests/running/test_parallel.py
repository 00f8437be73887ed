"""Frames and tiles over the workers of a real Dask cluster of separate processes: the same numbers, though workers
die."""

import importlib
import os
import pkgutil
import signal
import socket
import subprocess
import sys
import time

import numpy as np
import pytest
from numba.core.registry import CPUDispatcher
from numba.extending import _Intrinsic as Intrinsic
from test_cli import SCENE, finished_frames, write_dump
from test_cli import atc as start_atc
from test_run import same

import atc
import atc.decomposers
import atc.deposit
import atc.estimators
import atc.kernels
import atc.running.parallel
from atc import simd
from atc.estimators import groups
from atc.estimators.tile_cuts import Cut, owned
from atc.frame import Cell
from atc.planning.calibrate import argon, silicon

KERN = atc.kernel("quartic", radius=6.0)
GRID = atc.Grid.regular(shape=(7, 6, 8))
WHAT = ["stress", "virial_stress", "density", "temperature"]


@pytest.fixture(scope="module")
def cluster():
    """A scheduler and two workers, as a person would start them."""
    distributed = pytest.importorskip("distributed")
    with socket.socket() as s:
        s.bind(("127.0.0.1", 0))
        port = s.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    start = [
        sys.executable,
        "-m",
        "distributed.cli.dask_scheduler",
        "--host",
        "127.0.0.1",
        "--port",
        str(port),
        "--no-dashboard",
        "--no-show",
    ]
    worker = [
        sys.executable,
        "-m",
        "distributed.cli.dask_worker",
        address,
        "--nthreads",
        "1",
        "--no-dashboard",
        "--no-nanny",
        "--memory-limit",
        "0",
    ]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "env": environment}
    processes = [subprocess.Popen(start, **quiet)]

    def more():
        processes.append(subprocess.Popen(worker, **quiet))

    more()
    more()
    try:
        with distributed.Client(address, timeout="60s", set_as_default=False) as client:
            client.wait_for_workers(2, timeout=60)
        yield address, more
    finally:
        for p in processes[::-1]:
            p.kill()
            p.wait()


def frames(n=8):
    first, pot = argon(4)
    rng = np.random.default_rng(0)
    return [
        first.replace(
            positions=first.positions + rng.normal(0, 0.05, first.positions.shape), step=k, source=f"a frame {k}"
        )
        for k in range(n)
    ], pot


def pids(address):
    import distributed

    with distributed.Client(address, set_as_default=False) as client:
        return client.run(os.getpid)


def test_a_cluster_gives_what_one_process_gives_though_a_worker_is_killed(cluster, tmp_path, monkeypatch):
    address, more = cluster
    trajectory, pot = frames()
    serial = atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1)
    seen = []

    def progress(done, total, rate):
        seen.append(done)
        if done == 2:
            victim = next(iter(pids(address).values()))
            os.kill(victim, signal.SIGKILL)

    out = tmp_path / "o.zarr"
    ds = atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1, cluster=address, progress=progress, out=out)
    assert seen == list(range(9))  # progress frame by frame, none lost, none twice
    same(serial, ds)
    assert len(pids(address)) == 1
    more()
    deadline = time.time() + 60
    while len(pids(address)) < 2 and time.time() < deadline:
        time.sleep(0.2)
    # An average over windows, by the workers that are there now.
    same(
        atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1, average=3),
        atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1, average=3, cluster=address),
    )
    # And in groups of frames, one of whose workers dies.
    monkeypatch.setattr(groups, "size_of", lambda window, atoms: 2)
    seen.clear()
    arguments = (trajectory, pot, KERN, GRID, WHAT)
    ds = atc.fields(*arguments, threads=1, average=True, cluster=address, progress=progress)
    assert seen == [0, 2, 4, 6, 8] and len(pids(address)) == 1
    same(atc.fields(*arguments, threads=1, average=True), ds)
    more()


def test_tiles_on_a_cluster_are_those_computed_here(cluster):
    trajectory, pot = frames(2)
    here = atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1, tiles=(2, 1, 2))
    there = atc.fields(trajectory, pot, KERN, GRID, WHAT, threads=1, tiles=(2, 1, 2), cluster=cluster[0])
    same(here, there)


def test_a_run_on_a_cluster_that_is_killed_leaves_no_work_behind(cluster, tmp_path):
    """The scheduler forgets what the run has sent; the same command goes on, and gives what it gives here."""
    import distributed

    write_dump(tmp_path / "run.dump", frames=8)
    (tmp_path / "scene.toml").write_text(SCENE)
    words = ["fields", "scene.toml", "-q", "--cluster", cluster[0], "-o"]
    process = start_atc(*words, "out.zarr", cwd=tmp_path, hold=2)
    deadline = time.time() + 100
    while finished_frames(tmp_path / "out.zarr") < 2 and time.time() < deadline:
        assert process.poll() is None, process.communicate()
        time.sleep(0.02)
    process.kill()
    process.wait()
    with distributed.Client(cluster[0], set_as_default=False) as client:
        deadline = time.time() + 30
        while left := client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.tasks)):
            assert time.time() < deadline, left
            time.sleep(0.2)
    assert not (tmp_path / "out.zarr").exists()
    for process in (
        start_atc(*words, "out.zarr", cwd=tmp_path),
        start_atc(*words[:3], "-o", "here.zarr", cwd=tmp_path),
    ):
        _, err = process.communicate(timeout=200)
        assert process.returncode == 0, err
    same(atc.open_dataset(tmp_path / "here.zarr"), atc.open_dataset(tmp_path / "out.zarr"))


def test_who_does_not_answer(monkeypatch):
    monkeypatch.setattr(atc.running.parallel, "PATIENCE", "1s")
    with pytest.raises(atc.AtcError, match="no Dask scheduler answers"):
        atc.fields(*frames(1), KERN, GRID, ["density"], cluster="tcp://127.0.0.1:9")
    with pytest.raises(atc.AtcError, match="three whole numbers"):
        atc.fields(*frames(1), KERN, GRID, ["density"], tiles=(2, 2))


def close(a, b, names):
    for name in names:
        x, y = a[name].values, b[name].values
        # rounding of sums in another order; the churning is a difference of larger sums
        np.testing.assert_allclose(x, y, rtol=0, atol=1e-12 * np.nanmax(np.abs(y)))


@pytest.mark.parametrize("tiles", [(1, 1, 1), (3, 2, 1), (2, 2, 2)])
def test_tiles_add_up_for_pair_potentials(tiles):
    """Cutoff 8.5 in a box of 16 and 21 Å: tiles see several images of their neighbours, and of themselves."""
    what = ["stress", "heat_flux", "energy", "smoothed_virial_stress", "virial_stress", "churning_divergence"]
    for n in (3, 4):
        frame, pot = argon(n)
        whole, parts = (atc.fields(frame, pot, KERN, GRID, what, threads=2, tiles=t) for t in (None, tiles))
        close(
            parts, whole, [v for v in whole.data_vars if v not in ("mask", "heat_flux_churning", "churning_divergence")]
        )
        assert float(np.abs(parts.churning_divergence).max()) < 1e-10 * float(np.abs(whole.stress).max())


def test_tiles_add_up_for_many_body_potentials_and_tilted_cells():
    frame, pot = silicon(3)
    pot = pot.partitioned("center")
    shear = np.array([[1, 0, 0], [0.3, 1, 0], [-0.2, 0.25, 1.0]])
    tilted = frame.replace(
        positions=frame.positions @ shear + 5.0,
        cell=Cell(frame.cell.vectors @ shear, [5.0, 5, 5]),
        velocities=frame.velocities + 0.01,
    )
    what = ["stress", "heat_flux", "energy_flux", "churning", "churning_divergence", "smoothed_virial_stress"]
    slab = tilted.replace(cell=Cell(tilted.cell.vectors, tilted.cell.origin, (True, True, False)))
    for f in (tilted, slab):
        whole, parts = (atc.fields(f, pot, KERN, GRID, what, threads=1, tiles=t) for t in (None, (2, 2, 2)))
        close(parts, whole, [v for v in whole.data_vars if v not in ("mask", "churning_divergence")])
        assert float(np.abs(parts.churning_divergence).max()) < 1e-15 * float(np.abs(whole.stress).max())  # always 0


def test_every_bond_belongs_to_one_tile():
    frame, pot = silicon(3)
    want = pot.decompose(frame).n_bonds
    count = 0
    for tile in Cut(frame, (2, 3, 2), pot).tiles():
        bonds = pot.decompose(tile.frame).bonds
        count += len(owned(bonds.i, bonds.j, tile.index_p, tile.own_p, tile.image_pc))
    assert count == want


def compiled_functions():
    """Every compiled function of the rooms whose sums must be the same in all processes, and those that each calls."""
    found = {}
    for package in (atc.deposit, atc.kernels, atc.estimators, atc.decomposers):
        for m in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
            try:
                names_of = vars(importlib.import_module(m.name))
            except ModuleNotFoundError as e:
                assert e.name == "torch"  # what is written in torch compiles nothing
                continue
            found |= {id(f): f for f in names_of.values() if isinstance(f, CPUDispatcher)}

    def names(code):
        yield from (*code.co_names, *code.co_freevars)
        for inner in code.co_consts:
            if hasattr(inner, "co_names"):
                yield from names(inner)

    for f in found.values():
        known = f.py_func.__globals__
        yield f, [known[n] for n in set(names(f.py_func.__code__)) if n in known]


def test_no_function_has_two_copies_that_may_round_differently():
    """A function that is called, not inlined, is compiled once for itself and once within each caller; which copy runs
    depends on whether it was compiled in this process or came from the disk. They agree to the last bit unless products
    and sums may be contracted: what may is always inlined."""
    functions = list(compiled_functions())
    assert len(functions) > 100
    vectors = {id(x) for x in vars(simd).values() if isinstance(x, Intrinsic)}
    contracted = {
        id(f) for f, uses in functions if f.targetoptions.get("fastmath") or any(id(u) in vectors for u in uses)
    }
    assert len(contracted) > 20
    for f, uses in functions:
        for g in uses:
            if id(g) in contracted:
                assert g.targetoptions.get("forceinline"), f"{g.py_func.__name__}, called by {f.py_func.__name__}"


def test_workers_that_die_or_send_nothing_of_use(monkeypatch):
    """An error each, none is waited for."""
    import odd_workers

    from atc.errors import AtcError
    from atc.running import workers

    for work, kind, word in (
        (odd_workers.dies_in_an_answer, AtcError, "a worker process died"),
        (odd_workers.answers_what_cannot_be_sent, RuntimeError, "lambda"),
    ):
        monkeypatch.setattr(workers, "_work", work)
        two = workers.Workers(2, None)
        try:
            with pytest.raises(kind, match=word):
                two.compute([], 0)
        finally:
            began = time.monotonic()
            two.end()
        assert time.monotonic() - began < 20
