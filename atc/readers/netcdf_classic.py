"""Classic NetCDF files (versions 1, 2 and 5) read by position: SciPy's reader knows no version 5, which LAMMPS writes,
and trusts every length.

Format: NetCDF Users Guide, appendix "File Format Specifications". Everything is big-endian; names and values are padded
to 4 bytes; a variable along the unlimited dimension is spread over records.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError

_TYPES = {1: "i1", 2: "S1", 3: ">i2", 4: ">i4", 5: ">f4", 6: ">f8", 7: "u1", 8: ">u2", 9: ">u4", 10: ">i8", 11: ">u8"}
_DIMENSION, _VARIABLE, _ATTRIBUTE = 10, 11, 12
_HEADER = 1 << 20  # bytes; what describes a trajectory takes a few thousand
_STREAMING = {1: 2**32 - 1, 2: 2**32 - 1, 5: 2**64 - 1}


@dataclass
class Variable:
    """Of one variable: its dimensions by name, shape (None for the unlimited one), type, attributes, and where its
    values begin."""

    name: str
    dims: tuple
    shape: tuple
    dtype: np.dtype
    attrs: dict
    begin: int
    along_records: bool
    size: int = field(default=0)  # bytes of one record, or of the whole variable, without padding


class ClassicFile:
    """The header of a classic NetCDF file, and its values on demand. `bytes_` is what `open_bytes` gives."""

    def __init__(self, bytes_, source: str):
        self._bytes, self.source = bytes_, source
        self._data = bytes_.read(0, _HEADER).tobytes()
        self._at = 4
        self.version = self._data[3] if self._data[:3] == b"CDF" else 0
        if self.version not in _STREAMING:
            raise AtcError(f"{source}: no NetCDF file of version 1, 2 or 5")
        try:
            self._read_header()
        except (struct.error, IndexError, UnicodeDecodeError):
            raise AtcError(
                f"{source}: its NetCDF header is damaged or cut off near byte {min(self._at, len(self._data))}"
            ) from None

    # Header
    # ------------------------------------------------------------------------------------------------------------------

    def _take(self, form: str):
        values = struct.unpack_from(">" + form, self._data, self._at)
        self._at += struct.calcsize(">" + form)
        return values[0] if len(values) == 1 else values

    def _count(self) -> int:
        """A number of things, or a length: 64 bits in version 5."""
        n = self._take("Q" if self.version == 5 else "I")
        return n

    def _raw(self, size: int) -> bytes:
        if size > len(self._data) - self._at:
            raise IndexError
        out = self._data[self._at : self._at + size]
        self._at += size + (-size) % 4
        return out

    def _name(self) -> str:
        return self._raw(self._count()).decode("utf-8")

    def _list(self, tag):
        found, n = self._take("I"), self._count()
        if (found, n) == (0, 0):
            return range(0)
        if found != tag or n > len(self._data):
            raise IndexError
        return range(n)

    def _attributes(self) -> dict:
        out = {}
        for _ in self._list(_ATTRIBUTE):
            name = self._name()
            dtype = np.dtype(self._type())
            n = self._count()
            values = np.frombuffer(self._raw(n * dtype.itemsize), dtype, n)
            out[name] = values.tobytes().rstrip(b"\0").decode("utf-8", "replace") if dtype.kind == "S" else values
        return out

    def _type(self) -> str:
        number = self._take("I")
        if number not in _TYPES:
            raise IndexError
        return _TYPES[number]

    def _read_header(self):
        records = self._count()
        dims = []
        for _ in self._list(_DIMENSION):
            name = self._name()
            dims.append((name, self._count()))
        self.attrs = self._attributes()
        self.variables: dict[str, Variable] = {}
        unlimited = {k for k, (_, n) in enumerate(dims) if n == 0}
        for _ in self._list(_VARIABLE):
            name = self._name()
            which = [self._count() for _ in range(self._dims_count())]
            if any(d >= len(dims) for d in which):
                raise IndexError
            attrs = self._attributes()
            dtype = np.dtype(self._type())
            self._count()  # the size as the writer saw it: redundant, and too small to hold large ones
            begin = self._take("Q" if self.version >= 2 else "I")
            along = bool(which) and which[0] in unlimited
            shape = tuple(None if d in unlimited and j == 0 else dims[d][1] for j, d in enumerate(which))
            size = dtype.itemsize
            for n in shape[along:]:
                size *= n
            self.variables[name] = Variable(
                name, tuple(dims[d][0] for d in which), shape, dtype, attrs, begin, along, size
            )
        self.dims = dict(dims)
        moving = [v for v in self.variables.values() if v.along_records]
        # A single variable along the records is not padded.
        self.record_size = moving[0].size if len(moving) == 1 else sum(v.size + (-v.size) % 4 for v in moving)
        self._first = min((v.begin for v in moving), default=0)
        self.announced = None if records == _STREAMING[self.version] else records

    def _dims_count(self) -> int:
        n = self._count()
        if n > 64:
            raise IndexError
        return n

    # Values
    # ------------------------------------------------------------------------------------------------------------------

    def has_record(self, k: int) -> bool:
        """Whether all of record k is in the file: what the header announces may still be on its way."""
        if not self.record_size or (self.announced is not None and k >= self.announced):
            return False
        end = max(v.begin + k * self.record_size + v.size for v in self.variables.values() if v.along_records)
        return len(self._bytes.read(end - 1, end)) == 1

    def read(self, name: str, k: int = 0) -> np.ndarray:
        """The values of a variable (of record k, if it has records) in this machine's byte order, as stored:
        `scale_factor` is not applied."""
        v = self.variables[name]
        shape = v.shape[v.along_records :]
        start = v.begin + (k * self.record_size if v.along_records else 0)
        raw = self._bytes.read(start, start + v.size)
        if len(raw) < v.size:
            raise AtcError(f"{self.source}: it ends within variable {name!r}; the file is cut off or damaged")
        a = np.frombuffer(raw.tobytes(), v.dtype).reshape(shape)
        return a.astype(v.dtype.newbyteorder("="))
