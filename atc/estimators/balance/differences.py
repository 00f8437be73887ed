"""Rates as differences: of the atoms' energies along the motion, and between frames."""

from __future__ import annotations

import numpy as np

from .laws import Exact, Law
from .points import Sites
from .rates import Motion
from .stencils import STEPS


def energy_rates(frame, pot, state: Motion, threads: int = 1) -> tuple[float, float, int]:
    """dU^(j)/dt from the sources against differences of U^(j) with all atoms moved along their velocities.

    Returns
    -------
    largest difference over the largest rate; the largest difference between two step sizes of the differences (their
    own error), likewise; and the number of atoms left out because a pair crossed a jump of the potential meanwhile (two
    step sizes disagree by more than 1e-4).
    """
    speed = float(np.sqrt((state.v_nc**2).sum(1)).max(initial=0.0))
    scale = float(np.abs(state.share_rate_n).max(initial=0.0))
    if speed == 0.0 or scale == 0.0:
        return 0.0, 0.0, 0
    # An energy is good to 1e-15 or so, differences of it over 1e-3 Å (1e-3 σ) to 1e-12; h⁴ stays below that.
    tau = 1e-3 / speed

    def shares(t):
        return pot.stream(
            frame.replace(positions=frame.positions + t * state.v_nc), threads=threads, energies=True
        ).energies_n

    slopes = [(shares(s * tau) - shares(-s * tau)) / (2 * s * tau) for s in STEPS]
    fourth = [(4 * slopes[0] - slopes[1]) / 3, (4 * slopes[1] - slopes[2]) / 3]
    unsure = np.abs(fourth[0] - fourth[1])
    keep = unsure < 1e-4 * scale
    difference = np.abs((16 * fourth[0] - fourth[1]) / 15 - state.share_rate_n)[keep]
    return float(difference.max(initial=0.0)) / scale, float(unsure[keep].max(initial=0.0)) / scale, int((~keep).sum())


def sums_of_frame(frame, pot, x_gc, kern, drift, shift, threads: int):
    """ρ, ρ v and ε of another frame at the points x + shift, with the drift of the middle frame taken off."""
    energies = pot.stream(frame, threads=threads, energies=True).energies_n
    sites = Sites(x_gc + shift, frame.positions, frame.cell, kern)
    v = frame.velocities - drift
    m = frame.masses
    e = 0.5 * m * (v * v).sum(1) + energies
    return {"mass": sites.sum(m), "momentum": sites.sum(m[:, None] * v), "energy": sites.sum(e)}


def frame_residuals(exact_laws, exact: Exact, before, after, dt: float) -> dict[str, Law]:
    """The laws with rates (after − before)/(2 dt) and the exact divergences of the frame in the middle."""
    rate_of = {
        "mass": ("d(rho)/dt", exact.rho_t),
        "momentum": ("d(rho v)/dt", exact.pi_t),
        "energy": ("d(e)/dt", exact.energy_t),
    }
    out = {}
    for law, (name, rate) in rate_of.items():
        exact_law = exact_laws[law]
        difference = (after[law] - before[law]) / (2.0 * dt)
        residual = exact_law.residual + (difference - rate)
        without = None if exact_law.without is None else exact_law.without + (difference - rate)
        out[law] = Law({**exact_law.terms, name: difference}, residual, without)
    return out
