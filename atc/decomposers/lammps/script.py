"""The lines of a LAMMPS input script that define the model, with variables put in; everything else is passed over.

What could change the model in a way that the text does not show (loops over model lines, conditional model lines) is refused.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from ...errors import AtcError
from .commands import COMMANDS, check_known
from .variables import Unknown, Variables

MODEL = {
    "units",
    "pair_style",
    "pair_coeff",
    "pair_modify",
    "bond_style",
    "bond_coeff",
    "angle_style",
    "angle_coeff",
    "dihedral_style",
    "dihedral_coeff",
    "improper_style",
    "improper_coeff",
    "special_bonds",
    "dielectric",
    "kspace_style",
    "labelmap",
    "mass",
    "read_data",
    "clear",
    "dimension",
}
# Commands that a pasted model may hold as well; used only to tell text from a file name.
OTHER = {
    "variable",
    "include",
    "atom_style",
    "newton",
    "neighbor",
    "neigh_modify",
    "boundary",
    "kspace_modify",
    "comm_modify",
    "pair_write",
}


@dataclass(frozen=True)
class Command:
    name: str
    words: tuple[str, ...]
    where: str


@dataclass(frozen=True)
class _Line:
    text: str
    where: str


def is_text(source: str) -> bool:
    """Whether a string holds LAMMPS lines rather than a path."""
    if "\n" in source:
        return True
    first = source.split()
    return bool(first) and (first[0] in MODEL or first[0] in OTHER) and len(first) > 1


def split_words(text: str, where: str) -> list[str]:
    """Words of a line; quotes (single, double, triple) hold a word together, # outside them starts a comment."""
    words, p, n = [], 0, len(text)
    while p < n:
        c = text[p]
        if c.isspace():
            p += 1
        elif c == "#":
            break
        elif c in "\"'":
            q = '"""' if text.startswith('"""', p) else c
            end = text.find(q, p + len(q))
            if end < 0:
                raise AtcError(f"{where}: a quote is not closed")
            words.append(text[p + len(q) : end])
            p = end + len(q)
        else:
            end = p
            while end < n and not text[end].isspace() and text[end] != "#":
                end += 1
            words.append(text[p:end])
            p = end
    return words


def _logical_lines(text: str, name: str) -> list[_Line]:
    """Lines joined at a trailing ``&`` and inside triple quotes; `where` names the first."""
    out, held, first = [], "", 0
    for number, raw in enumerate(text.splitlines(), 1):
        if not held:
            first = number
        held += raw
        stripped = held.rstrip()
        if stripped.endswith("&"):
            held = stripped[:-1]
            continue
        if _uncommented(held).count('"""') % 2:
            held += "\n"
            continue
        out.append(_Line(held, f"{name}, line {first}"))
        held = ""
    if held.strip():
        out.append(_Line(held, f"{name}, line {first}"))
    return out


def read_commands(text: str, name: str, folder: Path, script: bool = False) -> list[Command]:
    """The model's commands of LAMMPS lines `text`, called `name` in messages; included files are looked up in `folder`. script: the lines of a whole run."""
    reader = _Reader(folder, script)
    reader.feed(text, name)
    return reader.commands


class _Reader:
    def __init__(self, folder: Path, script: bool = False):
        self.folder, self.script = folder, script
        self.variables = Variables()
        self.commands: list[Command] = []
        self.depth = 0
        # Where in `commands` each label stands, and jumps to labels not seen yet.
        self.labels: dict[str, int] = {}
        self.pending: list[tuple[str, int, str]] = []

    def feed(self, text: str, name: str) -> None:
        if self.depth > 20:
            raise AtcError(f"{name}: includes are nested more than 20 deep; does a file include itself?")
        self.depth += 1
        for line in _logical_lines(text, name):
            self.line(line)
        self.depth -= 1

    def line(self, line: _Line) -> None:
        # Only the first word decides whether the rest must be understood.
        head = line.text.split("#")[0].split()
        if not head:
            return
        name = head[0]
        if name.startswith("$"):
            words = self.words(line)
            if words and words[0] in MODEL:
                self.keep(words, line)
        elif name in MODEL:
            self.keep(self.words(line), line)
        elif name not in COMMANDS:
            check_known(name, line.where, self.script)
        elif name == "variable":
            self.variable(line, head)
        elif name == "include":
            words = self.words(line)
            if len(words) < 2:
                raise AtcError(f"{line.where}: include needs a file name")
            path = Path(words[1]).expanduser()
            path = path if path.is_absolute() else self.folder / path
            self.feed(read_text(path, line.where), str(path))
        elif name == "label" and len(head) > 1:
            self.labels[head[1]] = len(self.commands)
            for label, at, where in self.pending:
                if label == head[1] and len(self.commands) > at:
                    raise AtcError(
                        f"{where}: this jump skips model lines such as {self.commands[at].name!r} ({self.commands[at].where}): write the model without jumps over it"
                    )
        elif name == "jump":
            self.jump(head[1:], line.where)
        elif name in ("if", "partition", "python", "run"):
            self.conditional(line)
        elif name == "next":
            for v in head[1:]:
                self.variables.forget(v, f"variable {v} is stepped by 'next' ({line.where}), so its value depends on the run")
        elif name == "neigh_modify" and "exclude" in head:
            raise AtcError(
                f"{line.where}: neigh_modify exclude leaves out pair interactions, which is not supported: remove the line, or the interaction"
            )
        elif name == "fix" and len(head) > 3 and head[3].startswith("adapt"):
            raise AtcError(
                f"{line.where}: fix {head[3]} changes coefficients while LAMMPS runs, which is not supported: give the coefficients that hold"
            )

    def words(self, line: _Line) -> list[str]:
        try:
            return split_words(self.variables.substitute(_uncommented(line.text)), line.where)
        except Unknown as e:
            raise AtcError(f"{line.where}: {e}") from None

    def keep(self, words: list[str], line: _Line) -> None:
        if words[0] == "clear":
            self.commands.clear()
            self.labels = {k: 0 for k in self.labels}
            return
        self.commands.append(Command(words[0], tuple(words[1:]), line.where))

    def variable(self, line: _Line, head) -> None:
        try:
            words = split_words(self.variables.substitute(_uncommented(line.text)), line.where)
        except (Unknown, AtcError) as e:
            if len(head) > 1:
                self.variables.forget(head[1], str(e))
            return
        self.variables.define(words[1:])

    def conditional(self, line: _Line) -> None:
        held = re.findall(r"[A-Za-z_]+", line.text)
        model = [w for w in held if w in MODEL - {"mass", "units", "dimension"} or w == "include"]
        if model:
            raise AtcError(
                f"{line.where}: {model[0]!r} depends on a condition, which is not supported: write the line that holds without '{held[0]}'"
            )
        if "jump" in held:
            m = re.search(r"jump\s+(\S+)(?:\s+([^\s\"']+))?", line.text)
            if m:
                self.jump([w.strip("\"'") for w in m.groups() if w], line.where)
        for m in re.finditer(r"variable\s+(\w+)", line.text):
            self.variables.forget(m.group(1), f"variable {m.group(1)} depends on a condition ({line.where})")

    def jump(self, words, where) -> None:
        if not words or words[0] != "SELF":
            raise AtcError(f"{where}: a jump to another file may change the model: use 'include', or name that file")
        label = words[1] if len(words) > 1 else None
        at = 0 if label is None else self.labels.get(label)
        if at is None:
            self.pending.append((label, len(self.commands), where))
        elif len(self.commands) > at:
            c = self.commands[at]
            raise AtcError(f"{where}: this jump repeats the model line {c.name!r} ({c.where}): move the model out of the loop")


def _uncommented(text: str) -> str:
    """Text before a # that is not in quotes, so that a comment's $ is left alone."""
    quote = ""
    for p, c in enumerate(text):
        if quote:
            if c == quote:
                quote = ""
        elif c in "\"'":
            quote = c
        elif c == "#":
            return text[:p]
    return text


def read_text(path: Path, where: str | None = None) -> str:
    """A text file, or an AtcError that says what is wrong with it."""
    prefix = f"{where}: " if where else ""
    try:
        return Path(path).read_text(encoding="utf-8", errors="replace")
    except FileNotFoundError:
        raise AtcError(f"{prefix}{path}: no such file") from None
    except IsADirectoryError:
        raise AtcError(f"{prefix}{path}: is a folder, expected a file with LAMMPS lines") from None
    except OSError as e:
        raise AtcError(f"{prefix}{path}: cannot be read: {e.strerror}") from None
