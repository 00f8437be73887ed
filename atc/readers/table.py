"""Tables of white-space separated columns, as dumps, YAML dumps and XYZ files hold them: from bytes to arrays, every
fault with its line."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..errors import AtcError
from . import _parse
from ._parse import FLOAT, INT, TEXT

#: No name of an element or type is longer: what is, is damage (and a table of texts takes rows times the longest).
LONGEST_WORD = 256


def parse_columns(buf, names, kinds, n: int, where: Callable[[int], str], finite=frozenset(), of: str = "") -> dict:
    """The `n` lines of a table at the start of `buf` as {name: (n,) array}.

    Parameters
    ----------
    buf : uint8 array that holds the lines, each with its line end
    names, kinds : the columns, each FLOAT, INT or TEXT
    where : row -> what to call its line in messages, e.g. ``"run.dump, frame 3, line 17"``
    finite : names of columns in which NaN and infinity are errors
    of : what messages say behind a column's name, such as " of section Atoms"

    Raises
    ------
    AtcError
        A line with another number of columns, a word that is no number where one is expected, or not finite.
    """
    kinds = list(kinds)
    # Each word takes two bytes: lines that are too short are found before room is made for what they announce.
    if 2 * len(kinds) * n > len(buf):
        row, line = _first_short(buf, len(kinds), n)
        raise _miscounted(where(row), names, line, of)
    count = [0, 0, 0]
    slots = []
    for kind in kinds:
        slots.append(count[kind])
        count[kind] += 1
    floats = np.empty((n, count[FLOAT]))
    ints = np.empty((n, count[INT]), np.int64)
    texts = np.empty((n, count[TEXT], 2), np.int64)
    hard = np.empty((max(4096, 2 * len(kinds)), 4), np.int64)
    kind_k, slot_k = np.array(kinds, np.int64), np.array(slots, np.int64)
    status, row, pos = _parse.FULL, 0, 0
    while status == _parse.FULL:
        status, row, pos, n_hard = _parse.read_table(buf, pos, kind_k, slot_k, row, n, floats, ints, texts, hard)
        for r, c, a, b in hard[:n_hard].tolist():
            word, name = buf[a : min(b, a + 400)].tobytes(), f"{names[c]!r}{of}"
            value = convert(word, kinds[c], name, lambda r=r: where(r), names[c] in finite)
            (ints if kinds[c] == INT else floats)[r, slots[c]] = value
    if status != _parse.DONE:
        raise _miscounted(where(row), names, buf[pos : pos + 4096].tobytes().split(b"\n", 1)[0], of)
    out = {}
    for name, kind, slot in zip(names, kinds, slots):
        out[name] = (
            words(buf, texts[:, slot], name, where) if kind == TEXT else (floats if kind == FLOAT else ints)[:, slot]
        )
    return out


def convert(token: bytes, kind: int, name: str, where: Callable[[], str], finite: bool = False):
    """One word as a float or int, for those that the kernel leaves to Python: over-long ones, and what is none."""
    text = token.decode("utf-8", "replace")
    try:
        if not token.isascii() or "_" in text:
            raise ValueError
        value = float(text)
        if kind == INT:
            if not (value.is_integer() and abs(value) < 2**63):
                raise ValueError
            exact = int(text) if text.lstrip("+-").isdigit() else int(value)
            if not -(2**63) <= exact < 2**63:
                raise ValueError
            return exact
    except (ValueError, OverflowError):
        raise AtcError(
            f"{where()}: column {name} holds {text[:40]!r}, expected {'an integer' if kind == INT else 'a number'}"
        ) from None
    if finite and not np.isfinite(value):
        raise AtcError(f"{where()}: column {name} holds {text!r}; the run that wrote it has probably blown up")
    return value


def words(buf, ranges, name: str, where: Callable[[int], str]) -> np.ndarray:
    """The texts at byte ranges (n, 2) of `buf`, through their distinct values: a column holds few different ones."""
    n = len(ranges)
    if not n:
        return np.array([], dtype="U1")
    lengths = ranges[:, 1] - ranges[:, 0]
    width = int(lengths.max())
    if width > LONGEST_WORD:
        raise AtcError(
            f"{where(int(lengths.argmax()))}: column {name!r} holds a word of {width} letters; the file is damaged"
        )
    at = ranges[:, :1] + np.arange(width)
    chars = np.where(at < ranges[:, 1:], buf[np.minimum(at, len(buf) - 1)], 0).astype(np.uint8)
    return np.char.decode(np.ascontiguousarray(chars).view(f"S{width}")[:, 0], "utf-8", "replace")


def is_number(token: bytes) -> bool:
    """Whether a word is a number as C prints them."""
    try:
        float(token)
    except ValueError:
        return False
    return b"_" not in token


def _first_short(buf, n_columns, n):
    text = buf.tobytes()
    start = 0
    for row in range(n):
        end = text.find(b"\n", start)
        line = text[start : end if end >= 0 else len(text)]
        if len(line[:4096].split()) < n_columns or end < 0:
            return row, line
        start = end + 1
    return 0, b""


def _miscounted(where, names, line: bytes, of: str) -> AtcError:
    text = line.decode("utf-8", "replace").strip()
    columns = " ".join(names)
    columns = columns if len(columns) <= 200 else columns[:200] + " …"
    got = f"'{text[:60]}{'…' if len(text) > 60 else ''}'"
    return AtcError(f"{where}: expected {len(names)} columns ({columns}){of}, got {len(text.split())}: {got}")
