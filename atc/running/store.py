"""Results on disk, frame by frame: nothing under the final name until everything is there; a killed run can go on.

While a run lasts, everything is in ``OUT.partial/``: ``request.json`` (what is being computed), ``data.zarr``,
``journal.jsonl`` (one line for each entry that is complete) and, for time averages, ``state.npz``. At the end
``data.zarr`` is renamed to OUT, or copied entry by entry to a NetCDF file which is renamed. From before that until
everything else is cleared away, ``made.json`` says how the finished output is known again: a run that is killed in
between and begun once more finds that it was at its end.
"""

from __future__ import annotations

import json
import os
import shutil
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import AtcError
from ..planning.identity import differences
from .output import Layout, check_name, clean, every_chunk, explained
from .sealed import reserve, seal
from .whole import renamed


class Store:
    """The unfinished output of one run.

    Parameters
    ----------
    out : path ending in .zarr or .nc
    request : dict of plain values
        What is being computed. An unfinished output of another request is never continued.
    resume : bool
        False: throw an unfinished output away and begin again.

    Raises
    ------
    AtcError
        if the place cannot be written, is in use by another run, or holds an unfinished output of another request.
    """

    def __init__(self, out, request: dict, resume: bool = True):
        self.out = check_name(out)
        self.partial = self.out.with_name(self.out.name + ".partial")
        # Both from `begin` on.
        self.layout: Any = None
        self._group: Any = None
        self._arrays: dict = {}
        self.journal: list[dict] = []
        #: Whether the output stands under its name already, and only clearing away was left to do.
        self.published = False
        with explained(self.out, self.partial):
            if not self.out.parent.is_dir():
                raise AtcError(f"{self.out}: the directory {self.out.parent} does not exist")
            if self.out.suffix == ".nc" and self.out.is_dir():
                raise AtcError(f"{self.out}: is a directory; choose another name")
            self.partial.mkdir(exist_ok=True)
            self._lock()
            self._recover()
            request = json.loads(json.dumps(request, sort_keys=True))
            known = self._read_json("request.json")
            if not resume:
                self._clear()
            elif known is not None and (why := _other(known, request)):
                self._unlock()
                raise AtcError(
                    f"{self.partial}: holds an unfinished run of another request (different: {why}): finish that one, "
                    "delete the directory, or start again without resuming"
                )
            elif known is None:
                self._clear()
            self._write_json("request.json", request)
            journal = self.partial / "journal.jsonl"
            self.published = published(self.out)
            if journal.exists() and (self.published or (self.partial / "data.zarr").is_dir()):
                for line in journal.read_bytes().split(b"\n"):
                    note = _of_line(line)
                    if note is None:  # the kill came while this line was written, or it is not what was written
                        break
                    self.journal.append(note)
                # Forget a half-written line, so that the next one starts on its own.
                self._write_journal()

    def keep(self, count: int, of: int) -> None:
        """Forget all entries but the first `count`, for an output that shall have `of`."""
        if self.published and not count == len(self.journal) == of:
            self.published, count = False, 0  # what is finished cannot be added to
        if count < len(self.journal):
            del self.journal[count:]
            with explained(self.out, self.partial):
                self._write_journal()
                (self.partial / "state.npz").unlink(missing_ok=True)

    def _write_journal(self) -> None:
        with renamed(self.partial / "journal.jsonl") as part:
            part.write_text("".join(map(_line, self.journal)))

    # --- while running
    @property
    def done(self) -> int:
        """Number of complete entries; they are the first ones."""
        return len(self.journal)

    def begin(self, layout: Layout) -> None:
        """Create the arrays, or check that those of an earlier run fit."""
        import numcodecs
        import zarr

        self.layout = layout
        if self.published:
            return
        path = str(self.partial / "data.zarr")
        with explained(self.out, self.partial):
            if self.done:
                for half in (self.partial / "data.zarr").glob("**/*.partial"):
                    half.unlink()  # a chunk that a kill left unfinished under a name of its own
                try:
                    with every_chunk():
                        self._group = zarr.open_group(path, mode="r+")
                        self._arrays = dict(self._group.arrays())
                    missing = [v.name for v in layout.variables if v.name not in self._arrays]
                except Exception as e:  # each layer of the format has its own words for damage
                    missing = [type(e).__name__]
                if missing:
                    raise AtcError(
                        f"{path}: the unfinished run there is damaged ({missing[0]} cannot be read): delete "
                        f"{self.partial}, or start again without resuming"
                    )
                for v in layout.variables:
                    array, shape = self._arrays[v.name], v.whole_shape(layout.entries)
                    if array.shape != shape:  # the trajectory may have grown
                        array.resize(shape)
                        if v.static is not None:
                            array[...] = v.static
                return
            shutil.rmtree(path, ignore_errors=True)
            self._group = zarr.open_group(path, mode="w", zarr_format=2)
            for v in layout.variables:
                with every_chunk():
                    array = self._group.create_array(
                        v.name,
                        shape=v.whole_shape(layout.entries),
                        chunks=v.chunks(),
                        dtype=v.dtype,
                        fill_value=_fill(v.dtype),
                        filters=[numcodecs.CRC32()],
                        attributes={"_ARRAY_DIMENSIONS": list(v.all_dims), **clean(v.attrs)},
                    )
                self._arrays[v.name] = array
                if v.static is not None and v.static.size:
                    array[...] = v.static

    def write(self, values: dict, note: dict) -> None:
        """The next entry: one array a variable, and `note` (plain values) for the journal. Complete when this
        returns."""
        k = self.done
        with explained(self.out, self.partial):
            for v in self.layout.variables:
                if v.static is None:
                    self._arrays[v.name][k] = np.asarray(values[v.name], dtype=v.dtype)
            with open(self.partial / "journal.jsonl", "a") as f:
                f.write(_line(note))
                f.flush()
                os.fsync(f.fileno())
        self.journal.append(note)
        (self.partial / "state.npz").unlink(missing_ok=True)

    def save_state(self, arrays: dict) -> None:
        """Keep what an unfinished time average needs to go on."""
        with explained(self.out, self.partial), renamed(self.partial / "state.npz") as part:
            np.savez(part, **arrays)

    def load_state(self) -> dict | None:
        """What `save_state` kept, if the run was stopped within an average."""
        path = self.partial / "state.npz"
        if not path.exists():
            return None
        try:
            with np.load(path) as f:
                return {k: f[k] for k in f.files}
        except Exception:  # each layer of the format has its own words for damage: the window begins again
            return None

    def remember(self, name: str, value) -> None:
        """Keep plain values that an interrupted run must find again."""
        with explained(self.out, self.partial):
            self._write_json(f"{name}.json", {"value": value, "checksum": _checksum(value)})

    def recall(self, name: str):
        """What `remember` kept, or None, also where it is no longer that."""
        kept = self._read_json(f"{name}.json")
        whole = isinstance(kept, dict) and "value" in kept and kept.get("checksum") == _checksum(kept["value"])
        return kept["value"] if whole else None

    # --- the end
    def finish(self, attrs: dict) -> None:
        """Set the final attributes (by variable; "" for the dataset), rename, and clear away what is no longer
        needed."""
        self.publish(attrs)
        self.clear_away()

    def publish(self, attrs: dict) -> None:
        """Set the final attributes and rename."""
        import zarr

        if self.published:
            return
        with explained(self.out, self.partial):
            path = self.partial / "data.zarr"
            for v in self.layout.variables:
                if v.name in attrs:
                    self._arrays[v.name].attrs.update(clean(attrs[v.name]))
            names = " ".join(v.name for v in self.layout.variables if not v.coordinate)
            self._group.attrs.update(clean({**self.layout.attrs, **attrs.get("", {}), "variables": names}))
            coordinates = " ".join(v.name for v in self.layout.variables if v.coordinate and v.all_dims != (v.name,))
            if coordinates:
                self._group.attrs["coordinates"] = coordinates
            if self.out.suffix == ".nc":
                made = self.partial / "data.nc"
                self._to_netcdf(made, attrs)
            else:
                made = path
                zarr.consolidate_metadata(str(path), zarr_format=2)
            self._write_json("made.json", _known_by(made))
            if self.out.suffix == ".nc":
                os.replace(made, self.out)
            else:
                self._swap(made)
        self.published = True

    def clear_away(self) -> None:
        """Remove what a finished output does not need; last what says that it is finished."""
        with explained(self.out, self.partial):
            last = ("made.json", "request.json", "journal.jsonl", "lock")
            self._remove_all_but(last)
            for name in last[:2]:
                (self.partial / name).unlink(missing_ok=True)
            self._unlock()
            shutil.rmtree(self.partial)

    def _swap(self, path) -> None:
        """Rename a directory over another: the old one steps aside first and comes back if the second step never
        happens."""
        old = self.partial / "old"
        if self.out.exists():
            os.rename(self.out, old)
        os.rename(path, self.out)

    def _recover(self) -> None:
        old = self.partial / "old"
        if old.exists() and not self.out.exists():
            os.rename(old, self.out)

    def _to_netcdf(self, path, attrs) -> None:
        import h5netcdf
        import h5py

        path.unlink(missing_ok=True)
        reserve(path, self._size())
        with h5netcdf.File(path, "w") as f:
            for v in self.layout.variables:
                for d, n in zip(v.all_dims, v.whole_shape(self.layout.entries), strict=True):
                    if d not in f.dimensions:
                        f.dimensions[d] = n
            for v in self.layout.variables:
                dtype, shape = v.dtype, v.whole_shape(self.layout.entries)
                final = clean({**v.attrs, **attrs.get(v.name, {})})
                kwargs: dict = {}
                if dtype.kind == "b":
                    final["dtype"], dtype = "bool", np.dtype(np.int8)  # xarray's way: NetCDF has no booleans
                elif dtype.kind in "UO":
                    dtype = h5py.string_dtype()
                elif dtype.kind == "f":
                    kwargs["fillvalue"] = np.nan
                if shape and all(shape) and dtype.kind in "fiu":
                    # As in the .zarr, a chunk never spans two frames.
                    stored = self._arrays[v.name].chunks
                    kwargs |= {"chunks": tuple(stored), "fletcher32": True}
                array = f.create_variable(v.name, v.all_dims, dtype, **kwargs)
                if v.static is not None:
                    array[...] = v.static.astype(object) if v.static.dtype.kind in "UO" else v.static
                else:
                    for k in range(self.layout.entries):
                        array[k] = np.asarray(self._arrays[v.name][k]).astype(dtype, copy=False)
                for key, value in final.items():
                    array.attrs[key] = value
            for key, value in dict(self._group.attrs).items():
                f.attrs[key] = value
        seal(path)

    def _size(self) -> int:
        """Bytes of the data."""
        return sum(
            int(np.prod(v.whole_shape(self.layout.entries), dtype=np.int64)) * max(8, v.dtype.itemsize)
            for v in self.layout.variables
        )

    # --- small things
    def _lock(self) -> None:
        try:
            import fcntl
        except ImportError:  # no such thing on Windows: two runs on one output are the user's care there
            self._handle = None
            return
        self._handle = open(self.partial / "lock", "w")
        try:
            fcntl.flock(self._handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._handle.close()
            raise AtcError(
                f"{self.partial}: another run is writing this output: wait for it, or choose another name"
            ) from None

    def close(self) -> None:
        """Let another run have the place, and leave nothing behind that nobody could continue."""
        kept = self.journal or any((self.partial / name).exists() for name in ("state.npz", "old"))
        if self._handle is not None and not kept:
            shutil.rmtree(self.partial, ignore_errors=True)
        self._unlock()

    def _unlock(self) -> None:
        if self._handle is not None:
            self._handle.close()
            self._handle = None

    def _clear(self) -> None:
        self.journal, self.published = [], False
        # First of all what would make the rest look like a run to go on with.
        for name in ("made.json", "journal.jsonl"):
            (self.partial / name).unlink(missing_ok=True)
        self._remove_all_but(("lock", "old"))

    def _remove_all_but(self, names) -> None:
        for entry in self.partial.iterdir():
            if entry.name not in names:
                shutil.rmtree(entry) if entry.is_dir() else entry.unlink()

    def _read_json(self, name):
        try:
            return json.loads((self.partial / name).read_text())
        except (FileNotFoundError, ValueError):
            return None

    def _write_json(self, name, value) -> None:
        with renamed(self.partial / name) as part:
            part.write_text(json.dumps(value, indent=1, sort_keys=True))


def _checksum(value) -> str:
    return f"{zlib.crc32(json.dumps(value, sort_keys=True).encode()):08x}"


def _line(note: dict) -> str:
    """A line of the journal: the note and its checksum."""
    return f"{json.dumps(note)}\t{_checksum(note)}\n"


def _of_line(line: bytes) -> dict | None:
    """The note in a line of a journal; None if it is not what was written."""
    text, _, checksum = line.partition(b"\t")
    try:
        note = json.loads(text)
    except ValueError:
        return None
    return note if isinstance(note, dict) and checksum.decode("ascii", "replace") == _checksum(note) else None


def require_place(path: Path, where: str, overwrite: bool, resume: bool) -> None:
    """Raise AtcError, at `where`, if a result cannot be written to `path`: found out before anything is computed. With
    `resume` what is there may be that of a run which only has to clear away."""
    folder = path.parent
    if path.suffix not in (".zarr", ".nc"):
        raise AtcError(f"{where}: expected a name that ends in .zarr or .nc, got {path.name}")
    if not folder.is_dir():
        raise AtcError(f"{where}: there is no directory {folder}: make it, or choose another place")
    if not os.access(folder, os.W_OK | os.X_OK):
        raise AtcError(f"{where}: no permission to write in {folder}: choose another place")
    if path.exists() and not (overwrite or (resume and published(path))):
        raise AtcError(f"{where}: {path} exists: give --overwrite to replace it, or another name")


def published(out) -> bool:
    """Whether an output is the finished one of a run that was ended before it could clear away."""
    out = Path(out)
    try:
        return json.loads((out.with_name(out.name + ".partial") / "made.json").read_text()) == _known_by(out)
    except (OSError, ValueError):
        return False


def _known_by(path) -> list[int]:
    """What a file, or the last one of a directory, keeps when it is renamed."""
    about = os.stat(path if path.is_file() else path / ".zmetadata")
    return [about.st_ino, about.st_size, about.st_mtime_ns]


def _other(known: dict, request: dict) -> str:
    """What makes `request` another one than that of an unfinished output; "" for the same. More frames than then are no
    difference."""
    out = differences(known, request)
    then, now = known.get("frames"), request.get("frames")
    if then is not None and now is not None and now < then:
        fewer = f"frames: the trajectory had {then} and has {now} now, take as many as then (-e)"
        out = f"{out}; {fewer}" if out else fewer
    return out


def _fill(dtype):
    # A fill value of 0 would read as "missing" where the numbers are 0.
    return np.nan if np.dtype(dtype).kind == "f" else None
