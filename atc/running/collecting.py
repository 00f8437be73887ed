"""The results of frames, one after the other, to entries of an output: frames, or averages of windows, in memory or in
a store; what there is to note goes along.
"""

from __future__ import annotations

import copy
import json
import time
import warnings
from dataclasses import replace
from typing import Any

import numpy as np

from ..decomposers.base import Worst
from ..errors import AtcError, AtcWarning
from ..estimators.accuracy.random_points import tolerance_kept
from ..estimators.methods import Refinement, details
from ..estimators.registry import QUANTITIES, hidden
from ..estimators.results import FrameResult, count, take_largest
from ..estimators.statistics import BlockAverage
from ..planning.identity import changed_parts, frame_digest
from ..planning.job import Job
from ..readers.times import Sequence
from .as_scene import file_name
from .dataset import asymmetry, follows_cell, grid_moves, in_output_units, moving_coordinates, output_layout
from .store import Store
from .thermal import finish_thermal

# Seconds between two saves of an unfinished time average.
_SAVE_EVERY = 5.0


class Sink:
    """Collects the results of frames into entries (a frame, or the average of a window) in memory or in a store."""

    def __init__(self, job: Job, store: Store | None):
        self.job, self.store = job, store
        self.agreement = ""  # see `first_frames.agreement`
        self.input_error: tuple[float, dict[str, float]] = (0.0, {})  # see `first_frames.input_errors`
        self.layout: Any = None  # from `prepare` on
        self.entries: list[dict] = []
        if store is not None:
            store.keep(self._whole_entries(store.journal), job.entries)
        self.notes: list[dict] = list(store.journal) if store else []
        self.averages: dict[str, BlockAverage] = {}
        self.any_mass: np.ndarray | None = None
        self.any_common: np.ndarray | None = None
        self.any_weight: dict[str, np.ndarray] = {}
        self.factors: dict[str, float] = {}  # to the units of the output, by variable
        self.note: dict = {}
        self._said_refined = False
        self.sequence = Sequence()
        self.next_frame = min(len(self.notes) * job.window, job.n_frames)
        self._saved = time.monotonic()
        if store is not None and job.window > 1:
            self._restore(store.load_state())

    def _whole_entries(self, journal) -> int:
        """How many entries hold as many frames as they shall: the last window of a trajectory that has grown since may
        have been a short one."""
        n, window = self.job.n_frames, self.job.window
        for k, note in enumerate(journal):
            if note.get("frames") != min(window, n - k * window):
                return k
        return len(journal)

    def compare_done(self, count: int) -> None:
        """The frames that are done must be what they were; which is told by their content, so they are read again."""
        digests = [d for note in (*self.notes, self.note) for d in note.get("digests", ())]
        if count == 0 or self.store is None:
            return
        out = self.store.partial
        for k, then in enumerate(digests[:count]):
            try:
                frame = self.job.frames[k]
            except IndexError:
                break
            now = frame_digest(frame)
            if now != then:
                raise AtcError(
                    f"{frame.source}: is not what it was when its fields were computed (different: "
                    f"{changed_parts(then, now)}), and {out} holds an unfinished run with it: "
                    "compute that trajectory under another name, delete the directory, or start again without resuming"
                )

    def copied(self, job: Job) -> Sink:
        """One for `job` that goes on from here, and leaves this one as it is."""
        new = copy.copy(self)
        new.job, new.entries, new.notes = job, list(self.entries), list(self.notes)
        new.averages, new.any_weight = copy.deepcopy(self.averages), dict(self.any_weight)
        new.sequence, new.note = copy.deepcopy(self.sequence), copy.deepcopy(self.note)
        return new

    @property
    def averaging(self) -> bool:
        return self.job.request.average is not False

    def add(self, k: int, frame, result: FrameResult, last_of_window: bool, more=()) -> None:
        """The result of frame `k`, or of it and `more` that follow it."""
        if self.layout is None:
            self.prepare(result)
        for j, one in enumerate((frame, *more), k):
            self._fits(one, result)
            self.sequence.add(j, one)
        self._merge_note(k, frame, result, more)
        if not self.averaging:
            known = {name: w > 0 for name, w in result.weights.items()}
            values = self._masked(result.arrays, result.mask, result.common, known)
            values = {name: x for name, x in values.items() if not hidden(name)}
            self._emit({**values, **self._coordinates(frame, result)}, result.mask)
            return
        for name, x in result.arrays.items():
            # The weight stays in internal units: only ratios of it matter.
            weight = None if QUANTITIES[name].weight is None else result.weights[name]
            if name not in self.averages:
                self.averages[name] = BlockAverage(block=self.job.group(k), threads=self.job.threads)
            self.averages[name].add(x, weight, result.frames, result.within.get(name))
        self.any_mass, self.any_common = _either(self.any_mass, result.mask), _either(self.any_common, result.common)
        for name, w in result.weights.items():
            self.any_weight[name] = (w > 0) | self.any_weight.get(name, False)
        if "frame" not in self.note:
            self.note.update(frame=k, first=_plain_coordinates(self._coordinates(frame, result)))
        if last_of_window:
            self.emit_average()
        elif self.store is not None and time.monotonic() - self._saved > _SAVE_EVERY:
            self._save(self.store, k + result.frames)

    def emit_average(self):
        means, extra = {}, {}
        for name, average in self.averages.items():
            mean, stderr, correlated = average.result()
            means[name], extra[f"{name}_stderr"], extra[f"{name}_correlated"] = mean, stderr, correlated
        finish_thermal(self.job, means, extra)
        masks = self.any_mass, self.any_common, self.any_weight
        values = self._masked(means, *masks)
        for name in means:
            if QUANTITIES[name].masked:
                values[f"{name}_stderr"] = self._masked({name: extra.pop(f"{name}_stderr")}, *masks)[name]
        values.update(extra)
        values["frames_averaged"] = np.array(self.note["frames"])
        values.update({name: np.array(v) for name, v in self.note.pop("first").items()})
        mask = self.any_mass
        self.averages, self.any_mass, self.any_common, self.any_weight = {}, None, None, {}
        self._emit(values, mask)

    def _emit(self, values, mask):
        if mask is not None:
            values["mask"] = mask
        pot, asked = self.job.request.pot, self.job.work.quantities
        if pot is not None and not pot.central:
            self.note["asymmetry"] = {q.name: asymmetry(values[q.name]) for q in asked if q.symmetric_if_central}
        values = {name: x * self.factors[name] if name in self.factors else x for name, x in values.items()}
        note, self.note = self.note, {}
        if self.store is None:
            self.entries.append(values)
        else:
            self.store.write(values, note)
        self.notes.append(note)

    @staticmethod
    def _masked(arrays, mask, common=None, weighted=None):
        """Quotients are NaN where there is no mass (nothing that they could be means of: `weighted`, by name); of
        fields of parts, what is relative to the velocity of all where there is no mass of any (`common`)."""
        out = {}
        for name, x in arrays.items():
            known = common if common is not None and QUANTITIES[name].weight is None else mask
            if known is not None and weighted and name in weighted:
                known = known & weighted[name]
            if known is not None and QUANTITIES[name].masked and not known.all():
                x = x.copy()
                x[~known] = np.nan
            out[name] = x
        return out

    # --- what goes along
    def _merge_note(self, k, frame, result, more=()):
        """Errors are the largest of the frames; the rest is counted."""
        seen = {name: measured for name, measured in result.errors.items() if not hidden(name)}
        take_largest(self.note.setdefault("errors", {}), seen)
        counts, worst = self.note.setdefault("notes", {}), self.note.setdefault("worst", {})
        for what, n in result.notes.items():
            if isinstance(n, Worst):
                worst[what] = float(n + worst.get(what, 0.0))
            else:
                counts[what] = counts.get(what, 0) + n
        for what in result.refined:
            self.note.setdefault("refined", []).extend([j, what.plain()] for j in range(k, k + result.frames))
            if not self._said_refined:
                self._said_refined = True
                text = f"{frame.source}: computed again more closely: {what} (further ones are noted in the output)"
                warnings.warn(text, AtcWarning, stacklevel=2)
        self.note["frames"] = self.note.get("frames", 0) + result.frames
        if self.store is not None:
            self.note.setdefault("digests", []).extend(frame_digest(f) for f in (frame, *more))
        self.note["sources"] = [*self.note.get("sources", []), file_name(frame.source)][:1]

    def _coordinates(self, frame, result):
        u = frame.units
        out = {"cell": u.to_user("length", frame.cell.vectors), "cell_origin": u.to_user("length", frame.cell.origin)}
        out["step"] = np.array(-1 if frame.step is None else frame.step, dtype=np.int64)
        out["time"] = np.array(np.nan if frame.time is None else u.to_user("time", frame.time), dtype=np.float64)
        if self.job.follow is not None:
            out["grid_shift"] = u.to_user("length", result.bound.moved_c)
        if self.moves:
            out.update({name: values for name, (_, values, _) in moving_coordinates(result.bound, u).items()})
        return out

    def prepare(self, result: FrameResult) -> None:
        """Lay the output out: the shapes from any frame's result, the rest from the trajectory's first frame, also when
        a run goes on from a later one."""
        job, first = self.job, self.job.first
        self.moves = grid_moves(job)
        self._cell = first.cell
        if set(job.work.grid_users) - set(job.work.on_reference):
            result = replace(result, bound=job.bound)
        self.layout = output_layout(job, first, result, self.moves)
        if job.request.output_units is not None:
            self.layout, self.factors = in_output_units(self.layout, job.request.output_units)
        self._atoms = first.ids
        if self.store is not None:
            self.store.begin(self.layout)

    def _fits(self, frame, result):
        if not self.moves and self.job.entries > 1 and follows_cell(self.job) and frame.cell != self._cell:
            text = "the cell changes, and the grid with it, but its coordinates in the output are those of the first"
            warnings.warn(f"{frame.source}: {text} frame: see cell and cell_origin", AtcWarning, stacklevel=2)
            self._cell = frame.cell
        for v in self.layout.variables:
            x = result.arrays.get(v.name)
            if x is not None and x.shape != v.shape:
                raise AtcError(
                    f"{frame.source}: {v.name} has shape {x.shape} here but {v.shape} in the first frame: compute "
                    "frames with different numbers of atoms "
                    "one by one"
                )
        if any(q.kind == "atom" for q in self.job.work.quantities) and not np.array_equal(self._atoms, frame.ids):
            raise AtcError(
                f"{frame.source}: its atom ids are not those of the first frame: compute per-atom quantities of such "
                "frames one by one"
            )

    def final_attributes(self) -> dict:
        """Attributes only known at the end, by variable; "" for the dataset."""
        out: dict = {}
        for note in self.notes:
            take_largest(out, note["errors"])
        for at in out.values():
            at["measured_error"] = at.get("error_max", 0.0)
            kept = tolerance_kept(at, self.job.request.tolerance)
            if kept is not None:
                at["tolerance_kept"] = kept
            if at.pop("error_of_terms", 0.0):
                at["error_relative_to"] = "sum of the sizes of the terms: the field is 0 within rounding"
        worst = max((at["measured_error"] for at in out.values()), default=0.0)
        out[""] = {"sources": ", ".join(dict.fromkeys(s for note in self.notes for s in note["sources"]))}
        if self.agreement:
            out[""]["agrees_with_run"] = self.agreement
        step, moved = self.input_error
        if moved:
            for name, error in moved.items():
                if not hidden(name):
                    out.setdefault(name, {})["input_error"] = error
            out[""]["input_error"] = max(moved.values())
            out[""]["input_resolution"] = self.job.first.units.to_user("length", step)
        refined = Refinement.summary([r for note in self.notes for r in note.get("refined", [])])
        if refined:
            out[""]["refinements"] = refined
        if self.job.methods:
            out[""]["method"], out[""]["method_details"] = self.job.method_used, details(self.job.methods)
        counts: dict = {}
        for note in self.notes:
            count(counts, note["notes"])
            for what, value in note.get("worst", {}).items():
                out[""][what] = float(Worst(value) + out[""].get(what, 0.0))
            for name, value in note.get("asymmetry", {}).items():
                at = out.setdefault(name, {})
                at["asymmetry"] = float(Worst(value) + at.get("asymmetry", 0.0))
        if counts:
            out[""]["notes"] = "; ".join(f"{what}: {n}" for what, n in sorted(counts.items()))
        if self.job.work.grid_users:
            out[""]["measured_error"] = worst
            missed = {name: at["tolerance_kept"] for name, at in out.items() if "tolerance_kept" in at}
            if missed:
                # The exact sum itself can only miss it where a field is the small difference of large numbers.
                how = "use method='direct'"
                if all(m.exact or not m.forced for m in self.job.methods.values()):
                    how = "hardly more than the rounding of what they are the difference of"
                which = ", ".join(f"{name} ({kept.partition(': ')[2]})" for name, kept in missed.items())
                text = f"tolerance {self.job.request.tolerance:.1e} not kept for {which}: {how}"
                warnings.warn(f"the measured error {worst:.1e}: {text}", AtcWarning, stacklevel=2)
        return out

    # --- an average that was interrupted
    def save_unfinished(self, after) -> None:
        """Keep what a window has of its frames, when the run is stopped between two of them."""
        if self.store is not None and self.averages and self.job.window > 1:
            self._save(self.store, after)

    def unfinished(self) -> dict:
        """The averages so far, as arrays by names."""
        arrays = {f"{name}/{key}": a for name, average in self.averages.items() for key, a in average.state().items()}
        for key in ("any_mass", "any_common"):
            if getattr(self, key) is not None:
                arrays[key] = getattr(self, key)
        return arrays | {f"any_weight:{name}": known for name, known in self.any_weight.items()}

    def go_on(self, arrays: dict) -> None:
        """Take the averages as `unfinished` gave them."""
        self.any_mass, self.any_common = arrays.pop("any_mass", None), arrays.pop("any_common", None)
        by_name: dict[str, dict] = {}
        for key, a in arrays.items():
            if key.startswith("any_weight:"):
                self.any_weight[key.partition(":")[2]] = a
            else:
                name, _, rest = key.rpartition("/")
                by_name.setdefault(name, {})[rest] = a
        self.averages = {name: BlockAverage.from_state(s, self.job.threads) for name, s in by_name.items()}

    def _save(self, store: Store, after):
        about = {"entry": len(self.notes), "next": after, "note": self.note}
        store.save_state({**self.unfinished(), "about": np.array(json.dumps(about))})
        self._saved = time.monotonic()

    def _restore(self, state):
        if state is None:
            return
        about = json.loads(str(state.pop("about")))
        if about["entry"] != len(self.notes):
            return
        self.next_frame, self.note = about["next"], about["note"]
        self.go_on(state)


def _either(a, b):
    """Where one of two masks is True; None says nothing."""
    return b if a is None else a if b is None else a | b


def _plain_coordinates(coordinates):
    """As JSON can hold them; floats survive JSON exactly."""
    return {name: np.asarray(v).tolist() for name, v in coordinates.items()}
