"""Files of HDF5 (.nc) that are looked at before the HDF5 library opens them.

Chunks of data carry checksums, the structure around them does not: one flipped bit of it can make the library loop for
ever or crash. `seal` writes a digest of everything but the chunks behind the end of the file, where HDF5 and NetCDF do
not look; `require_sound` compares it first, which reads the structure and no data. A file without a seal (of an earlier
version, or changed by another program, which drops it) is opened in a process of its own first, for so long.

Layout of a seal, in little-endian: the stretches of data (n × begin, end), n, the size of the file before, a digest of
all this and of the structure (16 bytes), `MAGIC`.
"""

import hashlib
import os
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np

from ..errors import AtcError

MAGIC = b"\natc seal 1\n"
_TAIL = struct.Struct(f"<QQ16s{len(MAGIC)}s")
_BLOCK = 1 << 20
#: Seconds that the structure of a file without a seal may take to be read.
PATIENCE = 30.0


class Damaged(AtcError):
    """An output is not what was written."""


def seal(path) -> None:
    """Write the digest of a finished file behind its end."""
    stretches = _stretches_of_data(path)
    with open(path, "r+b") as f:
        size = f.seek(0, os.SEEK_END)
        f.write(stretches.tobytes() + _TAIL.pack(len(stretches), size, _digest(f, size, stretches), MAGIC))


def to_netcdf(ds, path, encoding=None) -> None:
    """Write an `xarray.Dataset` as a sealed file."""
    ds.to_netcdf(path, engine="h5netcdf", encoding=encoding)
    seal(path)


def reserve(path, size: int) -> None:
    """See that there is room for a file with so many bytes of data: HDF5 takes a full disk badly, and says so at
    length on standard error."""
    if not hasattr(os, "posix_fallocate"):
        return
    handle = os.open(path, os.O_CREAT | os.O_WRONLY, 0o666)
    try:
        os.posix_fallocate(handle, 0, size + 2**18)
    finally:
        os.close(handle)
        os.unlink(path)


def require_sound(path) -> None:
    """Raise `Damaged` if HDF5 had better not open this file."""
    path = Path(path)
    with open(path, "rb") as f:
        end = f.seek(0, os.SEEK_END)
        tail = b""
        if end >= _TAIL.size:
            f.seek(end - _TAIL.size)
            tail = f.read(_TAIL.size)
        if tail.endswith(MAGIC):
            count, size, digest, _ = _TAIL.unpack(tail)
            sound = size + 16 * count + _TAIL.size == end
            if sound:
                f.seek(size)
                stretches = np.frombuffer(f.read(16 * count), "<u8").reshape(-1, 2)
                sound = np.all(stretches <= size) and _digest(f, size, stretches) == digest
        else:
            sound = _survived(path)
    if not sound:
        raise Damaged(f"{path}: its structure is not what was written: the file is damaged, compute it again")


def _digest(f, size, stretches) -> bytes:
    """Of the stretches and of the `size` bytes of the file that are in none of them."""
    out = hashlib.blake2b(stretches.tobytes(), digest_size=16)
    at = 0
    for begin, end in [*stretches.tolist(), [size, size]]:
        f.seek(at)
        while at < min(begin, size):
            piece = f.read(min(_BLOCK, begin - at))
            out.update(piece)
            at += len(piece)
            if not piece:  # cut off while it is read
                break
        at = max(at, end)
    f.seek(0, os.SEEK_END)
    return out.digest()


def _stretches_of_data(path) -> np.ndarray:
    """(n, 2): begin and end of what the chunks of all arrays take in the file, in order; neighbours are one."""
    import h5py

    found = []
    with h5py.File(path, "r") as f:

        def chunks(name, a):
            if isinstance(a, h5py.Dataset) and a.chunks:
                add = lambda chunk: found.append((chunk.byte_offset, chunk.byte_offset + chunk.size))  # noqa: E731
                if hasattr(a.id, "chunk_iter"):
                    a.id.chunk_iter(add)
                else:
                    for k in range(a.id.get_num_chunks()):
                        add(a.id.get_chunk_info(k))

        f.visititems(chunks)
    merged: list = []
    for begin, end in sorted(found):
        if merged and merged[-1][1] == begin:
            merged[-1][1] = end
        else:
            merged.append([begin, end])
    return np.array(merged, "<u8").reshape(-1, 2)


# What a reader of an output does to it short of reading its data.
_TRY = """
import sys, h5py
def look(name, a):
    dict(a.attrs)
    if isinstance(a, h5py.Dataset):
        if a.chunks:
            a.id.get_num_chunks()
        elif a.size and a.size < 1 << 20:
            a[()]
        [d[name] for d in a.dims for name in d]
with h5py.File(sys.argv[1], "r") as f:
    dict(f.attrs)
    f.visititems(look)
"""
_tried: dict = {}


def _survived(path) -> bool:
    """Whether a process of its own gets through the structure of a file."""
    about = os.stat(path)
    key = (str(path), about.st_ino, about.st_size, about.st_mtime_ns)
    if key not in _tried:
        try:
            call, no = [sys.executable, "-c", _TRY, os.fspath(path)], subprocess.DEVNULL
            done = subprocess.run(call, stdin=no, stdout=no, stderr=no, timeout=PATIENCE)
            _tried[key] = done.returncode == 0
        except subprocess.TimeoutExpired:
            _tried[key] = False
    return _tried[key]
