"""pair_style zero: no interaction."""

from __future__ import annotations

import numpy as np

from ..base import Term, Work
from ..registry import StyleInput, pair_style


@pair_style("zero")
def _zero_style(inp: StyleInput):
    words = [w for w in inp.args if w not in ("nocoeff", "full")]
    inp.replace(args=tuple(words)).numbers(words, [("cutoff", "length")])
    return []


@pair_style("tracker")
def _tracker_style(inp: StyleInput):
    """It counts how long pairs stay close, and has no forces."""
    return []


class Nothing(Term):
    """No interaction at all: a run whose only styles are ``zero`` has density, temperature and the like, and no
    potential stress."""

    pairwise = True

    def describe(self) -> str:
        return "no interactions (styles zero)"

    def prepare(self, frame) -> Work:
        return Work()

    def terms_of(self, frame):
        """No atoms, no types."""
        return np.zeros((0, 2), np.int32), np.zeros(0, np.int32)
