"""Random access to the bytes of a file, plain or compressed, by position in the uncompressed text."""

from __future__ import annotations

import threading
import zlib
from pathlib import Path

import numpy as np

from ..errors import AtcError

_CHUNK = 1 << 18
_APART = 1 << 24  # decompressed bytes between two points from which a .gz can be resumed (about 40 kB of state each)


class PlainBytes:
    """`read(start, stop)` of an uncompressed file, as a uint8 array. Copies: a file that shrinks under a memory map kills the process."""

    def __init__(self, path):
        self.path = Path(path)
        self.hold = 0
        self._open()

    def _open(self):
        self._lock = threading.Lock()
        self._file = open(self.path, "rb", buffering=0)

    def read(self, start: int, stop: int) -> np.ndarray:
        out = np.empty(max(0, stop - start), np.uint8)
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

    def close(self):
        self._file.close()

    def __del__(self):
        if hasattr(self, "_file"):
            self._file.close()

    def __getstate__(self):
        return {"path": self.path, "hold": 0}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._open()


class StreamBytes:
    """The same for a compressed file: decompressed as far as needed, with a window that never drops what lies behind `hold`.

    A .gz can be resumed at points it passed every 16 MB, so going back costs one such stretch; a .bz2 or .xz starts again.
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
        import lzma

        return lzma.LZMADecompressor()

    def _rewind(self, start: int):
        best = next((m for m in reversed(self._marks) if m[0] <= start), None)
        self._window = bytearray()
        self._eof = False
        if best is None:
            self._begin, self._raw, self._d = 0, 0, self._decoder()
        else:
            self._begin, self._raw, self._d = best[0], best[1], best[2].copy()
        self._file.seek(self._raw)

    def _more(self):
        """Decompress one more chunk into the window."""
        raw = self._file.read(_CHUNK)
        if not raw:
            self._eof = True  # also inside a stream: a file still being written
            return
        self._raw += len(raw)
        try:
            while raw:
                self._window += self._d.decompress(raw)
                raw = b""
                if self._d.eof:  # several streams one after the other, as pigz or `cat a.gz b.gz` leave them
                    raw = self._d.unused_data.lstrip(b"\0")
                    self._d = self._decoder()
        except (zlib.error, OSError, ValueError, EOFError) as e:
            at = self._begin + len(self._window)
            raise AtcError(
                f"{self.path}: the compressed data are damaged behind byte {at} of the text ({e}); decompress it to see what is left"
            ) from None
        except Exception as e:  # lzma.LZMAError, only importable where lzma is
            raise AtcError(f"{self.path}: the compressed data are damaged ({e}); decompress it to see what is left") from None
        end = self._begin + len(self._window)
        if self.kind == "gz" and end - (self._marks[-1][0] if self._marks else 0) >= _APART:
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

    def close(self):
        self._file.close()

    def __del__(self):
        if hasattr(self, "_file"):
            self._file.close()

    def __getstate__(self):
        return {"path": self.path, "kind": self.kind}

    def __setstate__(self, state):
        self.__dict__.update(state)
        self._reset()


_MAGIC = ((b"\x1f\x8b", "gz"), (b"BZh", "bz2"), (b"\xfd7zXZ\x00", "xz"), (b"\x28\xb5\x2f\xfd", "zst"))


def open_bytes(path) -> PlainBytes | StreamBytes:
    """The bytes of `path`, decompressed if its first bytes (not its name) say so: gzip, bzip2 or xz."""
    path = Path(path)
    try:
        with open(path, "rb") as f:
            head = f.read(6)
    except FileNotFoundError:
        raise AtcError(f"{path}: there is no such file") from None
    except IsADirectoryError:
        raise AtcError(f"{path} is a directory: name a trajectory file") from None
    except OSError as e:
        raise AtcError(f"{path}: cannot be read ({e.strerror})") from None
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            if kind == "zst":
                raise AtcError(f"{path}: zstd-compressed files are not read; decompress it first (zstd -d)")
            return StreamBytes(path, kind)
    return PlainBytes(path)
