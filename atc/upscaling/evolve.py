"""Chains in time: velocity Verlet for every model, and the exact modal solution of the linear ones."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from ..errors import AtcError
from .chain import LJ_SPINODAL, LennardJones, Springs, check_boundary, need_nodes, positive, whole

# Neighbours from which a convolution by FFT beats the sum over them, on chains of 10⁴ to 10⁵ nodes (measured; the
# result is the same to rounding).
_FFT_FROM = 100


_DENSITY, _POTENTIAL = "density over density at rest", "potential energy, zero at rest"


@dataclass(frozen=True)
class History:
    """What `verlet` returns: the recorded steps of one run.

    Attributes
    ----------
    x_n : reference positions; t_t : times; dt : time step
    u_tn, v_tn : displacements and velocities
    kinetic_t, potential_t : energies of the whole chain (potential: zero in the reference configuration)
    """

    model: object = field(repr=False)
    boundary: str
    dt: float
    x_n: np.ndarray = field(repr=False)
    t_t: np.ndarray = field(repr=False)
    u_tn: np.ndarray = field(repr=False)
    v_tn: np.ndarray = field(repr=False)
    kinetic_t: np.ndarray = field(repr=False)
    potential_t: np.ndarray = field(repr=False)

    @property
    def total_t(self) -> np.ndarray:
        return self.kinetic_t + self.potential_t

    @property
    def density_tn(self) -> np.ndarray:
        """The paper's colour, (x_{j+1} − x_{j−1})/(y_{j+1} − y_{j−1}); at the ends the chain goes on as its boundary
        says."""
        return relative_density(self.u_tn, self.model.spacing, self.boundary)

    def at(self, t: float) -> np.ndarray:
        """Displacements at any time of the run: a recorded step, else Hermite's cubic between the two around it (fourth
        order in their distance)."""
        times = self.t_t
        if not times[0] - 1e-9 <= t <= times[-1] + 1e-9:
            raise AtcError(f"t = {t:g}: the run has times {times[0]:g} to {times[-1]:g}")
        k = int(np.clip(np.searchsorted(times, t) - 1, 0, len(times) - 2))
        h = times[k + 1] - times[k]
        s = (t - times[k]) / h
        u, v = self.u_tn, self.v_tn
        return (
            (1 + 2 * s) * (1 - s) ** 2 * u[k] + s**2 * (3 - 2 * s) * u[k + 1]
            + h * s * (1 - s) * ((1 - s) * v[k] - s * v[k + 1])
        )  # fmt: skip

    def dataset(self):
        """As an `xarray.Dataset` with dims time, x. Units are the model's own (reduced)."""
        import xarray as xr

        from .. import __version__

        model = self.model
        attrs = {
            "model": model.name,
            **{key: getattr(model, key) for key in ("spacing", "neighbors", "density", "modulus")},
            "boundary": self.boundary,
            "time_step": self.dt,
            "integrator": "velocity Verlet",
            "atc_version": __version__,
            "units": "reduced: length, time and mass in those of the model's spacing, modulus and density",
        }
        return xr.Dataset(
            {
                "displacement": (("time", "x"), self.u_tn, {"units": "length", "long_name": "displacement"}),
                "velocity": (("time", "x"), self.v_tn, {"units": "length/time", "long_name": "velocity"}),
                "relative_density": (("time", "x"), self.density_tn, {"units": "1", "long_name": _DENSITY}),
                "kinetic_energy": ("time", self.kinetic_t, {"units": "energy", "long_name": "kinetic energy"}),
                "potential_energy": ("time", self.potential_t, {"units": "energy", "long_name": _POTENTIAL}),
            },
            {
                "time": ("time", self.t_t, {"units": "time"}),
                "x": ("x", self.x_n, {"units": "length", "long_name": "reference position"}),
            },
            attrs,
        )


def relative_density(u_tn, spacing: float, boundary: str = "periodic") -> np.ndarray:
    """(x_{j+1} − x_{j−1})/(y_{j+1} − y_{j−1}) of displacements (..., n)."""
    u = np.asarray(u_tn, dtype=float)
    if check_boundary(boundary) == "periodic":
        right, left = np.roll(u, -1, axis=-1), np.roll(u, 1, axis=-1)
    else:
        zero = np.zeros((*u.shape[:-1], 1))
        right, left = np.concatenate([u[..., 1:], zero], -1), np.concatenate([zero, u[..., :-1]], -1)
    with np.errstate(divide="ignore"):
        return 2 * spacing / (2 * spacing + right - left)


def _displacements(name: str, u, n: int | None = None) -> np.ndarray:
    u = np.array(u, dtype=float)
    if u.ndim != 1 or (n is not None and len(u) != n) or not np.isfinite(u).all():
        raise AtcError(f"{name}: expected one finite number for each node{f' ({n})' if n is not None else ''}")
    return u


def verlet(
    model,
    u0_n,
    v0_n=None,
    *,
    dt: float,
    steps: int,
    every=1,
    boundary: str = "periodic",
    beyond_spinodal: str = "refuse",
) -> History:
    """Velocity Verlet of a chain.

    Parameters
    ----------
    model : Springs or LennardJones
    u0_n, v0_n : (n,) arrays
        Displacements and velocities at t = 0; at rest if `v0_n` is not given.
    dt, steps : time step, number of steps
    every : int, or a list of step numbers
        Record every that many steps, or those steps (0 and the last are always recorded).
    boundary : "periodic" or "clamped"
    beyond_spinodal : "refuse" or "allow"
        What to do about Lennard-Jones bonds stretched beyond the spinodal, where the chain breaks. Bonds that turn over
        are always refused.

    Raises
    ------
    AtcError
        for an unstable time step of a linear chain; for Lennard-Jones bonds beyond the spinodal or turned over: which,
        when, and what to do.
    """
    if not isinstance(model, Springs | LennardJones):
        raise AtcError(
            f"{type(model).__name__} is not a chain: velocity Verlet moves Springs and LennardJones; continuous "
            "models have atc.upscaling.evolve.modal"
        )
    u0 = _displacements("initial displacements", u0_n)
    n = len(u0)
    v = _displacements("initial velocities", v0_n, n) if v0_n is not None else np.zeros(n)
    dt, steps = positive("dt", dt), whole("steps", steps)
    if np.ndim(every) == 0:
        marks = [*range(0, steps, whole("every", every)), steps]
    else:
        marks = sorted({0, steps, *(whole("every", int(s), 0) for s in every if s <= steps)})
    M = model.neighbors
    need_nodes(n, M, boundary)
    periodic = boundary == "periodic"
    linear = isinstance(model, Springs)
    if linear:
        _require_stable(dt, model.stable_time_step)
        advance = _springs_stepper(model, n, dt, periodic)
    else:
        if beyond_spinodal not in ("refuse", "allow"):
            raise AtcError(f"beyond_spinodal = {beyond_spinodal!r}: expected refuse or allow")
        advance = _lj_stepper(model, n, dt, periodic, LJ_SPINODAL if beyond_spinodal == "refuse" else math.inf)

    u, a = np.zeros(n + 2 * M), np.empty(n)
    u[M : M + n] = u0
    u_tn, v_tn = np.empty((len(marks), n)), np.empty((len(marks), n))
    kinetic, potential = np.empty(len(marks)), np.empty(len(marks))
    done = 0
    advance(u, v, a, 0, 0)
    for row, mark in enumerate(marks):
        if mark > done:
            advance(u, v, a, mark - done, done)
            done = mark
        u_tn[row], v_tn[row] = u[M : M + n], v
        kinetic[row] = 0.5 * model.density * model.spacing * float(v @ v)
        # A quadratic energy from the force at hand: −½ Σ u F, clamped nodes outside included (they are at 0).
        half = -0.5 * model.density * model.spacing
        potential[row] = half * float(u_tn[row] @ a) if linear else model.potential_energy(u_tn[row], boundary)
    x_n, t_t = np.arange(n) * model.spacing, dt * np.array(marks, dtype=float)
    return History(model, boundary, dt, x_n, t_t, u_tn, v_tn, kinetic, potential)


def _require_stable(dt, limit) -> None:
    if not dt < limit:
        why = f"velocity Verlet is unstable at and above 2/ω_max = {limit:.6g} for this model; take a smaller step"
        raise AtcError(f"dt = {dt:g}: {why}")


def _springs_stepper(model, n, dt, periodic):
    from ._chain_kernels import pad, springs_force, springs_verlet

    M = model.neighbors
    w = model.weights / model.density
    if M < _FFT_FROM:

        def advance(u, v, a, steps, done):
            if not steps:
                pad(u, M, periodic)
                springs_force(u, w, a)
            else:
                springs_verlet(u, v, a, w, dt, steps, periodic)

        return advance

    from scipy.fft import irfft, next_fast_len, rfft

    # The padded row, so that neither the ends of the chain nor the length of the transform show: n itself may be a
    # large prime.
    size = next_fast_len(n + 2 * M, real=True)
    stencil = np.zeros(size)
    stencil[0] = -2 * w.sum()
    stencil[1 : M + 1] += w
    stencil[size - M :] += w[::-1]
    symbol = rfft(stencil).real

    def advance(u, v, a, steps, done):
        here = u[M : M + n]
        if not steps:
            pad(u, M, periodic)
            a[:] = irfft(symbol * rfft(u, size), size)[M : M + n]
        for _ in range(steps):
            v += 0.5 * dt * a
            here += dt * v
            pad(u, M, periodic)
            a[:] = irfft(symbol * rfft(u, size), size)[M : M + n]
            v += 0.5 * dt * a

    return advance


def _lj_stepper(model, n, dt, periodic, highest):
    from ._chain_kernels import lj_force, lj_verlet, pad, stretch_range

    M, dx = model.neighbors, model.spacing
    A, B = model.coefficients
    work = np.empty(n + M)

    def check(u, when):
        lo, ilo, hi, ihi = stretch_range(u, M, dx)
        if lo > 0 and hi < highest:
            return
        atom, F = (ilo, lo) if not lo > 0 else (ihi, hi)
        where = f"{when} the bond between nodes {atom} and {atom + 1} (x = {atom * dx:g}) has stretch {F:.4g}"
        if not lo > 0:
            smaller = "or wider" if when == "at the start" else "time step or a smaller"
            raise AtcError(
                f"{where}: neighbours have changed places, which no Lennard-Jones bond allows; take a smaller "
                f"{smaller} initial displacement"
            )
        raise AtcError(
            f"{where}, beyond the spinodal {LJ_SPINODAL:.4f} where bonds lose stiffness: the chain breaks there; take "
            "a smaller or wider "
            "initial displacement, or allow it (beyond_spinodal='allow', --beyond-spinodal allow) and read the result "
            "as a fracture"
        )

    def advance(u, v, a, steps, done):
        if not steps:
            pad(u, M, periodic)
            check(u, "at the start")
            lj_force(u, dx, M, A, B, 1 / model.density, a, work)
            return
        did = lj_verlet(u, v, a, work, dx, M, A, B, 1 / model.density, dt, steps, periodic, 0.0, highest)
        check(u, f"at t = {(done + did) * dt:g}")

    return advance


# --------------------------------------------------------------------------------------------------------------------
# Exact in time.


def modal(
    model, u0_n, times, v0_n=None, *, spacing: float | None = None, boundary: str = "periodic", dt: float | None = None
):
    """The exact solution of a linear model in time: each mode turns with its own frequency.

    Parameters
    ----------
    model : Springs, or a continuous one with `frequency(k)` (`atc.upscaling.continuum`), whose spatial operator then
        acts on the trigonometric interpolant
    u0_n, v0_n : (n,) arrays; at rest if `v0_n` is not given
    times : number or (t,) array
    spacing : float
        Distance of the nodes, for continuous models.
    boundary : "periodic" (FFT), or "clamped" (all modes of its matrix: chains of up to 2048 nodes)
    dt : float, optional
        Give what velocity Verlet with this step gives, in closed form: mode k turns by 2 arcsin(ω dt/2) a step.

    Returns
    -------
    u, v : arrays (n,) or (t, n)
    """
    u0 = _displacements("initial displacements", u0_n)
    n = len(u0)
    v0 = _displacements("initial velocities", v0_n, n) if v0_n is not None else np.zeros(n)
    t_t = np.atleast_1d(np.asarray(times, dtype=float))
    discrete = isinstance(model, Springs)
    if isinstance(model, LennardJones) or not hasattr(model, "frequency"):
        raise AtcError(
            f"{model.name}: only linear models have modes; use its .linearised() for small displacements, or verlet"
        )
    dx = model.spacing if discrete else positive("spacing", spacing, "the distance of the nodes")
    if check_boundary(boundary) == "periodic":
        if discrete:
            need_nodes(n, model.neighbors, boundary)
        omega = model.frequency(2 * np.pi * np.fft.rfftfreq(n, dx))
        forward, back = np.fft.rfft, lambda f: np.fft.irfft(f, n, axis=-1)
    else:
        if not discrete:
            raise AtcError("clamped ends: only chains have them here; a continuous model is solved with periodic ends")
        omega, modes = _clamped_modes(model, n)
        forward, back = (lambda f: modes.T @ f), (lambda f: f @ modes.T)
    a, b = forward(u0), forward(v0)
    if dt is None:
        phase, rate, turn = omega, omega, np.ones_like(omega)
    else:
        dt = positive("dt", dt)
        top = omega.max()
        _require_stable(dt, 2 / top if top != 0 else math.inf)
        phase = 2 * np.arcsin(0.5 * dt * omega) / dt
        rate = np.sin(phase * dt) / dt  # amplitude of the velocity; Verlet's orbit is an ellipse
        turn = np.divide(rate, phase, out=np.ones_like(rate), where=phase > 0)
    angle = phase * t_t[:, None]
    sine = t_t[:, None] * np.sinc(angle / np.pi)  # sin(phase t)/phase, also at phase 0
    u = back(a * np.cos(angle) + b * sine / turn)
    v = back(b * np.cos(angle) - a * rate * phase * sine)
    return (u[0], v[0]) if np.ndim(times) == 0 else (u, v)


def _clamped_modes(model, n):
    from scipy.linalg import eigh, toeplitz

    if n > 2048:
        raise AtcError(
            f"a chain of {n} nodes with clamped ends: all its modes are found for up to 2048 nodes only; use periodic "
            "ends, or verlet"
        )
    row = np.zeros(n)
    row[0] = 2 * model.weights.sum()
    row[1 : model.neighbors + 1] = -model.weights[: n - 1]
    squared, modes = eigh(toeplitz(row) / model.density)
    return model.roots(squared, squared[-1]), modes


def relative_error(u, exact) -> float:
    """‖u − exact‖₂ / ‖exact‖₂."""
    exact = np.asarray(exact, dtype=float)
    return float(np.linalg.norm(np.asarray(u, dtype=float) - exact) / np.linalg.norm(exact))


def count_steps(duration: float, dt: float) -> int:
    """⌊duration/dt⌋, a whole quotient not lost to rounding: the paper's N_t."""
    return math.floor(positive("duration", duration) / positive("dt", dt) * (1 + 1e-12))
