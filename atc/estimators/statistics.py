"""Time averages with a standard error that knows about correlation in time (block averaging, streaming).

Successive frames are correlated, so σ/√n is too small. Flyvbjerg & Petersen (J. Chem. Phys. 91, 461 (1989)) average
pairs of neighbours again and again: the apparent standard error of the mean rises with the block length until the
blocks are independent, and then stays on a plateau. Only one sum of squares per block length is kept: about
log2(frames) arrays.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

import numpy as np

from ..compiled import njit

# A block length counts as evidence only if at least this many blocks of it were seen: the standard error from n blocks
# is itself uncertain by 1/√(2(n−1)), 41 % at 4.
MIN_BLOCKS = 4
#: The shortest series whose numbers may come as means of a few of them, how many such blocks there are at least, and of
#: how many numbers at most. `BlockAverage` takes no blocks shorter than (2n)^⅓ numbers for the standard error, however
#: little they correlate: 8 of 64, 16 of 256. These are not longer.
LONG, BLOCKS, TOGETHER = 64, 16, 16
# Numbers that a thread is worth.
_PIECE = 200_000


def longest_block(n: int) -> int:
    """How many consecutive numbers of a series of n may be averaged before they come here: a power of two, so that
    blocks of blocks are whole."""
    most = min(TOGETHER, n // BLOCKS) if n >= LONG else 1
    return 1 << (most.bit_length() - 1)


@njit(cache=True, nogil=True, error_model="numpy")
def _pair(a, b, x0, s_xx, out, lo, hi):
    """Two blocks: their squares about `x0` added, their mean."""
    for e in range(lo, hi):
        u, v = a[e] - x0[e], b[e] - x0[e]
        s_xx[e] += u * u + v * v
        out[e] = 0.5 * (a[e] + b[e])


@njit(cache=True, nogil=True, error_model="numpy")
def _weighted_pair(a, b, wa, wb, x0, w0, s_xx, s_xw, s_ww, out, out_w, lo, hi):
    """The same with weights, one for as many successive numbers as go into one; lo, hi of the weights."""
    many = len(a) // max(len(wa), 1)
    for g in range(lo, hi):
        p, q = wa[g] - w0[g], wb[g] - w0[g]
        s_ww[g] += p * p + q * q
        out_w[g] = 0.5 * (wa[g] + wb[g])
        for e in range(g * many, (g + 1) * many):
            u, v = a[e] - x0[e], b[e] - x0[e]
            s_xx[e] += u * u + v * v
            s_xw[e] += u * p + v * q
            out[e] = 0.5 * (a[e] + b[e])


@dataclass
class _Level:
    """Blocks of one length: sums of products of their deviations from a fixed value, of those that have found a
    partner; and the one that waits for it.

    That value is the first block of all, so that a large mean costs no digits: the data are never all far from one of
    them.
    """

    n: int = 0
    s_xx: np.ndarray | None = None
    s_xw: np.ndarray | None = None
    s_ww: np.ndarray | None = None
    pending: tuple | None = None


def _spread(w, x):
    """Weights shaped to multiply tensors."""
    return w.reshape(w.shape + (1,) * (x.ndim - w.ndim))


@dataclass
class BlockAverage:
    """Streaming mean and standard error of an array-valued series, element by element.

    With weights the mean is the ratio of means <w x>/<w>, as befits a quotient like velocity (w = mass density) or
    temperature (w = number density): `add` takes x and w, and where w is 0 the value of x does not count. Its standard
    error is the linearised one, that of the series w (x − mean)/<w>.

    Parameters
    ----------
    block : frames of the shortest block: 1, or more where what is added are means of several frames already
    threads : that share the work on large arrays; results do not depend on them
    """

    levels: list[_Level] = field(default_factory=list)
    weighted: bool | None = None
    block: int = 1
    threads: int = 1
    # The first block of all: see `_Level`.
    first: tuple | None = None
    # Frames of a block that is not full yet, and the sums of their x (times w) and w.
    rest: tuple | None = None
    # Mean square deviation of the frames of a block from its mean: the sum over blocks, and how many frames were seen.
    spread_within: float = 0.0
    frames_within: int = 0

    def add(self, x, w=None, frames: int = 1, within: float | None = None) -> None:
        """The next frame, or the mean of the next few.

        Parameters
        ----------
        x : any shape, always the same; of several frames their mean, <w x>/<w> with weights
        w : weights whose shape is the beginning of x's; of several frames their mean
        frames : how many. They fill a block exactly sooner or later, or the series ends before.
        within : mean square deviation of these frames from their mean, w (x − mean)/<w> with weights, at some elements
            that stand for all
        """
        if self.weighted is None:
            self.weighted = w is not None
        x = np.ascontiguousarray(x, dtype=np.float64)
        w = None if w is None else np.ascontiguousarray(w, dtype=np.float64)
        if w is not None:
            x = x * _spread(w, x)
        if within is not None:
            self.spread_within += within * frames
            self.frames_within += frames
        if frames != self.block or self.rest is not None:
            count, sum_x, sum_w = (0, 0.0, 0.0) if self.rest is None else self.rest
            count, sum_x = count + frames, sum_x + frames * x
            sum_w = None if w is None else sum_w + frames * w
            if count > self.block:
                raise ValueError(f"{count} frames in a block of {self.block}")
            if count < self.block:
                self.rest = count, sum_x, sum_w
                return
            self.rest, x, w = None, sum_x / count, None if w is None else sum_w / count
        if self.first is None:
            self.first = x, w
        at = 0
        while True:
            if at == len(self.levels):
                self.levels.append(_Level())
            level = self.levels[at]
            level.n += 1
            if level.pending is None:
                level.pending = (x, w)
                return
            (x, w), level.pending = self._merged(level, *level.pending, x, w), None
            at += 1

    def _merged(self, level, a, wa, b, wb):
        """The mean of two blocks of a level, which learns of them."""
        if level.s_xx is None:
            level.s_xx = np.zeros_like(a)
            if wa is not None:
                level.s_xw, level.s_ww = np.zeros_like(a), np.zeros_like(wa)
        x0, w0 = self.first
        out, out_w = np.empty_like(a), None if wa is None else np.empty_like(wa)
        if wa is None:
            arguments, n = (_pair, a, b, x0, level.s_xx, out), a.size
        else:
            arguments, n = (
                (_weighted_pair, a, b, wa, wb, x0, w0, level.s_xx, level.s_xw, level.s_ww, out, out_w),
                wa.size,
            )
        f, *arrays = arguments
        arrays = [_flat(array) for array in arrays]
        many = min(self.threads, 1 + a.size // _PIECE)
        if many == 1:
            f(*arrays, 0, n)
        else:
            cuts = [n * k // many for k in range(many + 1)]
            with ThreadPoolExecutor(many) as pool:
                list(pool.map(lambda k: f(*arrays, cuts[k], cuts[k + 1]), range(many)))
        return out, out_w

    @property
    def n(self) -> int:
        """Number of frames."""
        return (self.block * self.levels[0].n if self.levels else 0) + (self.rest[0] if self.rest else 0)

    def mean(self) -> np.ndarray:
        """The mean; 0 where all weights were 0."""
        x, w = self._tree(0), self._tree(1) if self.weighted else None
        if w is None:
            return x
        w = _spread(w, x)
        return np.divide(x, w, out=np.zeros_like(x), where=w > 0)

    def _tree(self, which):
        """The mean from the blocks that wait for a partner, one for each binary digit of the number of frames: summed
        by pairs, so that rounding grows with the logarithm of that number only."""
        total = self._blocks_total(which, 0) if self.levels else None
        if self.rest is None:
            return total / self.levels[0].n
        rest = self.rest[1 + which]
        return (rest if total is None else self.block * total + rest) / self.n

    def _moments(self, k):
        """Sums of squares and products of the deviations of level k's blocks from their own mean: (xx, xw, ww), the
        last two None without weights."""
        level, (x0, w0) = self.levels[k], self.first
        x, w = self._blocks_mean(0, k) - x0, self._blocks_mean(1, k) - w0 if self.weighted else None
        p, q = (None, None) if level.pending is None else level.pending

        def central(s, a, b, u, v):
            out = -level.n * (a * b) if s is None else s - level.n * (a * b)
            return out if u is None else out + u * v

        u = None if p is None else p - x0
        if not self.weighted:
            return central(level.s_xx, x, x, u, u), None, None
        v = None if q is None else q - w0
        wide, wide_v = _spread(w, x), None if v is None else _spread(v, x)
        return central(level.s_xx, x, x, u, u), central(level.s_xw, x, wide, u, wide_v), central(level.s_ww, w, w, v, v)

    def _blocks_mean(self, which, k):
        """The mean of level k's blocks."""
        return self._blocks_total(which, k) / self.levels[k].n

    def _blocks_total(self, which, k):
        total = None
        for j, level in enumerate(self.levels[k:]):
            if level.pending is not None:
                part = level.pending[which] * float(2**j)
                total = part if total is None else total + part
        return total

    def errors_by_level(self) -> tuple[np.ndarray, np.ndarray]:
        """(levels, ...) apparent standard error of the mean for block lengths of 1, 2, 4, ... times `block`, and
        (levels,) the number of blocks."""
        mean = self.mean()
        out, blocks = [], []
        for k, level in enumerate(self.levels):
            if level.n < 2:
                break
            m2, m_xw, m_ww = self._moments(k)
            if self.weighted:
                w = _spread(self._tree(1), mean)
                m2 = m2 - 2 * mean * m_xw + mean**2 * _spread(m_ww, mean)
                m2 = np.divide(m2, w**2, out=np.full_like(mean, np.nan), where=w > 0)
            out.append(np.sqrt(np.maximum(m2, 0.0) / (level.n * (level.n - 1.0))))
            blocks.append(level.n)
        return np.array(out).reshape(len(out), *mean.shape), np.array(blocks, dtype=int)

    def result(self):
        """Mean, standard error, and where the blocks still correlate.

        Returns
        -------
        mean : array
        stderr : array. NaN when there are fewer than two frames. The largest up to the block length of the plateau;
            where none was seen, the largest of
            the usable block lengths: a lower bound.
        correlated : bool array. True where no plateau was seen, always when there are too few frames to tell.

        Notes
        -----
        The plateau is taken at the shortest block length B with B³ > 2 n (s_B/s_1)⁴, where the bias left by correlation
        and the scatter of few blocks are in balance (Lee, Conduit, Nemec, López Ríos, Drummond, Phys. Rev. E 83, 066706
        (2011)). Where the shortest block has several frames s_B/s_1 is the product of s_B/s_block, element by element,
        and of s_block/s_1 for all elements together, which follows from the spread of the frames within the blocks
        (`within` of `add`; as large as it can be, if that is unknown).
        """
        mean = self.mean()
        errors, blocks = self.errors_by_level()
        if not len(errors):
            return mean, np.full_like(mean, np.nan), np.ones(mean.shape, bool)
        usable = max(1, int(np.count_nonzero(blocks >= MIN_BLOCKS)))
        errors = errors[:usable]
        stderr = errors.max(axis=0)
        correlated = np.ones(mean.shape, bool)
        # The largest so far: few long blocks agree by chance now and then.
        largest = np.maximum.accumulate(errors, axis=0)
        growth = np.divide(largest, errors[0], out=np.ones_like(errors), where=errors[0] > 0)
        short = self._short_growth(errors[0], blocks[0]) ** 2
        # A standard error that falls again with longer blocks is chance, so that the largest up to the plateau counts;
        # of the lengths that any grouping of the frames leaves, for the same numbers with and without.
        begin = next(
            k for k in range(usable) if self.block * 2**k >= min(longest_block(self.n), self.block * 2 ** (usable - 1))
        )
        plateau = np.maximum.accumulate(errors[begin:], axis=0)
        for k in range(usable - 1, -1, -1):
            long_enough = (self.block * 2.0**k) ** 3 > 2.0 * self.n * short * growth[k] ** 4
            stderr = np.where(long_enough, plateau[k - begin] if k >= begin else errors[k], stderr)
            correlated &= ~long_enough
        return mean, stderr, correlated

    def _short_growth(self, errors, blocks) -> float:
        """(s_block/s_1)²: 1 where the frames of a block are independent, `block` where they are all the same."""
        if self.block == 1:
            return 1.0
        between = np.mean(errors[np.isfinite(errors)] ** 2) * blocks if np.isfinite(errors).any() else 0.0
        within = self.spread_within / self.frames_within if self.frames_within else 0.0
        return float(np.clip(self.block * between / (between + within), 1.0, self.block)) if between > 0 else 1.0

    # --- so that an interrupted average can go on
    def state(self) -> dict[str, np.ndarray]:
        """Everything as plain arrays; `from_state` gives back an object that continues bit for bit."""
        out = {"weighted": np.array(bool(self.weighted)), "block": np.array(self.block)}
        out["within"] = np.array([self.spread_within, self.frames_within])
        more = [(f"{k}.pending", level.pending) for k, level in enumerate(self.levels)]
        for name, pair in (("first", self.first), ("rest", self.rest and self.rest[1:]), *more):
            if pair is not None:
                out.update({f"{name}_{which}": a for which, a in zip("xw", pair) if a is not None})
        if self.rest is not None:
            out["rest_n"] = np.array(self.rest[0])
        for k, level in enumerate(self.levels):
            out[f"{k}.n"] = np.array(level.n)
            out.update({f"{k}.{name}": a for name in _SUMS if (a := getattr(level, name)) is not None})
        return out

    @classmethod
    def from_state(cls, state, threads: int = 1) -> BlockAverage:
        """The inverse of `state`."""

        def pair(name):
            return tuple(np.array(state[key]) if (key := f"{name}_{which}") in state else None for which in "xw")

        spread, frames = state["within"]
        self = cls(
            weighted=bool(state["weighted"]),
            block=int(state["block"]),
            threads=threads,
            spread_within=float(spread),
            frames_within=int(frames),
        )
        self.first = pair("first") if "first_x" in state else None
        self.rest = (int(state["rest_n"]), *pair("rest")) if "rest_n" in state else None
        k = 0
        while f"{k}.n" in state:
            sums = {name: np.array(state[f"{k}.{name}"]) for name in _SUMS if f"{k}.{name}" in state}
            self.levels.append(
                _Level(
                    int(state[f"{k}.n"]), **sums, pending=pair(f"{k}.pending") if f"{k}.pending_x" in state else None
                )
            )
            k += 1
        return self


_SUMS = ("s_xx", "s_xw", "s_ww")


def _flat(a):
    """One-dimensional, and writable for numba's sake: it compiles anew for arrays that are not."""
    a = a.reshape(-1)
    return a if a.flags.writeable else a.copy()
