"""``atc upscale``: molecular dynamics to peridynamics in one dimension. Only the options live here; the work is in
`atc.upscaling`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ..errors import AtcError
from .common import Json, option

group = typer.Typer(
    name="upscale",
    help="Molecular dynamics to peridynamics in one dimension: the paper of Seleson, Parks, Gunzburger and Lehoucq "
    "(2009) computed again, and chains of your own.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

Folder = Annotated[
    Path, option("-o --output OUTDIR", "Directory for report.html, pictures, numbers.json and runs as .nc.")
]
Quiet = Annotated[bool, option("-q --quiet", "Print nothing.")]


def _table(report, quiet: bool) -> None:
    if quiet:
        return
    for c in report.claims:
        print(
            f"{c.where}: {c.claim}\n    {c.measured}\n    -> {c.verdict}{': ' + c.assumption if c.assumption else ''}"
        )
    print(f"report: {report.folder / 'report.html'}")


def _teller(quiet: bool):
    import sys

    return (lambda text: None) if quiet or not sys.stderr.isatty() else (lambda text: print(text, file=sys.stderr))


@group.command()
def springs(output: Folder, quiet: Quiet = False) -> None:
    """Section 4 of the paper: every figure and table for linear springs, claim by claim, and better coarse models. Half
    a minute."""
    from ..upscaling.reports.springs import springs_report

    _table(springs_report(output, _teller(quiet)), quiet)


@group.command()
def lj(
    output: Folder,
    half_width: Annotated[float, option("--half-width W", "Of the initial bump.")] = 100.0,
    amplitude: Annotated[float, option("--amplitude A", "Of the initial bump.")] = 2.0,
    dt: Annotated[float, option("--dt T", "Time step.")] = 0.1,
    duration: Annotated[float, option("--duration T", "Length of the runs.")] = 300.0,
    beyond_spinodal: Annotated[
        str, option("--beyond-spinodal refuse|allow", "Lennard-Jones bonds stretched until they soften.")
    ] = "refuse",
    quiet: Quiet = False,
) -> None:
    """Section 5 of the paper: the Lennard-Jones chain, its shocks and energies, claim by claim."""
    from ..upscaling.reports.lennard_jones import lj_report

    bump = {"half_width": half_width, "amplitude": amplitude}
    how = {"dt": dt, "duration": duration, "beyond_spinodal": beyond_spinodal, "progress": _teller(quiet)}
    _table(lj_report(output, **bump, **how), quiet)


@group.command()
def series(
    order: Annotated[int, option("--order M", "Number of terms; the last derivative is twice that.")] = 4,
    neighbors: Annotated[
        str, option("--neighbors N|exact|leading", "A number; polynomials in N; or large N, which is peridynamics.")
    ] = "exact",
    inner: Annotated[int | None, option("--inner DEGREE", "The inner expansion of this odd degree instead.")] = None,
    lennard_jones: Annotated[bool, option("--lj", "The Lennard-Jones chain (eq. 5.2) instead of springs.")] = False,
    json: Json = False,
) -> None:
    """Higher-order gradient series and dispersion series in exact rationals, and what each truncation is good for."""
    import json as _json

    from ..upscaling.gradients import Polynomial, dispersion_series, inner_series, spring_series, well_posedness

    count: int | str = int(neighbors) if neighbors.isdigit() else neighbors
    if count not in ("exact", "leading") and not isinstance(count, int):
        raise AtcError(f"--neighbors {neighbors}: expected a whole number, exact or leading")
    if lennard_jones:
        from ..upscaling.gradients_nonlinear import lennard_jones_equation

        terms = lennard_jones_equation(order)
        rows = [
            {
                "sigma_power": s,
                "a_power": level - 1,
                "zeta": s + 1 - level,
                "derivatives": list(o),
                "stretch_power": -(s + 1 + len(o)),
                "coefficient": str(c),
            }
            for (s, level, o), c in sorted(terms.items())
        ]
        if json:
            print(_json.dumps(rows, indent=1))
            return
        print("rho y_tt / epsilon = sum of coefficient * sigma^s a^p Z(z)/Z(s) * derivatives / (y')^n")
        for r in rows:
            product = " ".join(f"y({k})" for k in r["derivatives"])
            print(
                f"  {r['coefficient']:>14}  sigma^{r['sigma_power']} a^{r['a_power']} "
                f"Z({r['zeta']})/Z({r['sigma_power']})  {product} / (y')^{-r['stretch_power']}"
            )
        return
    if inner is not None:
        count = 1 if count == "exact" else count
        terms = inner_series(inner, count)
    else:
        terms = spring_series(order, count)
    waves = dispersion_series(terms)
    verdicts = [] if count == "exact" else [str(well_posedness(terms[: m + 1])) for m in range(len(terms))]
    length = "Na" if count == "leading" else "a"
    if json:
        found = {"length": length, "gradient": list(map(str, terms)), "dispersion": list(map(str, waves))}
        print(_json.dumps({**found, "well_posedness": verdicts}, indent=1))
        return
    print(f"rho y_tt = K1 sum of c_m L^(2m-2) d^(2m)y/dx^(2m), L = {length};   omega = c k sum of d_m (kL)^(2m)")
    for m, (c, d) in enumerate(zip(terms, waves), 1):
        verdict = f"   cut here: {verdicts[m - 1]}" if verdicts else ""
        print(f"  c_{m} = {c if isinstance(c, Polynomial) else str(c)}\n  d_{m - 1} = {d}{verdict}")


@group.command()
def chain(
    output: Annotated[Path, option("-o --output OUT", "The run as .nc or .zarr; a picture goes beside it.")],
    model: Annotated[str, option("--model NAME", "springs, lj, or pd (peridynamics with --horizon).")] = "springs",
    spacing: Annotated[float, option("--spacing DX", "Distance of the nodes.")] = 0.25,
    neighbors: Annotated[int, option("--neighbors M", "On either side (springs, lj).")] = 20,
    horizon: Annotated[float | None, option("--horizon D", "For pd: a multiple of the spacing.")] = None,
    coarse: Annotated[
        str | None, option("--coarse METHOD,FACTOR", "Coarsen the springs first: band,2 or moments-4,2 (horizon kept).")
    ] = None,
    length: Annotated[float, option("--length L", "Of the chain.")] = 1000.0,
    initial: Annotated[str, option("--initial SHAPE", "bump or square, in the middle, at rest.")] = "bump",
    half_width: Annotated[float, option("--half-width W", "Of the initial shape.")] = 10.0,
    amplitude: Annotated[float, option("--amplitude A", "Of the initial shape.")] = 1.0,
    duration: Annotated[float, option("--duration T", "Length of the run.")] = 300.0,
    dt: Annotated[
        float | None, option("--dt T", "Time step; default: eq. 4.13 with 0.85, for lj 0.1 of the stable one.")
    ] = None,
    boundary: Annotated[str, option("--boundary NAME", "periodic or clamped.")] = "clamped",
    rows: Annotated[int, option("--rows N", "Recorded times, about.")] = 300,
    beyond_spinodal: Annotated[
        str, option("--beyond-spinodal refuse|allow", "Lennard-Jones bonds stretched until they soften.")
    ] = "refuse",
    quiet: Quiet = False,
) -> None:
    """One run of a chain of your own by velocity Verlet: a dataset and its space-time picture. Modulus and density are
    1."""
    from ..upscaling.custom import run_chain

    nodes = {"spacing": spacing, "neighbors": neighbors, "horizon": horizon, "coarse": coarse, "length": length}
    shape = {"initial": initial, "half_width": half_width, "amplitude": amplitude, "boundary": boundary}
    how = {"duration": duration, "dt": dt, "rows": rows, "beyond_spinodal": beyond_spinodal}
    run, picture = run_chain(output, model=model, **nodes, **shape, **how)
    if not quiet:
        drift = abs(run.total_t / run.total_t[0] - 1).max()
        print(
            f"{run.model.name}: {len(run.x_n)} nodes, {run.model.neighbors} neighbours, dt = {run.dt:.6g}, "
            f"{len(run.t_t)} recorded times; largest relative change of the energy {drift:.1e}"
        )
        print(f"dataset: {output}\npicture: {picture}")
