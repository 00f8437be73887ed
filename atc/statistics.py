"""Time averages with a standard error that knows about correlation in time (block averaging, streaming).

Successive frames are correlated, so σ/√n is too small. Flyvbjerg & Petersen (J. Chem. Phys. 91, 461 (1989)) average pairs of
neighbours again and again: the apparent standard error of the mean rises with the block length until the blocks are independent,
and then stays on a plateau. Only one running mean and variance per block length is kept: about log2(frames) arrays.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

# A block length counts as evidence only if at least this many blocks of it were seen: the standard error from n blocks is itself
# uncertain by 1/√(2(n−1)), 41 % at 4.
MIN_BLOCKS = 4


@dataclass
class _Level:
    """Running moments of the block means at one block length (Welford, so a large mean costs no digits)."""

    n: int = 0
    mean_x: np.ndarray | None = None
    m_xx: np.ndarray | None = None
    mean_w: np.ndarray | None = None
    m_xw: np.ndarray | None = None
    m_ww: np.ndarray | None = None
    pending: tuple | None = None

    def add(self, x, w):
        self.n += 1
        if self.n == 1:
            self.mean_x, self.m_xx = x.copy(), np.zeros_like(x)
            if w is not None:
                self.mean_w, self.m_xw, self.m_ww = w.copy(), np.zeros_like(x), np.zeros_like(w)
            return
        dx = x - self.mean_x
        self.mean_x += dx / self.n
        self.m_xx += dx * (x - self.mean_x)
        if w is not None:
            dw = w - self.mean_w
            self.mean_w += dw / self.n
            after = w - self.mean_w
            self.m_xw += dx * _spread(after, x)
            self.m_ww += dw * after


def _spread(w, x):
    """Weights shaped to multiply tensors."""
    return w.reshape(w.shape + (1,) * (x.ndim - w.ndim))


@dataclass
class BlockAverage:
    """Streaming mean and standard error of an array-valued series, element by element.

    With weights the mean is the ratio of means <w x>/<w>, as befits a quotient like velocity (w = mass density) or temperature
    (w = number density): `add` takes x and w, and where w is 0 the value of x does not count. Its standard error is the linearised
    one, that of the series w (x − mean)/<w>.
    """

    levels: list[_Level] = field(default_factory=list)
    weighted: bool | None = None

    def add(self, x, w=None) -> None:
        """One more frame: x (any shape), and weights w whose shape is the beginning of x's."""
        if self.weighted is None:
            self.weighted = w is not None
        x = np.asarray(x, dtype=np.float64)
        w = None if w is None else np.asarray(w, dtype=np.float64)
        if w is not None:
            x = x * _spread(w, x)
        at = 0
        while True:
            if at == len(self.levels):
                self.levels.append(_Level())
            level = self.levels[at]
            level.add(x, w)
            if level.pending is None:
                level.pending = (x, w)
                return
            px, pw = level.pending
            level.pending = None
            x = 0.5 * (px + x)
            w = None if w is None else 0.5 * (pw + w)
            at += 1

    @property
    def n(self) -> int:
        return self.levels[0].n if self.levels else 0

    def mean(self) -> np.ndarray:
        """The mean; 0 where all weights were 0."""
        x, w = self._tree(0), self._tree(1) if self.weighted else None
        if w is None:
            return x
        w = _spread(w, x)
        return np.divide(x, w, out=np.zeros_like(x), where=w > 0)

    def _tree(self, which):
        """The mean from the blocks that wait for a partner, one for each binary digit of the number of frames: summed by pairs, so that rounding grows with
        the logarithm of that number only."""
        total = None
        for k, level in enumerate(self.levels):
            if level.pending is not None:
                part = level.pending[which] * float(2**k)
                total = part if total is None else total + part
        return total / self.n

    def errors_by_level(self) -> tuple[np.ndarray, np.ndarray]:
        """(levels, ...) apparent standard error of the mean for block lengths 1, 2, 4, ..., and (levels,) the number of blocks."""
        mean = self.mean()
        first = self.levels[0]
        out, blocks = [], []
        for level in self.levels:
            if level.n < 2:
                break
            m2 = level.m_xx
            if self.weighted:
                w = _spread(first.mean_w, mean)
                m2 = level.m_xx - 2 * mean * level.m_xw + mean**2 * _spread(level.m_ww, mean)
                m2 = np.divide(m2, w**2, out=np.full_like(mean, np.nan), where=w > 0)
            out.append(np.sqrt(np.maximum(m2, 0.0) / (level.n * (level.n - 1.0))))
            blocks.append(level.n)
        return np.array(out).reshape(len(out), *mean.shape), np.array(blocks, dtype=int)

    def result(self):
        """Mean, standard error, and where the blocks still correlate.

        Returns
        -------
        mean : array
        stderr : array. NaN when there are fewer than two frames. Where no plateau was seen, the largest of the usable block
            lengths: a lower bound.
        correlated : bool array. True where no plateau was seen, always when there are too few frames to tell.

        Notes
        -----
        The plateau is taken at the shortest block length B with B³ > 2 n (s_B/s_1)⁴, where the bias left by correlation and the
        scatter of few blocks are in balance (Lee, Conduit, Nemec, López Ríos, Drummond, Phys. Rev. E 83, 066706 (2011)).
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
        for k in range(usable - 1, -1, -1):
            long_enough = 8.0**k > 2.0 * self.n * growth[k] ** 4
            stderr = np.where(long_enough, errors[k], stderr)
            correlated &= ~long_enough
        return mean, stderr, correlated

    # --- so that an interrupted average can go on
    def state(self) -> dict[str, np.ndarray]:
        """Everything as plain arrays; `from_state` gives back an object that continues bit for bit."""
        out = {"weighted": np.array(bool(self.weighted))}
        for k, level in enumerate(self.levels):
            out[f"{k}.n"] = np.array(level.n)
            for name in ("mean_x", "m_xx", "mean_w", "m_xw", "m_ww"):
                if getattr(level, name) is not None:
                    out[f"{k}.{name}"] = getattr(level, name)
            if level.pending is not None:
                out[f"{k}.pending_x"] = level.pending[0]
                if level.pending[1] is not None:
                    out[f"{k}.pending_w"] = level.pending[1]
        return out

    @classmethod
    def from_state(cls, state) -> BlockAverage:
        """The inverse of `state`."""
        self = cls(weighted=bool(state["weighted"]))
        k = 0
        while f"{k}.n" in state:
            level = _Level(n=int(state[f"{k}.n"]))
            for name in ("mean_x", "m_xx", "mean_w", "m_xw", "m_ww"):
                if f"{k}.{name}" in state:
                    setattr(level, name, np.array(state[f"{k}.{name}"]))
            if f"{k}.pending_x" in state:
                level.pending = (
                    np.array(state[f"{k}.pending_x"]),
                    np.array(state[f"{k}.pending_w"]) if f"{k}.pending_w" in state else None,
                )
            self.levels.append(level)
            k += 1
        return self
