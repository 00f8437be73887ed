"""The mesh that one thread of the spectral deposit spreads its sources on."""

from __future__ import annotations

import numpy as np

from . import spread


class Mesh:
    """What one thread has spread: nodes [low, low + shape) × components, `scale` times the sources; `total` what has
    been moved on.

    Rows along z are stored with some nodes to spare, see `spread.row_length`."""

    def __init__(self, low, shape, lanes, real):
        self.low, self.lanes, self.real = low, lanes, real
        self.shape = tuple(int(n) for n in shape)
        self.row = spread.row_length(self.shape[2], lanes * np.dtype(real).itemsize)
        self.stored = (*self.shape[:2], self.row)
        self.flat = spread.aligned(int(np.prod(self.stored)) * lanes, real)
        self.total, self.scale, self.largest, self.points = None, 0.0, 0.0, 0
        self.rows = np.zeros(self.shape[:2], np.uint8)

    def planes(self):
        """[(array [x][y][z][component], scale)]"""
        parts = [(self.flat, self.scale)] if self.scale else []
        if self.total is not None:
            parts.append((self.total, 1.0))
        return [(a.reshape(*self.stored, self.lanes)[:, :, : self.shape[2]], s) for a, s in parts]

    def flush(self, width):
        if self.total is None:
            self.total = spread.aligned(len(self.flat), np.float64)
        self.largest = max(self.largest, self.scale)
        mesh, total = (a.reshape(*self.shape[:2], -1) for a in (self.flat, self.total))
        spread.flush(mesh, self.rows, width, total, self.scale)
        self.points = 0

    def grown(self, low, shape):
        """The same on more nodes."""
        new = Mesh(low, shape, self.lanes, self.real)
        new.scale, new.largest, new.points = self.scale, self.largest, self.points
        at = tuple(slice(int(a), int(a) + n) for a, n in zip(self.low - low, self.shape))
        end = self.shape[2]
        new.flat.reshape(*new.stored, -1)[at] = self.flat.reshape(*self.stored, -1)[:, :, :end]
        new.rows[at[:2]] = self.rows
        if self.total is not None:
            new.total = spread.aligned(len(new.flat), np.float64)
            new.total.reshape(*new.stored, -1)[at] = self.total.reshape(*self.stored, -1)[:, :, :end]
        return new
