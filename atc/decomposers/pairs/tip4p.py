"""Four-point water (TIP4P): the charge of the oxygen sits on a virtual site, as with LAMMPS's ``…/tip4p/…`` styles."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from types import SimpleNamespace

import numpy as np

from ...errors import AtcError
from ...frame import Frame
from ...neighbors.verlet import using
from ..constraints.virtual_sites import FrameWithSites, Places
from ..numbering import atoms_of_ids
from ..registry import StyleInput, pair_style
from .coulomb import CoulombCut, wanted_pairs
from .coulomb_long import lj_long, long_style
from .input import named
from .lennard_jones import LennardJones, mix_lj
from .pairs import Pairs
from .radial import CUTOFF, both_cutoffs, short_values


@dataclass
class TIP4P:
    """The charge of the oxygen of four-point water sits on the line that halves the angle, at a distance from the
    oxygen that is `distance` where bonds and angle are at rest: x_M = x_O + (a/2)(x_H1 + x_H2 − 2 x_O).

    oxygen, hydrogen : types. a : distance / (bond length · cos(angle/2)). where : the line that says so

    As in LAMMPS the hydrogens of a molecule are the atoms whose ids follow that of its oxygen.
    """

    oxygen: int
    hydrogen: int
    a: float
    where: str = field(default="pair_style tip4p", compare=False)

    def describe(self) -> str:
        return f"the charge of every oxygen (type {self.oxygen}) at O + {0.5 * self.a:.6g} (OH1 + OH2)"

    def places(self, frame: Frame) -> Places:
        O = np.flatnonzero(frame.types == self.oxygen)
        found, good = atoms_of_ids(frame, frame.ids[O][:, None] + [1, 2])
        good &= frame.types[found] == self.hydrogen
        if not good.all():
            bad = frame.ids[O[np.argmin(good.all(1))]]
            raise AtcError(
                f"{frame.source}: atom {bad} is the oxygen of a four-point water (type {self.oxygen}, {self.where}), "
                f"but atoms {bad + 1} and {bad + 2} are not its hydrogens (type {self.hydrogen}): their ids must "
                "follow that of their oxygen, as in LAMMPS"
            )
        parents = np.concatenate([O[:, None], found], axis=1)
        w = np.tile([1.0 - self.a, 0.5 * self.a, 0.5 * self.a], (len(O), 1))
        return Places(parents, w, O, charged_by=True)


class SitePairs(Pairs):
    """Pair styles between charges of which some sit on virtual sites. A site's bonded neighbours are those of its
    host."""

    on_sites = True
    _last = None

    def prepare(self, frame):
        if isinstance(frame, FrameWithSites) and frame.places.inside_s is None:
            frame = self._weighted(frame)
        with using(None):  # lists that are kept are those of the atoms
            return super().prepare(frame)

    def __getstate__(self):
        return {**self.__dict__, "_last": None}

    def _weighted(self, frame: FrameWithSites) -> Frame:
        top, special = frame.topology, self.special
        if top is None or special is None or special.trivial:
            return frame
        if top.untold:
            raise AtcError(top.untold)
        known = top if top.weighted is None else top.weighted
        if not len(known.bonds):
            return frame
        host = frame.places.host_s
        if self._last is None or self._last[0] is not known or not np.array_equal(self._last[1], host):
            lists = _with_sites(*special.lists(known, frame.n_atoms)[:3], host, frame.n_atoms)
            self._last = known, host, lists
        start, other, apart, hints = self._last[2]
        new = copy(top)
        new.special = SimpleNamespace(cell=frame.cell, start=start, other=other, apart=apart, hints=hints)
        return frame.replace(topology=new)


def _with_sites(start, other, apart, host_s, n):
    """Lists of special neighbours (CSR) in which a site's are its host's, and the site is one of theirs."""
    from .special_bonds import special_hints

    site = np.full(n, -1, np.int64)
    site[host_s] = n + np.arange(len(host_s))
    i, j = np.repeat(np.arange(n), np.diff(start)), np.asarray(other, np.int64)
    parts = [(i, j, apart)]
    for a, b in ((site[i], j), (i, site[j]), (site[i], site[j])):
        some = (a >= 0) & (b >= 0)
        parts.append((a[some], b[some], apart[some]))
    i, j, apart = (np.concatenate(column) for column in zip(*parts))
    order = np.lexsort((j, i))
    total = n + len(host_s)
    start = np.concatenate([[0], np.cumsum(np.bincount(i, minlength=total))])
    other, apart = np.ascontiguousarray(j[order], np.int32), np.ascontiguousarray(apart[order], np.int8)
    return start, other, apart, special_hints(start, other)


# LAMMPS's lines
# ----------------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class TIP4PLine:
    """What a pair_style line says of its water: types of atoms, bonds and angles, as words, and the distance
    (internal)."""

    oxygen: str
    hydrogen: str
    bond: str
    angle: str
    distance: float
    where: str


def _water(inp: StyleInput, words):
    """(TIP4PLine, what is left of the words)"""
    if len(words) < 6:
        raise inp.wrong(f"{inp.command} takes otype htype btype atype qdist and one or two cutoffs")
    distance = inp.number(words[4], "length", "qdist")
    if not distance >= 0:
        raise inp.error(f"{inp.command}: qdist must not be negative, got {words[4]}")
    return TIP4PLine(*words[:4], distance, inp.where), words[5:]


def _coulomb(inp: StyleInput, line, rc: float, long: bool):
    style = long_style(inp, rc) if long else CoulombCut.of(inp, np.where(wanted_pairs(inp), rc, 0.0))
    style.water = line
    return style


def _with_water(long: bool):
    """Of the styles with Lennard-Jones, and with charges alone."""
    ending = "long" if long else "cut"

    @pair_style(f"lj/cut/tip4p/{ending}")
    def _lj(inp: StyleInput):
        line, cutoffs = _water(inp, inp.args)
        rc, rcoul = both_cutoffs(inp, cutoffs)
        lj = LennardJones.of(inp, *short_values(inp, LennardJones.numbers, rc, mix_lj))
        return [lj, _coulomb(inp, line, rcoul, long)]

    @pair_style(f"tip4p/{ending}")
    def _alone(inp: StyleInput):
        line, cutoffs = _water(inp, inp.args)
        (rc,) = inp.numbers(cutoffs, [CUTOFF])
        named(inp)
        return _coulomb(inp, line, rc, long)


_with_water(True)
_with_water(False)


@pair_style("lj/long/tip4p/long")
def _lj_long(inp: StyleInput):
    line, cutoffs = _water(inp, inp.args[2:])
    return lj_long(inp, (*inp.args[:2], *cutoffs), lambda rc: _coulomb(inp, line, rc, True))


#: Which number of a coefficient line is the length of a bond, or the angle, at rest.
_REST = {
    "bond": {"harmonic": 1, "zero": 0, "morse": 2, "class2": 0, "gromos": 1},
    "angle": {"harmonic": 1, "zero": 0, "charmm": 1, "cosine/squared": 1, "cosine/delta": 1, "class2": 0},
}


def rest(kind: str, style: str, words, where: str) -> float:
    """Length (user's unit) or angle (degrees) at rest of a coefficient line."""
    k = _REST[kind].get(style)
    try:
        return float(words[k])
    except (TypeError, IndexError, ValueError):
        raise AtcError(
            f"{where}: the {'length' if kind == 'bond' else 'angle'} at rest, which places the charge of TIP4P water, "
            f"is not known of {kind}_style {style} with the coefficients {' '.join(words) or '(none)'}: expected one "
            f"of {', '.join(_REST[kind])}"
        ) from None
