"""TOML beyond `tomllib`: on which line a key stands, what was wrong in plain words, and writing values."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Mapping
from datetime import date, time
from pathlib import Path
from typing import Any

from ..errors import AtcError

#: Bytes of the largest scene or case.
LONGEST = 1 << 24

# --------------------------------------------------------------------------------------------------------------------
# Where in the text a key stands.


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """Line numbers (from 1) of every table header and key of a TOML text, by dotted path: ``("kernel", "radius") → 7``.

    Tables of an array, ``[[wall]]``, are numbered: ``("wall", "0", "normal") → 12``.

    A scan, not a parser: it is only asked about texts that `tomllib` has already accepted.
    """
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    counts: dict[tuple[str, ...], int] = {}
    depth, quote, number, i, n = 0, "", 1, 0, len(text)
    line_start = True
    while i < n:
        c = text[i]
        if quote:  # inside a string, maybe one that runs over lines
            if c == "\\" and quote[0] == '"':
                number += text[i + 1 : i + 2] == "\n"
                i += 2
                continue
            if text.startswith(quote, i):
                i += len(quote)
                while (
                    len(quote) == 3 and text[i : i + 1] == quote[0]
                ):  # a multi-line string may end in up to two quotes of its own
                    i += 1
                quote = ""
                continue
        elif c == "#":
            i = text.find("\n", i)
            if i < 0:
                break
            continue
        elif line_start and depth == 0 and not c.isspace():
            end = text.find("\n", i)
            head = text[i : end if end >= 0 else n]
            if c == "[":
                table, _ = _dotted(head.strip("[ \t"))
                found.setdefault(table, number)
                if head.startswith("[["):
                    array, count = table, counts.get(table, 0)
                    counts[array], table = count + 1, (*array, str(count))
                    found[table] = number
                i = end if end >= 0 else n
                continue
            path, length = _dotted(head)
            for k in range(1, len(path) + 1):
                found.setdefault(table + path[:k], number)
            line_start = False
            i += length
            continue
        elif c in "\"'":
            quote = c * 3 if text.startswith(c * 3, i) else c
            i += len(quote)
            continue
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "\n":
            number += 1
            line_start = True
        i += 1
    return found


def _dotted(head: str) -> tuple[tuple[str, ...], int]:
    """The dotted key at the start of `head`, up to ``=`` or ``]``, and how many characters it takes with that."""
    parts, part, quote, length = [], "", "", 0
    for c in head:
        length += 1
        if quote:
            if c == quote:
                quote = ""
            else:
                part += c
        elif c in "\"'":
            quote = c
        elif c in "=]#":
            break
        elif c == ".":
            parts.append(part)
            part = ""
        elif not c.isspace():
            part += c
    return (*parts, part), length


# --------------------------------------------------------------------------------------------------------------------
# What scenes and peridynamic cases share.


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

    def result(self, given=None) -> tuple[Path, str]:
        """The file to write: `given`, else ``[output] file``; and what says so."""
        if given is not None:
            return Path(given), f"-o {given}"
        path = self.path("output", "file")
        if path is None:
            raise self.need("output", 'say where the result goes: -o OUT, or file = "out.zarr" in [output]')
        return path, self.where("output", "file") + ": [output] file"


# --------------------------------------------------------------------------------------------------------------------
# Writing TOML.


def _toml_string(s: str, over_lines: bool = False) -> str:
    escapes = {"\\": "\\\\", '"': '\\"', "\b": "\\b", "\t": "\\t", "\f": "\\f", "\r": "\\r"}
    escapes["\n"] = "\n" if over_lines else "\\n"
    out = "".join(escapes.get(c) or (f"\\u{ord(c):04X}" if ord(c) < 32 or ord(c) == 127 else c) for c in s)
    return f'"""\n{out}"""' if over_lines else f'"{out}"'


def toml_key(k: str) -> str:
    """A key as TOML writes it, in quotes where it needs them."""
    bare = k and all(c.isascii() and (c.isalnum() or c in "-_") for c in k)
    return k if bare else _toml_string(k)


def toml_value(v) -> str:
    """One value as TOML."""
    if isinstance(v, bool):
        return "true" if v else "false"
    if isinstance(v, (int, float)):
        return repr(v)
    if isinstance(v, str):
        return _toml_string(v, over_lines="\n" in v)
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(toml_value(x) for x in v) + "]"
    if isinstance(v, Mapping):
        return "{ " + ", ".join(f"{toml_key(str(k))} = {toml_value(x)}" for k, x in v.items()) + " }"
    if isinstance(v, (date, time)):  # a datetime is a date
        return v.isoformat()
    raise TypeError(f"{type(v).__name__} has no TOML form")


def toml_document(sections: Mapping[str, Mapping]) -> str:
    """Sections as TOML, empty ones left out; what stands at the key "#" as a comment."""
    out = []
    for name, table in sections.items():
        if table:
            lines = (f"# {v}" if k == "#" else f"{toml_key(k)} = {toml_value(v)}" for k, v in table.items())
            out += [f"[{name}]", *lines, ""]
    return "\n".join(out)


def shown(value) -> str:
    """A value in a message: as TOML where it has such a form, in one line, not long."""
    try:
        text = toml_value(value)
    except TypeError:
        text = str(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def parse(text: str) -> dict:
    """`tomllib.loads`, whose only exception is `tomllib.TOMLDecodeError`."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise tomllib.TOMLDecodeError("brackets are nested too deeply") from None


def complaint(name: str, text: str, e: Exception) -> str:
    """tomllib's complaint with the line first, and what most often is the reason."""
    message = str(e)
    line = getattr(e, "lineno", None)
    if line is None and "(at line " in message:
        line = int(message.rpartition("(at line ")[2].split(",")[0])
    elif line is None and "(at end of document)" in message:
        line = text.count("\n") + 1
    reason = message.rpartition(" (at ")[0] or message
    source = text.split("\n")[line - 1].strip() if line and line <= text.count("\n") + 1 else ""
    value = source.partition("=")[2].strip()
    if reason == "Invalid value" and value[:1].isalpha():
        reason = f"invalid value {value[:40]}: text needs quotes"
    return f"{name}{f':{line}' if line else ''}: not valid TOML: {reason[:1].lower() + reason[1:]}"
