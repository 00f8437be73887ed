"""The terms of a model: those of its pair style, long-range Coulomb, bonded styles and virtual sites, as a
`Potential`."""

from __future__ import annotations

import re

import numpy as np

from ...errors import AtcError
from ..base import Term, Wrapper
from ..constraints.virtual_sites import VirtualSites
from ..pairs.hybrid import strip_suffix
from ..pairs.pairs import MAX_TYPES, Pairs
from ..pairs.special_bonds import SpecialBonds
from ..pairs.tip4p import TIP4P, rest
from ..pairs.zero import Nothing
from ..potentials import Potential
from ..registry import STYLES
from .model import BONDED, Model, Style, build_style, builder, coeff_lines, count_types, type_range
from .pair_terms import PairBuild, pair_terms


def assemble(model: Model, name: str) -> Potential:
    """The potential of a model's lines; AtcError where there is none."""
    special = SpecialBonds.from_lines([(c.words, c.where) for c in model.special])
    terms: list[Term] = []
    notes = []
    if "pair" in model.styles:
        build = PairBuild(model, model.styles["pair"])
        if build.tail:
            notes.append("long-range tail corrections (pair_modify tail) are not included")
        terms += pair_terms(build, special)
        # Some bonded styles need the pair interaction of their atoms.
        model.pairs = next((t for t in terms if isinstance(t, Pairs)), None)
    terms += _long_range(model, terms, name)
    for kind in BONDED:
        style = model.styles.get(kind)
        if style is not None and style.name == "zero":
            lines = coeff_lines(model, style) if style.lines else []
            build_style(model, style, lines, count_types(lines))  # nothing, but what is wrong with its lines is said
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
    pot.unmentioned = tuple(k for k in BONDED if k not in model.styles and k not in model.declined)
    return pot


def _long_range(model: Model, terms, name: str) -> list[Term]:
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


def _whole(style: Style) -> bool:
    subs = [w for w in map(strip_suffix, style.args) if w in STYLES["pair"]]
    return all(map(_WHOLE.match, subs if style.name.startswith("hybrid") else [style.name]))


def _check_restart(model: Model) -> None:
    c, pair = model.restart, model.styles.get("pair")
    what = None
    if pair is None:
        what = "pair_style and pair_coeff lines"
    elif not pair.modify and not _whole(pair):
        what = "a pair_modify line (shift, mix)"
    elif any(k in model.styles for k in BONDED) and not model.special:
        what = "a special_bonds line"
    if what:
        raise c.error(
            f"read_restart {' '.join(c.words[:1])}: the model is in a binary file, which is not read: add "
            f"{what} behind it (LAMMPS's write_coeff and write_data write what holds)"
        )


def _sites(model: Model, terms) -> VirtualSites | None:
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
        for line in coeff_lines(model, style) if style is not None else ():
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


def _one_type(model: Model, kind: str, word: str, where: str) -> range:
    span = type_range(model, kind, word, where)
    if span.lo != span.hi:
        raise AtcError(f"{where}: expected one {kind} type, got {word}")
    return span(span.lo)


class _Growing(Wrapper):
    """A bonded term whose coefficient lines end in ``*``: rebuilt when a frame has more types than the lines name."""

    def __init__(self, model: Model, style: Style, lines, n_types: int):
        self.model, self.style, self.lines, self.n_types = model, style, lines, n_types
        self.choices = ()
        self.term = self._build(n_types)
        self.cutoff = self.term.cutoff
        self._grown = {}

    def _build(self, n_types):
        (term,) = build_style(self.model, self.style, self.lines, n_types)
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
        types = getattr(frame.topology, f"{self.style.kind}_types") if frame.topology is not None else ()
        top = int(np.max(types)) if len(types) else 0
        if top <= self.n_types:
            return self.term
        if top not in self._grown:
            self._grown[top] = self._build(top)
        return self._grown[top]


def _bonded_terms(model: Model, style: Style) -> list[Term]:
    builder(style.kind, style.name, style.where)  # that it is not supported is the better reason
    lines = coeff_lines(model, style)
    if not lines:
        raise AtcError(f"{style.where}: {style.kind}_style {style.name} has no {style.kind}_coeff lines: add them")
    n = count_types(lines)
    if any(t.hi is None for line in lines for t in line.types):
        return [_Growing(model, style, lines, n)]
    return build_style(model, style, lines, n)
