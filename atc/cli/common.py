"""What the commands of ``atc`` share: options, the loading of scenes, progress, the console. Nothing heavy is imported
here."""

from __future__ import annotations

import contextlib
import functools
import inspect
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, get_type_hints

import typer

from ..errors import AtcError
from ..terminal import printable, unfiltered

#: What is said of a command that is stopped and can be continued: set by `kept_on_interrupt`.
_kept: str | None = None


@contextlib.contextmanager
def kept_on_interrupt(message: str):
    """While this runs, an interruption ends with `message`, and errors name the flag that starts again."""
    global _kept
    _kept = message
    try:
        yield
    except AtcError as e:
        raise AtcError(str(e).replace("start again without resuming", "start again with --restart")) from None
    finally:
        if not issubclass(sys.exc_info()[0] or type(None), KeyboardInterrupt):
            _kept = None


def interrupted(word: str = "interrupted") -> str:
    """What to say after Ctrl-C, or the signal that `word` is for."""
    return f"{word}; {_kept}" if _kept else word


def option(words: str, help: str):
    """An option as its help shows it, such as ``-q --quantity NAME``: its names, and what stands for its value."""
    names = [word for word in words.split() if word.startswith("-")]
    metavar = words.partition(names[-1])[2].strip() or None
    return typer.Option(*names, metavar=metavar, help=help)


def argument(metavar: str, help: str):
    """An argument, by what stands for it in the help."""
    return typer.Argument(metavar=metavar, help=help)


SceneFile = Annotated[Path, argument("SCENE", "The scene, a TOML file.")]
Begin = Annotated[int | None, option("-b --begin N", "First frame, counted from 0.")]
End = Annotated[int | None, option("-e --end N", "Frame to stop before.")]
Step = Annotated[int | None, option("--step N", "Take every N-th frame.")]
Jobs = Annotated[int, option("-j --jobs N", "Processor cores to use; 0 is all of them.")]
Quiet = Annotated[bool, option("-q --quiet", "No progress, no summary.")]
Silent = Annotated[bool, option("-q --quiet", "Only the exit status.")]
Json = Annotated[bool, option("--json", "As JSON.")]
Output = Annotated[Path | None, option("-o --output OUT", "The file to write: .zarr or .nc.")]
Overwrite = Annotated[bool, option("--overwrite", "Replace OUT if it exists.")]
#: Of commands that write their results beside printing them.
Dataset = Annotated[Path | None, option("-o --output OUT", "Write a dataset: .nc or .zarr.")]
Topology = Annotated[str | None, option("--topology FILE", "LAMMPS data file with masses, charges, bonds.")]
UnitsOption = Annotated[str | None, option("--units STYLE", "LAMMPS unit style: lj, real, metal, si, ...")]
Masses = Annotated[str | None, option("--masses LIST", "Masses by type: 28.0855,15.999 or 1=28.0855,2=15.999.")]
PublishedUnits = Annotated[
    str | None, option("--units LIST", 'In these units, e.g. "GPa, nm", or a preset: metal-gpa, nm-gpa, si.')
]
Species = Annotated[str | None, option("--species NAME", "Of fields taken apart, whose (see --by of atc fields).")]


@dataclass
class SceneFlags:
    """Flags that override keys of a scene: `flags` puts them in the place of a command's parameter of this class."""

    set: Annotated[
        list[str] | None,
        option("--set SECTION.KEY=VALUE", "Override a key of the scene, e.g. --set kernel.radius=10. Repeatable."),
    ] = None
    begin: Begin = None
    end: End = None
    step: Step = None

    def load(self, path, selects: bool = False):
        """The scene with these overrides on top. `selects`: whether the command knows what to do with [select]."""
        from ..config.scene import Scene
        from ..config.words import frame_slice

        scene = Scene.load(path, list(self.set or []))
        if "select" in scene.data and not selects:
            import warnings

            from ..errors import AtcWarning

            text = f"{scene.where('select')}: [select] is for atc fields: this command takes all atoms"
            warnings.warn(text, AtcWarning, stacklevel=2)
        flags = _said(begin=self.begin, end=self.end, step=self.step)
        if flags:
            frames = scene.get("trajectory", "frames")
            if frames is not None:
                s = frame_slice(frames)
                flags = _said(begin=s.start, end=s.stop, step=s.step) | flags
            names = {"begin": "-b", "end": "-e", "step": "--step"}
            scene.set("trajectory", "frames", flags, flag=" ".join(f"{names[k]} {v}" for k, v in flags.items()))
        return scene


@dataclass
class SelectFlags(SceneFlags):
    """The same, and those of [select]."""

    select: Annotated[
        str | None,
        option(
            "--select WORDS",
            'Only of some atoms, in words of MDAnalysis, e.g. "type 1 2", or "group:wall", a group of the script; '
            "more ways: [select] in the scene.",
        ),
    ] = None
    by: Annotated[str | None, option("--by WHAT", "Take fields apart: type, element or molecule.")] = None
    bonds: Annotated[
        str | None,
        option(
            "--bonds WHICH", "With selected atoms, which bonds count by their ends: half (default), both, one, any."
        ),
    ] = None

    def load(self, path, selects: bool = True):
        """The scene with these overrides on top."""
        scene = super().load(path, selects)
        for flag, key in (("select", "atoms"), ("by", "by"), ("bonds", "bonds")):
            value = getattr(self, flag)
            if value is not None:
                scene.set("select", key, value, flag=f"--{flag} {value}")
        return scene


def _said(**flags) -> dict:
    """The flags that were given."""
    return {name: value for name, value in flags.items() if value is not None}


def flags(command):
    """The command as typer takes it: where a parameter is of a class of flags, the flags themselves."""
    hints = get_type_hints(command, include_extras=True)
    parameters, classes = [], {}
    for p in inspect.signature(command).parameters.values():
        kind = hints[p.name]
        if isinstance(kind, type) and issubclass(kind, SceneFlags):
            types = get_type_hints(kind, include_extras=True)
            classes[p.name] = kind, [f.name for f in fields(kind)]
            parameters += [p.replace(name=f.name, annotation=types[f.name], default=f.default) for f in fields(kind)]
        else:
            parameters.append(p.replace(annotation=kind))

    @functools.wraps(command)
    def run(**given):
        made = {p: kind(**{name: given.pop(name) for name in names}) for p, (kind, names) in classes.items()}
        return command(**made, **given)

    run.__signature__ = inspect.Signature(parameters)
    run.__annotations__ = {p.name: p.annotation for p in parameters}
    return run


def show(result, json: bool = False, csv: bool = False, quiet: bool = False) -> None:
    """Print a result in the form that is asked for."""
    if json:
        print(result.json())
    elif csv:
        print(result.csv(), end="")
    elif not quiet:
        result.print(console())


def write_result(result, dataset, picture, tell: bool) -> None:
    """Write a result's dataset and draw its picture, where they are asked for, and say where they are. Last of all, so
    that the numbers are seen where there is no room for files."""
    sys.stdout.flush()
    for what, path, write in (("dataset", dataset, "save"), ("picture", picture, "picture")):
        if path is not None:
            getattr(result, write)(path)
            if tell:
                print(f"{what}: {path}")


def output_asked(scene, output, overwrite):
    """Where to write a dataset, checked: what the flag says, else the scene; None where neither does."""
    asked = output is not None or scene.get("output", "file") is not None
    return scene.output(output, overwrite=overwrite) if asked else None


def parse_numbers(flag: str, text: str | None, expected: str, good=lambda values: True) -> list[float] | None:
    """The numbers of ``--flag 1,2``, which `good` must be content with; None for nothing."""
    if text is None:
        return None
    try:
        values = [float(v) for v in text.split(",") if v.strip()]
    except ValueError:
        values = None
    if values is None or not good(values):
        raise AtcError(f"{flag} {text}: expected {expected}")
    return values


def parse_masses(text: str | None):
    """``--masses`` as `atc.read` takes them: {type: mass} or a list; None for nothing."""
    if text is None:
        return None
    parts = [p for p in text.replace(" ", ",").split(",") if p]
    try:
        if all("=" in p for p in parts):
            return {int(k) if k.isdigit() else k: float(v) for k, v in (p.split("=", 1) for p in parts)}
        return [float(p) for p in parts]
    except ValueError:
        raise AtcError(f"--masses {text}: expected masses by type, e.g. 28.0855,15.999 or 1=28.0855,2=15.999") from None


def console():
    """Where tables and notes are printed."""
    from rich.console import Console
    from rich.segment import Segment

    class Clean(Console):
        """Draws colours and tables, but no text that would steer the terminal."""

        def render(self, renderable, options=None):
            for part in super().render(renderable, options):
                yield part if part.control or part.text.isprintable() else Segment(printable(part.text), part.style)

    # wide when piped, so that no number is cut; no markup, so that file names with brackets survive
    return Clean(file=unfiltered(sys.stdout), width=None if sys.stdout.isatty() else 200, markup=False, highlight=False)


class Progress:
    """What `atc.fields` calls after every frame; draws a bar when somebody watches."""

    def __init__(self, bar=None, things: str = "frames"):
        self.bar, self.task, self.things = bar, None, things
        self.there = self.total = 0
        self.rate = 0.0

    def __call__(self, done: int, total: int, rate: float) -> None:
        self.total, self.rate = total, rate
        if rate == 0.0:  # the first call: what an earlier, interrupted run left
            self.there = done
        if self.bar is None:
            return
        if self.task is None:
            self.bar.start()
            self.task = self.bar.add_task(self.things, total=total, completed=done, rate="", left="")
            return
        left = (total - done) / rate if rate > 0 else 0.0
        each = (
            f"{rate:.3g} {self.things}/s" if rate >= 1 else f"{1 / rate:.3g} s/{self.things[:-1]}" if rate > 0 else ""
        )
        self.bar.update(self.task, completed=done, rate=each, left=f"{duration(left)} left" if done < total else "")


@contextlib.contextmanager
def progress_bar(quiet: bool, things: str = "frames"):
    """A progress bar on the terminal; silent when stderr is piped or `quiet`."""
    if quiet or not sys.stderr.isatty():
        yield Progress(things=things)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TextColumn("{task.fields[left]}"),
    )
    bar = Bar(*columns, console=Console(file=unfiltered(sys.stderr), stderr=True), transient=True)
    try:
        yield Progress(bar, things)
    finally:
        bar.stop()


def duration(seconds: float) -> str:
    """A time in words, in the unit that suits it."""
    if seconds < 90:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
