"""Section 4 of the 2009 paper, what needs no run to its end: gradient and dispersion series, and stable time steps."""

from __future__ import annotations

import math

import numpy as np

from ..chain import Springs, square_pulse
from ..gradients import dispersion_series, inner_series, peridynamic_series, spring_series, well_posedness
from .report import ASSUMING, NO, YES, Report, percent


def series(report: Report) -> None:
    """Coefficients of the gradient equations and of ω(k), in exact rationals; which truncations are well-posed."""
    order = 5
    exact, leading, local = spring_series(order), spring_series(order, "leading"), spring_series(order, 1)
    peridynamic = peridynamic_series(order)
    w_exact, w_peridynamic = dispersion_series(exact), dispersion_series(peridynamic)
    report.heading("Gradient series and dispersion (eqs. 4.2, 4.4, 4.6, 4.8, 4.9)")
    report.text(
        "Coefficients of ∂²y, ∂⁴y, … in ρ y_tt = K₁ Σ c_m L^(2m−2) ∂^(2m) y, in exact rationals. N is the number of "
        "neighbours on either side; L = a for the "
        "exact ones and nearest neighbours, L = Na = δ for the leading order and for peridynamics."
    )
    report.table(
        "derivative | chain, exact in N (L = a) | chain, leading order (L = Na) | peridynamics (L = δ) | "
        "nearest neighbours (L = a)",
        [[f"∂^{2 * m}", *map(str, c)] for m, c in enumerate(zip(exact, leading, peridynamic, local), 1)],
    )
    report.table(
        "term of ω/(ck) | chain, exact in N (kL = ka) | peridynamics (kL = kδ)",
        [[f"(kL)^{2 * m}", str(w_exact[m]), str(w_peridynamic[m])] for m in range(order)],
    )
    rows = []
    for name, series in (
        *((f"(4.4) cut after ∂^{2 * m}", peridynamic[:m]) for m in range(1, order + 1)),
        ("inner expansion, degree 3, nearest neighbours: 1, 1/12, 1/576", inner_series(3)),
        ("inner expansion, degree 3, large N", inner_series(3, "leading")),
        ("inner expansion, degree 5, large N", inner_series(5, "leading")),
        ("inner expansion, degree 3, order-consistent: 1, 1/12", inner_series(3, consistent=True)),
    ):
        rows.append([name, ", ".join(map(str, series)), str(well_posedness(series))])
    report.table("truncation | coefficients | well-posedness", rows)
    report.numbers["series"] = {
        "chain_exact": list(map(str, exact)),
        "peridynamics": list(map(str, peridynamic)),
        "nearest": list(map(str, local)),
        "dispersion_chain_exact": list(map(str, w_exact)),
        "dispersion_peridynamics": list(map(str, w_peridynamic)),
        "well_posedness": {r[0]: r[2] for r in rows},
    }
    # leading order in N of the exact polynomials, against peridynamics
    agree = all(c.degree == 2 * m and c.leading == p for m, (c, p) in enumerate(zip(exact, peridynamic)))
    agree_w = all(c.leading == p for c, p in zip(w_exact[1:], w_peridynamic[1:]))
    report.claim(
        "(4.2) = (4.4)",
        "The gradient series of the chain and of peridynamics agree at every order for δ = Na.",
        f"leading coefficients in N equal those of peridynamics through ∂^{2 * order}: {'yes' if agree else 'no'}; "
        "exact ones have N(N+1) for N² and more",
        ASSUMING if agree else NO,
        "only the leading order in N; at N = 20 the second coefficient is 5 % larger than "
        "(Na)²/24, which δ = a√(N(N+1)) repairs",
    )
    report.claim(
        "(4.6)",
        "Nearest neighbours: 1, a²/12, a⁴/360.",
        ", ".join(map(str, local[:3])),
        YES if list(map(str, local[:3])) == ["1", "1/12", "1/360"] else NO,
    )
    report.claim(
        "(4.8) = (4.9)",
        "ω/(ck) = 1 − (kNa)²/48 + 17 (kNa)⁴/69120 for both.",
        f"peridynamics: {', '.join(map(str, w_peridynamic[:3]))}; chain: {w_exact[1]}, {w_exact[2]}",
        ASSUMING if agree_w and list(map(str, w_peridynamic[:3])) == ["1", "-1/48", "17/69120"] else NO,
        "the chain's only to leading order in N",
    )
    report.claim(
        "§3.2",
        "The inner expansion avoids ill-posed equations.",
        "degree 3 and 5: ω² is a square; but (4.2) itself, cut after ∂⁴, is the bad-sign equation",
        ASSUMING,
        "true of the full inner expansion, whose coefficients (1, 1/12, 1/576) are not those the paper "
        "prints; its order-consistent cut is ill-posed",
    )


def stability(report: Report) -> None:
    """Fig. 4.2: the largest stable time step, by (4.12), exactly, and by runs."""
    horizon, counts = 5.0, [1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 50, 64, 80, 100]
    rows = []
    for M in counts:
        model = Springs.paper(horizon / M, M)
        observed = _observed_limit(model) if M <= 50 else math.nan
        rows.append((model.spacing, M, model.sufficient_time_step, model.stable_time_step, observed))
    rows = np.array(rows)
    slack = rows[:, 3] / rows[:, 2] - 1
    observed = rows[:, 4] / rows[:, 2] - 1
    inside = (rows[:, 1] >= 4) & (rows[:, 1] <= 25)
    report.heading("Stability (Fig. 4.2)")

    def draw(fig):
        ax = fig.subplots()
        ax.plot(rows[:, 0], rows[:, 2], ".-", label="sufficient condition (4.12)")
        ax.plot(rows[:, 0], rows[:, 3], "-", color="0.6", lw=3, zorder=0, label="2/ω_max, exact")
        ax.plot(rows[:, 0], rows[:, 4], "+--", label="observed, square pulse")
        ax.plot(rows[:, 0], rows[0, 2] / rows[0, 0] * rows[:, 0], "k--", lw=0.8, label="proportional to Δx")
        ax.set(xlabel="Δx", ylabel="Δt", xlim=(0, 5.1), ylim=(0, None), title="δ = 5, ρ = K₁ = 1")
        ax.legend()

    report.figure(
        "fig_4_2_stability", "Fig. 4.2: the largest stable time step against the spacing, horizon 5.", draw, (6, 4)
    )
    report.table(
        "Δx | M | (4.12) | 2/ω_max | observed | slack of (4.12)",
        [
            [float(r[0]), int(r[1]), float(r[2]), float(r[3]), float(r[4]) if np.isfinite(r[4]) else "", percent(s)]
            for r, s in zip(rows, slack)
        ],
    )
    report.numbers["stability"] = {
        "spacing": rows[:, 0],
        "neighbors": counts,
        "sufficient": rows[:, 2],
        "exact": rows[:, 3],
        "observed": [None if math.isnan(v) else v for v in rows[:, 4]],
    }
    report.claim(
        "Fig. 4.2",
        "For small Δx the time step may exceed (4.12) by about 20–30 %.",
        f"2/ω_max exceeds it by {percent(slack[inside].min())} to {percent(slack[inside].max())} for M = 4 … 25 (runs "
        f"of the square pulse: {percent(np.nanmin(observed[inside]))} to {percent(np.nanmax(observed[inside]))}), "
        f"{percent(slack[-1])} at M = 100; none at M = 1",
        YES,
    )
    report.claim(
        "§4.3",
        "The stable step falls more slowly than Δx.",
        f"from Δx = 5 to 0.05 it falls by a factor {rows[0, 3] / rows[-1, 3]:.3g}, Δx by 100",
        YES,
    )


def _observed_limit(model: Springs) -> float:
    """The largest step with which velocity Verlet keeps the square pulse bounded over 2000 steps, by runs, bisected to
    0.5 %."""
    from .._chain_kernels import pad, springs_force, springs_verlet

    M, w = model.neighbors, model.weights / model.density
    n = 40 * M  # 40 horizons: 200 long
    pulse = np.zeros(n + 2 * M)
    pulse[M : M + n] = square_pulse(np.arange(n) * model.spacing, 100.0, 10.0)

    def bounded(dt):
        u, v, a = pulse.copy(), np.zeros(n), np.empty(n)
        pad(u, M, True)
        springs_force(u, w, a)
        springs_verlet(u, v, a, w, dt, 2000, True)
        return bool(np.abs(u).max() < 10)  # also False for NaN

    lo, hi = model.sufficient_time_step, 2 * model.sufficient_time_step
    while hi / lo > 1.005:
        mid = 0.5 * (lo + hi)
        lo, hi = (mid, hi) if bounded(mid) else (lo, mid)
    return lo
