"""Time and memory of one frame of a request, from the counts of its work and the costs of each (`costs`); of frames
that are added up, their share."""

from __future__ import annotations

from dataclasses import dataclass

from ..estimators.accuracy.random_points import checking_kernel
from ..estimators.accuracy.strongest_bonds import POINTS
from ..estimators.field_pass import EVERY
from ..estimators.groups import POINTS as GROUP_POINTS
from ..estimators.groups import formed_once
from ..estimators.methods import EXACT
from . import costs as model
from .method_choice import sizes, spectral_deposit

#: Bytes of a process that has done nothing yet: the interpreter, numpy, numba, scipy.
PROCESS = 3.0e8
#: Of a number that joins a time average, and of one that is formed frame by frame for the mean of a group.
SECONDS_PER_AVERAGED, SECONDS_PER_FORMED = 2e-9, 1e-8
#: What of the rest each frame of a group takes.
OF_EACH = 0.25
#: Of a pair of a bond and a point with both ends within its horizon.
SECONDS_PER_WEIGHT = 3e-8


@dataclass
class Prediction:
    """parallel, serial : CPU seconds that threads share, and that they do not; parts : both, by what they are for;
    memory : peak bytes; counts."""

    parallel: float
    serial: float
    parts: dict[str, float]
    memory: float
    points: int
    visits: float


def predict(job) -> Prediction:
    """What one frame will take."""
    work, frame, costs, load, threads = job.work, job.first, job.costs, job.load, job.request.threads
    n, m = len(frame), job.group()
    together = job.added_up if m > 1 else frozenset()
    parts = {"reading": costs.read_atom * n}
    memory = PROCESS + 8.0 * n * 24
    # One deposit is gone before the next begins.
    visits, points, passing = 0.0, 0, [0.0]
    if work.bond_users:
        parts["neighbours and forces"] = load.seconds(costs, n)
        memory += 12.0 * n + 4e6 * threads + _list_memory(load)
    passing += _fields(job, parts)
    if work.grid_users:
        points = len(job.bound)
        memory += 8.0 * points * 4 * sum(3**q.rank for q in work.quantities if q.kind == "grid")
    if work.horizon_users:
        from ..estimators.peridynamic import ball_volume

        ball = ball_volume(job.horizon, job.request.pot, frame.cell)
        # Half of the ball is within the horizon of both ends of a bond of mean length.
        near = load.bonds * points * 0.5 * ball / job.bound.cell.volume
        parts["weighted virials"] = SECONDS_PER_WEIGHT * near * (bool(work.point) + bool(work.reference_point))
    if work.kernel_users:
        kern, bound = job.kernel_internal, job.bound
        checked = checking_kernel(kern, job.methods, job.request.tolerance)
        for key, (items, length, components) in sizes(work, n, load).items():
            method, slopes = job.methods.get(key, EXACT), False
            what = "deposit of atoms" if key == "site" else "deposit of bonds"
            if key in ("gather", "reference_gather"):
                what, slopes = "gradients", work.slopes(key)
                memory += 8.0 * points * components * (1 + 3 * slopes)
            if method.exact and what == "gradients":
                seconds = model.gather(costs, bound, kern, items, length, components)
            elif method.exact:
                many = 0.0 if bound.kind == "slab" else model.visits(bound, kern, items, length)
                seconds = model.direct(costs, bound, kern, items, length, components)
                passing.append(8.0 * points * (4 * -(-components // 4)) * (threads + 1))
                visits += many if key != "site" else 0.0
            else:
                deposit = spectral_deposit(
                    bound, kern, bound.cell, components, method.tolerance, gradients=slopes, order=method.order
                )
                seconds = model.spectral(costs, deposit, items, length, components, n, m if key in together else 1)
                passing.append(model.spectral_memory(deposit, components, threads, n))
            if key == "site" and work.squares:
                some = bound, kern, bound.cell, items, len(work.squares)
                seconds += model.squares(costs, *some, method, job.request.tolerance)
            parts[what] = parts.get(what, 0.0) + seconds
            # Points around the strongest bonds, where sums over bonds are approximate; see
            # `estimators.accuracy.strongest_bonds`.
            watched = POINTS if key == "bond" and not method.exact and job.request.tiles is None else 0
            looked_at = GROUP_POINTS if m > 1 else 100 + watched
            seconds = model.check(costs, bound, checked, items, length, min(points, looked_at))
            parts["error check"] = parts.get("error check", 0.0) + seconds
        components = sum(3**q.rank for q in work.quantities if q.kind == "grid")
        sums = {"site": work.n_site, "bond": work.n_bond, "": work.n_reference_bond}
        values = components + sum(sums.values())
        if m > 1:
            formed = sum(3**q.rank for q in work.elements if q not in formed_once(work))
            formed += sum(k for key, k in sums.items() if key not in together)
            parts["fields of each frame"] = SECONDS_PER_FORMED * points * formed
            memory += 8.0 * n * m * 12 + 8.0 * points * 2 * formed
            values = (components + sum(k for key, k in sums.items() if key in together)) / m
        # Averages are written once a window.
        parts["fields"] = costs.value * points * values * (1.0 if job.request.average is False else 0.5)
        if job.request.average is not False:
            parts["time average"] = SECONDS_PER_AVERAGED * points * components / m
        memory += 8.0 * points * (work.n_site + work.n_bond + work.n_reference_bond)
    memory += max(passing)
    parts["the rest"] = costs.frame * (OF_EACH + (1.0 - OF_EACH) / m)
    serial = parts["reading"] + parts["the rest"] + parts.get("fields", 0.0)
    serial += costs.list_atom * n * bool(work.bond_users)
    total = sum(parts.values())
    return Prediction(max(total - serial, 0.0), min(serial, total), parts, memory, points, visits)


def _fields(job, parts: dict) -> list[float]:
    """Adds what fields (long-range Coulomb) cost to the parts; bytes of their meshes."""
    work, costs, pot, frame = job.work, job.costs, job.request.pot, job.first
    if not work.bond_users or pot is None or not pot.fields:
        return []
    frame = pot.complete(frame)
    if work.beyond_bonds or pot.needs_forces:
        forces = 3 * bool(work.force_users or pot.needs_forces)
        many = forces + bool(work.energy_users) + 6 * bool(work.atom_virial or "box_power" in work.whole)
        parts["energy and forces of the long-range part"] = sum(model.smooth(costs, t, frame, many) for t in pot.fields)
    main, tight = job.field_sums(), job.field_sums(tight=True)
    if main is None:
        return []
    layouts = [[sums.layout(n, frame) for n in range(len(pot.fields))] for sums in (main, tight)]
    once, again = (sum(model.products(costs, on, main.kinds, len(frame)) for on in some) for some in layouts)
    parts["long-range fields"] = once
    # Modes and split are computed again more closely in some frames.
    checked = -(-job.n_frames // EVERY) / job.n_frames
    again += 1.5 * job.load.seconds(costs, len(frame)) + parts.get("energy and forces of the long-range part", 0.0)
    parts["error check"] = parts.get("error check", 0.0) + checked * again
    return [on.memory for on in layouts[1]]


def _list_memory(load) -> float:
    """Pairs stream by unless many-body terms need all of them."""
    return 150.0 * load.pairs if load.triplets else 0.0
