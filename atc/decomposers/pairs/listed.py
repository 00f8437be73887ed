"""Pairs of atoms listed by their numbers, each with a formula of its own (LAMMPS ``pair_style list``)."""

from __future__ import annotations

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ...readers.whole import whole_text
from ..base import Accumulator
from ..bonded.cluster import ClusterTerm, first_not_finite
from ..numbering import atoms_of_ids
from ..registry import StyleInput, pair_style

_PER_LENGTH = {"length": -1}
#: form: numbers behind its name
FORMS = {
    "lj126": (("epsilon", "energy"), ("sigma", "length")),
    "morse": (("d0", "energy"), ("alpha", _PER_LENGTH), ("r0", "length")),
    "harmonic": (("K", {"energy": 1, "length": -2}), ("r0", "length")),
    "quartic": (("K", {"energy": 1, "length": -4}), ("r0", "length"), ("b1", "length"), ("b2", "length")),
}


class ListedPairs(ClusterTerm):
    """U of listed pairs of atoms at their closest images, for d < cutoff, half to each atom.

    Forms: lj126 4ε[(σ/d)¹² − (σ/d)⁶]; morse D₀[1 − e^{−α(d − r₀)}]²; harmonic K(d − r₀)²; quartic K(d − r₀)²(d − r₀ −
    b₁)(d − r₀ − b₂). special_bonds does not weight them.

    Parameters
    ----------
    ids : (m, 2) atom numbers
    forms : (m,) names. numbers : (m, 4) their numbers, internal units, filled up with 0. cutoffs : (m,)
    where : for messages
    """

    bodies = 2
    weights = np.array([0.5, 0.5])
    pairwise = True
    #: whether special_bonds is none of its business
    unweighted = True

    def __init__(self, ids, forms, numbers, cutoffs, where="list"):
        self.ids, self.forms = np.asarray(ids, np.int64).reshape(-1, 2), np.asarray(forms, dtype=object)
        self.where = where
        self.numbers, self.cutoffs = np.asarray(numbers, float).reshape(-1, 4), np.asarray(cutoffs, float)

    def describe(self) -> str:
        return f"{len(self.ids)} listed pairs, energy shared half to each atom"

    def terms_of(self, frame: Frame):
        atoms, found = atoms_of_ids(frame, self.ids)
        if not found.all():
            missing = self.ids[~found][0]
            raise AtcError(
                f"{frame.source}: {self.where} names atom {missing}, which is not in this frame: dump all atoms"
            )
        return np.ascontiguousarray(atoms, dtype=np.int32), np.arange(len(atoms), dtype=np.int32)

    def evaluate(self, x_tkc, types, U, G, acc: Accumulator) -> int:
        d = np.sqrt(((x_tkc[:, 1] - x_tkc[:, 0]) ** 2).sum(axis=1))
        p, near = self.numbers[types], d < self.cutoffs[types]
        U[:] = 0.0
        G[:] = 0.0
        with np.errstate(all="ignore"):
            for form in FORMS:
                b = np.flatnonzero(near & (self.forms[types] == form))
                if len(b):
                    u, du = _FORMULA[form](d[b], *p[b].T)
                    U[b], G[b, 0] = u, du / d[b]
        return first_not_finite(U, G)


def _lj(d, epsilon, sigma, *_):
    s6 = (sigma / d) ** 6
    return 4 * epsilon * (s6 * s6 - s6), -4 * epsilon * (12 * s6 * s6 - 6 * s6) / d


def _morse(d, d0, alpha, r0, *_):
    x = np.exp(-alpha * (d - r0))
    return d0 * (1 - x) ** 2, 2 * d0 * alpha * x * (1 - x)


def _harmonic(d, K, r0, *_):
    return K * (d - r0) ** 2, 2 * K * (d - r0)


def _quartic(d, K, r0, b1, b2):
    t = d - r0
    return K * t * t * (t - b1) * (t - b2), K * t * (2 * (t - b1) * (t - b2) + t * (2 * t - b1 - b2))


_FORMULA = {"lj126": _lj, "morse": _morse, "harmonic": _harmonic, "quartic": _quartic}


@pair_style("list")
def _list_style(inp: StyleInput):
    if not 2 <= len(inp.args) <= 3 or (len(inp.args) == 3 and inp.args[2] not in ("check", "nocheck")):
        raise inp.wrong(f"{inp.command} takes a file, a cutoff and [check or nocheck]")
    if inp.modify.shift:
        raise inp.error(
            f"{inp.command}: pair_modify shift yes is not supported for listed pairs: set it for the other sub-styles "
            "only"
        )
    path = inp.path(inp.args[0])
    rc = inp.number(inp.args[1], "length", "cutoff")
    for line in inp.coeffs:
        inp.numbers(line.words, [], line)
    ids, forms, numbers, cutoffs = [], [], [], []
    for k, text in enumerate(whole_text(path, "pair list", inp.where).splitlines(), 1):
        words = text.split("#")[0].split()
        if not words:
            continue
        here = inp.replace(where=f"{path}, line {k}")
        if len(words) < 3 or not (words[0].isdigit() and words[1].isdigit()) or words[2] not in FORMS:
            raise here.error(
                f"expected two atom numbers, one of {', '.join(FORMS)}, its coefficients and [cutoff], got "
                f"{' '.join(words)[:80]}"
            )
        if words[0] == words[1]:
            raise here.error(f"atom {words[0]} is paired with itself")
        *values, cut = here.numbers(words[3:], [*FORMS[words[2]], ("cutoff", "length")], optional=1)
        ids.append((int(words[0]), int(words[1])))
        forms.append(words[2])
        numbers.append(values + [0.0] * (4 - len(values)))
        cutoffs.append(rc if cut is None else cut)
    if not ids:
        raise inp.error(f"{inp.command}: {path} lists no pairs")
    return ListedPairs(ids, forms, numbers, cutoffs, str(path))
