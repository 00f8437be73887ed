"""``atc check``: do the fields of this trajectory, potential and kernel obey the balance laws, how well, and what limits it?

The physics is in `atc.estimators.balance`; here are the choice of points and frames, what counts as holding, the table and the verdict.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field

import numpy as np

from .errors import AtcError
from .estimators import balance as law
from .estimators.accuracy import kernel_internal

#: A law in closed form leaves rounding only: 1e-13 or so of the largest term, more where forces cancel.
EXACT = 1e-9
#: Divergences by differences hold within this many times their own error estimate (or EXACT, if that is larger).
DIFFERENCES = 30.0
#: Nothing is said about a law when the error of a test is more than this share of the largest term.
HOPELESS = 0.05
#: Largest distance between frames, times the mean frequency √(Σ F²/m / Σ m v²) of the atoms, of which differences make sense.
CLOSE = 0.5
_NAMES = {"mass": "mass", "momentum": "momentum", "energy": "energy", "churning": "div z = 0"}


@dataclass
class Outcome:
    """One law by one way: residual, its limit, both relative to the law's largest term; `holds` is None where it cannot be decided."""

    residual: float
    limit: float
    holds: bool | None
    without: float | None = None
    rms: float = 0.0


@dataclass
class Frames:
    """The laws from differences between frames, by spacing; all relative to the largest term, internal units for times."""

    dt: list[float]
    residual: dict[str, list[float]] = field(default_factory=dict)
    slope: dict[str, list[float]] = field(default_factory=dict)
    outcome: dict[str, Outcome] = field(default_factory=dict)
    limits: dict[str, dict[str, float]] = field(default_factory=dict)


@dataclass
class Report:
    """What `check` found. `ok` is False if a law is broken; `lines` is the verdict, `data` everything as plain values."""

    title: str
    ok: bool
    verdict: list[str]
    rows: list[list[str]]
    notes: list[str]
    data: dict

    def json(self) -> str:
        return json.dumps(self.data | {"holds": self.ok, "verdict": self.verdict, "notes": self.notes}, indent=2)

    def print(self, console) -> None:
        console.print(self.title, soft_wrap=True)
        widths = [max(len(r[c]) for r in self.rows) for c in range(len(self.rows[0]))]
        for row in self.rows:
            console.print("  " + "  ".join(f"{cell:<{w}}" for cell, w in zip(row, widths, strict=True)).rstrip(), soft_wrap=True)
        for line in self.verdict:
            console.print(line, soft_wrap=True)
        for note in self.notes:
            console.print(f"note: {note}", soft_wrap=True)


def check_scene(scene, jobs: int = 1) -> Report:
    """`check` with what a scene says: its trajectory, potential, kernel, grid and [check] section."""
    for section, example in (("potential", 'lammps = """pair_style ..."""'), ("kernel", 'name = "quartic" and radius = 8.0')):
        if section not in scene.data:
            raise AtcError(f"{scene.name}: no [{section}] section: the balance laws need one, e.g. {example}")
    options = scene.data.get("check", {})
    traj = scene.trajectory()
    pot, kern, grid = scene.potential(), scene.kernel(), scene.grid()
    return check(traj, pot, kern, grid, threads=jobs or os.cpu_count() or 1, **options)


def check(traj, pot, kern, grid=None, *, points: int = 20, seed: int = 0, timestep: float | None = None, threads: int = 1) -> Report:
    """Residuals of the balance laws of mass, momentum and energy and of ∇·z = 0, on the frame in the middle of a trajectory.

    Parameters
    ----------
    traj : trajectory, Frame or anything `atc.read` takes. With at least 3 frames close in time, rates are also taken as differences between
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
    from . import read

    traj = read(traj)
    n_frames = len(traj)
    if not n_frames:
        raise AtcError(f"{traj.source}: holds no complete frame")
    k = n_frames // 2
    frame = traj[k]
    frame.require("masses", "velocities", why="a balance law")
    if not len(frame):
        raise AtcError(f"{frame.source}: holds no atoms: there is nothing to check")
    kern_in = kernel_internal(kern, frame.units)
    notes: list[str] = []
    bound = None
    if grid is not None:
        bound = grid.bind(frame.units, frame.cell, frame.positions)
        if bound.kind == "slab":
            notes.append("a slab profile has no points of its own: random points only")
            bound = None
    if law.jumps(kern_in):
        notes.append(
            f"kernel {kern_in.name!r} jumps: its fields change by jumps when an atom enters or leaves, which no rate at a point sees"
        )

    x_gc, n_random = law.choose_points(frame, kern_in, points, np.random.default_rng([20240301, seed]), bound)
    if n_random < points:
        notes.append(f"only {n_random} of {points} random points keep clear of the kernel's kinks")
    h = law.step_length(kern_in)
    stencils = law.stencil(x_gc, h)
    deposit = law.deposit_at(stencils, kern_in, frame.cell, threads)
    state = _motion(frame, pot, threads, deposit)
    fields = law.deposited(state, deposit)
    exact = law.Exact(law.Sites(x_gc, frame.positions, frame.cell, kern_in), state, fields.pop("bonds")[::19])
    laws = exact.laws()
    still = frame.replace(velocities=state.v_nc)
    written = law.from_fields(still, pot, kern, stencils, threads)
    apart = {name: _relative(np.abs(a - fields[name]).max(), np.abs(fields[name]).max()) for name, a in written.items()}
    by_fields = law.field_laws(laws, exact, fields | written, h)

    scale = {name: x.largest[1] for name, x in laws.items()}
    closed = {name: _outcome(x, scale[name], np.zeros(1)) for name, x in laws.items()}
    stencil = {name: _outcome(x, scale[name], x.limit, DIFFERENCES) for name, x in by_fields.items()}
    source_error, source_limit, jumped = law.energy_rates(frame, pot, state, threads)
    found = law.cutoff_jumps(frame, pot, threads)
    # 1e-9: what rounding leaves of z where a pair potential has none
    churns = bool(np.abs(exact.z).max() > 1e-9 * np.abs(exact.S).max())
    frames, why = _frames(traj, k, frame, pot, kern_in, x_gc, exact, laws, scale, found, timestep, threads)
    if why:
        notes.append(why)
    return _report(
        traj,
        k,
        frame,
        state.forces_nc,
        kern,
        laws,
        closed,
        stencil,
        frames,
        apart,
        (source_error, source_limit, jumped),
        found,
        n_random,
        len(x_gc),
        churns,
        notes,
        state.notes,
    )


def _motion(frame, pot, threads, deposit):
    try:
        return law.motion(frame, pot, threads, deposit)
    except NotImplementedError as e:
        raise AtcError(f"the energy balance needs the derivatives of each atom's energy, which are not there for: {e}") from None


def _relative(a, b) -> float:
    return float(a / b) if b > 0 else 0.0 if a == 0 else float("inf")


def _outcome(x, scale, limit, times=1.0) -> Outcome:
    """How a law does against `scale`; it holds below EXACT or `times` its limit."""
    worst = _relative(law.size(x.residual).max(), scale)
    bound = _relative(np.max(limit), scale)
    rms = _relative(np.sqrt(np.mean(law.size(x.residual) ** 2)), scale)
    without = None if x.without is None else _relative(law.size(x.without).max(), scale)
    allowed = max(EXACT, times * bound)
    return Outcome(worst, bound, None if allowed > HOPELESS else worst <= allowed, without, rms)


# ---- differences between frames


def _frames(traj, k, frame, pot, kern, x_gc, exact, laws, scale, found, timestep, threads):
    """(Frames, "") or (None, why not)."""
    u, label = frame.units, frame.units.label("time")
    if not 1 <= k < len(traj) - 1:
        return None, "differences between frames need at least 3 frames (9 for three spacings)"
    if law.jumps(kern):
        return None, ""
    near = {0: frame}
    for m in (1, 2, 4):
        if k - m >= 0 and k + m < len(traj):
            near[m], near[-m] = traj[k + m], traj[k - m]
    times = {m: _time(f, timestep, u) for m, f in near.items()}
    if any(t is None for t in times.values()):
        return None, (
            f"no differences between frames: the trajectory does not say its times: give timestep, the {label} per step, in [check] "
            "(--set check.timestep=0.001)"
        )
    dt = 0.5 * (times[1] - times[-1])
    if not dt > 0:
        return None, "no differences between frames: time does not increase"
    if any(abs(times[m] - times[0] - m * dt) > 1e-6 * dt * abs(m) for m in near):
        return None, "no differences between frames: frames are not evenly spaced in time"
    if any(f.cell != frame.cell for f in near.values()):
        return None, "no differences between frames: the cell changes, its walls do work that is in none of the laws"
    if any(f.velocities is None or f.masses is None for f in near.values()):
        return None, "no differences between frames: some have no velocities"
    state = exact.state
    m_n = frame.masses
    heat = float(m_n @ (state.v_nc**2).sum(1))
    frequency = np.sqrt(float(((state.forces_nc**2).sum(1) / m_n).sum()) / heat) if heat > 0 else 0.0
    if frequency * dt > CLOSE:
        good, here = (_g(u.to_user("time", t)) for t in (0.1 / frequency, dt))
        return (
            None,
            f"no differences between frames: they are {here} {label} apart, too far for the motion of the atoms; {good} {label} or less would do",
        )
    spacings = [m for m in (1, 2, 4) if m in near and m * dt * frequency <= 2 * CLOSE]
    drift = state.drift
    # where the atoms moved on since the middle frame, if time and velocities belong together
    moved = near[1].positions - near[-1].positions
    moved -= np.where(frame.cell.periodic, np.rint(moved @ frame.cell.inverse), 0.0) @ frame.cell.vectors
    speed2 = float((frame.velocities**2).sum())
    fits = float((moved * frame.velocities).sum()) / (2 * dt * speed2) if speed2 > 0 else 1.0
    if len(near[1]) != len(frame) or not np.array_equal(near[1].ids, near[-1].ids):
        fits = 1.0
    if not 0.5 < fits < 2.0:
        return None, (
            f"no differences between frames: atoms move {_g(fits)} times as far as their velocities say: frames at {_g(u.to_user('time', dt))} {label} "
            "do not fit the velocities; check the times (timestep) and units"
        )
    residuals = {}
    for m in spacings:
        sums = [law.sums_of_frame(near[s], pot, x_gc, kern, drift, drift * (s * dt), threads) for s in (-m, m)]
        residuals[m] = law.frame_residuals(laws, exact, *sums, m * dt)
    out = Frames([m * dt for m in spacings])
    dx, dv = _resolution(traj, frame)
    noise = law.resolution_noise(exact, dx, dv)
    jump = law.cutoff_noise(exact, found, dt)
    steps = near[1].step - frame.step if frame.step is not None and near[1].step is not None else 1
    for name in ("mass", "momentum", "energy"):
        out.outcome[name], out.limits[name] = _extrapolated(
            residuals, spacings, name, scale[name], noise[name], jump if name == "energy" else 0.0, dt, steps
        )
        size = [_relative(law.size(residuals[m][name].residual).max(), scale[name]) for m in spacings]
        out.residual[name] = size
        rms = [float(np.sqrt((law.size(residuals[m][name].residual) ** 2).mean())) for m in spacings]
        out.slope[name] = [float(np.log2(b / a)) if a > 0 and b > 0 else 0.0 for a, b in zip(rms, rms[1:])]
    return out, ""


def _extrapolated(residuals, spacings, name, scale, noise_g, jump, dt, steps):
    """The residual at spacing 0, and what limits it, from residuals R(m) = C + a m² + b m⁴ at one, two or three spacings.

    Limits: what the extrapolation leaves; the run's own time step, which is `steps` times smaller than the spacing of the frames (velocity
    Verlet's error is of second order in it, and no larger than that of differences at that spacing); rounding of the file; jumps at the cutoff.
    """
    r = {m: residuals[m][name].residual for m in spacings}
    without = {m: residuals[m][name].without for m in spacings}
    if len(spacings) == 1:
        value, bare = r[1], without[1]
        # nothing to tell a(Δt) from: the rates' own change, (Ω Δt)² of them at most
        curvature = np.full(1, HOPELESS * scale * 2)
        integrator = 0.0
    else:
        value = (4 * r[1] - r[2]) / 3
        bare = None if without[1] is None else (4 * without[1] - without[2]) / 3
        second = law.size(r[2] - r[1]) / 3
        integrator = float(second.max()) / max(int(steps), 1) ** 2
        curvature = law.size(value - (4 * r[2] - r[4]) / 3) if 4 in r else second
    # two frames, and (4 R(1) − R(2))/3 of their differences
    rounding = 3.0 * float(noise_g.max()) * 1.4 / (np.sqrt(2.0) * dt)
    parts = {
        "spacing of the frames": float(curvature.max()),
        "time step of the run": integrator,
        "precision of the file": rounding,
        "jumps at the cutoff": 3.0 * 1.4 * jump,
    }
    parts = {what: _relative(v, scale) for what, v in parts.items()}
    limit = sum(parts.values())
    worst = _relative(law.size(value).max(), scale)
    without = None if bare is None else _relative(law.size(bare).max(), scale)
    return Outcome(worst, limit, None if limit > HOPELESS else worst <= max(limit, EXACT), without), parts


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


# ---- the words


def _g(v) -> str:
    return f"{v:.3g}"


def _e(v) -> str:
    return "0" if v == 0 else f"{v:.1e}"


def _percent(v: float) -> str:
    return f"{100 * v:.2g} %" if v >= 1e-4 else _e(v)


def _report(
    traj, k, frame, state_forces, kern, laws, closed, stencil, frames, apart, sources, found, n_random, n_points, churns, notes, remarks
) -> Report:
    u = frame.units
    unit = {name: _unit(u, name) for name in laws}
    header = ["law", "largest term", "chain rule", "fields", *(["frames", "order in dt"] if frames else [])]
    rows = [header]
    data = {
        "frame": k,
        "atoms": len(frame),
        "points": {"random": n_random, "grid": n_points - n_random},
        "kernel": kern.describe(),
        "laws": {},
    }
    broken, doubtful = [], []
    for name, x in laws.items():
        term, largest = x.largest
        factor, label = unit[name]
        entry = {
            "largest_term": term,
            "largest": largest * factor,
            "units": label,
            "chain_rule": _plain(closed[name]),
            "fields": _plain(stencil[name]),
        }
        ways = {"chain rule": closed[name], "fields": stencil[name]}
        row = [_NAMES[name], f"{term} {_g(largest * factor)} {label}", _e(closed[name].residual), _e(stencil[name].residual)]
        if frames:
            if name in frames.outcome:
                ways["frames"] = frames.outcome[name]
                row += [_e(frames.outcome[name].residual), ", ".join(f"{s:.2f}" for s in frames.slope[name]) or "-"]
                entry["frames"] = _plain(frames.outcome[name]) | {
                    "dt": [u.to_user("time", t) for t in frames.dt], "residuals": frames.residual[name], "order": frames.slope[name],
                    "limits": frames.limits[name],
                }  # fmt: skip
            else:
                row += ["", ""]
        rows.append(row)
        if name == "energy":
            extra = ["  without churning", "", _e(closed[name].without), _e(stencil[name].without)]
            rows.append(extra + ([_e(frames.outcome[name].without), ""] if frames else []))
        data["laws"][name] = entry
        broken += [(name, way, o) for way, o in ways.items() if o.holds is False]
        doubtful += [(name, way, o) for way, o in ways.items() if o.holds is None]
    error, limit, jumped = sources
    sources_hold = error <= max(30 * limit, 1e-8)
    data["energy_sources"] = {"error": error, "limit": limit, "atoms_left_out": jumped}
    data["fields_against_own_sums"] = apart
    fields_agree = all(v <= EXACT for v in apart.values())
    forces = _forces(frame, state_forces)
    verdict = _verdict(laws, closed, stencil, frames, broken, doubtful, churns, u)
    if not sources_hold:
        verdict.append(
            f"BROKEN: the energy sources are not the derivatives of the atoms' energies: off by {_percent(error)} of the largest"
        )
    if not fields_agree:
        worst = max(apart, key=apart.get)
        verdict.append(f"BROKEN: the field {worst} differs from an independent sum by {_percent(apart[worst])} of its largest value")
    data["cutoff_jumps"] = []
    for j in sorted(found, key=lambda j: -abs(j.energy)):
        rate = j.crossings * u.time
        data["cutoff_jumps"].append(
            {"style": j.name, "cutoff": u.to_user("length", j.cutoff), "energy": u.to_user("energy", j.energy), "crossings_per_time": rate}
        )
    if found:
        j = max(found, key=lambda j: abs(j.energy) * j.crossings)
        notes.append(
            f"{j.name} ends at its cutoff ({_g(u.to_user('length', j.cutoff))} {u.label('length')}) with an energy of {_g(u.to_user('energy', j.energy))} "
            f"{u.label('energy')}: about {_g(j.crossings * u.time)} pairs a {u.label('time')} cross it, and the energy of the run jumps by that much each time"
        )
    if jumped:
        notes.append(f"{jumped} atoms were left out of the test of the energy sources: pairs crossed the cutoff within it")
    notes += [f"{what}: {count}" for what, count in remarks.items()]
    if forces is not None:
        data["forces_in_file"] = forces
        notes.append(f"forces of the potential and forces in the file differ by {_percent(forces)} of the largest")
    ok = not broken and sources_hold and fields_agree
    many = f"{n_random} random points" + (f" and {n_points - n_random} points of the grid" if n_points > n_random else "")
    title = f"{traj.source}, frame {k}, {len(frame)} atoms; kernel {kern.describe()}; {many}"
    return Report(title, ok, verdict, rows, notes, data)


def _unit(u, name) -> tuple[float, str]:
    """Factor from internal units and label of a law's terms."""
    above, below = law.DIMENSIONS[name]
    if below is None:
        return u.to_user(above, 1.0), u.label(above)
    label = u.label(below)
    return u.to_user(above, 1.0) / u.to_user(below, 1.0), f"{u.label(above)}/{label}"


def _plain(o: Outcome) -> dict:
    out = {"residual": o.residual, "limit": o.limit, "holds": o.holds}
    return out if o.without is None else out | {"without_churning": o.without}


def _forces(frame, forces_nc) -> float | None:
    """Largest difference between the potential's forces and those of the file, relative to the largest; None if the file has none."""
    if frame.forces is None:
        return None
    return _relative(np.abs(forces_nc - frame.forces).max(), np.abs(frame.forces).max())


_WAYS = {"chain rule": "in closed form", "fields": "from the fields on stencils", "frames": "from differences between frames"}
_SUSPECTS = {
    "chain rule": "forces, stress and energy sources do not belong to each other: an error of atc",
    "fields": "the deposited fields are not the sums they should be: an error of atc",
    "frames": "is the potential that of the run, the run free of thermostats, walls and other outside forces, and are units, masses and times right?",
}


def _verdict(laws, closed, stencil, frames, broken, doubtful, churns, u) -> list[str]:
    out = []
    bad = {name for name, _, _ in broken}
    for name in laws:
        if name in bad:
            continue
        sure = [o for o in (closed[name], stencil[name]) if o.holds]
        residual = max(o.residual for o in sure)
        what = "div z = 0" if name == "churning" else f"{name} balance"
        out.append(f"{what} holds to {_e(residual)} of its largest term")
        if name == "energy":
            without = max(o.without for o in sure)
            if not churns:
                out[-1] += "; there is no churning heat flux (as for every pair potential)"
            elif without > 2 * residual:
                out[-1] += f"; without the churning heat flux it would be off by {_percent(without)}"
    if frames:
        label = u.label("time")
        shown = ", ".join(_g(u.to_user("time", t)) for t in frames.dt)
        held = [name for name, o in frames.outcome.items() if o.holds]
        if held:
            worst = max(held, key=lambda name: frames.outcome[name].residual)
            o = frames.outcome[worst]
            main = max(frames.limits[worst], key=frames.limits[worst].get)
            text = f"frames {shown} {label} apart: {', '.join(held)} hold to {_e(o.residual)} ({worst}; limited to {_e(o.limit)} by the {main})"
            slopes = [s[0] for s in frames.slope.values() if s]
            if slopes:
                text += f"; residuals fall with the spacing to the power {min(slopes):.2f}" + (
                    f" to {max(slopes):.2f}" if max(slopes) - min(slopes) >= 0.005 else ""
                )
            out.append(text)
    for name, way, o in broken:
        what = "div z = 0" if name == "churning" else f"{name} balance"
        out.append(
            f"BROKEN: {what} {_WAYS[way]}: off by {_percent(o.residual)} of its largest term, {_e(o.limit)} can be explained: {_SUSPECTS[way]}"
        )
    for name, way, o in doubtful:
        what = "div z = 0" if name == "churning" else f"{name} balance"
        out.append(
            f"undecided: {what} {_WAYS[way]}: off by {_percent(o.residual)}, but the test itself is only good to {_percent(o.limit)}"
        )
    return out
