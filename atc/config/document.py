"""What scenes and peridynamic cases share: a TOML file that knows where its keys stand."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import AtcError
from .toml import LONGEST, shown


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


class Document:
    """A TOML file that knows where its keys stand: `data`, its `name` and `folder`, lines by path in `_lines`, and the
    flags that set keys in `_flags`."""

    name: str
    folder: Path
    data: dict[str, Any]
    _lines: dict[tuple[str, ...], int]
    _flags: dict[tuple[str, ...], str]

    def where(self, *path: str) -> str:
        """``file:line`` of a key or section, or the flag that set it."""
        if path in self._flags:
            return self._flags[path]
        while path:
            if path in self._lines:
                return f"{self.name}:{self._lines[path]}"
            path = path[:-1]
        return self.name

    def bad(self, path: tuple, why) -> AtcError:
        """An error at a key: `path` = (section, key) or (section, number, key)."""
        return AtcError(f"{self.where(*map(str, path))}: [{path[0]}] {path[-1]}: {why}")

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

    def check_value(self, spec, table: dict, key: str, bad: Callable[[str], AtcError]) -> None:
        """Put what the `spec` of a key makes of its value in its place, or raise what `bad` makes of the reason."""
        value = table[key]
        try:
            table[key] = spec.check(value)
        except (ValueError, TypeError) as e:
            # int("abc") and its like bring Python's own words, which help nobody.
            reason = f" ({e})" if str(e) and "literal" not in str(e) else ""
            raise bad(f"expected {spec.expected}, got {shown(value)}{reason}") from None

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

    def result(self, given=None) -> tuple[Path, str]:
        """The file to write: `given`, else ``[output] file``; and what says so."""
        if given is not None:
            return Path(given), f"-o {given}"
        path = self.path("output", "file")
        if path is None:
            raise self.need("output", 'say where the result goes: -o OUT, or file = "out.zarr" in [output]')
        return path, self.where("output", "file") + ": [output] file"
