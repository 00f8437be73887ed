"""Nonlocal advection in one dimension on a periodic domain: nonlocal Burgers and any other flux, inviscid and
regularised.

u_t + ∫ F(u(x), u(y)) φ_a(y − x) dy = ε ∫ (u(y) − u(x)) φ_s(y − x) dy,  φ_a odd, φ_s even and ≥ 0, F(a, b) = F(b, a),
F(u, u) = ψ(u).

With ∫ z φ_a dz = 2 and ∫ z² φ_s dz = 2 the limit of a vanishing horizon is u_t + ψ(u)_x = ε u_xx. (Parks et al., LDRD
report, chapter 2, eqs. 2.0.5, 2.0.14; its 2.0.7 lacks the factor 2, its 2.0.15 has the opposite sign and would be
ill-posed.) Two fluxes: `midpoint`, F = ψ((a+b)/2), the report's; and `conserving`, F = ∫₀¹ ψ(a + s(b−a)) ds, for which
∫ u²/2 is constant at ε = 0. Both conserve mass. The midpoint flux is not entropy-stable: at ε = 0
it takes or makes energy, and after a few shock times has multiplied it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..errors import AtcError

KERNELS = ("box", "triangle", "gaussian")
FLUXES = ("midpoint", "conserving")
_SHAPES: dict[str, tuple[Callable, float]] = {
    # even profiles b(|z|/δ), and where they end in units of δ
    "box": (lambda s: np.ones_like(s), 1.0),
    "triangle": (lambda s: 1 - s, 1.0),
    "gaussian": (lambda s: np.exp(-4.5 * s * s), 3.0),  # standard deviation δ/3, cut where it is 3e-18
}
# Along the axes, SSP-RK3's region of absolute stability ends at −2.5127 and ±1.7320i.
_REAL_LIMIT, _IMAGINARY_LIMIT = 2.5127, math.sqrt(3)
_FFT_FROM = 200  # stencil half-width from which Burgers by FFT is faster (measured on 4096 nodes)


@dataclass(frozen=True)
class Kernel:
    """Discrete φ_a(z) = C z b(|z|/δ) and φ_s(z) = C b(|z|/δ) on a grid, both with their moments exactly 2; φ_s has a
    profile and a horizon of its own where they are given.

    Parameters
    ----------
    shape : str or function
        ``box``, ``triangle``, ``gaussian`` (standard deviation δ/3), or b(s) ≥ 0 on 0 ≤ s ≤ 1, vectorised.
    horizon : float
        δ.
    spacing : float
        Of the grid. Weights are cell averages of b, so δ need not be a multiple; it has to reach the next node.
    smoothing_shape, smoothing_horizon : of φ_s, by default those of φ_a
    """

    shape: str | Callable
    horizon: float
    spacing: float
    smoothing_shape: str | Callable | None = None
    smoothing_horizon: float | None = None

    def __post_init__(self):
        for name in ("horizon", "spacing", "smoothing_horizon"):
            value = getattr(self, name)
            if value is None and name == "smoothing_horizon":
                continue
            if not (isinstance(value, (int, float, np.number)) and math.isfinite(value) and value > 0):
                raise AtcError(f"{name} = {value!r}: expected a length greater than 0")
        for shape in (self.shape, self.smoothing_shape):
            if isinstance(shape, str) and shape not in _SHAPES:
                raise AtcError(f"kernel {shape!r}: expected {', '.join(KERNELS)} or a function")

    @property
    def smoothed_alike(self) -> bool:
        """Whether φ_s has the profile and horizon of φ_a."""
        return self.smoothing_shape is None and self.smoothing_horizon is None

    @cached_property
    def profile_m(self) -> np.ndarray:
        """C b of φ_a averaged over the cells m = 1 … M, times the spacing."""
        return self._profile(self.shape, self.horizon)

    @cached_property
    def smoothing_m(self) -> np.ndarray:
        """C b of φ_s averaged over its cells, times the spacing."""
        if self.smoothed_alike:
            return self.profile_m
        shape = self.shape if self.smoothing_shape is None else self.smoothing_shape
        return self._profile(shape, self.horizon if self.smoothing_horizon is None else self.smoothing_horizon)

    def _profile(self, shape, horizon):
        b, end = _SHAPES[shape] if isinstance(shape, str) else (shape, 1.0)
        reach, dx = horizon * end, self.spacing
        M = math.ceil(reach / dx - 0.5 - 1e-9)
        if M < 1:
            raise AtcError(
                f"horizon = {horizon:g}: does not reach the next node at {dx:g}; take more nodes or a longer horizon"
            )
        m = np.arange(1, M + 1)
        left, right = (m - 0.5) * dx, np.minimum((m + 0.5) * dx, reach)
        nodes, weights = np.polynomial.legendre.leggauss(8)
        z = 0.5 * (left + right)[:, None] + 0.5 * (right - left)[:, None] * nodes
        values = np.asarray(b(z / horizon), dtype=float)
        if values.shape != z.shape or not np.isfinite(values).all():
            raise AtcError(
                "the kernel's profile: expected a finite number for every distance between 0 and the horizon"
            )
        if values.min() < 0:
            raise AtcError(
                "the kernel's profile is negative somewhere: φ_s must be 0 or greater, or the regularisation amplifies"
            )
        w = 0.5 * (right - left) * (values @ weights)
        second = 2 * (w * (m * dx) ** 2).sum()
        if not second > 0:
            raise AtcError("the kernel's profile is zero everywhere")
        return w * 2 / second

    @property
    def neighbors(self) -> int:
        """M, of the kernel that reaches further."""
        return max(len(self.profile_m), len(self.smoothing_m))

    @property
    def odd_m(self) -> np.ndarray:
        """φ_a Δx at z = mΔx, m = 1 … M (at −m the negative)."""
        return self._padded(self.profile_m) * np.arange(1, self.neighbors + 1) * self.spacing

    @property
    def even_m(self) -> np.ndarray:
        """φ_s Δx at z = ±mΔx, m = 1 … M."""
        return self._padded(self.smoothing_m)

    def _padded(self, x_m):
        return np.concatenate([x_m, np.zeros(self.neighbors - len(x_m))])

    def advection_symbol(self, k) -> np.ndarray:
        """∫ φ_a(z) sin(kz) dz of the discrete kernel: 2k for long waves."""
        m = np.arange(1, self.neighbors + 1)
        return 2 * np.sin(np.multiply.outer(np.asarray(k, dtype=float), m * self.spacing)) @ self.odd_m

    def diffusion_symbol(self, k) -> np.ndarray:
        """λ(k) = ∫ φ_s(z)(1 − cos kz) dz of the discrete kernel, ≥ 0: k² for long waves, bounded for short ones."""
        m = np.arange(1, self.neighbors + 1)
        return 4 * np.sin(np.multiply.outer(np.asarray(k, dtype=float), 0.5 * m * self.spacing)) ** 2 @ self.even_m


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


def _burgers(u):
    return 0.5 * u * u


def advect(
    u0,
    kernel: Kernel,
    *,
    duration: float,
    viscosity: float = 0.0,
    psi: Callable | str = "burgers",
    two_point: str = "midpoint",
    times=101,
    method: str = "auto",
    safety: float = 0.5,
    relaxation: bool = True,
    max_steps: int = 1_000_000,
) -> AdvectionRun:
    """Solve the nonlocal advection equation on a periodic grid with strong-stability-preserving Runge–Kutta of third
    order.

    Parameters
    ----------
    u0 : (n,) array
        At x = iΔx, Δx = kernel.spacing; the period is nΔx.
    kernel : Kernel
    duration : float
    viscosity : float
        ε ≥ 0.
    psi : function or "burgers"
        The local flux ψ(u), vectorised; Burgers is u²/2.
    two_point : "midpoint" or "conserving"
    times : int or increasing array
        Recorded times: that many, evenly, or these.
    method : "auto", "fft" (Burgers only: two convolutions a stage) or "stencil" (any flux)
    safety : float
        Δt = safety / (ε max λ / 2.51 + max|ψ'| max|φ̂_a| / 1.73): inside SSP-RK3's stability region. max λ is bounded
        by the kernel, so Δt does not fall with the spacing. Updated every step.
    relaxation : bool
        Scale each step by a number close to 1 such that energy changes by exactly what flux and regularisation do at
        its stages (Ketcheson 2019): still third order, and the ledger closes to rounding.

    Returns
    -------
    AdvectionRun
        `stopped` says why if the run ended early: max|u| above 100 times its first value (the midpoint flux at ε = 0),
        or `max_steps`.
    """
    u = np.array(u0, dtype=float)
    if u.ndim != 1 or len(u) < 4 or not np.isfinite(u).all():
        raise AtcError("the initial u: expected finite numbers at four nodes or more")
    n, dx, M = len(u), kernel.spacing, kernel.neighbors
    if 2 * M >= n:
        raise AtcError(
            f"horizon = {kernel.horizon:g}: the kernel reaches {M} of {n} nodes on either side; it must be shorter "
            f"than half the period {n * dx:g}"
        )
    if not (math.isfinite(viscosity) and viscosity >= 0):
        raise AtcError(f"viscosity = {viscosity!r}: expected 0 or greater (a negative one is ill-posed)")
    for name, value in (("duration", duration), ("safety", safety)):
        if not (math.isfinite(value) and value > 0):
            raise AtcError(f"{name} = {value!r}: expected a number greater than 0")
    if two_point not in FLUXES:
        raise AtcError(f"two-point flux {two_point!r}: expected midpoint or conserving")
    burgers = psi == "burgers"
    if method not in ("auto", "fft", "stencil"):
        raise AtcError(f"method {method!r}: expected auto, fft or stencil")
    if method == "fft" and not burgers:
        raise AtcError("method fft is for Burgers' flux, a sum of two convolutions; other fluxes need the stencil")
    if method == "auto":
        method = "fft" if burgers and M >= _FFT_FROM else "stencil"
    function = _burgers if burgers else psi
    _check_flux(function, u)
    t_t = np.linspace(0, duration, times) if np.ndim(times) == 0 else np.asarray(times, dtype=float)
    if len(t_t) < 2 or t_t[0] != 0 or not (np.diff(t_t) > 0).all():
        raise AtcError("times: expected two or more, increasing, the first one 0")
    transport, smooth = (_by_fft if method == "fft" else _by_stencil)(kernel, n, function, two_point, burgers)
    k = np.linspace(0, math.pi / dx, 8 * M + 257)
    odd, even = float(np.abs(kernel.advection_symbol(k)).max()) / 2, float(kernel.diffusion_symbol(k).max())

    rate = viscosity * even / _REAL_LIMIT + _fastest(function, u, burgers) * odd / _IMAGINARY_LIMIT
    if duration * rate / safety > max_steps:
        raise AtcError(
            f"about {duration * rate / safety:.1e} steps would be needed (at most {max_steps:.0e}): the stable step "
            f"is {1 / rate:.3g}; take a shorter duration, a smaller viscosity or a longer horizon"
        )
    records = [u.copy()]
    ledger = np.zeros(2)  # production, dissipation
    ledgers = [ledger.copy()]
    steps, t, shortest, longest, stopped = 0, 0.0, math.inf, 0.0, ""
    size = max(float(np.abs(u).max()), 1e-300)

    def slope(v):
        f, s = transport(v), smooth(v) if viscosity else 0.0
        made = -float(v @ f)
        taken = -viscosity * float(v @ s) if viscosity else 0.0
        return -f + viscosity * s, made, taken

    for target in t_t[1:]:
        while t < target * (1 - 1e-14) and not stopped:
            rate = viscosity * even / _REAL_LIMIT + _fastest(function, u, burgers) * odd / _IMAGINARY_LIMIT
            dt = safety / rate if rate > 0 else target - t
            remaining = target - t
            last = dt >= remaining * (1 - 1e-9)
            if last:
                dt = remaining
            f1, p1, d1 = slope(u)
            for _ in range(8):
                f2, p2, d2 = slope(u + dt * f1)
                f3, p3, d3 = slope(u + (0.25 * dt) * (f1 + f2))
                change = (f1 + f2 + 4 * f3) * (dt / 6)
                gain = np.array([p1 + p2 + 4 * p3, d1 + d2 + 4 * d3]) * (dt / 6)
                scale = _relaxed(u, change, gain, size) if relaxation else 1.0
                # A relaxed step ends at t + scale dt: the one that must land on a recorded time is repeated with a
                # length that does.
                if not last or abs(scale * dt / remaining - 1) < 1e-13:
                    break
                dt = remaining / scale
            u = u + scale * change
            ledger = ledger + scale * gain
            t = target if last else t + scale * dt
            steps += 1
            shortest, longest = min(shortest, dt), max(longest, dt)
            largest = np.abs(u).max()
            if not largest < 100 * size:
                stopped = f"max|u| grew beyond 100 times its first value at t = {t:.6g}"
            elif steps >= max_steps:
                stopped = f"{max_steps} steps were taken by t = {t:.6g}"
        records.append(u.copy())
        ledgers.append(ledger.copy())
        if stopped:
            t_t = np.append(t_t[: len(records) - 1], t)
            break
    u_tn, made = np.array(records), np.array(ledgers) * dx
    with np.errstate(over="ignore", invalid="ignore"):
        mass, energy = np.array([math.fsum(v) * dx for v in u_tn]), 0.5 * (u_tn**2).sum(axis=1) * dx
    flux, dt_range = "burgers" if burgers else getattr(psi, "__name__", "psi"), (shortest if steps else 0.0, longest)
    recorded = np.arange(n) * dx, t_t, u_tn, mass, energy, made[:, 0], made[:, 1]
    return AdvectionRun(
        kernel, flux, two_point, float(viscosity), method, *recorded, steps, dt_range, stopped, function
    )


def _relaxed(u, change, gain, size) -> float:
    """The factor by which a step is scaled so that Σ u²/2 changes by its gains; in units of the grid spacing, which
    drops out."""
    square = float(change @ change)
    if not square > 1e-28 * size**2 * len(u):
        return 1.0
    scale = 2 * (gain[0] - gain[1] - float(u @ change)) / square
    return (
        scale if 0.5 < scale < 2 else 1.0
    )  # never seen inside the stability region; the ledger's closure would show it


def _check_flux(psi, u) -> None:
    lo, hi = float(u.min()), float(u.max())
    try:
        values = np.asarray(psi(np.linspace(lo, hi, 17)), dtype=float)
    except Exception as e:
        raise AtcError(
            f"the flux: could not be evaluated for u between {lo:g} and {hi:g} ({type(e).__name__}: {e}); expected a "
            "function of an array"
        ) from None
    if values.shape != (17,) or not np.isfinite(values).all():
        raise AtcError(f"the flux: is not a finite number for every u between {lo:g} and {hi:g}")


def _fastest(psi, u, burgers) -> float:
    """max|ψ'| over the range of u."""
    if burgers:
        return float(np.abs(u).max())
    lo, hi = float(u.min()), float(u.max())
    if not hi - lo > 1e-9 * max(abs(lo), abs(hi), 1e-9):
        middle, h = 0.5 * (lo + hi), 1e-6 * max(abs(lo), 1.0)
        return float(abs(psi(np.array([middle + h]))[0] - psi(np.array([middle - h]))[0]) / (2 * h))
    grid = np.linspace(lo, hi, 257)
    # a chord is never steeper than the steepest tangent: 1.05 makes up for the finite grid
    return 1.05 * float(np.abs(np.diff(psi(grid))).max() / (grid[1] - grid[0]))


def _by_fft(kernel, n, psi, two_point, burgers):
    """Burgers: ∫ F φ_a = [2u a⋆u + a⋆u²]/8 (midpoint) or [u a⋆u + a⋆u²]/6 (conserving), a⋆f = Σ_m a_m f_{i+m}."""
    from scipy.fft import irfft, rfft

    k = 2 * np.pi * np.fft.rfftfreq(n, kernel.spacing)
    odd, even = 1j * kernel.advection_symbol(k), -kernel.diffusion_symbol(k)
    if n % 2 == 0:
        odd[-1] = 0
    own, square = (0.25, 0.125) if two_point == "midpoint" else (1 / 6, 1 / 6)

    def transport(u):
        return own * u * irfft(odd * rfft(u), n) + square * irfft(odd * rfft(u * u), n)

    return transport, lambda u: irfft(even * rfft(u), n)


def _by_stencil(kernel, n, psi, two_point, burgers):
    a, s, M = kernel.odd_m, kernel.even_m, kernel.neighbors
    # F(a, b) = Σ_g w_g ψ(a + s_g (b − a)): one point is the midpoint flux; 8 Gauss points are exact for polynomials of
    # degree 15.
    nodes, weights = np.polynomial.legendre.leggauss(1 if two_point == "midpoint" else 8)
    nodes, weights = 0.5 * (nodes + 1), 0.5 * weights
    if burgers:
        from ._kernels import burgers_transport, smoothing

        own, square = (0.25, 0.125) if two_point == "midpoint" else (1 / 6, 1 / 6)

        def transport(u):
            return burgers_transport(_wrapped(u, M), a, own, square)
    else:
        from ._kernels import smoothing

        def transport(u):
            row, out = _wrapped(u, M), np.zeros(n)
            for m in range(1, M + 1):
                # F of the pairs (i, i+m), i = −m … n−1: each pair once, + at its left node and − at its right one, so
                # mass is conserved pair by pair
                left = row[M - m : M + n]
                step = row[M : M + n + m] - left
                F = sum(w * psi(left + g * step) for g, w in zip(nodes, weights)) * a[m - 1]
                out += F[m:] - F[:n]
            return out

    return transport, lambda u: smoothing(_wrapped(u, M), s)


def _wrapped(u, M):
    return np.concatenate([u[len(u) - M :], u, u[:M]])


def find_shocks(x_n, u_n, psi=_burgers, steepness: float = 0.2) -> list[dict]:
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
