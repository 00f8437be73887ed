"""Scenes: the TOML file in which a person says what to compute.

A scene has the sections ``[trajectory]``, ``[potential]``, ``[kernel]``, ``[grid]``, ``[fields]`` and ``[output]``. Everything in it is
checked before anything is computed; every complaint names the file and the line (or the ``--set`` flag) and says what was expected.
Paths are relative to the scene file, lengths in the trajectory's unit style.
"""

from __future__ import annotations

import difflib
import os
import re
import shutil
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from .errors import AtcError

# --------------------------------------------------------------------------------------------------------------------
# Checks of single values: each returns the value in its normal form, or raises ValueError (with a text: why not).


def _string(v):
    if not isinstance(v, str) or not v.strip():
        raise ValueError
    return v


def _number(v):
    if isinstance(v, bool) or not isinstance(v, (int, float)) or v != v or v in (float("inf"), float("-inf")):
        raise ValueError
    return v


def _positive(v):
    if _number(v) <= 0:
        raise ValueError("it must be greater than 0")
    return v


def _count(v):
    if isinstance(v, bool) or not isinstance(v, int):
        raise ValueError
    if v < 1:
        raise ValueError("it must be at least 1, or there is nothing to compute")
    return v


def _integer(v):
    if isinstance(v, bool) or not isinstance(v, int):
        raise ValueError
    return v


def _boolean(v):
    if not isinstance(v, bool):
        raise ValueError
    return v


def _list_of(check, length=None):
    def checked(v):
        if not isinstance(v, list) or (length is not None and len(v) != length) or not v:
            raise ValueError
        return [check(x) for x in v]

    return checked


def _either(*checks):
    def checked(v):
        reason = ""
        for check in checks:
            try:
                return check(v)
            except ValueError as e:
                reason = reason or str(e)
        raise ValueError(reason)

    return checked


def _choice(choices: Callable[[], list[str]] | list[str]):
    def checked(v):
        known = choices() if callable(choices) else choices
        if not isinstance(v, str):
            raise ValueError
        if v not in known:
            raise ValueError(f"{_guess(v, known)}known: {', '.join(known)}")
        return v

    return checked


def _axis(v):
    if isinstance(v, str) and v.lower() in ("x", "y", "z", "a", "b", "c"):
        return v.lower()
    if isinstance(v, int) and not isinstance(v, bool) and v in (0, 1, 2):
        return v
    raise ValueError


def _frames(v):
    """A slice string, a table {begin, end, step} or one index, kept as written once it is known to be well formed."""
    frame_slice(v)
    return v


def _masses(v):
    if isinstance(v, list):
        return _list_of(_positive)(v)
    if isinstance(v, dict) and v:
        return {str(k): _positive(m) for k, m in v.items()}
    raise ValueError


def _tolerance(v):
    if not 0 < _number(v) < 1:
        raise ValueError("it must lie between 0 and 1 (1e-12 means the exact sum)")
    return v


def _guess(word: str, known) -> str:
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"did you mean {near[0]!r}? " if near else ""


def frame_slice(value) -> slice:
    """The `slice` that a scene's ``frames`` means: ``"100:500:5"``, ``{begin, end, step}``, or one frame's index. ValueError if it means none."""
    if isinstance(value, bool):
        raise ValueError
    if isinstance(value, int):
        return slice(value, value + 1 if value != -1 else None, 1)
    if isinstance(value, str):
        parts = value.split(":")
        if len(parts) == 1:
            return frame_slice(int(parts[0]))
        if len(parts) > 3:
            raise ValueError("a slice has at most three numbers")
        begin, end, step = ([int(p) if p.strip() else None for p in parts] + [None])[:3]
    elif isinstance(value, dict):
        wrong = [k for k in value if k not in ("begin", "end", "step")]
        if wrong:
            raise ValueError(f"unknown key {wrong[0]!r}; known: begin, end, step")
        if any(isinstance(x, bool) or not isinstance(x, int) for x in value.values()):
            raise ValueError
        begin, end, step = (value.get(k) for k in ("begin", "end", "step"))
    else:
        raise ValueError
    if step is not None and step < 1:
        raise ValueError("the step must be at least 1")
    return slice(begin, end, step)


def _unit_names():
    from .units import _SYSTEMS

    return list(_SYSTEMS)


# --------------------------------------------------------------------------------------------------------------------
# What a scene may hold.


@dataclass(frozen=True)
class _Key:
    check: Callable[[Any], Any]
    expected: str
    path: bool = False  # a file name (when it is a string), relative to the scene


_LENGTH3 = _either(_positive, _list_of(_positive, 3))
_VECTOR = _list_of(_number, 3)

SCHEMA: dict[str, dict[str, _Key]] = {
    "trajectory": {
        "file": _Key(_string, 'a file name, e.g. "run.dump"', path=True),
        "topology": _Key(_string, 'the name of a LAMMPS data file, e.g. "run.data"', path=True),
        "units": _Key(_choice(_unit_names), 'a unit style, e.g. "metal"'),
        "masses": _Key(_masses, "a mass for each type, e.g. { 1 = 28.0855 } or [28.0855]"),
        "frames": _Key(_frames, 'frames counted from 0, e.g. "100:500:5", { begin = 100, end = 500, step = 5 } or -1'),
        "reference": _Key(
            _either(_integer, _string), 'the index of the reference frame, or the file that holds it, e.g. 0 or "start.data"', path=True
        ),
    },
    "potential": {
        "lammps": _Key(_string, "LAMMPS lines, e.g. '''pair_style sw\\npair_coeff * * Si.sw Si'''"),
        "input": _Key(_string, 'the name of a LAMMPS input script, e.g. "in.run"', path=True),
        "units": _Key(_choice(_unit_names), 'a unit style, e.g. "metal"'),
    },
    "kernel": {
        "name": _Key(_string, 'the name of a kernel, e.g. "quartic"'),
        "radius": _Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 8.0"),
        "width": _Key(_positive, "a length greater than 0 in the trajectory's units, e.g. 3.0"),
        "size": _Key(_LENGTH3, "one or three lengths greater than 0, e.g. [5.0, 5.0, 5.0]"),
        "table": _Key(
            _either(_string, _list_of(_list_of(_number))), "a file of r and phi(r) in two columns, or the pairs [[r, phi], ...]", path=True
        ),
    },
    "grid": {
        "kind": _Key(_choice(lambda: list(GRIDS)), 'the kind of grid, e.g. "regular"'),
        "shape": _Key(_either(_count, _list_of(_count)), "how many points along each axis, e.g. [40, 40, 20]"),
        "spacing": _Key(_either(_positive, _list_of(_positive)), "the distance between points, greater than 0, e.g. 2.0"),
        "at": _Key(_choice(["centers", "corners"]), '"centers" or "corners"'),
        "origin": _Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "vectors": _Key(_list_of(_either(_positive, _VECTOR)), "edge vectors, e.g. [[40.0, 0.0, 0.0], [0.0, 40.0, 0.0], [0.0, 0.0, 20.0]]"),
        "axis": _Key(_axis, 'an axis of the cell, e.g. "z"'),
        "position": _Key(_number, "a distance from the cell's face along axis, e.g. 12.5"),
        "u": _Key(_VECTOR, "an edge vector, e.g. [40.0, 0.0, 0.0]"),
        "v": _Key(_VECTOR, "an edge vector, e.g. [0.0, 40.0, 0.0]"),
        "start": _Key(_VECTOR, "a point, e.g. [0.0, 0.0, 0.0]"),
        "end": _Key(_VECTOR, "a point, e.g. [0.0, 0.0, 50.0]"),
        "n": _Key(_count, "a number of points, e.g. 100"),
        "bins": _Key(_count, "a number of bins, e.g. 100"),
        "points": _Key(_either(_string, _list_of(_VECTOR)), "points [[x, y, z], ...], or a file of three columns", path=True),
    },
    "fields": {
        "quantities": _Key(_either(_list_of(_string), lambda v: [_string(v)]), 'a list of quantities, e.g. ["stress", "density"]'),
        "tolerance": _Key(_tolerance, "the error allowed relative to the field's maximum, e.g. 1e-5"),
        "method": _Key(_string, 'how to sum, e.g. "auto"'),
        "average": _Key(
            _either(_boolean, _count), "true (one time average with standard error), false, or the number of frames in a window"
        ),
    },
    "output": {"file": _Key(_string, 'the file to write, e.g. "out.zarr" or "out.nc"', path=True)},
}

# kind of grid → (keys it needs, alternatives within a tuple; keys it may have)
GRIDS: dict[str, tuple[list, list]] = {
    "regular": ([("shape", "spacing")], ["at", "origin", "vectors"]),
    "plane": ([("axis", "u"), ("shape", "spacing")], ["position", "origin", "v", "at"]),
    "line": (["start", "end", "n"], []),
    "slab": (["axis", "bins"], []),
    "points": (["points"], []),
    "atoms": ([], []),
}

# --------------------------------------------------------------------------------------------------------------------
# Where in the text a key stands.


def key_lines(text: str) -> dict[tuple[str, ...], int]:
    """Line numbers (from 1) of every table header and key of a TOML text, by dotted path: ``("kernel", "radius") → 7``.

    A scan, not a parser: it is only asked about texts that `tomllib` has already accepted.
    """
    found: dict[tuple[str, ...], int] = {}
    table: tuple[str, ...] = ()
    depth, quote, number, i, n = 0, "", 1, 0, len(text)
    line_start = True
    while i < n:
        c = text[i]
        if quote:  # inside a string, maybe one that runs over lines
            if c == "\\" and quote[0] == '"':
                number += text[i + 1 : i + 2] == "\n"
                i += 2
                continue
            if text.startswith(quote, i):
                i += len(quote)
                while len(quote) == 3 and text[i : i + 1] == quote[0]:  # a multi-line string may end in up to two quotes of its own
                    i += 1
                quote = ""
                continue
        elif c == "#":
            i = text.find("\n", i)
            if i < 0:
                break
            continue
        elif line_start and depth == 0 and not c.isspace():
            end = text.find("\n", i)
            head = text[i : end if end >= 0 else n]
            if c == "[":
                table = _dotted(head.strip("[ \t"))
                found.setdefault(table, number)
                i = end if end >= 0 else n
                continue
            path = _dotted(head)
            for k in range(1, len(path) + 1):
                found.setdefault(table + path[:k], number)
            line_start = False
            i += max(_key_length(head), 1)
            continue
        elif c in "\"'":
            quote = c * 3 if text.startswith(c * 3, i) else c
            i += len(quote)
            continue
        elif c in "[{":
            depth += 1
        elif c in "]}":
            depth -= 1
        if c == "\n":
            number += 1
            line_start = True
        i += 1
    return found


def _dotted(head: str) -> tuple[str, ...]:
    """The dotted key at the start of `head`, up to ``=`` or ``]``."""
    parts, part, quote = [], "", ""
    for c in head:
        if quote:
            if c == quote:
                quote = ""
            else:
                part += c
        elif c in "\"'":
            quote = c
        elif c in "=]#":
            break
        elif c == ".":
            parts.append(part)
            part = ""
        elif not c.isspace():
            part += c
    return (*parts, part)


def _key_length(head: str) -> int:
    """How many characters the key takes, its ``=`` included."""
    quote = ""
    for k, c in enumerate(head):
        if quote:
            quote = "" if c == quote else quote
        elif c in "\"'":
            quote = c
        elif c == "=":
            return k + 1
    return len(head)


# --------------------------------------------------------------------------------------------------------------------
# Writing TOML.


def _toml_string(s: str) -> str:
    escapes = {"\\": "\\\\", '"': '\\"', "\b": "\\b", "\t": "\\t", "\f": "\\f", "\r": "\\r"}
    multi = "\n" in s
    out = "".join(escapes.get(c) or (c if c == "\n" and multi else f"\\u{ord(c):04X}" if ord(c) < 32 or ord(c) == 127 else c) for c in s)
    return f'"""\n{out}"""' if multi else f'"{out}"'


def _toml_key(k: str) -> str:
    bare = k and all(c.isascii() and (c.isalnum() or c in "-_") for c in k)
    return k if bare else _toml_string(k).replace("\n", "\\n") if "\n" not in k else '"' + _toml_string(k)[4:-3].replace("\n", "\\n") + '"'


def toml_value(v) -> str:
    """One value as TOML."""
    if isinstance(v, bool):
        return "true" if v else "false"
    if isinstance(v, int):
        return str(v)
    if isinstance(v, float):
        return repr(v)
    if isinstance(v, str):
        return _toml_string(v)
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(toml_value(x) for x in v) + "]"
    if isinstance(v, Mapping):
        return "{ " + ", ".join(f"{_toml_key(str(k))} = {toml_value(x)}" for k, x in v.items()) + " }"
    raise TypeError(f"{type(v).__name__} has no TOML form")


# --------------------------------------------------------------------------------------------------------------------


@dataclass
class Scene:
    """What to compute: a checked scene.

    Attributes
    ----------
    data : {section: {key: value}} after overrides, checked; values in the user's units, paths as written
    folder : where relative paths start
    name : what to call the scene in messages
    """

    data: dict[str, dict[str, Any]]
    folder: Path = field(default_factory=Path, compare=False)
    name: str = field(default="scene", compare=False)
    _lines: dict = field(default_factory=dict, repr=False, compare=False)
    _flags: dict = field(default_factory=dict, repr=False, compare=False)
    _text: str = field(default="", repr=False, compare=False)

    # ---- making one

    @classmethod
    def load(cls, source: str | os.PathLike | Mapping, overrides: Mapping[str, Any] | list[str] | None = None) -> Scene:
        """Read and check a scene.

        Parameters
        ----------
        source : path of a TOML file, or a mapping of sections
        overrides : ``{"kernel.radius": 10}`` or ``["kernel.radius=10"]`` (the value as TOML, or a bare word)

        Raises
        ------
        AtcError : naming file, line and key, for anything unknown, missing or malformed
        """
        if isinstance(source, Scene):
            return cls.load({s: dict(t) for s, t in source.data.items()}, overrides)._placed(source)
        if isinstance(source, Mapping):
            return cls._build({k: dict(v) if isinstance(v, Mapping) else v for k, v in source.items()}, Path(), "scene", {}, overrides)
        path = Path(source)
        try:
            text = path.read_text(encoding="utf-8")
        except FileNotFoundError:
            raise AtcError(f"{path}: no such scene file") from None
        except IsADirectoryError:
            raise AtcError(f"{path}: is a directory, expected a scene (a TOML file)") from None
        except UnicodeDecodeError:
            raise AtcError(f"{path}: is not a text file, expected a scene (a TOML file)") from None
        except OSError as e:
            raise AtcError(f"{path}: cannot be read: {e.strerror}") from None
        return cls.loads(text, name=str(path), folder=path.parent, overrides=overrides)

    @classmethod
    def loads(cls, text: str, name: str = "scene", folder: str | os.PathLike = ".", overrides=None) -> Scene:
        """Check a scene given as TOML text."""
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as e:
            raise AtcError(_toml_complaint(name, text, e)) from None
        scene = cls._build(data, Path(folder), name, key_lines(text), overrides)
        scene._text = text
        return scene

    def _placed(self, other: Scene) -> Scene:
        self.folder, self.name, self._lines, self._text = other.folder, other.name, other._lines, other._text
        return self

    @classmethod
    def _build(cls, data, folder, name, lines, overrides):
        scene = cls(data, folder, name, lines)
        for section, table in data.items():
            if section not in SCHEMA:
                raise AtcError(f"{scene.where(section)}: unknown section [{section}]: {_guess(section, SCHEMA)}known: {', '.join(SCHEMA)}")
            if not isinstance(table, dict):
                raise AtcError(f"{scene.where(section)}: {section} must be a section: write [{section}] and its keys below")
        for path, value, flag in _overrides(overrides):
            section, key = path
            scene.data.setdefault(section, {})[key] = value
            scene._flags[section, key] = flag
        scene._check()
        return scene

    # ---- complaints

    def where(self, *path: str) -> str:
        """``file:line`` of a key or section, or the flag that set it."""
        if path in self._flags:
            return self._flags[path]
        while path:
            if path in self._lines:
                return f"{self.name}:{self._lines[path]}"
            path = path[:-1]
        return self.name

    def _bad(self, section, key, why) -> AtcError:
        return AtcError(f"{self.where(section, key)}: [{section}] {key}: {why}")

    def _need(self, section, what) -> AtcError:
        return AtcError(f"{self.where(section)}: {what}" if section in self.data else f"{self.name}: no [{section}] section: {what}")

    def _check(self):
        for section, table in self.data.items():
            known = SCHEMA[section]
            for key, value in table.items():
                if key not in known:
                    raise AtcError(
                        f"{self.where(section, key)}: unknown key {key!r} in [{section}]: {_guess(key, known)}known: {', '.join(known)}"
                    )
                spec = known[key]
                try:
                    table[key] = spec.check(value)
                except (ValueError, TypeError) as e:
                    # int("abc") and its like bring Python's own words, which help nobody.
                    reason = f" ({e})" if str(e) and "literal" not in str(e) else ""
                    raise self._bad(section, key, f"expected {spec.expected}, got {_shown(value)}{reason}") from None
        if "file" not in self.data.get("trajectory", {}):
            raise self._need("trajectory", 'it needs file, the trajectory to read, e.g. file = "run.dump"')
        self._check_grid()
        self._check_potential()
        for q in self.get("fields", "quantities", []):
            self._check_name("fields", "quantities", q, _quantity_names())
        name = self.data.get("kernel", {}).get("name")
        if name is not None:
            self._check_name("kernel", "name", name, _kernel_names())
            if not isinstance(self.get("kernel", "table"), str):  # a table in a file is looked at when it is used
                self.kernel()
        elif "kernel" in self.data:
            raise self._need("kernel", f"[kernel] needs name, one of {', '.join(_kernel_names())}")

    def _check_name(self, section, key, word, known):
        if known and word not in known:
            raise self._bad(section, key, f"unknown {word!r}: {_guess(word, known)}known: {', '.join(known)}")

    def _check_potential(self):
        if "potential" not in self.data:
            return
        given = [k for k in ("lammps", "input") if k in self.data["potential"]]
        if not given:
            raise self._need(
                "potential", '[potential] needs lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file" (a LAMMPS input script)'
            )
        if len(given) == 2:
            raise self._bad("potential", "input", "give lammps or input, not both")

    def _check_grid(self):
        if "grid" not in self.data:
            return
        table = self.data["grid"]
        kind = table.get("kind")
        if kind is None:
            raise self._need("grid", f"[grid] needs kind, one of {', '.join(GRIDS)}")
        needs, may = GRIDS[kind]
        allowed = ["kind", *may]
        for need in needs:
            options = need if isinstance(need, tuple) else (need,)
            allowed += options
            given = [k for k in options if k in table]
            if not given:
                examples = " or ".join(f"{k} ({SCHEMA['grid'][k].expected})" for k in options)
                raise self._need("grid", f"a {kind} grid needs {examples}")
            if len(given) > 1:
                raise self._bad("grid", given[1], f"give {' or '.join(options)}, not both")
        for key in table:
            if key not in allowed:
                raise self._bad("grid", key, f"does not belong to a {kind} grid; its keys: {', '.join(allowed)}")
        if not isinstance(table.get("points"), str):  # points in a file are looked at when they are used
            self.grid()

    def require_complete(self):
        """What the quantities asked for need must be there."""
        from .estimators.registry import Work

        quantities = self.get("fields", "quantities")
        if quantities is None:
            raise self._need("fields", 'it needs quantities, what to compute, e.g. quantities = ["stress", "density"]')
        work = Work.of(quantities)
        if work.bond_users and "potential" not in self.data:
            raise self._need(
                "potential", f'{work.bond_users[0]} needs one: lammps = """pair_style ...""" (LAMMPS lines) or input = "in.file"'
            )
        if work.grid_users and "kernel" not in self.data:
            raise self._need("kernel", f'{work.grid_users[0]} needs one, e.g. name = "quartic" and radius = 8.0')
        if work.grid_users and "grid" not in self.data:
            raise self._need("grid", f'{work.grid_users[0]} needs one, e.g. kind = "regular" and spacing = 2.0')
        if work.reference_users and self.get("trajectory", "reference") is None:
            raise self._need(
                "trajectory",
                f"{work.reference_users[0]} needs reference, the index of the reference frame or the file that holds it, e.g. reference = 0",
            )

    # ---- what it means

    def get(self, section: str, key: str, default=None):
        """The value of a key, or `default`."""
        return self.data.get(section, {}).get(key, default)

    def path(self, section: str, key: str) -> Path | None:
        """A file name of the scene, relative to the scene's folder unless absolute."""
        value = self.get(section, key)
        return None if value is None else self.folder / Path(value).expanduser()

    def trajectory(self):
        """The frames asked for, as `atc.read` gives them. `AtcError` if there are none."""
        whole = self._whole()
        frames = self.get("trajectory", "frames")
        if frames is None:
            part = whole
        else:
            part = whole[frame_slice(frames)]
        if len(part) == 0:
            why = f"{whole.source} has {len(whole)} complete frame{'s' * (len(whole) != 1)}, numbered from 0"
            raise AtcError(
                f"{self.where('trajectory', 'frames')}: [trajectory] frames: {_shown(frames) if frames is not None else 'all'} selects none: {why}"
            )
        return part

    def _whole(self):
        return self._read(self.path("trajectory", "file"), "file")

    def _read(self, path, key):
        from . import read

        if not path.exists():
            raise self._bad("trajectory", key, f"there is no file {path}")
        topology = self.path("trajectory", "topology")
        if topology is not None and not topology.exists():
            raise self._bad("trajectory", "topology", f"there is no file {topology}")
        try:
            return read(path, topology=topology, units=self.get("trajectory", "units"), masses=self.get("trajectory", "masses"))
        except AtcError as e:
            raise AtcError(str(e) if str(path) in str(e) else f"{self.where('trajectory', key)}: {e}") from None

    def reference(self):
        """The reference frame, or None: the index counts from the trajectory's first frame, whatever `frames` selects; of a file, its first frame."""
        value = self.get("trajectory", "reference")
        if value is None:
            return None
        if isinstance(value, str):
            return self._read(self.path("trajectory", "reference"), "reference")[0]
        whole = self._whole()
        if not -len(whole) <= value < len(whole):
            raise self._bad("trajectory", "reference", f"there is no frame {value}: {whole.source} has {len(whole)}, numbered from 0")
        return whole[value]

    def kernel(self):
        """The localisation function, in the user's unit of length; None if the scene has none."""
        if "kernel" not in self.data:
            return None
        from .kernels import kernel

        table = dict(self.data["kernel"])
        name = table.pop("name")
        if isinstance(table.get("table"), str):
            table["table"] = self._columns("kernel", "table", 2)
        try:
            return kernel(name, table.pop("radius", None), **table)
        except AtcError as e:
            raise self._placed_error("kernel", list(self.data["kernel"]), e) from None

    def potential(self):
        """The model of the interactions; None if the scene has none. Files it names are relative to the scene."""
        if "potential" not in self.data:
            return None
        from . import potential

        units = self.get("potential", "units")
        path = self.path("potential", "input")
        if path is not None:
            if not path.is_file():
                raise self._bad("potential", "input", f"there is no file {path}")
            return potential(path, units=units)
        text = self.data["potential"]["lammps"]
        if units is None and not re.search(r"^\s*units\s", text, re.MULTILINE):
            units = self.get("trajectory", "units") or self._whole().units.name
        # Empty lines in front, so that what is wrong with line 3 of the text is reported at its line of the scene.
        line = 0
        if ("potential", "lammps") not in self._flags:
            line = self._lines.get(("potential", "lammps"), 0)
            opening = self._text.split("\n")[line - 1].partition("=")[2].strip() if line else ""
            line -= bool(line) and opening not in ('"""', "'''")
        name = self._flags.get(("potential", "lammps"), self.name)
        return potential("\n" * line + text + "\n", units=units, folder=self.folder, name=name)

    def grid(self):
        """Where the fields are wanted; None if the scene has no grid."""
        if "grid" not in self.data:
            return None
        from .grids import Grid

        table = dict(self.data["grid"])
        kind = table.pop("kind")
        if kind == "points":
            xyz = table["points"]
            table = {"xyz": self._columns("grid", "points", 3) if isinstance(xyz, str) else xyz}
        try:
            return getattr(Grid, kind)(**table)
        except AtcError as e:
            raise self._placed_error("grid", list(self.data["grid"]), e) from None

    def output(self, given=None, overwrite: bool = False) -> Path:
        """The file to write: `given`, else the scene's ``[output] file``. Whether it can be written is found out here, before anything is computed."""
        if given is not None:
            path, where = Path(given), f"-o {given}"
        elif self.get("output", "file") is not None:
            path, where = self.path("output", "file"), self.where("output", "file") + ": [output] file"
        else:
            raise self._need("output", 'say where the result goes: -o OUT, or file = "out.zarr" in [output]')
        if path.suffix not in (".zarr", ".nc"):
            raise AtcError(f"{where}: expected a name that ends in .zarr or .nc, got {path.name}")
        folder = path.parent
        if not folder.is_dir():
            raise AtcError(f"{where}: there is no directory {folder}: make it, or choose another place")
        if not os.access(folder, os.W_OK | os.X_OK):
            raise AtcError(f"{where}: no permission to write in {folder}: choose another place")
        if path.exists() and not overwrite:
            raise AtcError(f"{where}: {path} exists: give --overwrite to replace it, or another name")
        return path

    def arguments(self, jobs: int = 1) -> dict:
        """The arguments of `atc.fields` (and `atc.plan`) this scene stands for.

        `jobs` processors: whole frames to processes where there are as many frames, else threads within a frame; 0 means all processors.
        """
        self.require_complete()
        if jobs < 0:
            raise AtcError(f"-j {jobs}: expected a number of processor cores, or 0 for all of them")
        from .plan import choose_method, cpus

        jobs = jobs or cpus()
        method = self.get("fields", "method", "auto")
        try:
            choose_method(method)
        except AtcError as e:
            raise self._placed_error("fields", ["method"], e) from None
        traj = self.trajectory()
        parallel = jobs > 1 and len(traj) >= jobs
        given = {k: self.get("fields", k) for k in ("quantities", "tolerance", "average") if self.get("fields", k) is not None}
        return {
            "traj": traj, "pot": self.potential(), "kern": self.kernel(), "grid": self.grid(), "reference": self.reference(), "method": method,
            "threads": 1 if parallel else jobs, "workers": jobs if parallel else 1, **given,
        }  # fmt: skip

    def plan(self, jobs: int = 1):
        """What `run` would do; nothing is computed."""
        from .plan import plan

        return plan(**self.arguments(jobs))

    def run(self, out=None, *, jobs: int = 1, progress=None, resume: bool = True):
        """Compute the fields: `atc.fields` with this scene's arguments, into `out` (or in memory). Returns the xarray.Dataset."""
        from . import fields

        arguments = self.arguments(jobs)
        partial = None if out is None else Path(f"{out}.partial")
        there = partial is not None and partial.exists()
        try:
            return fields(**arguments, out=out, progress=progress, resume=resume, scene=self.to_toml())
        except AtcError:
            # Input that cannot be used leaves nothing behind; a run that has finished frames, or one that is not ours, does.
            if partial is not None and not there and not (partial / "journal.jsonl").exists():
                shutil.rmtree(partial, ignore_errors=True)
            raise

    def _columns(self, section, key, count):
        """A text file of numbers, `count` to a line."""
        import numpy as np

        path = self.path(section, key)
        try:
            values = np.loadtxt(path, ndmin=2)
        except OSError as e:
            raise self._bad(section, key, f"{path} cannot be read: {e.strerror or e}") from None
        except ValueError as e:
            raise self._bad(section, key, f"{path}: expected {count} numbers a line: {' '.join(str(e).split())}") from None
        if values.shape[1] != count or not len(values):
            raise self._bad(section, key, f"{path}: expected {count} numbers a line, found {values.shape[1] if len(values) else 'none'}")
        return values

    def _placed_error(self, section, keys, error) -> AtcError:
        """An error of a lower floor, with the line of the key it speaks of (or of the section)."""
        message = str(error)
        spoken = [k for k in keys if k != "name" and k in message]
        where = self.where(section, spoken[0]) if len(spoken) == 1 else self.where(section)
        return AtcError(f"{where}: [{section}] {message}")

    def to_toml(self) -> str:
        """The resolved scene as TOML. Absolute paths lose what lies outside the scene's folder, so that no user or host name is kept."""
        out = []
        for section in SCHEMA:
            table = self.data.get(section)
            if not table:
                continue
            out.append(f"[{section}]")
            for key, value in table.items():
                if SCHEMA[section][key].path and isinstance(value, str):
                    value = self._anonymous(value)
                out.append(f"{_toml_key(key)} = {toml_value(value)}")
            out.append("")
        return "\n".join(out)

    def _anonymous(self, name: str) -> str:
        path = Path(name).expanduser()
        if path.is_absolute():
            try:
                return path.relative_to(self.folder.resolve()).as_posix()
            except ValueError:
                return path.name
        if ".." in path.parts and Path.home().name in path.parts:
            return path.name
        return path.as_posix()

    def set(self, section: str, key: str, value, flag: str = "") -> None:
        """Change one key and check the scene again; `flag` is what a complaint then names."""
        before = {s: dict(t) for s, t in self.data.items()}
        self.data.setdefault(section, {})[key] = value
        self._flags[section, key] = flag or f"{section}.{key}"
        try:
            self._check()
        except AtcError:
            self.data = before
            raise


# --------------------------------------------------------------------------------------------------------------------


def _shown(value) -> str:
    text = toml_value(value) if not isinstance(value, (dict, list)) or _plain(value) else str(value)
    text = " ".join(text.split())
    return text if len(text) <= 60 else text[:57] + "..."


def _plain(value) -> bool:
    if isinstance(value, dict):
        return all(_plain(v) for v in value.values())
    if isinstance(value, list):
        return all(_plain(v) for v in value)
    return isinstance(value, (bool, int, float, str))


def _overrides(overrides):
    """((section, key), value, flag) of each override."""
    if not overrides:
        return
    if isinstance(overrides, Mapping):
        for dotted, value in overrides.items():
            yield _setting_path(dotted, dotted), value, dotted
        return
    for text in overrides:
        dotted, eq, value = text.partition("=")
        flag = f"--set {text}"
        if not eq:
            raise AtcError(f"{flag}: expected SECTION.KEY=VALUE, e.g. --set kernel.radius=10")
        section, key = path = _setting_path(dotted.strip(), flag)
        yield path, _typed(section, key, value.strip()), flag


def _setting_path(dotted: str, flag: str) -> tuple[str, str]:
    section, dot, key = dotted.partition(".")
    if not dot:
        homes = [s for s in SCHEMA if dotted in SCHEMA[s]]
        hint = f"did you mean {homes[0]}.{dotted}? " if homes else ""
        raise AtcError(f"{flag}: expected SECTION.KEY=VALUE, e.g. kernel.radius=10; {hint}got only {dotted!r} before the =")
    if section not in SCHEMA:
        raise AtcError(f"{flag}: unknown section {section!r}: {_guess(section, SCHEMA)}known: {', '.join(SCHEMA)}")
    if key not in SCHEMA[section]:
        raise AtcError(f"{flag}: unknown key {key!r} in [{section}]: {_guess(key, SCHEMA[section])}known: {', '.join(SCHEMA[section])}")
    return section, key


def _typed(section: str, key: str, text: str):
    """The value a flag means: TOML where it is TOML, else the bare word; ``a,b`` where a list is wanted."""
    try:
        return tomllib.loads(f"v = {text}")["v"]
    except tomllib.TOMLDecodeError:
        pass
    if (section, key) == ("fields", "quantities"):
        return [w.strip() for w in text.split(",") if w.strip()]
    if "," in text and not text.startswith("["):
        try:
            return tomllib.loads(f"v = [{text}]")["v"]
        except tomllib.TOMLDecodeError:
            pass
    return text


def _toml_complaint(name: str, text: str, e: Exception) -> str:
    """tomllib's complaint with the line first, and what most often is the reason."""
    message = str(e)
    line = getattr(e, "lineno", None)
    if line is None and "(at line " in message:
        line = int(message.rpartition("(at line ")[2].split(",")[0])
    elif line is None and "(at end of document)" in message:
        line = text.count("\n") + 1
    reason = message.rpartition(" (at ")[0] or message
    source = text.split("\n")[line - 1].strip() if line and line <= text.count("\n") + 1 else ""
    value = source.partition("=")[2].strip()
    if reason == "Invalid value" and value[:1].isalpha():
        reason = f"invalid value {value[:40]}: text needs quotes"
    return f"{name}{f':{line}' if line else ''}: not valid TOML: {reason[:1].lower() + reason[1:]}"


def _kernel_names() -> list[str]:
    from . import kernels

    return [*kernels.NAMES, *kernels._ALIASES]


def _quantity_names() -> list[str]:
    from .estimators.registry import QUANTITIES

    return list(QUANTITIES)
