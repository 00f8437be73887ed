"""``atc advect``: nonlocal advection. Only the options live here; the work is in `atc.advection` and
`atc.advection.study`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import option, parse_numbers


def advect(
    output: Annotated[Path, option("-o --output OUT", "The run as .nc or .zarr; a picture goes beside it.")],
    initial: Annotated[
        str, option("--initial FORMULA", "u at t = 0, a formula of x (and L, the period).")
    ] = "sin(2*pi*x/L)",
    length: Annotated[float, option("--length L", "The period.")] = 1.0,
    nodes: Annotated[int, option("--nodes N", "Grid points.")] = 1024,
    kernel: Annotated[
        str,
        option(
            "--kernel NAME|FORMULA|FILE",
            "box, triangle, gaussian; a formula of s = |z|/horizon; or a file with columns s and b(s).",
        ),
    ] = "gaussian",
    horizon: Annotated[
        float, option("--horizon D", "Reach of the kernel; three standard deviations of gaussian, which reaches 3 D.")
    ] = 0.02,
    smoothing_kernel: Annotated[
        str | None,
        option(
            "--smoothing-kernel NAME|FORMULA|FILE",
            "Profile of the regularisation's kernel, as --kernel; by default the same.",
        ),
    ] = None,
    smoothing_horizon: Annotated[
        float | None, option("--smoothing-horizon D", "Its reach; by default that of --horizon.")
    ] = None,
    viscosity: Annotated[float, option("--viscosity EPS", "Strength of the regularisation; 0 is inviscid.")] = 0.01,
    flux: Annotated[str, option("--flux NAME|FORMULA", "burgers (u^2/2), or a formula of u.")] = "burgers",
    two_point: Annotated[
        str, option("--two-point NAME", "midpoint, or conserving (energy constant at viscosity 0).")
    ] = "midpoint",
    duration: Annotated[float, option("--duration T", "How long.")] = 1.0,
    frames: Annotated[int, option("--frames N", "Recorded times.")] = 101,
    method: Annotated[str, option("--method NAME", "auto, fft (Burgers) or stencil.")] = "auto",
    safety: Annotated[float, option("--safety C", "Part of the stable time step to take.")] = 0.5,
    reference: Annotated[
        bool, option("--reference/--no-reference", "Compare with the local equation (Cole-Hopf, Hopf-Lax).")
    ] = True,
    horizons: Annotated[
        str | None, option("--horizons H1,H2,...", "A study instead: these horizons against Cole-Hopf at the end.")
    ] = None,
    fluxes: Annotated[bool, option("--fluxes", "Write the explicit nonlocal fluxes too, between the nodes.")] = False,
    quiet: Annotated[bool, option("-q --quiet", "Print nothing.")] = False,
) -> None:
    """Nonlocal advection in one dimension: Burgers or another flux, shocks, mass and entropy ledgers, against the local
    equation."""
    from ..advection.study import Problem, convergence_study, picture, run_study
    from ..running.whole import write_dataset
    from ..upscaling.custom import writable

    output = writable(output)
    if horizons is not None and (smoothing_horizon is not None or fluxes):
        what = "--smoothing-horizon" if smoothing_horizon is not None else "--fluxes"
        raise AtcError(f"{what}: is of one run; leave it out, or leave out --horizons")
    values = parse_numbers("--horizons", horizons, "lengths, e.g. --horizons 0.08,0.04,0.02", len)
    problem = Problem(
        initial, length, nodes, kernel, viscosity, flux, two_point, duration, method, safety, smoothing_kernel
    )
    if values is not None:
        study = convergence_study(problem, values)
    else:
        study = run_study(problem, horizon, frames, reference, smoothing_horizon, fluxes)
    write_dataset(study.dataset, output)
    drawn = picture(study, output.with_suffix(".png"))
    if not quiet:
        print("\n".join(study.lines))
        print(f"dataset: {output}\npicture: {drawn}")
