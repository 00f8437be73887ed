"""Which method each deposit takes, and why: the cheapest that keeps the promise, by the cost model (`costs`)."""

from __future__ import annotations

from dataclasses import dataclass

from .costs import Costs, Load, collapsed, direct, gather, points_each, spectral, spectral_memory
from .errors import AtcError
from .estimators.methods import EXACT, Method

#: A tolerance at or below this means the exact sum.
EXACT_BELOW = 1e-11
#: The spectral method's own tolerance over the one asked for, from the loosest start to what is tried last. It is relative to a field of independent sources;
#: how much further stresses may begin is measured (`pilot`), anything else begins at 1.
FACTORS = (32.0, 16.0, 8.0, 4.0, 2.0, 1.0, 1 / 2, 1 / 8, 1 / 64, 1 / 512)
#: The error that the pilot may expect at the start, over the tolerance: with other frames to come, and without.
AIM, AIM_ONE = 0.35, 0.5
#: Nothing is gained beyond this.
LOOSEST = 0.1
#: CPU seconds of an exact sum below which nothing else is considered.
CHEAP = 3e-3
#: Bytes that meshes may take.
MOST_MEMORY = 4e9


def require_known(method: str) -> None:
    from .deposit import METHODS

    if method != "auto" and method not in METHODS:
        raise AtcError(f"unknown method {method!r}: expected auto or one of {', '.join(METHODS)}")


def sizes(work, atoms: int, load: Load) -> dict[str, tuple[float, float, int]]:
    """For each deposit that a frame needs: how many items, their mean length, how many components."""
    out = {}
    if work.summed_site:
        out["site"] = (float(atoms), 0.0, work.n_site)
    if work.bond:
        out["bond"] = (load.bonds, load.length, work.n_bond)
    if work.reference_bond:
        out["reference_bond"] = (load.bonds, load.length, work.n_reference_bond)
    if work.gather:
        out["gather"] = (float(atoms), 0.0, work.n_gather)
    if work.reference_gather:
        out["reference_gather"] = (float(atoms), 0.0, work.n_reference_gather)
    return out


def spectral_deposit(bound, kern, cell, components: int, tolerance: float, threads: int = 1, gradients: bool = False, order=None):
    """A spectral deposit without its meshes, or an AtcError that says why there can be none."""
    from .deposit.spectral import SpectralDeposit

    return SpectralDeposit(bound, kern, cell, components, components, threads, tolerance, gradients=gradients, order=order)


def cheapest(
    costs: Costs, bound, kern, cell, items: float, length: float, components: int, tolerance: float, gradients=False, gathered: float = 0.0
):
    """(seconds, spectral deposit): with points on bonds, or with the moments of `gathered` atoms (0: not possible), whichever costs less."""
    from .deposit import moments

    best = None
    for order in (None, *(moments.ORDERS if gathered else ())):
        try:
            deposit = spectral_deposit(bound, kern, cell, components, tolerance, gradients=gradients, order=order)
        except AtcError:
            if order is not None:
                continue
            raise
        # An order that is enough for all bonds is the last one worth a look.
        seconds = spectral(costs, deposit, items, length, components, gathered)
        if best is None or (seconds < best[0] and _fits(deposit, components, gathered)):
            best = seconds, deposit
        if order is not None and collapsed(deposit, length) == 1.0:
            break
    return best


def choose(
    method: str, tolerance: float, costs: Costs, work, bounds: dict, kern, cells: dict, atoms: int, load: Load, pilot=None, frames: int = 1
) -> dict[str, Method]:
    """The method of each deposit.

    Parameters
    ----------
    method : "auto" or what the user forces
    bounds, cells : the bound grid and the cell of "site", "bond", "gather" (the frame's), "reference_bond" and "reference_gather" (the reference's)
    kern : kernel in internal units
    pilot : a function that makes a `pilot.Pilot` of the first frame's stress; None: the spectral method begins at the tolerance
    frames : how many there are
    """
    out = {}
    for key, (items, length, components) in sizes(work, atoms, load).items():
        bound, cell = bounds[key], cells[key]
        by_gather = key in ("gather", "reference_gather")
        slopes = by_gather and work.slopes(key)
        exact = (gather if by_gather else direct)(costs, bound, kern, items, length, components)
        look = None
        if pilot is not None and key == "bond" and work.bond == ["stress"]:
            look = _Look(pilot, AIM_ONE if frames == 1 else AIM, load.seconds(costs, atoms))
        # Of central forces atoms can carry what their bonds sum up to.
        gathered = float(atoms) if key == "bond" and work.bond == ["stress"] else 0.0
        out[key] = _one(method, tolerance, costs, bound, kern, cell, items, length, components, exact, slopes, look, gathered)
    return out


@dataclass
class _Look:
    """A pilot that has not been made: how, the error it may expect over the tolerance, and what making it costs."""

    make: object
    aim: float
    seconds: float


def _one(method, tolerance, costs, bound, kern, cell, items, length, components, exact, gradients, look=None, gathered=0.0) -> Method:
    """exact : seconds of the exact sum; gradients : whether those are wanted too; gathered : atoms that can carry moments."""

    def best_for(t):
        return cheapest(costs, bound, kern, cell, items, length, components, t, gradients, gathered)

    if method == "spectral":
        first = best_for(max(tolerance, 1e-14))[1]
        rungs = _rungs(tolerance, lambda t: _fits(best_for(t)[1], components, gathered))
        orders = tuple(best_for(t)[1].order for t in rungs)
        return Method("spectral", tolerance, _shape(first, "asked for", length), rungs, True, first.order, orders)
    if method != "auto":
        return Method(method, reason="asked for", forced=True)
    if bound.kind == "slab":
        return Method("direct", reason="averages over the cross-section in closed form: exact, no 3-D grid")
    if tolerance <= EXACT_BELOW:
        return Method("direct", reason=f"tolerance {tolerance:g} means the exact sum")
    if not items:
        return EXACT
    if exact < CHEAP:
        return Method("direct", reason=f"exact, and cheap here: {exact:.1g} s of CPU")

    def cost(t):
        seconds, deposit = best_for(t)
        if not _fits(deposit, components, gathered):
            raise AtcError(f"its mesh of {_mesh(deposit)} would take more than {MOST_MEMORY / 1e9:.0f} GB")
        return seconds, deposit

    start = tolerance if look is None else _start(tolerance, cost, exact, look, lambda t: spectral_deposit(bound, kern, cell, 1, t))
    try:
        fast, deposit = cost(start)
    except AtcError as e:
        return Method("direct", reason=f"spectral cannot: {_short(e)}")
    if fast >= exact:
        return Method("direct", reason=f"exact, and cheaper here: {exact:.2g} s of CPU against {fast:.2g} s by the spectral method")

    def wins(t):
        return cost(t)[0] < exact

    reason = _shape(deposit, f"{fast:.2g} s of CPU against {exact:.2g} s for the exact sum", length)
    rungs = _rungs(tolerance, wins, start)
    return Method("spectral", start, reason, rungs, order=deposit.order, orders=tuple(cost(t)[1].order for t in rungs))


def _start(tolerance, cost, exact, look, deposit) -> float:
    """The loosest tolerance of the spectral method that the pilot expects to be enough, if a pilot is worth its while; `deposit` makes one for one component."""
    ladder = [t for f in FACTORS if f > 1 and (t := f * tolerance) <= LOOSEST and t < _precise(tolerance)]
    if not ladder:
        return tolerance
    try:
        loosest = cost(ladder[0])[0]
    except AtcError:
        return tolerance
    try:
        tight = min(cost(tolerance)[0], exact)
    except AtcError:
        tight = exact
    if tight - loosest < 2.0 * look.seconds:
        return tolerance
    pilot, at_most = look.make(), ladder[0]
    for t in ladder:
        if t > at_most * (1 + 1e-9):
            continue
        try:
            if cost(t)[0] >= exact:
                break
        except AtcError:
            break
        error = pilot.error(deposit(t))
        if error <= look.aim * tolerance:
            return t
        # Errors follow the tolerance.
        at_most = t * look.aim * tolerance / error
    return tolerance


def _precise(tolerance) -> float:
    """Below which the spectral method's arithmetic is precise enough for a tolerance of the result."""
    from .deposit.spectral import SINGLE, SINGLE_TRANSFORM

    return SINGLE if tolerance < 1e-6 else SINGLE_TRANSFORM if tolerance < 1e-5 else 1.0


def _rungs(tolerance, good, start=None) -> tuple[float, ...]:
    """Tolerances tighter than `start`, as far as they are possible and good."""
    from .deposit.spectral import SINGLE

    start = tolerance if start is None else start
    out = []
    for factor in FACTORS:
        t = tolerance * factor
        # Where rounding may be what failed, nothing is gained before arithmetic is more precise.
        if t >= start * (1 - 1e-9) or (start >= SINGLE and tolerance < 4e-6 and t >= SINGLE):
            continue
        try:
            if t < EXACT_BELOW or not good(t):
                break
        except AtcError:
            break
        out.append(t)
    return tuple(out)


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
