"""What an output holds: its variables, coordinates and attributes, from a request and the result of one frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..estimators.columns import is_column, label
from ..estimators.field_pass import attributes
from ..estimators.planes import ABOUT, counted_how
from ..estimators.registry import hidden
from ..estimators.results import FrameResult
from ..grids.planes import through_planes
from ..planning.job import Job, local_axes
from .as_scene import scene_of
from .output import Layout, Variable
from .thermal import described


def follows_cell(job: Job) -> bool:
    """Whether the points of the grid move with the cell of each frame."""
    grid = job.request.grid
    on_grid = [q for q in job.work.quantities if q.kind == "grid" and not q.on_reference]
    return grid is not None and bool(on_grid) and grid.follows_cell


def grid_moves(job: Job) -> bool:
    """Whether the output needs the positions of the points for every entry: grids of atoms, and of a cell that changes
    from the first frame to the second."""
    if job.entries < 2:
        return False
    if follows_cell(job):
        return job.frames[1].cell != job.first.cell
    on_frames = set(job.work.grid_users) - set(job.work.on_reference)
    grid = job.request.grid
    return grid is not None and bool(on_frames) and grid.follows_atoms


def moving_coordinates(bound, u) -> dict:
    """Positions of the points at one time, under names that are no dimensions, as {name: (dims, values, attrs)}."""
    found = _grid_coordinates(bound, u)
    whole = {name: entry for name, entry in found.items() if name.startswith("position_")}
    return whole or {f"position_{name}": entry for name, entry in found.items()}


def output_layout(job: Job, frame, result: FrameResult, moves: bool = False) -> Layout:
    """All variables and attributes of the output."""
    from .. import __version__

    work, u = job.work, frame.units
    bound = result.bound
    letters = cartesian = np.array(["x", "y", "z"])
    axes = local_axes(job.request.grid) if work.grid_users else ()
    if axes:
        letters = np.array(axes)
    grid_dims = tuple(bound.dims) if bound is not None else ()
    f8, i8 = np.dtype(np.float64), np.dtype(np.int64)
    variables: list[Variable] = []

    def static(name, dims, values, **attrs):
        values = np.asarray(values)
        variables.append(Variable(name, tuple(dims), values.shape, values.dtype, attrs, static=values, coordinate=True))

    def moving(name, dims, shape, dtype, coordinate=False, **attrs):
        variables.append(Variable(name, tuple(dims), tuple(shape), dtype, attrs, coordinate=coordinate))

    # The first coordinates are those that xarray's pictures name in their titles: which component it is.
    static("i", ("i",), letters, long_name="direction of a vector; first index of a tensor")
    if any(q.rank == 2 for q in work.quantities):
        static("j", ("j",), letters, long_name="second index of a tensor")
    first_of = "first frame of the window" if job.request.average is not False else "frame"
    numbers = np.arange(job.entries, dtype=i8) * job.window
    static("frame", ("frame",), numbers, long_name=f"number of the {first_of} in the trajectory")
    moving("step", (), (), i8, True, long_name=f"time step of the {first_of} (-1: unknown)")
    moving("time", (), (), f8, True, units=u.label("time"), long_name=f"time of the {first_of}")
    # Not along i, so that they are no coordinates of one component of a field.
    xyz = "cartesian"
    static(xyz, (xyz,), cartesian, long_name="direction of the cell's vectors")
    moving("cell", ("edge", xyz), (3, 3), f8, True, units=u.label("length"), long_name="edge vectors of the cell")
    moving("cell_origin", (xyz,), (3,), f8, True, units=u.label("length"), long_name="origin of the cell")
    if any(q.kind == "atom" for q in work.quantities):
        static("atom", ("atom",), frame.ids.astype(i8), long_name="atom id")
    apart: tuple[str, ...] = ()
    if job.parts is not None:
        apart = ("species",)
        static("species", apart, np.array(job.parts.labels), long_name=f"{job.parts.by} of the atoms")
    if job.follow is not None:
        moving("grid_shift", (xyz,), (3,), f8, True, units=u.label("length"),
               long_name=f"how far the grid has moved with the atoms, {first_of}")  # fmt: skip
    if bound is not None:
        at_times = moving_coordinates(bound, u) if moves else {}
        for name, (dims, values, attrs) in at_times.items():
            moving(name, dims, values.shape, f8, True, **attrs)
        for name, (dims, values, attrs) in _grid_coordinates(bound, u).items():
            if name not in at_times:
                noted = {"comment": f"of the first frame; position_{name} has every frame's"} if moves else {}
                static(name, dims, values, **attrs, **noted)
    tail = {0: (), 1: ("i",), 2: ("i", "j")}
    told = {"units": "1", "sign_convention": "none"}  # what is no field
    shown = [q for q in work.quantities if not hidden(q.name)]
    crossing = through_planes(job.request.grid)
    for q in shown:
        head = apart + {"grid": grid_dims, "box": (), "atom": ("atom",)}[q.kind]
        shape = result.arrays[q.name].shape
        unit = label(q.name, u, job.request.column_units) if is_column(q.name) else u.label(q.dimension)
        called, said = ABOUT[q.name] if crossing and q.name in ABOUT else (q.long_name, q.comment)
        attrs = {"units": unit, "long_name": called, "sign_convention": q.sign}
        if u.dimension == 2:
            attrs["dimension"] = 2
        if apart:
            attrs["of_species"] = "each one's own" if q.weight is not None else "shares that add up"
        comment = [_in_plane(said) if u.dimension == 2 else said] if said else []
        if why := "" if crossing else described(job.request.velocity, q):
            comment.append(why)
        if job.request.average is not False:
            of = f"<w X>/<w>, w the {_WEIGHTS[q.weight]}" if q.weight else "of the fields of the frames"
            comment.append(f"time average {of}")
        moving(q.name, head + tail[q.rank], shape, f8, **attrs, **({"comment": "; ".join(comment)} if comment else {}))
        if job.request.average is not False:
            dims = head + tail[q.rank]
            error = {"units": unit, "long_name": f"standard error of {called}", "sign_convention": "positive"}
            how = "by block averaging; a lower bound where the blocks still correlate"
            moving(f"{q.name}_stderr", dims, shape, f8, **error, comment=how)
            how = f"whether the blocks still correlate (or are too few to tell), so that {q.name}_stderr is a lower"
            moving(f"{q.name}_correlated", dims, shape, np.dtype(bool), **told, long_name=f"{how} bound")
    if result.mask is not None:
        what = "whether there is mass within the kernel: velocity and whatever is relative to it are NaN where not"
        moving("mask", apart + grid_dims, result.mask.shape, np.dtype(bool), **told, long_name=what)
    if job.request.average is not False:
        moving("frames_averaged", (), (), i8, **told, long_name="number of frames in the average")
    attrs = {
        "Conventions": "CF-1.11",  # in style: names, units, long_name; units are those of the run, not always UDUNITS's
        "atc_version": __version__,
        "version": __version__,
        "units": u.name,
        "tolerance": float(job.request.tolerance),
        "quantities": ", ".join(q.name for q in shown),
    }
    if work.horizon_users:
        attrs.update(
            horizon=u.to_user("length", job.horizon),
            horizon_units=u.label("length"),
        )
    grid = job.request.grid
    if grid is not None and not work.kernel_users:
        attrs.update(method="counted" if crossing else job.method_used, grid=grid.describe())
        if crossing and work.site:
            attrs["passages_counted"] = counted_how(grid, job.request.pot, u)
    elif grid is not None and job.request.kern is not None:
        attrs.update(
            kernel=job.request.kern.describe(),
            radius=float(job.request.kern.radius),
            radius_units=u.label("length"),
            method=job.method_used,
            grid=grid.describe(),
        )
    if any(q.thermal for q in shown) and not crossing:
        attrs["thermal_motion"] = f"relative to: {job.request.velocity}"
    if work.bond_users and job.request.pot is not None:
        attrs["decomposition"] = job.request.pot.describe()
        attrs.update(job.request.pot.attributes)
        attrs.update(job.held)
        if (sums := job.field_sums()) is not None:
            attrs.update(attributes(sums, job.request.pot.complete(job.first)))
    elif "degrees" in work.site:
        attrs.update(job.held)
    if job.request.select is not None:
        attrs["selected_atoms"] = job.request.select.describe()
    if (job.request.select is not None or apart) and work.bond_users:
        attrs["selected_bonds"] = _BONDS[job.request.bonds] if job.request.select is not None else _BONDS["half"]
    if axes:
        attrs["axes"] = " ".join(axes)
    attrs["dimension"] = u.dimension
    attrs["periodic"] = "".join("p" if p else "f" for p in frame.cell.periodic[: u.dimension])
    attrs["scene"] = str(job.request.scene) if job.request.scene else scene_of(job)
    return Layout(variables, job.entries, attrs)


def asymmetry(stress_gij) -> float:
    """max |σ − σᵀ|/2 over the points, relative to the largest |σ|; points where it is not defined (NaN) apart."""
    across = np.abs(stress_gij - np.swapaxes(stress_gij, -1, -2))[np.isfinite(stress_gij)] / 2
    largest = np.abs(stress_gij)[np.isfinite(stress_gij)].max(initial=0.0)
    return float(across.max(initial=0.0) / largest) if largest else 0.0


def in_output_units(layout: Layout, given) -> tuple[Layout, dict[str, float]]:
    """The layout with the units that an output shall have, and the factors of what is written of each variable.

    Raises
    ------
    AtcError where no variable has the dimension of one of them.
    """
    from ..units.words import converted, require_used, wanted_units

    wanted, factors, variables = wanted_units(given), {}, []
    require_used(wanted, [v.attrs.get("units", "") for v in layout.variables], str(given))
    for v in layout.variables:
        factor, text = converted(str(v.attrs.get("units", "")), wanted)
        if "units" in v.attrs and text != v.attrs["units"]:
            static = None if v.static is None else v.static * factor
            dtype = v.dtype if static is None else static.dtype
            v = replace(v, attrs={**v.attrs, "units": text}, static=static, dtype=dtype)
            factors[v.name] = factor
        variables.append(v)
    attrs = {**layout.attrs, "output_units": ", ".join(u.text for u in wanted)}
    return Layout(variables, layout.entries, attrs), factors


_BONDS = {
    "half": "half of each bond for every end that is selected",
    "both": "bonds with both ends selected",
    "one": "bonds with one end selected and one that is not",
    "any": "bonds with at least one end selected",
}


def _in_plane(comment: str) -> str:
    """What a quantity's comment says of three dimensions, for two."""
    for space, plane in (
        ("(3 n k_B): three degrees of freedom per atom", "(2 n k_B): two degrees of freedom per atom"),
        ("stress times volume", "stress times area"),
        ("the volume of the horizon", "the area of the horizon"),
        ("heat flux times volume", "heat flux times area"),
    ):
        comment = comment.replace(space, plane)
    return comment


_WEIGHTS = {"mass": "mass density", "one": "number density", "degrees": "number density (of degrees of freedom)"}


def _grid_coordinates(bound, u) -> dict:
    """The grid's coordinates as {name: (dims, values, attrs)}."""
    out = {}
    for name, (dims, values, *attrs) in bound.coords(u).items():
        dims = (dims,) if isinstance(dims, str) else tuple(dims)
        out[name] = dims, np.asarray(values), dict(attrs[0]) if attrs else {}
    return out
