"""LAMMPS binary dumps (a file name ending in ``.bin``): doubles, no rounding in the text, an order of magnitude faster
to read.

Layout (``DumpCustom::header_binary`` of LAMMPS; native byte order, told by a marker). Since 2020 a frame begins with
−len(magic), the magic string (``DUMPATOM`` or ``DUMPCUSTOM``), the byte-order marker 1 and a revision; revision 2
stores units, time and column names. Then, as ever: step, number of atoms (int64), triclinic flag, 6 boundary codes
(int32; 0 periodic), bounds (doubles), columns an atom, chunks; each chunk is a number of doubles (int32) and the
doubles.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell
from .._bytes import open_bytes
from ..trajectory import warn
from .columns import INT_COLUMNS, ScannedTrajectory, cell_from_bounds

_MAGICS = (b"DUMPATOM", b"DUMPCUSTOM")


def looks_binary(head: bytes, path) -> bool:
    """Whether a file begins like a binary dump: by its magic string, or, for the old format that has none, by a sane
    header in a file called .bin."""
    if head[8:16] == _MAGICS[0] or head[8:18] == _MAGICS[1]:
        return True
    if ".bin" not in [s.lower() for s in Path(path).suffixes[-2:]] or len(head) < 100:
        return False
    for endian in "<>":
        step, n, triclinic, *boundary = struct.unpack_from(endian + "qqi6i", head)
        if step >= 0 and 0 <= n < 1 << 40 and triclinic in (0, 1) and all(0 <= b <= 3 for b in boundary):
            return True
    return False


@dataclass
class _Header:
    start: int
    step: int
    n: int
    triclinic: int
    boundary: tuple
    box: tuple
    width: int
    chunks: int
    body: int
    endian: str
    magic: bytes | None = None
    units: str | None = None
    time: float | None = None
    columns: tuple | None = None
    end: int = 0


class _Truncated(Exception):
    pass


class _Cursor:
    def __init__(self, source, at):
        self.source, self.at, self.begin = source, at, at
        self.data = b""

    def take(self, size):
        k = self.at - self.begin
        if k + size > len(self.data):
            self.begin, k = self.at, 0
            self.data = self.source.read(self.at, self.at + max(size, 1024)).tobytes()
            if len(self.data) < size:
                raise _Truncated
        self.at += size
        return self.data[k : k + size]

    def unpack(self, endian, form):
        return struct.unpack(endian + form, self.take(struct.calcsize("=" + form)))


class LammpsBinaryDump(ScannedTrajectory):
    """Frames of a LAMMPS binary dump, ``dump atom`` or ``dump custom``, plain or compressed.

    Parameters and choices as for `atc.readers.lammps.dump.LammpsDump`. Files written before the column names were
    stored are read where the numbers leave no doubt that the columns are ``id type xs ys zs [ix iy iz]`` or ``id type x
    y z [ix iy iz]``; others are an error.
    """

    def __init__(self, path, topology=None, units=None, masses=None):
        self._bytes = open_bytes(path)
        self.source = str(path)
        self._headers, self._next, self._complete = [], 0, False
        self.frames_parsed = 0
        self._old_columns = None
        try:
            first = self._header(0, 0)
        except _Truncated:
            first = None
        super().__init__(path, topology, units, masses, first and first.units)
        if not self._has(0):
            raise AtcError(f"{path} holds no complete frame: it ends within its first one")
        self._require_atoms(lambda k: self._headers[k].n)

    def _header(self, start: int, k: int) -> _Header:
        where = f"{self.source}, frame {k}, byte {start}"
        c = _Cursor(self._bytes, start)
        raw = c.take(8)
        endian = "<"
        for e in "<>":
            (marker,) = struct.unpack(e + "q", raw)
            if -64 < marker < 0 or 0 <= marker < 1 << 48:
                endian = e
                break
        magic, revision, units, time, columns = None, 0, None, None, None
        if marker < 0:
            magic = c.take(-marker)
            if magic not in _MAGICS:
                raise AtcError(
                    f"{where}: expected the magic string DUMPATOM or DUMPCUSTOM, got {magic[:20]!r}; the file is "
                    "damaged, or a dump of something else than atoms"
                )
            (order,) = c.unpack(endian, "i")
            if order != 1:
                raise AtcError(f"{where}: byte-order marker {order}, expected 1; the file is damaged")
            (revision,) = c.unpack(endian, "i")
            (step,) = c.unpack(endian, "q")
        else:
            step = marker
        n, triclinic, *boundary = c.unpack(endian, "qi6i")
        if n < 0 or triclinic not in (0, 1, 2) or not all(0 <= b <= 3 for b in boundary):
            raise AtcError(
                f"{where}: {n} atoms, triclinic flag {triclinic}, boundaries {boundary}: not the header of a frame; "
                "the file is damaged"
            )
        box = c.unpack(endian, f"{(6, 9, 12)[triclinic]}d")
        (width,) = c.unpack(endian, "i")
        if revision >= 2:
            (size,) = c.unpack(endian, "i")
            if not 0 <= size < 64:
                raise AtcError(f"{where}: a unit style of {size} letters; the file is damaged")
            units = c.take(size).decode("ascii", "replace") if size else None
            if c.take(1) != b"\0":
                (time,) = c.unpack(endian, "d")
            (size,) = c.unpack(endian, "i")
            if not 0 <= size < 1 << 20:
                raise AtcError(f"{where}: column names of {size} letters; the file is damaged")
            columns = tuple(c.take(size).decode("utf-8", "replace").split())
            if len(columns) != width:
                raise AtcError(f"{where}: {len(columns)} column names for {width} columns; the file is damaged")
        (chunks,) = c.unpack(endian, "i")
        if width < 1 or chunks < 0:
            raise AtcError(f"{where}: {width} columns in {chunks} chunks; the file is damaged")
        return _Header(
            start, step, n, triclinic, tuple(boundary), box, width, chunks, c.at, endian, magic, units, time, columns
        )

    def _scan(self) -> bool:
        k, start = len(self._headers), self._next
        self._bytes.hold = start
        try:
            if not len(self._bytes.read(start, start + 1)):
                self._complete = True
                return False
            h = self._header(start, k)
            at, total = h.body, 0
            for _ in range(h.chunks):
                raw = self._bytes.read(at, at + 4).tobytes()
                if len(raw) < 4:
                    raise _Truncated
                (m,) = struct.unpack(h.endian + "i", raw)
                if m < 0 or m % h.width:
                    raise AtcError(
                        f"{self.source}, frame {k}, byte {at}: a chunk of {m} numbers in {h.width} columns; the file "
                        "is damaged"
                    )
                at += 4 + 8 * m
                total += m
            if total != h.n * h.width:
                raise AtcError(
                    f"{self.source}, frame {k}, byte {start}: {total // h.width} atoms are there but {h.n} are "
                    "announced; the file is damaged"
                )
            if at > start and not len(self._bytes.read(at - 1, at)):
                raise _Truncated
        except _Truncated:
            self._complete = True
            warn(f"{self.source}: its last frame (number {k}, from byte {start}) is not complete and is left out")
            return False
        if h.units is not None and k and h.units != self.units.name:
            raise AtcError(f"{self.source}, frame {k}: the units change from {self.units.name!r} to {h.units!r}")
        h.end = at
        self._headers.append(h)
        self._next = at
        return True

    @property
    def _found(self):
        return len(self._headers)

    def _table(self, h: _Header, k: int) -> np.ndarray:
        self.frames_parsed += 1
        raw = self._bytes_of(k, h.body, h.end).tobytes()
        parts, at = [], 0
        for _ in range(h.chunks):
            (m,) = struct.unpack_from(h.endian + "i", raw, at)
            parts.append(np.frombuffer(raw, h.endian + "f8", m, at + 4))
            at += 4 + 8 * m
        table = np.concatenate(parts) if len(parts) != 1 else parts[0]
        return table.astype("=f8", copy=False).reshape(h.n, h.width)

    def _cell(self, h: _Header, k: int) -> Cell:
        length = self.units.length
        periodic = [h.boundary[2 * a] == 0 and h.boundary[2 * a + 1] == 0 for a in range(3)]
        with located(f"{self.source}, frame {k}"):
            if h.triclinic == 2:
                return Cell(np.reshape(h.box[:9], (3, 3)) * length, np.array(h.box[9:]) * length, periodic)
            return cell_from_bounds(
                h.box[0:6:2], h.box[1:6:2], h.box[6:] if h.triclinic else (0.0, 0.0, 0.0), periodic, length
            )

    def _frame(self, k):
        h = self._headers[k]
        where = f"{self.source} frame {k}"
        table = self._table(h, k)
        columns = {}
        for c, name in enumerate(h.columns or self._columns_of_old(h, table)):
            column = table[:, c]
            if name in INT_COLUMNS:
                whole = np.rint(np.where(np.isfinite(column), column, np.nan))
                bad = np.flatnonzero(~(whole == column))
                if len(bad):
                    raise AtcError(
                        f"{where}, atom {bad[0]} of the file: column {name!r} holds {column[bad[0]]}, expected an "
                        "integer; the file is damaged"
                    )
                column = whole.astype(np.int64)
            columns[name] = column
        return self._build(
            columns, self._cell(h, k), k, where, int(h.step), h.time, lambda row: f"atom {row} of the file"
        )

    def _columns_of_old(self, h: _Header, table) -> tuple:
        """Names of the columns of a format that does not store them: only where one reading alone is possible."""
        if self._old_columns is None:
            tail = ("ix", "iy", "iz") if h.width == 8 else ()
            problem = (
                f"{self.source}: an old binary dump that does not name its columns, and it is not plainly one of "
                "'dump atom'; convert it with LAMMPS's binary2txt and write the names behind 'ITEM: ATOMS'"
            )
            whole = table[:, [0, 1, *range(5, h.width)]]
            if h.width not in (5, 8) or not h.n or not (whole == np.rint(whole)).all():
                raise AtcError(problem)
            if table[:, :2].min() < 1 or len(set(table[:, 0])) < h.n:
                raise AtcError(problem)
            lo, hi = np.array(h.box[0:6:2]), np.array(h.box[1:6:2])
            # Atoms of a dump lie in the box, give or take a little between reneighbourings: 10 % of it.
            x = table[:, 2:5]
            scaled = bool((x >= -0.1).all() and (x <= 1.1).all())
            plain = bool((x >= lo - 0.1 * (hi - lo)).all() and (x <= hi + 0.1 * (hi - lo)).all())
            # A handful of atoms may sit in the unit cube of a large box by chance; in a filled box they cannot.
            span = np.ptp(x, axis=0)
            if scaled and h.n >= 100 and (span < 0.5 * (hi - lo)).any() and (span > 0.5).all():
                plain = False
            if scaled == plain:
                raise AtcError(problem)
            self._old_columns = ("id", "type", *(("xs", "ys", "zs") if scaled else ("x", "y", "z")), *tail)
        return self._old_columns

    def _numbered(self):
        columns = self._headers[0].columns or self._old_columns
        return "id" in (columns or ())
