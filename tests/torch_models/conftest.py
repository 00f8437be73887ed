"""mace tells torch how the files of its e3nn are read, so that it must be imported before that."""

from importlib.util import find_spec

if find_spec("mace") is not None:
    import mace  # noqa: F401
