"""What the driver is given, beside the frames."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..contracts import Grid, Interactions, Kernel
from ..frame import Frame
from .chosen import Chosen
from .methods import Method
from .work import Work


@dataclass(frozen=True)
class Settings:
    """What a worker needs to know to turn frames into fields; picklable. Deposits that `methods` does not name are
    summed exactly."""

    names: tuple[str, ...]
    pot: Interactions | None = None
    kern: Kernel | None = None
    grid: Grid | None = None
    methods: dict[str, Method] = field(default_factory=dict)
    tolerance: float = 1e-5
    reference: Frame | None = None
    threads: int = 1
    check_points: int = 100
    horizon: float | None = None  # the user's unit of length; None: the potential's
    tiles: tuple[int, int, int] | None = None
    anchor: object = None  # see `atc.neighbors.verlet`
    # Of some atoms (`selections.Selection`), and taken apart (`selections.Parts`): see `chosen`.
    selection: Any = None
    bonds: str = "half"
    parts: Any = None
    part: int | None = None
    #: What thermal motion in temperature and kinetic stress is relative to: "local", the velocity at the point in the
    #: frame, as it is; "frame", the same, and corrected for what that velocity of few atoms takes of their motion;
    #: "none" and "average", the frame of the simulation (the averaged velocity is taken out at the end).
    velocity: str = "local"
    #: of grids that move with the atoms (`moving.Follow`)
    follow: object = None

    @property
    def work(self) -> Work:
        """What is to be summed."""
        return Work.on(self.grid, self.names, self.pot, self.part is not None, self.velocity)

    def chosen(self, frame) -> Chosen | None:
        """Which atoms and bonds of a frame count; None: all."""
        if self.selection is None and self.parts is None:
            return None
        whole = np.ones(len(frame), bool) if self.selection is None else self.selection.of(frame)
        of_part = None if self.parts is None or self.part is None else self.parts.index_of(frame, whole) == self.part
        return Chosen(whole, of_part, self.bonds)

    @cached_property
    def reference_energies_n(self) -> np.ndarray:
        """(n,) potential energies of the atoms in the reference frame."""
        assert self.pot is not None and self.reference is not None, "see `requirements`"
        return self.pot.stream(self.reference, None, threads=self.threads, energies=True, forces=False).energies_n
