"""Constraints that the file of a topology says (GROMACS's .tpr), taken where nothing else says any."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np

from ...errors import AtcError
from ...frame import Frame, Held
from ...readers.trajectory import warn
from ..numbering import pair_codes
from .held import Constraints
from .rules import Rule


@dataclass(frozen=True, eq=False)
class TopologyConstraints(Rule):
    """The distances that a file says are held. Held bonds and angles have no terms of their own, as in GROMACS."""

    pairs_c2: np.ndarray = field(default_factory=lambda: np.zeros((0, 2), np.int64))
    where: str = ""
    #: GROMACS's forces are those before the constraints
    contained = False

    def describe(self) -> str:
        return f"{len(self.pairs_c2)} distances held by the run input"

    def pairs(self, frame: Frame) -> np.ndarray:
        if len(self.pairs_c2) and self.pairs_c2.max() >= len(frame):
            raise AtcError(
                f"{frame.source}: has {len(frame)} atoms, and {self.where} holds atom {int(self.pairs_c2.max()) + 1}: "
                "all atoms are needed"
            )
        return self.pairs_c2


def held_by_topology(pot, frame: Frame):
    """A potential with the constraints that a frame's topology says, where nothing else says any.

    What a script, a scene or a System says wins, and an AtcWarning says where it differs. `Constraints` without rules
    are what those of the file are found from. Raises AtcError where these are asked for and cannot be read.
    """
    held, mine = frame.held, pot.constraints
    if pot.unheld or (mine is not None and any(isinstance(r, TopologyConstraints) for r in mine.rules)):
        return pot
    if held is not None and held.unknown:
        if mine is None:
            warn(held.unknown)
        elif not mine.rules:
            raise AtcError(held.unknown)
        return pot
    if mine is not None and mine.rules:
        if held is None:
            return pot
        missing, more = _differing(mine, held, pot.complete(frame))
        if not mine.assumed or more:
            if missing or more:
                warn(
                    f"{held.source}: the run holds {len(held.pairs_c2)} distances, of which {missing} are not held by "
                    f"{mine.where} ({', '.join(r.describe() for r in mine.rules)}), which holds {more} others: taken "
                    f"is what {mine.where} says"
                )
            return pot
    if held is None or not len(held.pairs_c2):
        return pot if mine is None or mine.rules else pot.constrained(None)
    base = Constraints(()) if mine is None else mine
    return pot.constrained(base.but(rules=(_rule(held),), assumed=False))


def _rule(held: Held) -> TopologyConstraints:
    return TopologyConstraints(held.pairs_c2, held.source)


def _differing(mine, held, frame) -> tuple[int, int]:
    """How many distances of the file are not held by some constraints, and how many of theirs are not in the file
    (those of rigid bodies not counted)."""
    n = len(frame)
    own, pairs = pair_codes(mine.pairs(frame), n), held.pairs_c2
    more = int((~np.isin(own, pair_codes(pairs, n))).sum())
    for rule in mine.rules:
        if rule.bodies:
            label = rule.labels(frame)[pairs]
            pairs = pairs[(label[:, 0] < 0) | (label[:, 0] != label[:, 1])]
    return int((~np.isin(np.unique(pair_codes(pairs, n)), own)).sum()), more


@lru_cache(maxsize=2)
def _constraints(held: Held) -> Constraints:
    return Constraints((_rule(held),))


def said_of_degrees(pot, frame: Frame) -> dict:
    """For an output of temperatures without forces: which constraints of a topology take degrees of freedom."""
    if pot is None:
        if frame.held is None or degrees_of_topology(frame) is None:
            return {}
        said = _constraints(frame.held)
    else:
        said = pot.constraints
    if said is None or not any(isinstance(r, TopologyConstraints) for r in said.rules):
        return {}
    return {"constraints": ", ".join(f"{r.describe()} ({r.where})" for r in said.rules)}


def degrees_of_topology(frame: Frame) -> np.ndarray | None:
    """(n,) degrees of freedom of atoms where no potential says any constraints; None: those of free atoms."""
    held = frame.held
    if held is None or not len(held.pairs_c2) or frame.masses is None:
        return None
    return _constraints(held).degrees(frame)
