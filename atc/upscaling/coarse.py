"""Coarse models of a chain at equal cost: the same nodes and neighbours, better weights.

A coarse chain (spacing Δx, M neighbours) is as good as its ω(k) is close to the fine one's for the waves that are
there. The paper keeps the form of the weights, which leaves the horizon as the only length; the weights themselves are
M free numbers. All models here have exactly the fine chain's modulus (sound speed).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..errors import AtcError
from .chain import Springs, positive, whole
from .evolve import count_steps, modal, relative_error

METHODS = ("paper", "trapezoid", "moments-2", "moments-4", "band", "band-in-time")


def coarsen(
    fine: Springs, spacing: float, neighbors: int, method: str = "band", band: float = 0.5, dt: float | None = None
) -> Springs:
    """A chain of `neighbors` neighbours at `spacing` that stands for `fine`.

    Parameters
    ----------
    fine : Springs
    spacing, neighbors : Δx and M of the coarse chain
    method : str
        ``paper``: weights 2K₁/(M(M+1)) / (q Δx²) (eq. A.2). ``trapezoid``: the trapezoidal rule for ∫ (c/|ε|)(u(x+ε) −
        u(x)) dε over the horizon, whose last weight is halved.
        ``moments-P``: the smallest relative change of the paper's weights that matches the moments Σ w (qΔx)^{2p}, p =
        1 … P, of the fine chain (its gradient series through ∂^{2P}).
        ``band``: w ≥ 0 that minimise Σ (ω²/ω²_fine − 1)² over wavenumbers k ≤ band·π/Δx (non-negative least squares).
        ``band-in-time``: the same for the chain *as velocity Verlet moves it* with the step `dt`: Verlet turns a mode
        of frequency ω by 2 arcsin(ω dt/2) a step, so the target is ω² = (2/dt)² sin²(ω_fine dt/2), and the errors of
        space and time go together.
    band : float
        For ``band`` and ``band-in-time``: the part of the coarse chain's zone that is fitted.
    dt : float
        For ``band-in-time``; default: the step of the paper's weights with safety factor 0.85.

    Raises
    ------
    AtcError
        for an unknown method, or moments that cannot be matched with so few neighbours.
    """
    M = whole("neighbors", neighbors)
    q = np.arange(1, M + 1)
    K, rho = fine.modulus, fine.density
    start = Springs.paper(spacing, M, K, rho)
    if method == "paper":
        weights = start.weights
    elif method == "trapezoid":
        weights = 1.0 / q
        weights[-1] /= 2
        if M == 1:
            raise AtcError("trapezoid: needs 2 neighbours or more")
        weights *= K / (weights * (q * spacing) ** 2).sum()
    elif method.startswith("moments-") and method[8:].isdigit() and int(method[8:]) >= 1:
        weights = _matched_moments(fine, start, int(method[8:]))
    elif method == "band":
        weights = _fitted_band(fine, start, positive("band", band))
    elif method == "band-in-time":
        dt = positive("dt", start.time_step() if dt is None else dt)
        weights = _fitted_band(fine, start, positive("band", band), dt)
    else:
        raise AtcError(
            f"coarse model {method!r}: expected paper, trapezoid, moments-2, moments-4 (or another number), band or "
            "band-in-time"
        )
    return Springs(spacing, weights, rho, method)


def _matched_moments(fine, start, count):
    M, reach = start.neighbors, start.horizon
    if count > M:
        raise AtcError(f"moments-{count}: a chain with {M} neighbours has no more than {M} weights to match them")
    r = np.arange(1, M + 1) * start.spacing / reach
    powers = 2 * np.arange(1, count + 1)
    # Relative corrections e_q: Σ_q w_q r^p (1 + e_q) = the fine chain's moment; least Σ e².
    A = start.weights * r ** powers[:, None]
    missing = np.array([fine.moment(p) / reach**p for p in powers]) - A.sum(axis=1)
    change, _, rank, _ = np.linalg.lstsq(A, missing, rcond=1e-13)
    if rank < count:
        raise AtcError(f"moments-{count}: too many for {M} neighbours in double precision; take fewer")
    return start.weights * (1 + change)


def _fitted_band(fine, start, band, dt=None):
    from scipy.optimize import nnls

    if band > 1:
        raise AtcError(f"band = {band:g}: expected a part of the coarse chain's zone, greater than 0 and at most 1")
    M, dx = start.neighbors, start.spacing
    q = np.arange(1, M + 1)
    k = np.linspace(0, band * math.pi / dx, max(401, 16 * M + 1))[1:]
    target = fine.frequency_squared(k)
    if dt is not None:
        half = 0.5 * dt * np.sqrt(target)
        if half.max() >= 0.5 * math.pi:
            raise AtcError(
                f"band-in-time: dt = {dt:g} is beyond half a period of the fastest wave of the band: take a smaller "
                "step or a smaller band"
            )
        target = (2 / dt * np.sin(half)) ** 2
    # Unknowns p_q = w_q (qΔx)²/K ≥ 0 with Σ p = 1, the modulus. Each spring's share of ω²/target:
    G = fine.modulus / fine.density * (k[:, None] * np.sinc(k[:, None] * q * dx / (2 * math.pi))) ** 2 / target[:, None]
    # Σ p = 1 turns ‖G p − 1‖ into the homogeneous ‖(G − 1) p‖; the heavy row only sets its scale, and the division
    # makes the modulus exact. (Its weight decides nothing: the minimiser of ‖A p‖² + (Σ p − 1)² is the constrained one
    # times a number.)
    A = np.vstack([G - 1, np.ones(M)])
    p, _ = nnls(A, np.append(np.zeros(len(k)), 1.0), maxiter=100 * M)
    p /= p.sum()
    return fine.modulus * p / (q * dx) ** 2


@dataclass(frozen=True)
class Accuracy:
    """One row of `accuracy_table`. `error` and the rest are relative; `cost` in units of the fine chain's nodes ×
    neighbours × steps."""

    method: str
    spacing: float
    neighbors: int
    time_step: float
    steps: int
    cost: float
    error: float
    error_verlet: float
    dispersion_error: float
    least_weight: float
    stable: bool


def accuracy_table(
    fine: Springs,
    initial,
    *,
    length: float,
    t: float,
    duration: float,
    models,
    safety: float = 0.85,
    band: float = 0.5,
    fine_safety: float = 0.85,
) -> list[Accuracy]:
    """Errors of coarse models against the exact solution of the fine chain, and what they cost.

    Parameters
    ----------
    fine : Springs
    initial : function x → u(x, 0)
    length : float
        Of the domain; a multiple of every spacing; periodic.
    t : float
        When profiles are compared, at the coarse nodes.
    duration : float
        Length of the simulation whose steps are counted (⌊duration/Δt⌋).
    models : list of (method, spacing, neighbors)
    safety : float
        Δt of each model = safety × its sufficient limit (eq. 4.13; for band-in-time that of the paper's weights).
        `error` is exact in time, `error_verlet` has Verlet's error at that Δt.
    fine_safety : float
        The same for the fine chain, whose nodes × neighbours × steps are the unit of cost.
    """
    nodes = _nodes(length, fine.spacing)
    reference, _ = modal(fine, initial(np.arange(nodes) * fine.spacing), t)
    work = (nodes + 1) * fine.neighbors * count_steps(duration, fine.time_step(fine_safety))
    rows = []
    for method, spacing, M in models:
        planned = Springs.paper(spacing, M, fine.modulus, fine.density).time_step(safety)
        model = coarsen(fine, spacing, M, method, band, planned)
        n = _nodes(length, spacing)
        step = round(spacing / fine.spacing)
        if abs(step * fine.spacing - spacing) > 1e-9 * spacing:
            raise AtcError(
                f"spacing = {spacing:g}: not a multiple of the fine chain's {fine.spacing:g}, so profiles have no "
                "nodes in common"
            )
        u0 = initial(np.arange(n) * spacing)
        dt = planned if method == "band-in-time" else model.time_step(safety)
        steps = count_steps(duration, dt)
        k = np.linspace(0, 0.5 * math.pi / spacing, 801)[1:]
        squared = model.frequency_squared(np.linspace(0, math.pi / spacing, 4001))
        stable = bool(squared.min() > -1e-12 * squared.max() and dt < model.stable_time_step)
        errors = [math.nan] * 3  # an unstable chain has no solution to compare
        if stable:
            errors = [relative_error(modal(model, u0, t, dt=d)[0], reference[::step]) for d in (None, dt)]
            errors.append(float(np.abs(model.frequency(k) / fine.frequency(k) - 1).max()))
        rows.append(
            Accuracy(
                method, spacing, M, dt, steps, (n + 1) * M * steps / work,
                *errors, float(model.weights.min() * spacing**2 / fine.modulus), stable,
            )
        )  # fmt: skip
    return rows


def _nodes(length, spacing):
    n = round(length / spacing)
    if abs(n * spacing - length) > 1e-9 * length:
        raise AtcError(f"spacing = {spacing:g}: the domain's length {length:g} is not a multiple of it")
    return n
