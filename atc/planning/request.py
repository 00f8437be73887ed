"""What is asked for: one call of `atc.fields` as plain checked data. Nothing is read or computed here."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..contracts import Grid, Interactions, Kernel
from ..errors import AtcError

#: What thermal motion in temperature and kinetic stress is relative to: the velocity at the point in each frame,
#: corrected for the few atoms it is of; the same as it is; its time average; nothing.
VELOCITIES = ("frame", "local", "average", "none")


@dataclass(frozen=True)
class Request:
    """One call of `atc.fields`; see there for the parameters.

    Raises
    ------
    AtcError
        for a value that cannot be meant, whatever the trajectory is.
    """

    traj: Any
    pot: Interactions | None = None
    kern: Kernel | None = None
    grid: Grid | None = None
    quantities: Any = ("stress",)
    tolerance: float = 1e-5
    method: str = "auto"
    reference: Any = None
    average: bool | int = False
    threads: int | None = None
    workers: int = 1
    scene: str | None = None
    horizon: float | None = None
    cluster: Any = None
    tiles: Any = None
    forces: str = "warn"
    log: Any = None
    column_units: dict | None = None
    select: Any = None
    by: Any = None
    bonds: str = "half"
    velocity: Any = None  # None: by what is there, see `job`
    output_units: object = None

    def __post_init__(self):
        from ..agreement.forces import MODES
        from ..estimators.selections import BONDS, BY, selection
        from ..units.words import wanted_units
        from .method_choice import require_known

        for name, value, method, hint in (
            ("pot", self.pot, "check_topology", "atc.potential('pair_style ...')"),
            ("kern", self.kern, "scaled", "atc.kernel('quartic', radius=8.0)"),
            ("grid", self.grid, "bind", "atc.Grid.regular(spacing=2.0)"),
        ):
            if value is not None and not hasattr(value, method):
                raise AtcError(f"{name} is a {type(value).__name__}: expected what {hint} gives")
        if not (isinstance(self.tolerance, (int, float)) and 0 < self.tolerance < 1):
            raise AtcError(
                f"tolerance {self.tolerance!r}: expected a number between 0 and 1, relative to the largest value of "
                "the field, e.g. 1e-5"
            )
        if self.forces not in MODES:
            raise AtcError(f"forces {self.forces!r}: expected one of {', '.join(map(repr, MODES))}")
        window = isinstance(self.average, (int, np.integer)) and self.average >= 1
        if not (isinstance(self.average, bool) or window):
            raise AtcError(f"average {self.average!r}: expected True, False, or the number of frames in a window")
        for name in ("threads", "workers"):
            value = getattr(self, name)
            if value is None and name == "threads":
                continue
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
                raise AtcError(f"{name} {value!r}: expected a whole number, 1 or more")
        for name, word, known in (
            ("by", self.by, (None, *BY)),
            ("bonds", self.bonds, BONDS),
            ("velocity", self.velocity, (None, *VELOCITIES)),
        ):
            if word not in known:
                raise AtcError(f"{name} {word!r}: expected one of {', '.join(repr(k) for k in known if k)}")
        if self.velocity == "average" and self.average is False:
            raise AtcError('velocity "average" is the one of a time average: give average=True, or a window')
        if self.bonds != "half" and self.select is None:
            raise AtcError(f"bonds {self.bonds!r} goes with select: whose ends they are told by")
        selection(self.select)
        if self.output_units is not None:
            wanted_units(self.output_units)
        require_known(self.method)
