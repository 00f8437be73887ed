"""Which method each deposit takes, and why: the cheapest that keeps the promise, by the cost model (`costs`)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

from ..errors import AtcError
from ..estimators.accuracy.strongest_bonds import WATCHED
from ..estimators.methods import EXACT, Method
from .costs import Costs, Load, collapsed, direct, gather, points_each, spectral, spectral_memory

#: A tolerance at or below this means the exact sum.
EXACT_BELOW = 1e-11
#: The spectral method's own tolerance over the one asked for, from the loosest start to what is tried last. It is
#: relative to a field of independent sources; how much further stresses may begin is measured (`error_forecast`),
#: anything else begins at 1.
FACTORS = (64.0, 45.0, 32.0, 22.0, 16.0, 11.0, 8.0, 5.6, 4.0, 2.8, 2.0, 1.4, 1.0, 0.7, 1 / 2, 1 / 8, 1 / 64, 1 / 512)
#: The error that the forecast may expect on the first frame, over the tolerance, and the one that is expected on later
#: ones, by what was found on the first: less, since what the frames differ by must fit in; nothing is tightened for
#: what is below the third.
FORECAST_AIM, LATER_AIM, TIGHTEN_ABOVE = 0.4, 0.35, 0.45
#: Where the forecast expects more even at the tolerance: what of it the start is.
CLOSER = 0.7
#: What of the tolerance the start is where bonds and long-range fields leave little of each other, and sums over atoms
#: and bonds are many times the stress.
CANCELLING = 1 / 8
#: Nothing is gained beyond this.
LOOSEST = 0.1
#: CPU seconds of an exact sum below which nothing else is considered.
CHEAP = 3e-3
#: CPU seconds, of a run, that it takes to look for the cheapest method of sums over atoms, and over bonds; and, of a
#: frame, to watch the strongest bonds where their sum is approximate: whatever the frame, for each bond, and at most.
SEARCH, WATCH = (3e-3, 0.035), (0.028, 5e-8, 0.15)
#: What of an exact sum's time all that an approximate one takes may be expected to cost. That is known less well (on
#: busy machines spreading on large meshes took three times as long as foreseen), and a looser tolerance must never be
#: dearer than the exact sum.
WORTH = 0.6
#: What of a run's time a forecast's pass over the bonds and its first mesh may take; all of it takes twice that.
LOOK = 0.01
#: Bytes that meshes may take.
MOST_MEMORY = 4e9


def require_known(method: str) -> None:
    """Raise AtcError for a method that is not one of `deposit.METHODS` or "auto"."""
    from ..deposit import METHODS

    if method != "auto" and method not in METHODS:
        raise AtcError(f"unknown method {method!r}: expected auto or one of {', '.join(METHODS)}")


def sizes(work, atoms: int, load: Load) -> dict[str, tuple[float, float, int]]:
    """For each deposit that a frame needs: how many items, their mean length, how many components."""
    of_atoms, of_bonds = (float(atoms), 0.0), (load.bonds, load.length)
    return {
        key: (*items, components)
        for key, there, items, components in (
            ("site", work.summed_site, of_atoms, work.n_site),
            ("bond", work.bond, of_bonds, work.n_bond),
            ("reference_bond", work.reference_bond, of_bonds, work.n_reference_bond),
            ("gather", work.gather, of_atoms, work.n_gather),
            ("reference_gather", work.reference_gather, of_atoms, work.n_reference_gather),
        )
        if there
    }


def spectral_deposit(
    bound, kern, cell, components: int, tolerance: float, threads: int = 1, gradients: bool = False, order=None
):
    """A spectral deposit without its meshes, or an AtcError that says why there can be none."""
    from ..deposit.collapse import spectral_deposit

    return spectral_deposit(bound, kern, cell, components, components, threads, tolerance, gradients, order)


def carriers(key: str, work, atoms: int) -> float:
    """Atoms that can carry moments of their bonds: where only the stress of central forces is summed over these."""
    return float(atoms) if key == "bond" and work.bond == ["stress"] else 0.0


def choose_methods(job, work, method: str) -> dict[str, Method]:
    """The method of each deposit of some work on the frames of a `Job`, by the first of them.

    method : "auto" or what the user forces
    """
    places, pot = job.places(work), job.request.pot
    if not places:
        return {}
    load = job.load if work.bond or work.reference_bond else Load()
    # How far above the tolerance sums over bonds may begin is known of the stress alone.
    forecast = job.may_loosen(work) and pot is not None and bool(pot.terms)
    # Fields that take away most of what the sums are.
    cancelling = bool(pot is not None and work.bond_users and pot.fields)
    costs, kern, tolerance, atoms = job.costs, job.kernel_internal, job.request.tolerance, len(job.first)
    out = {}
    for key, (items, length, components) in sizes(work, atoms, load).items():
        bound, cell = places[key]
        by_gather = key in ("gather", "reference_gather")
        slopes = by_gather and work.slopes(key)
        exact = (gather if by_gather else direct)(costs, bound, kern, items, length, components)
        look = None
        if forecast and not cancelling and key == "bond":
            look = _Look(job.forecast, load.seconds(costs, atoms))
        frames = job.group() if work is job.work and key in job.added_up else 1
        ways = SpectralWays(
            costs, bound, kern, cell, items, length, components, slopes, carriers(key, work, atoms), frames
        )
        out[key] = _one(method, tolerance, ways, exact, look, job.n_frames, CANCELLING if cancelling else 1.0)
    return out


@dataclass
class _Look:
    """A forecast that has not been made: how, and what its pass over the bonds costs."""

    make: Callable
    seconds: float


def _one(method, tolerance, ways: SpectralWays, exact, look, n_frames, closer) -> Method:
    """The method of one deposit. exact : seconds of the exact sum; look : a `_Look`, or None; closer : the start over
    the tolerance."""
    length = ways.length
    if method == "spectral":
        first = ways.deposit(max(tolerance, 1e-14))
        rungs = _rungs(tolerance, lambda t: _fits(ways.by_points.deposit(t), ways.components))
        return Method("spectral", tolerance, _shape(first, "asked for", length), rungs, True, first.order)
    if method != "auto":
        return Method(method, reason="asked for", forced=True)
    if ways.bound.kind == "slab":
        return Method("direct", reason="averages over the cross-section in closed form: exact, no 3-D grid")
    if tolerance <= EXACT_BELOW:
        return Method("direct", reason=f"tolerance {tolerance:g} means the exact sum")
    if not ways.items:
        return EXACT
    # Looking for an approximate sum, and after its errors, is part of what it costs.
    bonds = bool(length > 0)
    watch = min(WATCH[0] + WATCH[1] * ways.items, WATCH[2]) / ways.frames if bonds else 0.0
    allowed = WORTH * exact - SEARCH[bonds] / n_frames - watch
    if exact < CHEAP or allowed <= 0.0:
        return Method("direct", reason=f"exact, and cheap here: {exact:.1g} s of CPU")

    start = closer * tolerance if look is None else _start(tolerance, ways, exact, allowed, look, n_frames)
    try:
        fast = ways.cost(start)
    except AtcError as e:
        return Method("direct", reason=f"spectral cannot: {_short(e)}")
    if fast >= allowed:
        why = f"exact, and cheaper here: {exact:.2g} s of CPU against {fast:.2g} s by the spectral method"
        return Method("direct", reason=why)
    return ways.method(start, tolerance, exact)


@dataclass
class SpectralWays:
    """One deposit by the spectral method, at one tolerance or another.

    items, length, components : see `sizes`; gradients : whether those are wanted too; carried : atoms that can carry
    moments of their bonds (0: not possible); frames : finished together
    """

    costs: Costs
    bound: Any
    kern: Any
    cell: Any
    items: float
    length: float
    components: int
    gradients: bool = False
    carried: float = 0.0
    frames: int = 1
    _known: dict = field(default_factory=dict, init=False)

    def deposit(self, t):
        """The cheapest."""
        return self.cheapest(t)[1]

    def cheapest(self, t):
        """(seconds, spectral deposit): with points on bonds, or with the moments of atoms, whichever costs less a
        frame."""
        if t not in self._known:
            self._known[t] = self._cheapest(t)
        return self._known[t]

    def _cheapest(self, t):
        from ..deposit import moments

        best = None
        for order in (None, *(moments.ORDERS if self.carried else ())):
            try:
                deposit = spectral_deposit(
                    self.bound, self.kern, self.cell, self.components, t, gradients=self.gradients, order=order
                )
            except AtcError:
                if order is not None:
                    continue
                raise
            # An order that is enough for all bonds is the last one worth a look.
            what = self.items, self.length, self.components, self.carried, self.frames
            seconds = spectral(self.costs, deposit, *what)
            if best is None or (seconds < best[0] and _fits(deposit, self.components, self.carried)):
                best = seconds, deposit
            if order is not None and collapsed(deposit, self.length) == 1.0:
                break
        return best

    @cached_property
    def by_points(self) -> SpectralWays:
        """The same with points on all bonds, as what is computed again goes, which is rare: to find the best order of
        moments for every tolerance takes longer than a small frame."""
        return replace(self, carried=0.0) if self.carried else self

    def empty(self, t):
        """A deposit by points for one component."""
        return spectral_deposit(self.bound, self.kern, self.cell, 1, t, gradients=self.gradients)

    def error_seconds(self, t) -> float:
        """CPU seconds of what the few strongest bonds' error is found by: their sums in two ways."""
        some = WATCHED, self.length, 1
        return spectral(self.costs, self.empty(t), *some) + direct(self.costs, self.bound, self.kern, *some)

    def cost(self, t) -> float:
        """CPU seconds; an AtcError where its mesh is too large."""
        seconds, deposit = self.cheapest(t)
        if not _fits(deposit, self.components, self.carried):
            raise AtcError(f"its mesh of {_mesh(deposit)} would take more than {MOST_MEMORY / 1e9:.0f} GB")
        return seconds

    def method(self, start, tolerance, exact) -> Method:
        """Beginning at `start`, with what is cheaper than the exact sum to go on with."""
        seconds, first = self.cheapest(start)
        why = f"{seconds:.2g} s of CPU against {exact:.2g} s for the exact sum"
        rungs = _rungs(tolerance, lambda t: self.by_points.cost(t) < exact, start)
        return Method("spectral", start, _shape(first, why, self.length), rungs, order=first.order)


def adjusted(method: Method, error, tolerance, ways: SpectralWays) -> Method:
    """The method of sums over bonds for further frames, by the error that `method` left on the first: looser or
    tighter, as far as errors follow the tolerance."""
    limit = method.tolerance * LATER_AIM * tolerance / max(error, 1e-300) * (1 + 1e-9)
    looser = [*_loose(tolerance), *(f * tolerance for f in FACTORS if f <= 1)]
    ladder = [*(t for t in looser if t > method.tolerance * (1 + 1e-9)), method.tolerance, *method.rungs]
    start = next((t for t in ladder if t <= limit), method.tolerance)
    if start == method.tolerance or (start < method.tolerance and error <= TIGHTEN_ABOVE * tolerance):
        return method
    try:
        exact = direct(ways.costs, ways.bound, ways.kern, ways.items, ways.length, ways.components)
        return ways.method(start, tolerance, exact)
    except AtcError:
        return method


def _start(tolerance, ways, exact, allowed, look, n_frames) -> float:
    """The loosest tolerance of the spectral method that the forecast expects to be enough, if a forecast is worth its
    while. allowed : seconds that the sum may take."""
    if look.seconds > LOOK * exact * n_frames:
        return tolerance
    ladder, any_way, ways = _loose(tolerance), ways, ways.by_points
    if not ladder:
        return tolerance
    try:
        loosest = ways.cost(ladder[0])
        seconds = look.seconds + ways.error_seconds(ladder[0])
    except AtcError:
        return tolerance
    try:
        tight = min(ways.cost(tolerance), exact)
    except AtcError:
        tight = exact
    dear = 2.0 * look.seconds > tight - loosest or seconds > LOOK * tight * n_frames
    if dear or (loosest >= allowed and any_way.cost(ladder[0]) >= allowed):
        return tolerance
    forecast = look.make()
    # No more than what the many bonds' errors at random allow.
    at_random = forecast.at_random(tolerance) / tolerance
    at_most = max(min(ladder[0], FORECAST_AIM * tolerance / max(at_random, 1e-300)), tolerance)
    for t in [*ladder, tolerance]:
        if t > at_most * (1 + 1e-9):
            continue
        try:
            if ways.cost(t) >= exact:
                break
        except AtcError:
            break
        error = forecast.error(ways.empty(t))
        if error <= FORECAST_AIM * tolerance:
            return t
        # Errors follow the tolerance.
        at_most = max(t * FORECAST_AIM * tolerance / error, tolerance)
    # Incoherent stresses have errors as large as the tolerance allows: a little closer costs less than all of it again.
    closer = CLOSER * tolerance
    if _precisions(closer) == _precisions(tolerance) and closer in _rungs(tolerance, lambda t: ways.cost(t) < exact):
        return closer
    return tolerance


def _loose(tolerance) -> list[float]:
    """What the spectral method's tolerance may be above that of the result, loosest first."""
    return [t for f in FACTORS if f > 1 and (t := f * tolerance) <= LOOSEST and t < _precise(tolerance)]


def _precisions(t) -> tuple[bool, bool]:
    """Whether meshes and transforms are in single precision."""
    from ..deposit.spectral import SINGLE, SINGLE_TRANSFORM

    return t >= SINGLE, t >= SINGLE_TRANSFORM


def _precise(tolerance) -> float:
    """Below which the spectral method's arithmetic is precise enough for a tolerance of the result."""
    from ..deposit.spectral import SINGLE, SINGLE_TRANSFORM

    return SINGLE if tolerance < 1e-6 else SINGLE_TRANSFORM if tolerance < 1e-5 else 1.0


def _rungs(tolerance, good, start=None) -> tuple[float, ...]:
    """Tolerances tighter than `start`, as far as they are possible and good."""
    from ..deposit.spectral import SINGLE

    start = tolerance if start is None else start
    # Where rounding may be what failed, nothing is gained before arithmetic is more precise.
    tighter = [
        t
        for t in (tolerance * factor for factor in FACTORS)
        if EXACT_BELOW <= t < start * (1 - 1e-9) and not (start >= SINGLE and tolerance < 4e-6 and t >= SINGLE)
    ]

    def possible(t):
        try:
            return good(t)
        except AtcError:
            return False

    # The tighter the dearer: the last good one is between the first and the last.
    low, high = 0, len(tighter)
    while low < high:
        middle = (low + high) // 2
        low, high = (middle + 1, high) if possible(tighter[middle]) else (low, middle)
    return tuple(tighter[:low])


def _fits(deposit, components, atoms=0.0) -> bool:
    return spectral_memory(deposit, components, 1, atoms) <= MOST_MEMORY


def _mesh(deposit) -> str:
    return " x ".join(str(int(k)) for k in deposit.mesh)


def _shape(deposit, why, length) -> str:
    n = points_each(deposit, length)
    each = f", about {n:.0f} point{'s' * (n != 1)} a bond" if length > 0 else ""
    if deposit.order is not None:
        part = collapsed(deposit, length)
        of = "all bonds" if part == 1.0 else f"{100 * part:.0f} % of the bonds"
        each = f", moments to order {deposit.order} of each atom for {of}"
    return f"{why}; mesh {_mesh(deposit)}, window {deposit.parameters.width}{each}"


def _short(error) -> str:
    """The reason without the advice, which is what is being done."""
    text = str(error)
    for advice in (": use method 'direct'", ": the direct method takes it"):
        text = text.split(advice)[0]
    return text
