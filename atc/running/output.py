"""What an output consists of, in memory and on disk: its variables, attributes and name; what goes wrong with it in one
line.
"""

from __future__ import annotations

import errno
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError

_CHUNK_BYTES = 32 * 2**20


@dataclass
class Variable:
    """A variable of the dataset. `dims` without the leading "frame" unless `static`."""

    name: str
    dims: tuple[str, ...]
    shape: tuple[int, ...]
    dtype: np.dtype
    attrs: dict
    static: np.ndarray | None = None
    coordinate: bool = False

    @property
    def all_dims(self):
        return self.dims if self.static is not None else ("frame", *self.dims)

    def whole_shape(self, entries: int) -> tuple[int, ...]:
        """The shape in an output of so many entries."""
        return self.shape if self.static is not None else (entries, *self.shape)

    def chunks(self) -> tuple[int, ...]:
        """The shape of a piece on disk, none of which spans two entries."""
        if self.static is not None:
            return tuple(max(1, n) for n in self.shape)
        row = self.dtype.itemsize * int(np.prod(self.shape[1:], dtype=np.int64))
        first = max(1, _CHUNK_BYTES // max(1, row))
        return (1, *(max(1, min(n, first) if k == 0 else n) for k, n in enumerate(self.shape)))


@dataclass
class Layout:
    """All variables, the number of entries along "frame", and the attributes of the dataset."""

    variables: list[Variable]
    entries: int
    attrs: dict = field(default_factory=dict)


@contextmanager
def explained(path, partial=None):
    """Turn what the operating system says about an output into one line. `partial`: where what is complete is kept."""
    try:
        yield
    except OSError as e:
        if e.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            full = "larger than a file may be here" if e.errno == errno.EFBIG else "the disk is full"
            kept = f" (frames that are complete, if any, are kept in {partial})" if partial is not None else ""
            raise AtcError(f"{path}: {full}: make room and run the same command again{kept}") from e
        why = " ".join(str(e.strerror or e).split())[:200]
        raise AtcError(
            f"{path}: cannot be written ({why}): choose another output file or change its permissions"
        ) from e


def dataset_in_memory(layout: Layout, entries: list[dict], attrs: dict):
    """The same dataset as an `xarray.Dataset` in memory."""
    import xarray as xr

    data: dict = {}
    coords: dict = {}
    for v in layout.variables:
        values = v.static
        if values is None:
            values = np.stack([e[v.name] for e in entries]).astype(v.dtype, copy=False)
        (coords if v.coordinate else data)[v.name] = (v.all_dims, values, clean({**v.attrs, **attrs.get(v.name, {})}))
    return xr.Dataset(data, coords, clean({**layout.attrs, **attrs.get("", {}), "variables": " ".join(data)}))


def clean(attrs: dict) -> dict:
    """Attributes every format can hold."""
    return {
        k: int(v) if isinstance(v, (bool, np.bool_)) else v.item() if isinstance(v, np.generic) else v
        for k, v in attrs.items()
        if v is not None
    }


def plain(v):
    """Numbers and arrays of numpy as Python's own; of anything else its text: what JSON can hold."""
    return v.tolist() if isinstance(v, (np.ndarray, np.generic)) else str(v)


def check_name(out) -> Path:
    """The output path, or an error that says which names are possible."""
    path = Path(out)
    if path.suffix not in (".zarr", ".nc"):
        raise AtcError(f"{path}: the name of the output must end in .zarr or .nc")
    return path


def every_chunk():
    """Arrays opened within write chunks that hold nothing but the fill value, too: one that is missing later is a loss,
    not a field of nothing."""
    import zarr

    return zarr.config.set({"array.write_empty_chunks": True})
