"""``atc plan``: what a scene would compute, and how."""

from __future__ import annotations

import typer

from .common import Begin, End, Jobs, SceneFile, Set, Step, load_scene


def register(app: typer.Typer) -> None:
    """Add the verb."""
    app.command()(plan)


def plan(
    scene: SceneFile, set: Set = None, begin: Begin = None, end: End = None, step: Step = None, jobs: Jobs = 1
) -> None:
    """What would be computed, by which method and why; predicted time, memory and error."""
    made = load_scene(scene, set, begin, end, step)
    print(made.plan(jobs=jobs))
