"""A run of a crystal as waves: mass-weighted amplitudes u_k = Σ √m u exp(−ik·R) over the ideal sites R, by frame."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from ..readers.times import Clock
from .crystal import Crystal
from .sites import Sites, find_sites, of_one_run, shortest_contact


@dataclass
class Amplitudes:
    """Mass-weighted amplitudes of the waves of a run.

    k_kc : (k, 3) wave vectors. u_tkx, v_tkx : (frames, k, 3n) complex; displacements from the ideal sites and
        velocities. dt : internal, or None.
    """

    sites: Sites
    k_kc: np.ndarray
    u_tkx: np.ndarray
    v_tkx: np.ndarray
    dt: float | None
    temperature: float
    source: str
    notes: list = field(default_factory=list)


def amplitudes(traj, crystal: Crystal, wave_vectors, *, timestep: float | None = None) -> Amplitudes:
    """Project a trajectory on waves, frame by frame.

    Parameters
    ----------
    traj : frames with velocities and masses; the box may breathe (displacements are then taken relative to it)
    crystal : Crystal
    wave_vectors : function Sites → (k, 3) wave vectors
    timestep : time of one step in the user's unit, for dumps that give steps only

    Raises
    ------
    AtcError for missing velocities or masses, atoms that leave their sites, a box that does not fit, steps or times
    that repeat or go back.
    """
    first, frames = of_one_run(traj)
    first.require("velocities", "masses", why="the dispersion from a trajectory")
    sites = find_sites(first, crystal)
    crystal = sites.crystal
    if np.abs(first.masses - crystal.masses[sites.basis]).max() > 1e-6 * crystal.masses.max():
        raise AtcError(
            f"{first.source}: the masses of the atoms differ from those of {crystal.name}: give the same in both"
        )
    k = np.asarray(wave_vectors(sites), float).reshape(-1, 3)
    n = len(crystal)
    order = np.argsort(sites.basis, kind="stable")
    phase = np.exp(-1j * (k @ sites.sites[order].T)).reshape(len(k), n, -1) / np.sqrt(sites.cells)
    root = np.sqrt(first.masses)[:, None]
    nearest = shortest_contact(sites)
    u_all, v_all, kinetic, cells = [], [], [], []
    clock = Clock("a dispersion from a run", gaps=False)
    inv0 = np.linalg.inv(sites.cell)
    drift = np.zeros(3)

    def project(a):
        a = (root * a)[order].reshape(n, -1, 3)
        return np.einsum("kbm,bmc->kbc", phase, a, optimize=True).reshape(len(k), 3 * n)

    for frame in frames:
        frame.require("velocities", why="the dispersion from a trajectory")
        if not clock.follows(frame):
            continue
        x = (frame.positions - frame.cell.origin) @ frame.cell.inverse @ sites.cell
        # The crystal may drift as a whole, through the box if it likes: it is looked for where it was the frame before.
        u = x - sites.sites - drift
        s = u @ inv0
        u = (s - np.rint(s)) @ sites.cell
        moved = u.mean(axis=0)
        u -= moved
        drift = drift + moved
        far = np.sqrt((u**2).sum(axis=1))
        if far.max() > 0.5 * nearest:
            bad, u = int(np.argmax(far)), frame.units
            away = f"{u.to_user('length', far[bad]):.3g} {u.label('length')}"
            why = "the crystal has melted or atoms have changed places; take earlier frames"
            raise AtcError(f"{frame.source}: atom {frame.ids[bad]} is {away} from its site: {why}")
        v = frame.velocities - np.average(frame.velocities, axis=0, weights=frame.masses)
        u_all.append(project(u))
        v_all.append(project(v))
        kinetic.append((frame.masses[:, None] * v**2).sum() / (3 * (len(frame) - 1) * frame.units.boltzmann))
        cells.append(frame.cell.vectors)
    notes = list(clock.notes)
    swing = np.abs(np.array(cells) - sites.cell).max() / np.abs(sites.cell).max()
    if swing > 1e-6:
        notes.append(
            f"the box changes by up to {100 * swing:.2g} % during the run: wave vectors are those of the first frame"
        )
    dt, why = _interval(clock, timestep, first.units)
    if dt is None:
        notes.append(f"no spectra: {why}")
    return Amplitudes(sites, k, np.array(u_all), np.array(v_all), dt, float(np.mean(kinetic)), first.source, notes)


def _interval(clock: Clock, timestep, units):
    """(time between frames, "") or (None, why not)."""
    if clock.count < 2:
        return None, "there is one frame only"
    dt = clock.spacing(None if timestep is None else units.to_internal("time", timestep))
    if dt is None:
        return None, "the frames have no times; say the time of a step with timestep in [dispersion]"
    if clock.gap:
        return None, f"the frames are not equally spaced in time: {clock.gap}"
    return float(dt), ""
