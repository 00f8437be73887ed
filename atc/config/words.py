"""Small things that people write: names with a slip in them, and which frames are meant."""

from __future__ import annotations

import difflib


def guess(word: str, known) -> str:
    """ "did you mean ...? " for the known word that is nearest, "" where none is near."""
    known = {str(k).lower(): k for k in known}
    near = difflib.get_close_matches(str(word).lower(), list(known), n=1, cutoff=0.6)
    return f"did you mean {known[near[0]]!r}? " if near else ""


def unknown(what: str, word: str, known) -> str:
    """ "unknown WHAT: ..." with the known words, first the one nearest to `word`."""
    return f"unknown {what}: {guess(word, known)}known: {', '.join(map(str, known))}"


def frame_slice(value) -> slice:
    """The `slice` that a scene's ``frames`` means: ``"100:500:5"``, ``{begin, end, step}``, or one frame's index.
    ValueError if it means none."""
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
