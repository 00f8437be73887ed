"""The steps and times of successive frames: what a time series may rest on.

A correlation function, a spectrum and a difference in time need frames at equal distances. Files of a run that was
continued, joined or appended, frames that were lost, and a time step that was changed on the way break that without any
other sign. Times decide where frames have them (a step may be reset while time goes on), steps otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError

#: Distances in time that differ by more than this part are not equal; dumps print the time with at least six digits.
UNEVEN = 1e-4


@dataclass
class _Seen:
    number: int
    step: int | None
    time: float | None
    frame: object


@dataclass
class Clock:
    """Follows frames one after another and finds out whether they are equally spaced.

    Parameters
    ----------
    what : what needs equal distances, for messages ("a correlation function")
    gaps : whether a gap is an AtcError at once; otherwise `gap` says what is wrong, and only steps that repeat or go
        back are errors

    Attributes
    ----------
    notes : what was left out or could not be checked
    gap : "" or why distances are not equal
    """

    what: str
    gaps: bool = True
    notes: list[str] = field(default_factory=list)
    gap: str = ""
    count: int = 0
    again: int = 0
    _first: _Seen | None = None
    _last: _Seen | None = None
    _distance: float | None = None
    _steps: int | None = None
    _timed: bool = True
    _stepped: bool = True
    _kind: str = ""

    def follows(self, frame) -> bool:
        """Take note of the next frame. False where it is the one before once more, as a continued run writes it: it
        should be left out.

        Raises AtcError for steps (without times) or times that repeat or go back, and for gaps where these matter.
        """
        seen = _Seen(self.count + self.again, frame.step, frame.time, frame)
        last = self._last
        if last is None:
            self._timed, self._stepped = frame.time is not None, frame.step is not None
            self._first, self._last, self.count = seen, seen, 1
            return True
        if same_moment(last.frame, frame):
            self.again += 1
            self.notes.append(
                f"{_called(seen)} is {_called(last)} once more (a run that was continued writes the step it starts "
                "from again): it is left out"
            )
            return False
        self._timed &= seen.time is not None
        self._stepped &= seen.step is not None
        if self._timed:
            self._compare(seen, last, seen.time - last.time, "times")
        elif self._stepped:
            self._compare(seen, last, float(seen.step - last.step), "steps")
        last.frame = None  # only the last one is kept
        self._last, self.count = seen, self.count + 1
        return True

    def _compare(self, seen, last, distance, kind) -> None:
        u = seen.frame.units
        slack = 0.0
        if kind == "times":  # which some formats keep as float32
            slack = 4.0 * float(np.spacing(np.float32(max(abs(seen.time), abs(last.time)))))
        if not distance > 0:
            back = "repeats" if distance == 0 else "goes back"
            which = "step" if kind == "steps" else "time"
            raise AtcError(
                f"{seen.frame.source}: the {which} {back}: {_called(seen)} comes after {_called(last)}, but "
                f"{self.what} needs frames in the order of time: files of a continued run are joined or appended; take "
                "one part (frames in [trajectory], -b, -e), or leave out what is there twice"
            )
        if self._distance is None or kind != self._kind:
            self._distance, self._kind = distance, kind
            self._steps = None if seen.step is None or last.step is None else seen.step - last.step
            return
        if self.gap or abs(distance - self._distance) <= UNEVEN * self._distance + min(slack, 0.2 * self._distance):
            return
        if kind == "times":
            here, there = (f"{u.to_user('time', d):.6g} {u.label('time')}" for d in (distance, self._distance))
        else:
            here, there = f"{distance:.0f} steps", f"{self._distance:.0f}"
        text = f"{_called(seen)} comes {here} after {_called(last)}, those before are {there} apart"
        steps = None if seen.step is None or last.step is None else seen.step - last.step
        if kind == "times" and self._steps and steps == self._steps:
            a, b = (u.to_user("time", d / self._steps) for d in (self._distance, distance))
            text = f"the time step changes from {a:.6g} to {b:.6g} {u.label('time')} at {_called(last)}"
        self.gap = text
        if self.gaps:
            raise AtcError(
                f"{seen.frame.source}: {text}: {self.what} needs equal distances: take a part without gaps (frames in "
                "[trajectory], -b, -e, --step)"
            )

    def spacing(self, timestep: float | None = None) -> float | None:
        """Time between frames (internal): from their times, or their steps and `timestep` (internal); None where
        neither is known."""
        if self.count < 2:
            return None
        if self._timed:
            return (self._last.time - self._first.time) / (self.count - 1)
        if self._stepped and timestep is not None:
            return (self._last.step - self._first.step) * timestep / (self.count - 1)
        return None

    @property
    def checked(self) -> bool:
        """Whether times or steps could be looked at."""
        return self._timed or self._stepped


def _called(seen: _Seen) -> str:
    if seen.step is not None:
        return f"frame {seen.number} (step {seen.step})"
    if seen.time is not None and seen.frame is not None:
        u = seen.frame.units
        return f"frame {seen.number} (time {u.to_user('time', seen.time):.6g} {u.label('time')})"
    return f"frame {seen.number}"


def same_moment(a, b) -> bool:
    """Whether two frames are one moment written twice: the same step and time, atoms at the same places (through
    periodic faces) with the same velocities."""
    if a is None or (a.step is None and a.time is None) or a.step != b.step:
        return False
    if len(a) != len(b) or not np.array_equal(a.ids, b.ids):
        return False
    if a.step is None and (b.time is None or a.time != b.time):
        return False
    if not len(a):
        return True
    d = b.positions - a.positions
    d = d - np.where(a.cell.periodic, np.rint(d @ a.cell.inverse), 0.0) @ a.cell.vectors
    if np.abs(d).max() > 1e-6 * np.abs(a.cell.vectors).max():
        return False
    if a.velocities is None or b.velocities is None:
        return True
    return bool(np.abs(a.velocities - b.velocities).max() <= 1e-5 * np.abs(a.velocities).max())


class Sequence:
    """Steps of the frames of a run as they pass, for what does not need equal distances: which repeat or go back, and
    whether distances change."""

    def __init__(self):
        self.last = None
        self.back: list[str] = []
        self.uneven = ""
        self._distance = None

    def add(self, k: int, frame) -> None:
        here = (k, frame.step, frame.time)
        if self.last is not None:
            j, step, time = self.last
            steps = None if frame.step is None or step is None else float(frame.step - step)
            times = None if frame.time is None or time is None else frame.time - time
            if steps is not None and steps <= 0 and not (times is not None and times > 0):
                self.back.append(f"{k} (step {frame.step}) after {j} (step {step})")
            else:
                d = steps if times is None else times
                if d is not None:
                    if self._distance is None:
                        self._distance = d
                    elif not self.uneven and abs(d - self._distance) > 1e-3 * abs(self._distance):
                        self.uneven = (
                            f"frame {k} comes {d / self._distance:.3g} times as long after frame {j} as the first two "
                            "are apart"
                        )
        self.last = here

    def warnings(self, averaging: bool) -> list[str]:
        out = []
        if self.back:
            shown = ", ".join(self.back[:5]) + (f" and {len(self.back) - 5} more" if len(self.back) > 5 else "")
            out.append(
                f"steps repeat or go back: frame {shown}: duplicates of a restart, or joined files"
                + ("; they count twice in the average" if averaging else "")
            )
        if averaging and self.uneven:
            out.append(
                f"frames are not equally spaced ({self.uneven}): the average gives each the same weight, and its "
                "standard error takes them for a series"
            )
        return out
