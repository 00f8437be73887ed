"""When sums are taken again by tighter methods: where a field's error is too large, or fields are quotients of sums
that are nearly nothing."""

from __future__ import annotations

import numpy as np

from .methods import EXACT, Method, Refinement, deposits_of
from .work import Work

#: What of the tolerance may be found, at random points and around the strongest bonds. All of it may be what normally
#: distributed errors reach at as many points as there are: an estimate on the large side, since errors of neighbouring
#: points are alike.
SAFE = 0.65
# Where the density is below this fraction of its largest value, quotients by it need the exact sums.
_THIN = 0.02
# Where less than this share of thermal motion is seen relative to the local velocity, so does its correction.
_FEW = 0.75
# The sums that fields are quotients of: deposit, and where its density is.
_QUOTIENTS = (
    ("site", "site", "mass"),
    ("site", "site", "all_mass"),
    ("gather", "gathered", "mass"),
    ("reference_gather", "gathered", "reference_mass"),
)


def watched(work: Work, methods, check_points: int) -> bool:
    """Whether there are approximate sums over bonds, and fields of them, that are to be looked at around the strongest
    bonds."""
    return bool(not methods.get("bond", EXACT).exact and work.bond and check_points and work.checkable)


def thin_sums(main, work: Work, methods) -> set[str]:
    """The deposits whose sums are small somewhere though fields are quotients by them. What an approximate sum leaves
    where there is no mass is no mass: it is taken away."""
    thin = set()
    for key, of, name in _QUOTIENTS:
        method, rho = methods.get(key, EXACT), getattr(main, of).get(name)
        if rho is None:
            continue
        if not method.exact:
            rho[rho < 4 * method.tolerance * rho.max(initial=0.0)] = 0.0
        if (key != "site" or work.masked) and rho.min(initial=np.inf) < _THIN * rho.max(initial=0.0):
            thin.add(key)
    if work.squares and main.squared and (main.seen < _FEW).any():
        thin.add("site")
    return thin


def tightened(work: Work, methods, thin, expected, goal) -> dict[str, tuple[Method, Refinement]]:
    """{deposit: (its next method, why)} for every approximate deposit that a field with too large an error is made of.

    thin : see `thin_sums`; expected : the error of each field
    """
    loose = {key for key, m in methods.items() if not m.exact}
    out = {}
    for key, _, _ in _QUOTIENTS:
        if key in loose & thin:
            why = "nearly empty space, where fields are quotients of small sums"
            out[key] = methods[key].exactly(why), Refinement(why)
    if not loose:
        return out
    for q in work.quantities:
        error = expected.get(q.name, 0.0)
        if error <= goal:
            continue
        for key in deposits_of(q, work):
            if key not in loose:
                continue
            method = methods[key].tightened(error, goal)
            if method != methods[key] and (
                key not in out or method.exact or not 0 < out[key][0].tolerance <= method.tolerance
            ):
                if key not in out or not out[key][0].exact:
                    out[key] = method, Refinement(f"{q.name} above {goal:.1e}", error)
    return out
