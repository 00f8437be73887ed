"""A request made in Python as the scene that would say the same: what an output keeps of how it was made."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np

from ..config.toml import toml_document
from ..estimators.registry import hidden
from ..frame import Cell
from ..grids import Grid
from ..kernels.unsmoothed import Unsmoothed
from ..units import LAMMPS_STYLES

# More points than these are not repeated in an attribute: the output holds them as coordinates.
_MOST_POINTS = 1000


def scene_of(job) -> str:
    """The scene as TOML, comments where TOML has no words for what was given (potentials made of objects, frames in
    memory).

    Of files only the names are kept: directories hold user and host names.
    """
    sections = {
        "trajectory": _trajectory(job),
        "potential": _potential(job.request.pot),
        "kernel": _kernel(job.request.kern),
        "grid": None if job.request.grid is None else _grid(job.request.grid, job.first.units),
        "select": _selection(job),
        "fields": {
            "quantities": [q.name for q in job.work.quantities if not hidden(q.name)],
            **({"velocity": job.request.velocity} if any(q.thermal for q in job.work.quantities) else {}),
            **({"column_units": job.request.column_units} if job.request.column_units else {}),
            "tolerance": float(job.request.tolerance),
            "method": job.request.method,
            "average": job.request.average if isinstance(job.request.average, bool) else int(job.request.average),
        },
    }
    if job.request.output_units is not None:
        given = job.request.output_units
        sections["output"] = {"units": given if isinstance(given, str) else ", ".join(map(str, given))}
    return toml_document({name: {k: _plain(v) for k, v in table.items()} for name, table in sections.items() if table})


def file_name(source) -> str:
    """The name of a source without directories, and without the frame's number."""
    return PurePosixPath(re.sub(r",?\s+frame \d+$", "", str(source)).replace("\\", "/")).name


def _plain(v):
    if isinstance(v, np.ndarray):
        return v.tolist()
    if isinstance(v, np.generic):
        return v.item()
    return [_plain(x) for x in v] if isinstance(v, (list, tuple)) else v


def _trajectory(job) -> dict:
    units = job.first.units.name
    table = {"file": file_name(job.first.source)}
    if units in (*LAMMPS_STYLES, "gpumd"):
        table["units"] = units
    return table


def _potential(pot) -> dict | None:
    if pot is None:
        return None
    text, file = pot.text, pot.file
    if pot.learned is not None:
        maker, name, options = pot.learned
        said = {k: [t or "NULL" for t in v] if k == "types" else v for k, v in options.items() if v is not None}
        return {maker: name, **said}
    if file is not None:
        return {"input": file, "units": pot.units.name}
    if text is not None:
        return {"lammps": text, "units": pot.units.name}
    return {"#": " ".join(pot.describe().split())}


def _selection(job) -> dict:
    asked = job.request
    table = {} if asked.select is None else asked.select.plain()
    if asked.by is not None:
        table["by"] = asked.by
    return table | ({"bonds": asked.bonds} if asked.bonds != "half" else {})


def _kernel(kern) -> dict | None:
    return None if kern is None or isinstance(kern, Unsmoothed) else {"name": kern.name, **kern.parameters}


def _grid(grid, units) -> dict:
    if type(grid) is not Grid:  # one's own, which scenes know nothing of
        return {"#": grid.describe()}
    p: dict = grid._
    table: dict = {"kind": grid.kind}
    if grid.kind == "points":
        table |= {"follow": p["follow"]} if grid.follows_mass else {}
        if len(p["xyz"]) > _MOST_POINTS:
            return {**table, "#": f"{len(p['xyz'])} points: see the coordinates"}
        return {**table, "points": p["xyz"]}
    for key in ("shape", "spacing", "axis", "position", "origin", "u", "v", "start", "end", "n", "bins", "padding",
                "means", "positions", "patches", "interval", "center", "radius", "inner", "length",
                "follow"):  # fmt: skip
        if p.get(key) is not None:
            table[key] = "xyz"[p[key]] if key == "axis" else p[key]
    if grid.kind == "regular" and "shape" in table and table["shape"][-1] <= 0:
        # one number for all axes, or two of a two-dimensional run
        table["shape"] = table["shape"][0] if table["shape"][-1] else list(table["shape"][:2])
    if "shift" in p:
        table["at"] = "centers" if p["shift"] else "corners"
    region = p.get("cell")
    if isinstance(region, Cell):
        table.setdefault("origin", units.to_user("length", region.origin))
        region = units.to_user("length", region.vectors)
    if region is not None:
        table["vectors"] = region
    return table
