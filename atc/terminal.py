"""What reaches people: the terminal, which file names, column names and texts of damaged files must not steer; tables
and progress bars in notebooks."""

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


def tell(console, lines, notes=()) -> None:
    """Print lines on a console, and notes behind them; none is broken or cut."""
    for line in (*lines, *(f"note: {note}" for note in notes)):
        console.print(line, soft_wrap=True)


def html_table(title: str, rows) -> str:
    """What objects show in notebooks: a title and rows of (what, value)."""
    from html import escape

    left = 'style="text-align:left"'
    cells = "".join(
        f"<tr><th {left}>{escape(str(what))}</th><td {left}>{escape(str(value))}</td></tr>" for what, value in rows
    )
    return f"<div><b>{escape(title)}</b><table>{cells}</table></div>"


@contextlib.contextmanager
def progress_of(progress, total: int | None = None):
    """What ``progress=True`` means: a bar, in notebooks as in a terminal; anything else as it is."""
    if progress is not True:
        yield None if progress is False else progress
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("frames"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, transient=False) as bars:
        task = bars.add_task("frames", total=total)
        yield lambda done, all_of_them, rate: bars.update(task, completed=done, total=all_of_them)
