"""Which run of a script the frames belong to, and what its fixes mean for them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...errors import AtcError
from .atoms import touches
from .fixes import REACH, classify
from .interpreter import Interpreter, State
from .script import Command


@dataclass(frozen=True)
class Choice:
    """state : what holds. late : commands of later runs that may change atoms. fixes : those of every run meant; before : of the runs up to it."""

    state: State
    late: tuple[Command, ...]
    fixes: tuple[Command, ...]
    before: tuple[Command, ...]


def choose_run(script: Interpreter, run: int | None, name: str, trajectory=()) -> Choice:
    """The run that `run` names, counted from 1; without it all runs, which must then have the same model.

    Where they have not, and all frames were written by ``dump`` lines that hold for runs of one model, it is these.
    """
    states = script.runs or [script.state]
    if run is not None:
        if isinstance(run, bool) or not isinstance(run, int) or not 1 <= run <= len(states):
            have = f"{len(script.runs)} run{'s' * (len(script.runs) != 1)}" if script.runs else "no run"
            raise AtcError(f"{name}: run = {run}: the script has {have}: expected a number from 1 to {len(states)}")
        return _choice(states, [run - 1])
    numbers = list(range(len(states)))
    if any(not s.same_model(states[0]) for s in states[1:]):
        numbers = _dumped(script, trajectory, len(states)) or numbers
    first = states[numbers[0]]
    for k in numbers[1:]:
        if not states[k].same_model(first):
            c = _difference(first, states[k])
            raise AtcError(
                f"{c.where}: {c.name} {' '.join(c.words[:3])} holds in run {k + 1} ({states[k].where}), not in run {numbers[0] + 1} ({first.where}): "
                f"say which run the frames belong to, e.g. run = {k + 1} in [potential]"
            )
    return _choice(states, numbers)


def _difference(a: State, b: State) -> Command:
    """A command of b that a has not, or the other way round."""
    said = {(c.name, c.words) for c in a.model}
    other = {(c.name, c.words) for c in b.model}
    return next((c for c in b.model if (c.name, c.words) not in said), None) or next(
        (c for c in a.model if (c.name, c.words) not in other), b.model[-1] if b.model else a.model[-1]
    )


def _choice(states, numbers) -> Choice:
    first = states[numbers[0]]
    late: dict = {}
    for k in numbers[1:]:
        if states[k].atoms is first.atoms:
            continue
        for c in _beyond(first.atoms, states[k].atoms):
            late[c.name, c.words, c.where] = c
    fixes = {c: None for k in dict.fromkeys(numbers) for c in states[k].fixes}
    before = {c: None for s in _distinct(states[: numbers[-1] + 1]) for c in s.fixes}
    return Choice(first, tuple(late.values()), tuple(fixes), tuple(before))


def _distinct(states):
    seen = set()
    for s in states:
        if id(s.fixes) not in seen:
            seen.add(id(s.fixes))
            yield s


def _beyond(first, other):
    """The commands of `other` that come on top of those of `first`, as far as they change atoms."""
    a, b = ([c for c in commands if c.name != "run"] for commands in (first, other))
    if [(c.name, c.words) for c in b[: len(a)]] == [(c.name, c.words) for c in a]:
        b = b[len(a) :]
    return [c for c in b if c.unknown or touches(c)]


def _dumped(script, trajectory, n) -> list[int]:
    """The runs in which the files of a trajectory are written; none if the script's dump lines do not say it of all of them."""
    out: set[int] = set()
    for file in trajectory:
        found = [
            range(first, n if last is None else min(last, n))
            for pattern, first, last in script.written
            if re.fullmatch("[0-9]*".join(map(re.escape, Path(pattern).name.split("*"))), Path(file).name)
        ]
        if len(found) != 1:
            return []
        out.update(found[0])
    return sorted(out)


def sort_fixes(choice: Choice) -> tuple[tuple[str, ...], dict]:
    """The forces from outside, one text for each fix, and what fixes change while LAMMPS runs, {property: reason}.

    Raises AtcError for fixes whose forces are part of the stress and not known.
    """
    outside = []
    for c in choice.fixes:
        kind, reason = _class(c)
        what = f"{c.where}: fix {c.words[2]}"
        if kind == "constraint":
            raise AtcError(
                f"{what} {reason}: the forces that do it are part of the stress and are not supported yet: take another run, or leave the fix out"
            )
        if kind == "model":
            raise AtcError(f"{what} {reason}, which is not supported: give the lines of the model that holds, without this fix")
        if kind == "outside":
            outside.append(f"fix {c.words[2]} on group {c.words[1]} ({c.where})")
    changing: dict[str, str] = {}
    for c in (*choice.before, *choice.fixes):
        kind, reason = _class(c)
        for what in REACH.get(kind, ()):
            changing.setdefault(what, f"{c.where}: fix {c.words[2]} {reason}")
    return tuple(outside), changing


def _class(c: Command):
    return classify(c.words[2], c.words[3:])
