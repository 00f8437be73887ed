"""Entries of Stillinger-Weber parameter files."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from .entries import Entry


@dataclass(frozen=True)
class SWEntry(Entry):
    """One line of a parameter file, ``elem1 elem2 elem3`` with elem1 at the centre: see `StillingerWeber` for the
    meaning of the numbers."""

    epsilon: float
    sigma: float
    a: float
    lam: float
    gamma: float
    costheta0: float
    A: float
    B: float
    p: float
    q: float
    tol: float = 0.0
    where: str = "the Stillinger-Weber parameters"

    what: ClassVar[str] = "Stillinger-Weber"
    signed: ClassVar[tuple] = ("costheta0",)
    energies: ClassVar[tuple] = ("epsilon",)
