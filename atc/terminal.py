"""What reaches the terminal: file names, column names and texts of damaged files must not steer it."""

from __future__ import annotations

import contextlib
import sys


def printable(text: str) -> str:
    """`text` with everything a terminal would act on (escapes, bells, directions of writing) as question marks; line
    ends and tabs stay."""
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in "\n\t" else "?" for c in text)


class _Filtered:
    """A stream that passes printable text on to another one, and is that other one in all else."""

    def __init__(self, stream):
        self.stream = stream

    def write(self, text):
        return self.stream.write(printable(text) if isinstance(text, str) else text)

    def writelines(self, lines):
        for line in lines:
            self.write(line)

    def __getattr__(self, name):
        return getattr(self.stream, name)


@contextlib.contextmanager
def only_printable():
    """While this runs, whatever is printed to standard output or error is printable. `Console` draws past it, with its
    own filter."""
    out, err = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = _Filtered(out), _Filtered(err)
    try:
        yield
    finally:
        sys.stdout, sys.stderr = out, err


def unfiltered(stream):
    """The stream behind a filter: for what makes its own escapes (colours, progress bars) from texts that are clean."""
    return stream.stream if isinstance(stream, _Filtered) else stream
