"""Static states: adaptive dynamic relaxation (Kilic & Madenci 2010) and a matrix-free Newton-Krylov solver.

Both look for displacements at which the force on every free degree of freedom vanishes, with the prescribed ones held
and the loads as they are at one time. An equilibrium is one step of the run: it counts in `State.step`, moves the clock
if asked to, and its work is in the energy ledger. Bonds do not break.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError


@dataclass
class Converged:
    """How a static solve went. residual : largest |force| on a free degree of freedom, relative to the largest force
    anywhere in the body."""

    iterations: int
    residual: float
    evaluations: int


class _Statics:
    """The static problem of a simulation: forces as a function of the free displacements. As a context, it leaves
    everything as it was if no equilibrium is found, and does the accounts if one is."""

    def __init__(self, sim, time):
        self.sim, s = sim, sim.state
        if time is not None and not np.isfinite(time):
            raise AtcError(f"the time of an equilibrium must be a finite number, got {time!r}")
        self.before = s.u_nc.copy(), s.v_nc.copy(), s.F_nc.copy(), s.external_nc.copy()
        self.energies = sim.energies().kinetic, sim._contact_energy, sim._rigid_energy, s.time
        self.warmth = None if sim.heat_flow is None else (sim.temperature_n.copy(), s.history["heat_brought"].copy())
        if time is not None:
            s.time = float(time)
        self.evaluations = 0
        self.inside = None

    def __enter__(self):
        sim = self.sim
        if sim.model.remembers:
            raise AtcError(
                f"{sim.model.first.name}: what is at rest depends on its history: run it in time, with damping"
            )
        if sim.frictional:
            raise AtcError("friction: what is at rest depends on how it came there: run it in time, with damping")
        t, before = sim.state.time, self.energies[3]
        if self.warmth is not None and t != before:
            if t < before:
                sim.state.time = before
                raise AtcError(
                    f"conduction: an equilibrium at time {t:g} after one at {before:g}: heat does not go back"
                )
            sim._conduct(before, t - before)
        n = len(sim.body)
        self.held = np.zeros((n, 3), bool)
        self.held[:, sim.body.dimension :] = True
        t = sim.state.time
        for p in sim.prescribed:
            if t > p.until:
                continue
            if p.is_velocity:
                value = p.at(t)
                if np.any(np.nan_to_num(value) != 0):
                    raise AtcError(
                        "a static state cannot have prescribed velocities other than zero: prescribe displacements "
                        "instead"
                    )
                self.held[p.nodes] |= ~np.isnan(value)
            else:
                value = p.at(t)
                fixed = ~np.isnan(value)
                sim._z[p.nodes, :3] = np.where(fixed, value, sim._z[p.nodes, :3])
                self.held[p.nodes] |= fixed
        self.free = ~self.held
        return self

    def __exit__(self, kind, *_):
        sim, s = self.sim, self.sim.state
        u, v, F, external = self.before
        if kind is not None:
            sim._z[:, :3], s.v_nc[:], s.F_nc[:], s.external_nc[:] = u, v, F, external
            _, sim._contact_energy, sim._rigid_energy, s.time = self.energies
            if self.warmth is not None:
                sim.temperature_n[:], s.history["heat_brought"][:] = self.warmth
                sim._expand()
            return
        s.v_nc[:] = 0.0
        s.step += 1
        # Loads and reactions went from their old values to the new ones while the body moved: exact for a linear body,
        # third order in the increment otherwise. What an unbalanced start had to spare, and its motion, are gone.
        half_du, ledger = 0.5 * (s.u_nc - u), s.ledger
        ledger["work_external"] += float(((external + s.external_nc) * half_du).sum())
        total = (F + s.F_nc) * half_du
        ledger["work_constraint"] -= float(total[self.held].sum())
        ledger["dissipated_damping"] += float(total[self.free].sum()) + self.energies[0]

    def forces(self):
        sim = self.sim
        sim._contact_energy, sim._rigid_energy = sim._all_forces(damage=False)
        self.evaluations += 1
        return sim.state.F_nc

    def scale(self):
        """The largest force any node feels: from its neighbours or from outside. A body that only its strained cell
        loads, or its own start, has neither: there the largest force in a bond at the start stands in."""
        F = self.sim.state.F_nc
        internal = np.abs(F[self.held]).max(initial=0.0)
        external = np.abs(self.sim.state.external_nc).max(initial=0.0)
        largest = max(internal, external)
        if self.sim.strained or largest == 0.0:
            if self.inside is None:
                self.inside = max(
                    (float(np.abs(f.F_bc).max(initial=0.0)) for f in self.sim.bond_force_parts()), default=0.0
                )
            largest = max(largest, self.inside)
        return max(largest, np.finfo(float).tiny)

    def residual(self):
        return float(np.abs(self.sim.state.F_nc[self.free]).max(initial=0.0))


def relax(sim, *, time=None, tolerance=1e-6, max_steps=20000, callback=None) -> Converged:
    """Adaptive dynamic relaxation: fictitious masses and a damping that follows the lowest mode being excited, to
    static equilibrium.

    Parameters
    ----------
    sim : Simulation. Its displacements are the start and take the result; velocities end at zero.
    time : the time whose loads and prescribed displacements hold, which becomes the state's: increasing times are a
        quasi-static history. None is
        the state's own time: equilibrium under the loads of now. The steps that the relaxation takes are no time;
        `State.step` counts the equilibrium as one.
    tolerance : largest free force relative to the largest reaction or external force
    callback : called with (iteration, residual) every 50 iterations

    The ledger gets the work of loads and reactions (their mean of before and after, times the displacement between),
    and as dissipated what an unbalanced start released. Raises AtcError when `max_steps` do not suffice; the simulation
    is then as it was before.
    """
    with _Statics(sim, time) as s:
        return _relax(sim, s, tolerance, max_steps, callback)


def _relax(sim, s, tolerance, max_steps, callback):
    z, free = sim._z, s.free
    # Fictitious masses: the time step is 1, and Gershgorin's bound on ω² is 2·stiffness/mass = 4·(a margin).
    mass = (0.6 * np.maximum(sim.model.stiffness_n(), np.finfo(float).tiny))[:, None]
    v = np.zeros_like(sim.state.v_nc)
    F = s.forces().copy()
    previous, start = F.copy(), z[:, :3].copy()
    for k in range(max_steps):
        scale = s.scale()
        worst = s.residual() / scale
        if worst <= tolerance:
            break
        if not np.isfinite(worst):
            raise AtcError(
                "the relaxation has blown up: forces are no longer finite numbers; load in smaller increments"
            )
        if callback is not None and k % 50 == 0:
            callback(k, worst)
        u = z[:, :3]
        damping = 0.0
        if k:
            # Local stiffness along the motion, −ΔF/Δu; Rayleigh's quotient of it is the square of the frequency to damp
            # critically.
            with np.errstate(divide="ignore", invalid="ignore"):
                stiff = np.where(free & (v != 0), -(F - previous) / (mass * v), 0.0)
            weight = np.where(free, u - start, 0.0)
            below = float((weight**2).sum())
            above = float((weight**2 * stiff).sum())
            if below > 0 and above > 0:
                damping = min(2.0 * np.sqrt(above / below), 1.9)
            v = ((2 - damping) * v + 2 * F / mass) / (2 + damping)
        else:
            v = 0.5 * F / mass
        v[~free] = 0.0
        z[:, :3] += v
        previous = F
        F = s.forces().copy()
    else:
        raise AtcError(
            f"the relaxation stands at a relative residual of {worst:.2g} after {max_steps} steps (asked: "
            f"{tolerance:g}): hold rigid motions, "
            "load in smaller increments, or allow more steps"
        )
    return Converged(k, worst, s.evaluations)


def solve_static(sim, *, time=None, tolerance=1e-8, max_iterations=50, inner=200) -> Converged:
    """Newton's method with matrix-free Krylov solves (scipy's newton_krylov, LGMRES, scaled by the nodes' stiffness) to
    static equilibrium.

    Parameters and result as for `relax`. Wants a problem without rigid motions left free and a start not too far away.
    """
    with _Statics(sim, time) as s:
        return _solve(sim, s, tolerance, max_iterations, inner)


def _solve(sim, s, tolerance, max_iterations, inner):
    from scipy.optimize import NoConvergence, newton_krylov

    free = s.free
    if not free.any():
        s.forces()
        return Converged(0, 0.0, s.evaluations)
    stiff = np.broadcast_to(sim.model.stiffness_n()[:, None], free.shape)[free]
    stiff = np.maximum(stiff, 1e-12 * stiff.max())
    length = 1e-3 * sim.body.spacing
    # Unknowns in lengths of a thousandth of the spacing, residuals as the displacement a node's own springs would need:
    # both of order one.
    base = sim._z[:, :3][free].copy()

    def residual(x):
        u = sim._z[:, :3]
        u[free] = base + length * x
        return -s.forces()[free] / (stiff * length)

    last = np.zeros(len(base))
    residual(last)
    scale = s.scale()
    iterations = 0

    def count(x, f):
        nonlocal iterations, last
        iterations, last = iterations + 1, x.copy()

    small = tolerance * scale / (stiff.max() * length)
    try:
        # At rest from the start scipy divides nothing by nothing.
        with np.errstate(invalid="ignore"):
            x = newton_krylov(
                residual,
                np.zeros(len(base)),
                f_tol=small,
                maxiter=max_iterations,
                inner_maxiter=inner,
                callback=count,
                method="lgmres",
            )
    except (NoConvergence, ValueError):
        # scipy's measure is stricter than the one asked for, as stiffnesses differ; and where rounding leaves no
        # direction to go in, it gives up. What counts is the state that was reached.
        x = last
    residual(x)
    # Forces of states passed on the way there, which may be anything, are no measure.
    scale = max(scale, s.scale())
    if not s.residual() <= tolerance * scale:
        raise AtcError(
            f"the static solver did not converge in {max_iterations} Newton steps (relative residual "
            f"{s.residual() / scale:.2g}): load in smaller"
            " increments, hold rigid motions, or use relax"
        )
    return Converged(iterations, s.residual() / s.scale(), s.evaluations)
