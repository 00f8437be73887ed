"""LAMMPS text dumps (``dump atom``, ``dump custom``), plain or compressed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell
from .. import _parse
from .._bytes import open_bytes
from ..resolution import text_resolution_of_frames
from ..table import FLOAT, INT, TEXT, is_number, parse_columns
from ..trajectory import warn
from .columns import INT_COLUMNS, KNOWN_FLOATS, TEXT_COLUMNS, ScannedTrajectory, cell_from_bounds, periodic_flags


def looks_like_dump(head: bytes, path=None) -> bool:
    """Whether a file begins like a text dump."""
    return head.lstrip().startswith(b"ITEM:")


@dataclass
class Header:
    """What stands above the atoms of one frame. `lines` is how many lines it takes, `size` how many bytes."""

    step: int | None = None
    time: float | None = None
    units: str | None = None
    n: int | None = None
    box: tuple | None = None  # words behind BOX BOUNDS, three rows of numbers, line number
    columns: tuple = ()
    lines: int = 0
    size: int = 0


_LONGEST_LINE = 1 << 20


def number(text: str) -> float:
    """A number as C prints it; ValueError otherwise (Python alone would take 1_000 too)."""
    if "_" in text or not text.isascii():
        raise ValueError
    return float(text)


def whole(text: str) -> int:
    """An integer that fits in 64 bits; ValueError otherwise."""
    if not text.lstrip("+-").isdigit() or not text.isascii() or len(text) > 20:
        raise ValueError
    value = int(text)
    if not -(2**63) <= value < 2**63:
        raise ValueError
    return value


def count_of(text: str) -> int:
    """As `whole`, not negative."""
    if (value := whole(text)) < 0:
        raise ValueError
    return value


def finite(text: str) -> float:
    """As `number`, neither infinite nor NaN."""
    if not np.isfinite(value := number(text)):
        raise ValueError
    return value


class Truncated(Exception):
    """The file ends inside a frame."""


class LammpsDump(ScannedTrajectory):
    """Frames of a LAMMPS text dump.

    Parameters
    ----------
    path : file, plain, .gz, .bz2 or .xz (told by content).
    topology : LAMMPS data file. Gives bonded terms, and masses, charges and types where the dump has none.
    units : LAMMPS unit style; may be left out where the dump (``dump_modify units yes``) or the data file says it.
    masses : {type or name: mass} or list by type. Goes before a ``mass`` column, which goes before the topology.

    Notes
    -----
    Positions are taken from the first of x y z, xu yu zu, xs ys zs, xsu ysu zsu that is complete; ``images`` is set for
    wrapped ones with ix iy iz. Without ``type``, types come from the topology, or from ``element`` in order of first
    appearance; with neither, all atoms are type 1 (with a warning unless one single mass, or a mass column, was given).
    Other columns are in ``extra``, as read.

    The positions of frames in the file are found once, by counting line ends, as far as they are needed. A last frame
    that is not complete is left out with a warning. Anything else that is not as it should be is an AtcError that names
    the frame and the line.
    """

    _kind = "LAMMPS"
    _may_lack_line_end = True  # whether the atoms of a frame can be the end of the file
    _next_begins = "ITEM: TIMESTEP"
    _last_item = b"ITEM: ATOMS"  # what the last line of a header begins with
    _mark = b"ITEM:"  # what every frame begins with
    _first_item = b"ITEM: TIMESTEP"  # what is only there once a frame

    def __init__(self, path, topology=None, units=None, masses=None):
        self._bytes = open_bytes(path)
        self._start, self._body, self._end, self._line, self._n = [], [], [], [], []
        self._next, self._next_line, self._complete = 0, 1, False
        self._per_line = 60.0
        self.source = str(path)
        self.frames_parsed = 0
        try:
            header = self._header(0, 1, 0)
        except Truncated:
            raise AtcError(f"{path} holds no complete frame: it ends within its first one") from None
        super().__init__(path, topology, units, masses, header.units)
        if not self._has(0):
            raise AtcError(
                f"{path} holds no complete frame: it ends within its first one, or that one's last line has no line end"
            )
        # A group or threshold may select nothing at a step, and then zero is what its density is; but somewhere there
        # must be atoms.
        self._require_atoms(lambda k: self._n[k])

    # Finding frames
    # ------------------------------------------------------------------------------------------------------------------

    def _header(self, start: int, line: int, k: int) -> Header:
        """The header of frame k, which begins at byte `start`, in line `line`."""
        size = 2048
        while True:
            text = self._bytes.read(start, start + size).tobytes()
            mark = text.find(self._last_item)
            end = text.find(b"\n", mark + 1) + 1 if mark >= 0 else 0
            if end:
                break
            if len(text) < size or size >= 1 << 19:
                # Never mistake another kind of file for the beginning of a dump.
                self._header_lines(text[: 1 << 19].decode("utf-8", "replace").split("\n")[:-1], line, k)
                if len(text) < size:
                    raise Truncated
                raise AtcError(
                    f"{self.source}, frame {k}, line {line}: found no '{self._last_item.decode().strip()}' here; is it "
                    f"a {self._kind} dump of atoms?"
                )
            size *= 4
        lines = text[:end].decode("utf-8", "replace").split("\n")[:-1]
        h = self._header_lines(lines, line, k)
        h.lines, h.size = len(lines), end
        where = f"{self.source}, frame {k}, line {line + len(lines) - 1}"
        self._require_items(h, where)
        twice = next((name for name in h.columns if h.columns.count(name) > 1), None)
        if twice is not None:
            raise AtcError(f"{where}: column {twice!r} is there twice")
        return h

    def _header_of(self, k: int) -> Header:
        """The header of a frame that has been found."""
        try:
            return self._header(self._start[k], self._line[k], k)
        except Truncated:
            raise self._shorter(k) from None

    def _require_items(self, h: Header, where: str) -> None:
        if not h.columns:
            raise AtcError(
                f"{where}: 'ITEM: ATOMS' stands where the lines of another item are expected; the file is damaged"
            )

    def _header_lines(self, lines, line, k) -> Header:
        h = Header()
        m = 0
        bad = partial(self._bad, lines, line, k)
        while m < len(lines):
            item = lines[m].strip()
            if not item.startswith("ITEM:"):
                raise bad(m, "an 'ITEM:' line")
            if item.startswith("ITEM: ATOMS"):
                h.columns = tuple(item.split()[2:])
                for what, value in (("TIMESTEP", h.step), ("NUMBER OF ATOMS", h.n), ("BOX BOUNDS", h.box)):
                    if value is None:
                        raise bad(m, f"'ITEM: {what}' before it")
                if not h.columns:
                    raise AtcError(
                        f"{self.source}, frame {k}, line {line + m}: 'ITEM: ATOMS' does not name its columns; write "
                        "them behind it, e.g. 'ITEM: ATOMS id type xs ys zs'"
                    )
                return h
            try:
                if item.startswith("ITEM: BOX BOUNDS"):
                    if m + 3 >= len(lines):
                        return h
                    rows = [[number(w) for w in lines[m + r].split()] for r in (1, 2, 3)]
                    h.box = (tuple(item.split()[3:]), rows, line + m)
                    m += 4
                    continue
                if m + 1 >= len(lines):
                    return h
                value = lines[m + 1].strip()
                if item.startswith("ITEM: TIMESTEP"):
                    h.step = whole(value)
                elif item == "ITEM: NUMBER OF ATOMS":
                    h.n = count_of(value)
                elif item == "ITEM: TIME":
                    h.time = finite(value)
                elif item == "ITEM: UNITS":
                    h.units = value
                elif item.startswith("ITEM: NUMBER OF"):
                    raise AtcError(
                        f"{self.source}, line {line + m}: {item[6:]!r}: this is a dump of something else than atoms; "
                        "atc reads atoms (dump custom: id type x y z vx vy vz)"
                    )
            except ValueError:
                raise bad(m + 1, f"numbers for {item!r}") from None
            m += 2
        return h

    def _bad(self, lines, line: int, k: int, at: int, expected: str) -> AtcError:
        """What is wrong with line number `at` of those that begin with number `line` of the file."""
        got = lines[at].strip()[:60] if at < len(lines) else "the end"
        return AtcError(
            f"{self.source}, frame {k}, line {line + at}: expected {expected}, got {got!r}; the file is damaged "
            f"or not a {self._kind} dump"
        )

    def _scan(self) -> bool:
        """Find one more frame. False at the end of the file."""
        k, start, line = len(self._start), self._next, self._next_line
        self._bytes.hold = start
        try:
            if not len(self._bytes.read(start, start + 1)):
                self._complete = True
                return False
            rest = self._bytes.read(start, start + 4096).tobytes()
            if not rest.strip() and len(rest) < 4096:
                self._complete = True  # blank lines at the end
                return False
            h = self._header(start, line, k)
            body = start + h.size
            end = self._skip(body, h)
        except Truncated:
            self._announces_too_many(start, k, line)
            self._complete = True
            warn(
                f"{self.source}: its last frame (number {k}, from line {line}) is not complete and is left out: the "
                "file ends within it, or within its last line, which has no line end"
            )
            return False
        follows = self._bytes.read(end, end + 5).tobytes()
        if follows and not self._mark.startswith(follows[: len(self._mark)]) and follows.strip():
            self._miscounted(h, k, body, end, line)
        if h.units is not None and k and h.units != self.units.name:
            raise AtcError(
                f"{self.source}, frame {k}, line {line}: the units change from {self.units.name!r} to {h.units!r}"
            )
        if h.n:
            self._per_line = max(8.0, (end - body) / h.n)
        self._start.append(start)
        self._body.append(body)
        self._end.append(end)
        self._line.append(line)
        self._n.append(h.n)
        self._next, self._next_line = end, line + h.lines + h.n + self._lines_behind()
        return True

    def _skip(self, pos: int, h: Header) -> int:
        """Position behind the atoms of a frame that begin at `pos`."""
        n, first = h.n, pos
        while n:
            size = int(min(max(n * self._per_line * 1.05 + 1024, 4096), 1 << 22))
            buf = self._bytes.read(pos, pos + size)
            used, seen = _parse.skip_lines(buf, n)
            n -= seen
            pos += used
            if n and len(buf) < size:
                if n == 1 and not self._start and self._may_lack_line_end:
                    # LAMMPS ends every line; but a file of one frame may have passed through an editor, and nothing
                    # else is left to read in it.
                    text = self._bytes.read(first, pos).tobytes()
                    if len(text[text.rfind(b"\n") + 1 :].split()) == len(h.columns):
                        warn(
                            f"{self.source}: its only frame has no line end behind the last atom; it is read, but its "
                            "last number may have been cut off"
                        )
                        return pos
                raise Truncated
            if not seen and len(buf) >= _LONGEST_LINE:
                raise AtcError(
                    f"{self.source}, byte {pos - used}: a line of more than {_LONGEST_LINE} letters; the file is "
                    "damaged"
                )
        return pos

    def _announces_too_many(self, start, k, line):
        """A frame that seems to reach beyond the end of the file, but within which another begins, is damaged, not
        cut."""
        at, lines = start, 0
        while True:
            # Blocks overlap by a little, so that a mark on the seam is found.
            block = self._bytes.read(at, at + (1 << 22)).tobytes()
            own = block.find(self._first_item) + 1 if at == start else 0
            seen = block.find(b"\n" + self._first_item, own)
            if seen >= 0:
                have = lines + block.count(b"\n", 0, seen + 1)
                raise AtcError(
                    f"{self.source}, frame {k}, line {line + have}: another frame begins here, before the atoms that "
                    f"the header in line {line} announces are there; the file is damaged"
                )
            if len(block) < 1 << 22:
                return
            step = len(block) - 64
            lines += block.count(b"\n", 0, step)
            at += step

    def _lines_behind(self) -> int:
        """Lines between the last atom of a frame and the next frame."""
        return 0

    def _words(self, buf) -> np.ndarray:
        """The bytes of the table of atoms as white-space separated words."""
        return buf

    def _parse(self, buf, columns, kinds, n, where, finite) -> dict:
        return parse_columns(buf, columns, kinds, n, where, finite)

    def _miscounted(self, h, k, body, end, line):
        """N lines below the header do not end at the next frame: say where it goes wrong."""
        text = self._bytes.read(body, end).tobytes()
        at = text.find(self._mark)
        first = line + h.lines
        if at >= 0:
            have = text.count(b"\n", 0, at)
            raise AtcError(
                f"{self.source}, frame {k}, line {first + have}: the frame ends after {have} atoms but announces "
                f"{h.n}; lines are missing"
            )
        raise AtcError(
            f"{self.source}, frame {k}, line {first + h.n}: expected {self._next_begins!r} after {h.n} atoms; there "
            "are more lines than announced"
        )

    @property
    def _found(self):
        return len(self._start)

    # Reading one
    # ------------------------------------------------------------------------------------------------------------------

    def _frame(self, k):
        h = self._header_of(k)
        columns, where, line_of = self._columns_of(k, h)
        return self._build(columns, self._cell(h, k), k, where, h.step, h.time, line_of)

    def _cell(self, h: Header, k: int) -> Cell:
        words, rows, line = h.box
        where = f"{self.source}, frame {k}, line {line}"
        width = 2
        general = words[:2] == ("abc", "origin")
        if general:
            words, width = words[2:], 4
        tilted = words[:3] == ("xy", "xz", "yz")
        if tilted:
            words, width = words[3:], 3
        if not words:
            raise AtcError(
                f"{where}: 'ITEM: BOX BOUNDS' has no boundary flags (an old LAMMPS); write them behind it, e.g. "
                "'ITEM: BOX BOUNDS pp pp pp'"
            )
        periodic = periodic_flags(words, where)
        if any(len(r) != width for r in rows):
            raise AtcError(
                f"{where}: expected three lines of {width} numbers below {' '.join(('ITEM: BOX BOUNDS', *h.box[0]))!r}"
            )
        a = np.array(rows)
        length = self.units.length
        with located(where):
            if general:
                return Cell(a[:, :3] * length, a[:, 3] * length, periodic)
            return cell_from_bounds(a[:, 0], a[:, 1], a[:, 2] if tilted else (0.0, 0.0, 0.0), periodic, length)

    def _table(self, k: int, h: Header, first: int) -> dict:
        """The columns of frame k by name, in file order."""
        self.frames_parsed += 1
        n, buf = self._n[k], self._bytes_of(k, self._body[k], self._end[k])
        if n and buf[-1] != 10:
            buf = np.append(buf, np.uint8(10))
        sample = self._words(buf[:65536]).tobytes().split(b"\n", 1)[0].split()[-len(h.columns) :] if n else []
        kinds = []
        for c, name in enumerate(h.columns):
            kind = INT if name in INT_COLUMNS else TEXT if name in TEXT_COLUMNS else FLOAT
            if kind == FLOAT and c < len(sample) and not is_number(sample[c]) and name not in KNOWN_FLOATS:
                kind = TEXT
            kinds.append(kind)
        return self._parse(
            buf, h.columns, kinds, n, lambda row: f"{self.source}, frame {k}, line {first + row}", KNOWN_FLOATS
        )

    def _columns_of(self, k, h: Header | None = None):
        h = h or self._header_of(k)
        first = self._line[k] + h.lines
        return self._table(k, h, first), f"{self.source} frame {k}", lambda row: f"line {first + row}"

    def _numbered(self):
        return "id" in self._header_of(0).columns

    def _precision(self, frame):
        columns = self._header_of(0).columns
        for behind, scaled in (("", False), ("u", False), ("s", True), ("su", True)):
            names = tuple(f"{axis}{behind}" for axis in "xyz")
            if all(name in columns for name in names):
                r, why = text_resolution_of_frames(lambda k, names=names: self._sample(k, names), self._has)
                scale = float(np.linalg.norm(frame.cell.vectors, axis=1).max()) if scaled else self.units.length
                return r * scale, why
        return 0.0, "no coordinates"

    def _sample(self, k, names) -> list[str]:
        """Some of what stands in these columns of frame k, as text."""
        columns = self._header_of(k).columns
        if not all(name in columns for name in names):
            return []
        at = [columns.index(name) for name in names]
        end = min(self._end[k], self._body[k] + (1 << 18))
        lines = self._bytes.read(self._body[k], end).tobytes().split(b"\n")[:-1]
        words = [
            self._words(np.frombuffer(w, np.uint8)).tobytes().split() for w in lines[:: max(1, len(lines) // 1000)]
        ]
        words = [w[-len(columns) :] for w in words if len(w) >= len(columns)]
        return [w[a].decode("utf-8", "replace") for w in words for a in at]
