"""Time against error on the user's own frame: every method and a ladder of tolerances, next to what per-atom virials
would give (``atc bench``).

Each rung is a whole frame (list, forces, deposits, error check) in this process, kernels compiled before; CPU seconds
of all threads, and wall seconds. Errors are of one field, at every point of the grid, against the exact sum: the
largest over the largest value, and the rms over the rms. For the binned and the smoothed per-atom virial they say how
far those are from Hardy's stress, which no tolerance brings closer.
"""

from __future__ import annotations

import json
import time
import warnings
from dataclasses import asdict, dataclass, field, replace

import numpy as np

from ..errors import AtcError, AtcWarning
from ..estimators.methods import Method
from ..estimators.settings import Settings
from ..estimators.work import Work
from ..grids.planes import through_planes
from ..pictures.drawing import save
from ..planning.costs import direct as direct_seconds
from ..planning.costs import gather as gather_seconds

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8)
#: A rung that took less than this, CPU and wall seconds together, is run once more, and the better time counts: the
#: first one may have compiled something.
SHORT = 20.0
#: CPU seconds that the exact sum may take; beyond, errors are measured at random points instead, and against the
#: closest spectral result.
MOST = 200.0


@dataclass
class Rung:
    """One way to compute the field. cpu, wall: seconds; error_max, error_l2: against the exact sum; front: nothing else
    is both faster and better."""

    label: str
    method: str
    tolerance: float | None
    cpu: float
    wall: float
    error_max: float
    error_l2: float
    front: bool = False
    chosen: bool = False
    details: str = ""


@dataclass
class Bench:
    """What `bench` found. `rungs` by method, tolerances falling; `left_out`: (method, why)."""

    title: str
    field: str
    atoms: int
    bonds: int
    points: int
    kernel: str
    threads: int
    rungs: list[Rung]
    left_out: list[tuple[str, str]] = field(default_factory=list)

    def json(self) -> str:
        return json.dumps(asdict(self), indent=1)

    def print(self, console) -> None:
        """A table for people."""
        from rich.table import Table

        console.print(
            f"{self.title}: {self.field}, {self.atoms:,} atoms, {self.bonds:,} bonds, {self.points:,} points, "
            f"{self.kernel}, {self.threads} thread(s)"
        )
        table = Table(box=None, pad_edge=False)
        for name in ("method", "CPU s", "wall s", "error max", "error l2", ""):
            table.add_column(name, justify="left" if name in ("method", "") else "right", no_wrap=True)
        for r in self.rungs:
            mark = ", ".join(["on the front"] * r.front + ["what auto takes"] * r.chosen)
            table.add_row(r.label, f"{r.cpu:.3g}", f"{r.wall:.3g}", f"{r.error_max:.1e}", f"{r.error_l2:.1e}", mark)
        console.print(table)
        for method, why in self.left_out:
            console.print(f"left out  {method}: {why}")

    def picture(self, path) -> None:
        """Error against CPU seconds, both logarithmic, with the front."""
        from matplotlib.figure import Figure

        figure = Figure(figsize=(6.4, 4.6), layout="constrained")
        ax = figure.add_subplot()
        places = lambda rungs: ([r.cpu for r in rungs], [max(r.error_max, 1e-16) for r in rungs])  # noqa: E731
        styles = {
            "spectral": ("o", "C0"),
            "direct": ("s", "C1"),
            "slab": ("s", "C1"),
            "smoothed virial": ("^", "C2"),
            "binned virial": ("v", "C3"),
        }
        for method in dict.fromkeys(r.method for r in self.rungs):
            some = [r for r in self.rungs if r.method == method]
            marker, color = styles.get(method, ("x", "C4"))
            ax.plot(*places(some), marker=marker, color=color, ls="", ms=7, label=method)
            for r in some:
                if r.tolerance and r.method == "spectral":
                    beside = {"textcoords": "offset points", "xytext": (6, 3), "fontsize": 8}
                    ax.annotate(f"{r.tolerance:g}", (r.cpu, r.error_max), **beside)
        front = sorted((r for r in self.rungs if r.front), key=lambda r: r.cpu)
        ax.step(*places(front), where="post", color="0.6", lw=1, zorder=0, label="Pareto front")
        ax.set(xscale="log", yscale="log", xlabel="CPU seconds a frame", ylabel="largest error / largest value")
        ax.set_title(f"{self.field}, {self.atoms:,} atoms, {self.points:,} points, {self.kernel}", fontsize=10)
        ax.grid(True, which="both", alpha=0.25)
        ax.legend(fontsize=8)
        save(figure, path)


def mark_front(rungs) -> None:
    """Set `front` on what nothing else beats in both time and error."""
    for r in rungs:
        r.front = not any(
            (o.cpu <= r.cpu and o.error_max < r.error_max) or (o.cpu < r.cpu and o.error_max <= r.error_max)
            for o in rungs
        )


def field_of(job, field=None) -> str:
    """The field that is measured: the one asked for, else stress_potential if anything is a sum over bonds, else the
    first one on the grid."""
    on_grid = [q for q in job.work.quantities if q.kind == "grid"]
    if through_planes(job.request.grid):
        raise AtcError("atc bench measures sums with a kernel: what crosses planes is counted, in one way only")
    if not on_grid or job.request.kern is None or job.request.grid is None:
        raise AtcError(
            "atc bench measures fields on a grid: the scene asks for none (quantities), or has no kernel or grid"
        )
    names = [q.name for q in on_grid]
    if field is not None:
        if field not in names:
            raise AtcError(f"field {field!r}: not among the fields on the grid that are asked for: {', '.join(names)}")
        return field
    return "stress_potential" if any(q.bond and not q.on_reference for q in on_grid) else names[0]


def bench(request, tolerances=TOLERANCES, progress=lambda text: None, most=MOST, most_each=np.inf, field=None) -> Bench:
    """Time against error of a request's first frame.

    Parameters
    ----------
    request : atc.plan.Request, or the job made of it
        Its first frame, grid, kernel and potential are used, and one of its fields.
    tolerances : of the spectral method
    progress : called with what is about to run
    most, most_each : CPU seconds that the exact sum, and any other rung, may be predicted to take; beyond, it is left
        out, and `left_out` says so
    field : which one; see `field_of`

    Raises
    ------
    AtcError for a request without fields on a grid.
    """
    from ..estimators.driver import fields_of
    from ..planning.job import prepare
    from ..planning.method_choice import SpectralWays, carriers, sizes

    job = prepare(request)
    frame, name = job.first, field_of(job, field)
    work = Work.of((name,))
    settings = replace(job.settings(), names=(name,), methods={}, tolerance=0.99, tiles=None)
    bound, kern, costs = job.bound, job.kernel_internal, job.costs
    places = job.places(work)
    if places is None:
        raise AtcError(f"atc bench: {name} needs a reference frame: give one")

    def run(settings):
        return _timed(lambda: fields_of([frame], settings))

    rungs, left_out, exact = [], [], None
    needed = sizes(work, len(frame), job.load)
    fixed = job.load.seconds(costs, len(frame)) if work.bond_users else 0.0
    seconds = fixed
    for key, size in needed.items():
        seconds += (gather_seconds if "gather" in key else direct_seconds)(costs, places[key][0], kern, *size)
    if seconds <= most:
        # The exact sum is what all errors are measured against; its own is what the check at random points finds.
        progress("the exact sum")
        result, cpu, wall = run(settings)
        exact, own = result.arrays[name], result.errors[name]
        method = "direct" if bound.kind != "slab" else "slab"
        rungs.append(Rung("direct (exact)", method, None, cpu, wall, own["error_max"], own["error_l2"]))
    else:
        why = f"predicted to take {seconds:.0f} s of CPU: errors are those found at random points, of virials those "
        left_out.append(("direct", f"{why}from the closest result"))
    for t in sorted(tolerances, reverse=True):
        try:
            deposits = {}
            for k, size in needed.items():
                more = "gather" in k and work.slopes(k), carriers(k, work, len(frame))
                deposits[k] = SpectralWays(costs, places[k][0], kern, places[k][1], *size, *more).cheapest(t)
        except AtcError as e:
            left_out.append((f"spectral {t:g}", str(e)))
            continue
        times = [of for of, _ in deposits.values()]
        deposits = {k: d for k, (_, d) in deposits.items()}
        d = max(deposits.values(), key=lambda d: np.prod(np.asarray(d.mesh, float)))
        about = f"mesh {' x '.join(str(int(k)) for k in d.mesh)}, window {d.parameters.width}" + (
            f", moments to order {d.order}" if d.order else ""
        )
        if np.prod(np.asarray(d.mesh, float)) * 8 * d.most_components * job.request.threads > 4e9:
            left_out.append((f"spectral {t:g}", f"a {about.split(',')[0]} does not fit"))
            continue
        ahead = fixed + sum(times)
        if ahead > most_each:
            left_out.append((f"spectral {t:g}", f"predicted to take {ahead:.0f} s of CPU"))
            continue
        progress(f"spectral, tolerance {t:g}")
        # Forced, so that the rung is what it says and nothing is refined.
        methods = {k: Method("spectral", t, "bench", (), True, deposits[k].order) for k in needed}
        result, cpu, wall = run(replace(settings, methods=methods, tolerance=t))
        found = result.errors[name]
        errors = (found["error_max"], found["error_l2"]) if exact is None else _errors(result.arrays[name], exact)
        closest = result.arrays[name]
        rungs.append(Rung(f"spectral {t:g}", "spectral", t, cpu, wall, *errors, details=about))
    if exact is None:
        if not rungs:
            raise AtcError(
                f"atc bench: the exact sum would take {seconds:.0f} s of CPU and the spectral method cannot: "
                f"{left_out[-1][1]}"
            )
        exact = closest
    ahead = fixed + direct_seconds(costs, bound, kern, len(frame), 0.0, 6)
    if name == "stress_potential" and ahead > most_each:
        left_out.append(("per-atom virials", f"predicted to take {ahead:.0f} s of CPU to smooth"))
    elif name == "stress_potential":
        progress("per-atom virials")
        smooth = "smoothed_virial_stress_potential"
        result, cpu, wall = run(replace(settings, names=(smooth,)))
        rungs.append(
            Rung("smoothed per-atom virial", "smoothed virial", None, cpu, wall, *_errors(result.arrays[smooth], exact))
        )
        binned = _binned(frame, job, bound, exact)
        if binned is not None:
            rungs.append(binned)
    chosen = job.methods_for(work)
    main = chosen[list(needed)[-1]]
    alike = ("direct", "slab") if main.exact else ("spectral",)
    candidates = [r for r in rungs if r.method in alike]
    if candidates:
        nearest = min(candidates, key=lambda r: abs(np.log((r.tolerance or 1.0) / (main.tolerance or 1.0))))
        nearest.chosen = True
    mark_front(rungs)
    bonds = round(job.load.bonds) if work.bond or work.reference_bond else 0
    sizes_of = len(frame), bonds, len(bound), job.request.kern.describe(), job.request.threads
    return Bench(frame.source, name, *sizes_of, rungs, left_out)


def _timed(work):
    """What `work` gives, and its CPU and wall seconds: of what is short the better of two, the first may compile."""
    least = (np.inf, np.inf)
    for _ in range(2):
        cpu, wall = time.process_time(), time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", AtcWarning)
            result = work()
        least = min(least[0], time.process_time() - cpu), min(least[1], time.perf_counter() - wall)
        if sum(least) >= SHORT:
            break
    return result, *least


def _errors(values, exact) -> tuple[float, float]:
    d = np.nan_to_num(values) - np.nan_to_num(exact)
    largest, rms = float(np.abs(np.nan_to_num(exact)).max(initial=0.0)), float(np.sqrt(np.nanmean(exact**2)))
    worst, mean = float(np.abs(d).max(initial=0.0)), float(np.sqrt(np.mean(d**2)))
    return worst / largest if largest else 0.0, mean / rms if rms else 0.0


def _binned(frame, job, bound, exact) -> Rung | None:
    """Per-atom virials added up in the cells of a grid over the whole box, over the cells' volume: what plain binning
    gives."""
    from ..estimators.driver import fields_of

    if not (bound.tiles or bound.kind == "slab"):
        return None
    name = "virial_stress_per_atom_potential"
    settings = Settings((name,), job.request.pot, threads=job.request.threads, check_points=0)

    def binned():
        virial = fields_of([frame], settings).arrays[name].reshape(len(frame), 9)
        s = frame.cell.fractional(frame.positions)
        axes = [bound.axis] if bound.kind == "slab" else [0, 1, 2]
        flat = np.zeros(len(frame), np.int64)
        for a, n in zip(axes, bound.shape):
            k = np.floor(s[:, a] * n).astype(np.int64)
            flat = flat * n + (k % n if frame.cell.periodic[a] else np.clip(k, 0, n - 1))
        sums = np.stack([np.bincount(flat, virial[:, c], minlength=len(bound)) for c in range(9)], axis=1)
        return sums / frame.units.to_user("volume", bound.cell_volume)

    field, *best = _timed(binned)
    return Rung("binned per-atom virial", "binned virial", None, *best, *_errors(field.reshape(exact.shape), exact))
