"""From a request to the least work that answers it, before anything is computed: which passes, sums and terms, by which
method, at what cost (`costs`)."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ..errors import AtcError
from ..estimators.methods import EXACT, Method, details, summary
from ..estimators.registry import BOND, Work

_TERMS = {
    "one": "1",
    "mass": "m",
    "momentum": "m v",
    "kinetic": "m v⊗v",
    "kinetic_energy": "½ m v²",
    "potential_energy": "U",
    "atom_virial": "½ Σ G r⊗r",
    "stress": "G r⊗r",
    "piola": "G R⊗r, between reference positions",
    "moment": "−r⊗F",
    "weighted": "−½ |r| (e_i − e_j)⊗F around each point",
    "weighted_normalised": "−½ |r| (e_i − e_j)⊗F around each point over its mean",
    "reference_weighted": "−½ |R| (E_i − E_j)⊗F around each point, between reference positions",
    "reference_weighted_normalised": "−½ |R| (E_i − E_j)⊗F around each point over its mean, between reference "
    "positions",
    "kinetic_flux": "½ m v² v",
    "potential_flux": "U v",
    "energy_current": "(½ m v² + U) v",
    "source_residual": "what the energy sources leave of the force",
    "power": "(v_k·∂U_j/∂x_k) x_jk",
    "power_lab": "(v_k·∂U_j/∂x_k) x_jk",
    "sources": "x_jk⊗∂U_j/∂x_k",
    "displacement": "m u",
    "reference_mass": "m",
    "reference_displacement": "m u",
    "reference_energy": "U − U of the reference",
}


def cpus() -> int:
    """Processors this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:
        return os.cpu_count() or 1


def cores(jobs: int) -> int:
    """How many processors ``-j jobs`` stands for: 0 is all of them."""
    if jobs < 0:
        raise AtcError(f"-j {jobs}: expected a number of processor cores, or 0 for all of them")
    return jobs or cpus()


@dataclass
class Request:
    """One call of `atc.fields`, checked and resolved; see there for the parameters."""

    traj: object
    pot: object = None
    kern: object = None
    grid: object = None
    quantities: object = ("stress",)
    tolerance: float = 1e-5
    method: str = "auto"
    reference: object = None
    average: bool | int = False
    threads: int | None = None
    workers: int = 1
    scene: str | None = None
    horizon: float | None = None
    cluster: object = None
    tiles: object = None
    input_error: tuple = (0.0, {})
    anchor: object = None
    forces: str = "warn"
    log: object = None
    agreement: str = ""

    def __post_init__(self):
        from ..agreement.forces import MODES
        from ..frame import Frame

        for name, value, method, hint in (
            ("pot", self.pot, "stream", "atc.potential('pair_style ...')"),
            ("kern", self.kern, "scaled", "atc.kernel('quartic', radius=8.0)"),
            ("grid", self.grid, "bind", "atc.Grid.regular(spacing=2.0)"),
        ):
            if value is not None and not hasattr(value, method):
                raise AtcError(f"{name} is a {type(value).__name__}: expected what {hint} gives")
        self.work = Work.of(self.quantities, getattr(self.pot, "central", True))
        from ..planar import matched, planar

        self.frames, self.pot = matched(as_frames(self.traj, self.pot), self.pot)
        self.n_frames = len(self.frames)
        if not self.n_frames:
            raise AtcError("the trajectory has no frames: nothing to compute")
        if not (isinstance(self.tolerance, (int, float)) and 0 < self.tolerance < 1):
            raise AtcError(
                f"tolerance {self.tolerance!r}: expected a number between 0 and 1, relative to the largest value of "
                "the field, e.g. 1e-5"
            )
        if self.forces not in MODES:
            raise AtcError(f"forces {self.forces!r}: expected one of {', '.join(map(repr, MODES))}")
        if (
            self.average is not True
            and self.average is not False
            and (not isinstance(self.average, (int, np.integer)) or self.average < 1)
        ):
            raise AtcError(f"average {self.average!r}: expected True, False, or the number of frames in a window")
        for name in ("threads", "workers"):
            value = getattr(self, name)
            if value is None and name == "threads":
                continue
            if not isinstance(value, (int, np.integer)) or isinstance(value, bool) or value < 1:
                raise AtcError(f"{name} {value!r}: expected a whole number, 1 or more")
        if self.tiles is not None:
            t = np.asarray(self.tiles)
            flat = self.frames[0].dimension == 2
            if (
                t.dtype.kind not in "iu"
                or t.shape not in ((3,), (2,) if flat else (3,))
                or (t < 1).any()
                or (flat and t[2:].any() and t[2] != 1)
            ):
                expected = (
                    "two whole numbers, 1 or more, e.g. (2, 2)"
                    if flat
                    else "three whole numbers, 1 or more, e.g. (2, 2, 1)"
                )
                raise AtcError(f"tiles {self.tiles!r}: expected {expected}")
            self.tiles = (*(int(n) for n in t), 1)[:3]
        if self.reference is not None and not isinstance(self.reference, Frame):
            if isinstance(self.reference, (int, np.integer)):
                try:
                    self.reference = self.frames[int(self.reference)]
                except IndexError:
                    raise AtcError(f"reference {self.reference}: the trajectory has {self.n_frames} frames") from None
            else:
                self.reference = as_frames(self.reference, self.pot)[0]
        elif self.reference is not None and getattr(self.pot, "setup", None) is not None:
            self.reference = self.pot.complete(self.reference)
        self.first = self.frames[0]
        if self.reference is not None and self.reference.dimension != self.first.dimension:
            if self.first.dimension == 3:
                raise AtcError(
                    f"the reference {self.reference.source} is of a two-dimensional run, but {self.first.source} is not"
                )
            self.reference = planar(self.reference)
        if self.kern is not None and self.work.kernel_users:
            self.kern.in_dimension(self.first.dimension)
        if self.work.grid_users and hasattr(self.grid, "fixed"):
            # Every entry of the output has as many points as the first.
            where = (
                self.first
                if set(self.work.grid_users) - set(self.work.on_reference) or self.reference is None
                else self.reference
            )
            self.grid = self.grid.fixed(where.units, where.cell, where.positions)
        if self.work.bond_users and hasattr(self.pot, "check_topology"):
            self.pot.check_topology(self.first)
        from .method_choice import require_known

        require_known(self.method)
        # Whole frames to processes if there are enough of them, else threads within a frame.
        if self.workers > 1 and self.n_frames < self.workers:
            self.threads, self.workers = self.threads or self.workers, 1
        self.threads = int(self.threads or max(1, cpus() // self.workers))
        self.workers = int(self.workers)
        self.methods = self.methods_for(self.work, self.method)

    def methods_for(self, work: Work, method: str = "auto") -> dict[str, Method]:
        """The method of each deposit, by the cost model and the first frame: the same for every frame, whoever computes
        it."""
        from .costs import Load
        from .method_choice import choose

        places = self.places(work)
        if not places:
            return {}
        load = self.load if work.bond or work.reference_bond else Load()
        pilot = self._pilot if self.may_loosen(work) and hasattr(self.pot, "terms") else None
        together = dict.fromkeys(self.added_up, self.group()) if work is self.work else None
        return choose(
            method,
            self.tolerance,
            self.costs,
            work,
            places,
            self.kernel_internal,
            len(self.first),
            load,
            pilot,
            together,
        )

    def places(self, work: Work) -> dict | None:
        """For each deposit that a frame needs, the bound grid and the cell that its atoms are in; None where something
        for that is missing."""
        if self.kern is None or self.grid is None or (work.bond_users and self.pot is None):
            return None
        out = {key: (self.bound, self.first.cell) for key in ("site", "bond", "gather") if getattr(work, key)}
        for key in ("reference_bond", "reference_gather"):
            if getattr(work, key):
                if self.reference is None:
                    return None
                at = self.reference
                out[key] = self.grid.bind(at.units, at.cell, at.positions), at.cell
        return out

    def may_loosen(self, work: Work) -> bool:
        """Whether sums over bonds may begin above the tolerance: where the largest errors are known to be found, around
        the strongest bonds."""
        return work.bond == ["stress"] and self.tiles is None

    def settle(self, result) -> None:
        """Fix the methods for all frames: those that the first one needed (a `FrameResult`), for further ones adjusted
        by the error it was left with."""
        self.methods = dict(result.methods)
        method = self.methods.get("bond", EXACT)
        errors = [result.expected[q.name] for q in self.work.quantities if q.bond and q.name in result.expected]
        if self.n_frames > 1 and not method.exact and not method.forced and errors and self.may_loosen(self.work):
            from .method_choice import adjusted

            ways = self.costs, self.bound, self.kernel_internal, self.first.cell, self.load, self.work.n_bond
            self.methods["bond"] = adjusted(
                method, max(errors), self.tolerance, *ways, float(len(self.first)), self.group()
            )

    def _pilot(self):
        """A pass over the bonds of the first frame; see there."""
        from .error_forecast import Pilot

        return Pilot(self.pot, self.first, self.bound, self.kernel_internal, self.tolerance, self.threads)

    @cached_property
    def costs(self):
        from .costs import Costs

        return Costs.load()

    @cached_property
    def bound(self):
        """The grid on the first frame."""
        return self.grid.bind(self.first.units, self.first.cell, self.first.positions)

    @cached_property
    def kernel_internal(self):
        from ..estimators.accuracy.random_points import kernel_internal

        return kernel_internal(self.kern, self.first.units)

    @cached_property
    def load(self):
        """Pairs, triplets and bonds of the first frame, estimated."""
        from .costs import Load, load_of

        return load_of(self.pot, self.first) if self.work.bond_users else Load()

    @property
    def method_used(self) -> str:
        return summary(self.methods)

    @property
    def window(self) -> int:
        """Frames that make one entry of the output."""
        return 1 if self.average is False else self.n_frames if self.average is True else int(self.average)

    @cached_property
    def added_up(self) -> frozenset[str]:
        """The deposits ("site", "bond") that frames of a window are added up in; see `estimators.groups`."""
        grid, first = self.grid, self.first
        if (
            self.average is False
            or self.n_frames < 2
            or self.tiles is not None
            or grid is None
            or getattr(grid, "follows_atoms", False)
        ):
            return frozenset()
        from ..estimators.groups import added_up, size_of

        if size_of(min(self.window, self.n_frames), len(first)) == 1:
            return frozenset()
        found = added_up(self.work)
        if not found or not first.cell.complete:
            return frozenset()
        try:
            return found if self.frames[1].cell == first.cell else frozenset()
        except (AtcError, IndexError):  # its own turn will come to say what is wrong with it
            return frozenset()

    def group(self, k: int = 0) -> int:
        """How many frames are added up in the window of frame `k`."""
        from ..estimators.groups import size_of

        begin = k - k % self.window
        return size_of(min(self.window, self.n_frames - begin), len(self.first)) if self.added_up else 1

    def groups(self, start: int = 0):
        """(first, how many) of the frames that are computed together, from frame `start` on."""
        while start < self.n_frames:
            begin = start - start % self.window
            m = self.group(start)
            count = min(m - (start - begin) % m, min(begin + self.window, self.n_frames) - start)
            yield start, count
            start += count

    @property
    def entries(self) -> int:
        """Length of the output along "frame"."""
        return -(-self.n_frames // self.window)

    def settings(self):
        """What a worker needs."""
        from ..estimators.settings import Settings

        names = tuple(q.name for q in self.work.quantities)
        return Settings(
            names,
            self.pot,
            self.kern,
            self.grid,
            dict(self.methods),
            self.tolerance,
            self.reference if self.work.reference_users else None,
            self.threads,
            horizon=self.horizon,
            tiles=self.tiles,
            anchor=self.anchor,
        )

    def alarm(self):
        """Whether the run's forces, and its log, are those of the potential (`run_check.RunCheck`). Warns, or raises
        where they must agree."""
        from ..agreement.run_check import alarm

        return alarm(
            self.frames,
            self.pot,
            mode=self.forces,
            log=self.log,
            threads=self.threads,
            first=self.first,
            needed=bool(self.work.bond_users),
        )


def as_frames(traj, pot=None):
    """Anything `atc.fields` takes as a trajectory, as a sequence of Frames; with what the script of a potential says of
    their atoms."""
    from ..readers.memory import completed

    return completed(_frames(traj), pot)


def _frames(traj):
    from ..frame import Frame

    if isinstance(traj, Frame):
        return [traj]
    if isinstance(traj, (list, tuple)) and traj and all(isinstance(f, Frame) for f in traj):
        return list(traj)
    from ..readers import read
    from ..readers.trajectory import Trajectory

    return traj if isinstance(traj, Trajectory) else read(traj)


@dataclass
class Plan:
    """What will be done, what will not, and what it will cost. ``str(plan)`` is for people.

    Attributes
    ----------
    passes : lines saying what runs
    left_out : (what, why) pairs
    method, reason : how the sums are taken, and why so
    atoms, frames, points : sizes (points is 0 without a grid)
    bonds, visits : predicted number of bonds and of bond-point visits a frame
    cpu_seconds, wall_seconds : predicted, a frame; total_seconds: the whole run
    memory : predicted peak in bytes, a process
    error : predicted error relative to the largest value of each field
    parts : CPU seconds a frame of each part of the work
    measured : whether the cost model was measured on this machine (`atc bench --calibrate`)
    agreement : whether the forces of the trajectory are those of the potential
    """

    passes: list[str]
    left_out: list[tuple[str, str]]
    method: str
    reason: str
    atoms: int
    frames: int
    points: int
    bonds: float
    visits: float
    cpu_seconds: float
    wall_seconds: float
    total_seconds: float
    memory: float
    output_bytes: float
    error: float
    tolerance: float
    workers: int
    threads: int
    quantities: list[str] = field(default_factory=list)
    parts: dict[str, float] = field(default_factory=dict)
    measured: bool = False
    agreement: str = ""

    def __str__(self):
        def count(x):
            return f"{x:.3g}" if x >= 1e6 else f"{x:,.0f}"

        lines = [
            f"{', '.join(self.quantities)}",
            f"{self.frames} frame{'s' * (self.frames != 1)} of {count(self.atoms)} atoms"
            + (f", {count(self.points)} grid points" if self.points else ""),
            "",
            "what runs",
            *(f"  {p}" for p in self.passes),
            "what is left out",
            *(f"  {what}: {why}" for what, why in self.left_out),
        ]
        if self.points:
            lines.append("method  " + self.reason.replace("; sums over", "\n        sums over"))
        parallel = (
            f"{self.workers} processes of {self.threads} threads"
            if self.workers > 1
            else f"{self.threads} thread{'s' * (self.threads != 1)}"
        )
        lines += [
            f"time    about {_duration(self.wall_seconds)} a frame, {_duration(self.total_seconds)} in all "
            f"({parallel}; first use adds compilation)",
            "        "
            + ", ".join(f"{what} {_duration(s)}" for what, s in self.parts.items() if s > 0.005 * self.cpu_seconds)
            + " of CPU a frame"
            + ("" if self.measured else "; atc bench --calibrate fits these to this machine"),
            f"memory  about {_bytes(self.memory)}, output {_bytes(self.output_bytes)}",
            f"error   about {self.error:.0e} of the largest value of each field (tolerance {self.tolerance:g}); "
            "measured at random points when it runs",
        ]
        if self.agreement:
            lines.append(f"run     agrees with the potential? {self.agreement}")
        return "\n".join(lines)


def plan(*args, **kwargs) -> Plan:
    """What `atc.fields` would do with the same arguments. Nothing is computed but the forces of a frame or two, where
    the trajectory has them to compare.

    Takes a `Request`, or the arguments of `atc.fields` up to `workers`.
    """
    request = args[0] if len(args) == 1 and not kwargs and isinstance(args[0], Request) else Request(*args, **kwargs)
    work, frame, threads = request.work, request.first, request.threads
    if work.grid_users and (request.grid is None or (request.kern is None and work.kernel_users)):
        raise AtcError(f"{', '.join(work.grid_users)} need a {'kernel and a ' * bool(work.kernel_users)}grid")
    if work.bond_users and request.pot is None:
        raise AtcError(
            f"{', '.join(work.bond_users)} need a potential: give the pair_style/pair_coeff lines of the run"
        )
    from .predict import predict

    p = predict(request)
    size = {"grid": p.points, "box": 1, "atom": len(frame)}
    entry = sum(8.0 * 3**q.rank * size[q.kind] for q in work.quantities)
    # A sum of squares and a block that waits for its partner at each length, means and errors.
    levels = 1 if request.average is False else 4 + 2 * (1 + int(np.log2(request.window / request.group())))
    memory = p.memory + (entry * levels if request.average is not False else 0.0)
    written = entry * request.costs.written_byte * (1.0 if request.average is False else 2.0 / request.window)
    wall = p.parallel / threads + p.serial + written
    return Plan(
        passes=_passes(work, request),
        left_out=_left_out(work),
        method=request.method_used,
        reason=details(request.methods),
        atoms=len(frame),
        frames=request.n_frames,
        points=p.points,
        bonds=request.load.bonds,
        visits=p.visits,
        cpu_seconds=p.parallel + p.serial + written,
        wall_seconds=wall,
        total_seconds=wall * request.n_frames / request.workers,
        memory=memory,
        output_bytes=entry * request.entries * (2 if request.average is not False else 1),
        error=max(
            [1e-13, *(min(0.3 * m.tolerance, 0.5 * request.tolerance) for m in request.methods.values() if not m.exact)]
        ),
        tolerance=request.tolerance,
        workers=request.workers,
        threads=threads,
        quantities=[q.name for q in work.quantities],
        parts=p.parts,
        measured=request.costs.machine != "shipped",
        agreement=request.alarm().text,
    )


def _passes(work: Work, request: Request) -> list[str]:
    out = []
    if work.bond_users:
        made = [f"Σ {_TERMS[b]} β, {BOND[b].width} components" for b in work.bond + work.reference_bond]
        made += [f"Σ {_TERMS[p]}, 9 components" for p in work.point + work.reference_point]
        made += ["moment of the forces on each atom"] * any("atom_moment" in name for name in work.whole)
        made += ["virial of each atom"] * work.atom_virial + ["virial of the box"] * ("box_virial" in work.whole)
        made += ["potential energy of each atom"] * bool(work.energy_users)
        made += ["energy sources"] * bool(work.source_users) + ["heat current of the box"] * ("box_power" in work.whole)
        cutoff = request.first.units.to_user("length", request.pot.cutoff)
        out.append(
            f"one pass over the bonds (neighbours within {cutoff:g} {request.first.units.label('length')}): "
            f"{'; '.join(made)}"
        )
    if work.summed_site:
        terms, components = ", ".join(_TERMS[s] for s in work.site), work.n_site
        out.append(f"one pass over the atoms: Σ a φ for a = {terms}: {components} component{'s' * (components != 1)}")
    for key, gather, where in (
        ("gather", work.gather, ""),
        ("reference_gather", work.reference_gather, ", over reference positions"),
    ):
        if gather:
            terms = ", ".join(_TERMS[s] for s in gather)
            over = (
                "points"
                if key not in request.methods or request.methods[key].exact
                else "atoms, on the modes of one mesh"
            )
            out.append(f"one pass over the {over}: Σ a φ{' and Σ a ∂φ/∂x' * work.slopes(key)} for a = {terms}{where}")
    if {"box_kinetic", "atom_kinetic"} & {*work.whole}:
        out.append("m v⊗v of the atoms, without a kernel")
    if request.average is not False:
        out.append(
            f"time average over {'all' if request.window >= request.n_frames else request.window} frames with its "
            "standard error by block averaging"
        )
        if request.group() > 1:
            over = " and over ".join({"site": "atoms", "bond": "bonds"}[key] for key in sorted(request.added_up))
            out.append(
                f"sums over {over}: the frames of a window are added up {request.group()} at a time before the sums "
                "are finished, and compared with exact ones"
            )
    return out


def _left_out(work: Work) -> list[tuple[str, str]]:
    out = []
    if not work.bond_users:
        out.append(("neighbour search, forces, bonds", "nothing asked needs the potential"))
    else:
        if not (work.bond or work.reference_bond):
            out.append(("bond function", "no field asked is a sum over bonds at grid points"))
        if not work.atom_virial:
            out.append(("virial of each atom", "no per-atom or smoothed virial was asked for"))
        if not work.energy_users:
            out.append(("potential energies of the atoms", "no energy was asked for"))
        if not work.source_users:
            out.append(("energy sources of the bonds", "no heat flux or churning was asked for"))
    if "velocities" not in work.attributes:
        out.append(("velocities", "nothing asked depends on them"))
    if not work.summed_site and work.grid_users:
        out.append(
            ("sums over atoms", "nothing asked needs them" if not work.site else "those with gradients have the same")
        )
    if work.kernel_users and not work.gradient_users:
        out.append(("gradient of the kernel", "no gradient was asked for"))
    if not work.grid_users:
        out.append(("kernel and grid", "no field was asked for"))
    if not work.reference_users:
        out.append(("reference frame", "nothing asked refers to one"))
    return out


def _duration(s: float) -> str:
    return (
        f"{1000 * s:.0f} ms"
        if s < 1
        else f"{s:.2g} s"
        if s < 100
        else f"{s / 60:.1f} min"
        if s < 6000
        else f"{s / 3600:.1f} h"
    )


def _bytes(b: float) -> str:
    return f"{b / 1e3:.0f} kB" if b < 1e6 else f"{b / 1e6:.0f} MB" if b < 1e9 else f"{b / 1e9:.1f} GB"
