"""Entries of Tersoff parameter files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .entries import Entry


@dataclass(frozen=True)
class TersoffEntry(Entry):
    """One entry ``elem1 elem2 elem3``, elem1 at the centre, elem2 the bonded atom, elem3 the one that weakens the bond:
    see `Tersoff`."""

    m: float
    gamma: float
    lam3: float
    c: float
    d: float
    costheta0: float
    n: float
    beta: float
    lam2: float
    B: float
    R: float
    D: float
    lam1: float
    A: float
    where: str = "the Tersoff parameters"

    what: ClassVar[str] = "Tersoff"
    signed: ClassVar[tuple] = ("costheta0", "lam3")
    energies: ClassVar[tuple] = ("A", "B")

    def check(self) -> str | None:
        if wrong := super().check():
            return wrong
        if self.m not in (1.0, 3.0):
            return f"m must be 1 or 3, got {self.m:g}"
        if self.D > self.R:
            return f"D must not exceed R, got R {self.R:g} and D {self.D:g}"
        if self.d == 0 and self.c != 0:
            return "d must not be 0, the angular function divides by it"
        return None
