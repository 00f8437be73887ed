"""``atc plan``: what a scene would compute, and how."""

from __future__ import annotations

import warnings

import typer

from ..errors import AtcError, AtcWarning
from .common import Begin, By, End, Ends, Jobs, SceneFile, Select, Set, Step, load_scene, select_atoms


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(plan)


def plan(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    select: Select = None,
    by: By = None,
    bonds: Ends = None,
) -> None:
    """What would be computed, by which method and why; predicted time, memory and error."""
    made = select_atoms(load_scene(scene, set, begin, end, step, selects=True), select, by, bonds)
    plan = made.plan(jobs=jobs)
    if made.get("output", "file") is not None:
        try:
            made.output(resume=True)
        except AtcError as e:
            warnings.warn(str(e), AtcWarning, stacklevel=2)
    print(plan)
