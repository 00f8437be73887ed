"""What the executed lines say of the model: units, styles with their coefficient lines, labels, masses."""

from __future__ import annotations

import os
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path

from ...errors import AtcError
from ...readers.lammps.sections import number_of
from ...units import LAMMPS_STYLES, Units, units
from ..pairs.exclusions import Exclusions, exclusions_of
from ..pairs.hybrid import strip_suffix
from ..pairs.pairs import MAX_TYPES, Pairs
from ..registry import STYLES, CoeffLine, StyleInput, TypeRange, refusal, supported
from .data_coeffs import take_data_file
from .script import Command, span_of
from .state import State

BONDED = ("bond", "angle", "dihedral", "improper")


@dataclass
class Style:
    """A ``*_style`` line with the coefficient lines and pair_modify lines that followed it."""

    kind: str
    name: str
    args: tuple[str, ...]
    where: str
    lines: list[Command] = field(default_factory=list)
    modify: list[Command] = field(default_factory=list)


@dataclass
class Model:
    """The lines of one model, each where it belongs."""

    units: Units
    folder: Path
    styles: dict[str, Style] = field(default_factory=dict)
    declined: set[str] = field(default_factory=set)
    special: list[Command] = field(default_factory=list)
    dielectric: float = 1.0
    kspace: Command | None = None
    kspace_modify: list[Command] = field(default_factory=list)
    labels: dict[str, dict[str, int]] = field(default_factory=dict)
    masses: dict[int, float] = field(default_factory=dict)
    data_file: Path | None = None
    dimension: int | None = None  # None: the lines say nothing of it
    atom_style: tuple[str, ...] = ()
    #: why the model is not all there: the read_restart line
    restart: Command | None = None
    exclusions: Exclusions | None = None
    notes: list[str] = field(default_factory=list)
    pairs: Pairs | None = None
    #: the lines that give types masses, in order: mass, and pair_coeff where its file has some
    heavy: list[Command] = field(default_factory=list)

    @property
    def charmm(self) -> bool:
        """Whether the Coulomb constant is CHARMM's: LAMMPS takes it for all styles as soon as one wants it."""
        pair = self.styles.get("pair")
        words = () if pair is None else (pair.name, *map(strip_suffix, pair.args))
        return self.units.name == "real" and any(w.startswith("lj/charmmfsw/") for w in words)


def gather(state: State, name: str, folder: Path, units_, script: bool) -> Model:
    """The model that holds at a run."""
    model = Model(_units(state.model, name, units_, script), folder)
    queue = deque(state.model)
    while queue:
        c = queue.popleft()
        kind = c.name.split("_")[0]
        if c.unknown:
            style = strip_suffix(c.words[0]) if c.words and c.name.endswith("_style") and kind in STYLES else "none"
            if "$" not in style and style != "none" and not style.startswith("hybrid"):
                builder(kind, style, c.where)  # that it is not supported is the better reason
            raise c.error(f"{c.unknown}")
        if c.name.endswith("_style") and kind in STYLES:
            _take_style(model, kind, c)
        elif c.name.endswith("_coeff") and kind in STYLES:
            _style_before(model, kind, c).lines.append(c)
            model.heavy += [c] if kind == "pair" else []
        elif c.name == "pair_modify":
            _style_before(model, "pair", c).modify.append(c)
        elif c.name == "special_bonds":
            model.special.append(c)
        elif c.name == "dielectric":
            model.dielectric = _float(c, 0)
            if model.dielectric <= 0:
                raise c.error(f"the dielectric constant must be positive, got {c.words[0]}")
        elif c.name == "kspace_style":
            model.kspace = None if c.words[:1] == ("none",) else c
        elif c.name == "kspace_modify":
            model.kspace_modify.append(c)
        elif c.name == "dimension":
            if c.words not in (("2",), ("3",)):
                raise c.error(f"expected dimension 2 or 3, got {' '.join(c.words) or 'nothing'}")
            model.dimension = int(c.words[0])
        elif c.name == "atom_style":
            model.atom_style = tuple(strip_suffix(w) for w in c.words)
        elif c.name == "read_restart":
            model.restart = c
        elif c.name == "labelmap":
            _labelmap(model, c)
        elif c.name == "mass":
            model.heavy.append(c)
            if len(c.words) == 2:
                span = type_range(model, "atom", c.words[0], c.where)
                for t in span(max(span.hi or span.lo, *model.masses, 1)):
                    model.masses[t] = _float(c, 1)
        elif c.name == "read_data" and c.words:
            model.data_file, more = take_data_file(c, folder, {k: s.name for k, s in model.styles.items()})
            queue.extendleft(reversed(more))
    model.exclusions = exclusions_of(state.atoms, lambda word, where: type_range(model, "atom", word, where).lo)
    return model


def _units(commands, name, given, script: bool = False) -> Units:
    said = [c for c in commands if c.name == "units"]
    names = {c.words[0] if c.words else "" for c in said}
    if len(names) > 1:
        raise AtcError(f"{said[-1].where}: units are set more than once, to {' and '.join(sorted(names))}: keep one")
    if said:
        if not said[0].words:
            raise said[0].error(f"units needs a style: one of {', '.join(LAMMPS_STYLES)}")
        if said[0].words[0] not in LAMMPS_STYLES:
            raise said[0].error(f"unknown units {said[0].words[0]!r}: expected one of {', '.join(LAMMPS_STYLES)}")
        found = units(said[0].words[0])
        if given is not None and units(given).name != found.name:
            raise said[0].error(
                f"the lines say units {found.name} but units={units(given).name!r} was given: drop one of them"
            )
        return found
    if given is None and script:
        return units("lj")  # as LAMMPS does; `assemble` says so
    if given is None:
        raise AtcError(
            f"{name}: the units of the coefficients are not known: add a 'units' line, or say units='metal' (one of "
            f"{', '.join(LAMMPS_STYLES)})"
        )
    return units(given)


def _style_before(model: Model, kind: str, c: Command) -> Style:
    """The style that a command goes on with."""
    if kind not in model.styles:
        raise c.error(f"{c.name} before any {kind}_style: put the style first")
    return model.styles[kind]


def _take_style(model: Model, kind: str, c: Command) -> None:
    if not c.words:
        raise c.error(f"{c.name} needs a style: one of {supported(kind)}")
    name, args = strip_suffix(c.words[0]), c.words[1:]
    old = model.styles.get(kind)
    if name == "none":
        model.styles.pop(kind, None)
        model.declined.add(kind)
        return
    if old is not None and old.name == name and old.lines and not name.startswith("hybrid"):
        # LAMMPS keeps the coefficients and resets their cutoffs here; which lines still hold is not for us to guess.
        raise c.error(
            f"{c.name} {name} is given a second time ({old.where} was the first): keep the one that holds, "
            "with its coefficients"
        )
    # The same style again: LAMMPS goes on with it, and with what pair_modify said of it.
    modify = list(old.modify) if old is not None and old.name == name and not name.startswith("hybrid") else []
    model.styles[kind] = Style(kind, name, args, c.where, modify=modify)


def _labelmap(model: Model, c: Command) -> None:
    if not c.words or c.words[0] not in ("atom", *BONDED) or len(c.words) % 2 == 0:
        raise c.error(
            f"expected 'labelmap atom|bond|angle|dihedral|improper number label ...', got {' '.join(c.words)!r}"
        )
    for number, label in zip(c.words[1::2], c.words[2::2], strict=True):
        model.labels.setdefault(c.words[0], {})[label] = int(_number(number, c.where))


def _number(word: str, where: str) -> float:
    value = number_of(word)
    if value is None:
        raise AtcError(f"{where}: expected a number, got {word!r}")
    return value


def _float(c: Command, k: int) -> float:
    if len(c.words) <= k:
        raise c.error(f"{c.name} needs {k + 1} argument{'s' if k else ''}")
    return _number(c.words[k], c.where)


def type_range(model: Model, kind: str, word: str, where: str) -> TypeRange:
    """``3``, ``*``, ``2*``, ``*3``, ``1*3``, or a type label."""
    label = model.labels.get(kind, {}).get(word)
    if label is not None:
        return TypeRange(label, label)
    span = span_of(word)
    if span is None:
        known = f" or one of the labels {', '.join(model.labels[kind])}" if model.labels.get(kind) else ""
        raise AtcError(f"{where}: expected a type such as 1, * or 2*4{known}, got {word!r}")
    lo, hi = span
    if lo < 1 or (hi is not None and hi < lo):
        raise AtcError(f"{where}: the types {word!r} are no range of numbers from 1")
    if max(lo, hi or 0) > MAX_TYPES:
        raise AtcError(f"{where}: type {max(lo, hi or 0)} is beyond the {MAX_TYPES} types that are supported")
    return TypeRange(lo, hi)


def coeff_lines(model: Model, style: Style) -> list[CoeffLine]:
    """The coefficient lines of a style, their types read."""
    if not style.lines and model.data_file is not None and not os.path.isfile(model.data_file):
        raise AtcError(
            f"{style.where}: no {style.kind}_coeff lines for {style.kind}_style {style.name}, and the data file "
            f"{model.data_file} that may hold them is not there"
        )
    out = []
    width = 2 if style.kind == "pair" else 1
    kind = "atom" if style.kind == "pair" else style.kind
    for c in style.lines:
        if len(c.words) < width:
            raise c.error(f"{c.name} needs {width} type{'s' if width > 1 else ''} and the coefficients")
        types = tuple(type_range(model, kind, w, c.where) for w in c.words[:width])
        if width == 2 and types[0].lo == types[0].hi and types[1].lo == types[1].hi and types[0].lo > types[1].lo:
            types = types[::-1]
        if width == 2 and types[1].hi is not None and types[1].hi < types[0].lo:
            raise c.error(
                f"pair_coeff {' '.join(c.words[:2])} sets no pair of types, as LAMMPS takes those whose first type is "
                f"not the larger one: write pair_coeff {c.words[1]} {c.words[0]}"
            )
        out.append(CoeffLine(types, c.words[width:], c.where))
    return out


def count_types(lines: list[CoeffLine]) -> int:
    """How many types coefficient lines name."""
    return max((t.hi if t.hi is not None else t.lo for line in lines for t in line.types), default=1)


def builder(kind: str, name: str, where: str):
    """What is registered for a style's name; AtcError, with the reason, where nothing is."""
    try:
        return STYLES[kind][name]
    except KeyError:
        raise AtcError(f"{where}: {refusal(kind, name)}") from None


def _input(model: Model, style: Style, lines, n_types: int, **more) -> StyleInput:
    own = {key: getattr(style, key) for key in ("kind", "name", "args", "where")}
    of_all = {key: getattr(model, key) for key in "units folder dielectric charmm labels masses notes pairs".split()}
    return StyleInput(coeffs=tuple(lines), n_types=n_types, **own, **of_all, **more)


def build_style(model: Model, style: Style, lines, n_types: int, **more) -> list:
    """What a style's lines make: pair styles or terms."""
    built = builder(style.kind, style.name, style.where)(_input(model, style, lines, n_types, **more))
    return list(built) if isinstance(built, list | tuple) else [built]
