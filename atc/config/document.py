"""What scenes and peridynamic cases share: a TOML file that knows where its keys stand."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar, Self

from ..errors import AtcError
from .checks import Key
from .overrides import overridden
from .toml import LONGEST, complaint, key_lines, parse, shown
from .words import unknown


def read_document(path: Path, what: str) -> str:
    """The text of a TOML file that is to be a `what`, or an AtcError that says why not."""
    try:
        with open(path, "rb") as f:  # a pipe is read to its end, a device without one only so far
            text = f.read(LONGEST + 1)
        if len(text) > LONGEST:
            raise AtcError(f"{path}: more than {LONGEST} bytes, expected a {what} (a TOML file)")
        return text.decode("utf-8")
    except FileNotFoundError:
        raise AtcError(f"{path}: no such {what} file") from None
    except IsADirectoryError:
        raise AtcError(f"{path}: is a directory, expected a {what} (a TOML file)") from None
    except UnicodeDecodeError:
        raise AtcError(f"{path}: is not a text file, expected a {what} (a TOML file)") from None
    except OSError as e:
        raise AtcError(f"{path}: cannot be read: {e.strerror}") from None


@dataclass
class Document:
    """A TOML file that knows where its keys stand.

    Attributes
    ----------
    data : {section: {key: value}}; lists of such tables for the sections that may be repeated
    folder : where relative paths start
    name : what to call it in messages
    """

    #: what such a file is, a key of it with a value, its sections and keys, and of those that may be repeated
    what: ClassVar[str]
    example: ClassVar[str]
    #: what writes one, as the end of a message
    begun_by: ClassVar[str] = ""
    tables: ClassVar[dict[str, dict[str, Key]]]
    arrays: ClassVar[dict[str, dict[str, Key]]] = {}

    data: dict[str, Any]
    folder: Path = field(default_factory=Path, compare=False)
    name: str = field(default="", compare=False)
    #: lines of keys by their path, the flags that set some, the text
    lines: dict[tuple[str, ...], int] = field(default_factory=dict, repr=False, compare=False)
    flags: dict[tuple[str, ...], str] = field(default_factory=dict, repr=False, compare=False)
    text: str = field(default="", repr=False, compare=False)

    def __post_init__(self):
        self.name = self.name or self.what

    @classmethod
    def load(cls, source: str | os.PathLike | Mapping, overrides: Mapping[str, Any] | list[str] | None = None) -> Self:
        """Read and check a file.

        Parameters
        ----------
        source : path of a TOML file, a mapping of sections, or another such document
        overrides : ``{"kernel.radius": 10}`` or ``["kernel.radius=10"]`` (the value as TOML, or a bare word)

        Raises
        ------
        AtcError : naming file, line and key, for anything unknown, missing or malformed
        """
        if isinstance(source, cls):
            return source.instead(source.data, overrides)
        if isinstance(source, Mapping):
            return cls(_copied(source))._made(overrides)
        path = Path(source)
        return cls.loads(read_document(path, cls.what), str(path), path.parent, overrides)

    @classmethod
    def loads(cls, text: str, name: str = "", folder: str | os.PathLike = ".", overrides=None) -> Self:
        """Check what is given as TOML text."""
        try:
            data = parse(text)
        except tomllib.TOMLDecodeError as e:
            instead = "" if Path(name).suffix in (".toml", "") else cls.begun_by
            raise AtcError(complaint(name or cls.what, text, e) + instead) from None
        return cls(data, Path(folder), name, key_lines(text), text=text)._made(overrides)

    def instead(self, data, overrides=None) -> Self:
        """The same document with other data."""
        new = self.load(data, overrides)
        new.folder, new.name, new.lines, new.text = self.folder, self.name, self.lines, self.text
        return new

    def _made(self, overrides=None) -> Self:
        """Itself with the overrides, checked."""
        self._check_sections()
        for (section, key), value, flag in overridden(overrides, self):
            self.data.setdefault(section, {})[key] = value
            self.flags[section, key] = flag
        self.check()
        return self

    def _check_sections(self) -> None:
        known = [*self.tables, *self.arrays]
        for section, value in self.data.items():
            at = self.where(section)
            if section not in known:
                raise AtcError(f"{at}: {unknown(f'section [{section}]', section, known)}")
            if section in self.arrays and isinstance(value, dict):
                # One table where several are allowed.
                self.data[section] = [value]
                self.lines |= {(section, "0", *p[1:]): n for p, n in self.lines.items() if p[0] == section}
            elif not isinstance(value, list if section in self.arrays else dict):
                raise AtcError(f"{at}: {section} must be a section: write [{section}] and its keys below")
            elif section in self.arrays and not all(isinstance(v, dict) for v in value):
                raise AtcError(f"{at}: {section} must be sections: write [[{section}]] and the keys of each below")

    def check(self) -> None:
        """Raise for what is no value of its key, and for keys that do not go together."""
        raise NotImplementedError

    def check_table(self, path: tuple, table: dict, known: Mapping[str, Key], why: Callable | None = None) -> None:
        """Put what its keys take in the place of their values; `why(key)` : why one is not known, where it is not a
        slip."""
        for key in list(table):
            if key not in known:
                what = f"key {key!r} in [{path[0]}]"
                said = f"unknown {what}: {reason}" if why and (reason := why(key)) else unknown(what, key, known)
                raise AtcError(f"{self.where(*path, key)}: {said}")
            self.check_value(known[key], table, key, (*path, key))

    def where(self, *path: str) -> str:
        """``file:line`` of a key or section, or the flag that set it."""
        if path in self.flags:
            return self.flags[path]
        while path:
            if path in self.lines:
                return f"{self.name}:{self.lines[path]}"
            path = path[:-1]
        return self.name

    def bad(self, path: tuple, why) -> AtcError:
        """An error at a key: `path` = (section, key) or (section, number, key)."""
        return AtcError(f"{self.where(*map(str, path))}: [{path[0]}] {path[-1]}: {why}")

    def wrong(self, path: tuple, why) -> AtcError:
        """An error of a section, said with the line of `path` = (section,), (section, number) or (section, key)."""
        return AtcError(f"{self.where(*path)}: [{path[0]}] {why}")

    @contextmanager
    def value_of(self, *path):
        """An error of a lower floor is what is wrong with the value of this key."""
        try:
            yield
        except AtcError as e:
            raise self.bad(path, e) from None

    @contextmanager
    def placed_at(self, section, key=None):
        """An error of a lower floor is said with the line of this key; else of the section's key that it speaks of (or
        of the section)."""
        try:
            yield
        except AtcError as e:
            spoken = [k for k in self.data.get(section, {}) if k != "name" and k in str(e)] if key is None else [key]
            where = self.where(section, spoken[0]) if len(spoken) == 1 else self.where(section)
            raise AtcError(f"{where}: [{section}] {e}") from None

    def need(self, section: str, what: str) -> AtcError:
        """An error for what a section lacks."""
        return AtcError(
            f"{self.where(section)}: {what}" if section in self.data else f"{self.name}: no [{section}] section: {what}"
        )

    def check_value(self, spec: Key, table: dict, key: str, path: tuple) -> None:
        """Put what the `spec` of a key makes of its value in its place."""
        value = table[key]
        try:
            table[key] = spec.check(value)
        except (ValueError, TypeError) as e:
            # int("abc") and its like bring Python's own words, which help nobody.
            reason = f" ({e})" if str(e) and "literal" not in str(e) else ""
            raise self.bad(path, f"expected {spec.expected}, got {shown(value)}{reason}") from None

    def get(self, section: str, key: str, default=None):
        """The value of a key of a section that is there once, or `default`."""
        return self.data.get(section, {}).get(key, default)

    def path(self, section: str, key: str) -> Path | None:
        """A file name, relative to the document's folder unless absolute."""
        value = self.get(section, key)
        return None if value is None else self.folder / Path(value).expanduser()

    def paths(self, section: str, key: str) -> list[Path]:
        """The file names of a key that holds one or a list."""
        given = self.get(section, key) or []
        return [self.folder / Path(name).expanduser() for name in (given if isinstance(given, list) else [given])]

    def output(self, given=None, overwrite: bool = False, resume: bool = False) -> Path:
        """The file to write: `given`, else ``[output] file``. Whether it can be written is found out here, before
        anything is computed; with `resume` it may be that of a run which only has to clear away."""
        from ..running.store import require_place

        path, where = self.result(given)
        require_place(path, where, overwrite, resume)
        return path

    def result(self, given=None) -> tuple[Path, str]:
        """The file to write: `given`, else ``[output] file``; and what says so."""
        if given is not None:
            return Path(given), f"-o {given}"
        path = self.path("output", "file")
        if path is None:
            raise self.need("output", 'say where the result goes: -o OUT, or file = "out.zarr" in [output]')
        return path, self.where("output", "file") + ": [output] file"


def _copied(value):
    if isinstance(value, Mapping):
        return {k: _copied(v) for k, v in value.items()}
    return [_copied(v) for v in value] if isinstance(value, (list, tuple)) else value
