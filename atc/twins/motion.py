"""How the nodes move: grips, the start in the state of the first frame, and from one frame to the next."""

from __future__ import annotations

import math

import numpy as np

from .. import pd
from .conditions import between, deform, history, smoothed_displacement

#: Steps in parts of the stable one: those of velocity Verlet put the phase of a wave (ω dt)²/24 ahead.
SAFETY = 0.7


def grips_of(held, frames, reference, made, times) -> list:
    """The conditions that hold components of nodes, `held` (n, 3), at the smoothed displacement of their atoms."""
    nodes = held.any(axis=1)
    if not nodes.any():
        return []
    u_tgc = np.array([smoothed_displacement(f, reference, made.smoothing, made.body.X_nc)[nodes] for f in frames])
    at = history(times, u_tgc)
    return [pd.Prescribed(nodes, displacement=lambda t: np.where(held[nodes], at(t), np.nan))]


def start(first, reference, made, material, conditions, forces, motion):
    """The simulation in the state of the run's first frame."""
    X = made.body.X_nc
    v = None
    if motion == "dynamic":
        first.require("velocities", why="the start of a dynamic twin")
        v = made.smoothing.mean(first.velocities)
    options = {"damage": material.damage, "conditions": conditions, "walls": forces, "velocities": v}
    sim = pd.Simulation(made.body, material.material, **options)
    # The cell first, which moves the nodes; then they go to where the atoms are.
    deform(sim, first.cell)
    sim._z[:, :3] = smoothed_displacement(first, reference, made.smoothing, X)
    sim._contact_energy, sim._rigid_energy = sim._all_forces(damage=False)
    return sim


def advance(sim, frames, times, k, motion, safety) -> int:
    """From frame k − 1 to frame k, the cell on the straight way between theirs; the evaluations of forces it took."""
    if motion == "static":
        if k == 0 or sim.cell != frames[k].cell or sim.prescribed or sim.rigid:
            deform(sim, frames[k].cell)
            return pd.relax(sim, time=times[k]).evaluations
        return 0
    if k == 0:
        return 0
    a, b, gap = frames[k - 1].cell, frames[k].cell, times[k] - times[k - 1]
    count = max(1, math.ceil(gap / (safety * sim.time_step_stable)))
    sim.dt = gap / count
    if a == b:
        sim.step(count)
        return count
    for m in range(count):
        deform(sim, between(a, b, (m + 1) / count))
        sim.step()
    return count
