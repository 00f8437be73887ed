"""special_bonds: pairs of atoms one, two or three bonds apart, whose pair interactions are weighted or left out (LAMMPS
``special_bonds``)."""

from __future__ import annotations

import numpy as np

from ...compiled import njit
from ...errors import AtcError
from ...readers.lammps.sections import number_of
from ..numbering import pair_codes

_PRESETS = {
    "amber": ((0.0, 0.0, 0.5), (0.0, 0.0, 5.0 / 6.0)),
    "charmm": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)),
    "dreiding": ((0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
    "fene": ((0.0, 1.0, 1.0), (0.0, 1.0, 1.0)),
}


class SpecialBonds:
    """Weights of the pair interactions between 1-2, 1-3 and 1-4 neighbours (one, two, three bonds apart; the fewest
    count).

    As in LAMMPS, a pair that is not the minimum image of its atoms is no special pair: a bonded atom's other images
    interact fully.

    Parameters
    ----------
    lj, coul : three weights each
    angle : 1-3 neighbours only if an angle (or dihedral) of the topology joins them
    dihedral : 1-4 neighbours only if a dihedral of the topology joins them
    """

    def __init__(self, lj=(0.0, 0.0, 0.0), coul=(0.0, 0.0, 0.0), angle: bool = False, dihedral: bool = False):
        self.lj, self.coul = tuple(map(float, lj)), tuple(map(float, coul))
        self.angle, self.dihedral = bool(angle), bool(dihedral)
        self._last = None

    def __getstate__(self):
        return {**self.__dict__, "_last": None}

    @classmethod
    def from_lines(cls, lines) -> SpecialBonds:
        """From (words, where) of ``special_bonds`` lines: each line starts from LAMMPS's defaults (all 0), so the last
        one holds."""
        special = cls()
        for words, where in lines:
            special = cls._from_words(list(words), where)
        return special

    @classmethod
    def _from_words(cls, words, where):
        lj = coul = (0.0, 0.0, 0.0)
        flags = {"angle": False, "dihedral": False}
        if not words:
            raise AtcError(f"{where}: special_bonds needs weights such as 'lj/coul 0 1 1'")
        k = 0
        while k < len(words):
            key = words[k]
            if key in _PRESETS:
                lj, coul = _PRESETS[key]
                k += 1
            elif key in ("lj", "coul", "lj/coul"):
                weights = _three(words[k + 1 : k + 4], key, where)
                lj = weights if "lj" in key else lj
                coul = weights if "coul" in key else coul
                k += 4
            elif key == "extra" and k + 1 < len(words):
                k += 2  # room in a list of LAMMPS's own
            elif key == "one/five" and words[k + 1 : k + 2] in (["no"], ["off"], ["false"]):
                k += 2
            elif key in flags:
                value = words[k + 1] if k + 1 < len(words) else ""
                if value not in ("yes", "no", "on", "off", "true", "false"):
                    raise AtcError(f"{where}: special_bonds {key}: expected yes or no, got {value or 'nothing'}")
                flags[key] = value in ("yes", "on", "true")
                k += 2
            else:
                raise AtcError(
                    f"{where}: special_bonds {key} is not supported: expected lj, coul, lj/coul with three weights, "
                    f"angle, dihedral, {', '.join(_PRESETS)}"
                )
        return cls(lj, coul, **flags)

    def with_own(self, lines, where) -> SpecialBonds:
        """These weights with those that ``pair_modify special`` gives one style: ((which, three weights), ...).

        LAMMPS leaves pairs of weight 0 out of its lists, and does not know those of weight 1, before a style sees them:
        only weights between can be others.
        """
        lj, coul = self.lj, self.coul
        for which, *words in lines:
            weights = _three(words, which, where)
            lj = weights if "lj" in which else lj
            coul = weights if "coul" in which else coul
        for k in range(3):
            both, new = {self.lj[k], self.coul[k]}, {lj[k], coul[k]}
            if len(both) == 1 and both <= {0.0, 1.0} and new != both:
                raise AtcError(
                    f"{where}: pair_modify special cannot change the weight {both.pop():g} of 1-{k + 2} neighbours, "
                    "which LAMMPS fixes in its lists: a special_bonds weight such as 1e-10 can be changed"
                )
        return type(self)(lj, coul, self.angle, self.dihedral)

    @property
    def trivial(self) -> bool:
        """Whether all weights are 1."""
        return set(self.lj) | set(self.coul) == {1.0}

    def prepare(self, frame, keep_excluded: bool = False) -> _Weights | None:
        """The weights for a frame; None if it has no bonds or nothing is weighted. `keep_excluded`: pairs of weight 0
        stay in the list."""
        top = frame.topology
        ready = None if top is None else top.special
        if ready is not None:
            return _Weights(self, ready.cell, ready.start, ready.other, ready.apart, ready.hints, keep_excluded)
        if top is not None and top.untold and not self.trivial:
            raise AtcError(top.untold)
        if top is not None and top.weighted is not None:
            top = top.weighted
        if top is None or not len(top.bonds) or self.trivial:
            return None
        last = self._last
        if last is None or last[0] is not top or last[1] != len(frame):
            self._last = last = (top, len(frame), *self.lists(top, len(frame)))
        return _Weights(self, frame.cell, *last[2:], keep_excluded)

    def lists(self, top, n):
        """For every atom its special neighbours (CSR: start, neighbour), how many bonds apart they are (1, 2, 3), and
        `special_hints`."""
        bonds = np.unique(np.sort(np.asarray(top.bonds, np.int64), axis=1), axis=0)
        start, other = _neighbours(bonds, n)
        a, d = np.asarray(top.angles, np.int64), np.asarray(top.dihedrals, np.int64)
        joined13 = np.unique(pair_codes(np.concatenate([a[:, [0, 2]], d[:, [0, 2]], d[:, [1, 3]]]), n))
        joined14 = np.unique(pair_codes(d[:, [0, 3]], n))
        start, other, apart = _special(n, start, other, self.angle, joined13, self.dihedral, joined14)
        return start, other, apart, special_hints(start, other)


class _Weights:
    """One frame's special pairs."""

    def __init__(self, special, cell, start, other, apart, hints, keep):
        self.start, self.other, self.apart, self.hints, self.keep = start, other, apart, hints, keep
        # With weights 0 and 1 only, the pairs that remain are ordinary ones.
        self.plain = not keep and all(w in ((0.0, 0.0), (1.0, 1.0)) for w in zip(special.lj, special.coul, strict=True))
        self.lj = np.array([1.0, *special.lj])
        self.coul = np.array([1.0, *special.coul])
        # LAMMPS tests |dx| > Lx/2 with a along x and b in the x-y plane: turn other cells that way.
        v = cell.vectors
        if np.all(v == np.tril(v)) and (np.diag(v) > 0).all():
            self.turn, edge = np.eye(3), np.diag(v)
        else:
            q, r = np.linalg.qr(v.T)
            sign = np.where(np.diag(r) < 0, -1.0, 1.0)
            self.turn, edge = q * sign, np.diag(r) * sign
        self.half = np.where(cell.periodic, edge / 2.0, np.inf)

    def weigh(self, ws, n: int):
        """Weights (lj, coul) of the first n pairs of a workspace, empty if all are 1; pairs of weight 0 are dropped
        from it (unless kept).

        Returns the new n first.
        """
        lj, coul = (np.zeros(0), np.zeros(0)) if self.plain else (np.empty(n), np.empty(n))
        pairs, lists = (ws.i, ws.j, ws.r, ws.d2), (self.start, self.other, self.apart, self.hints)
        n = _weigh(pairs, n, lists, self.lj, self.coul, self.turn, self.half, self.keep, lj, coul)
        return n, lj[:n], coul[:n]


def _three(words, key, where):
    out = tuple(number_of(w) for w in words)
    if len(out) != 3 or not all(w is not None and 0.0 <= w <= 1.0 for w in out):
        raise AtcError(
            f"{where}: special_bonds {key} needs three weights between 0 and 1, got {' '.join(words) or 'nothing'}"
        )
    return out


def _neighbours(bonds, n):
    """CSR adjacency of undirected bonds."""
    both = np.concatenate([bonds, bonds[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    return np.concatenate([[0], np.cumsum(np.bincount(both[:, 0], minlength=n))]), np.ascontiguousarray(both[:, 1])


@njit(cache=True, error_model="numpy")
def _joined(keys, n, i, j):
    key = min(i, j) * n + max(i, j)
    k = np.searchsorted(keys, key)
    return k < len(keys) and keys[k] == key


@njit(cache=True, error_model="numpy")
def _special(n, start, other, trim13, joined13, trim14, joined14):
    seen = np.full(n, -1)
    first = np.zeros(n + 1, np.int64)
    capacity = 16 * n + 64
    out = np.empty(capacity, np.int32)
    apart = np.empty(capacity, np.int8)
    m = np.int64(0)  # not the literal, for which `_put` would be compiled once more
    for i in range(n):
        seen[i] = i
        for level in range(1, 4):
            for a in range(start[i], start[i + 1]):
                j = other[a]
                if level == 1:
                    if seen[j] != i:
                        seen[j] = i
                        out, apart, m = _put(out, apart, m, j, 1)
                    continue
                for b in range(start[j], start[j + 1]):
                    k = other[b]
                    if k == i:
                        continue
                    if level == 2:
                        if seen[k] != i and (not trim13 or _joined(joined13, n, i, k)):
                            seen[k] = i
                            out, apart, m = _put(out, apart, m, k, 2)
                        continue
                    for c in range(start[k], start[k + 1]):
                        l = other[c]
                        if seen[l] != i and (not trim14 or _joined(joined14, n, i, l)):
                            seen[l] = i
                            out, apart, m = _put(out, apart, m, l, 3)
        first[i + 1] = m
    return first, out[:m].copy(), apart[:m].copy()


@njit(cache=True, error_model="numpy")
def _put(out, apart, m, other, level):
    """Put one more behind m neighbours, in longer arrays where these are full."""
    o, a = out, apart
    if m == len(out):
        o, a = np.empty(2 * m, np.int32), np.empty(2 * m, np.int8)
        # One by one: an assignment of arrays would bring numba's messages on shapes along, seconds of compiling.
        for k in range(m):
            o[k], a[k] = out[k], apart[k]
    o[m], a[m] = other, level
    return o, a, m + 1


@njit(cache=True, error_model="numpy")
def special_hints(start, other):
    """For every atom a word with the bits (neighbour mod 64) of its special neighbours set: most pairs are seen not to
    be special from it."""
    bits = np.zeros(len(start) - 1, np.uint64)
    for i in range(len(bits)):
        for k in range(start[i], start[i + 1]):
            bits[i] |= np.uint64(1) << np.uint64(other[k] & 63)
    return bits


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh(pairs, n, lists, lj, coul, turn, half, keep, wl, wc):
    (i, j, r, d2), (start, other, apart, hints) = pairs, lists
    weighted = len(wl) > 0
    m = 0
    for b in range(n):
        p, q = i[b], j[b]
        level = 0
        if (hints[p] >> np.uint64(q & 63)) & np.uint64(1):
            for k in range(start[p], start[p + 1]):
                if other[k] == q:
                    level = apart[k]
                    break
            if level > 0:
                for c in range(3):
                    x = r[b, 0] * turn[0, c] + r[b, 1] * turn[1, c] + r[b, 2] * turn[2, c]
                    if abs(x) > half[c]:
                        level = 0
            if not keep and lj[level] == 0.0 and coul[level] == 0.0:
                continue
        if m < b:
            i[m], j[m], d2[m] = p, q, d2[b]
            r[m, 0], r[m, 1], r[m, 2] = r[b, 0], r[b, 1], r[b, 2]
        if weighted:
            wl[m], wc[m] = lj[level], coul[level]
        m += 1
    return m
