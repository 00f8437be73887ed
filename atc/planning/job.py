"""A request made ready: its frames, what is asked of them, and the method of each deposit."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np

from ..contracts import Interactions
from ..errors import AtcError
from ..estimators import groups
from ..estimators.chosen import require_choosable
from ..estimators.methods import EXACT, Method, summary
from ..estimators.moving import Follow
from ..estimators.planes import require_countable
from ..estimators.results import FrameResult
from ..estimators.selections import Parts, selection
from ..estimators.settings import Settings
from ..estimators.work import Work
from ..grids import Grid
from ..grids.planes import by_frames, through_planes
from ..kernels.unsmoothed import Unsmoothed
from .request import Request


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


def prepare(request: Request | Job) -> Job:
    """Read what the request names, complete it and choose the methods; a job is ready. What does not fit together is an
    AtcError."""
    from ..estimators.accuracy.random_points import kernel_internal
    from ..grids.padding import resolved, warn_of_open_faces
    from ..planar import planar
    from ..readers.memory import since_the_frame_before
    from ..readers.planar import matched

    if isinstance(request, Job):
        return request
    apart, pot = request.by is not None, request.pot
    request = replace(request, **_velocity(request))
    crossing = through_planes(request.grid)
    work = Work.on(request.grid, request.quantities, pot, apart, request.velocity)
    frames, pot = matched(as_frames(request.traj, request.pot), request.pot)
    if not len(frames):
        raise AtcError("the trajectory has no frames: nothing to compute")
    first = frames[0]
    reference, grid = _reference(request, frames, pot), request.grid
    if work.bond_users and pot is not None:
        # What its constraints are found from is settled, and asked for, once.
        pot = pot.settled(first)
    if work.bond_users and pot is not None and pot.constraints is not None:
        work = Work.on(request.grid, request.quantities, pot, apart, request.velocity)
    elif pot is not None and "degrees" in work.site:
        pot = pot.held_by_topology(first)
    if crossing:
        assert isinstance(request.grid, Grid)
        require_countable(work, pot, request.grid)
        if request.tiles is not None:
            raise AtcError("tiles: what crosses planes is counted in whole frames: leave tiles out")
        if by_frames(request.grid) and work.site:
            frames = since_the_frame_before(frames)
            first = frames[0]
    if request.kern is None and work.kernel_users and has_bin_means(grid):
        if pot is not None and pot.fields and work.bond:
            raise AtcError(
                f"{', '.join(work.bond_users)}: without a kernel, but long-range forces (kspace_style) belong to no "
                "bonds that bins have parts of: give a kernel"
            )
        request = replace(request, kern=Unsmoothed())
    if reference is not None and reference.dimension != first.dimension:
        if first.dimension == 3:
            raise AtcError(f"the reference {reference.source} is of a two-dimensional run, but {first.source} is not")
        reference = planar(reference)
    if request.kern is not None and work.kernel_users:
        request.kern.in_dimension(first.dimension)
    if work.grid_users and grid is not None:
        # Every entry of the output has as many points as the first.
        where = first if set(work.grid_users) - set(work.on_reference) or reference is None else reference
        grid = resolved(grid, request.kern, where)
        grid = grid.fixed(where.units, where.cell, where.positions)
        for q in work.quantities if local_axes(grid) else ():
            if q.kind != "grid" and q.rank:
                raise AtcError(
                    f"{q.name}: has components along x, y, z, and the fields on a {grid.kind} grid along "
                    f"{', '.join(local_axes(grid))}: compute it in a scene of its own"
                )
        if request.kern is not None and work.kernel_users:
            warn_of_open_faces(grid, kernel_internal(request.kern, first.units), where)
    if work.bond_users and pot is not None:
        pot.check_topology(first)
    # Whole frames to processes if there are enough of them, else threads within a frame.
    threads, workers = request.threads, request.workers
    if workers > 1 and len(frames) < workers:
        threads, workers = threads or workers, 1
    threads = int(threads or max(1, cpus() // workers))
    tiles = None if request.tiles is None else _tiles(request.tiles, flat=first.dimension == 2)
    chosen, parts = selection(request.select), None
    if chosen is not None or apart:
        require_choosable(work, pot, apart, tiles)
        chosen = None if chosen is None else chosen.settled(first, frames, pot)
        if apart:
            whole = np.ones(len(first), bool) if chosen is None else chosen.of(first)
            parts = Parts.of_frame(request.by, first, whole)
    model = pot
    if pot is not None and pot.fields and work.bond and grid is not None:
        from ..decomposers.long_range.kspace import for_tolerance

        pot = for_tolerance(pot, request.tolerance, exactly=work.beyond_bonds)
    completed = replace(
        request,
        traj=frames,
        pot=pot,
        grid=grid,
        reference=reference,
        threads=threads,
        workers=int(workers),
        tiles=tiles,
        select=chosen,
    )
    follow = None
    if work.grid_users and isinstance(grid, Grid) and grid.follows_mass:
        follow = Follow.of(first, None if chosen is None else chosen.of(first), grid.follows)
    return Job(completed, frames, first, work, model, parts, follow)


def has_bin_means(grid) -> bool:
    """Whether values are means over bins, which need no kernel."""
    return isinstance(grid, Grid) and grid.bin_means


def local_axes(grid) -> tuple[str, ...]:
    """The axes that components on a grid are along, if not x, y, z."""
    return grid.local_axes if isinstance(grid, Grid) else ()


def _velocity(request: Request) -> dict:
    """What thermal motion is relative to, and the quantities with those that averages of it need."""
    velocity = request.velocity
    if through_planes(request.grid):
        if velocity not in (None, "none"):
            raise AtcError(
                f'velocity {velocity!r}: planes see all momentum that atoms carry through: leave it out (or "none")'
            )
        return {"velocity": "none"}
    if velocity is None:
        # Nodes of a body have no temperature that few of them would show too little of.
        velocity = "local" if request.pot is not None and request.pot.horizon is not None else "frame"
    quantities = [request.quantities] if isinstance(request.quantities, str) else list(request.quantities)
    found = Work.of(quantities).quantities
    if request.average is not False and any(q.thermal for q in found):
        if velocity == "average":
            quantities += [name for name in ("density", "momentum") if name not in quantities]
            if any(q.name == "temperature" for q in found):
                quantities.append("_degrees")
        elif velocity == "frame" and any(q.thermal and q.rank == 2 for q in found):
            quantities += ["_number", "_paired"]
    return {"velocity": velocity, "quantities": quantities}


def _reference(request: Request, frames, pot):
    """The reference frame, wherever it is."""
    from ..frame import Frame

    reference = request.reference
    if reference is None:
        return None
    if isinstance(reference, Frame):
        return pot.complete(reference) if pot is not None and pot.setup is not None else reference
    if not isinstance(reference, (int, np.integer)):
        return as_frames(reference, pot)[0]
    try:
        return frames[int(reference)]
    except IndexError:
        raise AtcError(f"reference {reference}: the trajectory has {len(frames)} frames") from None


def _tiles(tiles, flat: bool) -> tuple[int, int, int]:
    t = np.asarray(tiles)
    shapes = ((3,), (2,)) if flat else ((3,),)
    if t.dtype.kind not in "iu" or t.shape not in shapes or (t < 1).any() or (flat and t[2:].any() and t[2] != 1):
        count, example = ("two", "(2, 2)") if flat else ("three", "(2, 2, 1)")
        raise AtcError(f"tiles {tiles!r}: expected {count} whole numbers, 1 or more, e.g. {example}")
    x, y, z = (*t.tolist(), 1)[:3]
    return x, y, z


class Job:
    """A request that is ready to be computed.

    Attributes
    ----------
    request : Request, completed: its potential, grid, reference, threads, workers and tiles are those that are used
    frames, first : the frames, and the first of them
    work : what is to be summed
    model : the potential that was given, which the run's forces are held against; that of the request may be less
        accurate, as far as the tolerance of fields allows
    parts : `selections.Parts` that fields are taken apart by, or None
    follow : `moving.Follow` of a grid that moves with the atoms, or None
    threads : within a frame
    methods : of each deposit, for all frames; fixed by what the first ones need (`fix_methods`)
    """

    def __init__(
        self, request: Request, frames: Sequence, first, work: Work, model: Interactions | None,
        parts: Any = None, follow: Any = None,
    ):  # fmt: skip
        self.request, self.frames, self.first, self.work, self.model = request, frames, first, work, model
        self.parts, self.follow = parts, follow
        self.n_frames, self.threads = len(frames), int(request.threads or 1)
        self.methods = self.methods_for(work, request.method)

    def methods_for(self, work: Work, method: str = "auto") -> dict[str, Method]:
        """The method of each deposit, by the cost model and the first frame: the same for every frame, whoever computes
        it."""
        from .method_choice import choose_methods

        return choose_methods(self, work, method)

    def places(self, work: Work) -> dict | None:
        """For each deposit that a frame needs, the bound grid and the cell that its atoms are in; None where something
        for that is missing."""
        asked = self.request
        if asked.kern is None or asked.grid is None or (work.bond_users and asked.pot is None):
            return None
        if through_planes(asked.grid):
            return None
        out = {key: (self.bound, self.first.cell) for key in ("site", "bond", "gather") if getattr(work, key)}
        for key in ("reference_bond", "reference_gather"):
            if getattr(work, key):
                if self.request.reference is None:
                    return None
                at = self.request.reference
                out[key] = asked.grid.bind(at.units, at.cell, at.positions), at.cell
        return out

    def may_loosen(self, work: Work) -> bool:
        """Whether sums over bonds may begin above the tolerance: where the largest errors are known to be found, around
        the strongest bonds."""
        return work.bond == ["stress"] and self.request.tiles is None

    def fix_methods(self, result: FrameResult) -> None:
        """Fix the methods for all frames: those that the first one needed (a `FrameResult`), for further ones adjusted
        by the error it was left with."""
        self.methods = dict(result.methods)
        method = self.methods.get("bond", EXACT)
        errors = [result.expected[q.name] for q in self.work.quantities if q.bond and q.name in result.expected]
        if self.n_frames > 1 and not method.exact and not method.forced and errors and self.may_loosen(self.work):
            from .method_choice import SpectralWays, adjusted

            place, load = (self.bound, self.kernel_internal, self.first.cell), self.load
            bonds = load.bonds, load.length, self.work.n_bond
            ways = SpectralWays(self.costs, *place, *bonds, carried=float(len(self.first)), frames=self.group())
            self.methods["bond"] = adjusted(method, max(errors), self.request.tolerance, ways)

    def forecast(self):
        """What a pass over the bonds of the first frame says of its error."""
        from .error_forecast import ErrorForecast

        return ErrorForecast(
            self.request.pot, self.first, self.bound, self.kernel_internal, self.request.tolerance, self.threads
        )

    @cached_property
    def costs(self):
        from .costs import Costs

        return Costs.load()

    @cached_property
    def bound(self):
        """The grid on the first frame."""
        grid = self.request.grid
        assert grid is not None, "nothing asked is on a grid"
        return grid.bind(self.first.units, self.first.cell, self.first.positions)

    @cached_property
    def kernel_internal(self):
        from ..estimators.accuracy.random_points import kernel_internal

        return kernel_internal(self.request.kern, self.first.units)

    @cached_property
    def horizon(self) -> float:
        """That of the quantities that need one, internal units."""
        from ..estimators.peridynamic import horizon_of

        asked = self.request
        return horizon_of(asked.horizon, asked.pot, asked.grid, self.first.units, self.work.horizon_users)

    @cached_property
    def load(self):
        """Pairs, triplets and bonds of the first frame, estimated."""
        from .costs import Load, load_of

        return load_of(self.request.pot, self.first) if self.work.bond_users else Load()

    @cached_property
    def held(self) -> dict:
        """What an output says of the forces of constraints (what was held, what they were found from, how far off they
        are in the first frame) and from outside."""
        pot, work = self.request.pot, self.work
        if pot is None or (not work.force_users and (not work.bond_users or pot.constraints is None)):
            from ..decomposers.constraints.topology import said_of_degrees

            return said_of_degrees(pot, self.first) if "degrees" in work.site else {}
        d = pot.stream(self.first, None, threads=self.threads, forces=bool(work.force_users))
        out = {} if d.held is None else pot.constraints.attributes(d.held)
        if work.force_users:
            out["body_force_source"] = pot.body_forces(self.first, d.forces_nc)[1]
        return out

    def field_sums(self, tight: bool = False):
        """`field_pass.FieldSums` of the long-range terms, None if nothing is summed over them on the grid."""
        asked = self.request
        if asked.pot is None or not asked.pot.fields or not self.work.bond or asked.kern is None or asked.grid is None:
            return None  # and planes are refused where there is a field
        from ..estimators.field_pass import FieldSums

        return FieldSums(
            asked.pot.fields, self.work.bond, self.bound, self.kernel_internal, asked.tolerance, self.threads, tight
        )

    @property
    def method_used(self) -> str:
        return summary(self.methods)

    @property
    def window(self) -> int:
        """Frames that make one entry of the output."""
        average = self.request.average
        return 1 if average is False else self.n_frames if average is True else int(average)

    @cached_property
    def added_up(self) -> frozenset[str]:
        """The deposits ("site", "bond") that frames of a window are added up in; see `estimators.groups`."""
        grid, first = self.request.grid, self.first
        series = self.request.average is False or self.n_frames < 2
        if series or self.request.tiles is not None or grid is None or self.follow is not None:
            return frozenset()
        if grid.follows_atoms or through_planes(grid):
            return frozenset()
        if groups.size_of(min(self.window, self.n_frames), len(first)) == 1:
            return frozenset()
        found = groups.added_up(self.work)
        if not found or not first.cell.complete:
            return frozenset()
        try:
            return found if self.frames[1].cell == first.cell else frozenset()
        except (AtcError, IndexError):  # its own turn will come to say what is wrong with it
            return frozenset()

    def group(self, k: int = 0) -> int:
        """How many frames are added up in the window of frame `k`."""
        begin = k - k % self.window
        return groups.size_of(min(self.window, self.n_frames - begin), len(self.first)) if self.added_up else 1

    def groups(self, start: int = 0) -> Iterator[tuple[int, int]]:
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

    def settings(self, anchor=None) -> Settings:
        """What a worker needs. anchor : a list of neighbours kept for many frames, see `atc.neighbors.verlet`"""
        asked, names = self.request, tuple(q.name for q in self.work.quantities)
        reference = asked.reference if self.work.reference_users else None
        return Settings(
            names,
            asked.pot,
            asked.kern,
            asked.grid,
            dict(self.methods),
            asked.tolerance,
            reference,
            self.threads,
            horizon=asked.horizon,
            tiles=asked.tiles,
            anchor=anchor,
            selection=asked.select,
            bonds=asked.bonds,
            parts=self.parts,
            velocity=asked.velocity,
            follow=self.follow,
        )

    def alarm(self):
        """Whether the run's forces, and its log, are those of the potential (`run_check.RunCheck`). Warns, or raises
        where they must agree."""
        from ..agreement.run_check import alarm

        asked, needed = self.request, bool(self.work.bond_users)
        how = {"mode": asked.forces, "log": asked.log, "threads": self.threads, "needed": needed}
        return alarm(self.frames, self.model, first=self.first, **how)


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
