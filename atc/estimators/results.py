"""The fields of a frame, as the driver gives them back, and how those of several are put together: of frames and of
runs of them to means, of parts along one more axis, of planes with what is on no grid.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ..contracts import BoundGrid
from .methods import Method, Refinement
from .quantities.quantity import Quantity
from .sums import Sums
from .tensors import quotient


@dataclass
class FrameResult:
    """The fields of one frame, or the mean fields of some, in the user's units; masked quantities hold 0 where `mask`
    is False.

    errors : of each field, what was found (see `accuracy.random_points.Check.errors`)
    expected : of each field, its largest error anywhere as far as the points of the check tell: at least what was found
        there
    methods, refined : the methods used in the end; what was computed again, and why
    common : of fields of parts, where there is mass of any part: what is relative to the velocity of all is known there
    frames, within : of how many frames these are the means, and how far those are from them (mean square), by field
    """

    arrays: dict[str, np.ndarray]
    mask: np.ndarray | None = None
    weights: dict[str, np.ndarray] = field(default_factory=dict)
    errors: dict[str, dict[str, float]] = field(default_factory=dict)
    bound: BoundGrid | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)
    methods: dict[str, Method] = field(default_factory=dict)
    refined: list[Refinement] = field(default_factory=list)
    expected: dict[str, float] = field(default_factory=dict)
    frames: int = 1
    within: dict[str, float] = field(default_factory=dict)
    common: np.ndarray | None = None


def take_largest(known: dict, errors) -> None:
    """Errors by field and kind into others, the largest of each; what is no number stays seen."""
    for name, found in errors.items():
        at = known.setdefault(name, {})
        for kind, value in found.items():
            at[kind] = float(np.maximum(value, at.get(kind, 0.0)))


def count(known: dict, notes) -> None:
    """What is counted into other counts."""
    for what, more in notes.items():
        known[what] = known.get(what, 0) + more


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
        return quotient(self.sums[name], self.weights[name])

    def of(self, q: Quantity) -> np.ndarray:
        """The mean of a field that was added, or whose parts were."""
        return self.mean(q.name) if q.name in self.sums else sum(self.mean(name) for name in q.parts)

    def within(self, q: Quantity) -> float:
        """Mean square deviation of the fields from their mean, see `BlockAverage.add`."""
        names = q.parts or (q.name,)
        if names[0] in self.weights:
            mean, weight = self.mean(q.name), self.weight(q.name)
            deviations = (quotient(x - _wide(w, x) * mean, weight) for x, w in self.each[q.name])
            return float(np.mean([d**2 for d in deviations]))
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
        take_largest(errors, r.errors)
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
    arrays, weights = {}, {}
    errors: dict = {}
    notes: dict = {}
    for name in first.arrays:
        if name in first.weights:
            weights[name] = w = sum(r.frames * r.weights[name] for r in results) / n
            total = sum(r.frames * r.arrays[name] * _wide(r.weights[name], r.arrays[name]) for r in results) / n
            arrays[name] = quotient(total, w)
        else:
            arrays[name] = sum(r.frames * r.arrays[name] for r in results) / n
    for r in results:
        take_largest(errors, r.errors)
        count(notes, r.notes)
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


def with_others(on_planes: FrameResult, others: FrameResult, names) -> FrameResult:
    """The fields on planes, and those of the same frame that are on no grid, in the order of `names`."""
    return replace(
        others,
        arrays={name: {**on_planes.arrays, **others.arrays}[name] for name in names},
        errors={**others.errors, **on_planes.errors},
        expected={**others.expected, **on_planes.expected},
        bound=on_planes.bound,
        seconds={key: on_planes.seconds.get(key, 0.0) + s for key, s in others.seconds.items()},
    )
