"""The heat current of the box, frame by frame (quantity ``heat_current``: heat flux times volume), and whether species
of its atoms diffuse among each other."""

from __future__ import annotations

import time
from collections.abc import Sized
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import AtcError
from ..estimators.atom_pass import drift_velocity
from ..estimators.settings import Settings
from ..readers.planar import matched
from ..readers.times import Clock
from ..readers.trajectory import Trajectory
from ..units import Units

#: Atoms that get further than this many distances between neighbours, rms, diffuse.
DIFFUSES = 0.6


@dataclass
class HeatCurrents:
    """The heat current of the box, frame by frame; internal units.

    J_tc : (t, 3) heat flux times volume, energy·length/time, relative to the mass-mean velocity. dt : time between
        frames.
    volume, temperature : their means (temperature of 3N−3, in the plane 2N−2, degrees of freedom). units : the user's.
        atoms : how many.
    notes : what to know of the frames.
    """

    J_tc: np.ndarray
    dt: float
    volume: float
    temperature: float
    units: Units
    atoms: int | None = None
    source: str = "heat currents"
    notes: list = field(default_factory=list)

    def __len__(self):
        return len(self.J_tc)


def heat_currents(frames, pot, *, dt: float | None = None, threads: int | None = None, progress=None) -> HeatCurrents:
    """The heat current of every frame.

    Parameters
    ----------
    frames : trajectory from `atc.read`, or any iterable of Frames, equally spaced in time; read once, one frame at a
        time
    pot : potential from `atc.potential`
    dt : time between frames in the user's unit, for frames that do not know their time (steps, where they are known,
        must still be equally spaced)
    threads : threads within a frame (default 1: frames of a Green-Kubo run are small and many)
    progress : callable(done, total, rate), total 0 if it is not known

    Returns
    -------
    HeatCurrents. J = Σ e_j v_j + Σ_{j≠k} (v_k·∂U^(j)/∂x_k) x_jk, velocities relative to the mass-mean velocity of the
    frame (formulas: R 4.0.114-4.0.123).

    Raises
    ------
    AtcError
        when velocities, masses or times are missing, frames are not equally spaced (steps that repeat or go back, gaps,
        a change of the time step), or the number of atoms changes. The frame with which a continued run begins, if it
        is the one before once more, is left out.
    """

    from ..estimators.driver import fields_of
    from ..neighbors.verlet import Following

    settings = Settings(names=("heat_current",), pot=pot, threads=threads or 1, check_points=0)
    J, volumes, temperatures, first = [], [], [], None
    clock, paths = Clock("a correlation function"), Paths()
    lists = Following(pot.cutoff)
    if isinstance(frames, (list, tuple, Trajectory)):
        frames, pot = matched(frames, pot)
    total = len(frames) if isinstance(frames, Sized) else 0
    began = time.perf_counter()
    for frame in frames:
        frame = pot.complete(frame)
        frame, pot = matched(frame, pot)
        if first is None:
            pot = pot.settled(frame)
        held = 0 if pot.constraints is None else pot.constraints.taken(frame)
        first = frame if first is None else first
        if len(frame) != len(first) or len(frame) < 2:
            raise AtcError(
                f"{frame.source}: a conductivity needs the same two or more atoms in every frame, found {len(frame)} "
                f"after {len(first)}"
            )
        frame.require("velocities", "masses", why="the heat current")
        if not clock.follows(frame):
            continue
        paths.add(frame)
        still = frame.replace(velocities=frame.velocities - drift_velocity(frame))
        settings = replace(settings, pot=pot, anchor=lists.at(still))
        current = fields_of([still], settings, len(J)).arrays["heat_current"]
        J.append(frame.units.to_internal("energy_current", np.asarray(current).reshape(3)))
        volumes.append(frame.cell.volume)
        kinetic = still.masses @ np.einsum("nc,nc->n", still.velocities, still.velocities)
        temperatures.append(kinetic / ((frame.dimension * (len(frame) - 1) - held) * frame.units.boltzmann))
        if progress is not None:
            progress(len(J), total, len(J) / max(time.perf_counter() - began, 1e-9))
    if first is None:
        raise AtcError("no frames were given: a conductivity needs a trajectory")
    step, notes = _time_step(clock, first, None if dt is None else positive(dt, "dt", first.units))
    means = float(np.mean(volumes)), float(np.mean(temperatures))
    about = first.units, len(first), str(first.source), [*notes, *paths.notes()]
    return HeatCurrents(np.array(J), float(step), *means, *about)


def _time_step(clock, frame, given) -> tuple[float, list[str]]:
    """Time between frames (internal), and what to know of it. `given` goes before what the frames say."""
    u, notes = frame.units, list(clock.notes)
    if clock.count < 2 and given is None:
        raise AtcError(f"{frame.source}: has one frame: a conductivity needs thousands, equally spaced in time")
    step = clock.spacing()
    if given is None and step is None:
        raise AtcError(
            f"{frame.source}: its frames do not know their time (dump_modify time yes makes LAMMPS write it): give "
            "the time between frames as dt"
        )
    if given is None:
        return step, notes
    if step is not None and abs(step - given) > 1e-3 * given:
        here, there = (f"{u.to_user('time', t):.6g} {u.label('time')}" for t in (given, step))
        notes.append(f"dt = {here} goes before the times of the frames, by which they are {there} apart")
    if not clock.checked:
        notes.append("the frames have neither steps nor times: that they are equally spaced could not be checked")
    return given, notes


class Paths:
    """How far the atoms of each species get: whether species diffuse among each other."""

    def __init__(self):
        self.first = self.last = self.moved = None

    def add(self, frame) -> None:
        if self.last is None:
            self.first, self.moved = frame, np.zeros((len(frame), 3))
        else:
            d = frame.positions - self.last
            self.moved += d - np.where(frame.cell.periodic, np.rint(d @ frame.cell.inverse), 0.0) @ frame.cell.vectors
        self.last = frame.positions

    def notes(self) -> list[str]:
        """What a mixture needs before its heat current is that of conduction alone."""
        if self.first is None:
            return []
        f = self.first
        kinds, labels = species(f)
        if len(labels) < 2:
            return []
        w = self.moved - (f.masses @ self.moved) / f.masses.sum()
        reach = (f.cell.volume / len(f)) ** (1.0 / 3.0)
        far = {k: float(np.sqrt((w[kinds == k] ** 2).sum(1).mean())) for k in range(len(labels))}
        moving = [k for k, d in far.items() if d > DIFFUSES * reach]
        if not moving:
            return []
        u = f.units
        told = ", ".join(f"{labels[k]} by {u.to_user('length', far[k]):.3g} {u.label('length')}" for k in moving)
        return [
            f"a mixture whose species diffuse ({told}, rms): the partial enthalpies that diffusing species carry are "
            "not taken off the current, "
            "J - sum over species of h_s sum of v_i, so that the value is not the conductivity at zero flow of "
            "matter; take h_s from runs of other compositions, "
            "subtract, and give the series to atc.conductivity"
        ]


def connected(n: int, bonds) -> tuple[int, np.ndarray]:
    """How many molecules bonds (b, 2 or more; the last two are the atoms) make of n atoms, and (n,) the number of each
    atom's."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    i, j = np.asarray(bonds)[:, -2:].T
    return connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(n, n)), directed=False)


def species(frame) -> tuple[np.ndarray, list[str]]:
    """(n,) number of each atom's species and their names: types of atoms, or kinds of molecules where bonds say which
    atoms belong together."""
    types = frame.types
    names = frame.type_names
    values, kinds = np.unique(types, return_inverse=True)
    labels = [f"type {t}" + (f" ({names[t]})" if t in names else "") for t in values.tolist()]
    top = frame.topology
    if top is None or not len(top.bonds):
        return kinds, labels
    count, molecule = connected(len(frame), top.bonds)
    content = np.zeros((count, len(values)), np.int64)
    np.add.at(content, (molecule, kinds), 1)
    unique, which = np.unique(content, axis=0, return_inverse=True)
    called = [" + ".join(f"{m} {labels[k]}" for k, m in enumerate(row) if m) for row in unique]
    alone = [labels[int(row.argmax())] if row.sum() == 1 else None for row in unique]
    return which.reshape(-1)[molecule], [one or f"molecules of {of}" for one, of in zip(alone, called)]


def positive(x, name, u, dimension="time") -> float:
    """A number greater than 0 in the user's units, in internal ones."""
    if isinstance(x, bool) or not isinstance(x, (int, float, np.number)) or not 0 < x < np.inf:
        raise AtcError(f"{name}={x!r}: expected a number greater than 0 ({u.label(dimension)})")
    return float(u.to_internal(dimension, x))
