"""The one exception a user of atc is meant to see."""


class AtcError(Exception):
    """Input that cannot be used: one line that names the file, key or line, what was expected and what to do.

    The command line prints it without a traceback and exits with status 2.
    """


class AtcWarning(UserWarning):
    """Something that is probably not what the user meant, though it can be computed."""
