"""Files of LAMMPS's that have a header and named sections (data files, molecule files): where everything is, as LAMMPS
looks for it.

The first line is a title. Lines of the header end in a keyword that is known; the first that is none, is the name of a
section. Names stand alone in a line, blanks around them and a comment behind them do not count, and inside they have
one blank. Lines of a section are counted without blank and comment lines.
"""

from __future__ import annotations

import re

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from .. import _parse
from ..trajectory import warn
from ..whole import whole_bytes

_MANY = 100_000  # lines that begin with a letter: names of sections, and rows that begin with a type label
# |x|³ and 1/|x|³ of what is not larger than this, in any units, can still be computed with.
_HUGE = 1e80


@njit(cache=True, nogil=True, error_model="numpy")
def _worded(buf, at):
    """Beginnings of the lines from position `at` on that start with a letter (behind blanks), and of the lines before
    and behind that are not blank."""
    out, n = np.empty(_MANY + 1, np.int64), 0
    size = len(buf)
    while at < size:
        p = at
        while buf[p] == 32 or buf[p] == 9 or buf[p] == 13:
            p += 1
        c = buf[p] | 32
        if 97 <= c <= 122:
            out[n] = at
            n += 1
            if n > _MANY:
                return out[:n]
        while buf[p] != 10:
            p += 1
        at = p + 1
    return out[:n]


@njit(cache=True, nogil=True, error_model="numpy")
def _lines_between(buf, begin, end):
    n = 0
    for k in range(begin, end):
        n += buf[k] == 10
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _filled(buf, begin, end, out, number, out_number):
    """Copy the lines of buf[begin:end] that hold more than blanks and comments, without the latter. Returns (lines,
    bytes)."""
    rows = 0
    p = begin
    m = 0
    while p < end:
        start = m
        seen = False
        comment = False
        while buf[p] != 10:
            c = buf[p]
            if c == 35:
                comment = True
            if not comment:
                seen |= c > 32
                out[m] = 32 if c == 11 or c == 12 else c
                m += 1
            p += 1
        p += 1
        if seen:
            out[m] = 10
            m += 1
            out_number[rows] = number
            rows += 1
        else:
            m = start
        number += 1
    return rows, m


@njit(cache=True, nogil=True, error_model="numpy")
def _first_short(buf, columns):
    """The first line with fewer words, and where it begins."""
    p, row = 0, 0
    while p < len(buf):
        line, words, inside = p, 0, False
        while buf[p] != 10:
            blank = buf[p] <= 32
            words += inside and blank
            inside = not blank
            p += 1
        words += inside
        if words < columns:
            return row, line
        p += 1
        row += 1
    return -1, 0


class Section:
    """The lines of a section: ``buf`` without blanks and comments, ``number`` of each line in the file."""

    def __init__(self, name, comment, line, buf, number, source, last):
        self._last = last  # whether its last line is the last of the file
        self.name, self.comment, self.line = name, comment, line
        self.buf, self.number, self.source = buf, number, source

    def __len__(self):
        return len(self.number)

    def require(self, expected: int | None, what: str = "its header announces") -> None:
        if expected is not None and len(self) == expected + 1 and self._last and expected:
            # LAMMPS does not notice a single line behind the last section.
            warn(
                f"{self.where(expected)}: section {self.name} has one line more than the {expected} that the header "
                "announces: left out, as by LAMMPS"
            )
            self.buf = self.buf[: _parse.skip_lines(self.buf, expected)[0]]
            self.number = self.number[:expected]
        if expected is not None and len(self) != expected:
            at = self.number[min(expected, len(self) - 1)] if len(self) else self.line
            raise AtcError(
                f"{self.source}, line {at}: section {self.name} has {len(self)} lines, {what} {expected}; the file is "
                "cut off or damaged"
            )

    def rows(self, most: int | None = None) -> list[list[str]]:
        """The words of each line, of the first `most`."""
        buf = self.buf
        if most is not None and most < len(self):
            buf = buf[: _parse.skip_lines(buf, most)[0]]
        text = buf.tobytes().decode("utf-8", "replace")
        return [line.split() for line in text.split("\n")[:-1]]

    def where(self, row: int) -> str:
        return f"{self.source}, line {self.number[row]}"

    def table(self, columns, whole, label=None) -> dict:
        """The columns by name: int64 where they are in `whole`, float64 otherwise. label : {name: number} that words of
        the column "type" may be."""
        n, buf, name = len(self), self.buf, self.name
        if len(buf) < 2 * n * len(columns):
            row, at = _first_short(buf, len(columns))
            self._wrong_width(columns, row, at)
        kinds = [_parse.INT if c in whole or c == "type" else _parse.FLOAT for c in columns]
        if label and "type" in columns:
            kinds[columns.index("type")] = _parse.TEXT
        slots = [sum(k == kinds[c] for k in kinds[:c]) for c in range(len(kinds))]
        floats = np.empty((n, kinds.count(_parse.FLOAT)))
        ints = np.empty((n, kinds.count(_parse.INT)), np.int64)
        texts = np.empty((n, kinds.count(_parse.TEXT), 2), np.int64)
        hard = np.empty((4096, 4), np.int64)
        status, row, pos = _parse.FULL, 0, 0
        while status == _parse.FULL:
            status, row, pos, n_hard = _parse.read_table(
                buf, pos, np.array(kinds), np.array(slots), row, n, floats, ints, texts, hard
            )
            for r, c, a, b in hard[:n_hard].tolist():
                word = buf[a:b].tobytes().decode("utf-8", "replace")
                if kinds[c] == _parse.INT:
                    ints[r, slots[c]] = self._whole(word, r, columns[c])
                else:
                    floats[r, slots[c]] = self._number(word, r, columns[c])
        if status != _parse.DONE:
            self._wrong_width(columns, row, pos)
        if floats.size and (top := np.abs(floats).max()) > _HUGE:
            r, s = np.argwhere(np.abs(floats) == top)[0]
            c = next(k for k in range(len(kinds)) if kinds[k] == _parse.FLOAT and slots[k] == s)
            raise AtcError(
                f"{self.where(r)}: {floats[r, s]:g} for {columns[c]!r} in section {name} is no number that atoms have"
            )
        out = {}
        for c, kind, slot in zip(columns, kinds, slots, strict=True):
            if kind == _parse.TEXT:
                out[c] = self._labelled(texts[:, slot], label)
            else:
                out[c] = (floats if kind == _parse.FLOAT else ints)[:, slot].copy()
        return out

    def _wrong_width(self, columns, row, at):
        end = at + int(np.argmax(self.buf[at:] == 10))
        line = self.buf[at:end].tobytes().decode("utf-8", "replace").strip()
        raise AtcError(
            f"{self.where(row)}: expected {len(columns)} columns ({' '.join(columns)}) in section {self.name}, got "
            f"{len(line.split())}: '{shortened(line)}'"
        )

    def _number(self, word, row, column) -> float:
        value = number_of(word)
        if value is None:
            raise AtcError(
                f"{self.where(row)}: expected a finite number for {column!r} in section {self.name}, got "
                f"{shortened(word)!r}"
            )
        return value

    def _whole(self, word, row, column) -> int:
        value = whole_of(word)
        if value is None:
            raise AtcError(
                f"{self.where(row)}: expected an integer for {column!r} in section {self.name}, got {shortened(word)!r}"
            )
        return value

    def _labelled(self, spans, label):
        known = {}
        out = np.empty(len(spans), np.int64)
        for k, (a, b) in enumerate(spans.tolist()):
            word = self.buf[a:b].tobytes()
            if word not in known:
                text = word.decode("utf-8", "replace")
                known[word] = label[text] if text in label else whole_of(text)
                if known[word] is None:
                    raise AtcError(
                        f"{self.where(k)}: {shortened(text)!r} is neither a number nor one of the file's Type Labels"
                    )
            out[k] = known[word]
        return out


def number_of(word: str) -> float | None:
    """A finite number as LAMMPS writes them; None for anything else, also for what only Python takes for one."""
    try:
        value = float(word)
    except ValueError:
        return None
    return value if np.isfinite(value) and word.isascii() and "_" not in word else None


def whole_of(word: str) -> int | None:
    """An integer that 64 bits can hold."""
    if re.fullmatch(r"[-+]?\d{1,4000}", word, re.ASCII):
        value = int(word)
    else:
        f = number_of(word)
        if f is None or not f.is_integer():
            return None
        value = int(f)
    return value if abs(value) < 2**63 else None


def shortened(text: str, most: int = 60) -> str:
    """What a message shows of words from a file: the beginning, and only what can be printed."""
    text = "".join(c if c.isprintable() else "\N{REPLACEMENT CHARACTER}" for c in text[: most + 1])
    return text if len(text) <= most else f"{text[:most]}..."


class SectionedFile:
    """Header lines and sections of a file.

    Parameters
    ----------
    path : plain or compressed
    names : the sections that LAMMPS knows in such a file
    is_header : whether a line (without comment) belongs to the header

    Attributes
    ----------
    title : the first line. header : [(number, line without comment)]
    places : {name: (begin, end, comment, line)} in the order of the file, `others` of them with names that LAMMPS does
        not know
    """

    def __init__(self, path, names, is_header, what: str):
        self.source, self.names, self.what = str(path), frozenset(names), what
        self._buf = whole_bytes(path)
        self._alike = {re.sub(r"\s", "", n).lower(): n for n in names}
        first = self._end_of_line(0)
        self.title = self._text(0, first)
        self.header = []
        at, number = first, 2
        size = len(self._buf)
        while at < size:
            end = self._end_of_line(at)
            line = self._text(at, end).split("#")[0].rstrip()
            if line.strip():
                if not is_header(line):
                    break
                self.header.append((number, line))
            at, number = end, number + 1
        self._body, self._body_line = at, number
        self._find_sections()

    def _end_of_line(self, at: int) -> int:
        step = 256
        while True:
            found = np.flatnonzero(self._buf[at : at + step] == 10)
            if len(found):
                return at + int(found[0]) + 1
            if at + step >= len(self._buf):
                return len(self._buf)
            step *= 8

    def _text(self, a: int, b: int) -> str:
        return self._buf[a:b].tobytes().decode("utf-8", "replace").rstrip("\r\n")

    def _line_of(self, position: int) -> int:
        return self._body_line + _lines_between(self._buf, self._body, position)

    def _find_sections(self):
        self.places, self.others = {}, []
        starts = _worded(self._buf, self._body)
        if len(starts) > _MANY:
            raise AtcError(f"{self.source}: more than {_MANY} lines of words: it is no {self.what}")
        found = []
        for at in starts.tolist():
            end = self._end_of_line(at)
            line = self._text(at, end)
            name, _, comment = line.partition("#")
            name = name.strip()
            if name in self.names or ((at == self._body or self._alone(at, end)) and self._names_something(name, at)):
                found.append((at, end, name, comment.strip()))
        if self._body < len(self._buf) and (not found or found[0][0] != self._body):
            line = shortened(self._text(self._body, self._end_of_line(self._body)).strip())
            raise AtcError(
                f"{self.source}, line {self._body_line}: {line!r} is neither a header line nor the name of a section "
                f"of a LAMMPS {self.what}"
            )
        for k, (at, end, name, comment) in enumerate(found):
            stop = found[k + 1][0] if k + 1 < len(found) else len(self._buf)
            if name in self.places:
                raise AtcError(f"{self.source}, line {self._line_of(at)}: a second '{name}' section")
            self.places[name] = (end, stop, comment, at)
            if name not in self.names:
                self.others.append(name)

    def _names_something(self, name: str, at: int) -> bool:
        """Whether a line of words is the name of a section that LAMMPS does not know itself (of a fix); an error if it
        is meant to be one that it knows."""
        if not re.fullmatch(r"[A-Za-z][A-Za-z_/-]*([ \t]+[A-Za-z_/-]+)*|[A-Za-z]\S*", name):
            return False
        alike = self._alike.get(re.sub(r"\s", "", name).lower())
        if alike is not None:
            raise AtcError(
                f"{self.source}, line {self._line_of(at)}: section {shortened(name)!r}: LAMMPS wants it written "
                f"{alike!r}"
            )
        return True

    def _alone(self, at: int, end: int) -> bool:
        """Whether the lines before and behind are blank."""
        before = at - 1
        while before > 0 and self._buf[before - 1] in (32, 9, 13):
            before -= 1
        return (before <= 0 or self._buf[before - 1] == 10) and not self._text(end, self._end_of_line(end)).strip()

    def section(self, name: str) -> Section:
        begin, end, comment, at = self.places[name]
        line = self._line_of(begin)
        first = self._text(begin, self._end_of_line(begin)) if begin < end else ""
        if first.strip()[:1].isalpha():  # LAMMPS skips the line behind a name, which may hold the names of the columns
            begin, line = self._end_of_line(begin), line + 1
        n = _lines_between(self._buf, begin, end)
        out, number = np.empty(end - begin, np.uint8), np.empty(n, np.int64)
        rows, size = _filled(self._buf, begin, end, out, line, number)
        last = end == len(self._buf) and rows and number[rows - 1] == line + n - 1
        return Section(name, comment, line - 1, out[:size], number[:rows], self.source, bool(last))
