"""Where the sums of a frame are wanted, and how they are taken there.

Every pass serves two sets of points at once, the grid and the points of the error check; what it gives comes in pairs,
(on the grid, at the points of the check).
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cached_property

from ..frame import Cell
from .accuracy.random_points import Check, checking_kernel
from .deposits import Deposits


@dataclass(frozen=True)
class Place:
    """Where sums are wanted, and how they are taken: a grid, and the points of the error check in it; picklable.

    bound : BoundGrid. cell : Cell of the atoms
    kern, check_kern : kernel in internal units (None where nothing needs one), and the one that errors are measured
        with
    methods : of each deposit on the grid
    index : number of the frame, which random points depend on
    """

    bound: object
    cell: Cell
    kern: object
    check_kern: object
    methods: dict
    threads: int
    index: int
    check_points: int

    @classmethod
    def on(
        cls, bound, cell, kern, methods, tolerance: float, threads: int, index: int, check_points: int, again: bool
    ) -> Place:
        """A grid, and a check that is as close as the tolerance asks. `again`: the methods follow others that left too
        large an error, part of which may have been the check's own."""
        cut = not again and bound.kind != "slab" and kern is not None
        check_kern = checking_kernel(kern, methods, tolerance) if cut else kern
        return cls(bound, cell, kern, check_kern, methods, threads, index, check_points)

    @cached_property
    def grid(self) -> Deposits:
        """The deposits on the grid."""
        return Deposits(self.methods, self.bound, self.kern, self.cell, self.threads)

    @cached_property
    def check(self) -> Check:
        return self.checked_at(None)

    def checked_at(self, which) -> Check:
        """The check at some points of the grid; None: at random ones."""
        count, kern = self.check_points, self.check_kern
        return Check(self.bound, self.kern, self.cell, self.threads, self.index, count, which, kern)

    @property
    def both(self) -> tuple:
        """The deposits on the grid and at the points of the check."""
        return self.grid, self.check.deposits

    def __getstate__(self):
        return {f.name: getattr(self, f.name) for f in fields(self)}
