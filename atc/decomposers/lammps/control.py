"""Commands that say which line is next, or what a word means: variables, labels, jumps, loops, conditions, includes."""

from __future__ import annotations

import os

from ...errors import AtcError
from .conditions import holds
from .script import split_words
from .unsure import Unsure, lines_in
from .variables import Unknown

#: Commands that are executed before loops that change nothing are cut short.
PATIENCE = 5000


class Quit(Exception):
    """The script is at its end."""


class Control(Unsure):
    """The part of the `Interpreter` for commands of class "control"; each returns the file and the line to go on with,
    or None for the next."""

    def _variable(self, line, file, p):
        head = line.text.split()
        try:
            words = split_words(self.variables.substitute(line.text), line.where)
        except (Unknown, AtcError) as e:
            if len(head) > 1:
                self.variables.forget(head[1], str(e))
            return
        self.variables.define(words[1:])

    def _next(self, line, file, p):
        words, _ = self._known_words(line)
        self._skip_jump = self.variables.step(words[1:]) or self._skip_jump

    def _label(self, line, file, p):
        pass

    _print = _label

    def _quit(self, line, file, p):
        raise Quit

    def _shell(self, line, file, p):
        words, why = self._known_words(line)
        if words[1:2] == ["cd"]:
            if why or len(words) != 3:
                raise line.error(f"shell cd: {why or 'expected a folder'}")
            self.folder = self._find(words[2])

    def _python(self, line, file, p):
        words, _ = self._known_words(line)
        if "SELF" in words[2:]:
            raise line.error(
                f"python {words[1]} gets LAMMPS itself (SELF), so it may change anything: write the "
                "lines of the model that holds"
            )

    def _partition(self, line, file, p):
        words, _ = self._known_words(line)
        self._harmless_or_refuse(" ".join(words[3:]), line.where, "is for some partitions only")

    def _include(self, line, file, p):
        words = self._words(line)
        if len(words) < 2:
            raise line.error("include needs a file name")
        self._file(self._load(words[1], line.where))

    def _jump(self, line, file, p):
        if self._skip_jump:
            self._skip_jump = False
            return None
        words = self._words(line)
        if len(words) < 2:
            raise line.error("jump needs a file name, or SELF")
        target, at = self._target(words, line, file)
        if target is file and at <= p and self._executed > PATIENCE:
            span = file.lines[at : p + 1]
            if self._changing(span) is None:
                self._forget(span, f"is set in a loop that goes on for more than {PATIENCE} commands ({line.where})")
                return None
        return target, at

    def _target(self, words, line, file):
        name, label = words[1], words[2] if len(words) > 2 else None
        own = file.path is not None and self._find(name).name == file.path.name and not self._is_other(name, file)
        if name == "SELF" or own:
            target = file
        else:
            path = self._find(name)
            if not os.path.isfile(path):
                raise line.error(f"jump to another file, {name}, which is not there (looked for {path})")
            target = self._load(name, line.where)
        if label is None:
            return target, 0
        if label not in target.labels:
            raise line.error(f"jump to the label {label}, which is not there: add 'label {label}'")
        return target, target.labels[label]

    def _is_other(self, name, file) -> bool:
        """Whether a file name of a jump means another file than the one that is executed."""
        path = self._find(name)
        try:
            return path.exists() and not path.samefile(file.path)
        except OSError:
            return False

    def _if(self, line, file, p):
        words, branches = self._parse_if(line)
        for condition, commands in branches:
            try:
                true = condition is None or holds(self.variables.substitute(condition))
            except Unknown as e:
                return self._uncertain(line, file, p, branches, str(e))
            if true:
                for one in lines_in(commands, line):
                    target = self._line(one, file, p)
                    if target is not None:
                        return target
                return None
        return None
