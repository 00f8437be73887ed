"""Random access to the bytes of a file, plain or compressed, by position in the uncompressed text."""

from __future__ import annotations

import contextlib
import importlib
import os
import stat
import threading
import zlib
from pathlib import Path

import numpy as np

from ..errors import AtcError

_CHUNK = 1 << 18
_APART = 1 << 24  # decompressed bytes between two points from which a .gz can be resumed (about 40 kB of state each)
_PIECE = 1 << 22  # at most so many bytes come out of the decompressor at once, whatever went in
# Numbers of a dump shrink to a third; coordinates that repeat, to a thirtieth. A file that swells 300-fold beyond this
# many bytes is none.
_BOMB, _SWELL = 1 << 28, 300


class _Opened:
    """What has an open `_file`."""

    def close(self):
        self._file.close()

    def __del__(self):
        if hasattr(self, "_file"):
            self._file.close()


class PlainBytes(_Opened):
    """`read(start, stop)` of an uncompressed file, as a uint8 array. Copies: a file that shrinks under a memory map
    kills the process."""

    def __init__(self, path):
        self.path = Path(path)
        self.hold = 0
        self._open()

    def _open(self):
        self._lock = threading.Lock()
        self._file = open(self.path, "rb", buffering=0)

    def read(self, start: int, stop: int) -> np.ndarray:
        # Whatever a damaged header asks for: never room for more than the file holds.
        stop = min(stop, os.fstat(self._file.fileno()).st_size)
        out = np.empty(max(0, stop - start), np.uint8)
        if not len(out):
            return out
        view = memoryview(out)
        got = 0
        with self._lock:
            self._file.seek(start)
            while got < len(out):
                n = self._file.readinto(view[got:])
                if not n:
                    break
                got += n
        return out[:got]

    def __getstate__(self):
        return {"path": self.path, "hold": 0}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._open()


class StreamBytes(_Opened):
    """The same for a compressed file: decompressed as far as needed, with a window that never drops what lies behind
    `hold`.

    A .gz can be resumed at points it passed every 16 MB, so going back costs one such stretch; a .bz2 or .xz starts
    again.
    """

    def __init__(self, path, kind: str):
        self.path, self.kind = Path(path), kind
        self._reset()

    def _reset(self):
        self._lock = threading.Lock()
        self._marks = []
        self.hold = 0
        self._file = open(self.path, "rb")
        self._rewind(0)

    def _decoder(self):
        if self.kind == "gz":
            return zlib.decompressobj(wbits=31)
        if self.kind == "bz2":
            import bz2

            return bz2.BZ2Decompressor()
        if self.kind == "zst":
            return _zstd(self.path).ZstdDecompressor()
        import lzma

        return lzma.LZMADecompressor()

    def _rewind(self, start: int):
        best = next((m for m in reversed(self._marks) if m[0] <= start), None)
        self._window = bytearray()
        self._eof = False
        self._rest = b""
        if best is None:
            self._begin, self._raw, self._d = 0, 0, self._decoder()
        else:
            self._begin, self._raw, self._d = best[0], best[1], best[2].copy()
        self._file.seek(self._raw)

    def _more(self):
        """Decompress one more piece into the window."""
        waiting = self.kind != "gz" and not self._d.eof and not self._d.needs_input
        raw = self._rest
        if not raw and not waiting:
            raw = self._file.read(_CHUNK)
            if not raw:
                self._eof = True  # also inside a stream: a file still being written
                return
            self._raw += len(raw)
        at = self._begin + len(self._window)
        try:
            self._window += self._d.decompress(raw, _PIECE)
            self._rest = self._d.unconsumed_tail if self.kind == "gz" else b""
            if self._d.eof:  # several streams one after the other, as pigz or `cat a.gz b.gz` leave them
                self._rest = self._d.unused_data.lstrip(b"\0")
                self._d = self._decoder()
        except Exception:  # zlib.error, OSError, EOFError, lzma.LZMAError: each library has its own
            raise AtcError(
                f"{self.path}: the compressed data are damaged behind byte {at} of the text; decompress the file to "
                "see what is left"
            ) from None
        end = self._begin + len(self._window)
        if end > _BOMB and end > _SWELL * self._raw:
            raise AtcError(
                f"{self.path}: {self._raw} compressed bytes swell to more than {end}: no trajectory shrinks like "
                "that; decompress the file and look at it"
            )
        # A mark is a point of the file from which a copy of the decompressor goes on: only where nothing waits to be
        # decompressed.
        if self.kind == "gz" and not self._rest and end - (self._marks[-1][0] if self._marks else 0) >= _APART:
            self._marks.append((end, self._raw, self._d.copy()))

    def read(self, start: int, stop: int) -> np.ndarray:
        with self._lock:
            if start < self._begin:
                self._rewind(start)
            while not self._eof and self._begin + len(self._window) < stop:
                drop = min(start, max(self.hold, self._begin)) - self._begin
                drop = min(drop, len(self._window))
                if drop > _CHUNK:
                    del self._window[:drop]
                    self._begin += drop
                self._more()
            a = start - self._begin
            return np.frombuffer(bytes(memoryview(self._window)[a : max(a, stop - self._begin)]), np.uint8)

    def __getstate__(self):
        return {"path": self.path, "kind": self.kind}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._reset()


_MAGIC = ((b"\x1f\x8b", "gz"), (b"BZh", "bz2"), (b"\xfd7zXZ\x00", "xz"), (b"\x28\xb5\x2f\xfd", "zst"))


def require_file(path) -> Path:
    """`path`, if it can be opened and read again and again: a regular file. Anything else is an AtcError; nothing is
    waited for."""
    path = Path(path)
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        raise AtcError(f"{path}: there is no such file") from None
    except (OSError, ValueError) as e:  # a name too long, a loop of links, no permission, a zero byte in the name
        name = str(path)
        shown = name if len(name) < 200 else f"{name[:80]} ... {name[-40:]}"
        raise AtcError(
            f"{shown}: cannot be opened ({(getattr(e, 'strerror', None) or 'no possible name of a file').lower()})"
        ) from None
    if stat.S_ISDIR(mode):
        raise AtcError(f"{path} is a directory: name a trajectory file")
    if not stat.S_ISREG(mode):
        raise AtcError(f"{path} is a pipe or a device: a trajectory is read back and forth; write it to a file first")
    return path


def open_bytes(path) -> PlainBytes | StreamBytes:
    """The bytes of `path`, decompressed if its first bytes (not its name) say so: gzip, bzip2, xz, or zstd where Python
    can."""
    path = require_file(path)
    try:
        with open(path, "rb") as f:
            head = f.read(6)
    except OSError as e:
        raise AtcError(f"{path}: cannot be read ({(e.strerror or 'input/output error').lower()})") from None
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            if kind == "zst":
                _zstd(path)
            return StreamBytes(path, kind)
    return PlainBytes(path)


def head_of(path) -> bytes:
    """The first kilobytes of a file, decompressed: what tells its format."""
    with contextlib.closing(open_bytes(path)) as reader:
        return reader.read(0, 1 << 14).tobytes()


def _zstd(path):
    """The module for zstd: Python's own from 3.14 on, else the package that gives it to older ones."""
    for name in ("compression.zstd", "backports.zstd"):
        with contextlib.suppress(ImportError):
            return importlib.import_module(name)
    raise AtcError(
        f"{path}: reading zstd-compressed files needs Python 3.14 or the package backports.zstd; install it, or "
        "decompress first (zstd -d)"
    )
