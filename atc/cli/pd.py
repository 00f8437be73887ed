"""``atc pd``: runs a peridynamic body."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

from .common import Output, Overwrite, Quiet, argument, duration, kept_on_interrupt, option, progress_bar


def pd(
    case: Annotated[Path, argument("CASE", "The case, a TOML file.")],
    output: Output = None,
    set: Annotated[
        list[str] | None,
        option("--set SECTION.KEY=VALUE", "Override a key of the case, e.g. --set run.steps=100. Repeatable."),
    ] = None,
    jobs: Annotated[int, option("-j --jobs N", "Processor cores to use; 0 is all of them.")] = 0,
    check: Annotated[bool, option("--check", "Only say what would be run: nodes, bonds, time step, memory.")] = False,
    restart: Annotated[bool, option("--restart", "Forget what an interrupted run has done.")] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Run a peridynamic body. After an interruption the same command continues, with the same result as if there had
    been none."""
    from ..cases.case import Case
    from ..errors import AtcError

    if jobs < 0:
        raise AtcError(f"-j {jobs}: expected a number of processor cores, or 0 for all of them")
    made = Case.load(case, set)
    if check:
        print(describe(made))
        return
    out = made.output(output, overwrite=overwrite, resume=not restart)
    started = time.perf_counter()
    kept = kept_on_interrupt("what is done is kept: the same command continues")
    with kept, progress_bar(quiet, "steps") as progress:
        ds = made.run(out, threads=jobs, progress=progress, resume=not restart)
    if not quiet:
        summary(ds, out, time.perf_counter() - started, progress)


def describe(case) -> str:
    """What a case would run."""
    from ..cases.build import amounts, said_amounts

    sim = case.simulation(1)
    body, run = sim.body, case.data["run"]
    state = sum(a.nbytes for a in sim.state.to_arrays().values())
    bonds = len(body.bonds)
    return "\n".join(
        [
            f"{len(body)} nodes in {body.dimension} dimension{'s' * (body.dimension > 1)}, {bonds} bonds, horizon "
            f"{body.horizon:g} = {body.horizon / body.spacing:.3g} spacings",
            *_held_together(case, sim),
            f"time step {sim.dt:.4g}, {sim.dt / sim.time_step_stable:.2f} of the stable {sim.time_step_stable:.4g}; "
            f"{run['steps']} steps to {run['steps'] * sim.dt:.4g}",
            f"broken at the start: {sim.n_broken} bonds; one saved state takes {state / 1e6:.1f} MB",
            said_amounts(amounts(case, body)),
        ]
    )


def _held_together(case, sim) -> list[str]:
    """A line for each material, and one for each pair of them that has bonds or an interface of its own."""
    import numpy as np

    from ..cases.damage import between

    names = {m.get("id", k + 1): f" {m['name']}" for k, m in enumerate(case.data["material"]) if "name" in m}
    numbers, table, rule = sim.body.material_n, sim.body.bonds, sim.model.rule
    pairs, counts = np.unique(np.sort([numbers[table.i_b], numbers[table.j_b]], axis=0), axis=1, return_counts=True)
    bonds = {tuple(int(m) for m in p): int(n) for p, n in zip(pairs.T, counts, strict=True)}
    own = {between(case, k): t for k, t in enumerate(case.data.get("interface", []))}

    def breaks(pair):
        if rule.Gc is not None and np.isfinite(rule.Gc[sim.model.kinds[pair]]):
            return f"break when the work on them is their share of Gc = {rule.Gc[sim.model.kinds[pair]]:.4g}"
        s00, alpha = rule.s00[sim.model.kinds[pair]], rule.alpha[sim.model.kinds[pair]]
        more = f", alpha {alpha:g}" if alpha else ""
        return f"break at a stretch of {s00:.4g}{more}" if np.isfinite(s00) else "never break"

    lines = [
        f"material {n}{names.get(n, '')}: {m.name}, {int((numbers == n).sum())} nodes, {bonds.get((n, n), 0)} bonds "
        f"that {breaks((n, n))}"
        for n, m in sorted(sim.materials.items())
    ]
    for pair in sorted({p for p in bonds if p[0] != p[1]} | set(own)):
        t = own.get(pair, {})
        if not t.get("bonded", True):
            lines.append(f"between {pair[0]} and {pair[1]}: no bonds")
            continue
        stiffness = f", {t['stiffness']:g} times as stiff as by default," if "stiffness" in t else ""
        lines.append(f"between {pair[0]} and {pair[1]}: {bonds.get(pair, 0)} bonds{stiffness} that {breaks(pair)}")
    return lines


def summary(ds, out, seconds, progress) -> None:
    """Print what a run has come to."""
    from ..cases.build import said_amounts

    done = progress.total - progress.there
    before = (
        f"{progress.there} of {progress.total} steps were there, {done} computed" if progress.there else f"{done} steps"
    )
    print(f"{out}: {ds.attrs['quantities']} of {ds.sizes['node']} nodes at {ds.sizes['frame']} times")
    if "mass" in ds.attrs:
        print(said_amounts(ds.attrs))
    total = ds["energy_total"].values
    moved = max(float(abs(ds[f"energy_{k}"]).max()) for k in ("kinetic", "strain", "work_external", "work_constraint"))
    drift = ""
    if moved > 0:
        drift = f"; the energy ledger closes to {abs(total - total[0]).max() / moved:.1e} of its largest part"
        if "conductivity" in ds.attrs["case"] and "expansion" in ds.attrs["case"]:
            drift += " (what heat brings of strain energy stands in none)"
    print(
        f"broken bonds: {int(ds['n_broken'][-1])} of {ds.attrs['bonds']}; largest damage "
        f"{float(ds['damage'][-1].max()) if 'damage' in ds else float('nan'):.3g}{drift}"
    )
    print(
        f"{before} in {duration(seconds)}"
        + (f" ({1000 * seconds / done:.3g} ms a step, start and output included)" if done > 1 else "")
    )
