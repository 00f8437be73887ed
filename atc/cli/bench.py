"""``atc bench``: speed against error, and the cost model's constants."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from ..errors import AtcError
from .common import Jobs, Json, Quiet, SceneFlags, argument, option, parse_numbers, show


def bench(
    flags: SceneFlags,
    scene: Annotated[Path | None, argument("SCENE", "The scene, a TOML file.")] = None,
    jobs: Jobs = 1,
    tolerances: Annotated[str | None, option("--tolerances T1,T2,...", "Tolerances of the spectral method.")] = None,
    field: Annotated[
        str | None, option("--field NAME", "Which of the scene's fields; default: stress_potential, or the first.")
    ] = None,
    calibrate: Annotated[
        bool, option("--calibrate", "Measure what plans and choices of methods are based on, and keep it.")
    ] = False,
    picture: Annotated[Path | None, option("--picture FILE", "Where the picture goes; default: next to SCENE.")] = None,
    json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Time against error of every method on the scene's first frame, next to binned and smoothed per-atom virials.

    With --calibrate (and no scene) the constants of the cost model are measured on this machine, in about a minute,
    and kept in the user's cache folder; `atc plan` and method "auto" use them from then on.
    """
    if calibrate:
        _calibrate(json, quiet)
        if scene is None:
            return
    if scene is None:
        raise AtcError("atc bench: give a scene, or --calibrate")
    from ..analysis.bench import TOLERANCES
    from ..analysis.bench import bench as run
    from ..pictures.drawing import picture_kind
    from ..planning.request import Request

    target = picture or scene.with_name(scene.stem + "-bench.png")
    picture_kind(target)
    given = parse_numbers(
        "--tolerances",
        tolerances,
        "numbers between 0 and 1, e.g. --tolerances 1e-3,1e-5",
        lambda values: values and all(0 < t < 1 for t in values),
    )
    ladder = sorted(given, reverse=True) if given else TOLERANCES
    made = flags.load(scene)
    arguments = made.arguments(jobs)
    arguments["threads"], arguments["workers"] = max(arguments["threads"], arguments["workers"]), 1
    arguments["traj"] = arguments["traj"][:1]
    result = run(Request(**arguments), ladder, (lambda text: None) if quiet or json else _say, field=field)
    result.picture(target)
    show(result, json)
    if not (json or quiet):
        print(f"picture: {target}")


def _say(text: str) -> None:
    import sys

    if sys.stderr.isatty():
        print(f"  {text} ...", file=sys.stderr, flush=True)


def _calibrate(json: bool, quiet: bool) -> None:
    from dataclasses import asdict
    from json import dumps

    from ..kernels import kernel
    from ..planning.calibrate import calibrate

    costs = calibrate((lambda text: None) if quiet or json else _say)
    path = costs.save()
    if json:
        print(dumps(asdict(costs), indent=1))
    elif not quiet:
        print(f"costs of this machine: {path} (delete it to go back to those shipped)")
        print(
            f"a visit of the quartic's {costs.visit_of(kernel('quartic', radius=1.0).compiled) * 1e9:.1f} ns, a "
            f"pair {costs.pair * 1e9:.0f} ns, a spread point {costs.spread_point * 1e9:.0f} ns"
            f" and {costs.spread_register * 1e9:.2f} ns a register of its window"
        )
