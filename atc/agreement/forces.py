"""Do the forces in the trajectory follow from the potential? The alarm for everything that a script, a hand or a force
field got wrong.

The difference D = F_run − F_model of every atom is set against what the digits of the file explain: F_run was rounded,
and so were the positions x, which moves F_model by H δx. That is not estimated but computed, by moving the atoms at
random within half a step of their last digit. What a difference that remains looks like is found in
`atc.agreement.diagnosis`.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from ..errors import AtcError

#: What to do with the forces of a trajectory: `[trajectory] forces`.
MODES = ("warn", "must agree", "ignore")
#: Rms of the differences over what the digits explain, above which they do not explain it.
BEYOND = 3.0
#: A single atom counts as different when its difference is so many times what moved atoms make of its force (the rms of
#: up to `MOVES` tries).
SINGLE = 12.0
MOVES = 3
#: Two correct programs: relative to the rms of the forces, and to the mean sum of the sizes of the bond forces of an
#: atom (which may cancel).
ROUNDING, CANCELLATION = 1e-8, 1e-12
#: With so many frames one from the middle is looked at, too.
SEVERAL = 6
_WORST = 5


@dataclass
class ForceCheck:
    """Forces of one frame beside those of the potential.

    Attributes
    ----------
    frame : which one. agrees : whether the digits of the file explain the difference
    share : rms of the differences over the rms of the run's forces. explained : the part of it that the digits may
        hide, likewise
    rms : of the run's forces, internal. differ : number of atoms whose forces differ beyond the digits; worst : ids of
        those that differ most
    atoms : how many there are. looks : what the difference looks like, in words. outside : forces from outside that the
        script names
    energy, virial_cc : of the potential on this frame (internal), since they are known then
    largest, largest_force, rms_difference : the largest difference of an atom, the largest force of the run, rms of the
        differences (internal)
    coulomb : `CoulombDoubt` of the run's own Coulomb sum, or None; needs_coulomb : whether the forces would not agree
        without it
    """

    frame: int
    agrees: bool
    share: float
    explained: float
    rms: float
    differ: int
    atoms: int
    worst: tuple[int, ...] = ()
    looks: str = ""
    outside: tuple[str, ...] = ()
    energy: float = float("nan")
    virial_cc: np.ndarray | None = None
    largest: float = 0.0
    largest_force: float = 0.0
    rms_difference: float = 0.0
    coulomb: object = None
    needs_coulomb: bool = False

    @property
    def because(self) -> str:
        """What explains a difference where model and run agree."""
        return "the file's digits" + " and the accuracy of the run's Coulomb sum" * self.needs_coulomb

    def __str__(self):
        if self.agrees:
            why = f"explained by {self.because}" if self.share > ROUNDING else "the same within rounding"
            return f"forces of frame {self.frame}: yes, rms difference {self.share:.1e} of rms force, {why}"
        many = f"{self.differ} of {self.atoms} atoms" if self.differ else f"{self.atoms} atoms"
        worst = f" (most: {', '.join(map(str, self.worst))})" if self.worst else ""
        text = (
            f"no: forces of frame {self.frame} differ from the potential's by {_percent(self.share)} (rms), on "
            f"{many}{worst}"
        )
        if self.explained > 0.01 * self.share:
            text += f", the digits of the file explain {_percent(self.explained)}"
        if self.looks:
            text += f"; it looks like {self.looks}"
        if self.outside:
            named = ", ".join(self.outside)
            text += f"; forces from outside are named in the script and are not in the potential: {named}"
        return text


def _percent(share: float) -> str:
    if share == np.inf:
        return "forces where the run has none"
    return f"{100 * share:.3g} % of the run's" if share > 1e-3 else f"{share:.1e} of the run's"


def follows_from(pot) -> bool:
    """Whether this is a potential whose forces can be set beside a run's (bodies of peridynamics are not)."""
    from ..decomposers.potentials import Potential

    return isinstance(pot, Potential)


def compare_forces(
    frame, pot, number: int = 0, *, resolution: float | None = None, threads: int = 1, diagnose: bool = True
) -> ForceCheck:
    """The forces of a frame beside those of the potential, and whether the digits of the file explain the difference.

    Parameters
    ----------
    frame : Frame with forces
    pot : Potential
    number : what to call the frame
    resolution : step of the last digit of its positions (internal length); None: looked for in the numbers
    threads : threads
    diagnose : whether to say what a difference looks like (which takes a few more evaluations where charges may be the
        cause)
    """
    from ..readers.resolution import decimal_resolution
    from .real_space import coulomb_doubt

    frame.require("forces", why="a comparison with the run's forces")
    n = len(frame)
    told = pot.acting is not None and pot.acting.told(pot.complete(frame))
    outside = () if told else tuple(pot.outside)
    sizes = [0.0] * threads
    whole, pot = pot, pot.as_in_file(frame)

    def consume(bonds, thread):
        sizes[thread] += float((np.abs(bonds.G_b) * np.sqrt((bonds.r_bc**2).sum(1))).sum())

    def with_outside(decomposition, at):
        """The forces that the laws of the script add are those of the run, too."""
        if told and pot.acting.laws:
            decomposition.forces_nc = decomposition.forces_nc + pot.acting.of(pot.complete(at), decomposition.forces_nc)
        return decomposition

    mine = with_outside(pot.stream(frame, consume, threads=threads, forces=True), frame)
    # The virial is that of the potential with all its constraints, found as its fields will find them.
    virial = mine.virial_cc if pot is whole else whole.stream(frame, None, threads=threads).virial_cc
    known = {"energy": mine.energy, "virial_cc": virial}
    if not n:
        return ForceCheck(number, True, 0.0, 0.0, 0.0, 0, 0, **known)
    F, D = frame.forces, frame.forces - mine.forces_nc
    rms_F, d = _rms(F), np.linalg.norm(D, axis=1)
    floor = ROUNDING * rms_F + CANCELLATION * 2.0 * sum(sizes) / n
    coulomb = coulomb_doubt(frame, pot, threads)
    # The run's own Coulomb sum, as well as it was asked to do, and can.
    printed = np.sqrt(printed_error(F, frame.units.factor("force")) ** 2 + floor**2)
    rounding = printed if coulomb is None else np.hypot(printed, coulomb.force_n)
    moved2, tries, within = np.zeros(n), 0, bool((d <= rounding).all())
    allowed, odd = rounding, np.zeros(n, bool)
    if not within:
        dx = decimal_resolution(frame.positions)[0] if resolution is None else resolution
        rng = np.random.default_rng(11)

        def moved():
            """Squares of what forces change by when atoms move within their last digit."""
            there = frame.replace(positions=frame.positions + rng.uniform(-0.5, 0.5, (n, 3)) * dx)
            again = with_outside(pot.stream(there, None, threads=threads, forces=True), there)
            return ((again.forces_nc - mine.forces_nc) ** 2).sum(1)

        for tries in range(1, MOVES + 1):
            moved2 += moved()
            allowed = np.sqrt(rounding**2 + moved2 / tries)
            within, odd = _within(d, allowed)
            if within or _rms(d) > 10 * BEYOND * _rms(allowed):
                break
        if not within and 0 < odd.sum() <= max(20, n // 100):
            # a pair at its cutoff acts or not by the last digit of a coordinate: whether its ends are the only ones
            # that differ
            flipped = odd & at_cutoff(frame, pot, np.flatnonzero(odd), 4.0 * dx)
            if flipped.any():
                within, odd = _within(np.where(flipped, 0.0, d), allowed)
    rms_d, scale = _rms(d), rms_F if rms_F > 0 else _rms(mine.forces_nc)
    share = rms_d / rms_F if rms_F > 0 else (np.inf if rms_d > 0 else 0.0)
    explained = _rms(allowed) / scale if scale > 0 else 0.0
    check = ForceCheck(number, within, share, explained, rms_F, int(odd.sum()), n, outside=outside, **known)
    if coulomb is not None:
        check.coulomb = coulomb
        # without it the rest would not do
        rest = np.sqrt(np.maximum(allowed**2 - coulomb.force_n**2, printed**2))
        check.needs_coulomb = within and not _within(d, rest)[0]
    check.largest, check.rms_difference = float(d.max()), rms_d
    check.largest_force = float(np.linalg.norm(F, axis=1).max())
    check.worst = (int(frame.ids[d.argmax()]),)
    if not within:
        while 0 < tries < MOVES:  # one try alone makes too little of some atoms
            tries += 1
            moved2 += moved()
            allowed = np.sqrt(rounding**2 + moved2 / tries)
        odd = d > 5.0 * np.maximum(allowed, np.median(allowed))
        check.differ = int(odd.sum())
        order = np.argsort(-d, kind="stable")[:_WORST]
        check.worst = tuple(int(i) for i in frame.ids[order])
        if diagnose:
            from .diagnosis import looks_like

            check.looks = looks_like(frame, pot, mine.forces_nc, allowed, odd, threads)
    return check


def _rms(a) -> float:
    return sqrt(float((np.asarray(a) ** 2).sum()) / max(len(a), 1))


def _within(d, allowed):
    """Whether all differences are explained, and which are not."""
    odd = (d > SINGLE * allowed) & (d > _rms(allowed))
    return bool(not odd.any() and _rms(d) <= BEYOND * _rms(allowed)), odd


def printed_error(x_nc, unit: float) -> np.ndarray:
    """(n,) how far vectors may be from what was computed, by the digits that their numbers were written with (in a unit
    of size `unit`).

    Numbers printed with p significant digits, with d decimals, or as float32 are told by their values. Half a step of
    the last digit.
    """
    x = np.asarray(x_nc, dtype=np.float64) / unit
    some = x.ravel()[:: max(1, x.size // 1500)]
    some = some[some != 0]
    if not len(some):
        return np.zeros(len(x))
    slack = 8.0 * np.spacing(np.abs(some))  # a conversion of units on the way in and back
    with np.errstate(over="ignore", invalid="ignore"):
        if (np.abs(some - some.astype(np.float32)) <= slack).all():
            step = 2.0**-23 * np.abs(x)
        else:
            digits = next((p for p in range(1, 17) if (np.abs(some - _printed(some, f".{p - 1}e")) <= slack).all()), 17)
            with np.errstate(divide="ignore"):
                step = np.where(x != 0, 10.0 ** (np.floor(np.log10(np.abs(x))) + 1 - digits), 0.0)
    decimals = next((q for q in range(13) if (np.abs(some - _printed(some, f".{q}f")) <= slack).all()), None)
    if decimals is not None:
        step = np.maximum(step, 10.0**-decimals)
    return 0.5 * np.linalg.norm(step, axis=1) * unit


def _printed(values, form):
    return np.array([float(format(v, form)) for v in values.tolist()])


def at_cutoff(frame, pot, atoms, within: float) -> np.ndarray:
    """(n,) bool: the `atoms` of which two are at one of the potential's cutoffs from each other, to `within`."""
    from ..neighbors.cell_list import neighbor_list

    out = np.zeros(len(frame), bool)
    limits = sorted(cutoffs(pot, frame))
    if not limits:
        return out
    some = frame.positions[atoms]
    try:
        i, j, r, _ = neighbor_list(some, frame.cell, max(limits) + within)
    except AtcError:
        return out
    far = np.sqrt((r**2).sum(1))
    close = np.min([np.abs(far - rc) for rc in limits], axis=0) <= within
    out[atoms[i[close]]] = out[atoms[j[close]]] = True
    return out


def cutoffs(pot, frame) -> set[float]:
    """Distances at which terms of the potential end (internal)."""
    out = set()
    top = int(frame.types.max(initial=1))
    for term in pot.terms:
        term = term.inner
        for style in term.covering(top).styles:
            out.update(float(rc) for rc in np.unique(np.sqrt(np.abs(np.asarray(style.table)[..., 0]))) if rc > 0)
        if term.cutoff > 0:
            out.add(float(term.cutoff))
    return out
