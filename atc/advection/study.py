"""What ``atc advect`` does: one run with its ledgers, shocks, reference and picture, or a study of the convergence to
the local equation."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..config.formula import formula
from ..errors import AtcError
from ..pictures.drawing import STYLE
from ..readers.whole import whole_text
from ..running.output import explained
from .equation import advect
from .kernel import KERNELS, Kernel
from .reference import cole_hopf
from .solution import AdvectionRun

#: What is longer is no name of a file.
_LONGEST_NAME = 256


@dataclass
class Study:
    """A run (`run`, None for a study of convergence), its dataset, and what to print."""

    dataset: object
    run: AdvectionRun | None = None
    lines: list[str] = field(default_factory=list)


def kernel_shape(text: str):
    """``box``, ``triangle``, ``gaussian``; a formula of s = |z|/horizon on 0 … 1; or a file with two columns, s and
    b(s)."""
    if text in KERNELS:
        return text
    path = Path(text)
    if path.suffix in (".txt", ".csv", ".dat") or (len(text) < _LONGEST_NAME and path.is_file()):
        try:
            text = whole_text(path, "kernel")
            table = np.loadtxt(text.splitlines(), delimiter="," if path.suffix == ".csv" else None, ndmin=2)
        except AtcError as e:
            why = e if path.exists() else f"{path}: no such file"
            raise AtcError(
                f"{why}; --kernel takes {', '.join(KERNELS)}, a formula of s, or a file with two columns"
            ) from None
        except ValueError as e:
            raise AtcError(
                f"{path}: {e}; expected two columns of numbers, s = |z|/horizon from 0 to 1 and b(s); a line of names "
                "begins with #"
            ) from None
        s = table[:, 0]
        shaped = table.shape[1] == 2 and len(table) >= 2
        if not (shaped and (np.diff(s) > 0).all() and s[0] == 0 and abs(s[-1] - 1) <= 1e-9):
            raise AtcError(f"{path}: expected two columns, s increasing from 0 to 1 and b(s) >= 0")

        def tabulated(s):
            return np.interp(s, table[:, 0], table[:, 1])

        return tabulated
    shape = formula(text, "s", "--kernel", KERNELS)
    shape.__name__ = text
    return shape


@dataclass
class Problem:
    """What is solved on one period, as `advect` takes it; `initial` and fluxes other than burgers are formulas of x and
    u, `kernel` and `smoothing_kernel` what `kernel_shape` takes.

    Raises AtcError for what makes no problem.
    """

    initial: str
    length: float
    nodes: int
    kernel: str
    viscosity: float
    flux: str
    two_point: str
    duration: float
    method: str
    safety: float
    smoothing_kernel: str | None = None

    def __post_init__(self):
        length, nodes = self.length, self.nodes
        if not 0 < self.safety <= 1:
            raise AtcError(
                f"--safety {self.safety:g}: expected a part of the stable time step, greater than 0 and at most 1"
            )
        if not 1e-30 < length < 1e30:
            raise AtcError(f"--length {length:g}: expected a period greater than 0 (1e-30 to 1e30)")
        if not 8 <= nodes <= 10_000_000:
            raise AtcError(f"--nodes {nodes}: expected 8 to 10,000,000")
        inner = formula(self.initial, "x", "--initial", L=length)
        self.u0 = lambda x: inner(np.mod(x, length))
        self.psi = "burgers" if self.flux == "burgers" else formula(self.flux, "u", "--flux", ("burgers",))
        self.x, self.dx = np.arange(nodes) * (length / nodes), length / nodes
        bad = ~np.isfinite(self.u0(self.x))
        if bad.any():
            raise AtcError(f"--initial {self.initial!r}: is not a finite number at x = {self.x[np.argmax(bad)]:g}")

    def solve(self, horizon: float, times: int, smoothing_horizon: float | None = None) -> AdvectionRun:
        """The run with a kernel of this horizon, recorded at so many times."""
        smoothing = None if self.smoothing_kernel is None else kernel_shape(self.smoothing_kernel)
        kernel = Kernel(kernel_shape(self.kernel), horizon, self.dx, smoothing, smoothing_horizon)
        how = {k: getattr(self, k) for k in ("duration", "viscosity", "psi", "two_point", "method", "safety")}
        return advect(self.u0(self.x), kernel, times=times, **how)


def run_study(
    problem: Problem, horizon: float, frames: int, reference: bool = True, smoothing_horizon=None, fluxes: bool = False
) -> Study:
    """One run; for Burgers' flux with the local solution beside it (variable ``local``). `smoothing_horizon`: φ_s's own
    reach; `fluxes`: the explicit fluxes too."""
    nodes, viscosity, two_point, kernel = problem.nodes, problem.viscosity, problem.two_point, problem.kernel
    if frames < 2:
        raise AtcError(f"--frames {frames}: expected 2 or more")
    if frames * nodes > 200_000_000:
        raise AtcError(
            f"--frames {frames} of --nodes {nodes}: {frames * nodes:.1e} numbers to keep, expected at most 2e8; take "
            "fewer frames"
        )
    run = problem.solve(horizon, frames, smoothing_horizon)
    ds = run.dataset(fluxes)
    ds.attrs |= {"initial": problem.initial, "flux": problem.flux, "kernel": kernel}
    lines = [
        f"{run.steps} steps of {run.dt_range[0]:.3g} to {run.dt_range[1]:.3g} by {run.method}, kernel {kernel} over "
        f"{run.kernel.neighbors} nodes on either side",
        f"mass: changes by {run.mass_error:.1e} of ∫|u|",
        f"energy: {run.energy_t[0]:.6g} -> {run.energy_t[-1]:.6g}; made by the {two_point} flux "
        f"{run.production_t[-1]:+.3e}, taken by the regularisation {run.dissipation_t[-1]:.3e}; ledger open by "
        f"{np.abs(run.closure_t).max():.1e}",
    ]
    shocks = sorted(run.shocks(), key=lambda s: -s["jump"])
    lines += [
        f"shock at x = {s['position']:.5g}: {s['left']:.4g} -> {s['right']:.4g}, width {s['width']:.3g}, speed "
        f"{s['speed']:.4g}"
        for s in shocks[:3]
    ] or ["no shock at the end"]
    if len(shocks) > 3:
        why = "" if viscosity else " steep falls: oscillations, which no viscosity damps"
        lines.append(f"and {len(shocks) - 3} more{why}")
    if run.stopped:
        why = "; the midpoint flux makes energy at viscosity 0: take the conserving one, or a viscosity"
        lines.append(f"stopped early: {run.stopped}{why if two_point == 'midpoint' and not viscosity else ''}")
    if reference and problem.psi == "burgers" and not run.stopped:
        local, error = cole_hopf(problem.u0, problem.x, float(run.t_t[-1]), viscosity, problem.length)
        what = "local Burgers equation at the last time: " + ("Cole-Hopf" if viscosity else "Hopf-Lax")
        ds["local"] = ("x", local, {"long_name": what, "error": error})
        difference = np.abs(run.u_tn[-1] - local)
        stated = f"Cole-Hopf, itself within {max(error, 1e-16):.0e}" if viscosity else "Hopf-Lax"
        lines.append(
            f"against the local equation ({stated}): largest difference {difference.max():.3e}, rms "
            f"{np.sqrt((difference**2).mean()):.3e}"
        )
    return Study(ds, run, lines)


def convergence_study(problem: Problem, horizons) -> Study:
    """The same problem with several horizons against Cole–Hopf: errors and the observed order."""
    import xarray as xr

    viscosity, duration, x = problem.viscosity, problem.duration, problem.x
    if problem.psi != "burgers":
        raise AtcError("--horizons compares with the Cole-Hopf solution, which only Burgers' flux has")
    if viscosity <= 0:
        raise AtcError(
            "--horizons: give a --viscosity greater than 0; without one the solutions have shocks, where differences "
            "do not fall with the horizon"
        )
    horizons = np.array(sorted({float(h) for h in horizons}, reverse=True))
    if len(horizons) < 2:
        raise AtcError("--horizons: expected two or more")
    local, stated = cole_hopf(problem.u0, x, duration, viscosity, problem.length)
    errors, solutions = [], []
    for h in horizons:
        run = problem.solve(float(h), 2)
        if run.stopped:
            raise AtcError(f"horizon {h:g}: the run {run.stopped}")
        solutions.append(run.u_tn[-1])
        errors.append(float(np.sqrt(np.mean((run.u_tn[-1] - local) ** 2))))
    order = np.full(len(horizons), np.nan)
    order[1:] = np.diff(np.log(errors)) / np.diff(np.log(horizons))
    from .. import __version__

    ds = xr.Dataset(
        {
            "u": (("horizon", "x"), np.array(solutions)),
            "local": ("x", local, {"long_name": "Cole-Hopf", "error": stated}),
            "error": ("horizon", errors, {"long_name": "rms difference"}),
            "order": ("horizon", order),
        },
        {"horizon": ("horizon", horizons), "x": ("x", x)},
        {
            **{key: getattr(problem, key) for key in ("initial", "kernel", "viscosity")},
            **{"two_point_flux": problem.two_point, "time": duration, "atc_version": __version__},
        },
    )
    lines = [f"rms difference from Cole-Hopf (itself within {max(stated, 1e-16):.0e}) at t = {duration:g}"]
    lines += [
        f"  horizon {h:<8g} {e:.4e}" + (f"   order {o:.3f}" if np.isfinite(o) else "")
        for h, e, o in zip(horizons, errors, order)
    ]
    return Study(ds, None, lines)


def picture(study: Study, path: Path) -> Path:
    """A run: space-time map, profiles with the local solution, ledgers. A convergence study: profiles and errors."""
    import matplotlib
    from matplotlib.figure import Figure

    ds = study.dataset
    with matplotlib.rc_context(STYLE):
        fig = Figure(figsize=(12, 3.8), layout="constrained")
        if study.run is None:
            left, right = fig.subplots(1, 2)
            for h, u in zip(ds.horizon.values, ds.u.values):
                left.plot(ds.x, u, label=f"horizon {h:g}")
            left.plot(ds.x, ds.local, "k--", lw=0.8, label="local, Cole–Hopf")
            left.set(xlabel="x", ylabel="u", title=f"t = {ds.attrs['time']:g}")
            left.legend()
            right.loglog(ds.horizon, ds.error, "o-")
            second = ds.error.values[-1] * (ds.horizon / ds.horizon.values[-1]) ** 2
            right.loglog(ds.horizon, second, color="0.6", label="slope 2")
            right.set(xlabel="horizon", ylabel="rms difference from Cole–Hopf")
            right.legend()
        else:
            run = study.run
            a, b, c = fig.subplots(1, 3)
            top = float(np.nanmax(np.abs(ds.u))) or 1.0
            step = max(1, len(run.x_n) // 1500)
            how = {"cmap": "RdBu_r", "vmin": -top, "vmax": top, "shading": "nearest", "rasterized": True}
            a_map = a.pcolormesh(run.x_n[::step], run.t_t, run.u_tn[:, ::step], **how)
            fig.colorbar(a_map, ax=a, label="u")
            a.plot(ds.shock_position, ds.time, "k.", ms=1)
            a.set(xlabel="x", ylabel="time", title="u, and its strongest shock")
            for k in np.unique(np.linspace(0, len(run.t_t) - 1, 5).astype(int)):
                b.plot(run.x_n, run.u_tn[k], label=f"t = {run.t_t[k]:.3g}")
            if "local" in ds:
                b.plot(ds.x, ds.local, "k--", lw=0.8, label="local")
            b.set(xlabel="x", title="u")
            b.legend()
            made = {"energy ∫ u²/2": run.energy_t, "made by the flux": run.production_t}
            for label, values in {**made, "taken by the regularisation": run.dissipation_t}.items():
                c.plot(run.t_t, values, label=label)
            c.plot(run.t_t, run.mass_t, color="0.6", label="mass")
            c.set(xlabel="time", title=f"ledgers; open by {np.abs(run.closure_t).max():.0e}")
            c.legend()
        with explained(path):
            fig.savefig(path, metadata={"Software": None})
    return path
