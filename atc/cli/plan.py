"""``atc plan``: what a scene would compute, and how."""

from __future__ import annotations

import warnings

from ..errors import AtcError, AtcWarning
from .common import Jobs, SceneFile, SelectFlags


def plan(
    scene: SceneFile,
    flags: SelectFlags,
    jobs: Jobs = 1,
) -> None:
    """What would be computed, by which method and why; predicted time, memory and error."""
    made = flags.load(scene)
    plan = made.plan(jobs=jobs)
    if made.get("output", "file") is not None:
        try:
            made.output(resume=True)
        except AtcError as e:
            warnings.warn(str(e), AtcWarning, stacklevel=2)
    print(plan)
