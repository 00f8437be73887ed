"""The one exception a user of atc is meant to see, and its warnings."""

import contextlib


class AtcError(Exception):
    """Input that cannot be used: one line that names the file, key or line, what was expected and what to do.

    The command line prints it without a traceback and exits with status 2.
    """


class AtcWarning(UserWarning):
    """Something that is probably not what the user meant, though it can be computed.

    Said to Python's logging (logger "atc") as well, for programs that log.
    """

    def __init__(self, *args):
        super().__init__(*args)
        if args:
            logger().warning("%s", args[0])


@contextlib.contextmanager
def located(where: str):
    """What is wrong within is said to be at a file, frame or line."""
    try:
        yield
    except AtcError as e:
        raise AtcError(f"{where}: {e}") from None


def logger():
    """Python's logger "atc": warnings, and (level INFO) what is computed and how. Silent until a program sets logging
    up."""
    import logging

    found = logging.getLogger("atc")
    if not found.handlers:
        found.addHandler(logging.NullHandler())
    return found


@contextlib.contextmanager
def heard():
    """The sentences of all warnings of atc in the meantime, which are shown as ever."""
    import warnings

    said: list[str] = []
    show = warnings.showwarning

    def listen(message, category, *more, **named):
        if issubclass(category, AtcWarning):
            said.append(str(message))
        show(message, category, *more, **named)

    warnings.showwarning = listen
    try:
        yield said
    finally:
        warnings.showwarning = show
