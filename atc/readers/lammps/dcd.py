"""DCD trajectories that LAMMPS wrote (``dump dcd``): in the units of its run, which other readers take for Å and
CHARMM's time.

Layout (Fortran records, each between two int32 of its length): a header of 84 bytes (``CORD``, number of frames, first
step, steps between frames, last step, 5 zeros, ..., the time step as a float32, whether cells follow), titles of 80
letters, the number of atoms; then by frame the cell (6 doubles: A, cos γ, B, cos β, cos α, C) and the x, y and z of all
atoms (float32). LAMMPS names itself in the first title.
"""

from __future__ import annotations

import struct

import numpy as np

from ...errors import AtcError, located
from ...frame import Cell
from .._bytes import open_bytes
from ..resolution import decimal_resolution
from ..trajectory import warn
from .columns import ScannedTrajectory, edge_vectors

_NAME = b"Written by LAMMPS"


def looks_like_dcd(head: bytes) -> bool:
    """Whether a file begins like a DCD of any program."""
    return head[:4] in (b"T\0\0\0", b"\0\0\0T") and head[4:8] == b"CORD"


def written_by_lammps(head: bytes, path=None) -> bool:
    """Whether a DCD says in its titles that LAMMPS wrote it."""
    return looks_like_dcd(head) and _NAME in head[:4096]


def rest_behind_frames(path) -> bool:
    """Whether a DCD of any program ends within a frame. Files with fixed atoms, whose frames differ in size, are not
    looked into."""
    try:
        with open(path, "rb") as f:
            head = f.read(1 << 16)
            total = f.seek(0, 2)
        endian = "<" if head[0] else ">"
        word = struct.unpack_from(endian + "20i", head, 8)
        (titles,) = struct.unpack_from(endian + "i", head, 92)
        at = 92 + titles + 8
        (n,) = struct.unpack_from(endian + "i", head, at + 4)
    except (OSError, ValueError, IndexError, struct.error):
        return False
    size = 56 * (word[10] != 0) + 3 * (8 + 4 * n) + (8 + 4 * n) * (word[11] != 0)
    return not word[8] and n > 0 and titles >= 0 and (total - at - 12) % size != 0


class LammpsDcd(ScannedTrajectory):
    """Frames of a DCD file of LAMMPS: positions (float32), cell, step and time.

    Parameters
    ----------
    path : file, plain or compressed
    topology : LAMMPS data file with the same atoms. Gives types, masses, charges, bonded terms, and the atoms' ids: a
        DCD is in their order.
    units : LAMMPS unit style of the run; needed, the file does not say it.
    masses : as for `atc.read`

    Notes
    -----
    The file knows neither where the box has its corner nor which of its faces are periodic: the corner is put at 0, 0,
    0, all axes are taken as periodic (`assumed` says so). Steps and times follow from the header where its first step,
    last step, interval and number of frames agree; otherwise they are left out, with a warning.
    """

    assumed = ("a DCD file does not say which faces of its box are periodic: all are taken to be",)
    _without_ids = None
    _without_types = (
        "holds no types: all atoms are taken to be of type 1; give the run's data file as topology if there are more"
    )

    def __init__(self, path, topology=None, units=None, masses=None):
        self._bytes = open_bytes(path)
        self.source = str(path)
        self._read_header()
        super().__init__(path, topology, units, masses, None)
        if not self._has(0):
            raise AtcError(f"{path} holds no complete frame")
        self._ids = None if self._data is None else self._ids_of_data(self._n, path)

    def _damaged(self, byte, what) -> AtcError:
        return AtcError(f"{self.source}, byte {byte}: {what}; the file is damaged")

    def _record(self, at: int, most: int) -> tuple[bytes, int]:
        """The Fortran record at byte `at`, and the position behind it."""
        raw = self._bytes.read(at, at + 4).tobytes()
        if len(raw) < 4:
            raise AtcError(f"{self.source} holds no complete frame: it ends within its header")
        (size,) = struct.unpack(self._endian + "i", raw)
        if not 0 <= size <= most:
            raise self._damaged(at, f"a record of {size} bytes where at most {most} are expected")
        body = self._bytes.read(at + 4, at + 8 + size).tobytes()
        if len(body) < size + 4:
            raise AtcError(f"{self.source} holds no complete frame: it ends within its header")
        if body[size:] != raw:
            raise self._damaged(at + 4 + size, "a record that ends with another length than it begins with")
        return body[:size], at + 8 + size

    def _read_header(self):
        self._endian = "<" if self._bytes.read(0, 1)[0] else ">"
        header, at = self._record(0, 84)
        if len(header) != 84:
            raise self._damaged(0, "no header of 84 bytes")
        word = struct.unpack(self._endian + "20i", header[4:])
        n_frames, first, every, last = word[:4]
        (dt,) = struct.unpack(self._endian + "f", header[40:44])
        if word[8]:
            raise self._damaged(36, f"{word[8]} atoms are said to be fixed, which LAMMPS never writes")
        self._has_cell = word[10] != 0
        _, at = self._record(at, 1 << 16)
        counts, at = self._record(at, 4)
        if len(counts) != 4:
            raise self._damaged(at - 8, "no number of atoms")
        (self._n,) = struct.unpack(self._endian + "i", counts)
        if self._n < 0:
            raise self._damaged(at - 8, f"{self._n} atoms")
        if not self._n:
            raise AtcError(f"{self.source} holds no atoms")
        self._body = at
        self._size = 56 * self._has_cell + 3 * (8 + 4 * self._n)
        self._first, self._every = first, every
        self._steps_known = every > 0 and n_frames > 0 and first >= 0 and last == first + every * (n_frames - 1)
        # The shortest decimal number that is this float32: 0.001, not 0.0010000000474974513.
        self._dt = float(str(np.float32(dt))) if np.isfinite(dt) and dt > 0 else None

    # Frames
    # ------------------------------------------------------------------------------------------------------------------

    def _scan(self):
        end = self._body + (self._found + 1) * self._size
        self._bytes.hold = end - self._size
        if len(self._bytes.read(end - 1, end)):
            self._found += 1
            return True
        self._complete = True
        if len(self._bytes.read(end - self._size, end - self._size + 1)):
            warn(
                f"{self.source}: its last frame (number {self._found}, from byte {end - self._size}) is not complete "
                "and is left out"
            )
        if not self._steps_known and self._found > 1:
            warn(
                f"{self.source}: the steps of its frames are not evenly spaced, or its header was not finished: its "
                "frames have neither step nor time"
            )
        return False

    def _frame(self, k):
        where = f"{self.source} frame {k}"
        start = self._body + k * self._size
        raw = self._bytes_of(k, start, start + self._size).tobytes()
        at, six, columns = 0, None, {}
        if self._has_cell:
            six = struct.unpack_from(self._endian + "6d", raw, 4)
            self._check_record(raw, 0, 48, start, k)
            at = 56
        for name in "xyz":
            self._check_record(raw, at, 4 * self._n, start, k)
            columns[name] = np.frombuffer(raw, self._endian + "f4", self._n, at + 4).astype(np.float64)
            at += 8 + 4 * self._n
        if self._ids is not None:
            columns = {"id": self._ids, **columns}
        step = self._first + k * self._every if self._steps_known else None
        time = None if step is None or self._dt is None else step * self._dt
        return self._build(
            columns, self._cell(six, where), k, where, step, time, lambda row: f"atom {row + 1} of the file"
        )

    def _check_record(self, raw, at, size, start, k):
        ends = tuple(struct.unpack_from(self._endian + "i", raw, p)[0] for p in (at, at + 4 + size))
        if ends != (size, size):
            raise AtcError(
                f"{self.source}, frame {k}, byte {start + at}: a record of {ends[0]} bytes, expected {size}; the file "
                "is damaged"
            )

    def _cell(self, six, where) -> Cell:
        if six is None:
            raise AtcError(f"{where}: the file holds no cell; dump custom writes it")
        a, gamma, b, beta, alpha, c = six
        cosines = np.array([alpha, beta, gamma])
        if not (np.isfinite(six).all() and min(a, b, c) > 0):
            raise AtcError(f"{where}: lengths {a}, {b}, {c} make no cell")
        if (np.abs(cosines) > 1).any():  # CHARMM's degrees, as tools that rewrite the file leave them
            if not ((cosines > 0) & (cosines < 180)).all():
                raise AtcError(f"{where}: angles {cosines.tolist()} make no cell")
            cosines = np.where(cosines == 90, 0.0, np.cos(np.radians(cosines)))
        vectors = edge_vectors((a, b, c), cosines)
        if vectors is None:
            raise AtcError(f"{where}: cosines {cosines.tolist()} of the angles make no cell")
        with located(where):
            return Cell(vectors * self.units.length)

    def _numbered(self):
        return self._ids is not None

    def _precision(self, frame):
        step, why = decimal_resolution(frame.positions / self.units.length)
        return step * self.units.length, why
