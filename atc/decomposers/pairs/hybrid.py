"""pair_style hybrid and hybrid/overlay: which sub-style acts on which pairs of types."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

import numpy as np

from ...errors import AtcError
from ..registry import MAPPED_STYLES, PAIR_STYLES, CoeffLine, Modify, mapped_elements
from .pair_modify import apply_modify
from .unsupported import reason

# Words that are arguments of a sub-style, not the name of the next one.
_ARGUMENTS = set(
    "linear spline lookup bitmap nocoeff full threebody on off long cut shift maxdelta check nocheck".split()
)
# Accelerator suffixes: other code for the same formula.
_SUFFIX = re.compile(r"/(omp|opt|gpu|intel|kk|kk/host|kk/device)$")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?$")


def strip_suffix(name: str) -> str:
    """A style's name without its accelerator suffix."""
    return _SUFFIX.sub("", name)


@dataclass
class SubStyle:
    """One entry of the hybrid line. ``index`` counts equal names from 1, 0 if the name occurs once."""

    name: str
    args: tuple[str, ...]
    index: int = 0
    #: of hybrid/scaled
    factor: float = 1.0
    lines: list[CoeffLine] = field(default_factory=list)
    modify: Modify = field(default_factory=Modify)

    @property
    def called(self) -> str:
        return f"{self.name} {self.index}" if self.index else self.name


@dataclass
class Hybrid:
    """A parsed hybrid style: its sub-styles and, in order, which lines belong to which (None: ``none``)."""

    subs: list[SubStyle]
    order: list[tuple[SubStyle | None, CoeffLine]]
    overlay: bool
    where: str

    def masks(self, n_types: int) -> list[np.ndarray]:
        """For each sub-style, (n_types + 1, n_types + 1) bool: the pairs of types it acts on (LAMMPS PairHybrid::coeff
        and init_one)."""
        of: dict[tuple[int, int], list[int]] = {}
        for sub, line in self.order:
            k = None if sub is None else self.subs.index(sub)
            if sub is not None and sub.name in MAPPED_STYLES:
                of = {p: [m for m in ms if m != k] for p, ms in of.items()}
                of = {p: ms for p, ms in of.items() if ms}
            for pair in line.covers(n_types):
                if sub is None:
                    of[pair] = []
                elif sub.name in MAPPED_STYLES and not _mapped(sub.name, line, pair):
                    continue
                elif not self.overlay:
                    of[pair] = [k]
                elif k not in of.setdefault(pair, []):
                    of[pair].append(k)
        masks = [np.zeros((n_types + 1, n_types + 1), bool) for _ in self.subs]
        for i in range(1, n_types + 1):
            for j in range(i, n_types + 1):
                if (i, j) not in of:
                    a, b = of.get((i, i)), of.get((j, j))
                    if i == j or a is None or b is None or len(a) != 1 or a != b:
                        raise AtcError(
                            f"{self.where}: no sub-style for types {i} and {j}: add 'pair_coeff {i} {j} <style> ...', "
                            f"or 'pair_coeff {i} {j} none'"
                        )
                    of[i, j] = a
                for k in of[i, j]:
                    masks[k][i, j] = masks[k][j, i] = True
        return masks


def _mapped(style: str, line: CoeffLine, pair) -> bool:
    elements = mapped_elements(style, line.words)
    return all(t <= len(elements) and elements[t - 1] != "NULL" for t in pair)


def _is_argument(word: str) -> bool:
    return bool(_NUMBER.match(word)) or word in _ARGUMENTS


def _parse_subs(style, known) -> list[SubStyle]:
    """The sub-styles behind ``hybrid`` on the pair_style line; `known` are the names that may occur."""
    subs: list[SubStyle] = []
    scaled = style.name == "hybrid/scaled"
    for k, word in enumerate(style.args):
        if scaled and k + 1 < len(style.args) and not _is_argument(style.args[k + 1]):
            # The factor in front of the next sub-style.
            if not _NUMBER.match(word):
                raise AtcError(
                    f"{style.where}: {style.name}: the factor {word} may change as the run goes: give its value as a "
                    "number"
                )
            factor = float(word)
            continue
        if _is_argument(word) or (subs and subs[-1].name == "list" and not subs[-1].args):
            if not subs:
                raise AtcError(f"{style.where}: expected a sub-style behind {style.name}, got {word!r}")
            subs[-1].args += (word,)
        else:
            name = strip_suffix(word)
            if name not in known:
                why = reason("pair", name) or f"expected one of {', '.join(sorted(known))}"
                raise AtcError(f"{style.where}: {word} as a sub-style of {style.name} is not supported: {why}")
            subs.append(SubStyle(name, ()))
            if scaled:
                if k == 0:
                    raise AtcError(f"{style.where}: {style.name} needs a factor in front of {word}")
                subs[-1].factor = factor
    if not subs:
        raise AtcError(f"{style.where}: {style.name} needs sub-styles")
    for s in subs:
        same = [t for t in subs if t.name == s.name]
        if len(same) > 1:
            s.index = 1 + next(k for k, t in enumerate(same) if t is s)
    return subs


def parse_hybrid(style, lines: list[CoeffLine]) -> Hybrid:
    """From the words behind ``pair_style hybrid[/overlay]``, the pair_coeff and the pair_modify lines."""
    subs = _parse_subs(style, PAIR_STYLES)
    order = []
    for line in lines:
        if not line.words:
            raise AtcError(f"{line.where}: expected the sub-style behind the types")
        if line.words[0] == "none":
            order.append((None, line))
            continue
        sub, words = _find(subs, line.words, line.where)
        line = CoeffLine(line.types, words, line.where)
        sub.lines.append(line)
        order.append((sub, line))
    for s in subs:
        if not s.lines and s.name != "zero":
            raise AtcError(
                f"{style.where}: the sub-style {s.called} has no pair_coeff line: add one, or drop the sub-style"
            )
    for c in style.modify:
        words, targets = c.words, subs
        if words[:1] == ("pair",):
            sub, words = _find(subs, words[1:], c.where)
            targets = [sub]
        for s in targets:
            s.modify = apply_modify(s.modify, [(words, c.where)])
    return Hybrid(subs, order, style.name != "hybrid", style.where)


def _find(subs, words, where):
    """The sub-style that the words of a line name (with its number if the name occurs more than once), and the words
    behind it."""
    name = strip_suffix(words[0]) if words else ""
    same = [s for s in subs if s.name == name]
    if not same:
        raise AtcError(
            f"{where}: {name or 'nothing'} is not a sub-style of the hybrid: expected "
            f"{', '.join(s.called for s in subs)} or none"
        )
    if len(same) == 1:
        return same[0], words[1:]
    number = words[1] if len(words) > 1 else ""
    for s in same:
        if number == str(s.index):
            return s, words[2:]
    raise AtcError(
        f"{where}: {name} is used {len(same)} times in the hybrid: say which with a number behind it, such as '{name} "
        "1'"
    )
