"""`njit` as the kernels of this package use it: numba's, with a cache that cannot be wrong and that nothing depends on.

Numba's own cache looks only at the file of a function for changes. A function of another file that was compiled into
it, or a constant imported from there, may have changed since, after an upgrade for instance, and the old machine code
would go on giving the old numbers. Here a cache entry is bound to all source files whose functions a kernel calls, and
to the constants it uses. Where no folder can be written, code is compiled anew in each process, with a note.
"""

from __future__ import annotations

import gc
import hashlib
import inspect
import os
import tempfile
import warnings
from functools import cache
from pathlib import Path
from types import FunctionType, ModuleType

import numba
import numpy as np
from numba.core import config, event, types
from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.targetconfig import ConfigStack

from .errors import AtcWarning

__all__ = ["as_tuple", "njit", "specialise"]


def njit(**options):
    """A decorator: ``numba.njit(**options)``; with ``cache=True`` in this package's cache."""
    keep = options.pop("cache", False)
    # An entry for C code, which nothing here calls.
    options.setdefault("no_cfunc_wrapper", True)

    def decorate(function):
        dispatcher = numba.njit(**options)(function)
        if keep:
            try:
                dispatcher._cache = _Cache(function)
            except RuntimeError:  # numba's word for "no place"
                _say_once()
        return dispatcher

    return decorate


def specialise(function, tag: str, options: dict, **names):
    """Compile a copy of `function`, with `njit`'s `options`, in which the global `names` have other values: a law in a
    loop, a β in a sum.

    A copy under its own name (`tag`) is what can be kept on disk; a closure over a compiled function would be compiled
    anew in every run. Nothing is kept of functions that were typed in and stand in no file: what they say tomorrow
    cannot be compared with what they said today.
    """
    given = [v.py_func for v in names.values() if hasattr(v, "py_func")]
    if not all(os.path.isfile(inspect.getfile(f)) for f in given):
        options = {**options, "cache": False}
    copy = FunctionType(function.__code__, {**function.__globals__, **names}, function.__name__, function.__defaults__)
    copy.__qualname__ = f"{function.__qualname__}_{tag}"
    copy.__module__ = function.__module__
    return njit(**options)(copy)


def tag_of(*laws) -> str:
    """What tells specialised copies for these compiled functions apart."""
    h = hashlib.sha256()
    for law in laws:
        f = law.py_func
        h.update(f"{f.__module__}.{f.__qualname__}".encode() + f.__code__.co_code + repr(f.__code__.co_consts).encode())
    return f"{laws[0].py_func.__name__}_{h.hexdigest()[:12]}"


def as_tuple(a):
    """The numbers of a small array, as a tuple of tuples: what loops take that is the same in every turn. Compiling
    that reads them costs a fraction of what reading arrays does."""
    return tuple(map(as_tuple, a)) if np.ndim(a) > 1 else tuple(np.asarray(a).tolist())


class _Locator(_CacheLocator):
    """Where a kernel's code is kept, and what it depends on."""

    def __init__(self, function, file, folder):
        self._function, self._file, self._folder = function, file, folder

    @classmethod
    def from_function(cls, function, file):
        folder = _folder(os.path.dirname(os.path.abspath(file)), getattr(config, "CACHE_DIR", "") or "")
        return None if folder is None else cls(function, file, folder)

    def get_cache_path(self):
        return self._folder

    def get_source_stamp(self):
        return _stamp(self._function)

    def get_disambiguator(self):
        return str(self._function.__code__.co_firstlineno)


class _Implementation(CompileResultCacheImpl):
    _locator_classes = [_Locator]  # type: ignore[list-item]  # noqa: RUF012


class _Cache(FunctionCache):
    """Neither an entry that cannot be read nor a disk without room keeps a kernel from being compiled."""

    _impl_class = _Implementation

    def load_overload(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # half an entry, another numba's, not ours to read: whatever it is, it is no code for us
            return None

    def save_overload(self, sig, data):
        try:
            try:
                super().save_overload(sig, data)
            except OSError:
                raise
            except Exception:  # the list of entries is damaged: begin a new one
                self.flush()
                super().save_overload(sig, data)
        except OSError:
            _say_once()


class _Quicker(event.Listener):
    """What saves a quarter of numba's time while it compiles. Garbage waits: looking again and again through millions
    of objects that live until it is done takes a tenth. And what `+` of two floats is, or `peek` of two integers, is
    found out once, not by all templates of the function in turn at every place where it stands, which takes a fifth."""

    def __init__(self):
        self._depth, self._on = 0, False

    # In the thread that holds the compiler's lock.
    def on_start(self, event):
        if not self._depth:
            self._on = gc.isenabled()
            gc.disable()
            if _AS_KNOWN:
                types.Function.get_call_type = _call_type  # type: ignore[method-assign]
        self._depth += 1

    def on_end(self, event):
        self._depth -= 1
        if not self._depth:
            if _AS_KNOWN:
                del types.Function.get_call_type  # that of its base again
            if self._on:
                gc.enable()


#: Whether numba is built as `_call_type` takes it to be (0.59 to 0.68 are); if not, nothing of it is replaced.
_AS_KNOWN = (
    "get_call_type" not in vars(types.Function) and {"get_call_type", "get_impl_key"} <= vars(types.BaseFunction).keys()
)

# Signatures of functions for types of arguments: those found under each set of options, as some are compiled with them.
_found: dict = {}
_under: list = [None, {}]


def _call_type(self, context, args, kws):
    """What numba's own finds, found once. Functions that more templates were added to are other ones, with a table of
    their own."""
    options = ConfigStack.top_or_none()
    if options is not _under[0]:
        _under[:] = options, _found.setdefault(options, {})
    key = (context, self.templates, args, tuple(kws.items()))
    if key not in _under[1]:
        sig = super(types.Function, self).get_call_type(context, args, kws)
        _under[1][key] = sig, self.get_impl_key(sig)
    sig, implementation = _under[1][key]
    self._impl_keys[sig.args] = implementation
    return sig


event.register("numba:compile", _Quicker())


# --- where


@cache
def _folder(source: str, given: str) -> str | None:
    """The folder for the kernels of a source folder: in NUMBA_CACHE_DIR, beside the sources, or in the user's cache;
    None where none can be written.

    Never in a folder that others can write: machine code is loaded from it.
    """
    name = f"{os.path.basename(source)}_{hashlib.sha1(source.encode()).hexdigest()}"
    home = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    places = [os.path.join(given, name)] if given else []
    places.append(os.path.join(source, "__pycache__"))
    if os.path.isabs(home):
        places.append(os.path.join(home, "numba", name))
    for place in places:
        try:
            os.makedirs(place, exist_ok=True)
            with tempfile.TemporaryFile(dir=place):
                return place
        except OSError:
            continue
    return None


@cache
def _say_once() -> None:
    import multiprocessing

    if multiprocessing.current_process().name == "MainProcess":  # workers leave it to their parent
        warnings.warn(
            "compiled code cannot be kept, as no folder for it can be written: it is compiled anew in every run, "
            "which takes some ten seconds; set NUMBA_CACHE_DIR to a folder that can be written",
            AtcWarning,
            stacklevel=2,
        )


# --- what code depends on


def _stamp(function) -> str:
    """A digest of the sources and constants that the machine code of a function is made of."""
    h = hashlib.sha256()
    seen: set[int] = set()
    files: set[str] = set()

    def walk(f):
        if id(f) in seen:
            return
        seen.add(id(f))
        files.add(inspect.getfile(f))
        names = list(f.__code__.co_names) + [
            name for c in f.__code__.co_consts if inspect.iscode(c) for name in c.co_names
        ]
        cells = zip(f.__code__.co_freevars, (c.cell_contents for c in f.__closure__ or ()))
        for name, value in [*((n, f.__globals__[n]) for n in names if n in f.__globals__), *cells]:
            take(name, value)

    def take(name, value):
        inner = getattr(value, "py_func", None) or getattr(value, "_defn", None)  # a dispatcher, an intrinsic
        if isinstance(inner, FunctionType):
            walk(inner)
        elif isinstance(value, FunctionType):
            files.add(inspect.getfile(value))
        elif isinstance(value, ModuleType):
            if value.__name__.split(".")[0] == __name__.split(".")[0]:
                files.add(str(value.__file__))
        elif isinstance(value, np.ndarray):
            h.update(f"{name}{value.dtype.str}{value.shape}".encode() + value.tobytes())
        elif isinstance(value, (int, float, complex, str, bool, tuple, np.generic)):
            h.update(f"{name}={value!r}".encode())

    walk(function)
    for file in sorted(files):
        h.update(os.path.basename(file).encode() + _content(file))
    return h.hexdigest()


@cache
def _content(file: str) -> bytes:
    try:
        return hashlib.sha256(Path(file).read_bytes()).digest()
    except OSError:
        return b""
