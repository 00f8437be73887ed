"""The pair style's terms: all pair styles in one sweep of the neighbour list, many-body styles beside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...errors import AtcError
from ..base import Term, Wrapper
from ..pairs.hybrid import Hybrid, parse_hybrid
from ..pairs.pair_modify import apply_modify
from ..pairs.pairs import Pairs, PairStyle
from ..pairs.special_bonds import SpecialBonds
from ..pairs.tip4p import SitePairs
from ..registry import MAPPED_STYLES, Modify, mapped_elements
from .model import Model, Style, build_style, builder, coeff_lines, count_types


class PairBuild:
    """n_types → styles and terms of the pair style. A class, so that a potential can be sent to other processes."""

    def __init__(self, model: Model, style: Style):
        self.model, self.style = model, style
        if not style.name.startswith("hybrid"):
            builder("pair", style.name, style.where)
        self.lines = coeff_lines(model, style)
        self.hybrid: Hybrid | None = None
        self.modify_compute = True
        if style.name in ("hybrid", "hybrid/overlay", "hybrid/scaled"):
            self.hybrid = parse_hybrid(style, self.lines)
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
        self.n_types = max([count_types(self.lines), *mapped])

    def __call__(self, n_types: int) -> list[PairStyle | Term]:
        model, style = self.model, self.style
        if self.hybrid is None:
            return build_style(model, style, self.lines, n_types, modify=self.modify)
        out = []
        for sub, wanted in zip(self.hybrid.subs, self.hybrid.masks(n_types), strict=True):
            own = Style("pair", sub.name, sub.args, style.where)
            lines = sub.lines[-1:] if sub.name in MAPPED_STYLES else sub.lines
            built = build_style(model, own, lines, n_types, modify=sub.modify, wanted=wanted)
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
    build: PairBuild
    own: tuple = ()
    on_sites: bool = False

    def __call__(self, n_types: int) -> list[PairStyle]:
        built = [b for b in self.build(n_types) if isinstance(b, PairStyle) and b.own_special == self.own]
        return [b for b in built if (b.water is not None) == self.on_sites]


def pair_terms(build: PairBuild, special: SpecialBonds) -> list[Term]:
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
