"""What limits a balance law from differences between frames: jumps of the potential at its cutoff, and the digits of
the file."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from .laws import Exact


@dataclass
class CutoffJump:
    """What a pair style leaves at its cutoff: energy `U`, force `F` (per pair, internal), and how many pairs cross it
    per time, both ways."""

    name: str
    cutoff: float
    energy: float
    force: float
    crossings: float = 0.0


def cutoff_jumps(frame, pot, threads: int = 1) -> list[CutoffJump]:
    """Pair styles that are not 0 at their cutoff, the largest jump of each, with the rate of crossings counted in this
    frame."""
    found = []
    for term in pot.terms:
        for style in term.inner.covering(int(frame.types.max(initial=1))).styles:
            found += _jumps_of(style, frame)
    if not found:
        return []
    limits = sorted({j.cutoff for j in found})
    shell = {rc: [0.0] * threads for rc in limits}
    v = frame.velocities

    def consume(bonds, thread):
        d = np.sqrt((bonds.r_bc**2).sum(1))
        for rc in limits:
            near = np.flatnonzero((d > 0.98 * rc) & (d <= rc))
            w = np.einsum("bc,bc->b", v[bonds.i[near]] - v[bonds.j[near]], bonds.r_bc[near]) / d[near]
            shell[rc][thread] += float(np.abs(w).sum()) / (0.02 * rc)

    pot.stream(frame, consume, threads=threads)
    for jump in found:
        jump.crossings = sum(shell[jump.cutoff])
    return found


def _jumps_of(style, frame) -> list[CutoffJump]:
    types = frame.types.astype(np.int32)
    first = {int(t): int(np.flatnonzero(types == t)[0]) for t in np.unique(types)}
    pairs = [
        (a, b)
        for a in first
        for b in first
        if a <= b and a <= style.n_types and b <= style.n_types and style.table[a, b, 0] > 0
    ]
    if not pairs:
        return []
    i = np.array([first[a] for a, _ in pairs], np.int32)
    j = np.array([first[b] for _, b in pairs], np.int32)
    d2 = np.array([style.table[p][0] for p in pairs]) * (1.0 - 1e-12)
    U, G = np.zeros(len(pairs)), np.zeros(len(pairs))
    style.add(types, i, j, d2, np.zeros(0), U, G, style.prepare(frame))
    best: dict[float, CutoffJump] = {}
    for d, energy, g in zip(np.sqrt(d2), U, G, strict=True):
        rc = round(float(d), 9)
        new = CutoffJump(style.name, rc, float(energy), float(g * d))
        if rc not in best or abs(new.energy) + abs(new.force) * rc > abs(best[rc].energy) + abs(best[rc].force) * rc:
            best[rc] = new
    # what a smooth cutoff leaves at 1 − 1e-12 of it is rounding; kT of the frame is the scale of energies
    thermal = float((frame.masses[:, None] * frame.velocities**2).sum()) / max(len(frame), 1)
    return [j for j in best.values() if abs(j.energy) + abs(j.force) * j.cutoff > 1e-9 * thermal]


def resolution_noise(exact: Exact, dx: float, dv: float) -> dict[str, np.ndarray]:
    """(g,) standard deviation of ρ, ρ v and ε at points when coordinates are rounded to `dx` and velocities to `dv`:
    independent, uniform errors."""
    s, st = exact.sites, exact.state
    m, v, e = st.frame.masses, st.v_nc, st.total_n
    phi2 = s.phi.multiply(s.phi)
    slope2 = sum(g.multiply(g) for g in s.gradient)
    ux, uv = dx**2 / 12.0, dv**2 / 12.0
    speed2 = (v * v).sum(1)
    rho = ux * (slope2 @ m**2)
    pi = ux * (slope2 @ (m**2 * speed2)) + 3 * uv * (phi2 @ m**2)
    energy = ux * (slope2 @ e**2 + phi2 @ st.stiffness_n**2) + uv * (phi2 @ (m**2 * speed2))
    return {"mass": np.sqrt(rho), "momentum": np.sqrt(pi), "energy": np.sqrt(energy)}


def cutoff_noise(exact: Exact, found: list[CutoffJump], dt: float) -> dict[str, float]:
    """Standard deviation of rates from differences over ±dt when pairs cross a cutoff at random times meanwhile.

    A crossing changes ε by ½ U_c (φ_i + φ_j) at once, and the rate of ρ v by F_c (φ_i − φ_j), that of ε by the power of
    F_c, from then on.
    """
    n = exact.sites.phi.shape[1]
    square = float(np.max(exact.sites.phi.multiply(exact.sites.phi).sum(1))) / n
    v2 = float((exact.state.v_nc**2).sum()) / n
    # ⟨¼ (φ_i + φ_j)²⟩ = ½ ⟨φ²⟩, ⟨(φ_i − φ_j)²⟩ = 2 ⟨φ²⟩ for ends that know nothing of each other; a third from where in
    # the interval it happens
    jolts = sum(j.energy**2 * j.crossings * 2 * dt for j in found) * 0.5 * square / (2 * dt) ** 2
    forces = sum(j.force**2 * j.crossings * 2 * dt for j in found) * 2.0 * square / 3.0
    return {"mass": 0.0, "momentum": sqrt(forces), "energy": sqrt(jolts + forces * v2)}
