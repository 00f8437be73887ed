"""What LAMMPS averages over the cells of a grid or over bins: files of ``dump grid`` (which is how ``fix ave/grid``
writes) and of ``fix ave/chunk``, as an xarray.Dataset."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...units import units as unit_system
from .._bytes import head_of
from ..whole import whole_bytes
from .columns import cell_from_bounds, periodic_flags

#: Names of ``fix ave/chunk`` and ``ave/grid`` that say what a column is: its dimension.
KNOWN = {
    "density/mass": "density", "density/number": "number_density", "temp": "temperature", "mass": "mass",
    **{f"v{c}": "velocity" for c in "xyz"}, **{f"f{c}": "force" for c in "xyz"}, "Ncount": "dimensionless",
}  # fmt: skip
#: Columns that are per volume or counts: 0 where there are no atoms. All others are means over atoms, of none there.
_OF_NO_ATOMS = ("density/mass", "density/number", "Ncount")


def is_grid(path) -> bool:
    """Whether `read_grid` reads a file, told from its beginning."""
    return Path(path).is_file() and is_grid_file(head_of(path))


def is_grid_file(head: bytes) -> bool:
    """Whether a file's first bytes are those of a ``dump grid`` or ``fix ave/chunk`` file."""
    text = head.replace(b"\r\n", b"\n")
    if text.lstrip().startswith(b"ITEM:"):
        return b"ITEM: GRID SIZE" in text
    lines = text.split(b"\n", 3)[:3]
    return len(lines) == 3 and all(line.startswith(b"#") for line in lines) and lines[2].startswith(b"# Chunk ")


@dataclass
class Entry:
    """One step: {column: values (shape)}; of a grid the cell, of bins their coordinates along each axis."""

    step: int
    time: float | None
    columns: dict
    cell: object = None
    axes: tuple = ()


class _Lines:
    """The lines of a file, one after the other, with their numbers."""

    def __init__(self, path):
        text = whole_bytes(path).tobytes().decode("utf-8", "replace")
        self.path, self.lines, self.at = path, text.splitlines(), 0

    def __bool__(self):
        while self.at < len(self.lines) and not self.lines[self.at].strip():
            self.at += 1
        return self.at < len(self.lines)

    def next(self, expected: str) -> str:
        if self.at >= len(self.lines):
            raise AtcError(f"{self.path}: ends where {expected} should stand: cut off, or still being written")
        self.at += 1
        return self.lines[self.at - 1]

    def numbers(self, count: int, expected: str) -> list[float]:
        """A line of so many numbers."""
        words = self.next(expected).split()
        try:
            if len(words) != count:
                raise ValueError
            return [float(w) for w in words]
        except ValueError:
            raise self.bad(expected) from None

    def table(self, rows: int, columns: int, expected: str) -> np.ndarray:
        """(rows, columns) numbers."""
        block = self.lines[self.at : self.at + rows]
        if len(block) < rows:
            raise AtcError(
                f"{self.path}: ends after {len(block)} of {rows} lines of {expected}: cut off, or still being written"
            )
        try:
            out = np.array([line.split() for line in block], dtype=np.float64)
            if out.shape != (rows, columns):
                raise ValueError
        except ValueError:
            for line in block:  # the line that it was
                self.at += 1
                try:
                    if len([float(w) for w in line.split()]) == columns:
                        continue
                except ValueError:
                    pass
                raise self.bad(f"{columns} numbers of {expected}") from None
            raise self.bad(expected) from None
        self.at += rows
        return out

    def bad(self, expected: str) -> AtcError:
        got = self.lines[self.at - 1].strip()[:60] if self.lines else ""
        return AtcError(f"{self.path}, line {self.at}: expected {expected}, got {got!r}")


# --- dump grid


def _read_grid(lines: _Lines) -> tuple[list[Entry], str | None]:
    entries, units = [], None
    while lines:
        step = time = bounds = shape = None
        dimension = 3
        while True:
            head = lines.next("an item of a dump grid").strip()
            if head == "ITEM: UNITS":
                units = lines.next("the unit style").strip()
            elif head == "ITEM: TIME":
                (time,) = lines.numbers(1, "the time")
            elif head == "ITEM: TIMESTEP":
                (step,) = lines.numbers(1, "the time step")
            elif head.startswith("ITEM: BOX BOUNDS"):
                bounds = _bounds(lines, head.split()[3:])
            elif head == "ITEM: DIMENSION":
                (dimension,) = lines.numbers(1, "the dimension, 2 or 3")
            elif head.startswith("ITEM: GRID SIZE"):
                size = lines.numbers(3, "three numbers of grid cells")
                if min(size) < 1 or any(n != int(n) for n in size):
                    raise lines.bad("three whole numbers of grid cells, 1 or more")
                shape = tuple(int(n) for n in size)
            elif head.startswith("ITEM: GRID CELLS"):
                break
            else:
                raise lines.bad("an item of a dump grid (TIMESTEP, BOX BOUNDS, GRID SIZE, GRID CELLS)")
        names = head.split()[3:]
        needed = {
            "ITEM: TIMESTEP": step,
            "ITEM: BOX BOUNDS": bounds,
            "ITEM: GRID SIZE": shape,
            "names of columns behind ITEM: GRID CELLS": names or None,
        }
        for what, there in needed.items():
            if there is None:
                raise AtcError(f"{lines.path}, line {lines.at}: {what} is missing above the grid cells")
        if entries and (list(entries[0].columns) != names or next(iter(entries[0].columns.values())).shape != shape):
            raise AtcError(f"{lines.path}, line {lines.at}: the grid or its columns are not those of the first step")
        table = lines.table(int(np.prod(shape)), len(names), "grid cells")
        # x runs fastest
        columns = {n: table[:, k].reshape(shape[::-1]).transpose(2, 1, 0) for k, n in enumerate(names)}
        entries.append(Entry(int(step), time, columns, bounds))
    return entries, units


def _bounds(lines: _Lines, words):
    """A `Cell` in the file's own unit of length."""
    tilted = words[:3] == ["xy", "xz", "yz"]
    if words[:2] == ["abc", "origin"]:
        from ...frame import Cell

        rows = np.array([lines.numbers(4, "an edge vector and a number of the origin") for _ in range(3)])
        return Cell(rows[:, :3], rows[:, 3], periodic_flags(words[2:], f"{lines.path}, line {lines.at - 3}"))
    flags = periodic_flags(words[3:] if tilted else words, f"{lines.path}, line {lines.at}")
    rows = np.array([lines.numbers(3 if tilted else 2, "bounds of the box") for _ in range(3)])
    return cell_from_bounds(rows[:, 0], rows[:, 1], rows[:, 2] if tilted else (0, 0, 0), flags, 1.0)


# --- fix ave/chunk


def _read_chunks(lines: _Lines) -> list[Entry]:
    lines.at = 2
    names = lines.next("the names of columns").lstrip("# ").split()
    entries: list[Entry] = []
    while lines:
        if lines.lines[lines.at].startswith("#"):  # another run's header, in a file that was appended to
            lines.at += 1
            continue
        step, count, _ = lines.numbers(3, "a time step, the number of chunks and a count")
        if count < 0 or count != int(count):
            raise lines.bad("a whole number of chunks")
        table = lines.table(int(count), len(names), "chunks")
        columns = {n: table[:, k] for k, n in enumerate(names)}
        entries.append(_on_lattice(int(step), columns, lines))
    shape = next(iter(entries[0].columns.values())).shape if entries else None
    for e in entries:
        here = next(iter(e.columns.values())).shape
        if here != shape:
            raise AtcError(
                f"{lines.path}: step {e.step} has {here} chunks, the first step {shape}: only chunks that stay as many "
                "can be read"
            )
    return entries


def _on_lattice(step: int, columns: dict, lines: _Lines) -> Entry:
    """The rows of one step on the lattice of their coordinates; chunks without (types, molecules) in a row."""
    coordinates = [columns[n] for n in sorted(n for n in columns if re.fullmatch(r"Coord\d", n))]
    values = {n: a for n, a in columns.items() if not re.fullmatch(r"Coord\d|Chunk|OrigID", n)}
    empty = columns.get("Ncount", np.ones(1)) == 0
    for n, a in values.items():
        if n not in _OF_NO_ATOMS and empty.any():
            values[n] = np.where(empty, np.nan, a)
    if not coordinates:
        return Entry(step, None, values, axes=(columns.get("OrigID", columns["Chunk"]),))
    axes, places = zip(*(np.unique(c, return_inverse=True) for c in coordinates), strict=True)
    shape = tuple(len(a) for a in axes)
    flat = np.ravel_multi_index(places, shape)
    if len(np.unique(flat)) != len(flat):
        raise AtcError(f"{lines.path}, step {step}: two bins have the same coordinates")
    out = {}
    for n, a in values.items():  # bins that were left out because they are empty
        whole = np.full(int(np.prod(shape)), 0.0 if n in _OF_NO_ATOMS else np.nan)
        whole[flat] = a
        out[n] = whole.reshape(shape)
    return Entry(step, None, out, axes=axes)


# ---


def read_grid(path, units=None):
    """What LAMMPS averaged over the cells of a grid (``dump grid``, of ``fix ave/grid`` and others) or over chunks
    (``fix ave/chunk``).

    Parameters
    ----------
    path : the file, plain or compressed; of `atc export` too (``.grid``)
    units : a LAMMPS unit style, where the file does not say it: only for the labels, numbers are as in the file

    Returns
    -------
    xarray.Dataset
        A variable for each column, by its name. Of grids: dims frame, x, y, z; values belong to the cells around the
        points. Of chunks in bins: frame, bin1, bin2, bin3, whose coordinates are the bins' centres as the file has them
        (it does not say along which axes they lie); of other chunks: frame, chunk. Means over atoms are NaN in bins
        without atoms. `step` is that of each entry: of averages the last one of their interval.

    Raises
    ------
    AtcError
        for a file that is neither, is damaged or cut off: with its line
    """
    import xarray as xr

    head = head_of(path)
    if not is_grid_file(head):
        raise AtcError(
            f"{path}: neither a dump grid (ITEM: GRID SIZE) nor a file of fix ave/chunk ('# Chunk ...' in its third "
            "line)"
        )
    lines, declared = _Lines(path), None
    kind = "dump grid" if head.lstrip().startswith(b"ITEM:") else "ave/chunk"
    if kind == "dump grid":
        entries, declared = _read_grid(lines)
    else:
        entries = _read_chunks(lines)
    if not entries:
        raise AtcError(f"{path}: holds no step yet, only its header")
    if declared is not None and units is not None and unit_system(units).name != declared:
        raise AtcError(f"{path} says its units are {declared!r}, but {unit_system(units).name!r} were given")
    u = unit_system(units or declared) if units or declared else None
    length = {"units": u.label("length")} if u else {}
    first = entries[0]
    if first.cell is not None:
        dims = ("x", "y", "z")
    else:
        binned = any(c.startswith("Coord") for c in lines.lines[2].split())
        dims = tuple(f"bin{k + 1}" for k in range(len(first.axes))) if binned else ("chunk",)
    coords: dict = {"step": ("frame", np.array([e.step for e in entries]))}
    if any(e.time is not None for e in entries):
        coords["time"] = ("frame", np.array([np.nan if e.time is None else e.time for e in entries]))
    if first.cell is not None:
        coords |= _cell_coordinates(entries, length)
    else:
        for d, a in zip(dims, first.axes, strict=True):
            coords[d] = (d, a, {"long_name": "centre of the bin", **length} if d != "chunk" else {})
    variables = {}
    for name in first.columns:
        attrs = {"long_name": f"column {name} of LAMMPS"}
        if u and name in KNOWN:
            attrs["units"] = u.label(KNOWN[name])
        variables[name] = (("frame", *dims), np.stack([e.columns[name] for e in entries]), attrs)
    attrs = {"kind": kind, "source": str(path), **({"units": u.name} if u else {})}
    return xr.Dataset(variables, coords, attrs)


def _cell_coordinates(entries, length) -> dict:
    cells = [e.cell for e in entries]
    n = next(iter(entries[0].columns.values())).shape
    out = {
        "cell": (("frame", "edge", "i"), np.stack([c.vectors for c in cells]), length),
        "cell_origin": (("frame", "i"), np.stack([c.origin for c in cells]), length),
    }
    first = cells[0]
    if first.orthogonal:
        for k, d in enumerate("xyz"):
            x = first.origin[k] + (np.arange(n[k]) + 0.5) * first.vectors[k, k] / n[k]
            out[d] = (d, x, {"long_name": d, **length})
        return out
    s = np.stack(np.meshgrid(*[(np.arange(k) + 0.5) / k for k in n], indexing="ij"), -1)
    for k, d in enumerate("xyz"):
        attrs = {"long_name": f"{d} of the cells", **length}
        out[f"position_{d}"] = (("x", "y", "z"), first.cartesian(s)[..., k], attrs)
    return out
