"""Being asked to stop: Ctrl-C, SIGTERM and a lost terminal end a command in the same orderly way, and never in the
middle of what must be done whole."""

from __future__ import annotations

import _thread
import contextlib
import os
import signal
import sys
import threading
import time

#: What each signal is called in messages.
_WORDS = {"SIGINT": "interrupted", "SIGTERM": "terminated", "SIGHUP": "the terminal has gone"}
#: Packages in the middle of which nothing may be raised: HDF5 loses an exception or makes another one of it, and so do
#: callbacks of weak references.
_FRAGILE = {"h5py", "h5netcdf", "weakref", "_weakrefset"}
#: Seconds until a signal that came in the middle of these is tried again.
_AGAIN_AFTER = 0.01


class Stopped(KeyboardInterrupt):
    """A signal to stop. `number` is the signal's, the exit status 128 more, `word` what it is called."""

    def __init__(self, number: int):
        super().__init__(number)
        self.number = number
        self.word = _WORDS.get(signal.Signals(number).name, "stopped")

    @property
    def status(self) -> int:
        return 128 + self.number


class _Watch:
    """The signals of this process while a command runs. The first one stops it as soon as nothing must be finished
    first; the second one at once."""

    def __init__(self):
        self.held = 0
        self.pending: int | None = None
        self.heard = 0
        self.again = False

    def __call__(self, number, frame):
        if self.again:
            self.again = False
            if self.pending is None:  # raised meanwhile
                return
        else:
            self.heard += 1
            if self.heard > 1:
                _at_once(number)
            self.pending = number
        if self.held:
            return
        if _within(frame, _FRAGILE):
            self.try_again(number)
        else:
            self.raise_pending()

    def raise_pending(self):
        global _last
        number, self.pending = self.pending, None
        if number is not None:
            _last = number
            # Not kept: its traceback would hold whatever the interrupted functions had open.
            raise Stopped(number)

    def try_again(self, number):
        """Have the signal come once more in a moment."""

        def send():
            time.sleep(_AGAIN_AFTER)
            if _watch is not self:
                return
            self.again = True
            main = threading.main_thread().ident
            if hasattr(signal, "pthread_kill") and main is not None:  # ends waiting, too
                signal.pthread_kill(main, number)
            else:
                _thread.interrupt_main(number)

        # In a signal handler no lock may be waited for, as `threading` does.
        _thread.start_new_thread(send, ())

    def unraisable(self, before):
        """A hook that hears of exceptions which Python cannot raise where they come up: one that says to stop is
        raised again."""

        def hook(what):
            if issubclass(what.exc_type, Stopped) and what.exc_value is not None:
                self.pending = what.exc_value.number
                self.try_again(self.pending)
            else:
                before(what)

        return hook


_watch: _Watch | None = None
_last: int | None = None


def last() -> Stopped | None:
    """The signal that stopped this process last: libraries turn a KeyboardInterrupt into exceptions of their own."""
    return None if _last is None else Stopped(_last)


def _within(frame, packages) -> bool:
    """Whether a function of these packages is being executed."""
    while frame is not None:
        if frame.f_globals.get("__name__", "").partition(".")[0] in packages:
            return True
        frame = frame.f_back
    return False


@contextlib.contextmanager
def watched(names=tuple(_WORDS)):
    """Around a command: signals that ask to stop raise `Stopped`. Only in the main thread, and only where nobody else
    handles them."""
    global _watch, _last
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before, hook = {}, sys.unraisablehook
    _watch, _last = _Watch(), None
    sys.unraisablehook = _watch.unraisable(hook)
    for name in names:
        number = getattr(signal, name, None)
        # nohup: who is told to ignore a signal ignores it.
        if number is not None and signal.getsignal(number) in (signal.SIG_DFL, signal.default_int_handler):
            before[number] = signal.signal(number, _watch)
    try:
        yield
    finally:
        _watch, sys.unraisablehook = None, hook
        for number, handler in before.items():
            signal.signal(number, handler)


@contextlib.contextmanager
def whole():
    """What is done within is done whole: a signal to stop is heard when it is over."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    # Called from somebody's own program: there, Ctrl-C alone is our business.
    with contextlib.nullcontext() if _watch is not None else watched(("SIGINT",)):
        watch = _watch
        assert watch is not None  # `watched` has set it
        watch.held += 1
        try:
            yield
        finally:
            watch.held -= 1
        if not watch.held:
            watch.raise_pending()


def asked() -> bool:
    """Whether a signal to stop waits for `whole` to end."""
    return _watch is not None and _watch.pending is not None


def _at_once(number: int) -> None:
    """Leave without looking back; worker processes see that this one is gone (`in_worker`)."""
    import multiprocessing

    for child in multiprocessing.active_children():
        child.kill()
    with contextlib.suppress(OSError):
        os.write(2, b"error: stopped at once; what was finished before is kept\n")
    os._exit(128 + number)


@contextlib.contextmanager
def unheard():
    """Processes that are started within hear no signal to stop before they say which they want to (`in_worker`): what a
    terminal or a scheduler sends goes to all, while they are still importing. This one hears them afterwards, those
    that another of its threads got, too: a process half started would complain."""
    with whole(), _masked():
        yield


@contextlib.contextmanager
def _masked():
    """This thread, and what it starts, gets no signal to stop."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    from multiprocessing import resource_tracker

    numbers = {getattr(signal, name) for name in _WORDS}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
    try:
        # The process that the library keeps beside its own, too: it hears the lost terminal, and by starting it two
        # signals come through again.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, numbers)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def in_worker() -> None:
    """In a worker process: signals to stop are the parent's business, and it ends when the parent has gone, however
    that went."""
    import multiprocessing
    from multiprocessing import connection

    for name in _WORDS:
        number = getattr(signal, name, None)
        if number is not None:
            signal.signal(number, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    assert parent is not None

    def wait():
        connection.wait([parent.sentinel])
        # No clean-up: nobody is left whom it could serve, and threads may be deep in a computation.
        os._exit(1)

    threading.Thread(target=wait, daemon=True, name="end with parent").start()
