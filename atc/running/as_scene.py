"""A request made in Python as the scene that would say the same: what an output keeps of how it was made."""

from __future__ import annotations

import re
from pathlib import PurePosixPath

import numpy as np

from ..config.toml import toml_key, toml_value
from ..frame import Cell
from ..grids import Grid
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
        "kernel": None if job.request.kern is None else {"name": job.request.kern.name, **job.request.kern.parameters},
        "grid": None if job.request.grid is None else _grid(job.request.grid, job.first.units),
        "fields": {
            "quantities": [q.name for q in job.work.quantities],
            **({"column_units": job.request.column_units} if job.request.column_units else {}),
            "tolerance": float(job.request.tolerance),
            "method": job.request.method,
            "average": job.request.average if isinstance(job.request.average, bool) else int(job.request.average),
        },
    }
    out = []
    for name, table in sections.items():
        if not table:
            continue
        out.append(f"[{name}]")
        for key, value in table.items():
            out.append(f"# {value}" if key == "#" else f"{toml_key(key)} = {toml_value(_plain(value))}")
        out.append("")
    return "\n".join(out)


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
    if units in LAMMPS_STYLES:
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


def _grid(grid, units) -> dict:
    if type(grid) is not Grid:  # one's own, which scenes know nothing of
        return {"#": grid.describe()}
    p, table = grid._, {"kind": grid.kind}
    if grid.kind == "points":
        if len(p["xyz"]) > _MOST_POINTS:
            return {"kind": "points", "#": f"{len(p['xyz'])} points: see the coordinates"}
        return {"kind": "points", "points": p["xyz"]}
    for key in ("shape", "spacing", "axis", "position", "origin", "u", "v", "start", "end", "n", "bins", "padding"):
        if p.get(key) is not None:
            table[key] = "xyz"[p[key]] if key == "axis" else p[key]
    if "shift" in p:
        table["at"] = "centers" if p["shift"] else "corners"
    region = p.get("cell")
    if isinstance(region, Cell):
        table.setdefault("origin", units.to_user("length", region.origin))
        region = units.to_user("length", region.vectors)
    if region is not None:
        table["vectors"] = region
    return table
