"""LAMMPS log files: the thermodynamic output of every run in them, by step.

Understood: one line a step (``thermo_style one``, ``custom``), several lines (``multi``), YAML (``thermo_modify line
yaml``); several runs in one file or in several files, warnings and other text in between, a file that breaks off. The
commands that the log echoes say its units, whether energies are per atom (``thermo_modify norm``), what renamed columns
are, and which fixes add to energy and virial.
"""

from __future__ import annotations

import os
import re
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...units import LAMMPS_STYLES, Units, units
from ..table import is_number

#: Column headings (in LAMMPS of different years) and thermo_style keywords by what they are.
NAMES = {
    "step": ("Step", "step"), "temperature": ("Temp", "temp"), "pressure": ("Press", "press"),
    "potential": ("PotEng", "pe"), "kinetic": ("KinEng", "ke"), "total": ("TotEng", "etotal"),
    "pair": ("E_pair", "epair"), "molecular": ("E_mol", "emol"), "vdwl": ("E_vdwl", "evdwl"),
    "coul": ("E_coul", "ecoul"), "long": ("E_long", "elong"), "tail": ("E_tail", "etail"), "bond": ("E_bond", "ebond"),
    "angle": ("E_angle", "eangle"), "dihedral": ("E_dihed", "edihed"), "improper": ("E_impro", "eimp"),
    "volume": ("Volume", "vol"), "atoms": ("Atoms", "atoms"), "time": ("Time", "time"), "dt": ("Dt", "dt"),
    "pxx": ("Pxx", "pxx"), "pyy": ("Pyy", "pyy"), "pzz": ("Pzz", "pzz"), "pxy": ("Pxy", "pxy"), "pxz": ("Pxz", "pxz"),
    "pyz": ("Pyz", "pyz"),
}  # fmt: skip
_BY_WORD = {word: name for name, words in NAMES.items() for word in words}
TENSOR = ("pxx", "pyy", "pzz", "pxy", "pxz", "pyz")

_MULTI = re.compile(r"^-{4,}\s*Step\s+(-?\d+)\s+-{3,}\s*CPU\s*=")
#: What stands behind the rows of a run.
_BEHIND = ("Loop time of", "Per MPI rank", "Memory usage", "ERROR")
_MEMORY = ("Per MPI rank memory allocation", "Memory usage per processor")
#: Beginnings of styles of fixes whose forces are none between the atoms of a potential.
_ACTING = tuple("shake rattle rigid wall efield addforce gravity spring restrain cmap indent external qeq".split())
_PAIR = re.compile(r"(\S+)\s+=\s+(\S+)")


@dataclass
class LogRow:
    """What the log says of one step, in its own units, energies as printed.

    values : {what: number}, named as in `NAMES`. steps_of_digit : {what: size of one step of the last printed digit}.
    normalised : whether energies are per atom; None where the log does not tell. run : number of the run in the log.
        causes : what, as far as the commands say, is in the numbers beside the forces between atoms. line : where it
        stands.
    """

    step: int
    values: dict
    digits: dict
    normalised: bool | None
    run: int
    line: int
    causes: tuple[str, ...] = ()


@dataclass
class _State:
    """What the echoed commands have said up to here."""

    units: str | None = None
    norm: bool | None = None
    keywords: tuple[str, ...] = ()
    temp: str = ""
    press: str = ""
    tail: bool = False
    kspace: str = ""
    fixes: dict = field(default_factory=dict)
    energy: set = field(default_factory=set)
    echoed: bool = False


class LammpsLog:
    """The thermodynamic output of a LAMMPS log file, or of several (of a run and its continuations).

    Parameters
    ----------
    paths : a path or a list of paths
    default_units : Units of the trajectory beside it, for logs that do not echo their ``units`` line

    Attributes
    ----------
    rows : list of LogRow, in file order. units : Units. name : of the files, without folders. notes : what could not be
        read

    Raises
    ------
    AtcError for a file that is not there, holds no thermodynamic output, or changes its units.
    """

    def __init__(self, paths, default_units: Units | str | None = None):
        paths = [paths] if isinstance(paths, (str, Path)) else list(paths)
        self.source = str(paths[0]) if len(paths) == 1 else f"{paths[0]} .. {paths[-1]}"
        self.name = ", ".join(Path(p).name for p in paths)
        self.rows: list[LogRow] = []
        self.notes: list[str] = []
        self._said: str | None = None
        self._runs = 0
        for path in paths:
            self._read(Path(path))
        if self._said is not None:
            self.units = units(self._said)
        elif default_units is not None:
            self.units = units(default_units)
        else:
            raise AtcError(f"{self.source}: does not echo its units line: say units")
        self.assumed_norm = any(r.normalised is None for r in self.rows)
        for row in self.rows:
            if row.normalised is None:
                row.normalised = self.units.reduced  # LAMMPS's default
        self._by_step: dict[int, list[LogRow]] = {}
        for row in self.rows:
            self._by_step.setdefault(row.step, []).append(row)
        if not self.rows:
            why = self.notes[0] if self.notes else "no thermodynamic output was found in it"
            raise AtcError(
                f"{self.source}: not a LAMMPS log that can be used: {why}; expected lines such as 'Step Temp E_pair "
                "...' with numbers below"
            )

    def at(self, step) -> list[LogRow]:
        """All that the log says of a step: nothing, or a row for every run that printed it."""
        return self._by_step.get(step, [])

    @property
    def steps(self) -> list[int]:
        return sorted(self._by_step)

    # Reading
    # ------------------------------------------------------------------------------------------------------------------

    def _read(self, path: Path) -> None:
        if not os.path.isfile(path):
            raise AtcError(f"there is no log file {path}")
        from ..whole import bytes_as_they_are

        raw = bytes_as_they_are(path).tobytes()
        if b"\0" in raw[:4096]:
            raise AtcError(f"{path}: holds binary data: not a LAMMPS log")
        lines = raw.decode("utf-8", "replace").split("\n")
        lines.pop()  # what stands behind the last line end may have been cut off
        self._lines(lines, path)

    def _lines(self, lines, path) -> None:
        state, k = _State(), 0
        # printed text may look like a heading; a log that was cut down to its tables has nothing else
        self._whole = any(line.startswith(_MEMORY) for line in lines)
        while k < len(lines):
            line = lines[k]
            words = line.split()
            if _MULTI.match(line):
                k = self._multi(lines, k, state)
            elif words[:1] == ["keywords:"] and k and lines[k - 1].strip() == "---":
                k = self._yaml(lines, k, state)
            elif (words[:1] == ["Step"] and not self._whole) or _follows_memory(lines, k, words):
                k = self._table(lines, k, state)
            else:
                self._command(words, state, path, k + 1)
                k += 1

    def _command(self, words, state: _State, path, number) -> None:
        """Take note of an echoed command."""
        if not words or any("$" in w for w in words):  # the line with variables in place follows
            return
        name, args = words[0], words[1:]
        if name == "units" and len(args) == 1 and args[0] in LAMMPS_STYLES:
            if self._said not in (None, args[0]):
                raise AtcError(
                    f"{path}, line {number}: the log changes its units from {self._said!r} to {args[0]!r}: give the "
                    "logs of one run"
                )
            self._said = state.units = args[0]
            state.echoed = True
        elif name == "thermo_style" and args:
            state.norm, state.temp, state.press, state.echoed = None, "", "", True
            state.keywords = tuple(args[1:]) if args[0] == "custom" else ()
        elif name == "thermo_modify":
            state.echoed = True
            for key, value in pairwise(args):
                if key == "norm" and value in ("yes", "no", "on", "off", "true", "false"):
                    state.norm = value in ("yes", "on", "true")
                elif key in ("temp", "press"):
                    setattr(state, key, value)
        elif name == "pair_style":
            state.tail, state.echoed = False, True
        elif name == "pair_modify" and "tail" in args[:-1]:
            state.tail = args[args.index("tail") + 1] in ("yes", "on", "true")
        elif name == "kspace_style" and args:
            state.kspace = "" if args[0] == "none" else args[0]
        elif name == "fix" and len(args) >= 3:
            state.fixes[args[0]] = args[2]
        elif name == "unfix" and args:
            state.fixes.pop(args[0], None)
            state.energy.discard(args[0])
        elif name == "fix_modify" and "energy" in args[:-1]:
            on = args[args.index("energy") + 1] in ("yes", "on", "true")
            (state.energy.add if on else state.energy.discard)(args[0])
        elif name == "clear" and not args:
            said = state.units
            state.__init__()
            state.units = said
        elif name in ("run", "minimize", "rerun"):
            state.echoed = True

    def _table(self, lines, k, state) -> int:
        """A heading and its rows; returns the number of the line behind."""
        heading = lines[k].split()
        first = k + 1
        at = first
        found = []
        while at < len(lines):
            words = lines[at].split()
            if lines[at].startswith(_BEHIND) or _MULTI.match(lines[at]):
                break
            if words[:1] == ["Step"] and not self._whole:
                break
            if len(words) == len(heading) and all(_numeric(w) for w in words):
                found.append((at + 1, words))
            elif not found and at - first > 5:
                return k + 1  # words that only look like a heading
            at += 1
        if found:
            self._keep(heading, found, state)
        return at if found else k + 1

    def _yaml(self, lines, k, state) -> int:
        heading = re.findall(r"'([^']*)'", lines[k])
        found, at = [], k + 1
        while at < len(lines) and lines[at].strip() != "...":
            text = lines[at].strip()
            if text.startswith("- ["):
                words = [w.strip() for w in text[3:].rstrip("]").split(",") if w.strip()]
                if text.endswith("]") and len(words) == len(heading) and all(_numeric(w) for w in words):
                    found.append((at + 1, words))
            elif lines[at].startswith(("Loop time of", "Per MPI rank", "---")):
                break
            at += 1
        self._keep(heading, found, state)
        return at

    def _multi(self, lines, k, state) -> int:
        found, at, heading = [], k, None
        while at < len(lines):
            mark = _MULTI.match(lines[at])
            if not mark:
                if lines[at].startswith(_BEHIND):
                    break
                at += 1
                continue
            number, names, values = at + 1, ["Step"], [mark[1]]
            at += 1
            while at < len(lines) and not _MULTI.match(lines[at]):
                pairs = _PAIR.findall(lines[at])
                if pairs and all(_numeric(v) for _, v in pairs):
                    names += [n for n, _ in pairs]
                    values += [v for _, v in pairs]
                elif not lines[at].startswith("WARNING"):
                    break
                at += 1
            if heading is None or len(names) > len(heading):
                heading = names
            if len(names) == len(heading):  # the last one may have been cut off
                found.append((number, values))
        self._keep(heading, [row for row in found if len(row[1]) == len(heading)], state)
        return max(at, k + 1)

    def _keep(self, heading, found, state: _State) -> None:
        self._runs += 1
        names = [_BY_WORD.get(h) for h in heading]
        if state.keywords and len(state.keywords) == len(heading):
            # what the columns are whatever they were renamed to
            names = [_BY_WORD.get(w) for w in state.keywords]
        if "step" not in names:
            if found:
                self.notes.append(
                    f"the output from line {found[0][0]} on has no column Step: add step to thermo_style custom"
                )
            return
        causes = _causes(state)
        norm = state.norm if state.norm is not None or not state.echoed or self._said is None else self._said == "lj"
        steps = _last_digits([[words[c] for _, words in found] for c in range(len(heading))])
        for r, (line, words) in enumerate(found):
            values, digits = {}, {}
            for c, name in enumerate(names):
                if name is not None and name not in values:
                    values[name], digits[name] = float(words[c]), steps[c][r]
            step = values.pop("step")
            if abs(step) < 2**62 and step == int(step):  # not so for NaN
                self.rows.append(LogRow(int(step), values, digits, norm, self._runs, line, causes))


def _follows_memory(lines, k, words) -> bool:
    """A heading need not begin with Step (``thermo_style custom temp step``): it stands behind the line on memory."""
    if not words or _numeric(words[0]) or not any(w in _BY_WORD for w in words):
        return False
    back = k - 1
    while back >= 0 and (lines[back].startswith("WARNING") or not lines[back].strip()):
        back -= 1
    return back >= 0 and lines[back].startswith(_MEMORY)


def _causes(state: _State) -> tuple[str, ...]:
    out = []
    if state.tail:
        out.append("tail corrections (pair_modify tail yes)")
    if state.kspace:
        out.append(f"long-range Coulomb (kspace_style {state.kspace})")
    for name in state.energy & set(state.fixes):
        out.append(f"energy of fix {state.fixes[name]} (fix_modify {name} energy yes)")
    for what, compute in (("temperature", state.temp), ("pressure", state.press)):
        if compute:
            out.append(f"{what} of compute {compute} (thermo_modify)")
    for style in dict.fromkeys(state.fixes.values()):
        if style.startswith(_ACTING):
            out.append(f"fix {style}")
    return tuple(out)


def _numeric(word: str) -> bool:
    return is_number(word.encode())


def _last_digits(columns) -> list[np.ndarray]:
    """For each column of texts the size of a step of the last digit of each number: of a fixed number of decimals, or
    of significant digits.

    Columns without a decimal point (a box of 9261, say) have as many significant digits as the others: the format drops
    zeros.
    """
    looks = [_look_of(texts) for texts in columns]
    most = max((digits for digits, _, whole in looks if not whole), default=17)
    out = []
    for texts, (digits, decimals, whole) in zip(columns, looks, strict=True):
        values = np.array([float(t) for t in texts])
        with np.errstate(divide="ignore", invalid="ignore"):
            shown = min(max(digits, most) if whole else digits, 17)
            step = np.where(values != 0, 10.0 ** (np.floor(np.log10(np.abs(values))) + 1 - shown), 0.0)
        if decimals:
            step = np.maximum(step, 10.0**-decimals)
        out.append(np.where(np.isfinite(step), step, np.inf))
    return out


def _look_of(texts):
    """Most significant digits of numbers as printed, their common number of decimals (0: not common), whether none has
    a decimal point."""
    decimals, digits, whole = set(), 1, True
    for t in texts:
        mantissa, _, exponent = t.lstrip("+-").lower().partition("e")
        before, point, fraction = mantissa.partition(".")
        whole &= not point and not exponent
        power = int(exponent) if exponent.lstrip("+-").isdecimal() and len(exponent) < 6 else 0
        decimals.add(len(fraction) - power)
        digits = max(digits, len((before + fraction).lstrip("0")))
    common = next(iter(decimals)) if len(decimals) == 1 and len(texts) > 1 else 0
    return digits, max(common, 0), whole
