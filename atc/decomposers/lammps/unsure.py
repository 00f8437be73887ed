"""Lines of a script that LAMMPS may or may not get to, as a condition decides that only the run knows. Nothing of the
model may depend on it; variables that do are not known from then on."""

from __future__ import annotations

from ...errors import AtcError
from ..pairs.hybrid import strip_suffix
from .commands import CLASSES
from .fixes import class_of, classify
from .script import Command, Line, logical_lines, split_words
from .variables import Unknown

#: Variables and output: what is not executed, or twice, does no harm.
_IDLE = {"variable", "print", "label", "jump", "next", "quit", "log", "shell"}


class Unsure:
    """The part of the `Interpreter` that looks at lines without executing them."""

    def _parse_if(self, line):
        """The words, and [(condition or None, commands), ...]."""
        words, _ = self._known_words(line)
        branches, k = [], 1
        keyword = "if"
        while k < len(words):
            condition = None
            if keyword != "else":
                condition = words[k]
                k += 1
                if keyword == "if" and words[k : k + 1] != ["then"]:
                    raise line.error(f"expected 'if <condition> then <command> ...', got {' '.join(words[:4])}")
                k += keyword == "if"
            commands = []
            while k < len(words) and words[k] not in ("elif", "else"):
                commands.append(words[k])
                k += 1
            branches.append((condition, commands))
            keyword = words[k] if k < len(words) else ""
            k += 1
        if not branches:
            raise line.error("expected 'if <condition> then <command> ...'")
        return words, branches

    def _uncertain(self, line, file, p, branches, why):
        """A condition that is not known: nothing it decides on may matter."""
        for _, commands in branches:
            for one in lines_in(commands, line):
                self._maybe(one, file, p, why)

    def _maybe(self, line: Line, file, p, why: str) -> None:
        name = line.head
        if name == "jump":
            words, unknown = self._known_words(line)
            if unknown:
                raise line.error(f"{unknown}")
            target, at = self._target(words, line, file)
            if target is not file:
                raise line.error(f"jump to another file depends on a condition that is not known: {why}")
            span = file.lines[min(at, p + 1) : max(at, p + 1)]
            self._executed += len(span)
            found = self._changing(span)
            if found is not None:
                word = "repeats" if at <= p else "skips"
                raise line.error(
                    f"whether this jump {word} {found.head!r} ({found.where}) is not known: {why}: "
                    "write the model without it"
                )
            self._forget(span, f"depends on a condition ({line.where})")
            return
        found = self._changing([line])
        if found is not None and CLASSES.get(name, ("",))[0] == "atoms":
            words = tuple(split_words(line.text, line.where)[1:])
            self.atoms.append(Command(name, words, line.where, f"it depends on a condition: {why}"))
        elif found is not None:
            raise line.error(
                f"{name!r} depends on a condition that is not known: {why}: write the line that holds without 'if'"
            )
        self._forget([line], f"depends on a condition ({line.where})")

    def _harmless_or_refuse(self, text: str, where: str, why: str) -> None:
        for line in logical_lines(text, where):
            line = Line(line.text, where)
            if self._changing([line]) is not None:
                raise AtcError(
                    f"{where}: {line.head!r} {why}, which is not supported: write the line that holds by itself"
                )
            self._forget([line], f"is set by a command that {why} ({where})")

    def _changing(self, lines) -> Line | None:
        """The first line that may change the model or the atoms."""
        for line in lines:
            name = line.head
            kind = CLASSES.get(name, ("harmless",))[0]
            if name in _IDLE or kind in ("harmless", "run"):
                continue
            if name == "neigh_modify" and "exclude" not in line.text and "include" not in line.text:
                continue
            if name == "if":
                try:
                    _, branches = self._parse_if(line)
                except (AtcError, Unknown):
                    return line
                inner = [one for _, commands in branches for one in lines_in(commands, line)]
                if not any(i.head == "if" for i in inner) and self._changing(inner) is None:
                    continue
            if name == "fix":
                words = line.text.split()
                found = classify(strip_suffix(words[3]), words[4:]) if len(words) > 3 else None
                if found is not None and found[0] in ("harmless", "outside"):
                    continue
            if name == "unfix":
                words = line.text.split()
                there = self.fixes.get(words[1]) if len(words) > 1 else None
                if there is None or class_of(there) in ("harmless", "outside"):
                    continue
            return line
        return None

    def _forget(self, lines, why: str) -> None:
        for line in lines:
            words = line.text.split()
            if words[0] == "variable" and len(words) > 1:
                self.variables.forget(words[1], f"variable {words[1]} {why}")
            elif words[0] == "next":
                for v in words[1:]:
                    self.variables.forget(v, f"variable {v} {why}")
            elif words[0] == "if":
                try:
                    _, branches = self._parse_if(line)
                except (AtcError, Unknown):
                    continue
                for _, commands in branches:
                    self._forget([one for one in lines_in(commands, line) if one.head != "if"], why)


def lines_in(commands, line: Line) -> list[Line]:
    """The lines of commands that stand in another line."""
    return [Line(one.text, line.where) for text in commands for one in logical_lines(text, line.where)]
