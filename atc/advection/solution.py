"""What a run of nonlocal advection gives: the solution, its ledgers, explicit fluxes and shocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from .kernel import Kernel


@dataclass(frozen=True)
class AdvectionRun:
    """What `advect` returns.

    Attributes
    ----------
    x_n, t_t, u_tn : grid, recorded times, solution
    mass_t, energy_t : ∫ u dx, ∫ u²/2 dx
    production_t, dissipation_t : energy made by the flux and taken by the regularisation since t = 0 (the entropy
        ledger: energy_t = energy_0 + production − dissipation)
    steps, dt_range : steps taken, smallest and largest time step
    stopped : why the run ended early, or ""
    """

    kernel: Kernel
    flux: str
    two_point: str
    viscosity: float
    method: str
    x_n: np.ndarray = field(repr=False)
    t_t: np.ndarray = field(repr=False)
    u_tn: np.ndarray = field(repr=False)
    mass_t: np.ndarray = field(repr=False)
    energy_t: np.ndarray = field(repr=False)
    production_t: np.ndarray = field(repr=False)
    dissipation_t: np.ndarray = field(repr=False)
    steps: int
    dt_range: tuple[float, float]
    stopped: str
    psi: Callable = field(repr=False)

    @property
    def closure_t(self) -> np.ndarray:
        """What the entropy ledger does not account for, over the energy at t = 0: the error of the time integration
        (rounding, with relaxation)."""
        return (self.energy_t - self.energy_t[0] - self.production_t + self.dissipation_t) / max(
            self.energy_t[0], np.finfo(float).tiny
        )

    @property
    def mass_error(self) -> float:
        """Largest change of mass, over ∫|u| dx at t = 0."""
        size = np.abs(self.u_tn[0]).sum() * (self.x_n[1] - self.x_n[0])
        return float(np.abs(self.mass_t - self.mass_t[0]).max() / max(size, np.finfo(float).tiny))

    def fluxes(self, frame: int = -1):
        """The explicit fluxes of one recorded time at x + Δx/2 (R 2.0.9a and its counterpart of the regularisation).

        Returns
        -------
        f (n,), g (n,) : f_{i+½} = Δx Σ_m φ_a(mΔx) Σ F(u_k, u_{k+m}) over the pairs that straddle the face, and g alike
            with −ε φ_s (u_{k+m} − u_k): u_t = −[(f + g)_{i+½} − (f + g)_{i−½}]/Δx exactly as the run has it.
        """
        u, kernel, dx = self.u_tn[frame], self.kernel, self.kernel.spacing
        n, f, g = len(u), np.zeros(len(u)), np.zeros(len(u))
        nodes, weights = np.polynomial.legendre.leggauss(1 if self.two_point == "midpoint" else 8)
        for m, (a, s) in enumerate(zip(kernel.odd_m, kernel.even_m), 1):
            step = np.roll(u, -m) - u
            pair = sum(0.5 * w * self.psi(u + 0.5 * (q + 1) * step) for q, w in zip(nodes, weights))
            for total, part in ((f, a * pair), (g, -self.viscosity * s * step)):
                # Σ over k = i − m + 1 … i, around the period.
                running = np.cumsum(np.concatenate([[0.0], part[n - m + 1 :], part]))
                total += running[m : m + n] - running[:n]
        return dx * f, dx * g

    def shocks(self, frame: int = -1) -> list[dict]:
        """Shocks of one recorded time: see `find_shocks`."""
        return find_shocks(self.x_n, self.u_tn[frame], self.psi)

    def dataset(self, fluxes: bool = False):
        """As an `xarray.Dataset` with dims time, x; with `fluxes` those of `fluxes` too, on x_face = x + Δx/2."""
        import xarray as xr

        from .. import __version__

        main = [max(find_shocks(self.x_n, u, self.psi), key=lambda s: s["jump"], default=None) for u in self.u_tn]
        shock = {
            "position": "steepest descent of the strongest shock",
            "jump": "u left of it minus u right of it",
            "width": "jump over steepest slope",
            "speed": "Rankine-Hugoniot speed of its two states",
        }
        series = {
            "mass": (self.mass_t, "integral of u"),
            "energy": (self.energy_t, "integral of u^2/2"),
            "production": (self.production_t, "energy made by the flux since t = 0"),
            "dissipation": (self.dissipation_t, "energy taken by the regularisation since t = 0"),
            "closure": (self.closure_t, "what the entropy ledger does not account for, over the energy at t = 0"),
            **{f"shock_{k}": (np.array([s[k] if s else np.nan for s in main]), what) for k, what in shock.items()},
        }
        called = lambda shape: shape if isinstance(shape, str) else getattr(shape, "__name__", "function")  # noqa: E731
        attrs = {
            "equation": "u_t + int F(u(x),u(y)) phi_a(y-x) dy = viscosity int (u(y)-u(x)) phi_s(y-x) dy",
            "flux": self.flux,
            "two_point_flux": self.two_point,
            "kernel": called(self.kernel.shape),
            "horizon": self.kernel.horizon,
            "viscosity": self.viscosity,
            "method": self.method,
            "integrator": "SSP-RK3",
            "steps": self.steps,
            "smallest_time_step": self.dt_range[0],
            "largest_time_step": self.dt_range[1],
            "stopped": self.stopped,
            "atc_version": __version__,
        }
        explicit, faces = {}, {}
        if fluxes:
            both = np.array([self.fluxes(k) for k in range(len(self.t_t))])
            faces = {"x_face": ("x_face", self.x_n + 0.5 * self.kernel.spacing)}
            explicit = {
                "advective_flux": (("time", "x_face"), both[:, 0], {"long_name": "nonlocal flux of advection"}),
                "regularising_flux": (("time", "x_face"), both[:, 1], {"long_name": "flux of the regularisation"}),
            }
        if not self.kernel.smoothed_alike:
            own, reach = self.kernel.smoothing_shape, self.kernel.smoothing_horizon
            attrs["smoothing_kernel"] = called(self.kernel.shape if own is None else own)
            attrs["smoothing_horizon"] = self.kernel.horizon if reach is None else reach
        return xr.Dataset(
            {
                **explicit,
                "u": (("time", "x"), self.u_tn, {"long_name": "solution"}),
                **{name: ("time", values, {"long_name": what}) for name, (values, what) in series.items()},
            },
            {"time": ("time", self.t_t), "x": ("x", self.x_n), **faces},
            attrs,
        )


def burgers_flux(u):
    """ψ(u) = u²/2."""
    return 0.5 * u * u


def find_shocks(x_n, u_n, psi=burgers_flux, steepness: float = 0.2) -> list[dict]:
    """Shocks of a profile on a periodic grid: places where u falls more steeply than `steepness` times the steepest
    fall, and at least 5 times the mean slope of its range over the period.

    Returns
    -------
    list of dict, from left to right
        ``position``; ``left``, ``right``: u where the slope has fallen to a tenth, ``jump`` = left − right; ``width`` =
        jump/slope; ``speed`` = (ψ(left) − ψ(right))/jump (Rankine–Hugoniot).
    """
    u, x = np.asarray(u_n, dtype=float), np.asarray(x_n, dtype=float)
    n, dx = len(u), x[1] - x[0]
    slope = (np.roll(u, -1) - np.roll(u, 1)) / (2 * dx)
    steepest = -slope.min()
    if not (np.isfinite(steepest) and steepest > 5 * (u.max() - u.min()) / (n * dx)):
        return []
    found = []
    lowest = (slope < np.roll(slope, 1)) & (slope <= np.roll(slope, -1)) & (slope < -steepness * steepest)
    for i in np.flatnonzero(lowest):
        left = right = 0
        while left < n // 2 and slope[(i - left) % n] < 0.1 * slope[i]:
            left += 1
        while right < n // 2 and slope[(i + right) % n] < 0.1 * slope[i]:
            right += 1
        a, b = u[(i - left) % n], u[(i + right) % n]
        if a - b <= 0.05 * (u.max() - u.min()):
            continue
        before, here, after = slope[i - 1], slope[i], slope[(i + 1) % n]
        curvature = before - 2 * here + after
        shift = 0.5 * (before - after) / curvature if curvature > 0 else 0.0
        speed = (psi(np.array([a]))[0] - psi(np.array([b]))[0]) / (a - b)
        found.append(
            {
                "position": float((x[i] + shift * dx - x[0]) % (n * dx) + x[0]),
                "left": float(a),
                "right": float(b),
                "jump": float(a - b),
                "width": float((a - b) / -here),
                "speed": float(speed),
            }
        )
    return found
