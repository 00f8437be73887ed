"""Pairs of atoms that no pair style acts on: LAMMPS's ``neigh_modify exclude`` and ``include``.

Bonds, angles and the like between such atoms act all the same.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...compiled import njit
from ...errors import AtcError


@dataclass(frozen=True)
class Exclusions:
    """Which pairs are left out.

    Parameters
    ----------
    types : ((i, j), ...) pairs of atom types
    groups : names of groups; `Frame.groups` has a bit for each, in this order
    pairs : ((k, l), ...) one atom in the k-th group, the other in the l-th
    same, different : groups whose atoms do not act on each other in the same molecule, or in different molecules
    only : the group whose atoms alone act on each other, or none
    where : the first line that said so, for messages
    """

    types: tuple[tuple[int, int], ...] = ()
    groups: tuple[str, ...] = ()
    pairs: tuple[tuple[int, int], ...] = ()
    same: tuple[int, ...] = ()
    different: tuple[int, ...] = ()
    only: tuple[int, ...] = ()
    where: str = ""

    def __bool__(self):
        return bool(self.types or self.pairs or self.same or self.different or self.only)

    @property
    def keyword(self) -> str:
        """Of ``neigh_modify``, for messages."""
        return "exclude" if self.types or self.pairs or self.same or self.different else "include"

    def prepare(self, frame) -> _Excluded:
        """Ready for one frame. AtcError where its groups or molecules are not known."""
        n = len(frame)
        if (
            (self.pairs or self.same or self.different or self.only)
            and frame.groups is None
            and set(self.groups) != {"all"}
        ):
            raise AtcError(
                f"{self.where}: who is in group {next(g for g in self.groups if g != 'all')} is not known for "
                f"{frame.source}: give atc the frames of a trajectory, with the data file that the script reads"
            )
        if (self.same or self.different) and frame.molecules is None:
            raise AtcError(
                f"{self.where}: pairs are left out by molecule, but {frame.source} does not say which atom is in "
                "which: dump mol too"
            )
        top = max(int(frame.types.max(initial=1)), max((t for p in self.types for t in p), default=1))
        mask = np.zeros((top + 1, top + 1), np.bool_)
        for i, j in self.types:
            mask[i, j] = mask[j, i] = True
        everyone = sum(1 << k for k, g in enumerate(self.groups) if g == "all")
        own = (1 << len(self.groups)) - 1  # behind them stand groups that others need
        bits = (np.zeros(n, np.int64) if frame.groups is None else frame.groups & own) | everyone
        molecules = np.zeros(n, np.int64) if frame.molecules is None else frame.molecules
        a, b = (np.array([1 << p[s] for p in self.pairs], np.int64) for s in (0, 1))
        same, different = (np.array([1 << k for k in ks], np.int64) for ks in (self.same, self.different))
        for k in self.only:
            # whoever is not in it is in a group of its own that nobody acts on
            outside = np.int64(1) << len(self.groups)
            bits = np.where(bits & (1 << k), bits, bits | outside)
            both = np.int64(1 << k) | outside
            a, b = np.append(a, outside), np.append(b, both)
        return _Excluded((frame.types.astype(np.int32), bits, molecules), (mask, a, b, same, different))


@dataclass(frozen=True)
class _Excluded:
    """Types, groups and molecules of a frame's atoms, and the rules about them."""

    atoms: tuple[np.ndarray, ...]
    rules: tuple[np.ndarray, ...]

    def leave_out(self, ws, n: int) -> int:
        """Take the pairs out of the first n of a workspace; how many are left."""
        return _leave_out((ws.i, ws.j, ws.r, ws.d2), n, self.atoms, self.rules)


@njit(cache=True, nogil=True, error_model="numpy")
def _leave_out(pairs, n, atoms, rules):
    (i, j, r, d2), (types, bits, molecules), (mask, a, b, same, different) = pairs, atoms, rules
    m = 0
    for k in range(n):
        p, q = i[k], j[k]
        out = mask[types[p], types[q]]
        bp, bq = bits[p], bits[q]
        for g in range(len(a)):
            if (bp & a[g] and bq & b[g]) or (bp & b[g] and bq & a[g]):
                out = True
        if molecules[p] == molecules[q]:
            for g in range(len(same)):
                if bp & same[g] and bq & same[g]:
                    out = True
        else:
            for g in range(len(different)):
                if bp & different[g] and bq & different[g]:
                    out = True
        if out:
            continue
        if m < k:
            i[m], j[m], d2[m] = p, q, d2[k]
            r[m, 0], r[m, 1], r[m, 2] = r[k, 0], r[k, 1], r[k, 2]
        m += 1
    return m


def exclusions_of(commands, type_of) -> Exclusions | None:
    """From the ``neigh_modify`` commands of a script, in order; `type_of(word, where)` gives the number of a type. None
    if nothing is left out.

    Raises AtcError for what LAMMPS does not know.
    """
    values = {"delay": 1, "every": 1, "check": 1, "once": 1, "cluster": 1, "page": 1, "one": 1, "binsize": 1}
    types, named, only, where = [], [], "all", ""
    for c in commands:
        if c.name != "neigh_modify":
            continue
        words, k = c.words, 0
        if c.unknown:
            raise c.error(f"{c.unknown}")
        where = where or c.where
        while k < len(words):
            key, rest = words[k], words[k + 1 :]
            kind = rest[0] if rest else ""
            if key == "include":
                if not kind:
                    raise c.error("neigh_modify include needs the name of a group")
                only, k = kind, k + 2
            elif key in values:
                k += 1 + values[key]
            elif key.startswith("collection/"):
                k += 2 + (int(kind) if kind.isdigit() else 0)
            elif key != "exclude":
                raise c.error(f"neigh_modify {key} is not known")
            elif kind == "none":
                types, named, k = [], [], k + 2
            elif kind in ("type", "group") and len(rest) > 2:
                if kind == "type":
                    types.append((type_of(rest[1], c.where), type_of(rest[2], c.where)))
                else:
                    named.append((kind, rest[1], rest[2]))
                k += 4
            elif kind in ("molecule/intra", "molecule/inter", "molecule") and len(rest) > 1:
                named.append(("molecule/intra" if kind == "molecule" else kind, rest[1]))
                k += 3
            else:
                raise c.error(
                    f"expected neigh_modify exclude type, group, molecule/intra, molecule/inter or none, "
                    f"got {' '.join(rest) or 'nothing'}"
                )
    some = () if only == "all" else (only,)
    groups = tuple(dict.fromkeys([*(g for n in named for g in n[1:]), *some]))
    at = groups.index
    out = Exclusions(
        tuple(types),
        groups,
        tuple((at(n[1]), at(n[2])) for n in named if n[0] == "group"),
        tuple(at(n[1]) for n in named if n[0] == "molecule/intra"),
        tuple(at(n[1]) for n in named if n[0] == "molecule/inter"),
        tuple(map(at, some)),
        where,
    )
    return out or None
