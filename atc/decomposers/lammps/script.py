"""The words of LAMMPS input scripts: continued lines, quotes, comments; files that can be read."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from ...errors import AtcError
from .commands import CLASSES

#: A script, or an included file, is no longer than this (bytes): what is, is something else.
LONGEST = 1 << 24
_LONGEST_MESSAGE = 2000
_QUOTES = ('"""', '"', "'")


@dataclass(frozen=True)
class Command:
    """One executed command: its name, the words behind it with variables put in, and the file and line it came from.

    unknown : why the words are not known, if variables that only the run knows are among them; the words then have
        these as they stand
    """

    name: str
    words: tuple[str, ...]
    where: str
    unknown: str | None = None

    def error(self, message: str) -> AtcError:
        return AtcError(f"{self.where}: {message}")


@dataclass(frozen=True)
class Line:
    """A logical line: text without its comment, and what to call it in messages."""

    text: str
    where: str

    error = Command.error

    @property
    def head(self) -> str:
        return self.text.split(None, 1)[0]


def span_of(word: str, lowest: int = 1) -> tuple[int, int | None] | None:
    """First and last (None: open) of ``3``, ``*``, ``2*``, ``*3`` or ``1*3``; None for words that are no such range."""
    m = re.fullmatch(r"(\d{0,18})(\*?)(\d{0,18})", word)
    if not m or not word or (not m.group(2) and m.group(3)):
        return None
    lo = int(m.group(1) or lowest)
    return lo, lo if not m.group(2) else int(m.group(3)) if m.group(3) else None


def short(where: str) -> str:
    """File and line without the folder: what is kept with results names no user."""
    file, comma, line = where.rpartition(", line ")
    return f"{Path(file).name}{comma}{line}" if comma else where


@contextmanager
def one_line():
    """Words of a script may hold line ends (in triple quotes); messages about them do not, and are no longer than need
    be."""
    try:
        yield
    except AtcError as e:
        message = " ".join(str(e).split())
        if len(message) > _LONGEST_MESSAGE:
            message = message[: _LONGEST_MESSAGE - 3] + "..."
        raise AtcError(message) from None


def is_text(source: str) -> bool:
    """Whether a string holds LAMMPS lines rather than a path."""
    if "\n" in source:
        return True
    first = source.split()
    return len(first) > 1 and first[0] in CLASSES


def _quote_at(text: str, p: int) -> str:
    return next((q for q in _QUOTES if text.startswith(q, p)), "")


def logical_lines(text: str, name: str) -> list[Line]:
    """Lines joined at a trailing ``&`` and inside triple quotes, without comments and empty lines."""
    return list(_lines(text, name))


def _lines(text: str, name: str) -> Iterator[Line]:
    parts: list[str] = []
    first, quote, comment = 0, "", False
    for number, raw in enumerate(text.split("\n"), 1):
        first = first or number
        stripped = raw.rstrip()
        continued = stripped.endswith("&")
        piece = stripped[:-1] if continued else raw.rstrip("\r")
        # How far the piece is no comment, and in which quotes it ends.
        p = 0
        while p < len(piece) and not comment:
            if quote:
                end = piece.find(quote, p)
                p = len(piece) if end < 0 else end + len(quote)
                quote = quote if end < 0 else ""
                continue
            if piece[p] == "#":
                comment = True
                break
            quote = _quote_at(piece, p)
            p += len(quote) or 1
        parts.append(piece[:p])
        if continued:
            continue
        if quote == '"""' and not comment:
            parts.append("\n")
            continue
        line = "".join(parts)
        if line.strip():
            yield Line(line, f"{name}, line {first}")
        parts, first, quote, comment = [], 0, "", False
    line = "".join(parts)
    if line.strip():
        yield Line(line, f"{name}, line {first}")


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
            q = _quote_at(text, p)
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


def read_text(path: Path, where: str | None = None) -> str:
    """A text file, or an AtcError that says what is wrong with it."""
    prefix = f"{where}: " if where else ""
    try:
        found = Path(path).stat()
        if stat.S_ISDIR(found.st_mode):
            raise IsADirectoryError
        if not stat.S_ISREG(found.st_mode):
            raise AtcError(f"{prefix}{path}: is no ordinary file, expected a file with LAMMPS lines")
        if found.st_size > LONGEST:
            raise AtcError(f"{prefix}{path}: has {found.st_size} bytes, too many for a file with LAMMPS lines")
        text = Path(path).read_bytes()
    except FileNotFoundError:
        raise AtcError(f"{prefix}{path}: no such file") from None
    except IsADirectoryError:
        raise AtcError(f"{prefix}{path}: is a folder, expected a file with LAMMPS lines") from None
    except (OSError, ValueError) as e:
        raise AtcError(f"{prefix}{str(path)[:200]!r}: cannot be read: {getattr(e, 'strerror', None) or e}") from None
    if b"\0" in text[:4096]:
        raise AtcError(f"{prefix}{path}: holds binary data, expected a file with LAMMPS lines")
    return text.decode("utf-8", "replace")
