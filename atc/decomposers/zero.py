"""pair_style zero: no interaction."""

from __future__ import annotations

from .registry import StyleInput, pair_style


@pair_style("zero")
def _zero_style(inp: StyleInput):
    words = [w for w in inp.args if w not in ("nocoeff", "full")]
    inp.replace(args=tuple(words)).numbers(words, [("cutoff", "length")])
    return []
