"""Fields while a run goes on: frames come one by one, from wherever, and only their averages are kept.

One accumulator, `Live`, for LAMMPS through its Python library, ASE's dynamics, streams of MDAnalysis (IMDv3) and any
iterable of frames. What it makes of a frame is what `atc.fields` makes of it.
"""

from __future__ import annotations

import copy
import json
import time
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import AtcError, AtcWarning
from ..estimators import groups
from ..estimators.driver import fields_of
from ..estimators.methods import Method
from ..neighbors.verlet import Following
from ..planning.identity import differences, identity
from ..planning.job import Job, prepare
from ..planning.request import Request
from ..planning.sanity import sanity
from ..readers.trajectory import Trajectory
from .collecting import Sink
from .first_frames import fix_methods
from .output import dataset_in_memory
from .whole import replacing

#: Seconds between two saves of what has been averaged.
_SAVE_EVERY = 60.0
#: Of averages of exact sums, errors are looked for at all random points in one group of frames of so many.
CHECK_EVERY = 16
#: What of an identity belongs to the first frame, which is another one in a run that goes on.
_OF_THE_FIRST = ("trajectory", "potential on the first frame", "reference")


class _Arrived(Trajectory):
    """Frames that have come so far; the first two stay, of the others the latest few."""

    def __init__(self, first):
        super().__init__()
        self.units, self.source = first.units, first.source
        self.dimension = 2 if first.units.dimension == 2 else None
        self._held, self._n = {}, 0
        self.push(first)

    def push(self, frame):
        if frame.units.name != self.units.name or frame.units.dimension != self.units.dimension:
            raise AtcError(
                f"{frame.source}: is in {frame.units.name!r} units ({frame.units.dimension}-D), the first frame in "
                f"{self.units.name!r} ({self.units.dimension}-D): they must agree"
            )
        for k in [k for k in self._held if 1 < k]:
            del self._held[k]
        self._held[self._n] = frame
        self._n += 1

    def __len__(self):
        return self._n

    def _frame(self, k):
        if k not in self._held:
            raise IndexError(k)
        return self._held[k]


class _LiveJob(Job):
    """A job whose frames are still to come: `together` of them are added up in `added_up`."""

    def __init__(self, job: Job, together: int, added_up: frozenset):
        self.together, self.added_up = together, added_up
        super().__init__(job.request, job.frames, job.first, job.work, job.model, job.parts, job.follow)

    def group(self, k: int = 0) -> int:
        return self.together


class Live:
    """Averages, or a series, of fields of frames that come one by one.

    Parameters
    ----------
    pot, kern, grid, quantities, tolerance, method, reference, threads, horizon, column_units : as for `atc.fields`;
        `reference` a Frame or something to read one from
    average : True, False or int
        The average over all frames (default), every frame, or averages over so many.
    forces : "warn", "must agree" or "ignore"
        What to do where the first frame's own forces are not the potential's; see `atc.fields`.
    frames : int
        How many frames are to come, about. In averages over 64 and more by the spectral method some (up to 16) are then
        added up before their sums are finished, as `atc.fields` does; that is faster, and keeps so many frames in
        memory.
    masses : as for `atc.read`, for frames that come without
    keep : path
        Where what has been averaged is kept: every minute, by `save` and by `result`. If the file is there already, the
        average goes on from it: the end of a run and its continuation give one average.
    scene : str, the scene as TOML, to be kept with the result

    Attributes
    ----------
    n : frames so far, those of earlier runs counted
    seconds : spent here, so far

    Examples
    --------
    ::

        live = atc.Live(pot, atc.kernel("quartic", 6.0), atc.Grid.slab("z", 50), ["stress", "temperature"])
        live.run(lmp, 100_000, every=100)                     # LAMMPS: run, and take every 100th step
        dyn.attach(live.observer(atoms, dyn), interval=10)    # ASE
        for frame in frames: live.add(frame)                  # anything else
        live.result()                                         # an xarray.Dataset, at any time

    Notes
    -----
    Results agree with those of `atc.fields` on the same frames within both tolerances, of exact sums to rounding. For a
    Lennard-Jones fluid a frame costs about as much as 15 steps of LAMMPS for profiles on slabs, 60 for a grid of 8000
    points (`benchmarks/live.py`): every 150th, every 600th step adds a tenth to the run. One object takes frames from
    one thread.
    """

    def __init__(
        self,
        pot=None,
        kern=None,
        grid=None,
        quantities=("stress",),
        *,
        average=True,
        tolerance=1e-5,
        method="auto",
        reference=None,
        threads=None,
        horizon=None,
        column_units=None,
        forces="warn",
        frames=None,
        masses=None,
        keep=None,
        scene=None,
    ):
        if isinstance(reference, (int, np.integer)):
            raise AtcError(f"reference {reference}: frames that come one by one have no numbers yet: give the frame")
        if frames is not None:
            _require_whole(f"frames {frames!r}", frames, "about how many frames are to come")
        self._request = Request(
            None, pot, kern, grid, quantities, tolerance, method, reference, average, threads, scene=scene,
            horizon=horizon, forces=forces, column_units=column_units,
        )  # fmt: skip
        self._expected, self._masses = frames, masses
        self._keep = None if keep is None else Path(keep)
        self._arrived: Any = None
        self._job: Any = None  # of the first frame alone, until there are two
        self._sink: Any = None
        self._buffer: list[Any] = []
        self._done = 0
        self._before: Any = None
        self._following: Any = None
        self._groups = 0
        self._first_result: Any = None
        self._failed: BaseException | None = None
        self._saved = time.monotonic()
        self._readers: dict = {}
        self.seconds = 0.0
        if self._keep is not None:
            if not self._keep.parent.is_dir():
                raise AtcError(f"{self._keep}: there is no directory {self._keep.parent}: make it, or choose another")
            if self._keep.exists():
                self._before = _load(self._keep)
                self._done = self._before[0]["n"]

    # --- frames in

    @property
    def n(self) -> int:
        """Frames so far."""
        return self._done + len(self._buffer)

    def add(self, frame) -> None:
        """The next frame: `Frame`, ase.Atoms, or a Universe or AtomGroup of MDAnalysis at its present time.

        Raises
        ------
        AtcError : as `atc.fields`; of the first frame before anything is computed
        """
        started = time.perf_counter()
        frame = self._as_frame(frame)
        if self._arrived is None:
            arrived = _Arrived(frame)
            self._job = prepare(self._asked(arrived))
            sanity(self._job)
            self._agreement = self._job.alarm().text
            self._check_kept()
            self._arrived = arrived
            self._following = Following(getattr(self._job.request.pot, "cutoff", 0.0) or 0.0)
        else:
            self._arrived.push(frame)
        # As the potential's script, and the dimension, have it.
        self._buffer.append(self._job.frames[len(self._arrived) - 1])
        if len(self._arrived) >= 2:
            self._ready()
            while len(self._buffer) >= self._due():
                self._flush()
            if self._keep is not None and time.monotonic() - self._saved > _SAVE_EVERY:
                self.save()
        self.seconds += time.perf_counter() - started

    def _asked(self, arrived) -> Request:
        return replace(self._request, traj=arrived)

    def _as_frame(self, x):
        from ..frame import Frame
        from ..readers import read

        if isinstance(x, Frame):
            return x if self._masses is None else read(x, masses=self._masses)[0]
        if hasattr(x, "universe") or (hasattr(x, "trajectory") and hasattr(x, "atoms")):
            from ..readers.mdanalysis import MDAnalysisTrajectory

            if id(x) not in self._readers:  # held with its object, so that the number stays its own
                self._readers[id(x)] = (x, MDAnalysisTrajectory(x, masses=self._masses))
            return self._readers[id(x)][1].current()
        traj = read(x, masses=self._masses)
        if len(traj) != 1:
            raise AtcError(f"{traj.source}: holds {len(traj)} frames: give them one by one, or all to atc.fields")
        return traj[0]

    # --- sums

    @property
    def _window(self) -> int | None:
        """Frames of one entry of the result; None: all."""
        average = self._request.average
        return 1 if average is False else None if average is True else int(average)

    def _ready(self) -> None:
        """With two frames it is known whether the grid moves and what can be added up; methods are chosen."""
        if self._sink is not None:
            return
        job, window = self._job, self._window
        alone = len(self._arrived) < 2
        size = int(window or self._expected or 1)
        job.n_frames = 1 if alone else max(2, size)
        job.__dict__.pop("added_up", None)  # with one frame there was none
        found = job.added_up
        together = groups.size_of(size, len(job.first)) if found and not alone else 1
        live = _LiveJob(job, together, found)
        if together > 1 and all(m.exact for m in live.methods.values()):
            live = _LiveJob(job, 1, found)  # there is no transform that they would share
        live.n_frames = 1 if alone else 2 * (window or 1)
        if self._before is not None:
            about = self._before[0]
            live.together = about["together"]  # blocks stay as long as they are
            live.methods = {key: Method.from_plain(m) for key, m in about["methods"].items()}
        else:
            fix_methods(live, None, 1)
        sink = Sink(live, None)
        sink.agreement = self._agreement
        if self._before is not None:
            self._restore(sink)
        self._job, self._sink = live, sink

    def _due(self) -> int:
        """How many frames are computed together next."""
        window = self._window
        together = self._job.together
        begin = self._done - (self._done % window if window else self._done)
        count = together - (self._done - begin) % together
        return min(count, begin + window - self._done) if window else count

    def _flush(self) -> None:
        count = min(self._due(), len(self._buffer))
        now, self._buffer = self._buffer[:count], self._buffer[count:]
        result = self._computed(now)
        self._done += count
        last = self._window is not None and self._done % self._window == 0
        self._sink.add(self._done - count, now[0], result, last_of_window=last, more=now[1:])

    def _computed(self, frames):
        anchor = None
        if len(frames) == 1 and self._job.work.bond_users:
            anchor = self._following.at(frames[0])
        settings = self._job.settings(anchor)
        # What an exact sum is compared with is the same sum: now and then is enough.
        exact = self._job.together == 1 and all(m.exact for m in self._job.methods.values())
        if exact and self._window != 1 and self._groups % CHECK_EVERY:
            slab = getattr(self._job.request.grid, "kind", "") == "slab"
            settings = replace(settings, check_points=0 if slab else 1)
        self._groups += 1
        result = fields_of(frames, settings, self._done)
        if self._first_result is None:
            self._first_result = result
        return result

    # --- fields out

    def result(self):
        """The fields of all frames so far, as `atc.fields` gives them (xarray.Dataset); more may follow.

        Raises
        ------
        AtcError : without a frame
        """
        if self._failed is not None:
            failed, self._failed = self._failed, None
            raise failed
        if self._arrived is None:
            if self._before is not None:
                raise AtcError(f"{self._keep}: add one frame of the run that goes on first: it says where the grid is")
            raise AtcError("there is no frame yet: add some")
        if self._keep is not None and len(self._arrived) >= 2:
            self.save()
        out = copy.copy(self)  # what is not full yet is finished in a copy
        if out._sink is None:
            out._job = copy.copy(self._job)
            out._ready()
        out._job = job = copy.copy(out._job)
        out._sink = sink = out._sink.copied(job)
        out._buffer, out._following = list(self._buffer), copy.copy(self._following)
        while out._buffer:
            out._flush()
        if sink.note and sink.averaging:  # a window that is not full
            sink.emit_average()
        job.n_frames = out._done
        sink.prepare(out._first_result or fields_of([job.first], job.settings(), 0))
        for sentence in sink.sequence.warnings(sink.averaging):
            warnings.warn(f"{self._arrived.source}: {sentence}", AtcWarning, stacklevel=2)
        return dataset_in_memory(sink.layout, sink.entries, sink.final_attributes())

    # --- kept

    def _identity(self, job) -> dict:
        found = {k: v for k, v in identity(job).items() if k not in (*_OF_THE_FIRST, "group")}
        return json.loads(json.dumps(found, default=str)) | {"atoms": len(job.first)}

    def _check_kept(self) -> None:
        if self._before is None:
            return
        other = differences(self._before[0]["identity"], self._identity(self._job))
        if other:
            raise AtcError(
                f"{self._keep}: was averaged with something else ({other}): give another name, or delete it to begin "
                "again"
            )

    def save(self, path=None) -> None:
        """Keep what has been averaged in a file (`keep`), from which another `Live` can go on."""
        path = self._keep if path is None else Path(path)
        if path is None:
            raise AtcError("save: give the file to write, or keep= when the average begins")
        if self._arrived is None:
            return
        self._ready()
        while self._buffer:
            self._flush()
        sink = self._sink
        arrays: dict[str, Any] = sink.unfinished()
        for k, entry in enumerate(sink.entries):
            arrays |= {f"entry {k}/{name}": np.asarray(a) for name, a in entry.items()}
        about = {
            "n": self._done, "note": sink.note, "notes": sink.notes, "together": self._job.together,
            "methods": {key: m.plain() for key, m in self._job.methods.items()}, "identity": self._identity(self._job),
        }  # fmt: skip
        arrays["about"] = np.array(json.dumps(about))
        with replacing(path) as part, open(part, "wb") as f:
            np.savez(f, **arrays)
        self._saved = time.monotonic()

    def _restore(self, sink) -> None:
        about, arrays = self._before
        sink.note, sink.notes = about["note"], about["notes"]
        arrays = dict(arrays)
        sink.entries = []
        while own := [key for key in arrays if key.startswith(f"entry {len(sink.entries)}/")]:
            sink.entries.append({key.partition("/")[2]: arrays.pop(key) for key in own})
        sink.go_on(arrays)

    # --- where frames come from

    def run(self, lmp, steps: int, every: int = 100, frames: int | None = None) -> None:
        """Run LAMMPS and add the state after every so many steps: exactly what ``dump custom`` would write there.

        Parameters
        ----------
        lmp : a serial ``lammps.lammps`` object that is set up to run
        steps : how many; those beyond the last multiple of `every` are run too
        every : steps between two frames

        Notes
        -----
        LAMMPS runs ``every`` steps at a time (``run ... pre no post no``, with start and stop of the whole), which does
        not change its trajectory; its thermo output comes in pieces.
        """
        from ..readers.lammps.live import LammpsState

        _require_whole(f"steps {steps!r}", steps, "a whole number of steps")
        _require_whole(f"every {every!r}", every, "a whole number of steps")
        if self._expected is None and self._arrived is None and self._window is None:
            self._expected = max(1, steps // every)
        state = LammpsState(lmp)
        begin = int(lmp.extract_global("ntimestep"))
        whole = f"start {begin} stop {begin + steps}"
        for k, at in enumerate(range(0, steps, every)):
            length = min(every, steps - at)
            last = at + length >= steps
            lmp.command(f"run {length} {whole} pre {'yes' if k == 0 else 'no'} post {'yes' if last else 'no'}")
            if length == every:
                self.add(state.frame())

    def attach(self, lmp, every: int = 100, fix: str = "atc") -> None:
        """Add frames while LAMMPS runs, by whatever ``run`` commands: a ``fix external`` whose callback comes every so
        many steps, and applies no force.

        Parameters
        ----------
        lmp : a serial ``lammps.lammps`` object with atoms
        every : steps between two frames
        fix : name of the fix; ``lmp.command("unfix atc")`` ends it

        Notes
        -----
        The callback comes when the step's forces are there and its velocities are half a step behind; they are
        completed by v + Δt f/2m. With fix nve (and langevin before this fix) they are those of the step; thermostats
        that rescale velocities at the end of a step (nvt, npt) would change them once more, by (their rate) Δt/4: `run`
        has them exactly. What goes wrong within is raised by `result`.
        """
        from ..readers.lammps.live import LammpsState

        _require_whole(f"every {every!r}", every, "a whole number of steps")
        state = LammpsState(lmp)
        lmp.command(f"fix {fix} all external pf/callback {every} 1")
        last = [int(lmp.extract_global("ntimestep"))]

        def callback(caller, step, nlocal, tag, x, force):
            force[:] = 0.0
            # At the start of a run forces are computed too, of a step that was there, and whose velocities are whole.
            if step == last[0]:
                return
            last[0] = step
            if self._failed is None:
                try:
                    self.add(state.frame(kick=True))
                except BaseException as e:  # it would be lost within LAMMPS
                    self._failed = e
                    lmp.force_timeout()

        lmp.set_fix_external_callback(fix, callback, None)

    def observer(self, atoms, dyn=None):
        """A function for ``dyn.attach(live.observer(atoms), interval=n)`` of ASE: adds the atoms as they are.

        dyn : the dynamics, for steps and times
        """
        from ..units import units

        def observe():
            frame = self._as_frame(atoms)
            if dyn is not None:
                u = units("ase")
                frame = frame.replace(step=int(dyn.nsteps), source=f"ASE step {int(dyn.nsteps)}")
                if hasattr(dyn, "get_time"):
                    frame = frame.replace(time=u.to_internal("time", float(dyn.get_time())))
            self.add(frame)

        return observe


def _require_whole(said: str, value, expected: str) -> None:
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < 1:
        raise AtcError(f"{said}: expected {expected}, 1 or more")


def _load(path):
    """(about, arrays) of a file that `Live.save` wrote."""
    try:
        with np.load(path, allow_pickle=False) as f:
            arrays = {k: f[k] for k in f.files}
        about = json.loads(str(arrays.pop("about")))
        if not {"n", "note", "notes", "together", "methods", "identity"} <= set(about):
            raise KeyError
    except Exception:  # each layer of the format has its own words for damage
        raise AtcError(f"{path}: is no average that atc.Live kept, or a damaged one: give another name") from None
    return about, arrays
