"""The command line: one file a verb."""

__all__ = ["app", "main"]


def main() -> None:
    """Entry point of the ``atc`` command."""
    import signal

    # Until the command hears signals itself, and after it, Ctrl-C ends this process as SIGTERM does: without the
    # traceback of an import.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from .root import main as run

    run()


def __getattr__(name):
    if name == "app":
        from .root import app

        return app
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
