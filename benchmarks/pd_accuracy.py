"""Peridynamics, speed against error: δ/Δx, Δt and precision against exact solutions of the same model, and against
classical elasticity.

    python benchmarks/pd_accuracy.py [--picture docs/pd_accuracy.png] [--fine 12]

A bump of displacement in a periodic plate spreads as pressure and shear waves. In the continuum (Δx → 0, Δt → 0) the
linear problem is solved exactly, wave by wave, for each material: ρω² of a wave k is an integral over the horizon,
written out below independently of the engine. So the error is not measured against the engine's own fine runs (which
are shown to converge to the same solution). CPU seconds: process time of the steps, set-up not included.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scipy.special import j0, j1

from atc import pd
from atc.frame import Cell

SIDE, HORIZON, RHO, YOUNGS = 1.0, 0.1, 1.0, 1.0
# PMB can have no other in a plate under plane stress; then LPS would be the same model.
POISSON = {"pmb": 1 / 3, "lps": 0.2, "correspondence": 0.2}
WIDTH, END, AMPLITUDE = 0.08, 0.45, 1e-7
TIMED = 0.3  # CPU seconds that a timing takes at least
WAVES = 18  # Fourier components each way: exp(−(2π·18·0.08)²/2) is nothing


def bump_coefficients():
    """(2K+1, 2K+1) Fourier coefficients of the periodic Gaussian bump in the middle, along x."""
    k = 2 * np.pi * np.arange(-WAVES, WAVES + 1) / SIDE
    one = WIDTH * np.sqrt(2 * np.pi) / SIDE * np.exp(-0.5 * (k * WIDTH) ** 2 - 1j * k * SIDE / 2)
    return k, one[:, None] * one[None, :]


def moduli(material, k, horizon):
    """(longitudinal, transverse) ρω² of waves k in the plate, Δx → 0; `horizon` 0 is classical elasticity."""
    nu = POISSON[material]
    mu, lam = YOUNGS / (2 * (1 + nu)), YOUNGS * nu / (1 - nu**2)
    if horizon == 0:
        return (lam + 2 * mu) * k**2, mu * k**2
    x, w = np.polynomial.legendre.leggauss(60)
    r, w = 0.5 * horizon * (x + 1), 0.5 * horizon * w
    z = k[..., None] * r
    z = np.where(z == 0, 1e-12, z)
    along = 2 * np.pi * (0.5 - (j0(z) - j1(z) / z))  # ∫ cos²φ (1 − cos(z cosφ)) dφ
    across = 2 * np.pi * (0.5 - j1(z) / z)  # ∫ sin²φ (1 − cos(z cosφ)) dφ
    if material == "pmb":
        c = 9 * YOUNGS / (np.pi * horizon**3)
        return c * (along @ w), c * (across @ w)
    omega = {"lps": 1 / r, "correspondence": np.ones_like(r)}[material]
    m = 2 * np.pi * (w * omega * r**3).sum()
    s = (2 * np.pi * j1(z)) @ (w * omega * r**2)  # ∫ ω r cosφ sin(z cosφ) dA
    if material == "lps":
        a, b = 4 * (lam - mu), 8 * mu
        return a * (s / m) ** 2 + 2 * b / m * (along @ (w * omega * r)), 2 * b / m * (across @ (w * omega * r))
    # Correspondence sees the gradient q instead of k; its stabilisation what q leaves over.
    q = 2 * s / m
    g = 0.1 * 8 * mu / m
    one = 2 * np.pi * (1 - j0(z))  # ∫ (1 − cos) dφ
    # |e^{iz cosφ} − 1 − i q r cosφ|² = 2(1 − cos) − 2 q r cosφ sin + q² r² cos²φ
    rest = 2 * one - 2 * (q[..., None] * r) * 2 * np.pi * j1(z) + (q[..., None] * r) ** 2 * np.pi
    hold = g * (rest @ (w * omega * r))
    return (lam + 2 * mu) * q**2 + hold, mu * q**2 + hold


def exact(material, X_nc, t, horizon=HORIZON):
    """(n, 2) displacement at time t of the bump that was at rest at 0, amplitude 1."""
    k, c = bump_coefficients()
    kx, ky = np.meshgrid(k, k, indexing="ij")
    size = np.hypot(kx, ky)
    nx, ny = (np.divide(a, size, out=np.zeros_like(a), where=size > 0) for a in (kx, ky))
    L, T = (np.cos(np.sqrt(np.maximum(m, 0) / RHO) * t) for m in moduli(material, size, horizon))
    ux = c * np.where(size > 0, nx * nx * L + ny * ny * T, 1.0)
    uy = c * nx * ny * (L - T)
    ex, ey = np.exp(1j * np.outer(X_nc[:, 0], k)), np.exp(1j * np.outer(X_nc[:, 1], k))
    return np.stack([((ex @ u) * ey).sum(axis=1).real for u in (ux, uy)], axis=1)


MATERIALS = {
    "PMB": ("pmb", lambda nu: pd.PMB(youngs=YOUNGS, volume_correction=nu)),
    "LPS": ("lps", lambda nu: pd.LPS(youngs=YOUNGS, poisson=POISSON["lps"], volume_correction=nu)),
    "correspondence": (
        "correspondence",
        lambda nu: pd.Correspondence(youngs=YOUNGS, poisson=POISSON["correspondence"], volume_correction=nu),
    ),
}


# The surface correction scales every bond so that the energy of the lattice is the classical one, also inside.
CORRECTED = "PMB corrected"


def plate(m, material, share=0.7, amplitude=AMPLITUDE, horizon=HORIZON):
    """The simulation at δ = mΔx and `share` of the stable step (rounded down so that it ends at END), and its number of
    steps."""
    dx = horizon / m
    n = round(SIDE / dx)
    body = pd.Body.lattice(
        pd.Box((0, 0, 0), ((n - 0.5) * dx,) * 2 + (0,)), dx, horizon * (1 + 1e-6), RHO, dimension=2, thickness=1.0,
        cell=Cell([SIDE, SIDE, 1.0], periodic=(True, True, False)),
    )  # fmt: skip
    u = np.zeros_like(body.X_nc)
    u[:, :2] = amplitude * exact("pmb", body.X_nc, 0.0)
    sim = pd.Simulation(body, material, displacements=u, threads=1)
    steps = int(np.ceil(END / (share * sim.time_step_stable)))
    sim.dt = END / steps
    return sim, steps


def run(sim, steps):
    """CPU seconds of the steps, which are taken; short runs are timed by going on for a while in a copy."""
    began = time.process_time()
    sim.step(steps)
    cpu = time.process_time() - began
    if cpu < TIMED:
        kept, more = sim.state.to_arrays(), 0
        while cpu < TIMED:
            sim.step(steps)
            more += 1
            cpu = time.process_time() - began
        sim._take(pd.State.from_arrays(kept), False)
        cpu /= 1 + more
    return cpu


def difference(u, want):
    return float(np.linalg.norm(u[:, :2] - want) / np.linalg.norm(want))


def against_spacing(finest):
    """Rows (material, ν, δ/Δx, nodes, bonds, error against the same model with a tenth of the stable step; steps, CPU s
    and error with 0.7 of it)."""
    rows = []
    for name, (key, make) in MATERIALS.items():
        for nu in (True, False):
            for m in [k for k in (2, 3, 4, 5, 6, 8, 12, 16) if k <= finest]:
                row = []
                for share in (0.1, 0.7):
                    sim, steps = plate(m, make(nu), share)
                    cpu = run(sim, steps)
                    row += [steps, cpu, difference(sim.state.u_nc / AMPLITUDE, exact(key, sim.body.X_nc, END))]
                rows.append((name, nu, m, len(sim.body), len(sim.body.bonds), row[2], *row[3:]))
    return rows


def against_horizon():
    """Rows (δ/width of the bump, error of each model against classical elasticity), all exact."""
    x = (np.arange(60) + 0.5) / 60 * SIDE
    X = np.stack(np.meshgrid(x, x, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    return [
        (h / WIDTH, *(difference(exact(key, X, END, h), exact(key, X, END, 0)) for key, _ in MATERIALS.values()))
        for h in HORIZON * 0.5 ** np.arange(5)
    ]


def against_classical(finest):
    """Rows (material, δ/Δx, width of the bump/Δx, nodes, steps, CPU s, error against classical elasticity): both δ and
    Δx go to 0."""
    rows = []
    corrected = "pmb", lambda nu: pd.PMB(youngs=YOUNGS, volume_correction=nu, surface_correction="energy")
    for name, (key, make) in {**MATERIALS, CORRECTED: corrected}.items():
        for m in (2, 3, 4):
            for n in [k for k in (20, 40, 80, 160, 240) if k <= 20 * finest]:
                sim, steps = plate(m, make(True), horizon=m * SIDE / n)
                cpu = run(sim, steps)
                rows.append(
                    (
                        name,
                        m,
                        WIDTH * n,
                        len(sim.body),
                        steps,
                        cpu,
                        difference(sim.state.u_nc / AMPLITUDE, exact(key, sim.body.X_nc, END, 0)),
                    )
                )
    return rows


def against_step(m=4):
    """Rows (Δt/stable, steps, CPU s, error of the displacement against Δt → 0, largest error of the energy)."""
    rows, fine = [], None
    for share in (0.0125, 0.025, 0.05, 0.1, 0.2, 0.4, 0.7, 1.0):
        sim, steps = plate(m, pd.PMB(youngs=YOUNGS), share)
        start, worst, cpu = sim.energies().total, 0.0, 0.0
        for k in range(steps):
            began = time.process_time()
            sim.step(1)
            cpu += time.process_time() - began
            if k % max(1, steps // 60) == 0:
                worst = max(worst, abs(sim.energies().total / start - 1))
        if fine is None:
            fine = sim.state.u_nc[:, :2].copy()
            continue
        rows.append((sim.dt / sim.time_step_stable, steps, cpu, difference(sim.state.u_nc, fine), worst))
    return rows


def against_precision(m=3):
    """Rows (amplitude, what is rounded to float32 after every step, error of the displacement against float64)."""
    rows = []

    def rounded(sim, what):
        z, v = sim._z, sim.state.v_nc
        v[:] = v.astype(np.float32)
        if what == "positions":
            z[:, :3] = (z[:, :3] + z[:, 3:6]).astype(np.float32).astype(float) - z[:, 3:6]
        else:
            z[:, :3] = z[:, :3].astype(np.float32)

    for amplitude in (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2):
        sim, steps = plate(m, pd.PMB(youngs=YOUNGS), amplitude=amplitude)
        sim.step(steps)
        want = sim.state.u_nc[:, :2].copy()
        for what in ("displacements", "positions"):
            sim, steps = plate(m, pd.PMB(youngs=YOUNGS), amplitude=amplitude)
            sim.step(steps, callback=lambda s, what=what: rounded(s, what))
            rows.append((amplitude / WIDTH * np.exp(-0.5), what, difference(sim.state.u_nc, want)))
    return rows


def picture(path, spacing, horizon, classical, step, precision):
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, panels = plt.subplots(2, 3, figsize=(13.5, 7.6), constrained_layout=True)
    colours = dict(zip(MATERIALS, ("tab:blue", "tab:orange", "tab:green"), strict=True))
    for name, colour in colours.items():
        for nu, style, word in ((True, "o-", "with ν"), (False, "s--", "without ν")):
            mine = [r for r in spacing if r[0] == name and r[1] == nu]
            panels[0, 0].loglog(
                [r[2] for r in mine], [r[5] for r in mine], style, color=colour, label=f"{name} {word}", ms=4, lw=1.2
            )
            panels[0, 1].loglog([r[7] for r in mine], [r[8] for r in mine], style, color=colour, ms=4, lw=1.2)
    m = np.unique([r[2] for r in spacing])
    panels[0, 0].set(
        xlabel="δ/Δx", ylabel="error of the displacement", title="spacing at one δ, against Δx → 0", xticks=m
    )
    panels[0, 0].xaxis.set_major_formatter("{x:.0f}")
    panels[0, 0].xaxis.set_minor_formatter("")
    panels[0, 0].legend(fontsize=7, ncol=2)
    panels[0, 1].set(
        xlabel="CPU seconds, δ/Δx from 2 upwards",
        ylabel="error of the displacement",
        title="speed against error at one δ, Δt = 0.7",
    )
    s = np.array([r[0] for r in step])
    panels[1, 1].loglog(s, [r[3] for r in step], "o-", color="tab:blue", ms=4, label="displacement, against Δt → 0")
    panels[1, 1].loglog(s, [r[4] for r in step], "s-", color="tab:red", ms=4, label="total energy")
    panels[1, 1].loglog(s, step[0][3] * (s / s[0]) ** 2, "k:", lw=0.8, label="Δt²")
    panels[1, 1].set(xlabel="Δt / stable step", ylabel="relative error", title="time step (PMB, δ = 4Δx)")
    panels[1, 1].legend(fontsize=7)
    for k, (name, colour) in enumerate({**colours, CORRECTED: "tab:purple"}.items()):
        if name != CORRECTED:
            panels[0, 2].loglog(
                [r[0] for r in horizon], [r[1 + k] for r in horizon], "o-", color=colour, ms=4, lw=1.2, label=name
            )
        for m, style in ((2, ":"), (3, "-"), (4, "--")):
            mine = [r for r in classical if r[:2] == (name, m)]
            panels[1, 0].loglog(
                [r[5] for r in mine],
                [r[6] for r in mine],
                f"o{style}",
                color=colour,
                ms=4,
                lw=1.2,
                label=name if m == 3 else None,
            )
    panels[0, 2].set(
        xlabel="δ / width of the bump",
        ylabel="error of the model (exact)",
        title="horizon, against classical elasticity",
    )
    panels[0, 2].legend(fontsize=7)
    panels[1, 0].set(
        xlabel="CPU seconds, Δx and δ together smaller",
        ylabel="error of the displacement",
        title="the same, to classical elasticity",
    )
    panels[1, 0].legend(fontsize=7, loc="lower left", title="δ = 2Δx dotted, 3Δx solid, 4Δx dashed", title_fontsize=7)
    for what, colour in (("displacements", "tab:blue"), ("positions", "tab:red")):
        mine = [r for r in precision if r[1] == what]
        panels[1, 2].loglog(
            [r[0] for r in mine], [r[2] for r in mine], "o-", color=colour, ms=4, label=f"{what} in float32"
        )
    panels[1, 2].set(
        xlabel="largest strain at the start", ylabel="error against float64", title="precision (PMB, δ = 3Δx)"
    )
    panels[1, 2].legend(fontsize=7)
    for p in panels.flat:
        p.grid(alpha=0.3, which="both", lw=0.4)
    figure.savefig(path, dpi=100)


def main(path=None, finest=12):
    began = time.perf_counter()
    for _, make in MATERIALS.values():  # compile first
        sim, _ = plate(2, make(True))
        sim.step(2)
    spacing, horizon, classical = against_spacing(finest), against_horizon(), against_classical(finest)
    step, precision = against_step(min(4, finest)), against_precision(min(3, finest))
    print(
        f"A bump of displacement in a periodic plate, after it has spread over it: δ = {HORIZON:g} of the side, bump "
        f"of width {WIDTH:g}. Relative L2 errors.\n"
    )
    print(
        "| material | ν | δ/Δx | nodes | bonds | error, Δt = 0.1 | error, Δt = 0.7 | steps | CPU s "
        "|\n|---|---|---:|---:|---:|---:|---:|---:|---:|"
    )
    for name, nu, m, n, b, slow, steps, cpu, fast in spacing:
        print(f"| {name} | {'yes' if nu else 'no'} | {m} | {n} | {b} | {slow:.2e} | {fast:.2e} | {steps} | {cpu:.2g} |")
    print(f"\n| δ / width | {' | '.join(MATERIALS)} |\n|---:|{'---:|' * len(MATERIALS)}")
    for size, *errors in horizon:
        print(f"| {size:.3f} | {' | '.join(f'{e:.2e}' for e in errors)} |")
    print(
        "\n| material | δ/Δx | width/Δx | nodes | steps | CPU s | error against classical elasticity "
        "|\n|---|---:|---:|---:|---:|---:|---:|"
    )
    for name, m, w, n, steps, cpu, error in classical:
        print(f"| {name} | {m} | {w:.1f} | {n} | {steps} | {cpu:.2g} | {error:.2e} |")
    print(
        "\n| Δt / stable step | steps | CPU s | displacement, against Δt → 0 | total energy "
        "|\n|---:|---:|---:|---:|---:|"
    )
    for share, steps, cpu, error, energy in step:
        print(f"| {share:.3f} | {steps} | {cpu:.3g} | {error:.2e} | {energy:.2e} |")
    print("\n| largest strain | displacements in float32 | positions in float32 |\n|---:|---:|---:|")
    for strain in dict.fromkeys(r[0] for r in precision):
        a, b = (next(r[2] for r in precision if r[0] == strain and r[1] == w) for w in ("displacements", "positions"))
        print(f"| {strain:.1e} | {a:.1e} | {b:.1e} |")
    if path:
        picture(path, spacing, horizon, classical, step, precision)
        print(f"\npicture: {path}")
    print(f"\n{time.perf_counter() - began:.0f} s in all")


if __name__ == "__main__":
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--picture", help="the PNG to write")
    p.add_argument("--fine", type=int, default=12, help="largest δ/Δx, up to 16")
    a = p.parse_args()
    main(a.picture, a.fine)
