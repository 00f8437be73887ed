"""The zero-frequency value of a power spectrum by cepstral analysis (Ercole, Marcolongo and Baroni, Sci. Rep. 7, 15835
(2017); Bertossa, Grasselli, Ercole and Baroni, Phys. Rev. Lett. 122, 255901 (2019)).

The periodogram of a stationary series is its power spectrum times noise of a known distribution, χ² with 2 degrees of
freedom a component, so that the logarithm of it is that of the spectrum plus noise of known mean and variance. The
Fourier coefficients of the logarithm (the cepstrum) fall off quickly where the spectrum is smooth: a few of them give
log S(0), and its error in closed form, without a choice of a plateau.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: So many times what Akaike's criterion keeps: by itself it balances the noise of all frequencies against what
#: is cut off, which leaves a bias of a standard error at frequency 0 (measured on autoregressive processes).
GENEROUS = 2


@dataclass(frozen=True)
class Cepstrum:
    """integral : ∫_0^∞ ⟨J(0) J(t)⟩ dt, the mean of the components; stderr : its standard error
    coefficients : how many cepstral coefficients were kept
    cepstrum : (n,) the coefficients, the first n = min(N/2, 2000)
    """

    integral: float
    stderr: float
    coefficients: int
    cepstrum: np.ndarray


def zero_frequency(J_tc, dt: float) -> Cepstrum:
    """∫_0^∞ ⟨J(0) J(t)⟩ dt of a stationary series of mean 0, whose components are statistically the same.

    Parameters
    ----------
    J_tc : (t, c)
    dt : time between samples

    Notes
    -----
    With Ŝ_k the mean periodogram of the ℓ components, log Ŝ_k − ψ(ℓ) + log ℓ has the mean log S_k and the variance
    ψ'(ℓ) (half as many degrees of freedom at k = 0 and at the Nyquist frequency). Of its Fourier coefficients C_n the
    first P give log S(0) = C_0 + 2 Σ_{n<P} C_n with the variance ψ'(ℓ) (4P − 2)/N; P is twice what minimises N/ψ'(ℓ)
    Σ_{n≥P} C_n² + 2P (Akaike). The integral is S(0)/2.
    """
    from scipy.special import digamma, polygamma

    J_tc = np.asarray(J_tc, float)
    J_tc = J_tc[: len(J_tc) - len(J_tc) % 2]
    n, ell = J_tc.shape
    power_k = (np.abs(np.fft.rfft(J_tc, axis=0)) ** 2).mean(1) * dt / n
    halves = np.full(len(power_k), float(ell))  # half of the degrees of freedom of each frequency
    halves[[0, -1]] = 0.5 * ell
    # A current of exactly 0 at some frequency has no logarithm: rounding puts it there.
    log_k = np.log(np.maximum(power_k, np.finfo(float).tiny)) - digamma(halves) + np.log(halves)
    C_n = np.fft.irfft(log_k, n)[: n // 2 + 1]
    variance = float(polygamma(1, ell))
    left = np.cumsum(C_n[::-1] ** 2)[::-1]  # Σ_{n≥P}
    criterion = n / variance * left[1:] + 2.0 * np.arange(1, len(left))
    P = min(GENEROUS * (1 + int(np.argmin(criterion[: max(1, len(criterion) - 1)]))), len(C_n) - 1)
    log_0 = C_n[0] + 2.0 * C_n[1:P].sum()
    error = np.sqrt(variance * (4 * P - 2) / n)
    integral = 0.5 * float(np.exp(log_0))
    return Cepstrum(integral, integral * float(error), P, C_n[:2000].copy())
