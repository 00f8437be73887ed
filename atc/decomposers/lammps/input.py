"""A model from LAMMPS lines or a LAMMPS input script: styles and coefficients become the terms of a `Potential`."""

from __future__ import annotations

import os
import re
from collections import deque
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from ...errors import AtcError
from ...readers.lammps.sections import number_of
from ...units import LAMMPS_STYLES, Units, units
from ..base import Potential, Term, Wrapper
from ..constraints.virtual_sites import VirtualSites
from ..outside import OutsideForces
from ..pairs.exclusions import Exclusions, exclusions_of
from ..pairs.hybrid import Hybrid, parse_hybrid, strip_suffix
from ..pairs.pairs import MAX_TYPES, Pairs, PairStyle
from ..pairs.special_bonds import SpecialBonds
from ..pairs.tip4p import TIP4P, SitePairs, rest
from ..pairs.zero import Nothing
from ..registry import (
    MAPPED_STYLES,
    STYLES,
    CoeffLine,
    Modify,
    StyleInput,
    TypeRange,
    mapped_elements,
    refusal,
    supported,
)
from .constraint_fixes import constraints_of, groups_of, needs_molecules
from .data_coeffs import take_data_file
from .interpreter import Interpreter, State
from .outside_fixes import acting, outside_of
from .runs import check_spins_push, choose_run, sort_fixes
from .script import Command, is_text, one_line, read_text, short
from .setup import Setup

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


def potential_from_lammps(
    source: str | Path, units_=None, folder=None, name=None, run=None, trajectory=()
) -> Potential:
    """The `Potential` of LAMMPS lines, or of the LAMMPS input script at a path. See `atc.potential`.

    trajectory : paths of the frames that are to be computed: where the model changes from run to run, the script's
        ``dump`` lines may say which run it is
    """
    with one_line():
        return _potential(source, units_, folder, name, run, trajectory)


def _potential(source, units_, folder, name, run, trajectory) -> Potential:
    script = isinstance(source, Path) or not is_text(source)
    if script:
        if not str(source).strip():
            raise AtcError(
                "the potential is empty: expected LAMMPS lines such as pair_style and pair_coeff, or the name of an "
                "input script"
            )
        path = Path(source).expanduser()
        if not os.path.exists(path):
            raise AtcError(
                f"{source}: no such file, nor LAMMPS lines (which start with a command such as pair_style or units)"
            )
        text, name, folder = read_text(path), str(source), path.parent
    else:
        path = None
        text, name, folder = source, name or "potential", Path.cwd() if folder is None else Path(folder)
    script_run = Interpreter(folder, script, path)
    script_run.execute(text, name)
    choice = choose_run(script_run, run, name, trajectory)
    model = _gather(choice.state, name, folder, units_, script)
    if "pair" not in model.styles:
        sort_fixes(choice, folder)  # a fix may be why there is no pair style
    if script and "pair" not in model.styles and model.restart is None and not any(k in model.styles for k in _BONDED):
        _check_free(model, script_run, choice.state, name)
    pot = _assemble(model, name)
    pot.outside, changing = sort_fixes(choice, folder)
    if script and any(s.magnetic for t in pot.terms for s in t.styles):
        check_spins_push(choice, name)
    # LAMMPS's default is 3, so a whole script says it in any case.
    pot.dimension, pot.dimension_said = model.dimension or 3, model.dimension is not None or script
    pot.atom_style = " ".join(model.atom_style)
    named = model.exclusions.groups if model.exclusions else ()
    from_outside = acting(choice.fixes)
    pot.moved = tuple(dict.fromkeys(c.words[1] for c in choice.fixes if c.words[2] == "move" and not c.unknown))
    needed = {*named, *groups_of(choice.fixes)}
    if_known = dict.fromkeys(c.words[1] for c in from_outside if c.words[1] != "all" and c.words[1] not in needed)
    groups = (*named, *(g for g in dict.fromkeys((*groups_of(choice.fixes), *if_known)) if g not in named))
    if script or from_outside:
        lattice = any(c.name == "lattice" for c in choice.state.atoms)
        pot.acting = outside_of(choice.fixes, groups, model.units, lattice)
        if not choice.steady:
            pot.acting = OutsideForces(
                (), tuple(f"fix {c.words[2]} ({short(c.where)}), not in all of the runs" for c in from_outside)
            )
    if choice.minimizes and (c := next((c for c in choice.state.held if c.words[2] in ("shake", "rattle")), None)):
        raise c.error(
            f"fix {c.words[2]} holds bonds by springs of its own while LAMMPS minimizes, which are not "
            "supported: name another run"
        )
    timestep = _timestep(choice.timestep, model.units)
    pot.constraints = constraints_of(choice.fixes, groups, partial(_types, model), model.units.mass, timestep)
    if script and not any(c.words[2:3] == ("dt/reset",) for c in choice.fixes):
        pot.timestep = timestep
    if script and not any(c.name == "units" for c in choice.state.model) and units_ is None:
        pot.remarks = (*pot.remarks, f"{Path(name).name} has no units line: lj, as in LAMMPS")
    pot.remarks = (*pot.remarks, *(f"forces from outside are no part of the stress: {o}" for o in pot.outside))
    concerned = [c for c in choice.state.atoms if c.name not in ("mass", "labelmap", "run")]
    heavy = _masses_of_files(model, pot.terms)
    if script or concerned or changing or groups or heavy:
        pot.setup = Setup(
            name,
            folder,
            model.units.name,
            pot.dimension,
            _atom_style(model),
            (*choice.state.atoms, *heavy),
            choice.later,
            changing,
            tuple(script_run.written_data),
            _needs(pot, model, choice.fixes),
            groups,
            script_run.may_lose,
            script_run.columns,
            frozenset(if_known),
        )
        pot.remarks = (*pot.remarks, *pot.setup.remarks())
    if script:
        pot.file = path.name
    else:
        pot.text = text.strip() + "\n"
    return pot


def _masses_of_files(model: _Model, terms) -> list[Command]:
    """The mass lines of a script with those that its potential files stand for (embedded atoms, MEAM, EIM), in the
    order in which they hold; none where no file says masses."""
    of_line = {t.inner.file_masses[0]: t.inner.file_masses[1] for t in terms if t.inner.file_masses[1]}
    pair = model.styles.get("pair")
    out = []
    for c in model.heavy if of_line else ():
        if c.name == "mass":
            out.append(c)
            continue
        said, own = of_line.get(c.where), True
        if said is None and pair is not None and "eam" in (pair.name, *c.words[2:3]):  # one file a type, one term
            said, own = of_line.get(pair.where, {}), False
        for word, mass in (said or {}).items():
            if own or all(_covers(_types(model, "atom", w, c.where), word) for w in c.words[:2]):
                out.append(Command("mass", (word, repr(mass)), c.where))
    return out


def _covers(span: TypeRange, word: str) -> bool:
    """Whether a range of types has the one, or all that are open above, that a word names."""
    first = int(word.rstrip("*") or 1)
    return span.lo <= first and (span.hi is None or (first <= span.hi and not word.endswith("*")))


# Gathering
# ----------------------------------------------------------------------------------------------------------------------


def _atom_style(model: _Model) -> tuple[str, ...]:
    """The words of ``atom_style``; LAMMPS's default, or what the styles of a restarted run need."""
    if model.atom_style or model.restart is None:
        return model.atom_style or ("atomic",)
    return ("full",) if any(k in model.styles for k in _BONDED) else ("atomic",)


#: LAMMPS's time step where a script has no ``timestep`` line, in its units.
_TIMESTEPS = {
    "lj": 0.005, "real": 1.0, "metal": 0.001, "si": 1e-8, "cgs": 1e-8, "electron": 0.001, "micro": 2.0, "nano": 0.00045,
}  # fmt: skip


def _timestep(word: str | None, u: Units) -> float | None:
    """The time step of a run (internal), None where it is not known."""
    word = str(_TIMESTEPS.get(u.name, "")) if word is None else word
    try:
        return float(u.to_internal("time", float(word)))
    except ValueError:
        return None


def _needs(pot: Potential, model: _Model, fixes=()) -> frozenset:
    """What the terms need to know of atoms besides their places and types."""
    styles = [s for t in pot.terms for s in (t, *t.styles)]
    out = {"charges"} if any(s.needs_charges for s in styles) else set()
    if model.exclusions and (model.exclusions.same or model.exclusions.different):
        out.add("molecules")
    if needs_molecules(fixes):
        out.add("molecules")
    return frozenset(out)


def _gather(state: State, name: str, folder: Path, units_, script: bool) -> _Model:
    model = _Model(_units(state.model, name, units_, script), folder)
    queue = deque(state.model)
    while queue:
        c = queue.popleft()
        kind = c.name.split("_")[0]
        if c.unknown:
            style = strip_suffix(c.words[0]) if c.words and c.name.endswith("_style") and kind in STYLES else "none"
            if "$" not in style and style != "none" and not style.startswith("hybrid"):
                _builder(kind, style, c.where)  # that it is not supported is the better reason
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
                span = _types(model, "atom", c.words[0], c.where)
                for t in span(max(span.hi or span.lo, *model.masses, 1)):
                    model.masses[t] = _float(c, 1)
        elif c.name == "read_data" and c.words:
            model.data_file, more = take_data_file(c, folder, {k: s.name for k, s in model.styles.items()})
            queue.extendleft(reversed(more))
    model.exclusions = exclusions_of(state.atoms, lambda word, where: _types(model, "atom", word, where).lo)
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
        return units("lj")  # as LAMMPS does; `_assemble` says so
    if given is None:
        raise AtcError(
            f"{name}: the units of the coefficients are not known: add a 'units' line, or say units='metal' (one of "
            f"{', '.join(LAMMPS_STYLES)})"
        )
    return units(given)


def _style_before(model: _Model, kind: str, c: Command) -> _Style:
    """The style that a command goes on with."""
    if kind not in model.styles:
        raise c.error(f"{c.name} before any {kind}_style: put the style first")
    return model.styles[kind]


def _take_style(model: _Model, kind: str, c: Command) -> None:
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
    model.styles[kind] = _Style(kind, name, args, c.where, modify=modify)


def _labelmap(model: _Model, c: Command) -> None:
    if not c.words or c.words[0] not in ("atom", *_BONDED) or len(c.words) % 2 == 0:
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
        types = tuple(_types(model, kind, w, c.where) for w in c.words[:width])
        if width == 2 and types[0].lo == types[0].hi and types[1].lo == types[1].hi and types[0].lo > types[1].lo:
            types = types[::-1]
        if width == 2 and types[1].hi is not None and types[1].hi < types[0].lo:
            raise c.error(
                f"pair_coeff {' '.join(c.words[:2])} sets no pair of types, as LAMMPS takes those whose first type is "
                f"not the larger one: write pair_coeff {c.words[1]} {c.words[0]}"
            )
        out.append(CoeffLine(types, c.words[width:], c.where))
    return out


def _n_types(lines: list[CoeffLine]) -> int:
    return max((t.hi if t.hi is not None else t.lo for line in lines for t in line.types), default=1)


# Assembling
# ----------------------------------------------------------------------------------------------------------------------


def _builder(kind: str, name: str, where: str):
    try:
        return STYLES[kind][name]
    except KeyError:
        raise AtcError(f"{where}: {refusal(kind, name)}") from None


def apply_modify(modify: Modify, lines) -> Modify:
    """`modify` after the words of pair_modify lines."""
    from dataclasses import replace

    from ..pairs.input import MIX_RULES

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
            elif key == "compute":
                modify = replace(modify, compute=_yes(value, f"{where}: pair_modify compute"))
            elif key == "special":
                which, weights = value, words[k + 2 : k + 5]
                if which not in ("lj", "coul", "lj/coul") or len(weights) != 3:
                    raise AtcError(
                        f"{where}: pair_modify special: expected lj, coul or lj/coul and three weights, got "
                        f"{' '.join(words[k + 1 : k + 5])}"
                    )
                modify = replace(modify, special=(*modify.special, (which, *weights)))
                k += 3
            elif key == "table":
                if not value.isdecimal() or len(value) > 2:
                    raise AtcError(f"{where}: pair_modify table: expected a number of bits such as 12, got {value}")
                modify = replace(modify, table=int(value))
            elif key in ("table/disp", "tabinner", "tabinner/disp", "tail", "neigh/trim", "compute/tally"):
                # table*: only for long-range Coulomb. tail: constants added to energy and pressure, no forces.
                if key == "tail" and _yes(value, f"{where}: pair_modify tail"):
                    modify = replace(modify, tail=True)
            elif key == "nofdotr":
                k -= 1
            else:
                raise AtcError(
                    f"{where}: pair_modify {key} is not supported: expected shift, mix, table, tail, compute, special"
                )
            k += 2
    return modify


def _yes(word, what) -> bool:
    if word in ("yes", "on", "true"):
        return True
    if word in ("no", "off", "false"):
        return False
    raise AtcError(f"{what}: expected yes or no, got {word!r}")


def _input(model: _Model, style: _Style, lines, n_types: int, **more) -> StyleInput:
    own = {key: getattr(style, key) for key in ("kind", "name", "args", "where")}
    of_all = {key: getattr(model, key) for key in "units folder dielectric charmm labels masses notes pairs".split()}
    return StyleInput(coeffs=tuple(lines), n_types=n_types, **own, **of_all, **more)


def _check_free(model: _Model, script_run: Interpreter, state: State, name: str) -> None:
    """Particles without forces between them, as LAMMPS runs them; AtcError for a script that makes no atoms, or runs
    nothing."""
    atoms = any(c.name in ("create_atoms", "read_data", "read_dump") for c in state.atoms)
    if atoms and script_run.runs:
        model.styles["pair"] = _Style("pair", "zero", ("0.0",), name)
        model.notes.append("there is no pair_style and no bonded style: no forces between atoms, as in LAMMPS")
    elif script_run.runs or state.atoms:
        what = "no run" if atoms else "no atoms (no create_atoms, read_data)"
        raise AtcError(
            f"{name}: no interactions found: expected pair_style or bond_style lines with their coefficients; the "
            f"script has {what} either"
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
    terms += _long_range(model, terms, name)
    for kind in _BONDED:
        style = model.styles.get(kind)
        if style is not None and style.name == "zero":
            lines = _coeff_lines(model, style) if style.lines else []
            _built(model, style, lines, _n_types(lines))  # nothing, but what is wrong with its lines is said
        elif style is not None:
            terms += _bonded_terms(model, style)
    if not terms and "pair" in model.styles:
        terms.append(Nothing())
    if model.restart is not None:
        _check_restart(model)
    if not terms:
        raise AtcError(
            f"{name}: no interactions found: expected pair_style or bond_style lines with their coefficients"
        )
    if any("charmm" in t.describe() for t in terms):
        from ..pairs.one_four import one_four_terms

        terms += one_four_terms(terms)
    pot = Potential(terms, model.units)
    pot.sites = _sites(model, terms)
    pot.remarks = (*notes, *model.notes)
    pot.masses = {t: float(model.units.to_internal("mass", m)) for t, m in model.masses.items()}
    pot.data_file = model.data_file
    # A script that makes the box without a word is LAMMPS's default; lines that say nothing leave it to the trajectory.
    pot.dimension = model.dimension or 3
    pot.dimension_said = model.dimension is not None or model.data_file is not None
    pot.unmentioned = tuple(k for k in _BONDED if k not in model.styles and k not in model.declined)
    return pot


def _long_range(model: _Model, terms, name: str) -> list[Term]:
    """The smooth part of long-range Coulomb."""
    from ..long_range.kspace import Kspace, check_style, kspace_term

    if model.kspace is not None:
        check_style(model.kspace)
    kspace = None if model.kspace is None else Kspace(model.kspace, tuple(model.kspace_modify))
    pair = model.styles.get("pair")
    found = kspace_term(kspace, terms, model.units, pair.where if pair else name)
    if found and model.exclusions:
        raise AtcError(
            f"{model.exclusions.where}: neigh_modify {model.exclusions.keyword} is not supported with long-range "
            "Coulomb: LAMMPS leaves out the near part of such pairs only, which depends on its own alpha"
        )
    model.notes.extend(t.run.describe(model.units) for t in found)
    return found


#: Pair styles that neither shift nor mix, so that a restart file can keep nothing of them that their lines do not say.
_WHOLE = re.compile(r"(eam|meam|sw|tersoff|adp|edip|vashishta|airebo|comb|bop|reaxff|snap|spin)\b")


def _whole(style: _Style) -> bool:
    subs = [w for w in map(strip_suffix, style.args) if w in STYLES["pair"]]
    return all(map(_WHOLE.match, subs if style.name.startswith("hybrid") else [style.name]))


def _check_restart(model: _Model) -> None:
    c, pair = model.restart, model.styles.get("pair")
    what = None
    if pair is None:
        what = "pair_style and pair_coeff lines"
    elif not pair.modify and not _whole(pair):
        what = "a pair_modify line (shift, mix)"
    elif any(k in model.styles for k in _BONDED) and not model.special:
        what = "a special_bonds line"
    if what:
        raise c.error(
            f"read_restart {' '.join(c.words[:1])}: the model is in a binary file, which is not read: add "
            f"{what} behind it (LAMMPS's write_coeff and write_data write what holds)"
        )


class _PairBuild:
    """n_types → styles and terms of the pair style. A class, so that a potential can be sent to other processes."""

    def __init__(self, model: _Model, style: _Style):
        self.model, self.style = model, style
        if not style.name.startswith("hybrid"):
            _builder("pair", style.name, style.where)
        self.lines = _coeff_lines(model, style)
        self.hybrid: Hybrid | None = None
        self.modify_compute = True
        if style.name in ("hybrid", "hybrid/overlay", "hybrid/scaled"):
            self.hybrid = parse_hybrid(style, self.lines, apply_modify)
            self.lines = [line for _, line in self.hybrid.order]
            self.tail = any(s.modify.tail for s in self.hybrid.subs)
            named = [(s.name, line) for s, line in self.hybrid.order if s is not None]
        else:
            self.modify = apply_modify(Modify(), [(c.words, c.where) for c in style.modify])
            self.tail, self.modify_compute = self.modify.tail, self.modify.compute
            if self.modify.special:
                raise AtcError(
                    f"{style.modify[-1].where}: pair_modify special goes with sub-styles of hybrid: 'pair_modify pair "
                    "<style> special ...'"
                )
            named = [(style.name, line) for line in self.lines]
        mapped = (len(mapped_elements(name, line.words)) for name, line in named if name in MAPPED_STYLES)
        self.n_types = max([_n_types(self.lines), *mapped])

    def __call__(self, n_types: int) -> list[PairStyle | Term]:
        model, style = self.model, self.style
        if self.hybrid is None:
            return _built(model, style, self.lines, n_types, modify=self.modify)
        out = []
        for sub, wanted in zip(self.hybrid.subs, self.hybrid.masks(n_types), strict=True):
            own = _Style("pair", sub.name, sub.args, style.where)
            lines = sub.lines[-1:] if sub.name in MAPPED_STYLES else sub.lines
            built = _built(model, own, lines, n_types, modify=sub.modify, wanted=wanted)
            if sub.name in MAPPED_STYLES:
                names = ("NULL", *mapped_elements(sub.name, lines[0].words))
                mapped = np.array([t < len(names) and names[t] != "NULL" for t in range(n_types + 1)])
                if not (wanted == (mapped[:, None] & mapped[None, :])).all():
                    raise AtcError(
                        f"{style.where}: {sub.called} must act on all pairs of the types that it maps: give the other "
                        "sub-style's pairs to types mapped to NULL"
                    )
            if sub.factor != 1.0:
                from ..pairs.scaled import Scaled

                if any(isinstance(b, Term) or b.water is not None for b in built):
                    raise AtcError(
                        f"{style.where}: {style.name} with a factor other than 1 for {sub.called} is not supported: "
                        "only for pair potentials"
                    )
                built = [Scaled(b, sub.factor) for b in built]
            built = [b for b in built if isinstance(b, Term) or b.cutoff > 0]
            for b in built if sub.modify.special else ():
                if isinstance(b, Term):
                    raise AtcError(
                        f"{style.where}: pair_modify special with {sub.called} is not supported: its neighbours would "
                        "not be those of the run"
                    )
                b.own_special = sub.modify.special
            out += built if sub.modify.compute else []
        return out


@dataclass
class _PairGrow:
    build: _PairBuild
    own: tuple = ()
    on_sites: bool = False

    def __call__(self, n_types: int) -> list[PairStyle]:
        built = [b for b in self.build(n_types) if isinstance(b, PairStyle) and b.own_special == self.own]
        return [b for b in built if (b.water is not None) == self.on_sites]


def _built(model: _Model, style: _Style, lines, n_types: int, **more) -> list:
    """What a style's lines make: pair styles or terms."""
    built = _builder(style.kind, style.name, style.where)(_input(model, style, lines, n_types, **more))
    return list(built) if isinstance(built, list | tuple) else [built]


def _pair_terms(build: _PairBuild, special: SpecialBonds) -> list[Term]:
    """All PairStyles in one sweep; terms of their own (sw) beside it."""
    built = build(build.n_types)
    styles = [b for b in built if isinstance(b, PairStyle)]
    if not build.modify_compute:
        return []
    terms: list[Term] = [b if b.unweighted else _Unweighted(b, special) for b in built if isinstance(b, Term)]
    excluded = build.model.exclusions
    if terms and excluded:
        raise AtcError(
            f"{excluded.where}: neigh_modify {excluded.keyword} is not supported with pair_style "
            f"{build.style.name}: its neighbours would not be those of the run"
        )
    # Styles with weights of their own (pair_modify special) sweep the list apart from the others.
    # So do those between charges that sit on virtual sites.
    for own, sites in sorted({(s.own_special, s.water is not None) for s in styles}, reverse=True):
        mine = [s for s in styles if s.own_special == own and (s.water is not None) == sites]
        weights = special.with_own(own, build.style.where) if own else special
        grow = _PairGrow(build, own, sites)
        terms.insert(0, (SitePairs if sites else Pairs)(mine, build.n_types, weights, grow=grow, exclusions=excluded))
    return terms


def _sites(model: _Model, terms) -> VirtualSites | None:
    """The virtual sites that the pair styles of a model ask for."""
    lines = {s.water for t in terms for s in t.styles if s.water is not None}
    if not lines:
        return None
    if len({(w.oxygen, w.hydrogen, w.bond, w.angle, w.distance) for w in lines}) > 1:
        raise AtcError(f"{model.styles['pair'].where}: the sub-styles have different TIP4P waters: one for all of them")
    water = lines.pop()
    if model.exclusions:
        raise AtcError(
            f"{model.exclusions.where}: neigh_modify {model.exclusions.keyword} is not supported with {water.where}'s "
            "virtual sites"
        )
    at_rest = {}
    for kind, word in (("bond", water.bond), ("angle", water.angle)):
        (number,) = _one_type(model, kind, word, water.where)
        style = model.styles.get(kind)
        found = None
        for line in _coeff_lines(model, style) if style is not None else ():
            words, name = line.words, style.name
            if name.startswith("hybrid") and words:
                name, words = strip_suffix(words[0]), words[1:]
            if line.types[0].lo <= number <= (line.types[0].hi or MAX_TYPES):
                found = name, words, line.where
        if found is None:
            raise AtcError(
                f"{water.where}: no {kind}_coeff of {kind} type {word}, whose size at rest places the charge of the "
                f"oxygen: add {kind}_style and {kind}_coeff lines (style zero, if it has no energy)"
            )
        at_rest[kind] = rest(kind, *found)
    b, theta = float(model.units.to_internal("length", at_rest["bond"])), np.radians(at_rest["angle"])
    if not (b > 0 and 0 < theta < np.pi):
        raise AtcError(
            f"{water.where}: TIP4P needs a bond length and an angle at rest between 0 and 180 degrees, got "
            f"{at_rest['bond']:g} and {at_rest['angle']:g}"
        )
    (o,), (h,) = (_one_type(model, "atom", word, water.where) for word in (water.oxygen, water.hydrogen))
    return VirtualSites(TIP4P(o, h, float(water.distance / (b * np.cos(0.5 * theta))), water.where))


def _one_type(model: _Model, kind: str, word: str, where: str) -> range:
    span = _types(model, kind, word, where)
    if span.lo != span.hi:
        raise AtcError(f"{where}: expected one {kind} type, got {word}")
    return span(span.lo)


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
        if top is not None and top.weighted is not None:
            top = top.weighted
        if top is not None and len(top.bonds) and not self.special.trivial:
            raise AtcError(
                f"{frame.source} has bonds, but special_bonds weights are not supported with a many-body pair style: "
                "add 'special_bonds lj/coul 1 1 1' if that is what holds"
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
        (term,) = _built(self.model, self.style, self.lines, n_types)
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
    _builder(style.kind, style.name, style.where)  # that it is not supported is the better reason
    lines = _coeff_lines(model, style)
    if not lines:
        raise AtcError(f"{style.where}: {style.kind}_style {style.name} has no {style.kind}_coeff lines: add them")
    n = _n_types(lines)
    if any(t.hi is None for line in lines for t in line.types):
        return [_Growing(model, style, lines, n)]
    return _built(model, style, lines, n)
