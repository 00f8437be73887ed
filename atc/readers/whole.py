"""Whole files in memory, with bounds: what comes in is not more than the file holds, and no pipe or device is waited
for."""

from __future__ import annotations

import contextlib
import stat
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ._bytes import StreamBytes, open_bytes

_PIECE = 1 << 24
# Columns of numbers shrink to a third, of repeated ones to a thirtieth; more than this from a compressed file is not
# read.
_SMALL, _SWELL = 1 << 28, 100
LARGEST = 1 << 40
#: Bytes of the largest potential file, table or molecule: those of LAMMPS have 20 MB at most.
LARGEST_TEXT = 1 << 28


def whole_bytes(path, largest: int = LARGEST) -> np.ndarray:
    """(n,) uint8 of a file, decompressed if it is compressed, with a line end at the end."""
    buf = bytes_as_they_are(path, largest)
    return buf if len(buf) and buf[-1] == 10 else np.append(buf, np.uint8(10))


def bytes_as_they_are(path, largest: int = LARGEST) -> np.ndarray:
    """The same, whatever the file ends with."""
    with contextlib.closing(open_bytes(path)) as reader:
        size = Path(path).stat().st_size
        if not isinstance(reader, StreamBytes):
            if size > largest:
                raise AtcError(f"{path}: {size} bytes are more than the {largest} that such a file may have")
            return reader.read(0, size)
        largest = min(largest, max(_SMALL, _SWELL * size))
        parts, at = [], 0
        while len(part := reader.read(at, at + _PIECE)):
            parts.append(part)
            at += len(part)
            if at > largest:
                raise AtcError(
                    f"{path}: {size} compressed bytes hold more than the {largest} bytes that such a file may have"
                )
    return np.concatenate(parts) if parts else np.zeros(0, np.uint8)


def whole_text(path, what: str, where: str = "") -> str:
    """The text of a `what` file ("Tersoff", "EAM", ...) that a line of a script names.

    Parameters
    ----------
    where : file and line that named it, for messages

    Raises
    ------
    AtcError for what cannot be read.
    """
    at = f"{where}: " if where else ""
    name = str(path)
    name = name if len(name) < 200 else f"{name[:80]} ... {name[-40:]}"
    try:
        mode = Path(path).stat().st_mode
        if stat.S_ISDIR(mode):
            raise AtcError(f"{at}cannot read the {what} file {name!r} (it is a directory): give the path of a file")
        if not stat.S_ISREG(mode):
            raise AtcError(
                f"{at}cannot read the {what} file {name!r} (it is a pipe or a device): write it to a file first"
            )
        text = whole_bytes(path, LARGEST_TEXT).tobytes()
    except (OSError, ValueError) as e:
        why = getattr(e, "strerror", None) or "no possible name of a file"
        raise AtcError(
            f"{at}cannot read the {what} file {name!r} ({why}): give its path relative to the input"
        ) from None
    if b"\0" in text[: 1 << 16]:
        raise AtcError(f"{at}the {what} file {name!r} is not a text file: it holds zero bytes")
    return text.decode("utf-8", "replace")
