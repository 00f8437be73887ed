"""Grids that move with the centre of mass of the atoms, or of those selected: droplets that drift, films that creep.

The centre of a periodic axis is that of a circle: the phase of Σ m exp(2πi s). Where atoms fill an axis it is not
defined, and the grid does not move along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError

#: |Σ m exp(2πi s)|/Σ m below which atoms fill an axis.
_FILLED = 0.1


@dataclass(frozen=True)
class Follow:
    """Where the centre was in the first frame (fractional), and along which axes of the cell it is followed."""

    first_s: np.ndarray
    axes: np.ndarray

    @classmethod
    def of(cls, frame, chosen_n=None) -> Follow:
        """AtcError where the centre is defined along no axis."""
        s, told = centre(frame, chosen_n)
        told &= np.arange(3) < frame.dimension
        if not told.any():
            raise AtcError(
                f'{frame.source}: follow = "mass": the atoms fill the cell along every axis, which leaves their centre '
                "undefined: select those to follow"
            )
        return cls(s, told)

    def shift(self, frame, chosen_n=None) -> np.ndarray:
        """(3,) how far the centre has moved since the first frame, by way of the nearest image (internal)."""
        s, told = centre(frame, chosen_n)
        lost = self.axes & ~told
        if lost.any():
            axis = "xyz"[int(np.flatnonzero(lost)[0])]
            raise AtcError(
                f'{frame.source}: follow = "mass": the atoms fill the cell along {axis} here, but not in the first '
                "frame: their centre is not defined any more: select those to follow"
            )
        d = s - self.first_s
        d = np.where(frame.cell.periodic, d - np.rint(d), d)
        return np.where(self.axes, d, 0.0) @ frame.cell.vectors


def centre(frame, chosen_n=None) -> tuple[np.ndarray, np.ndarray]:
    """(3,) fractional coordinates of the centre of mass (of the atoms alike, if there are no masses), and along which
    axes it is defined."""
    some = slice(None) if chosen_n is None else chosen_n
    s_nc = frame.cell.fractional(frame.positions)[some]
    m = (np.ones(len(frame)) if frame.masses is None else frame.masses)[some]
    total = m.sum()
    if not total > 0:
        return np.zeros(3), np.zeros(3, bool)
    z = m @ np.exp(2j * np.pi * s_nc) / total
    periodic = frame.cell.periodic
    s = np.where(periodic, np.angle(z) / (2 * np.pi), m @ s_nc / total)
    # so many atoms that are anywhere leave 1/√n of it
    least = max(_FILLED, 3.0 / np.sqrt(len(m)) if len(m) > 100 else _FILLED)
    return s, ~periodic | (np.abs(z) > least)
