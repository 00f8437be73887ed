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

import numpy as np

from ..errors import AtcError
from .kernel import Kernel
from .solution import AdvectionRun, burgers_flux

FLUXES = ("midpoint", "conserving")
# Along the axes, SSP-RK3's region of absolute stability ends at −2.5127 and ±1.7320i.
_REAL_LIMIT, _IMAGINARY_LIMIT = 2.5127, math.sqrt(3)
_FFT_FROM = 200  # stencil half-width from which Burgers by FFT is faster (measured on 4096 nodes)


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
    function = burgers_flux if burgers else psi
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
