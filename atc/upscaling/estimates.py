"""Frequencies of modes from their amplitudes, with errors: by the ratio of velocities to displacements, and by spectra.

Harmonic motion obeys ⟨|v_k|²⟩ = ω² ⟨|u_k|²⟩ whatever its amplitude, so no spectrum and no equipartition is needed;
where eigenvectors are not known, ω² are the eigenvalues of ⟨v v†⟩ against ⟨u u†⟩. Time averages are tapered by a Hann
window in each block, which removes the error of cutting a period; blocks give the error bars (jackknife).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .force_constants import signed_root

#: Fewer frames than this in a block make no spectrum; fewer cycles than this no frequency.
MIN_FRAMES, MIN_CYCLES = 16, 3.0


@dataclass
class Estimate:
    """Frequencies (internal ω) with standard errors, ascending, at one wave vector; NaN where none could be had. `why`
    says why not."""

    omega: np.ndarray
    error: np.ndarray
    why: str = ""


def _windows(frames: int, blocks: int):
    """Slices of equal blocks, and the Hann weights of one."""
    length = frames // blocks
    weights = np.hanning(length + 2)[1:-1] if length else np.zeros(0)
    return [slice(b * length, (b + 1) * length) for b in range(blocks)], weights


def by_ratio(u_stx, v_stx, vectors_sxm=None, blocks: int = 5, groups=None) -> Estimate:
    """ω of each mode from √(⟨|v|²⟩/⟨|u|²⟩), over equivalent wave vectors s.

    Parameters
    ----------
    u_stx, v_stx : (s, t, 3n) complex amplitudes
    vectors_sxm : (s, 3n, 3n) eigenvectors (columns) to project on, e.g. of the harmonic crystal; None: the generalised
        eigenproblem
        ⟨v v†⟩ e = ω² ⟨u u†⟩ e
    blocks : pieces of the run; their jackknife gives the error
    groups : (3n,) ints: modes of one number are degenerate and looked at together, each with the weight of its energy;
        with `vectors_sxm` only
    """
    modes, frames = u_stx.shape[2], u_stx.shape[1]
    parts, w = _windows(frames, blocks)
    need = max(4, 0 if vectors_sxm is not None else modes)
    if blocks < 2 or len(w) < need:
        empty = np.full(modes, np.nan)
        return Estimate(empty, empty, f"{frames} frames in {blocks} blocks are too few: {need} a block at least")
    u = u_stx - u_stx.mean(axis=1, keepdims=True)
    if vectors_sxm is not None:
        um, vm = (np.einsum("sxm,stx->stm", vectors_sxm.conj(), a, optimize=True) for a in (u, v_stx))
        U = _pooled(np.array([np.einsum("t,stm->m", w, np.abs(um[:, p]) ** 2) for p in parts]), groups)
        V = _pooled(np.array([np.einsum("t,stm->m", w, np.abs(vm[:, p]) ** 2) for p in parts]), groups)
        return Estimate(*jackknife(lambda which: np.sqrt(V[which].sum(axis=0) / U[which].sum(axis=0)), blocks))
    from scipy.linalg import eigh

    U, V = (
        np.array([np.einsum("t,stx,sty->sxy", w, a[:, p], a[:, p].conj(), optimize=True) for p in parts])
        for a in (u, v_stx)
    )

    def solve(which):
        return np.mean(
            [signed_root(eigh(b, a, eigvals_only=True)) for a, b in zip(U[which].sum(axis=0), V[which].sum(axis=0))],
            axis=0,
        )

    return Estimate(*jackknife(solve, blocks))


def _pooled(x, groups):
    """Sums over the groups of the last axis, given back to each member."""
    if groups is None:
        return x
    same = np.asarray(groups)[:, None] == np.asarray(groups)[None, :]
    return x @ same.astype(float)


def degenerate(values) -> np.ndarray:
    """Group numbers of ascending values that are equal to 1e-6 of the largest."""
    return np.concatenate([[0], np.cumsum(np.diff(values) > 1e-6 * np.abs(values).max())])


def jackknife(statistic, blocks: int):
    """Value and standard error of ``statistic(indices of blocks)``, leaving out one block at a time."""
    everything = np.arange(blocks)
    value = statistic(everything)
    without = np.array([statistic(np.delete(everything, b)) for b in range(blocks)])
    return value, np.sqrt((blocks - 1) / blocks * ((without - without.mean(axis=0)) ** 2).sum(axis=0))


def spectra(v_stm, dt: float, blocks: int = 5, pad: int = 4):
    """Power spectra of complex series, blocks tapered by a Hann window, +ω and −ω added.

    Parameters
    ----------
    v_stm : (s, t, m). Returns ω (f,) and power (blocks, f, m), summed over s.
    """
    parts, w = _windows(v_stm.shape[1], blocks)
    n = pad * len(w)
    out = []
    for p in parts:
        f = np.abs(np.fft.fft(v_stm[:, p] * w[None, :, None], n=n, axis=1)) ** 2
        half = n // 2 + 1
        folded = f[:, :half].copy()
        folded[:, 1:half] += f[:, ::-1][:, : half - 1]
        out.append(folded.sum(axis=0))
    return 2 * np.pi * np.arange(n // 2 + 1) / (n * dt), np.array(out)


def by_spectrum(v_stm, dt: float, blocks: int = 5, groups=None) -> Estimate:
    """ω of the highest peak of each mode's spectrum, by a parabola through the logarithm of the peak's three highest
    points (for a Hann window good to a hundredth of the block's resolution)."""
    modes, frames = v_stm.shape[2], v_stm.shape[1]
    empty = np.full(modes, np.nan)
    length = frames // blocks
    if blocks < 2 or length < MIN_FRAMES:
        why = f"{frames} frames in {blocks} blocks are too few for a spectrum: {MIN_FRAMES} a block at least"
        return Estimate(empty, empty, why)
    omega, power = spectra(v_stm, dt, blocks)
    power = _pooled(power, groups)

    def peaks(which):
        P = power[which].sum(axis=0)
        at = np.clip(np.argmax(P[1:-1], axis=0) + 1, 1, len(P) - 2)
        m = np.arange(modes)
        a, b, c = (np.log(np.maximum(P[at + d, m], 1e-300)) for d in (-1, 0, 1))
        curve = a - 2 * b + c
        return (at + np.where(curve < 0, 0.5 * (a - c) / np.where(curve < 0, curve, 1.0), 0.0)) * omega[1]

    value, error = jackknife(peaks, blocks)
    slow = value * length * dt < 2 * np.pi * MIN_CYCLES
    why = f"a block holds fewer than {MIN_CYCLES:g} periods of the slowest modes" if slow.any() else ""
    return Estimate(np.where(slow, np.nan, value), np.where(slow, np.nan, error), why)
