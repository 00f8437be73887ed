"""Which frames of a time average are added up before their sums are finished, and what can be: sums over atoms and
bonds are linear.

One transform, one evaluation on the grid and one comparison then do for all frames of a group, and a time average gets
its blocks ready made. What is not linear in the sums (the kinetic stress, the temperature: relative to the velocity
field of each frame) is formed frame by frame, and its mean taken; sums over bonds that it does not need are added up
all the same. The error check goes its own way: the exact fields of each frame at random points, the same for all frames
of the group, and their mean. Of all strongest bonds of the group as many are summed exactly as of one frame, and the
rest watched.

What a group gives depends on its frames, the settings and the number of its first frame alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .quantities.quantity import Quantity
from .settings import FrameResult
from .statistics import longest_block
from .sums import Sums
from .work import Work

#: Atoms of all frames of a group, at most. The frames are held until the group is done: it may have to be computed
#: again.
ATOMS = 2**19
#: Random points of the error check: of all groups of a window together many more than of one frame.
POINTS = 24


def size_of(window: int, atoms: int) -> int:
    """How many frames of a window are added up: a power of two, so that blocks of blocks have whole numbers of
    groups."""
    most = max(1, min(longest_block(window), ATOMS // max(atoms, 1)))
    return 1 << (most.bit_length() - 1)


def added_up(work: Work) -> frozenset[str]:
    """The deposits whose sums can be added up over frames ("site", "bond"); none if there is no gain in groups, or
    something asked is not made for them."""
    if any(
        (work.gather, work.reference_gather, work.reference_bond, work.point, work.reference_point, work.on_reference)
    ):
        return frozenset()
    if any(q.kind == "atom" for q in work.quantities):
        return frozenset()
    uses = [(q.linear, {key for key in ("site", "bond") if getattr(q, key)}) for q in elements(work)]
    found = set().union(*(keys for _, keys in uses))
    while True:
        spoilt = set().union(*(keys for linear, keys in uses if not (linear and keys <= found))) & found
        if not spoilt:
            break
        found -= spoilt
    return frozenset(found if "bond" in found or not work.bond else ())


def elements(work: Work) -> list[Quantity]:
    """The fields on the grid that others are sums of."""
    return [q for q in work.quantities if q.kind == "grid" and not q.parts]


def formed_once(work: Work) -> list[Quantity]:
    """Those that are formed once, from the mean sums."""
    together = added_up(work)
    return [q for q in elements(work) if q.linear and {key for key in ("site", "bond") if getattr(q, key)} <= together]


def of_one_cell(frames) -> list[list]:
    """Consecutive frames that share a cell: a cell that changes ends a sum."""
    runs: list[list] = []
    for frame in frames:
        if runs and frame.cell.complete and frame.cell == runs[-1][-1].cell:
            runs[-1].append(frame)
        else:
            runs.append([frame])
    return runs


class MeanFields:
    """The mean of fields that come one by one, of those with weights <w x>/<w>; of a single frame the field itself."""

    def __init__(self, keep: bool = False):
        self.keep, self.n = keep, 0
        self.sums: dict[str, np.ndarray] = {}
        self.weights: dict[str, np.ndarray] = {}
        self.first: dict[str, np.ndarray] = {}
        self.each: dict[str, list] = {}  # (w x, w), if they are to be kept

    def add(self, quantities, sums: Sums) -> None:
        self.n += 1
        for q in quantities:
            field = x = q.form(sums)
            w = None
            if q.weight is not None:
                w = sums.site[q.weight][:, 0]
                x = x * _wide(w, x)
                self.weights[q.name] = self.weights[q.name] + w if q.name in self.weights else w
            if self.keep:
                self.each.setdefault(q.name, []).append((x, w))
            if q.name in self.sums:
                self.sums[q.name] += x
                self.first.pop(q.name, None)
            else:
                self.sums[q.name], self.first[q.name] = x.copy(), field

    def weight(self, name: str):
        return self.weights[name] / self.n if name in self.weights else None

    def mean(self, name: str) -> np.ndarray:
        if name in self.first:
            return self.first[name]
        if name not in self.weights:
            return self.sums[name] / self.n
        w = self.weights[name]
        x = self.sums[name]
        return np.divide(x, _wide(w, x), out=np.zeros_like(x), where=_wide(w, x) > 0)

    def of(self, q: Quantity) -> np.ndarray:
        """The mean of a field that was added, or whose parts were."""
        return self.mean(q.name) if q.name in self.sums else sum(self.mean(name) for name in q.parts)

    def within(self, q: Quantity) -> float:
        """Mean square deviation of the fields from their mean, see `BlockAverage.add`."""
        names = q.parts or (q.name,)
        if names[0] in self.weights:
            mean, weight = self.mean(q.name), self.weight(q.name)
            return float(
                np.mean(
                    [
                        np.divide(
                            x - _wide(w, x) * mean, _wide(weight, x), out=np.zeros_like(x), where=_wide(weight, x) > 0
                        )
                        ** 2
                        for x, w in self.each[q.name]
                    ]
                )
            )
        mean = sum(self.mean(name) for name in names)
        return float(np.mean([(sum(self.each[name][k][0] for name in names) - mean) ** 2 for k in range(self.n)]))


def _wide(w, x):
    return w.reshape(w.shape + (1,) * (x.ndim - w.ndim))


def of_parts(results: list[FrameResult]) -> FrameResult:
    """The fields of all parts, one after the other along a new first axis; errors are the largest of any, the methods
    the closest."""
    first = results[0]
    methods = dict(first.methods)
    for r in results[1:]:
        for key, method in r.methods.items():
            if key not in methods or methods[key].looser_than(method):
                methods[key] = method
    errors: dict = {}
    for r in results:
        for name, found in r.errors.items():
            known = errors.setdefault(name, {})
            for key, value in found.items():
                known[key] = max(value, known.get(key, 0.0))
    return replace(
        first,
        arrays={name: np.stack([r.arrays[name] for r in results]) for name in first.arrays},
        weights={name: np.stack([r.weights[name] for r in results]) for name in first.weights},
        mask=None if first.mask is None else np.stack([r.mask for r in results]),
        common=None if first.common is None else np.stack([r.common for r in results]),
        errors=errors,
        expected={name: max(r.expected[name] for r in results) for name in first.expected},
        seconds={key: sum(r.seconds[key] for r in results) for key in first.seconds},
        notes=first.notes,
        methods=methods,
        refined=[why for r in results for why in r.refined],
        within={name: float(np.mean([r.within[name] for r in results])) for name in first.within},
    )


def joined(results: list[FrameResult]) -> FrameResult:
    """The mean of means."""
    n = sum(r.frames for r in results)
    first = results[0]
    arrays, weights, errors = {}, {}, {}
    for name in first.arrays:
        if name in first.weights:
            weights[name] = w = sum(r.frames * r.weights[name] for r in results) / n
            total = sum(r.frames * r.arrays[name] * _wide(r.weights[name], r.arrays[name]) for r in results) / n
            arrays[name] = np.divide(total, _wide(w, total), out=np.zeros_like(total), where=_wide(w, total) > 0)
        else:
            arrays[name] = sum(r.frames * r.arrays[name] for r in results) / n
    for r in results:
        for name, found in r.errors.items():
            errors[name] = {key: max(value, errors.get(name, {}).get(key, 0.0)) for key, value in found.items()} | {
                key: value for key, value in errors.get(name, {}).items() if key not in found
            }
    notes = {
        what: sum(r.notes.get(what, 0) for r in results)
        for what in dict.fromkeys(what for r in results for what in r.notes)
    }
    return replace(
        first,
        arrays=arrays,
        weights=weights,
        errors=errors,
        mask=None if first.mask is None else np.any([r.mask for r in results], axis=0),
        common=None if first.common is None else np.any([r.common for r in results], axis=0),
        seconds={key: sum(r.seconds[key] for r in results) for key in first.seconds},
        notes=notes,
        expected={name: max(r.expected[name] for r in results) for name in first.expected},
        frames=n,
        within={name: sum(r.frames * r.within.get(name, 0.0) for r in results) / n for name in first.arrays},
    )
