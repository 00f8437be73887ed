"""A pair style times a factor: LAMMPS's ``hybrid/scaled``."""

from __future__ import annotations

import numpy as np

from .pairs import PairStyle


class Scaled(PairStyle):
    """`style` with energies and forces times `factor`."""

    def __init__(self, style: PairStyle, factor: float):
        self.style, self.factor = style, factor
        self.name = f"{factor:g} {style.name}"
        self.table, self.units = style.table, style.units
        self.needs_charges, self.weight, self.keeps_excluded = style.needs_charges, style.weight, style.keeps_excluded

    def prepare(self, frame):
        return self.style.prepare(frame)

    def self_energy(self, frame):
        e = self.style.self_energy(frame)
        return None if e is None else self.factor * e

    def add(self, types, i, j, d2, weights, U, G, prepared):
        u, g = np.zeros_like(U), np.zeros_like(G)
        self.style.add(types, i, j, d2, weights, u, g, prepared)
        U += self.factor * u
        G += self.factor * g

    def trouble(self, ti, tj, d):
        return self.style.trouble(ti, tj, d)
