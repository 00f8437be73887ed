"""Which run of a script the frames belong to, and what its fixes mean for them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...errors import AtcError
from .atom_commands import touches
from .fixes import REACH, class_of, classify
from .interpreter import Interpreter
from .script import Command, short
from .state import State

#: Runs with models of their own that are compared.
_MOST = 200


@dataclass(frozen=True)
class Choice:
    """state : what holds. later : commands of later runs that may change atoms. fixes : those of every run meant.
    before : those of the runs up to it.
    timestep : the word of the ``timestep`` line, see `State`. minimizes : whether all runs meant are minimizations.
    steady : whether the same forces from outside act in all of them"""

    state: State
    later: tuple[Command, ...]
    fixes: tuple[Command, ...]
    before: tuple[Command, ...]
    timestep: str | None = None
    minimizes: bool = False
    steady: bool = True


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
    numbers = _distinct_models(states, name)
    if len(numbers) > 1:
        dumped = _dumped(script, trajectory, len(states))
        if not dumped:
            raise _differ(states, numbers[0], numbers[1])
        numbers = [dumped[k] for k in _distinct_models([states[k] for k in dumped], name)]
        if len(numbers) > 1:
            raise _differ(states, numbers[0], numbers[1])
        return _choice(states, dumped)
    return _choice(states, list(range(len(states))))


def _distinct_models(states, name) -> list[int]:
    """The numbers of states with models of their own."""
    lines = {}
    for k, s in enumerate(states):
        lines.setdefault(s.key, k)
    if len(lines) > _MOST:
        raise AtcError(
            f"{name}: more than {_MOST} runs with models of their own: say which run the frames belong to, e.g. run = "
            "1 in [potential]"
        )
    out, said = [], []
    for k in lines.values():
        mine = states[k].said()
        if mine not in said:
            out.append(k)
            said.append(mine)
        if len(out) > 2:
            break
    return out


def _differ(states, i: int, k: int) -> AtcError:
    c = _difference(states[i], states[k])
    words = c.words[2:3] if c.name == "fix" else c.words[:3]
    return c.error(
        f"{c.name} {' '.join(words)} holds in run {k + 1} ({states[k].where}), not in run {i + 1} "
        f"({states[i].where}): say which run the frames belong to, e.g. run = {k + 1} in [potential]"
    )


def _difference(a: State, b: State) -> Command:
    """A command of b that a has not, or the other way round."""
    mine, theirs = (*a.model, *a.held), (*b.model, *b.held)
    said = {(c.name, c.words) for c in mine}
    other = {(c.name, c.words) for c in theirs}
    return next((c for c in theirs if (c.name, c.words) not in said), None) or next(
        (c for c in mine if (c.name, c.words) not in other), theirs[-1] if theirs else mine[-1]
    )


def _choice(states, numbers) -> Choice:
    first = states[numbers[0]]
    # Of states that grow from the same list the longest says what the others say.
    longest = {}
    for k in numbers[1:]:
        s = states[k]
        if id(s._atoms) not in longest or s._n_atoms > longest[id(s._atoms)]._n_atoms:
            longest[id(s._atoms)] = s
    beyond = (c for s in list(longest.values())[:_MOST] for c in s.atoms_beyond(first) if c.name != "run")
    later = [c for c in beyond if c.unknown or touches(c) or c.name == "group"]
    fixes = {c: None for t in _distinct(states[k].fixes for k in numbers) for c in t}
    before = {c: None for t in _distinct(s.fixes for s in states[: numbers[-1] + 1]) for c in t}
    steps = {states[k].timestep for k in numbers}
    steady = len({tuple((c.name, c.words) for c in states[k].fixes if class_of(c) == "outside") for k in numbers}) == 1
    minimizes = all(states[k].name.startswith("minimize") for k in numbers)
    timestep = steps.pop() if len(steps) == 1 else ""
    return Choice(first, tuple(dict.fromkeys(later)), tuple(fixes), tuple(before), timestep, minimizes, steady)


def _distinct(tuples):
    return {id(t): t for t in tuples}.values()


def _dumped(script, trajectory, n) -> list[int]:
    """The runs in which the files of a trajectory are written; none if the script's dump lines do not say it of all of
    them."""
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


def sort_fixes(choice: Choice, folder) -> tuple[tuple[str, ...], dict]:
    """The forces from outside, one text for each fix, and what fixes change while LAMMPS runs, {property: reason}.

    folder : where files of the script are looked up

    Raises AtcError for fixes whose forces are part of the stress and not known.
    """
    outside = []
    for c in choice.fixes:
        kind, reason = classify(c.words[2], c.words[3:])
        what = f"{c.where}: fix {c.words[2]}"
        if kind == "held":
            raise AtcError(
                f"{what} {reason}: the forces that do it are part of the stress and are not supported: take another "
                "run, or leave the fix out"
            )
        if c.words[2] == "cmap" and _without_energy(c, choice, folder):
            continue
        if kind == "model":
            raise AtcError(
                f"{what} {reason}, which is not supported: give the lines of the model that holds, without this fix"
            )
        if kind == "outside":
            outside.append(f"fix {c.words[2]} on group {c.words[1]} ({short(c.where)})")
    changing: dict[str, str] = {}
    for c in (*choice.before, *choice.fixes):
        kind, reason = classify(c.words[2], c.words[3:])
        for what in REACH.get(kind, ()):
            changing.setdefault(what, f"{c.where}: fix {c.words[2]} {reason}")
    return tuple(outside), changing


def _without_energy(c: Command, choice: Choice, folder) -> bool:
    """Whether a ``fix cmap`` has no crossterm with energy in the data files that the script reads. AtcError, with the
    reason, for one that has."""
    from ..bonded.cmap import check_fix_cmap, read_crossterms

    types = []
    for read in (r for r in choice.state.atoms if r.name == "read_data" and not r.unknown):
        at = [k for k, w in enumerate(read.words[:-3]) if w == "fix" and read.words[k + 1] == c.words[0]]
        for k in at:
            types.extend(read_crossterms(Path(folder, read.words[0]), read.words[k + 3])[0])
    if not types or c.unknown:
        return False
    check_fix_cmap(c.words[3:], folder, c.where, types)
    return True


def check_spins_push(choice: Choice, name: str) -> None:
    """Complain of runs in which LAMMPS leaves the forces between spins out of those on atoms: all but those with ``fix
    nve/spin ... lattice moving``."""
    moving = False
    for c in choice.fixes:
        if c.words[2] == "nve/spin":
            words = c.words[3:]
            said = words[words.index("lattice") + 1 : words.index("lattice") + 2] if "lattice" in words else ("moving",)
            if said[:1] not in (("moving",), ("yes",)):
                raise c.error(
                    f"fix nve/spin lattice {' '.join(said)}: LAMMPS then computes no forces of spins on "
                    "atoms, so that there is no stress of theirs: it does with lattice moving"
                )
            moving = True
    if not moving:
        raise AtcError(
            f"{name}: LAMMPS computes forces of spins on atoms only with fix nve/spin ... lattice moving, which this "
            "run has not: add it before the run to see the stress that belongs to them"
        )
