"""Fields of a peridynamic run by the estimators that make fields of atoms: the sections ``[kernel]``, ``[grid]`` and
``[fields]`` of a case, as in scenes.

They go into a second output beside the first, ``OUT-fields``, entry by entry, with the same habits.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..config.scene import Scene
from ..errors import AtcError
from ..pd.fields import reference_frame, snapshot
from ..planning.request import Request
from ..running.store import Store

SECTIONS = ("kernel", "grid", "fields")


def scene_of(case):
    """The three sections as a checked `atc.config.scene.Scene`; None if the case has none of them."""
    there = {s: dict(case.data[s]) for s in SECTIONS if s in case.data}
    if not there:
        return None
    if "quantities" not in there.get("fields", {}):
        raise case.need(
            "fields",
            "[fields] needs quantities, what to compute with this kernel and grid, e.g. quantities = "
            '["peridynamic_stress"]',
        )
    # A scene must name a trajectory; here the run is it.
    there["trajectory"] = {"file": "run", "reference": 0}
    scene = Scene(there, case.folder, case.name, case.lines, dict(case.flags))
    scene.check()
    return scene


def fields_path(out) -> Path:
    """Where the fields of a case go: beside its output."""
    out = Path(out)
    return out.with_name(f"{out.stem}-fields{out.suffix}")


class CaseFields:
    """Computes and stores the fields of each entry of a run."""

    def __init__(self, case, out, request: dict, resume: bool, threads: int):

        self.scene = scene_of(case)
        self.scene.data["potential"] = {"lammps": "-"}  # the bonds of the run
        self.scene.require_complete()
        self.case, self.threads = case, threads
        self.path = fields_path(out)
        self.store = Store(self.path, {**request, "of": "fields"}, resume)
        self.sink = None

    def prepare(self, sim, entries: int, done: int) -> None:
        """Be ready for `entries` moments, the first `done` of which are those of an interrupted run."""
        from ..planning.job import cpus, prepare
        from ..running.collecting import Sink

        scene = self.scene
        frame, bonds = snapshot(sim)
        given = {k: scene.get("fields", k) for k in ("quantities", "tolerance", "method", "horizon")}
        given = {k: v for k, v in given.items() if v is not None}
        try:
            if scene.get("grid", "interval") == "frames":
                raise AtcError('interval = "frames": the moments of a case are computed one by one: give a time')
            request = Request(
                [frame] * entries,
                bonds,
                scene.kernel(),
                scene.grid(),
                reference=reference_frame(sim),
                threads=self.threads or cpus(),
                scene=self.case.to_toml(),
                **given,
            )
            from ..estimators.requirements import require

            self.job = prepare(request)
            require(frame, self.job.settings(), self.job.work)
        except AtcError as e:
            raise AtcError(
                str(e) if self.case.name in str(e) else f"{self.case.where('fields')}: [fields] {e}"
            ) from None
        self.sink = Sink(self.job, self.store)
        if self.store.done < done:
            raise AtcError(
                f"{self.path}: {done} entries of the interrupted run are there, but only {self.store.done} of its "
                "fields: begin again with --restart"
            )

    def add(self, sim, entry: int) -> None:
        """The fields of this moment, unless they are there already."""
        from ..estimators.driver import fields_of

        if entry < self.store.done:
            return
        frame, bonds = snapshot(sim)
        settings = replace(self.job.settings(), pot=bonds)
        self.sink.add(entry, frame, fields_of([frame], settings, entry), last_of_window=True)

    def publish(self) -> None:
        from ..estimators.driver import fields_of

        if self.sink.layout is None:  # all entries were there: the run was stopped just before its end
            self.sink.prepare(fields_of([self.job.first], self.job.settings()))
        attributes = self.sink.final_attributes()
        attributes[""]["sources"] = Path(self.case.name).name
        self.store.publish(attributes)
