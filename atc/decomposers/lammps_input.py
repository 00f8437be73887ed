"""A model from LAMMPS lines or a LAMMPS input script: styles and coefficients become the terms of a `Potential`."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..units import LAMMPS_STYLES, Units, units
from .base import Potential, Term, Wrapper
from .hybrid import Hybrid, parse_hybrid, strip_suffix
from .lammps_data_coeffs import take_data_file
from .lammps_script import Command, is_text, read_commands, read_text
from .pair import MAX_TYPES, Pairs, PairStyle
from .registry import MAPPED_STYLES, STYLES, CoeffLine, Modify, StyleInput, TypeRange, supported
from .special_bonds import SpecialBonds

__all__ = ["potential_from_lammps"]

_BONDED = ("bond", "angle", "dihedral", "improper")


@dataclass
class _Style:
    """A ``*_style`` line with the coefficient lines and pair_modify lines that followed it."""

    kind: str
    name: str
    args: tuple[str, ...]
    where: str
    lines: list[Command] = field(default_factory=list)
    modify: list[Command] = field(default_factory=list)


@dataclass
class _Model:
    units: Units
    folder: Path
    styles: dict[str, _Style] = field(default_factory=dict)
    declined: set[str] = field(default_factory=set)
    special: list[Command] = field(default_factory=list)
    dielectric: float = 1.0
    labels: dict[str, dict[str, int]] = field(default_factory=dict)
    masses: dict[int, float] = field(default_factory=dict)
    data_file: Path | None = None
    pairs: Pairs | None = None


def potential_from_lammps(source: str | Path, units_=None, folder=None, name=None) -> Potential:
    """The `Potential` of LAMMPS lines, or of the LAMMPS input script at a path. See `atc.potential`."""
    script = isinstance(source, Path) or not is_text(source)
    if script:
        if not str(source).strip():
            raise AtcError(
                "the potential is empty: expected LAMMPS lines such as pair_style and pair_coeff, or the name of an input script"
            )
        path = Path(source).expanduser()
        if not path.exists():
            raise AtcError(f"{source}: no such file, nor LAMMPS lines (which start with a command such as pair_style or units)")
        text, name, folder = read_text(path), str(source), path.parent
    else:
        text, name, folder = source, name or "potential", Path.cwd() if folder is None else Path(folder)
    commands = read_commands(text, name, folder, script)
    model = _gather(commands, name, folder, units_)
    pot = _assemble(model, name)
    if script:
        pot.file = path.name
    else:
        pot.text = text.strip() + "\n"
    return pot


# Gathering ------------------------------------------------------------------------------------------------------------------------------


def _gather(commands: list[Command], name: str, folder: Path, units_) -> _Model:
    model = _Model(_units(commands, name, units_), folder)
    queue = list(commands)
    while queue:
        c = queue.pop(0)
        kind = c.name.split("_")[0]
        if c.name.endswith("_style") and kind in STYLES:
            _take_style(model, kind, c)
        elif c.name.endswith("_coeff") and kind in STYLES:
            if kind not in model.styles:
                raise AtcError(f"{c.where}: {c.name} before any {kind}_style: put the style first")
            model.styles[kind].lines.append(c)
        elif c.name == "pair_modify":
            if "pair" not in model.styles:
                raise AtcError(f"{c.where}: pair_modify before any pair_style: put the style first")
            model.styles["pair"].modify.append(c)
        elif c.name == "special_bonds":
            model.special.append(c)
        elif c.name == "dielectric":
            model.dielectric = _float(c, 0)
            if model.dielectric <= 0:
                raise AtcError(f"{c.where}: the dielectric constant must be positive, got {c.words[0]}")
        elif c.name == "kspace_style" and c.words[:1] != ("none",):
            raise AtcError(
                f"{c.where}: kspace_style {' '.join(c.words)}: long-range forces cannot be split into bonds from positions alone, so they are not supported; "
                "use coul/dsf or coul/wolf (or kspace_style none)"
            )
        elif c.name == "dimension" and c.words[:1] != ("3",):
            raise AtcError(f"{c.where}: dimension {' '.join(c.words)} is not supported: only three-dimensional models are")
        elif c.name == "labelmap":
            _labelmap(model, c)
        elif c.name == "mass":
            if len(c.words) == 2:
                span = _types(model, "atom", c.words[0], c.where)
                for t in span(max(span.hi or span.lo, *model.masses, 1)):
                    model.masses[t] = _float(c, 1)
        elif c.name == "read_data" and c.words:
            model.data_file, more = take_data_file(c, folder, {k: s.name for k, s in model.styles.items()})
            queue[:0] = more
    return model


def _units(commands, name, given) -> Units:
    said = [c for c in commands if c.name == "units"]
    names = {c.words[0] if c.words else "" for c in said}
    if len(names) > 1:
        raise AtcError(f"{said[-1].where}: units are set more than once, to {' and '.join(sorted(names))}: keep one")
    if said:
        if said[0].words[:1] and said[0].words[0] not in LAMMPS_STYLES:
            raise AtcError(f"{said[0].where}: unknown units {said[0].words[0]!r}: expected one of {', '.join(LAMMPS_STYLES)}")
        if not said[0].words:
            raise AtcError(f"{said[0].where}: units needs a style: one of {', '.join(LAMMPS_STYLES)}")
        found = units(said[0].words[0])
        if given is not None and units(given).name != found.name:
            raise AtcError(f"{said[0].where}: the lines say units {found.name} but units={units(given).name!r} was given: drop one of them")
        return found
    if given is None:
        raise AtcError(
            f"{name}: the units of the coefficients are not known: add a 'units' line, or say units='metal' (one of {', '.join(LAMMPS_STYLES)})"
        )
    return units(given)


def _take_style(model: _Model, kind: str, c: Command) -> None:
    if not c.words:
        raise AtcError(f"{c.where}: {c.name} needs a style: one of {supported(kind)}")
    name, args = strip_suffix(c.words[0]), c.words[1:]
    old = model.styles.get(kind)
    if name == "none":
        model.styles.pop(kind, None)
        model.declined.add(kind)
        return
    if old is not None and old.name == name and old.lines and not name.startswith("hybrid"):
        # LAMMPS keeps the coefficients and resets their cutoffs here; which lines still hold is not for us to guess.
        raise AtcError(
            f"{c.where}: {c.name} {name} is given a second time ({old.where} was the first): keep the one that holds, with its coefficients"
        )
    model.styles[kind] = _Style(kind, name, args, c.where)


def _labelmap(model: _Model, c: Command) -> None:
    if not c.words or c.words[0] not in ("atom", *_BONDED) or len(c.words) % 2 == 0:
        raise AtcError(f"{c.where}: expected 'labelmap atom|bond|angle|dihedral|improper number label ...', got {' '.join(c.words)!r}")
    for number, label in zip(c.words[1::2], c.words[2::2], strict=True):
        model.labels.setdefault(c.words[0], {})[label] = int(_number(number, c.where))


def _number(word: str, where: str) -> float:
    try:
        return float(word)
    except ValueError:
        raise AtcError(f"{where}: expected a number, got {word!r}") from None


def _float(c: Command, k: int) -> float:
    if len(c.words) <= k:
        raise AtcError(f"{c.where}: {c.name} needs {k + 1} argument{'s' if k else ''}")
    return _number(c.words[k], c.where)


def _types(model: _Model, kind: str, word: str, where: str) -> TypeRange:
    """``3``, ``*``, ``2*``, ``*3``, ``1*3``, or a type label."""
    label = model.labels.get(kind, {}).get(word)
    if label is not None:
        return TypeRange(label, label)
    m = re.fullmatch(r"(\d*)(\*?)(\d*)", word)
    if not m or not word or (not m.group(2) and m.group(3)):
        known = f" or one of the labels {', '.join(model.labels[kind])}" if model.labels.get(kind) else ""
        raise AtcError(f"{where}: expected a type such as 1, * or 2*4{known}, got {word!r}")
    lo = int(m.group(1) or 1)
    hi = lo if not m.group(2) else int(m.group(3)) if m.group(3) else None
    if lo < 1 or (hi is not None and hi < lo):
        raise AtcError(f"{where}: the types {word!r} are no range of numbers from 1")
    if max(lo, hi or 0) > MAX_TYPES:
        raise AtcError(f"{where}: type {max(lo, hi or 0)} is beyond the {MAX_TYPES} types that are supported")
    return TypeRange(lo, hi)


def _coeff_lines(model: _Model, style: _Style) -> list[CoeffLine]:
    if not style.lines and model.data_file is not None and not model.data_file.is_file():
        raise AtcError(
            f"{style.where}: no {style.kind}_coeff lines for {style.kind}_style {style.name}, and the data file {model.data_file} that may hold them is not there"
        )
    out = []
    width = 2 if style.kind == "pair" else 1
    kind = "atom" if style.kind == "pair" else style.kind
    for c in style.lines:
        if len(c.words) < width:
            raise AtcError(f"{c.where}: {c.name} needs {width} type{'s' if width > 1 else ''} and the coefficients")
        types = tuple(_types(model, kind, w, c.where) for w in c.words[:width])
        if width == 2 and types[0].lo == types[0].hi and types[1].lo == types[1].hi and types[0].lo > types[1].lo:
            types = types[::-1]
        out.append(CoeffLine(types, c.words[width:], c.where))
    return out


def _n_types(lines: list[CoeffLine]) -> int:
    return max((t.hi if t.hi is not None else t.lo for line in lines for t in line.types), default=1)


# Assembling -----------------------------------------------------------------------------------------------------------------------------


def _builder(kind: str, name: str, where: str):
    try:
        return STYLES[kind][name]
    except KeyError:
        raise AtcError(f"{where}: {kind}_style {name} is not supported: expected one of {supported(kind)}") from None


def apply_modify(modify: Modify, lines) -> Modify:
    """`modify` after the words of pair_modify lines."""
    from dataclasses import replace

    from .pair_input import MIX_RULES

    for words, where in lines:
        k = 0
        while k < len(words):
            key, value = words[k], words[k + 1] if k + 1 < len(words) else None
            if value is None and key != "nofdotr":
                raise AtcError(f"{where}: pair_modify {key} needs a value")
            if key == "shift":
                modify = replace(modify, shift=_yes(value, f"{where}: pair_modify shift"))
            elif key == "mix":
                if value not in MIX_RULES:
                    raise AtcError(f"{where}: pair_modify mix {value}: expected one of {', '.join(MIX_RULES)}")
                modify = replace(modify, mix=value)
            elif key in ("table", "table/disp", "tabinner", "tabinner/disp", "tail", "compute", "neigh/trim"):
                # table*: only for long-range Coulomb. tail: constants added to energy and pressure, no forces.
                if key == "compute" and not _yes(value, f"{where}: pair_modify compute"):
                    raise AtcError(f"{where}: pair_modify compute no is not supported: remove the style instead")
                if key == "tail" and _yes(value, f"{where}: pair_modify tail"):
                    modify = replace(modify, tail=True)
            elif key == "nofdotr":
                k -= 1
            else:
                raise AtcError(f"{where}: pair_modify {key} is not supported: expected shift, mix, table, tail")
            k += 2
    return modify


def _yes(word, what) -> bool:
    if word in ("yes", "on", "true"):
        return True
    if word in ("no", "off", "false"):
        return False
    raise AtcError(f"{what}: expected yes or no, got {word!r}")


def _input(model: _Model, style: _Style, lines, n_types: int, **more) -> StyleInput:
    return StyleInput(
        kind=style.kind,
        name=style.name,
        args=style.args,
        coeffs=tuple(lines),
        n_types=n_types,
        units=model.units,
        folder=model.folder,
        where=style.where,
        dielectric=model.dielectric,
        labels=model.labels,
        masses=model.masses,
        pairs=model.pairs,
        **more,
    )


def _assemble(model: _Model, name: str) -> Potential:
    special = SpecialBonds.from_lines([(c.words, c.where) for c in model.special])
    terms: list[Term] = []
    notes = []
    if "pair" in model.styles:
        build = _PairBuild(model, model.styles["pair"])
        if build.tail:
            notes.append("long-range tail corrections (pair_modify tail) are not included")
        terms += _pair_terms(build, special)
        # Some bonded styles need the pair interaction of their atoms.
        model.pairs = next((t for t in terms if isinstance(t, Pairs)), None)
    for kind in _BONDED:
        if kind in model.styles and model.styles[kind].name != "zero":
            terms += _bonded_terms(model, model.styles[kind])
    if not terms:
        raise AtcError(f"{name}: no interactions found: expected pair_style or bond_style lines with their coefficients")
    pot = Potential(terms, model.units)
    pot.remarks = tuple(notes)
    pot.masses = {t: float(model.units.to_internal("mass", m)) for t, m in model.masses.items()}
    pot.data_file = model.data_file
    pot.unmentioned = tuple(k for k in _BONDED if k not in model.styles and k not in model.declined)
    return pot


class _PairBuild:
    """n_types → styles and terms of the pair style. A class, so that a potential can be sent to other processes."""

    def __init__(self, model: _Model, style: _Style):
        self.model, self.style = model, style
        self.lines = _coeff_lines(model, style)
        self.hybrid: Hybrid | None = None
        if style.name in ("hybrid", "hybrid/overlay"):
            self.hybrid = parse_hybrid(style, self.lines, apply_modify)
            self.lines = [line for _, line in self.hybrid.order]
            self.tail = any(s.modify.tail for s in self.hybrid.subs)
            mapped = [len(line.words) - 1 for s, line in self.hybrid.order if s is not None and s.name in MAPPED_STYLES]
        else:
            _builder("pair", style.name, style.where)
            self.modify = apply_modify(Modify(), [(c.words, c.where) for c in style.modify])
            self.tail = self.modify.tail
            mapped = [len(line.words) - 1 for line in self.lines] if style.name in MAPPED_STYLES else []
        self.n_types = max([_n_types(self.lines), *mapped])

    def __call__(self, n_types: int) -> list[PairStyle | Term]:
        model, style = self.model, self.style
        if self.hybrid is None:
            return _as_list(_builder("pair", style.name, style.where)(_input(model, style, self.lines, n_types, modify=self.modify)))
        out = []
        for sub, wanted in zip(self.hybrid.subs, self.hybrid.masks(n_types), strict=True):
            own = _Style("pair", sub.name, sub.args, style.where)
            lines = sub.lines[-1:] if sub.name in MAPPED_STYLES else sub.lines
            built = _as_list(_builder("pair", sub.name, style.where)(_input(model, own, lines, n_types, modify=sub.modify, wanted=wanted)))
            if sub.name in MAPPED_STYLES:
                mapped = np.array([0 < t <= len(lines[0].words) - 1 and lines[0].words[t] != "NULL" for t in range(n_types + 1)])
                if not (wanted == (mapped[:, None] & mapped[None, :])).all():
                    raise AtcError(
                        f"{style.where}: {sub.called} must act on all pairs of the types that it maps: give the other sub-style's pairs to types mapped to NULL"
                    )
            out += [b for b in built if isinstance(b, Term) or b.cutoff > 0]
        return out


@dataclass
class _PairGrow:
    build: _PairBuild

    def __call__(self, n_types: int) -> list[PairStyle]:
        return [b for b in self.build(n_types) if isinstance(b, PairStyle)]


def _as_list(built) -> list:
    return list(built) if isinstance(built, list | tuple) else [built]


def _pair_terms(build: _PairBuild, special: SpecialBonds) -> list[Term]:
    """All PairStyles in one sweep; terms of their own (sw) beside it."""
    built = build(build.n_types)
    styles = [b for b in built if isinstance(b, PairStyle)]
    terms: list[Term] = [_Unweighted(b, special) for b in built if isinstance(b, Term)]
    if styles:
        terms.insert(0, Pairs(styles, build.n_types, special, grow=_PairGrow(build)))
    return terms


class _Unweighted(Wrapper):
    """A many-body pair style: special_bonds would take pairs out of its neighbour list, which it does not offer."""

    def __init__(self, term: Term, special: SpecialBonds):
        self.term, self.special, self.cutoff = term, special, term.cutoff

    def leaves(self, frame):
        self._refuse(frame)
        return self.term.leaves(frame)

    def prepare(self, frame):
        self._refuse(frame)
        return self.term.prepare(frame)

    def _refuse(self, frame):
        top = frame.topology
        if top is not None and len(top.bonds) and not self.special.trivial:
            raise AtcError(
                f"{frame.source} has bonds, but special_bonds weights are not supported with a many-body pair style: add 'special_bonds lj/coul 1 1 1' if that is what holds"
            )


class _Growing(Wrapper):
    """A bonded term whose coefficient lines end in ``*``: rebuilt when a frame has more types than the lines name."""

    def __init__(self, model: _Model, style: _Style, lines, n_types: int):
        self.model, self.style, self.lines, self.n_types = model, style, lines, n_types
        self.choices = ()
        self.term = self._build(n_types)
        self.cutoff = self.term.cutoff
        self._grown = {}

    def _build(self, n_types):
        style = self.style
        term = _builder(style.kind, style.name, style.where)(_input(self.model, style, self.lines, n_types))
        for choice in self.choices:
            term = term.partitioned(*choice)
        return term

    def partitioned(self, partition, word=False):
        new = super().partitioned(partition, word)
        new.choices = (*self.choices, (partition, word))
        new._grown = {}
        return new

    def prepare(self, frame):
        return self._of(frame).prepare(frame)

    def leaves(self, frame):
        return self._of(frame).leaves(frame)

    def _of(self, frame):
        types = getattr(frame.topology, f"{self.style.kind}_types", ()) if frame.topology is not None else ()
        top = int(np.max(types)) if len(types) else 0
        if top <= self.n_types:
            return self.term
        if top not in self._grown:
            self._grown[top] = self._build(top)
        return self._grown[top]


def _bonded_terms(model: _Model, style: _Style) -> list[Term]:
    builder = _builder(style.kind, style.name, style.where)
    lines = _coeff_lines(model, style)
    if not lines:
        raise AtcError(f"{style.where}: {style.kind}_style {style.name} has no {style.kind}_coeff lines: add them")
    n = _n_types(lines)
    if any(t.hi is None for line in lines for t in line.types):
        return [_Growing(model, style, lines, n)]
    return _as_list(builder(_input(model, style, lines, n)))
