"""How Hardy's stress and the virial stress differ: a table, as text, JSON, CSV and a picture; several in one table."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..errors import AtcError
from ..pictures.comparison import compare_figure
from ..pictures.drawing import save
from ..running.output import plain
from ..terminal import tell

SIX = ("xx", "yy", "zz", "xy", "xz", "yz")
POINTWISE = "pointwise, Hardy - smoothed virial"
RELATIVE = "Hardy - smoothed virial relative to the largest component of Hardy's stress; box average: Hardy - virial"


@dataclass
class Comparison:
    """How Hardy's stress and the virial stress differ.

    Attributes
    ----------
    rows : list of dicts with ``section``, ``name`` and, where they apply, ``hardy``, ``virial``, ``difference``,
        ``relative`` (to the largest
        Hardy component), ``stderr_difference`` or ``stderr_virial`` and ``sigmas`` (difference in standard errors);
        stresses in `units`, tension positive
    data : xarray.Dataset with ``profile_*`` (axis profiles of both) and ``difference`` (Hardy − smoothed virial,
        pointwise) where the output allows
    notes : what could not be compared, and why
    attrs : kernel, radius, method, tolerance, measured error of the output
    place : atc.pictures.geometry.Places of the points
    dimension : of the run, 3 or 2
    """

    rows: list[dict]
    data: object
    units: str
    title: str
    notes: list[str] = field(default_factory=list)
    attrs: dict = field(default_factory=dict)
    place: object = None
    dimension: int = 3

    def json(self) -> str:
        """The table as JSON, numbers unrounded."""
        return json.dumps(
            {"title": self.title, "units": self.units, **self.attrs, "rows": self.rows, "notes": self.notes},
            indent=2,
            default=plain,
        )

    def csv(self) -> str:
        """The table as CSV, numbers unrounded."""
        out = io.StringIO()
        columns = list(dict.fromkeys(k for row in self.rows for k in row))
        writer = csv.DictWriter(out, columns, lineterminator="\n")
        writer.writeheader()
        writer.writerows({k: plain(v) if isinstance(v, np.generic) else v for k, v in row.items()} for row in self.rows)
        return out.getvalue()

    def value(self, section: str, name: str, column: str = "difference"):
        """One number of the table."""
        for row in self.rows:
            if row["section"] == section and row["name"] == name:
                return row[column]
        raise KeyError((section, name))

    def tables(self):
        """(section, titles of columns, rows) of each section as text, the names first."""
        for section in dict.fromkeys(r["section"] for r in self.rows):
            rows = [r for r in self.rows if r["section"] == section]
            columns = list(dict.fromkeys(k for r in rows for k in r if k not in ("section", "name")))
            head = ["", *(_heading(c, self.units) for c in columns)]
            yield section, head, [[r["name"], *(_cell(c, r.get(c)) for c in columns)] for r in rows]

    def print(self, console) -> None:
        """The table, one block a section."""
        from rich import box
        from rich.table import Table

        tell(console, [self.title])
        for section, head, rows in self.tables():
            console.print(f"\n{section}", style="bold", soft_wrap=True)
            table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
            for k, title in enumerate(head):
                table.add_column(title, justify="right" if k else "left")
            for row in rows:
                table.add_row(*row)
            console.print(table)
        tell(console, (), self.notes)

    def picture(self, path) -> Path:
        """Draw the comparison; returns the path."""
        return save(compare_figure(self), path)


_HEADINGS = {
    "hardy": "Hardy",
    "virial": "virial",
    "difference": "Hardy - virial",
    "stderr_difference": "std. error of the difference",
    "stderr_virial": "std. error of the virial",
    "rms": "rms",
    "max": "max",
}


def _heading(column, units):
    if column == "sigmas":
        return "in std. errors"
    if ", " in column or column == "relative box average":  # in tables whose title says that everything is relative
        return column.removeprefix("relative ")
    return f"{_HEADINGS[column]} ({units})" if column in _HEADINGS and units else _HEADINGS.get(column, column)


def _cell(column, v) -> str:
    if v is None:
        return ""
    if isinstance(v, str):
        return v
    if isinstance(v, (bool, np.bool_)):
        return "yes" if v else "no"
    if column.startswith("relative"):
        return f"{100 * v:.2g} %" if abs(v) >= 1e-7 else f"{100 * v:.0e} %"
    if column.startswith("measured"):
        return f"{v:.1e}"
    if column in ("sigmas", "rms in std. errors"):
        return f"{v:.2g}"
    return f"{v:.5g}" if abs(v) < 1e6 else f"{v:.4e}"


def side_by_side(
    results: list[Comparison], labels=None, section=f"by output, {RELATIVE}", coordinate=None
) -> Comparison:
    """Several comparisons in one table: relative to each one's largest stress component."""
    import xarray as xr

    labels = labels or [r.title for r in results]
    units = {r.units for r in results}
    if len(units) > 1:
        raise AtcError(f"these outputs are in different units ({', '.join(sorted(units))}): they cannot share a table")
    if len({r.dimension for r in results}) > 1:
        raise AtcError("some of these outputs are of two-dimensional runs, others not: they cannot share a table")
    out = Comparison([], xr.Dataset(), units.pop(), "", [], dimension=results[0].dimension)
    box = "box average"
    numbers: dict[str, list[float]] = {}
    for label, r in zip(labels, results):
        row = {"section": section, "name": label}
        for c in ("hydrostatic", "vonmises"):
            for column in ("relative rms", "relative max"):
                row[f"{column}, {c}"] = _try(r, POINTWISE, c, column)
        worst = [_try(r, POINTWISE, c, "relative max") for c in SIX]
        row["relative max, any component"] = max((w for w in worst if w is not None), default=None)
        boxes = [_try(r, f"{box}, potential part", c, "relative") for c in SIX]
        boxes = [_try(r, box, c, "relative") if b is None else b for b, c in zip(boxes, SIX)]
        row["relative box average"] = max((b for b in boxes if b is not None), default=None)
        out.rows.append(row)
        out.notes += [n for n in r.notes if n not in out.notes]
        for k, v in row.items():
            if k not in ("section", "name"):
                numbers.setdefault(k, []).append(np.nan if v is None else v)
    out.attrs = {k: results[0].attrs[k] for k in ("radius_units",) if k in results[0].attrs}
    dim, values = coordinate or ("output", np.asarray(labels))
    out.data = xr.Dataset(
        {k.replace(", ", "_").replace(" ", "_"): (dim, v) for k, v in numbers.items()}, coords={dim: values}
    )
    return out


def _try(result, section, name, column):
    try:
        return result.value(section, name, column)
    except KeyError:
        return None
