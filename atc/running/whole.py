"""What is in memory when it is written: whole or not at all; datasets with a checksum of every chunk."""

from __future__ import annotations

import contextlib
import os
import shutil
from pathlib import Path

import numpy as np

from ..errors import AtcError
from .output import check_name, every_chunk, explained
from .sealed import reserve, to_netcdf


@contextlib.contextmanager
def renamed(path: Path):
    """The name to write a file under, which takes the place of `path` once all is written; nothing is left behind where
    it cannot be (an OSError)."""
    part = path.with_name(f".{path.stem}.partial{path.suffix}")
    try:
        yield part
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)


@contextlib.contextmanager
def replacing(path: Path):
    """`renamed`, with an AtcError where the file cannot be written."""
    try:
        with renamed(path) as part:
            yield part
    except OSError as e:
        raise AtcError(f"{path}: cannot be written: {e.strerror or e}") from None


def write_dataset(ds, path) -> None:
    """Write an `xarray.Dataset` as an output of atc: .zarr, or a sealed .nc. What stands there is replaced once the new
    one is complete.

    Raises AtcError where it cannot be written; nothing is left behind then.
    """
    from .. import __version__

    path = check_name(path)
    # The format does not keep the order of variables.
    ds = ds.assign_attrs({"atc_version": __version__, "variables": " ".join(ds.data_vars), **ds.attrs})
    part, old = (path.with_name(f".{path.name}.{word}") for word in ("partial", "old"))
    with explained(path):
        if old.exists() and not path.exists():  # a kill came between the two renames below
            os.rename(old, path)
        try:
            _remove(part)
            (_to_zarr if path.suffix == ".zarr" else _to_netcdf)(ds, part)
            if path.is_dir():  # which no rename replaces
                _remove(old)
                os.rename(path, old)
            os.replace(part, path)
            _remove(old)
        finally:
            with contextlib.suppress(OSError):
                _remove(part)


def _to_zarr(ds, path) -> None:
    import numcodecs

    # The format that `Store` writes: where a chunk is missing is seen by the same means.
    encoding = {name: {"filters": [numcodecs.CRC32()]} for name, a in ds.variables.items() if a.dtype.kind != "O"}
    with every_chunk():
        ds.to_zarr(path, mode="w", zarr_format=2, encoding=encoding, consolidated=True)


def _to_netcdf(ds, path) -> None:
    reserve(path, 2 * ds.nbytes)
    encoding = {name: _chunked(a) for name, a in ds.variables.items() if a.ndim and a.size and a.dtype.kind in "fiub"}
    to_netcdf(ds, path, encoding)


def _chunked(a) -> dict:
    """One chunk, or where that is much one for each index of the first dimension."""
    shape = a.shape if a.nbytes < 1 << 20 else (1, *a.shape[1:])
    return {"fletcher32": True, "chunksizes": tuple(int(n) for n in np.maximum(shape, 1))}


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
