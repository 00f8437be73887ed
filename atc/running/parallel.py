"""Where frames are computed: here, in other processes of this machine, or by the workers of a Dask cluster. Results
come in the order of the frames.

A frame's result depends on the frame, the settings and its number alone, so it does not matter who computes it, or how
often it was begun; the same holds for the mean of a group of frames of a time average (`estimators.groups`).
"""

from __future__ import annotations

import contextlib
import warnings
from collections import deque
from dataclasses import replace
from itertools import islice

from ..errors import AtcError, AtcWarning
from ..estimators.driver import fields_of
from ..estimators.results import FrameResult
from ..estimators.settings import Settings
from ..planning.job import Job

#: How long a scheduler may take to answer.
PATIENCE = "10s"


def frame_results(job: Job, settings: Settings, start: int, first: FrameResult | None = None):
    """(frames, FrameResult) in order from frame `start`: one frame after the other, or groups of them; the result of
    the first frame may be there already.

    Parameters
    ----------
    job, settings : what is to be computed, with the methods of all frames
    """
    if first is not None:
        yield [job.first], first
        start = 1
    if start >= job.n_frames:
        return
    frames = _grouped(job, start)
    if job.request.cluster is not None and job.request.tiles is None:
        yield from _on_cluster(job, settings, frames)
    elif job.request.workers > 1 and job.request.tiles is None:
        yield from _in_processes(job, settings, frames)
    else:
        with here(job) as run_tiles:
            for k, group in frames:
                yield group, fields_of(group, settings, k, run_tiles=run_tiles)


def _grouped(job, start):
    """(number of the first, frames) of what is computed together, from frame `start` on, reading nothing before it."""
    frames = iter(job.frames if start == 0 else job.frames[start:])
    for k, count in job.groups(start):
        group = list(islice(frames, count))
        if group:
            yield k, group
        if len(group) < count:
            return


@contextlib.contextmanager
def here(job):
    """How the tiles of a frame that is put together here are computed: None (here too), or a function that has the
    cluster do it."""
    if job.request.tiles is None or job.request.cluster is None:
        yield None
        return
    with connected(job.request.cluster) as client:

        def run_tiles(f, tiles, task):
            keep = client.submit(_itself, task, pure=False)
            jobs = (client.submit(f, tile, keep, pure=False) for tile in tiles)
            yield from _in_order(jobs, _many(client))

        yield run_tiles


# --- processes of this machine


def _in_processes(job, settings, frames):
    from concurrent.futures import ThreadPoolExecutor

    from .workers import Workers

    count = job.request.workers
    try:
        workers = Workers(count, settings)
    except (OSError, ImportError) as e:  # a limit on the number of processes
        why = f"no worker processes can be had here ({getattr(e, 'strerror', None) or e})"
        text = f"{why}: frames are computed one after another, by as many threads"
        warnings.warn(text, AtcWarning, stacklevel=2)
        settings = replace(settings, threads=count * job.request.threads)
        for k, group in frames:
            yield group, fields_of(group, settings, k)
        return
    threads = ThreadPoolExecutor(count)  # one to wait for each process
    try:
        yield from _with_groups(frames, lambda group, k: threads.submit(workers.compute, group, k), 2 * count + 1)
    finally:
        workers.end()
        threads.shutdown(cancel_futures=True)


# --- a Dask cluster


@contextlib.contextmanager
def connected(cluster):
    """A client of the cluster: one that is given, or one for an address, closed at the end. Its failures in one
    line."""
    try:
        import distributed
    except ImportError:
        raise AtcError("a cluster needs dask and distributed: pip install 'atc[cluster]'") from None
    own, client = not isinstance(cluster, distributed.Client), cluster
    if own:
        try:
            client = distributed.Client(cluster, timeout=PATIENCE, set_as_default=False)
        except (OSError, TimeoutError, ValueError, TypeError) as e:
            raise AtcError(
                f"cluster {cluster}: no Dask scheduler answers there ({' '.join(str(e).split())[:120]}): give its "
                "address, e.g. tcp://127.0.0.1:8786"
            ) from None
    try:
        if not _workers(client):
            address = getattr(client.scheduler, "address", cluster)
            raise AtcError(f"cluster {address}: it has no workers: start some with dask worker")
        with warnings.catch_warnings():
            # Frames travel with their tasks, so that they survive the worker that had them.
            warnings.filterwarnings("ignore", message="Sending large graph")
            yield client
    except distributed.KilledWorker as e:
        raise AtcError(
            f"cluster: workers died again and again over one frame, out of memory? ({' '.join(str(e).split())[:160]})"
        ) from None
    finally:
        if own:
            client.close()


def _workers(client) -> int:
    return sum(client.nthreads().values())


def _many(client) -> int:
    """Tasks to have under way: enough that no worker waits, not so many that frames pile up."""
    return 2 * max(1, _workers(client)) + 1


def _on_cluster(job, settings, frames):
    with connected(job.request.cluster) as client:
        keep = client.submit(_itself, settings, pure=False)
        yield from _with_groups(
            frames, lambda group, k: client.submit(_frame_task, group, keep, k, pure=False), _many(client)
        )


def _with_groups(frames, submit, most: int):
    """(frames, result) of groups that `submit` has computed elsewhere, no more than `most` of them under way."""
    sent: deque = deque()

    def jobs():
        for k, group in frames:
            sent.append(group)
            yield submit(group, k)

    for result in _in_order(jobs(), most):
        yield sent.popleft(), result


def _in_order(jobs, most: int):
    """Results of futures in the order in which they were submitted, no more than `most` of them under way."""
    waiting: deque = deque()
    try:
        for job in jobs:
            waiting.append(job)
            if len(waiting) >= most:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        for job in waiting:
            job.cancel()


def _itself(x):
    return x


def _frame_task(frames, settings, k) -> FrameResult:
    return fields_of(frames, settings, k)
