"""One chain as the command line asks for it: model, run, dataset, picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..running.output import check_name, explained
from ..running.whole import write_dataset
from .chain import LennardJones, Springs, bump, positive, square_pulse, whole
from .coarse import coarsen
from .evolve import History, count_steps, verlet
from .reports.report import STYLE, draw_density


def run_chain(
    output,
    *,
    model="springs",
    spacing=0.25,
    neighbors=20,
    horizon=None,
    coarse=None,
    length=1000.0,
    initial="bump",
    half_width=10.0,
    amplitude=1.0,
    duration=300.0,
    dt=None,
    boundary="clamped",
    rows=300,
    beyond_spinodal="refuse",
) -> tuple[History, Path]:
    """Run one chain, write the dataset to `output` (.nc or .zarr) and its space-time picture beside it. Returns the run
    and the picture's path."""
    output = writable(output)
    if model not in ("springs", "lj", "pd"):
        raise AtcError(f"--model {model}: expected springs, lj or pd")
    if (horizon is not None) != (model == "pd"):
        why = ", which needs it" if horizon is None else f"; {model} has --neighbors"
        raise AtcError(f"--horizon goes with --model pd{why}")
    if model == "lj":
        chain = LennardJones(spacing, neighbors)
    elif model == "pd":
        chain = Springs.peridynamics(horizon, spacing)
    else:
        chain = Springs.paper(spacing, neighbors)
    if coarse is not None:
        if model == "lj":
            raise AtcError(
                "--coarse goes with springs and pd; a Lennard-Jones chain is coarsened by --spacing and --neighbors"
            )
        chain, dt = _coarsened(chain, coarse, dt)
    n = round(positive("length", length) / chain.spacing) + 1
    if n > 2_000_000:
        raise AtcError(f"{n} nodes: expected at most 2,000,000; take a larger spacing or a shorter chain")
    x = np.arange(n) * chain.spacing
    shapes = {"bump": bump, "square": square_pulse}
    if initial not in shapes:
        raise AtcError(f"--initial {initial}: expected bump or square")
    u0 = shapes[initial](x, length / 2, positive("half_width", half_width), amplitude)
    if not np.any(u0):
        raise AtcError(
            "the initial displacement is zero everywhere: give an amplitude other than 0, and a half-width of a few "
            "spacings"
        )
    if dt is None:
        dt = 0.1 * chain.stable_time_step if model == "lj" else chain.time_step()
    steps = count_steps(duration, dt)
    if steps < 1:
        raise AtcError(f"--duration {duration:g} is shorter than one time step, {dt:g}")
    every = max(1, -(-steps // whole("rows", rows)))
    run = verlet(chain, u0, dt=dt, steps=steps, every=every, boundary=boundary, beyond_spinodal=beyond_spinodal)
    write_dataset(run.dataset(), output)
    return run, _picture(run, output.with_suffix(".png"))


def _coarsened(chain, text, dt):
    method, _, factor = text.partition(",")
    try:
        factor = int(factor)
        if factor < 1 or chain.neighbors % factor:
            raise ValueError
    except ValueError:
        raise AtcError(
            f"--coarse {text}: expected METHOD,FACTOR with a FACTOR that divides the {chain.neighbors} neighbours, "
            "e.g. band,2"
        ) from None
    spacing, M = chain.spacing * factor, chain.neighbors // factor
    if method == "band-in-time" and dt is None:
        dt = Springs.paper(spacing, M).time_step()  # the fit holds for this step and no other
    return coarsen(chain, spacing, M, method, dt=dt), dt


def _picture(run, path):
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        fig = Figure(figsize=(10, 4), layout="constrained")
        left, middle, right = fig.subplots(1, 3, width_ratios=[1.3, 1.3, 0.9])
        title = f"{run.model.name}: density over density at rest"
        fig.colorbar(draw_density(left, run.x_n, run.t_t, run.density_tn, title), ax=left)
        for t in np.linspace(0, run.t_t[-1], 4):
            middle.plot(run.x_n, run.at(t), label=f"t = {t:.4g}")
        middle.set(title="displacement", xlabel="reference position")
        middle.legend()
        for values, name in ((run.kinetic_t, "kinetic"), (run.potential_t, "potential"), (run.total_t, "total")):
            right.plot(run.t_t, values, label=name)
        right.set(title="energy", xlabel="time")
        right.legend()

        with explained(path):
            fig.savefig(path, metadata={"Software": None})
    return path


def writable(path) -> Path:
    """The path of a dataset that can be written, or an error that says why not."""
    path = check_name(path)
    if not path.parent.is_dir():
        raise AtcError(f"{path}: the directory {path.parent} does not exist")
    return path
