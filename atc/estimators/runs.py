"""Consecutive frames with one cell: what is asked of them, and the sums that they give."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..decomposers.constraints.virtual_sites import atoms_of
from .accuracy.random_points import kernel_internal
from .accuracy.strongest_bonds import StrongestOfFrames
from .bond_pass import BondPass, BondTask
from .chosen import chosen_of
from .field_pass import FieldPass
from .groups import MeanFields, added_up, elements, formed_once
from .peridynamic import horizon_of
from .place import Place
from .quantities.quantity import Quantity
from .settings import Settings
from .sources import AtomFactors, drift_velocity
from .sums import Sums
from .work import Work


@dataclass(frozen=True)
class Run:
    """Consecutive frames with one cell, and what is asked of them.

    bound, reference_bound : the grid on them, and on the reference; None where nothing asked is there
    horizon : of the quantities that need one
    drifts : (3,) mean velocity of each frame
    chosen : of each frame which atoms and bonds count (`chosen.Chosen`), or None
    together : the deposits ("site") whose sums of several frames are added up; sums over bonds always are
    once, each : the quantities formed from the mean sums, and those formed of each frame, of which the mean is taken;
        wholes may be in neither
    """

    frames: list
    settings: Settings
    work: Work
    index: int
    goal: float
    run_tiles: object
    kern: object
    bound: object
    reference_bound: object
    horizon: float | None
    drifts: list
    chosen: list
    together: frozenset
    once: list[Quantity]
    each: list[Quantity]

    @classmethod
    def of(cls, frames, settings: Settings, work: Work, index: int = 0, goal: float = np.inf, run_tiles=None) -> Run:
        first, reference = frames[0], settings.reference
        chosen = [chosen_of(f, settings.selection, settings.bonds, settings.parts, settings.part) for f in frames]
        here, there = set(work.grid_users) - set(work.on_reference), work.on_reference
        if len(frames) == 1:
            once, each, together = work.quantities, [], frozenset()
        else:
            once, together = formed_once(work), added_up(work)
            each = [q for q in elements(work) if q not in once]
        return cls(
            frames, settings, work, index, goal, run_tiles,
            kern=kernel_internal(settings.kern, first.units) if work.kernel_users else None,
            bound=_bound(settings.grid, first, settings.follow, chosen[0]) if here else None,
            reference_bound=_bound(settings.grid, reference) if there else None,
            horizon=horizon_of(settings.horizon, settings.pot, settings.grid, first.units, work.horizon_users)
            if work.horizon_users
            else None,
            drifts=[
                drift_velocity(f, None if c is None else c.chosen_n) if "velocities" in work.attributes else np.zeros(3)
                for f, c in zip(frames, chosen)
            ],
            chosen=chosen,
            together=together, once=once, each=each,
        )  # fmt: skip

    @property
    def several(self) -> bool:
        return len(self.frames) > 1

    def places(self, methods, again: bool) -> tuple[Place | None, Place | None]:
        """Where sums are wanted: now, and over reference positions."""
        s = self.settings
        on = ((self.bound, self.frames[0]), (self.reference_bound, s.reference))
        return tuple(
            None
            if bound is None
            else Place.on(bound, at.cell, self.kern, methods, s.tolerance, s.threads, self.index, s.check_points, again)
            for bound, at in on
        )

    def task(self, k: int, pot, here: Place | None, reference: Place | None) -> BondTask:
        """What is wanted of the bonds of frame `k`."""
        return BondTask(pot, self.work, here, reference, self.settings.threads, self.drifts[k], self.horizon)

    def factors(self, k: int, per_atom, drift=None) -> AtomFactors:
        """The columns of the sums over atoms of frame `k`, velocities relative to its own drift if there is no
        other."""
        drift = self.drifts[k] if drift is None else drift
        return AtomFactors(self.frames[k], drift, per_atom, self.settings.pot, self.chosen[k])

    def no_sums(self, k: int) -> Sums:
        frame = self.frames[k]
        return Sums(
            drift=self.drifts[k],
            volume=frame.cell.volume,
            boltzmann=frame.units.boltzmann,
            dimension=frame.dimension,
            velocities=self.settings.velocity,
        )


def _bound(grid, frame, follow=None, chosen=None):
    """The grid on a frame, where it has moved to."""
    frame = atoms_of(frame)
    bound = grid.bind(frame.units, frame.cell, frame.positions)
    return bound if follow is None else bound.moved(follow.shift(frame, None if chosen is None else chosen.chosen_n))


@dataclass(frozen=True)
class RunBonds:
    """What the bonds of a run give.

    each : of each frame. grid : mean sums on the grid, by name
    strongest : the strongest bonds, if they were looked for; strong_g : (g,) the largest component of what was summed
        exactly of them
    left : what rounding may have left of them, in the units of the sums
    fields : what has no bonds, already added to the sums; or None
    """

    each: tuple[BondPass, ...]
    grid: dict = field(default_factory=dict)
    strongest: StrongestOfFrames | None = None
    strong_g: np.ndarray | None = None
    left: float = 0.0
    fields: FieldPass | None = None


@dataclass(frozen=True)
class RunSums:
    """All sums of a run.

    grid, check : of its only frame, on the grid and at the points of the check; of several, the mean sums on the grid,
        and None
    exactly : fields at the points of the check; fields, boxes : means of what is formed frame by frame
    """

    here: Place | None
    reference: Place | None
    bonds: RunBonds
    grid: Sums
    check: Sums | None
    exactly: MeanFields
    fields: MeanFields
    boxes: MeanFields
    mask: np.ndarray | None
    anywhere: np.ndarray | None
    thin: set
    seconds: dict[str, float]
