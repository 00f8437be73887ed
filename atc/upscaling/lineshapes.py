"""Linewidths and lifetimes of modes from the spectra of their velocities.

A mode's velocity is taken as a stationary Gaussian process whose autocorrelation decays: as a Lorentzian line,
c(t) = exp(−γ|t|/2) cos ω₀t, or as a damped oscillator, c(t) = exp(−γ|t|/2) (cos ω_e t − γ/(2ω_e) sin ω_e|t|) with
ω_e² = ω₀² − γ²/4. γ is the full width at half maximum of the line in ω, so that 1/γ is the lifetime of the mode's
energy (phono3py's 1/2Γ) and 2/γ that of its amplitude (dynasor's).

The parameters are those of greatest likelihood of the periodogram (Whittle's), whose expectation is that of the finite,
sampled run: leakage and folded frequencies are in the model (A. M. Sykulski et al., Biometrika 106, 251 (2019)). Error
bars allow for the correlation of neighbouring frequencies that a finite run makes, and grow with the root of the misfit
where the line has another shape: lines of anharmonic crystals have shoulders and satellites.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import AtcError

SHAPES = ("lorentzian", "oscillator")
#: Lines that are narrower than this over the run's length have no width that could be measured: γT, T the run. A
#: frequency of the run and the next are 2π/T apart.
NARROWEST = 8.0
#: Values of the periodogram that the start is smoothed over, and how often the band follows the line.
_SMOOTH, _ROUNDS = 60, 8


@dataclass
class Line:
    """One fitted line. omega, gamma : ω₀ and the full width at half maximum, with standard errors, which are √misfit
    times as large where that is above 1; NaN where no line could be had (`why`). power : ⟨|v|²⟩ of the mode. misfit :
    mean square of (data/fit − 1) over what it should be, 1 for a line of this shape; larger for another."""

    omega: float = np.nan
    omega_error: float = np.nan
    gamma: float = np.nan
    gamma_error: float = np.nan
    power: float = np.nan
    misfit: float = np.nan
    why: str = ""


def autocorrelation(shape: str, t, omega: float, gamma: float) -> np.ndarray:
    """c(t), 1 at t = 0, of a velocity; t ≥ 0. An oscillator may be overdamped."""
    if shape == "lorentzian":
        return np.exp(-0.5 * gamma * t) * np.cos(omega * t)
    turn = np.sqrt(complex(omega**2 - 0.25 * gamma**2))
    if abs(turn) < 1e-7 * gamma:
        return np.exp(-0.5 * gamma * t) * (1 - 0.5 * gamma * t)
    # Two decaying exponentials, so that nothing overflows where it is overdamped.
    a = 0.5j * gamma / turn
    return (
        0.5 * ((1 + a) * np.exp((1j * turn - 0.5 * gamma) * t) + (1 - a) * np.exp((-1j * turn - 0.5 * gamma) * t))
    ).real


def expected_periodogram(c_t, dt: float) -> np.ndarray:
    """E |Σ v e^{−iωt}|² dt/N at ω = 2πj/(N dt), j ≤ N/2, of a run of N values with autocorrelation c (N,)."""
    n = len(c_t)
    return dt * (2 * np.fft.rfft(c_t * (1 - np.arange(n) / n)).real - c_t[0])


def periodogram(v_st, dt: float, both: bool = True) -> np.ndarray:
    """(f,) mean over series of |Σ v e^{−iωt}|² dt/N; `both`: and over ±ω, which of complex series are independent."""
    n = v_st.shape[-1]
    power = (np.abs(np.fft.fft(v_st, axis=-1)) ** 2).reshape(-1, n).mean(axis=0) * dt / n
    half = power[: n // 2 + 1]
    return 0.5 * (half + power[-np.arange(n // 2 + 1)]) if both else half


def fit_line(v_st, dt: float, shape: str = "lorentzian", *, real: bool = False, band=None) -> Line:
    """Fit one line to the spectra of independent velocity series of one mode.

    Parameters
    ----------
    v_st : (s, t) complex or real series, equally spaced, equivalent to each other
    dt : time between values
    shape : of `SHAPES`
    real : ±ω of a series say the same (a real series, or a wave vector that is half a reciprocal vector)
    band : (lowest, highest) ω of the fit; default: around the highest peak, eight widths to either side

    Returns
    -------
    Line, ω and γ in 1/(unit of dt)
    """
    if shape not in SHAPES:
        raise AtcError(f"line shape {shape!r}: expected {' or '.join(map(repr, SHAPES))}")
    v_st = np.atleast_2d(v_st)
    n = v_st.shape[-1]
    real = real or not np.iscomplexobj(v_st)
    if n < 32:
        return Line(why=f"{n} frames are too few for a line: 32 at least")
    data = periodogram(v_st, dt, both=not real)
    independent = v_st.shape[0] * (1 if real else 2)
    step = 2 * np.pi / (n * dt)
    omega = step * np.arange(len(data))
    if not (data[1:] > 0).any():
        return Line(why="the mode does not move")
    t = dt * np.arange(n)
    # Start: the highest point of a spectrum smoothed over some hundred values, and the width of its half.
    reach = max(2, int(np.ceil(_SMOOTH / independent)))
    taper = np.minimum(np.arange(1, 2 * reach + 2), np.arange(2 * reach + 1, 0, -1))
    smooth = np.convolve(data, taper / taper.sum(), mode="full")[reach:-reach]
    inside = np.ones(len(data), bool) if band is None else (omega >= band[0]) & (omega <= band[1])
    inside[0] = False
    if inside.sum() < 6:
        return Line(why="the band holds fewer than six frequencies of the run")
    top = int(np.argmax(np.where(inside, smooth, -1.0)))
    below = smooth < 0.5 * smooth[top]
    left, right = top - np.argmax(below[top::-1]) if below[:top].any() else 0, top + np.argmax(below[top:])
    width = max(right - left if below[top:].any() else 2 * (top - left), 2) * step
    fitted = (1.0, omega[top], max(width - reach * step, 0.5 * step))
    # The band is that of the line that is found in it.
    for _ in range(_ROUNDS if band is None else 1):
        before = fitted
        if band is None:
            inside = (np.abs(omega - before[1]) <= 8 * max(before[2], 1.5 * step)) & (omega > 0)
        fitted = _greatest(shape, t, dt, data, inside, *before[1:])
        if abs(fitted[1] - before[1]) < 0.02 * fitted[2] and abs(fitted[2] - before[2]) < 0.02 * fitted[2]:
            break
    power, w0, gamma = fitted
    if gamma * n * dt < NARROWEST:
        return Line(omega=w0, why="a line is narrower than the run resolves: its lifetime is longer than the run")
    if gamma > omega[-1]:
        return Line(why="a line is wider than the frequencies that the run resolves")
    error = _errors(shape, t, dt, inside, power, w0, gamma, independent)
    model = power * expected_periodogram(autocorrelation(shape, t, w0, gamma), dt)
    misfit = float(independent * np.mean((data[inside] / model[inside] - 1) ** 2))
    error = error * np.sqrt(max(misfit, 1.0))
    return Line(float(w0), float(error[1]), float(gamma), float(error[2] * gamma), float(power), misfit)


def _greatest(shape, t, dt, data, inside, w0, gamma):
    """(power, ω, γ) of the least Σ log S + I/S; the power in closed form for given ω and γ."""
    from scipy.optimize import minimize

    I = data[inside]
    scale = max(gamma, 0.5 * 2 * np.pi / (len(t) * dt))
    tiny = 1e-12

    def shape_of(x):
        c = autocorrelation(shape, t, abs(w0 + scale * x[0]), gamma * np.exp(np.clip(x[1], -30, 30)))
        S = expected_periodogram(c, dt)[inside]
        return np.maximum(S, tiny * S.max())

    def cost(x):
        S = shape_of(x)
        return np.log(S).mean() + np.log((I / S).mean())

    simplex = np.array([[0.0, 0.0], [0.5, 0.0], [0.0, 0.5]])
    best = minimize(
        cost, [0.0, 0.0], method="Nelder-Mead", options={"xatol": 1e-5, "fatol": 1e-10, "initial_simplex": simplex}
    )
    return (
        float((I / shape_of(best.x)).mean()),
        abs(w0 + scale * best.x[0]),
        gamma * np.exp(np.clip(best.x[1], -30, 30)),
    )


def _errors(shape, t, dt, inside, power, w0, gamma, independent):
    """Standard errors of (log power, ω, log γ): H⁻¹ J H⁻¹, with H Fisher's matrix of independent frequencies and J the
    covariance of the score, |Cov(d_j, d_k)|² = (Im H_j − Im H_k)²/(N sin(π(j−k)/N))² of the finite run (H the
    one-sided transform of c)."""
    n = len(t)
    c = power * autocorrelation(shape, t, w0, gamma)
    S = expected_periodogram(c, dt)[inside]
    h_w, h_g = 1e-4 * gamma, 1e-4

    def log_model(w, g):
        return np.log(expected_periodogram(power * autocorrelation(shape, t, w, g), dt)[inside])

    slope = np.array(
        [
            np.ones(inside.sum()),
            (log_model(w0 + h_w, gamma) - log_model(w0 - h_w, gamma)) / (2 * h_w),
            (log_model(w0, gamma * np.exp(h_g)) - log_model(w0, gamma * np.exp(-h_g))) / (2 * h_g),
        ]
    )
    j = np.flatnonzero(inside)
    one_sided = np.fft.rfft(c).imag[j] * dt
    apart = np.sin(np.pi * (j[:, None] - j[None]) / n)
    with np.errstate(divide="ignore", invalid="ignore"):
        cov2 = np.where(apart == 0, 0.0, ((one_sided[:, None] - one_sided[None]) / (n * apart)) ** 2)
    cov2[np.arange(len(j)), np.arange(len(j))] = S**2
    inverse = np.linalg.inv(slope @ slope.T)
    weight = slope / S
    spread = inverse @ (weight @ cov2 @ weight.T) @ inverse / independent
    return np.sqrt(np.diag(spread))


def spectral_energy_density(v_stx, dt: float, blocks: int = 1, taper: bool = False, pad: int = 1):
    """Spectral energy density of waves: Σ_x |∫ √m v e^{−iωt} dt|²/(2πT) (J. A. Thomas et al., PRB 81, 081411 (2010)).

    Parameters
    ----------
    v_stx : (s, t, 3n) mass-weighted amplitudes over √cells (`vibrations.amplitudes`) of equivalent wave vectors s
    dt : time between frames
    blocks, taper : pieces whose spectra are averaged, and whether each is tapered by a Hann window
    pad : frequencies are this many times as close

    Returns
    -------
    ω (f,) ≥ 0 and the density (f,), an energy times a time: its integral over ω ≥ 0 is ½kT for each of the 3n modes,
    as dynasor has it; both signs of ω are averaged, which is the mean over q and −q.
    """
    length = v_stx.shape[1] // blocks
    n = pad * length
    w = np.hanning(length + 2)[1:-1] if taper else np.ones(length)
    total = 0.0
    for b in range(blocks):
        part = v_stx[:, b * length : (b + 1) * length] * w[None, :, None]
        power = (np.abs(np.fft.fft(part, n=n, axis=1)) ** 2).sum(axis=2).mean(axis=0)
        total = total + 0.5 * (power[: n // 2 + 1] + power[-np.arange(n // 2 + 1)])
    omega = 2 * np.pi * np.arange(n // 2 + 1) / (n * dt)
    return omega, total * dt / (2 * np.pi * blocks * (w**2).sum())
