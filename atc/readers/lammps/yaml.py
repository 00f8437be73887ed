"""LAMMPS dumps in YAML (``dump yaml``), plain or compressed: one document a frame, read without a YAML parser, which
would take minutes."""

from __future__ import annotations

import re
from functools import partial

import numpy as np

from ...errors import AtcError
from ..table import TEXT, parse_columns
from .dump import Header, LammpsDump, Truncated, count_of, finite, number, whole

# "  - [ 1 , 2 , 0.5, ]" becomes "  -   1   2   0.5    ": a table whose first column is the dash.
_BLANKS = bytes(range(256)).translate(bytes.maketrans(b"[],", b"   "))
_LIST = re.compile(r"^\s*(?:-\s*)?\[(.*)\]\s*$")


def looks_like_yaml_dump(head: bytes, path=None) -> bool:
    """Whether a file begins like a document of ``dump yaml``."""
    return bool(re.match(rb"---\s*\ncreator: LAMMPS\s*\n", head.replace(b"\r\n", b"\n")))


class LammpsYamlDump(LammpsDump):
    """Frames of a LAMMPS YAML dump.

    Parameters and choices as for `atc.readers.lammps.dump.LammpsDump`; units and time are in the file where
    ``dump_modify units yes time yes`` put them there. Its thermo data, if any, are not read.
    """

    _kind = "YAML"
    _may_lack_line_end = False
    _next_begins = "... and ---"
    _last_item = b"\ndata:"
    _mark = b"---"
    _first_item = b"timestep:"

    def _require_items(self, h: Header, where: str) -> None:
        for what, value in (("timestep", h.step), ("natoms", h.n), ("box", h.box), ("keywords", h.columns or None)):
            if value is None:
                raise AtcError(f"{where}: expected '{what}:' before 'data:'")

    def _header_lines(self, lines, line, k) -> Header:
        h = Header()
        flags, boundary_line = (), line
        m = 0
        bad = partial(self._bad, lines, line, k)
        while m < len(lines):
            key, colon, value = lines[m].partition(":")
            value = value.strip()
            if m == 0:
                if lines[m].strip() != "---":
                    raise bad(m, "'---'")
            elif not colon or key != key.strip():
                raise bad(m, "a key such as 'natoms:'")
            try:
                if key == "timestep":
                    h.step = whole(value)
                elif key == "natoms":
                    h.n = count_of(value)
                elif key == "time":
                    h.time = finite(value)
                elif key == "units":
                    h.units = value
                elif key == "boundary":
                    flags, boundary_line = _items(value), line + m
                elif key == "keywords":
                    h.columns = tuple(_items(value))
                elif key in ("box", "thermo"):
                    rows = []
                    first = m
                    while m + 1 < len(lines) and lines[m + 1].startswith((" ", "\t")):
                        m += 1
                        if key == "box":
                            rows.append([number(w) for w in _items(lines[m])])
                    if key == "box":
                        if len(rows) not in (3, 4) or any(len(r) != (2, 3)[j == 3] for j, r in enumerate(rows)):
                            if m + 1 >= len(lines):
                                return h  # cut off
                            raise bad(first, "three pairs of bounds, and perhaps three tilts, below it")
                        h.box = (flags, rows, line + first)
            except ValueError:
                raise bad(m, f"what belongs to {key!r}") from None
            m += 1
        if h.box is not None:
            if len(flags) != 6:
                raise AtcError(
                    f"{self.source}, frame {k}, line {boundary_line}: expected six boundary flags, such as [ p, p, p, "
                    "p, f, f, ], above the box"
                )
            # As a text dump has them: pairs of flags, and the tilts behind the bounds.
            rows = h.box[1]
            pairs = tuple(flags[2 * a] + flags[2 * a + 1] for a in range(3))
            if len(rows) == 4:
                h.box = (("xy", "xz", "yz", *pairs), [[*r, t] for r, t in zip(rows, rows[3])], h.box[2])
            else:
                h.box = (pairs, rows, h.box[2])
        return h

    def _skip(self, pos: int, h: Header) -> int:
        end = super()._skip(pos, h)
        # The document's last line, "...", tells that the line before it is whole; a frame without it is still being
        # written.
        closing = self._bytes.read(end, end + 5).tobytes()
        if closing == b"...":
            return end + 3
        if not closing.startswith((b"...\n", b"...\r\n")):
            if b"...\r\n".startswith(closing) or b"...\n".startswith(closing):
                raise Truncated
            return end  # another line than expected: said where the next frame is looked for
        return end + closing.index(b"\n") + 1

    def _lines_behind(self) -> int:
        return 1

    def _words(self, buf) -> np.ndarray:
        return np.frombuffer(buf.tobytes().translate(_BLANKS), np.uint8)

    def _parse(self, buf, columns, kinds, n, where, finite) -> dict:
        out = parse_columns(self._words(buf), ("-", *columns), (TEXT, *kinds), n, where, finite)
        del out["-"]
        return out


def _items(text: str) -> list[str]:
    """The items of ``[ a, b, c, ]``, with or without the dash of a list before it."""
    m = _LIST.match(text)
    if m is None:
        raise ValueError
    items = [w.strip() for w in m.group(1).split(",")]
    if items and not items[-1]:
        items.pop()
    if not all(items):
        raise ValueError
    return items
