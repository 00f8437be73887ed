"""Section 4 of the 2009 paper, the square pulse."""

from __future__ import annotations

import numpy as np

from ..chain import Springs, square_pulse
from ..evolve import modal, relative_error, verlet
from .report import ASSUMING, NO, YES, Report
from .springs_problem import NEIGHBORS, SPACING, grid


def square(report: Report) -> None:
    """Fig. 4.6: a square pulse in four models with one time step, and refined."""
    models = {
        "MD": Springs.paper(SPACING, NEIGHBORS),
        "PD fine": Springs.paper(0.01, 500),
        "PD coarse": Springs.paper(0.5, 10),
        "CCM": Springs.paper(0.01, 20),
    }
    dt = models["CCM"].time_step()
    frames = [24, 93]
    runs = {
        n: verlet(m, square_pulse(grid(m.spacing)), dt=dt, steps=max(frames), every=frames, boundary="clamped")
        for n, m in models.items()
    }
    report.heading("Square pulse (Fig. 4.6)")

    def draw(fig):
        axs = fig.subplots(2, 2)
        for i, frame in enumerate(frames):
            for name, style in (("MD", "x-"), ("PD fine", "-"), ("PD coarse", "+-")):
                axs[i, 0].plot(runs[name].x_n, runs[name].u_tn[i + 1], style, ms=3, lw=0.8, label=name)
            axs[i, 1].plot(runs["CCM"].x_n, runs["CCM"].u_tn[i + 1], lw=0.6, label="CCM")
            for ax in axs[i]:
                ax.set(xlim=(475, 525), title=f"t = {frame * dt:.2f}", xlabel="reference position", ylim=(-0.45, 1.45))
                ax.legend()

    report.figure("fig_4_6_square", "Fig. 4.6: a square pulse with one time step for all.", draw, (10, 7))
    rows, numbers = [], {}
    for name, run in runs.items():
        for i, frame in enumerate(frames):
            u = run.u_tn[i + 1]
            variation, over = float(np.abs(np.diff(u)).sum()), float(max(u.max() - 1, -u.min(), 0))
            rows.append([name, f"{frame * dt:.2f}", variation, over])
            numbers[f"{name} {frame * dt:.2f}"] = {"total_variation": variation, "overshoot": over}
    report.table("model | t | total variation of u | overshoot beyond [0, 1]", rows)
    table = _refined_pulse([frames[1] * dt, 10 * frames[1] * dt])
    report.table(
        "t | Δx | jump between the nodes at the discontinuity | largest change at a node when Δx is halved | L2 change",
        table,
        "The pulse with horizon 5, exact in time. Waves of wavenumber k have ω = (2/δ)√(K₁/ρ)√(ln kδ + γ) and hardly "
        "travel, so what is seen across a distance ε of the jump goes on turning as ε → 0.",
    )
    late = [row for row in table if row[0] == table[-1][0]]
    report.claim(
        "Fig. 4.6",
        "One step, Δt = 0.0649, for all.",
        f"{dt:.6f}; t = 1.56 and 6.04 are steps {frames[0]} and {frames[1]}",
        YES if abs(dt - 0.064940) < 5e-7 else NO,
    )
    end = f"{frames[1] * dt:.2f}"
    at_end = {name: f"{numbers[f'{name} {end}']['total_variation']:.3g}" for name in runs}
    report.claim(
        "Fig. 4.6",
        "The classical simulation oscillates; molecular dynamics and peridynamics oscillate less.",
        f"total variation at t = {end}: CCM {at_end['CCM']}, MD {at_end['MD']}, fine PD {at_end['PD fine']}, coarse PD "
        f"{at_end['PD coarse']} (2 at the start)",
        ASSUMING,
        "CCM's oscillations are those of its own chain of 20 neighbours; the wave equation itself moves the "
        "pulse undisturbed",
    )
    report.claim(
        "§4.4.3",
        "Nonlocality smooths a discontinuity.",
        "the jump stays at its place and turns with a frequency that grows as √ln(1/Δx) without limit: at t = "
        f"{late[0][0]:.3g} every halving of Δx, from {late[0][1]:g} down to {late[-1][1] / 2:g}, changes "
        f"the value at some node by {min(r[3] for r in late):.2g} to {max(r[3] for r in late):.2g}",
        NO,
        "short waves of peridynamics hardly travel: the oscillations are fewer than those of a fine local chain, "
        "the jump is not smoothed, and no refinement converges pointwise",
    )
    report.numbers["square_pulse"] = {"time_step": dt, "runs": numbers, "refinement": table}


def _refined_pulse(times) -> list[list]:
    """Rows (t, Δx, jump, largest and L2 change at the nodes of the coarsest chain against half the spacing)."""
    horizon, box, table = 5.0, 1000.0, []
    for t in times:
        before = None
        for M in (10, 20, 40, 80, 160, 320, 640):
            model = Springs.paper(horizon / M, M)
            x = np.arange(round(box / model.spacing)) * model.spacing
            u, _ = modal(model, square_pulse(x), t)
            edge = round(510 / model.spacing)  # the last node of the pulse
            row = [t, model.spacing, float(u[edge] - u[edge + 1]), None, None]
            coarse = u[:: M // 10]
            if before is not None:
                table[-1][3:] = [float(np.abs(coarse - before).max()), relative_error(before, coarse)]
            table.append(row)
            before = coarse
        table.pop()
    return table
