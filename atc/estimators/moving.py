"""Grids that move with the centre of mass of the atoms, or of those selected: droplets that drift, films that creep;
and with an interface, found by the density.

The centre of a periodic axis is that of a circle: the phase of Σ m exp(2πi s). Where atoms fill an axis it is not
defined, and the grid does not move along it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError

#: |Σ m exp(2πi s)|/Σ m below which atoms fill an axis.
_FILLED = 0.1


#: Bins of so many mean distances between atoms (and as many on either side) show no layers of a crystal.
_BIN = 2.0
#: How many standard errors the densities of two phases must be apart, and what is added to it over the number of bins:
#: the best cuts of 1500 uniform profiles got to 8.5 with 12 bins, 7.1 with 20, 6.2 with 160.
_APART, _MORE_APART = 6.5, 30.0


@dataclass(frozen=True)
class Follow:
    """Where what is followed was in the first frame (fractional), and along which axes of the cell.

    how : "mass", the centre of mass; "+z", "-x", ...: the interface on this side of the denser phase
    """

    first_s: np.ndarray
    axes: np.ndarray
    how: str = "mass"

    @classmethod
    def of(cls, frame, chosen_n=None, how: str = "mass") -> Follow:
        """AtcError where it is defined along no axis."""
        if how != "mass":
            axis = "xyz".index(how[1])
            if axis >= frame.dimension:
                raise AtcError(f"{frame.source}: follow = {how!r}: the run has {frame.dimension} dimensions")
            s = np.zeros(3)
            s[axis] = interface(frame, axis, how[0] == "+", chosen_n)
            return cls(s, np.arange(3) == axis, how)
        s, told = centre(frame, chosen_n)
        told &= np.arange(3) < frame.dimension
        if not told.any():
            raise AtcError(
                f'{frame.source}: follow = "mass": the atoms fill the cell along every axis, which leaves their centre '
                "undefined: select those to follow"
            )
        return cls(s, told)

    def shift(self, frame, chosen_n=None) -> np.ndarray:
        """(3,) how far it has moved since the first frame, by way of the nearest image (internal)."""
        if self.how != "mass":
            (axis,) = np.flatnonzero(self.axes)
            s, told = np.zeros(3), self.axes
            s[axis] = interface(frame, axis, self.how[0] == "+", chosen_n)
        else:
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


def interface(frame, axis: int, upper: bool, chosen_n=None) -> float:
    """Fractional coordinate, along an axis of the cell, of Gibbs' dividing surface on one side of the denser phase.

    The two phases are those of the profile of two levels with two steps that comes closest to the profile of the mass
    (of the number, if there are no masses). Their densities are those of the middle halves of both; the dividing
    surface is where a step between these has the mass that there is between the middles.

    Parameters
    ----------
    upper : the surface that one meets going up from the dense phase, else that going down

    Raises
    ------
    AtcError where the densities of two phases are not seen to differ, and where the dense phase ends at an open face.
    """
    word = f"{'+' if upper else '-'}{'xyz'[axis]}"
    told = f"{frame.source}: follow = {word!r}"
    cell, some = frame.cell, slice(None) if chosen_n is None else chosen_n
    s_n = cell.fractional(cell.wrap(frame.positions)[0])[some, axis]
    m_n = (np.ones(len(frame)) if frame.masses is None else frame.masses)[some]
    flat = frame.dimension == 2
    volume = cell.volume / (np.linalg.norm(cell.vectors[2]) if flat else 1.0)
    distance = (volume / max(len(s_n), 1)) ** (0.5 if flat else 1 / 3)
    bins = int(cell.heights[axis] / (_BIN * distance))
    if bins < 12:
        long = f"{cell.heights[axis] / distance:.0f} distances between atoms long there"
        raise AtcError(f"{told}: the cell is {long}, too few to tell two phases")
    first, count, apart = _two_levels(_profile(s_n, m_n, bins, cell.periodic[axis]))
    found = None
    if apart > _APART + _MORE_APART / bins:
        found = _dividing(s_n, m_n, first / bins, (first + count) / bins, _BIN * distance / cell.heights[axis])
    if found is None:
        raise AtcError(
            f'{told}: no two densities are seen along {word[1]}: select the atoms of one phase, or follow "mass"'
        )
    edge = found[upper]
    if not cell.periodic[axis] and min(edge % 1.0, -edge % 1.0) < 1.5 / bins:
        raise AtcError(f"{told}: the dense phase reaches to the open face of the cell: there is no interface")
    return float(edge % 1.0)


def _dividing(s_n, m_n, low: float, high: float, soft: float) -> tuple[float, float] | None:
    """The dividing surfaces below and above the dense phase, from where about they are, both found again until they
    stay; None where they do not. soft : the ends of intervals are so soft that layers of atoms do not show."""

    def mass(lo, hi):
        middle = 0.5 * (lo + hi)
        x_n = (s_n - middle + 0.5) % 1.0 - 0.5 + middle
        return m_n @ (_step((x_n - lo) / soft) - _step((x_n - hi) / soft))

    for _ in range(200):
        thick = high - low
        if not 2 * soft < thick < 1.0 - 2 * soft:
            return None
        rho_d = mass(low + 0.25 * thick, high - 0.25 * thick) / (0.5 * thick)
        rho_t = mass(high + 0.25 * (1 - thick), low + 1 - 0.25 * (1 - thick)) / (0.5 * (1 - thick))
        if not rho_d > rho_t:
            return None
        dense, below, above = low + 0.5 * thick, low - 0.5 * (1 - thick), high + 0.5 * (1 - thick)
        new_low = (rho_d * dense - rho_t * below - mass(below, dense)) / (rho_d - rho_t)
        new_high = (rho_d * dense - rho_t * above + mass(dense, above)) / (rho_d - rho_t)
        change = max(abs(new_low - low), abs(new_high - high))
        low, high = 0.5 * (low + new_low), 0.5 * (high + new_high)
        if change < 1e-13:
            return low, high
    return (low, high) if change < 1e-6 else None


def _step(u_n):
    """The integral of a hat from -1 to 1: 0 below, 1 above."""
    u = np.clip(u_n, -1.0, 1.0)
    return np.where(u < 0, 0.5 * (1 + u) ** 2, 1 - 0.5 * (1 - u) ** 2)


def _profile(s_n, m_n, bins: int, periodic: bool) -> np.ndarray:
    """(bins,) density, each atom shared linearly to the two bins whose centres are nearest."""
    x = s_n * bins - 0.5
    low = np.floor(x).astype(np.int64)
    part = x - low
    where = (lambda k: k % bins) if periodic else (lambda k: np.clip(k, 0, bins - 1))
    out = np.bincount(where(low), m_n * (1 - part), bins) + np.bincount(where(low + 1), m_n * part, bins)
    return out / m_n.sum() * bins


def _two_levels(rho_b) -> tuple[int, int, float]:
    """First bin and number of bins of the dense run, around the end if need be, of the two levels that leave the least
    squares; and how many standard errors the levels are apart, the bins at both steps left out."""
    n = len(rho_b)
    total = np.concatenate([[0.0], np.cumsum(np.tile(rho_b, 2))])
    best = (0.0, 0, 4)
    for count in range(4, n - 3):
        sums = total[count : count + n] - total[:n]
        gain = (sums - count * rho_b.mean()) * np.sqrt(n / (count * (n - count)))  # of levels higher inside
        k = int(np.argmax(gain))
        best = max(best, (float(gain[k]), k, count))
    _, first, count = best
    turned = np.roll(rho_b, -first)
    dense, thin = turned[1 : count - 1], turned[count + 1 : n - 1]
    left = (len(dense) * dense.var() + len(thin) * thin.var()) / (n - 6)
    error = np.sqrt(left * (1 / len(dense) + 1 / len(thin)))
    apart = dense.mean() - thin.mean()
    return first, count, apart / error if error > 0 else np.inf * apart


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
