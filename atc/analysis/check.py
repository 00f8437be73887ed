"""``atc check``: do the fields of this trajectory, potential and kernel obey the balance laws, how well, and what
limits it?

The physics is in `atc.estimators.balance`, the words in `atc.check_report`; here are the choice of points and frames
and what counts as holding.
"""

from __future__ import annotations

import itertools
import os

import numpy as np

from ..decomposers.long_range.kspace import converged
from ..errors import AtcError
from ..estimators import balance as law
from ..estimators.accuracy.random_points import kernel_internal
from ..estimators.balance import limits
from ..grids.padding import resolved
from ..readers.memory import completed
from ..readers.planar import matched
from .check_report import EXACT, Findings, Frames, Outcome, Report, number, relative, report

#: Divergences by differences hold within this many times their own error estimate (or EXACT, if that is larger).
DIFFERENCES = 30.0
#: Nothing is said about a law when the error of a test is more than this share of the largest term.
HOPELESS = 0.05
#: Largest distance between frames, times the mean frequency √(Σ F²/m / Σ m v²) of the atoms, of which differences make
#: sense.
CLOSE = 0.5
#: Error of velocity Verlet at a step over that of central differences at the same step; see `_extrapolated`.
_VERLET = 4.0


def check_scene(scene, jobs: int = 1) -> Report:
    """`check` with what a scene says: its trajectory, potential, kernel, grid and [check] section."""
    for section, example in (
        ("potential", 'lammps = """pair_style ..."""'),
        ("kernel", 'name = "quartic" and radius = 8.0'),
    ):
        if section not in scene.data:
            raise scene.need(section, f"the balance laws need one, e.g. {example}")
    options = scene.data.get("check", {})
    traj = scene.trajectory()
    pot, kern, grid = scene.potential(), scene.kernel(), scene.grid()
    return check(traj, pot, kern, grid, threads=jobs or os.cpu_count() or 1, **options)


def check(
    traj, pot, kern, grid=None, *, points: int = 20, seed: int = 0, timestep: float | None = None, threads: int = 1
) -> Report:
    """Residuals of the balance laws of mass, momentum and energy and of ∇·z = 0, on the frame in the middle of a
    trajectory.

    Parameters
    ----------
    traj : trajectory, Frame or anything `atc.read` takes. With at least 3 frames close in time, rates are also taken as
        differences between
        frames, with 5 or 9 frames at two or three spacings.
    pot : potential
    kern : kernel, user's length
    grid : Grid or None: as many of its points are looked at as there are random ones
    points : random points
    seed : of the random points
    timestep : the user's time per step, if the trajectory knows its steps but not its times
    threads : threads

    Returns
    -------
    Report
        `ok` is False when a law is broken by more than what limits the test explains.

    Raises
    ------
    AtcError for frames without masses or velocities, a potential that does not fit, nothing to look at.
    """
    from .. import read

    traj, pot = matched(completed(read(traj), pot), pot)
    n_frames = len(traj)
    if not n_frames:
        raise AtcError(f"{traj.source}: holds no complete frame")
    k = n_frames // 2
    frame = traj[k]
    frame.require("masses", "velocities", why="a balance law")
    if pot.fields:
        # Stencils and differences of energies see what fields may leave out.
        pot = converged(pot, law.FIELD_TOLERANCE)
    free = pot
    if pot.constraints is not None or frame.held is not None:
        pot = pot.settled(frame)
        free = pot if pot.constraints is None else pot.constrained(None)
    if not len(frame):
        raise AtcError(f"{frame.source}: holds no atoms: there is nothing to check")
    frame = pot.carriers(frame)  # with virtual sites, which have energies
    kern_in = kernel_internal(kern, frame.units)
    if pot.fields and not kern_in.analytic:
        raise AtcError(
            f"kernel {kern_in.name!r}: balance laws with long-range Coulomb (kspace_style) are checked to "
            f"{law.FIELD_TOLERANCE:g}, which takes too many modes with a kernel that ends: take kernel 'gaussian' for "
            "the check"
        )
    notes: list[str] = []
    bound = None
    if grid is not None:
        bound = resolved(grid, kern, frame).bind(frame.units, frame.cell, frame.positions)
        if bound.kind == "slab":
            notes.append("a slab profile has no points of its own: random points only")
            bound = None
    if kern_in.jumps:
        notes.append(
            f"kernel {kern_in.name!r} jumps: its fields change by jumps when an atom enters or leaves, which no rate "
            "at a point sees"
        )

    x_gc, n_random = law.choose_points(frame, kern_in, points, np.random.default_rng([20240301, seed]), bound)
    if n_random < points:
        notes.append(f"only {n_random} of {points} random points keep clear of the kernel's kinks")
    h = kern_in.difference_step
    stencils = law.stencil(x_gc, h, frame.dimension)
    deposit = law.deposit_at(stencils, kern_in, frame.cell, threads)
    state = _motion(frame, pot, threads, deposit)
    fields = law.deposited(state, deposit, law.field_bonds(frame, pot, kern_in, stencils, threads))
    if pot.acting is not None and (pot.acting.laws or pot.acting.others):
        state.outside_nc, said = pot.body_forces(frame, state.forces_nc)
        notes.append(f"body force {said}")
    exact = law.Exact(law.Sites(x_gc, frame.positions, frame.cell, kern_in), state, fields.pop("bonds")[::19])
    laws = exact.laws()
    still = frame.replace(velocities=state.v_nc)
    written = law.from_fields(still, pot, kern, stencils, threads)
    # rounding of z and q_C, which are 0 for pair potentials, is that of stress and heat flux
    whole = {"churning": "stress", "heat_flux_churning": "heat_flux"}
    apart = {
        name: relative(np.abs(a - fields[name]).max(), np.abs(fields[whole.get(name, name)]).max())
        for name, a in written.items()
    }
    by_fields = law.field_laws(laws, exact, fields | written, h)

    # Constraints have no energy, whose rate their velocities would have to belong to exactly.
    of_energies = state if free is pot else _motion(frame, free, threads, None)
    scale = {name: x.largest[1] for name, x in laws.items()}
    closed = {name: _outcome(x, scale[name], np.zeros(1)) for name, x in laws.items()}
    stencil = {name: _outcome(x, scale[name], x.limit, DIFFERENCES) for name, x in by_fields.items()}
    found = limits.cutoff_jumps(frame, pot, threads)
    # 1e-9: what rounding leaves of z where a pair potential has none
    churns = bool(np.abs(exact.z).max() > 1e-9 * np.abs(exact.S).max())
    frames, why = _frames(traj, k, frame, pot, kern_in, x_gc, exact, laws, scale, found, timestep, threads)
    if why:
        notes.append(why)
    notes += [f"{what}: {count}" for what, count in state.notes.items()]
    return report(
        Findings(
            source=traj.source,
            number=k,
            frame=frame,
            kernel=kern.describe(),
            n_random=n_random,
            n_points=len(x_gc),
            laws=laws,
            closed=closed,
            stencil=stencil,
            frames=frames,
            sources=law.energy_rates(frame, free, of_energies, threads),
            apart=apart,
            jumps=found,
            churns=churns,
            forces_nc=_as_in_file(frame, pot, state, threads),
            notes=notes,
        )
    )


def _as_in_file(frame, pot, state, threads):
    """The forces that the file of the run has: without those of constraints where they are known not to be in it."""
    there = pot.as_in_file(frame)
    if there.constraints is pot.constraints or there.constraints is not None:
        return state.forces_nc
    return there.stream(frame, forces=True, threads=threads).forces_nc


def _motion(frame, pot, threads, deposit):
    try:
        return law.motion(frame, pot, threads, deposit)
    except NotImplementedError as e:
        raise AtcError(
            f"the energy balance needs the derivatives of each atom's energy, which are not there for: {e}"
        ) from None


def _outcome(x, scale, limit, times=1.0) -> Outcome:
    """How a law does against `scale`; it holds below EXACT or `times` its limit."""
    worst = relative(law.size(x.residual).max(), scale)
    bound = relative(np.max(limit), scale)
    rms = relative(np.sqrt(np.mean(law.size(x.residual) ** 2)), scale)
    without = None if x.without is None else relative(law.size(x.without).max(), scale)
    allowed = max(EXACT, times * bound)
    return Outcome(worst, bound, None if allowed > HOPELESS else worst <= allowed, without, rms)


# ---- differences between frames


def _frames(traj, k, frame, pot, kern, x_gc, exact, laws, scale, found, timestep, threads):
    """(Frames, "") or (None, why not)."""
    u, label = frame.units, frame.units.label("time")
    if not 1 <= k < len(traj) - 1:
        return None, "differences between frames need at least 3 frames (9 for three spacings)"
    if kern.jumps:
        return None, ""
    near = {0: frame}
    for m in (1, 2, 4):
        if k - m >= 0 and k + m < len(traj):
            near[m], near[-m] = pot.carriers(traj[k + m]), pot.carriers(traj[k - m])
    times = {m: _time(f, timestep, u) for m, f in near.items()}
    if any(t is None for t in times.values()):
        return None, (
            f"no differences between frames: the trajectory does not say its times: give timestep, the {label} per "
            "step, in [check] "
            "(--set check.timestep=0.001)"
        )
    dt = 0.5 * (times[1] - times[-1])
    order = sorted(near)
    for a, b in itertools.pairwise(order):
        if not times[b] > times[a]:
            return None, (
                f"no differences between frames: time does not increase from {_called(k + a, near[a])} to "
                f"{_called(k + b, near[b])}: joined or appended files?"
            )
    if any(abs(times[m] - times[0] - m * dt) > 1e-6 * dt * abs(m) for m in order):
        gaps = {(a, b): (times[b] - times[a]) / (b - a) for a, b in itertools.pairwise(order)}
        (a, b), (c, d) = max(gaps, key=gaps.get), min(gaps, key=gaps.get)
        most, least = (number(u.to_user("time", gaps[key])) for key in ((a, b), (c, d)))
        return None, (
            f"no differences between frames: frames are not evenly spaced in time: from {_called(k + a, near[a])} to "
            f"{_called(k + b, near[b])} {most} {label} "
            f"a frame, from {_called(k + c, near[c])} to {_called(k + d, near[d])} {least}"
        )
    if any(f.cell != frame.cell for f in near.values()):
        return None, "no differences between frames: the cell changes, its walls do work that is in none of the laws"
    if any(not np.array_equal(f.ids, frame.ids) for f in near.values()):
        return None, "no differences between frames: they do not hold the same atoms"
    if any(f.velocities is None or f.masses is None for f in near.values()):
        return None, "no differences between frames: some have no velocities"
    state = exact.state
    m_n = frame.masses
    heat = float(m_n @ (state.v_nc**2).sum(1))
    heavy = m_n > 0.0  # virtual sites are not
    pull = float(((state.forces_nc[heavy] ** 2).sum(1) / m_n[heavy]).sum())
    frequency = np.sqrt(pull / heat) if heat > 0 else 0.0
    if frequency * dt > CLOSE:
        good, here = (number(u.to_user("time", t)) for t in (0.1 / frequency, dt))
        return None, (
            f"no differences between frames: they are {here} {label} apart, too far for the motion of the atoms; "
            f"{good} {label} or less would do"
        )
    spacings = [m for m in (1, 2, 4) if m in near and m * dt * frequency <= 2 * CLOSE]
    drift = state.drift
    # where the atoms moved on since the middle frame, if time and velocities belong together
    moved = near[1].positions - near[-1].positions - 2 * dt * drift
    moved -= np.where(frame.cell.periodic, np.rint(moved @ frame.cell.inverse), 0.0) @ frame.cell.vectors
    speed2 = float((state.v_nc**2).sum())
    fits = float((moved * state.v_nc).sum()) / (2 * dt * speed2) if speed2 > 0 else 1.0
    if not 0.5 < fits < 2.0:
        return None, (
            f"no differences between frames: atoms move {number(fits)} times as far as their velocities say: frames "
            f"at {number(u.to_user('time', dt))} {label} "
            "do not fit the velocities; check the times (timestep) and units"
        )
    residuals = {}
    for m in spacings:
        sums = [law.sums_of_frame(near[s], pot, x_gc, kern, drift, drift * (s * dt), threads) for s in (-m, m)]
        residuals[m] = law.frame_residuals(laws, exact, *sums, m * dt)
    out = Frames([m * dt for m in spacings])
    dx, dv = _resolution(traj, frame)
    noise = limits.resolution_noise(exact, dx, dv)
    jump = limits.cutoff_noise(exact, found, dt)
    # A smooth motion changes its rates in dt by no more than this share of them, squared in dt or, where atoms cross a
    # jump of φ'', linear.
    cap = 10.0 * (frequency * dt) ** 2 + 10.0 * np.sqrt(heat / m_n.sum()) * dt / kern.radius if kern.smooth else 1e300
    steps = near[1].step - frame.step if frame.step is not None and near[1].step is not None else 1
    for name in ("mass", "momentum", "energy"):
        worst = float(noise[name].max())
        out.outcome[name], out.limits[name] = _extrapolated(
            residuals, spacings, name, scale[name], worst, jump[name], dt, steps, cap * scale[name]
        )
        size = [relative(law.size(residuals[m][name].residual).max(), scale[name]) for m in spacings]
        out.residual[name] = size
        rms = [float(np.sqrt((law.size(residuals[m][name].residual) ** 2).mean())) for m in spacings]
        out.slope[name] = [float(np.log2(b / a)) if a > 0 and b > 0 else 0.0 for a, b in itertools.pairwise(rms)]
    return out, ""


def _extrapolated(residuals, spacings, name, scale, noise, jump, dt, steps, cap):
    """The residual at spacing 0, and what limits it, from residuals R(m) = C + a m² + b m⁴ at one, two or three
    spacings.

    Limits: what the extrapolation leaves; the run's own time step, `steps` times smaller than the spacing of the
    frames; rounding of the file; jumps at the cutoff. The first two are no larger than `cap`, what a smooth motion can
    do. Velocity Verlet solves other equations of motion, x' = v − h² x'''/6 and m x'' = F − m h² x''''/12 to leading
    order: third derivatives, like the error (2h)²/24 f''' = h² f'''/6 of a difference. A field's own third derivative
    has cancellations that those of the atoms have not, hence the factor (1 to 2 is seen).
    """
    r = {m: residuals[m][name].residual for m in spacings}
    without = {m: residuals[m][name].without for m in spacings}
    if len(spacings) == 1:
        value, bare, curvature, integrator = r[1], without[1], np.inf, 0.0
    else:
        value = (4 * r[1] - r[2]) / 3
        bare = None if without[1] is None else (4 * without[1] - without[2]) / 3
        second = law.size(r[2] - r[1]) / 3
        integrator = _VERLET * min(float(second.max()), cap) / max(int(steps), 1) ** 2
        curvature = float((law.size(value - (4 * r[2] - r[4]) / 3) if 4 in r else second).max())
    # two frames, and (4 R(1) − R(2))/3 of their differences
    rounding = 3.0 * noise * 1.4 / (np.sqrt(2.0) * dt)
    parts = {
        "spacing of the frames": min(curvature, cap),
        "time step of the run": integrator,
        "precision of the file": rounding,
        "jumps at the cutoff": 3.0 * 1.4 * jump,
    }
    parts = {what: relative(v, scale) for what, v in parts.items()}
    limit = sum(parts.values())
    worst = relative(law.size(value).max(), scale)
    without = None if bare is None else relative(law.size(bare).max(), scale)
    return Outcome(worst, limit, None if limit > HOPELESS else worst <= max(limit, EXACT), without), parts


def _called(k, frame) -> str:
    return f"frame {k}" if frame.step is None else f"frame {k} (step {frame.step})"


def _time(frame, timestep, u):
    if frame.time is not None:
        return frame.time
    if timestep is not None and frame.step is not None:
        return u.to_internal("time", timestep * frame.step)
    return None


def _resolution(traj, frame) -> tuple[float, float]:
    """Resolution of positions and, taken to have as many digits, of velocities; internal units."""
    dx = float(frame.units.to_internal("length", traj.info()["coordinate_resolution"]))
    largest = float(np.abs(frame.positions).max())
    return dx, (dx / largest if largest > 0 else 0.0) * float(np.abs(frame.velocities).max())
