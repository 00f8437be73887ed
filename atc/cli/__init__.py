"""The command line: one file a verb."""

from .root import app, main

__all__ = ["app", "main"]
