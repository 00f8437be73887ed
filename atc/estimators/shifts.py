"""Kinetic sums without cancellation where different regions move at very different speeds."""

from __future__ import annotations

import numpy as np

from .deposits import Deposits
from .sums import Sums
from .tensors import kinetic_flux, kinetic_flux_about, outer6, quotient, thermal, within_thermal

# Rounding error a point may have in T − ρ v⊗v, relative to its thermal part: far below the 1e-6 that is promised.
_SHIFT_TOLERANCE = 1e-9
_MAX_SHIFTS = 16


def local_shifts(sums: Sums, deposits: Deposits, x_nc, factors, flux: bool = False):
    """T − ρ v⊗v (and Σ ½ m w² w φ, if `flux`) where different regions move at very different speeds, without
    cancellation.

    The expressions do not change when one velocity is subtracted from all atoms; their rounding errors are about ε ρ
    |v(x) − c|² and ε ρ |v(x) − c|³ for the subtracted c. The frame's mean is enough for a uniform drift. Where it is
    not, more passes over the atoms take further c, each the velocity of the point that is worst off, and every point
    keeps the one nearest to its own velocity.

    Returns
    -------
    (g, 6) and (g, 3) or None; None, None where the frame's mean was enough everywhere.
    """
    best = sums.thermal_of_drift
    best_flux = sums.kinetic_flux_of_drift if flux else None
    rho = sums.rho
    v_gc = sums.stream
    eps = 64 * np.finfo(float).eps
    # How many thermal speeds away from c a point may be.
    limit = (_SHIFT_TOLERANCE / eps) ** (1 / 3 if flux else 1 / 2)
    if within_thermal(rho, v_gc, best, 0.99 * limit):
        return None, None
    have = np.linalg.norm(v_gc, axis=1)
    done = False
    for _ in range(_MAX_SHIFTS):
        heat = quotient(best[:, :3].sum(1), rho)
        # A point with one atom has no thermal part at all: measure it against what is typical of the points that
        # certainly have one.
        certain = heat[heat > eps * have**2]
        scale = np.sqrt(np.maximum(heat, np.median(certain) if len(certain) else 0.0))
        error = np.where(sums.defined, have - limit * scale, 0.0)
        worst = int(np.argmax(error)) if len(error) else 0
        if not len(error) or not error[worst] > 0:
            break
        c = v_gc[worst].copy()
        w_nc = factors.peculiar_nc - c
        m = factors["mass"]
        columns = [m, m * w_nc, m * outer6(w_nc)]
        if sums.of_part:
            M = factors["all_mass"]
            columns += [M, M * w_nc]
        if flux:
            columns.append(0.5 * m * np.einsum("nc,nc->n", w_nc, w_nc)[:, None] * w_nc)
        total = deposits.sites(x_nc, np.ascontiguousarray(np.concatenate(columns, axis=1)))
        about = ()
        if sums.of_part:
            u_gc = quotient(total[:, 11:14], total[:, 10])
            about, total = (u_gc,), np.delete(total, slice(10, 14), axis=1)
        else:
            u_gc = quotient(total[:, 1:4], total[:, 0])
        distance = np.linalg.norm(u_gc, axis=1)
        nearer = sums.defined & (distance < have)
        if not nearer.any():
            break
        if not done:
            done, best = True, best.copy()
            best_flux = best_flux.copy() if flux else None
        shifted = thermal(total[:, :1], total[:, 1:4], total[:, 4:10], *about)
        best[nearer] = shifted[nearer]
        if flux:
            if sums.of_part:
                flux_gc = kinetic_flux_about(total[:, :1], total[:, 1:4], total[:, 4:10], total[:, 10:], u_gc)
            else:
                flux_gc = kinetic_flux(total[:, 0], u_gc, shifted, total[:, 10:])
            best_flux[nearer] = flux_gc[nearer]
        have = np.where(nearer, distance, have)
    return (best, best_flux) if done else (None, None)
