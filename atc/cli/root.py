"""The command line: ``atc info | plan | fields | verify | compare | check | conductivity | bench | plot``.

Only what every command needs is imported here, so that ``atc --help`` is instant: numba, xarray and matplotlib come
with the commands that use them.

Exit status: 0 done; 1 ``atc check`` found a broken law, or ``atc verify`` a difference; 2 unusable input (one line on
stderr, never a traceback); 130 interrupted, 143 terminated, 129 hung up (what is finished is kept); 1 anything atc did
not foresee (ATC_DEBUG=1 shows the traceback).
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
import warnings
from pathlib import Path
from typing import Annotated

import typer
from typer.core import TyperGroup

from .. import __version__
from ..errors import AtcError
from ..running.interruption import last, watched
from ..terminal import only_printable, printable
from . import advect as cli_advect
from . import bench as cli_bench
from . import dispersion as cli_dispersion
from . import init as cli_init
from . import pd as cli_pd
from . import profile as cli_profile
from . import report as cli_report
from . import twin as cli_twin
from . import upscale as cli_upscale
from . import verify as cli_verify
from .common import (
    Begin,
    By,
    End,
    Ends,
    Jobs,
    Json,
    Masses,
    Overwrite,
    Progress,
    PublishedUnits,
    Quiet,
    SceneFile,
    Select,
    Set,
    Species,
    Step,
    Topology,
    UnitsOption,
    console,
    duration,
    heard,
    interrupted,
    kept_on_interrupt,
    load_scene,
    parse_masses,
    progress_bar,
    select_atoms,
)


def _fail(message: str, status: int) -> None:
    print("error: " + printable(" ".join(str(message).split())), file=sys.stderr, flush=True)
    sys.exit(status)


def _show_warning(message, category, filename, lineno, file=None, line=None) -> None:
    print("warning: " + printable(" ".join(str(message).split())), file=sys.stderr, flush=True)


@contextlib.contextmanager
def _one_line_warnings():
    """Warnings of atc as one line each; those of libraries are for developers."""
    import logging

    from ..errors import AtcWarning

    with warnings.catch_warnings():
        if not os.environ.get("ATC_DEBUG"):
            # It has its say about folders for its own cache.
            logging.getLogger("matplotlib").setLevel(logging.ERROR)
            warnings.simplefilter("ignore")
            warnings.simplefilter("default", AtcWarning)
            warnings.showwarning = _show_warning
        yield


class _Commands(TyperGroup):
    """A command group that turns every failure into one line and an exit status."""

    def main(self, args=None, prog_name=None, complete_var=None, standalone_mode=True, **extra):
        if not standalone_mode:
            return super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
        _outputs_opened().clear()
        if os.environ.get("ATC_DEBUG"):
            status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.exit(status if isinstance(status, int) else 0)
        try:
            with _one_line_warnings(), only_printable(), watched():
                status = super().main(args, prog_name, complete_var, standalone_mode=False, **extra)
            sys.stdout.flush()
        except AtcError as e:
            if isinstance(e.__cause__ or e.__context__, (OSError, RuntimeError)):
                _fail_damaged()
            _fail(e, 2)
        except KeyboardInterrupt:
            _stopped()
        except BrokenPipeError:
            _leave_quietly()
        except SystemExit as e:  # typer's way with a broken pipe
            if isinstance(e.__context__, BrokenPipeError):
                _leave_quietly()
            raise
        except MemoryError as e:
            _fail(
                f"not enough memory{': ' + str(e) if str(e) else ''}: take a coarser grid, a smaller radius or fewer "
                "jobs (-j 1)",
                2,
            )
        except OSError as e:
            _fail_damaged()
            _fail(f"{e.filename + ': ' if isinstance(e.filename, str) else ''}{e.strerror or e}", 2)
        except Exception as e:
            names = {c.__name__ for c in type(e).__mro__}
            if "NoArgsIsHelpError" in names:
                print(e.ctx.get_help())
                sys.exit(2)
            if "ClickException" in names:
                ctx = getattr(e, "ctx", None)
                hint = f" (see: {ctx.command_path} --help)" if ctx is not None else ""
                _fail(e.format_message() + hint, 2)
            if "Abort" in names:
                _stopped()
            _fail_damaged()
            _fail(f"{type(e).__name__}: {e}: atc did not foresee this; run again with ATC_DEBUG=1 for the traceback", 1)
        if status == 130:  # typer's way with Ctrl-C
            _stopped()
        sys.exit(status if isinstance(status, int) else 0)


def _fail_damaged() -> None:
    """Say so if one of the outputs that this command was reading is no longer what was written."""
    for path in _outputs_opened():
        from ..running.output import damage

        why = damage(path)
        if why:
            _fail(why, 2)


def _outputs_opened() -> list:
    """The outputs that this command has opened, without importing what opens them."""
    output = sys.modules.get("atc.running.output")
    return output.opened if output else []


def _stopped() -> None:
    """The end of a command that a signal has stopped."""
    signal = last()
    _fail(interrupted(*[signal.word] if signal else []), signal.status if signal else 130)


def _leave_quietly() -> None:
    """The reader of our output (head, less) has left: not an error, and the interpreter must not complain at exit
    either."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.exit(0)


app = typer.Typer(
    cls=_Commands,
    name="atc",
    help="Molecular-dynamics trajectories to continuum fields: Hardy stress, virial stress, density, temperature, "
    "each with a stated error.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def main() -> None:
    """Entry point of the ``atc`` command."""
    app(prog_name="atc")


def _version(value: bool) -> None:
    if value:
        print(f"atc {__version__}")
        raise typer.Exit()


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    pass


def _summary(attributes: dict, out, seconds: float, progress: Progress) -> None:
    """Closing lines: where the result is, what is in it, how accurate it is, how long it took."""
    computed = progress.total - progress.there
    before = (
        f"{progress.there} of {progress.total} frames were there, {computed} computed"
        if progress.there
        else f"{computed} frame{'s' * (computed != 1)}"
    )
    print(f"{out}: {attributes['quantities']}")
    error = attributes.get("measured_error")
    if error is not None:
        print(
            f"measured error {float(error):.1e} of the largest value (tolerance {float(attributes['tolerance']):g}), "
            "at random points by the exact method"
        )
    rounding = attributes.get("input_error")
    if rounding is not None and error is not None and float(rounding) > float(error):
        print(
            f"input error {float(rounding):.1e}: what rounding the coordinates to "
            f"{float(attributes['input_resolution']):.1g} left in doubt"
        )
    print(
        f"{before} in {duration(seconds)}"
        + (f" ({computed / seconds:.3g} frames/s, start included)" if computed > 1 else "")
    )


# --------------------------------------------------------------------------------------------------------------------
# Commands.


@app.command()
def info(
    trajectory: Annotated[
        list[str],
        typer.Argument(
            metavar="TRAJ...",
            help="A trajectory: LAMMPS dump or data file, or anything ASE or MDAnalysis reads; several files are "
            "joined. Or a scene.",
            show_default=False,
        ),
    ],
    topology: Topology = None,
    units: UnitsOption = None,
    masses: Masses = None,
    dimension: Annotated[
        int | None,
        typer.Option(
            "--dimension", metavar="2|3", help="2: a run in the plane (LAMMPS's dimension 2).", show_default=False
        ),
    ] = None,
    atom_style: Annotated[
        str | None,
        typer.Option(
            "--atom-style",
            metavar="STYLE",
            help="What the columns of a LAMMPS data file are, e.g. full.",
            show_default=False,
        ),
    ] = None,
    json: Json = False,
) -> None:
    """What is in a trajectory, in which units, how precise, and what can be computed from it; or what is in an output
    of atc.

    Of a scene also whether the forces in its trajectory are those of its potential.
    """
    from ..analysis.info import describe, describe_output, describe_scene, is_output

    if len(trajectory) == 1 and is_output(trajectory[0]):
        report = describe_output(trajectory[0])
    elif len(trajectory) == 1 and trajectory[0].endswith(".toml"):
        given = [
            flag
            for flag, value in (
                ("--topology", topology),
                ("--units", units),
                ("--masses", masses),
                ("--dimension", dimension),
                ("--atom-style", atom_style),
            )
            if value is not None
        ]
        if given:
            raise AtcError(f"{given[0]} goes with a trajectory; in a scene it is a key of [trajectory]")
        report = describe_scene(load_scene(trajectory[0], None))
    else:
        source = trajectory if len(trajectory) > 1 else trajectory[0]
        report = describe(
            source,
            topology=topology,
            units=units,
            masses=parse_masses(masses),
            dimension=dimension,
            atom_style=atom_style,
        )
    if json:
        print(report.json())
    else:
        report.print(console())


@app.command()
def plan(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    select: Select = None,
    by: By = None,
    bonds: Ends = None,
) -> None:
    """What would be computed, by which method and why; predicted time, memory and error."""
    made = select_atoms(load_scene(scene, set, begin, end, step, selects=True), select, by, bonds)
    plan = made.plan(jobs=jobs)
    if made.get("output", "file") is not None:
        try:
            made.output(resume=True)
        except AtcError as e:
            from ..errors import AtcWarning

            warnings.warn(str(e), AtcWarning, stacklevel=2)
    print(plan)


@app.command()
def fields(
    scene: SceneFile,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="OUT", help="The file to write: .zarr or .nc.", show_default=False),
    ] = None,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    select: Select = None,
    by: By = None,
    bonds: Ends = None,
    units: PublishedUnits = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            "--cluster",
            metavar="ADDRESS",
            help="Compute on the workers of this Dask scheduler, e.g. tcp://127.0.0.1:8786.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        bool, typer.Option("--report", help="Write an HTML page about the result beside it, too.")
    ] = False,
    restart: Annotated[
        bool, typer.Option("--restart", help="Forget the finished frames of an interrupted run.")
    ] = False,
    overwrite: Overwrite = False,
    quiet: Quiet = False,
) -> None:
    """Compute the fields of a scene, frame by frame, into a file. After an interruption the same command continues."""
    made = select_atoms(load_scene(scene, set, begin, end, step, selects=True), select, by, bonds)
    if units is not None:
        made.set("output", "units", units, flag=f"--units {units}")
    out = made.output(output, overwrite=overwrite, resume=not restart)
    started = time.perf_counter()
    kept = kept_on_interrupt("the finished frames are kept: the same command continues")
    with kept, progress_bar(quiet) as progress, heard() as warned:
        try:
            attributes = made.write(out, jobs=jobs, cluster=cluster, progress=progress, resume=not restart)
        except AtcError as e:
            raise AtcError(str(e).replace("start again without resuming", "start again with --restart")) from None
    if not quiet:
        _summary(attributes, out, time.perf_counter() - started, progress)
    if report:
        from ..analysis.page import report as write_page

        path = write_page(out, warned=warned)
        if not quiet:
            print(f"report: {path}")


@app.command()
def compare(
    what: Annotated[
        list[Path],
        typer.Argument(
            metavar="OUT...|SCENE", help="Outputs of atc fields, or a scene together with --radii.", show_default=False
        ),
    ],
    radii: Annotated[
        str | None,
        typer.Option(
            "--radii",
            metavar="R1,R2,...",
            help="Compute the scene's stress for these kernel radii and compare them.",
            show_default=False,
        ),
    ] = None,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="FILE", help="Where the picture goes; default: next to OUT.", show_default=False
        ),
    ] = None,
    json: Annotated[bool, typer.Option("--json", help="The table as JSON.")] = False,
    csv: Annotated[bool, typer.Option("--csv", help="The table as CSV.")] = False,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Quiet = False,
) -> None:
    """Hardy's stress against the virial stress: a table and a picture."""
    from ..analysis.compare import compare as compare_output
    from ..analysis.compare import compare_radii, side_by_side

    if json and csv:
        raise AtcError("give --json or --csv, not both")
    if radii is not None:
        if len(what) != 1:
            raise AtcError("--radii goes with one scene: atc compare SCENE --radii 4,6,8")
        made = load_scene(what[0], set, begin, end, step, selects=True)
        with progress_bar(quiet or json or csv) as progress:
            results = [compare_radii(made, _parse_radii(radii), jobs=jobs, progress=progress)]
        target = what[0]
    else:
        for path in what:
            if path.suffix == ".toml":
                raise AtcError(
                    f"{path}: is a scene; give it with --radii (atc compare {path} --radii 4,6,8), or give the output "
                    "of atc fields"
                )
        if set or begin is not None or end is not None or step is not None:
            raise AtcError("--set, -b, -e and --step go with a scene and --radii; an output is compared as it is")
        results = [compare_output(path, species=species, units=units) for path in what]
        if len(results) > 1:
            results = [side_by_side(results)]
        target = what[0]
    result = results[0]
    target = picture or target.with_name(target.stem + "-compare.png")
    result.picture(target)
    if json:
        print(result.json())
    elif csv:
        print(result.csv(), end="")
    else:
        result.print(console())
    if not (quiet or json or csv):
        print(f"picture: {target}")


@app.command()
def check(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    points: Annotated[
        int | None,
        typer.Option("--points", metavar="N", help="Random points, and as many of the grid's.", show_default=False),
    ] = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="Only the exit status.")] = False,
) -> None:
    """Balance laws: residuals of mass, momentum, energy and of div z = 0 at random points and points of the grid.

    On the frame in the middle, in closed form and from the fields; with 3, 5 or 9 frames close in time also from
    differences between frames. Exit status 0 when every law holds as far as it can be told, 1 when one is broken.
    """
    from ..analysis.check import check_scene

    made = load_scene(scene, set, begin, end, step)
    if points is not None:
        made.set("check", "points", points, flag=f"--points {points}")
    report = check_scene(made, jobs=jobs)
    if json:
        print(report.json())
    elif not quiet:
        report.print(console())
    if not report.ok:
        raise typer.Exit(1)


@app.command()
def conductivity(
    scene: SceneFile,
    set: Set = None,
    begin: Begin = None,
    end: End = None,
    step: Step = None,
    jobs: Jobs = 1,
    segments: Annotated[
        int, typer.Option("--segments", metavar="N", help="Independent parts of the run that give the error.")
    ] = 10,
    plateau: Annotated[
        str | None,
        typer.Option(
            "--plateau",
            metavar="T1,T2",
            help="Average the integral over these lags; default: found.",
            show_default=False,
        ),
    ] = None,
    longest: Annotated[
        float | None,
        typer.Option("--longest", metavar="T", help="The longest lag; default: half a segment.", show_default=False),
    ] = None,
    dt: Annotated[
        float | None,
        typer.Option("--dt", metavar="T", help="Time between frames, if the file does not say it.", show_default=False),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", metavar="FILE", help="Draw the correlation function and its integral.", show_default=False
        ),
    ] = None,
    json: Json = False,
    quiet: Annotated[bool, typer.Option("-q", "--quiet", help="No progress.")] = False,
) -> None:
    """Thermal conductivity of an equilibrium run, by Green and Kubo, with an error bar: needs [trajectory] and
    [potential]."""
    from ..analysis.green_kubo import conductivity_of_scene

    made = load_scene(scene, set, begin, end, step)
    with progress_bar(quiet or json) as progress:
        result = conductivity_of_scene(
            made, segments=segments, plateau=_parse_times(plateau), longest=longest, dt=dt, jobs=jobs, progress=progress
        )
    if picture is not None:
        result.picture(picture)
    if json:
        print(result.json())
    else:
        result.print(console())
        if picture is not None:
            print(f"picture: {picture}")


@app.command()
def plot(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Output of atc fields.", show_default=False)],
    quantity: Annotated[
        str | None,
        typer.Option(
            "-q",
            "--quantity",
            metavar="NAME",
            help="Which field; default: the first stress, else the first field.",
            show_default=False,
        ),
    ] = None,
    component: Annotated[
        str | None,
        typer.Option(
            "-c",
            "--component",
            metavar="NAME",
            help="xx, xy, ..., vonmises, hydrostatic, max_shear; x, y, z, magnitude.",
            show_default=False,
        ),
    ] = None,
    slice: Annotated[
        str | None,
        typer.Option(
            "--slice",
            metavar="AXIS=POS",
            help="Plane of a 3-D grid, e.g. z=0.5 (fraction of the axis) or z=12.5A (length).",
            show_default=False,
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option("--axis", metavar="AXIS", help="Axis normal to the plane (with --index).", show_default=False),
    ] = None,
    index: Annotated[
        int | None, typer.Option("--index", metavar="K", help="Index of the plane along --axis.", show_default=False)
    ] = None,
    frame: Annotated[
        str,
        typer.Option(
            "--frame", metavar="N|mean", help="Frame counted from 0 (-1 is the last), or the mean over frames."
        ),
    ] = "-1",
    limits: Annotated[
        str | None, typer.Option("--limits", metavar="LO,HI", help="Limits of the colour scale.", show_default=False)
    ] = None,
    robust: Annotated[
        bool | None,
        typer.Option(
            "--robust/--full",
            help="Limits at the 2nd and 98th percentile, or at the extremes; default: robust where a few points are "
            "far beyond all others.",
            show_default=False,
        ),
    ] = None,
    arrows: Annotated[
        str | None,
        typer.Option("--arrows", metavar="NAME", help="Draw a vector field over the map.", show_default=False),
    ] = None,
    streamlines: Annotated[
        str | None,
        typer.Option("--streamlines", metavar="NAME", help="The same as streamlines.", show_default=False),
    ] = None,
    principal: Annotated[
        str | None,
        typer.Option(
            "--principal", metavar="NAME", help="Draw principal stresses in the plane as crosses.", show_default=False
        ),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="FILE",
            help="The picture: .png, .pdf or .svg; default next to OUT.",
            show_default=False,
        ),
    ] = None,
    overlay: Annotated[
        Path | None,
        typer.Option(
            "--overlay",
            metavar="SCENE",
            help="Draw the atoms of this scene's trajectory near the plane.",
            show_default=False,
        ),
    ] = None,
    species: Species = None,
    units: PublishedUnits = None,
    quiet: Annotated[bool, typer.Option("--quiet", help="Do not print the picture's name.")] = False,
) -> None:
    """Draw a slice, plane or profile of a field."""
    from ..config.scene import Scene
    from ..pictures import plotting

    path = plotting.plot_file(
        out,
        quantity,
        component=component,
        slice=slice,
        axis=axis,
        index=index,
        frame=frame,
        limits=_parse_limits(limits),
        robust=robust,
        output=output,
        species=species,
        units=units,
        arrows=arrows,
        streamlines=streamlines,
        principal=principal,
        overlay=None if overlay is None else Scene.load(overlay).trajectory(),
    )
    if not quiet:
        print(path)


def _parse_radii(text: str) -> list[float]:
    try:
        radii = [float(r) for r in text.split(",") if r.strip()]
        if not radii or min(radii) <= 0:
            raise ValueError
    except ValueError:
        raise AtcError(
            f"--radii {text}: expected lengths greater than 0 in the trajectory's units, e.g. --radii 4,6,8,10"
        ) from None
    return radii


def _parse_times(text: str | None):
    if text is None:
        return None
    try:
        begin, end = (float(v) for v in text.split(","))
    except ValueError:
        raise AtcError(
            f"--plateau {text}: expected two lags in the trajectory's unit of time, e.g. --plateau 3,6"
        ) from None
    return begin, end


def _parse_limits(text: str | None):
    if text is None:
        return None
    try:
        lo, hi = (float(v) for v in text.split(","))
        if not lo < hi:
            raise ValueError
    except ValueError:
        raise AtcError(f"--limits {text}: expected two increasing numbers, e.g. --limits -2e4,2e4") from None
    return lo, hi


# --------------------------------------------------------------------------------------------------------------------
# Commands in modules of their own: options only, the work is imported when they run.

for _module in (
    cli_verify,
    cli_bench,
    cli_pd,
    cli_upscale,
    cli_dispersion,
    cli_advect,
    cli_init,
    cli_profile,
    cli_report,
    cli_twin,
):
    _module.register(app)

if __name__ == "__main__":
    main()
