"""Section 4 of the 2009 paper, smooth waves: molecular dynamics, peridynamics and the wave equation, local and nonlocal
chains."""

from __future__ import annotations

import math

import numpy as np

from ..chain import Springs, bump
from ..continuum import Peridynamics, wave_equation
from ..evolve import count_steps, modal, relative_error, verlet
from .report import ASSUMING, NO, YES, Report, draw_density, percent
from .springs_problem import DURATION, NEIGHBORS, PROFILE_TIME, SPACING, grid


def _run(model: Springs, rows: int | None = None, moments=(), boundary: str = "clamped", initial=bump):
    """Velocity Verlet on the paper's path: at most `rows` recorded steps, and the two steps around each of
    `moments`."""
    dt = model.time_step()
    steps = count_steps(DURATION, dt)
    every = 1 if rows is None else max(1, math.ceil(steps / rows))
    near = {s for t in moments for s in (math.floor(t / dt), math.floor(t / dt) + 1)}
    marks = sorted({*range(0, steps, every), *near})
    return verlet(model, initial(grid(model.spacing)), dt=dt, steps=steps, every=marks, boundary=boundary)


def dispersion(report: Report) -> None:
    """Figs. 4.3 and 4.4, table 4.1: the bump in four models, and which part of each error is space, which is Verlet."""
    models = {
        "MD": Springs.paper(SPACING, NEIGHBORS, name="molecular dynamics"),
        "CCM": Springs.paper(0.01, 20, name="wave equation by 20 neighbours"),
        "PD fine": Springs.paper(0.01, 500, name="peridynamics, fine"),
        "PD coarse": Springs.paper(0.5, 10, name="peridynamics, coarse"),
    }
    runs = {name: _run(m, None if m.spacing > 0.1 else 120, [PROFILE_TIME]) for name, m in models.items()}
    steps = {name: count_steps(DURATION, m.time_step()) for name, m in models.items()}
    cost = {name: len(runs[name].x_n) * models[name].neighbors * steps[name] for name in models}
    costs = {
        name: {"nodes": len(runs[name].x_n), "neighbors": m.neighbors, "time_step": m.time_step()}
        | {"steps": steps[name], "relative_cost": cost[name] / cost["MD"]}
        for name, m in models.items()
    }
    ratio = costs["PD coarse"]["relative_cost"]

    report.heading("Molecular dynamics, peridynamics and the wave equation (Figs. 4.3, 4.4, Table 4.1)")
    letters = {"MD": "a", "CCM": "b", "PD fine": "c", "PD coarse": "d"}

    def draw(fig):
        axs = fig.subplots(2, 2, sharex=True, sharey=True).ravel()
        for ax, (name, run) in zip(axs, runs.items()):
            title = f"({letters[name]}) {name}: {len(run.x_n):,} nodes, N = {run.model.neighbors}"
            image = draw_density(ax, run.x_n, run.t_t, run.density_tn, title, limits=(0.85, 1.15))
        fig.colorbar(image, ax=list(axs), label="density over density at rest", shrink=0.6)

    report.figure("fig_4_3_density", "Fig. 4.3: density over space (across) and time (downwards).", draw, (10, 7))
    profiles = {name: run.at(PROFILE_TIME) for name, run in runs.items()}
    exact, _ = modal(models["MD"], bump(grid(SPACING)), PROFILE_TIME)

    def draw_profiles(fig):
        left, right = fig.subplots(1, 2, sharey=True)
        for name, style in (("MD", "C0-"), ("PD fine", "C1--"), ("PD coarse", "C2:")):
            left.plot(runs[name].x_n, profiles[name], style, label=name)
        left.plot(grid(SPACING), exact, "k-", lw=0.5, label="MD, exact in time")
        right.plot(runs["CCM"].x_n, profiles["CCM"], label="CCM")
        for ax in (left, right):
            ax.set(xlim=(320, 680), xlabel="reference position", title=f"t = {PROFILE_TIME}")
            ax.legend()
        left.set_ylabel("displacement")

    report.figure(
        "fig_4_4_profiles",
        "Fig. 4.4: displacements at t = 150.05; each model with its own Verlet step, and the chain's exact solution.",
        draw_profiles,
    )
    report.table(
        "model | nodes | neighbours | Δt | steps | relative cost",
        [[name, *row.values()] for name, row in costs.items()],
        "Table 4.1 and its two companions. Cost: nodes × neighbours × steps.",
    )
    report.claim(
        "Table 4.1",
        "184 and 162 time steps, relative cost 0.22.",
        f"{steps['MD']} and {steps['PD coarse']} steps, {ratio:.5f}",
        ASSUMING if (steps["MD"], steps["PD coarse"]) == (184, 162) and abs(ratio - 0.22016) < 1e-5 else NO,
        "K₁ = ρ = 1, duration 300 and ⌊300/Δt⌋ steps, which the paper does not say",
    )
    fine_frame = round(PROFILE_TIME / models["PD fine"].time_step())
    report.claim(
        "Fig. 4.4",
        "Profiles at t = 150.05.",
        f"step {fine_frame} of the fine run is at t = {fine_frame * models['PD fine'].time_step():.3f}; the nearest "
        f"of MD is at {92 * models['MD'].time_step():.2f}, of coarse PD at {81 * models['PD coarse'].time_step():.2f}",
        ASSUMING,
        "only the fine peridynamic run has a step there; the others are interpolated (cubic in time) here",
    )

    # Which part of a difference is space and which is Verlet: exact solutions in time.
    x_fine = np.arange(100000) * 0.01
    wide = SPACING * math.sqrt(NEIGHBORS * (NEIGHBORS + 1))
    at_chain = slice(0, None, 25)
    periodic, _ = modal(models["MD"], bump(np.arange(4000) * SPACING), PROFILE_TIME)

    def continuous(model):
        return modal(model, bump(x_fine), PROFILE_TIME, spacing=0.01)[0][at_chain]

    errors = {
        "peridynamics, δ = Na": relative_error(continuous(Peridynamics(SPACING * NEIGHBORS)), periodic),
        "peridynamics, δ = a√(N(N+1))": relative_error(continuous(Peridynamics(wide)), periodic),
        "wave equation": relative_error(continuous(wave_equation()), periodic),
        "coarse peridynamics, Δx = 2a, M = 10": relative_error(
            modal(models["PD coarse"], bump(np.arange(2000) * 0.5), PROFILE_TIME)[0], periodic[::2]
        ),
        "MD by velocity Verlet, its own Δt": relative_error(profiles["MD"][:-1], periodic),
        "fine peridynamics by Verlet, its own Δt": relative_error(profiles["PD fine"][:-1][at_chain], periodic),
        "coarse peridynamics by Verlet, its own Δt": relative_error(profiles["PD coarse"][:-1], periodic[::2]),
    }
    between = {
        "fine PD against MD": relative_error(profiles["PD fine"][:-1][at_chain], profiles["MD"][:-1]),
        "coarse PD against MD": relative_error(profiles["PD coarse"][:-1], profiles["MD"][:-1][::2]),
        "CCM against MD": relative_error(profiles["CCM"][:-1][at_chain], profiles["MD"][:-1]),
    }
    shares = lambda numbers: [[k, percent(v)] for k, v in numbers.items()]  # noqa: E731
    report.table("profile at t = 150.05 | relative L2 error against the chain, exact in time", shares(errors))
    report.table("as the paper ran them (Verlet, own Δt) | relative L2 difference", shares(between))
    cancelled = {
        name: 2 * (m.time_step() / m.spacing) ** 2 / (m.neighbors * (m.neighbors + 1)) for name, m in models.items()
    }
    report.table("model | share of the leading dispersion that Verlet's own error cancels", shares(cancelled))
    report.claim(
        "Figs. 4.3, 4.4",
        "Fine peridynamics with δ = 5 disperses as the chain does, the wave equation does not.",
        f"exact in time, fine PD differs from MD by {percent(errors['peridynamics, δ = Na'])} (relative L2; the wave "
        f"equation by {percent(errors['wave equation'])}); with δ = a√(N(N+1)) = {wide:.4f} by "
        f"{percent(errors['peridynamics, δ = a√(N(N+1))'])}",
        ASSUMING,
        "alike by eye; a good model of the chain only with the horizon that is exact in N",
    )
    report.claim(
        "Fig. 4.4",
        "Coarse peridynamics (Δx = 2a, M = 10) follows the chain at a fifth of the cost.",
        f"exact in time it is off by {percent(errors['coarse peridynamics, Δx = 2a, M = 10'])}; run by Verlet with "
        f"its own step, by {percent(between['coarse PD against MD'])} from MD so run, and by "
        f"{percent(errors['coarse peridynamics by Verlet, its own Δt'])} from the true solution",
        ASSUMING,
        "alike by eye; other weights on the same nodes are off by 1e-5 (see below)",
    )
    report.claim(
        "§4.4.1",
        "What the runs show is the dispersion of the models.",
        f"at the paper's steps Verlet's own error cancels {percent(min(cancelled.values()))} to "
        f"{percent(max(cancelled.values()))} of the leading dispersion, a different share for each model; MD so run "
        f"is {percent(errors['MD by velocity Verlet, its own Δt'])} off its own exact solution",
        NO,
        "compare at one Δt, or exactly in time as here",
    )
    dalembert = 0.5 * (bump(x_fine, 500 - PROFILE_TIME) + bump(x_fine, 500 + PROFILE_TIME))
    ccm = relative_error(profiles["CCM"][:-1], dalembert)
    report.claim(
        "Figs. 4.3(b), 4.4(b)",
        "The classical model shows no dispersion.",
        f"the run differs from d'Alembert's solution by {percent(ccm)}",
        YES,
    )
    ends = _run(models["MD"], None, [PROFILE_TIME], boundary="periodic")
    apart = float(np.abs(ends.u_tn - runs["MD"].u_tn).max())
    report.claim(
        "§4.4",
        "Nothing is said of the ends of the chain.",
        f"clamped and periodic ends differ by {apart:.1e} up to t = 300",
        ASSUMING,
        "starts at rest; either end will do",
    )
    limit = {
        h: relative_error(continuous(Peridynamics(h)), continuous(wave_equation()))
        for h in (4.0, 2.0, 1.0, 0.5, 0.25, 0.125, 0.0625)
    }
    order = math.log(limit[0.125] / limit[0.0625]) / math.log(2)
    report.table("horizon | relative L2 distance from the wave equation", [[h, v] for h, v in limit.items()])
    report.claim(
        "§4.1",
        "Peridynamics goes over into the wave equation as δ → 0.",
        f"at fixed time, order {order:.2f} in the horizon",
        YES if abs(order - 2) < 0.1 else NO,
    )
    report.numbers |= {
        "table_4_1": costs,
        "profile_errors": errors,
        "profile_differences_verlet": between,
        "dispersion_cancelled_by_verlet": cancelled,
        "ccm_against_dalembert": ccm,
        "clamped_against_periodic": apart,
        "horizon_to_zero": {str(k): v for k, v in limit.items()},
    }
    report.dataset("md", runs["MD"].dataset())
    report.dataset("pd_coarse", runs["PD coarse"].dataset())


def local_nonlocal(report: Report) -> None:
    """Fig. 4.5: nearest neighbours beside five."""
    t = 150.45
    runs = {M: _run(Springs.paper(1.0, M), None, [t]) for M in (1, 5)}
    report.heading("Local and nonlocal chains (Fig. 4.5)")

    def draw(fig):
        axs = fig.subplots(2, 2)
        for j, (M, run) in enumerate(runs.items()):
            title = f"({'ab'[j]}) 1,001 atoms, N = {M}"
            draw_density(axs[0, j], run.x_n, run.t_t, run.density_tn, title, limits=(0.85, 1.15))
            axs[1, j].plot(run.x_n, run.at(t))
            title = f"({'cd'[j]}) t = {t}, N = {M}"
            axs[1, j].set(xlim=(300, 700), xlabel="reference position", title=title, ylabel="displacement")

    report.figure("fig_4_5_local", "Fig. 4.5: nearest neighbours and five neighbours.", draw, (10, 7))
    x = np.arange(1000.0)
    start = 0.5 * (bump(x, 500 - t) + bump(x, 500 + t))
    away = {M: relative_error(modal(Springs.paper(1.0, M), bump(x), t)[0], start) for M in runs}
    frame = t / runs[1].dt
    report.claim(
        "Fig. 4.5",
        "Profiles at t = 150.45.",
        f"{frame:.6g} steps of the nearest-neighbour run",
        ASSUMING,
        "Δt = 0.85 for N = 1; the run with N = 5 has no step there",
    )
    report.claim(
        "Fig. 4.5",
        "More neighbours at the same modulus: more dispersion.",
        f"distance from the undispersed wave at that time, exact in time: N = 1 {percent(away[1])}, N = 5 "
        f"{percent(away[5])}",
        YES if away[5] > away[1] else NO,
    )
    report.numbers["local_nonlocal"] = {str(k): v for k, v in away.items()}
